//! EGL: OpenGL on a graphics device, or in software by the same driver interface, without a display
//! server.

use std::ffi::CStr;
use std::os::raw::{c_char, c_int, c_uint, c_void};
use std::ptr;

use libloading::os::unix::{Library, RTLD_LAZY, RTLD_LOCAL};

const NAME: &str = "libEGL.so.1";
/// `RTLD_NOLOAD` of glibc and musl: only finds a library that is loaded already.
const RTLD_NOLOAD: c_int = 4;

type Handle = *mut c_void;
type Boolean = c_uint;

const TRUE: Boolean = 1;
const OPENGL_API: c_uint = 0x30A2;
const PLATFORM_DEVICE: c_uint = 0x313F;
/// Devices that are tried; more than any machine has.
const MOST_DEVICES: usize = 32;

/// What the contexts must be able to draw: pairs of `EGL/egl.h`, closed by `EGL_NONE`.
const CONFIGURATION: [c_int; 15] = [
    0x3033, 0x0001, // EGL_SURFACE_TYPE: EGL_PBUFFER_BIT
    0x3040, 0x0008, // EGL_RENDERABLE_TYPE: EGL_OPENGL_BIT
    0x3024, 8, // EGL_RED_SIZE
    0x3023, 8, // EGL_GREEN_SIZE
    0x3022, 8, // EGL_BLUE_SIZE
    0x3025, 24, // EGL_DEPTH_SIZE
    0x3026, 8,      // EGL_STENCIL_SIZE
    0x3038, // EGL_NONE
];

/// The functions of EGL that are needed.
struct Functions {
    get_proc_address: unsafe extern "C" fn(*const c_char) -> Handle,
    initialize: unsafe extern "C" fn(Handle, *mut c_int, *mut c_int) -> Boolean,
    terminate: unsafe extern "C" fn(Handle) -> Boolean,
    bind_api: unsafe extern "C" fn(c_uint) -> Boolean,
    choose_config:
        unsafe extern "C" fn(Handle, *const c_int, *mut Handle, c_int, *mut c_int) -> Boolean,
    create_context: unsafe extern "C" fn(Handle, Handle, Handle, *const c_int) -> Handle,
    destroy_context: unsafe extern "C" fn(Handle, Handle) -> Boolean,
    make_current: unsafe extern "C" fn(Handle, Handle, Handle, Handle) -> Boolean,
    release_thread: unsafe extern "C" fn() -> Boolean,
}

type QueryDevices = unsafe extern "C" fn(c_int, *mut Handle, *mut c_int) -> Boolean;
type GetPlatformDisplay = unsafe extern "C" fn(c_uint, Handle, *const c_int) -> Handle;

/// The loaded library with an initialised display, which stays so for the rest of the process.
pub(super) struct Egl {
    functions: Functions,
    display: Handle,
    config: Handle,
    /// Keeps the functions in place.
    _library: Library,
}

// SAFETY: EGL's functions may be called from any thread, and display and configuration belong to the
// process.
unsafe impl Send for Egl {}
// SAFETY: as for `Send`.
unsafe impl Sync for Egl {}

impl Egl {
    /// Loads the library and finds the first device that gives a context.
    ///
    /// # Errors
    /// Says what is missing. The library is then unloaded again if it can be (see [`is_loaded`]).
    pub(super) fn load() -> Result<Egl, String> {
        // SAFETY: the initialisers of EGL's loader expect nothing of the process.
        let library = unsafe { Library::new(NAME) };
        let library = library.map_err(|_| format!("{NAME} is not installed"))?;
        let functions = Functions::find(&library).map_err(|error| error.to_string())?;
        match functions.first_display() {
            Some((display, config)) => Ok(Egl {
                functions,
                display,
                config,
                _library: library,
            }),
            None => {
                // SAFETY: takes no arguments; forgets what EGL keeps for this thread.
                unsafe { (functions.release_thread)() };
                Err("no device gives a context".to_owned())
            }
        }
    }

    pub(super) fn context(&'static self) -> Result<EglContext, String> {
        let raw = self.functions.new_context(self.display, self.config);
        Ok(EglContext {
            raw: raw.ok_or("EGL makes no context")?,
            egl: self,
        })
    }
}

/// Whether the library is part of the process, where MuJoCo would find it and call into it.
pub(super) fn is_loaded() -> bool {
    // SAFETY: loads nothing.
    unsafe { Library::open(Some(NAME), RTLD_LAZY | RTLD_LOCAL | RTLD_NOLOAD) }.is_ok()
}

impl Functions {
    fn find(library: &Library) -> Result<Functions, libloading::Error> {
        // SAFETY: the types are those of the functions in `EGL/egl.h`, and whoever holds the pointers
        // holds the library.
        unsafe {
            Ok(Functions {
                get_proc_address: *library.get(b"eglGetProcAddress\0")?,
                initialize: *library.get(b"eglInitialize\0")?,
                terminate: *library.get(b"eglTerminate\0")?,
                bind_api: *library.get(b"eglBindAPI\0")?,
                choose_config: *library.get(b"eglChooseConfig\0")?,
                create_context: *library.get(b"eglCreateContext\0")?,
                destroy_context: *library.get(b"eglDestroyContext\0")?,
                make_current: *library.get(b"eglMakeCurrent\0")?,
                release_thread: *library.get(b"eglReleaseThread\0")?,
            })
        }
    }

    /// Address of an extension's function; `None` if EGL knows none of that name.
    fn extension(&self, name: &CStr) -> Option<Handle> {
        // SAFETY: the name is zero-terminated.
        let address = unsafe { (self.get_proc_address)(name.as_ptr()) };
        (!address.is_null()).then_some(address)
    }

    /// Display and configuration of the first device that gives a context which can be made current.
    fn first_display(&self) -> Option<(Handle, Handle)> {
        let query = self.extension(c"eglQueryDevicesEXT")?;
        let get_display = self.extension(c"eglGetPlatformDisplayEXT")?;
        // SAFETY: EGL gave these addresses for functions of these types (EGL_EXT_device_enumeration
        // and EGL_EXT_platform_base).
        let (query, get_display) = unsafe {
            (
                std::mem::transmute::<Handle, QueryDevices>(query),
                std::mem::transmute::<Handle, GetPlatformDisplay>(get_display),
            )
        };
        let mut devices = [ptr::null_mut(); MOST_DEVICES];
        let mut count = 0;
        // SAFETY: there is room for as many devices as stated.
        let found = unsafe { query(MOST_DEVICES as c_int, devices.as_mut_ptr(), &mut count) };
        let count = usize::try_from(count).unwrap_or(0);
        if found != TRUE {
            return None;
        }
        devices.into_iter().take(count).find_map(|device| {
            // SAFETY: the device is one of those just listed; no attributes may be null.
            let display = unsafe { get_display(PLATFORM_DEVICE, device, ptr::null()) };
            self.configuration(display).map(|config| (display, config))
        })
    }

    /// A configuration of the display with which a context can be made current; the display is
    /// closed again if there is none.
    fn configuration(&self, display: Handle) -> Option<Handle> {
        // SAFETY: the versions may be null; an invalid display is refused.
        let opened = unsafe { (self.initialize)(display, ptr::null_mut(), ptr::null_mut()) };
        if display.is_null() || opened != TRUE {
            return None;
        }
        let config = self.try_configuration(display);
        if config.is_none() {
            // SAFETY: initialised above, and nothing of it is in use.
            unsafe { (self.terminate)(display) };
        }
        config
    }

    fn try_configuration(&self, display: Handle) -> Option<Handle> {
        let (mut config, mut count) = (ptr::null_mut(), 0);
        // SAFETY: the list is closed by EGL_NONE, and there is room for the one configuration asked
        // for.
        let chosen = unsafe {
            (self.choose_config)(display, CONFIGURATION.as_ptr(), &mut config, 1, &mut count)
        };
        if chosen != TRUE || count < 1 {
            return None;
        }
        let context = self.new_context(display, config)?;
        let current = self.make_current(display, context);
        self.free(display, context);
        current.then_some(config)
    }

    fn new_context(&self, display: Handle, config: Handle) -> Option<Handle> {
        // SAFETY: display and configuration are valid; no shared context and no attributes may be
        // null.
        let context = unsafe {
            if (self.bind_api)(OPENGL_API) != TRUE {
                return None;
            }
            (self.create_context)(display, config, ptr::null_mut(), ptr::null())
        };
        (!context.is_null()).then_some(context)
    }

    /// Makes the context current without a surface: pictures are drawn into MuJoCo's own offscreen
    /// buffer.
    fn make_current(&self, display: Handle, context: Handle) -> bool {
        let none = ptr::null_mut();
        // SAFETY: display and context are valid; a driver that needs surfaces refuses.
        unsafe {
            // The API is a setting of the thread.
            (self.bind_api)(OPENGL_API) == TRUE
                && (self.make_current)(display, none, none, context) == TRUE
        }
    }

    /// Frees a context of this thread.
    fn free(&self, display: Handle, context: Handle) {
        let none = ptr::null_mut();
        // SAFETY: without a context, the thread's current one is released; the context is not used
        // after.
        unsafe {
            (self.make_current)(display, none, none, none);
            (self.destroy_context)(display, context);
        }
    }
}

/// A context of EGL.
pub(super) struct EglContext {
    raw: Handle,
    egl: &'static Egl,
}

impl EglContext {
    pub(super) fn make_current(&mut self) -> bool {
        self.egl.functions.make_current(self.egl.display, self.raw)
    }
}

impl Drop for EglContext {
    fn drop(&mut self) {
        self.egl.functions.free(self.egl.display, self.raw);
    }
}
