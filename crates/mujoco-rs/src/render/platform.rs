//! Which OpenGL library draws.

use std::env;
use std::sync::OnceLock;

use super::RenderError;
use super::context::Context;
use super::egl::{self, Egl};
use super::osmesa::OsMesa;

/// The environment variable that forces a library, as in MuJoCo's own Python bindings.
pub const VARIABLE: &str = "MUJOCO_GL";

/// A loaded OpenGL library that gave a context.
pub(super) enum Platform {
    Egl(Egl),
    OsMesa(OsMesa),
}

impl Platform {
    fn name(&self) -> &'static str {
        match self {
            Platform::Egl(_) => "EGL",
            Platform::OsMesa(_) => "OSMesa",
        }
    }

    /// A new context.
    pub(super) fn context(&'static self) -> Result<Context, RenderError> {
        match self {
            Platform::Egl(egl) => egl.context().map(Context::Egl),
            Platform::OsMesa(osmesa) => osmesa.context().map(Context::OsMesa),
        }
        .map_err(RenderError::Context)
    }
}

/// The library of this process. MuJoCo looks its OpenGL functions up once and keeps them, so the
/// library is chosen once as well and never unloaded.
pub(super) fn platform() -> Result<&'static Platform, RenderError> {
    static PLATFORM: OnceLock<Result<Platform, RenderError>> = OnceLock::new();
    PLATFORM.get_or_init(find).as_ref().map_err(Clone::clone)
}

/// Name of the OpenGL library that pictures are drawn with.
///
/// # Errors
/// If there is none, or none of the name in the environment variable [`VARIABLE`].
pub fn available() -> Result<&'static str, RenderError> {
    platform().map(Platform::name)
}

fn find() -> Result<Platform, RenderError> {
    let forced = env::var_os(VARIABLE).unwrap_or_default();
    let egl = || Egl::load().map(Platform::Egl);
    let osmesa = || OsMesa::load().map(Platform::OsMesa);
    match forced.to_string_lossy().to_lowercase().as_str() {
        "" => egl().or_else(|egl| {
            if egl::is_loaded() {
                return Err(RenderError::InTheWay(egl));
            }
            osmesa().map_err(|osmesa| RenderError::NoRenderer { egl, osmesa })
        }),
        "egl" => egl().map_err(|reason| RenderError::Forced {
            name: "egl",
            package: "libegl1` and a driver for it, such as `libegl-mesa0",
            reason,
        }),
        "osmesa" => osmesa().map_err(|reason| RenderError::Forced {
            name: "osmesa",
            package: "libosmesa6",
            reason,
        }),
        _ => Err(RenderError::UnknownLibrary(
            forced.to_string_lossy().into_owned(),
        )),
    }
}
