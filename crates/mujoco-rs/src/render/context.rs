//! An OpenGL context of either library.

use super::egl::EglContext;
use super::osmesa::OsMesaContext;

/// An OpenGL context, to be used by the thread that made it; freed when dropped.
pub(super) enum Context {
    Egl(EglContext),
    OsMesa(OsMesaContext),
}

impl Context {
    /// Makes the context the one that OpenGL calls of this thread go to; false if that fails.
    pub(super) fn make_current(&mut self) -> bool {
        match self {
            Context::Egl(context) => context.make_current(),
            Context::OsMesa(context) => context.make_current(),
        }
    }
}
