//! Installs the handlers and turns the guard's codes into errors.

use std::ffi::CStr;
use std::os::raw::c_int;
use std::sync::Once;

use mujoco_sys as sys;

use crate::{Error, Result};

/// Installs MuJoCo's handlers; every way to a [`Model`](crate::Model) leads through here, and without
/// a model there is nothing to call.
pub(crate) fn install() {
    static INSTALL: Once = Once::new();
    // SAFETY: sets two global function pointers of the library, once, before any other call to it.
    INSTALL.call_once(|| unsafe { sys::mjguard_install() });
}

/// Turns the code of a guarded call into a result.
pub(crate) fn check(code: c_int) -> Result<()> {
    if code == 0 {
        return Ok(());
    }
    // SAFETY: points at a zero-terminated buffer of this thread, which only its guarded calls write.
    let message = unsafe { CStr::from_ptr(sys::mjguard_message()) };
    Err(Error::Engine(
        message.to_string_lossy().trim_end().to_owned(),
    ))
}
