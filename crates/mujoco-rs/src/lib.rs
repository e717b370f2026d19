//! Safe wrapper over MuJoCo 2.x.
//!
//! A [`Model`] is compiled once and shared; a [`Data`] is one simulation of it. MuJoCo's fatal errors
//! come back as [`Error::Engine`] and its warnings are read as values from [`Data::warnings`]: the
//! library neither ends the process nor writes its log file.
//!
//! ```
//! use std::sync::Arc;
//! use mujoco_rs::{Data, Model};
//!
//! let xml = "<mujoco><worldbody><body><freejoint/><geom size='0.1'/></body></worldbody></mujoco>";
//! let mut data = Data::new(Arc::new(Model::from_xml(xml)?))?;
//! data.step_n(10)?;
//! assert!(data.qpos()[2] < 0.0);
//! # Ok::<(), mujoco_rs::Error>(())
//! ```

mod data;
mod error;
mod guard;
mod model;
mod object;
pub mod render;
mod warning;

pub use data::Data;
pub use error::{Error, Result};
pub use model::Model;
pub use object::Object;
pub use warning::{Warning, Warnings};

/// Version of the linked library, for example 222 for 2.2.2.
pub fn version() -> i32 {
    // SAFETY: takes no arguments and touches no state.
    unsafe { mujoco_sys::mj_version() }
}

/// Version of the linked library as text, for example `2.2.2`.
pub fn version_string() -> String {
    let v = version();
    format!("{}.{}.{}", v / 100, v / 10 % 10, v % 10)
}
