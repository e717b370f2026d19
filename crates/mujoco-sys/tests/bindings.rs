//! The bindings agree with the headers, and the headers with the library.

use std::mem::{offset_of, size_of};

use mujoco_sys::*;

#[test]
fn library_has_the_version_of_the_headers() {
    // SAFETY: takes no arguments and touches no state.
    let version = unsafe { mj_version() };
    assert_eq!(version, mjVERSION_HEADER as i32);
}

#[test]
fn layouts_agree_with_the_c_compiler() {
    // SAFETY: a constant table of the shim, written at compile time.
    let c = unsafe { mjguard_layout };
    let rust = [
        size_of::<mjModel>(),
        size_of::<mjData>(),
        size_of::<mjVFS>(),
        size_of::<mjContact>(),
        offset_of!(mjModel, qpos0),
        offset_of!(mjData, qpos),
        offset_of!(mjData, xpos),
        offset_of!(mjData, warning),
        size_of::<mjvScene>(),
        size_of::<mjvGeom>(),
        size_of::<mjvOption>(),
        size_of::<mjvCamera>(),
        size_of::<mjrContext>(),
        offset_of!(mjrContext, offWidth),
    ];
    assert_eq!(c, rust);
}
