//! OSMesa: OpenGL in software, without any display.

use std::os::raw::{c_int, c_uchar, c_uint, c_void};
use std::ptr::{self, NonNull};

use libloading::os::unix::Library;

/// Names of the library, the newest interface first.
const NAMES: [&str; 3] = ["libOSMesa.so.8", "libOSMesa.so.6", "libOSMesa.so"];

const OSMESA_RGBA: c_uint = 0x1908;
const GL_UNSIGNED_BYTE: c_uint = 0x1401;
const DEPTH_BITS: c_int = 24;
const STENCIL_BITS: c_int = 8;
const ACCUMULATION_BITS: c_int = 0;

type CreateContext = unsafe extern "C" fn(c_uint, c_int, c_int, c_int, *mut c_void) -> *mut c_void;
type MakeCurrent = unsafe extern "C" fn(*mut c_void, *mut c_void, c_uint, c_int, c_int) -> c_uchar;
type DestroyContext = unsafe extern "C" fn(*mut c_void);

/// The loaded library.
pub(super) struct OsMesa {
    create_context: CreateContext,
    make_current: MakeCurrent,
    destroy_context: DestroyContext,
    /// Keeps the functions in place.
    _library: Library,
}

impl OsMesa {
    /// Loads the library and tries a context.
    ///
    /// # Errors
    /// Says what is missing.
    pub(super) fn load() -> Result<OsMesa, String> {
        let library = NAMES
            .iter()
            // SAFETY: Mesa's initialisers expect nothing of the process.
            .find_map(|name| unsafe { Library::new(*name) }.ok())
            .ok_or("libOSMesa.so.8 is not installed")?;
        let missing = |error: libloading::Error| error.to_string();
        // SAFETY: the types are those of the functions in `GL/osmesa.h`, and the pointers are kept
        // together with the library.
        let osmesa = unsafe {
            OsMesa {
                create_context: *library
                    .get::<CreateContext>(b"OSMesaCreateContextExt\0")
                    .map_err(missing)?,
                make_current: *library
                    .get::<MakeCurrent>(b"OSMesaMakeCurrent\0")
                    .map_err(missing)?,
                destroy_context: *library
                    .get::<DestroyContext>(b"OSMesaDestroyContext\0")
                    .map_err(missing)?,
                _library: library,
            }
        };
        let tried = osmesa.create()?;
        // SAFETY: just made, and never current.
        unsafe { (osmesa.destroy_context)(tried.as_ptr()) };
        Ok(osmesa)
    }

    pub(super) fn context(&'static self) -> Result<OsMesaContext, String> {
        Ok(OsMesaContext {
            raw: self.create()?,
            window: Box::new([0; 4]),
            library: self,
        })
    }

    fn create(&self) -> Result<NonNull<c_void>, String> {
        // SAFETY: the last argument, a context to share with, may be null.
        let raw = unsafe {
            (self.create_context)(
                OSMESA_RGBA,
                DEPTH_BITS,
                STENCIL_BITS,
                ACCUMULATION_BITS,
                ptr::null_mut(),
            )
        };
        NonNull::new(raw).ok_or_else(|| "OSMesa makes no context".to_owned())
    }
}

/// A context of OSMesa.
pub(super) struct OsMesaContext {
    raw: NonNull<c_void>,
    /// The window's buffer, one pixel: pictures are drawn into MuJoCo's own offscreen buffer.
    window: Box<[u8; 4]>,
    library: &'static OsMesa,
}

impl OsMesaContext {
    pub(super) fn make_current(&mut self) -> bool {
        let window = self.window.as_mut_ptr().cast();
        // SAFETY: the context is valid, and its window has room for one pixel of four bytes as long
        // as the context lives.
        unsafe {
            (self.library.make_current)(self.raw.as_ptr(), window, GL_UNSIGNED_BYTE, 1, 1) != 0
        }
    }
}

impl Drop for OsMesaContext {
    fn drop(&mut self) {
        // SAFETY: all null releases this thread's context; the context is owned and not used after.
        unsafe {
            (self.library.make_current)(ptr::null_mut(), ptr::null_mut(), 0, 0, 0);
            (self.library.destroy_context)(self.raw.as_ptr());
        }
    }
}
