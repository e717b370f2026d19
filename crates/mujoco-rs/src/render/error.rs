use super::platform::VARIABLE;
use super::renderer::LARGEST_SIDE;

/// Why a picture cannot be drawn.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RenderError {
    /// Neither library is there and gives a context.
    #[error(
        "there is no renderer: install `libosmesa6` (Debian), which draws in software, or `libegl1` and a driver \
         for it (EGL: {egl}; OSMesa: {osmesa})"
    )]
    NoRenderer {
        /// Why EGL cannot be used.
        egl: String,
        /// Why OSMesa cannot be used.
        osmesa: String,
    },
    /// EGL gives no context and stays loaded, so that MuJoCo would call into it instead of OSMesa.
    #[error("EGL: {0}, and it cannot be unloaded; set {VARIABLE}=osmesa")]
    InTheWay(String),
    /// The library that the environment variable forces gives no context.
    #[error("{VARIABLE}={name}: {reason}; install `{package}` (Debian), or leave {VARIABLE} unset")]
    Forced {
        /// Name of the library in the variable.
        name: &'static str,
        /// The package that it comes with.
        package: &'static str,
        /// Why it cannot be used.
        reason: String,
    },
    /// The environment variable names no library.
    #[error("{VARIABLE}={0}: it must be `egl`, `osmesa` or unset")]
    UnknownLibrary(String),
    /// The library gave a context once, and gives none now.
    #[error("OpenGL gives no context: {0}")]
    Context(String),
    /// A picture of this width and height.
    #[error("a picture of {0}x{1} pixels: each side must be 1 to {LARGEST_SIDE}")]
    Size(usize, usize),
    /// The renderer has no memory for pictures of this width and height.
    #[error("a picture of {0}x{1} pixels is larger than the renderer can make")]
    Buffer(usize, usize),
    /// Positions that are not those of the model.
    #[error("{found} positions cannot be drawn with a model that has {expected}")]
    Positions {
        /// How many there are.
        found: usize,
        /// How many the model has.
        expected: usize,
    },
    /// OpenGL reports an error.
    #[error("OpenGL error {0:#x} while drawing")]
    OpenGl(i32),
    /// MuJoCo reports an error.
    #[error(transparent)]
    Mujoco(#[from] crate::Error),
}
