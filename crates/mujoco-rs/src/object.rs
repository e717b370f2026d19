use std::fmt;

use mujoco_sys as sys;

/// Kinds of named objects in a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Object {
    /// A rigid body; body 0 is the world.
    Body,
    /// A joint.
    Joint,
    /// A collision or visual shape.
    Geom,
    /// A marked place on a body.
    Site,
    /// A camera.
    Camera,
    /// A tendon.
    Tendon,
    /// An actuator.
    Actuator,
    /// A keyframe.
    Key,
}

impl Object {
    pub(crate) fn raw(self) -> std::os::raw::c_int {
        let kind = match self {
            Object::Body => sys::mjOBJ_BODY,
            Object::Joint => sys::mjOBJ_JOINT,
            Object::Geom => sys::mjOBJ_GEOM,
            Object::Site => sys::mjOBJ_SITE,
            Object::Camera => sys::mjOBJ_CAMERA,
            Object::Tendon => sys::mjOBJ_TENDON,
            Object::Actuator => sys::mjOBJ_ACTUATOR,
            Object::Key => sys::mjOBJ_KEY,
        };
        kind as std::os::raw::c_int
    }
}

impl fmt::Display for Object {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Object::Body => "body",
            Object::Joint => "joint",
            Object::Geom => "geom",
            Object::Site => "site",
            Object::Camera => "camera",
            Object::Tendon => "tendon",
            Object::Actuator => "actuator",
            Object::Key => "keyframe",
        })
    }
}
