//! Pictures of a simulation, drawn without a display.
//!
//! The OpenGL library is looked for when the first picture is to be drawn: EGL, where a driver gives a
//! context, otherwise OSMesa, which draws in software. The environment variable `MUJOCO_GL` (`egl` or
//! `osmesa`) forces one. Nothing is linked, so a machine without either simulates all the same.
//!
//! ```no_run
//! use mujoco_rs::render::{Camera, Renderer};
//! # let model = mujoco_rs::Model::from_xml("<mujoco/>")?;
//! let mut renderer = Renderer::new(&model, [640, 480])?;
//! let picture = renderer.picture(model.qpos0(), &[])?;
//! assert_eq!(picture.rgb.len(), 640 * 480 * 3);
//! # Ok::<(), mujoco_rs::render::RenderError>(())
//! ```

mod context;
mod egl;
mod error;
mod osmesa;
mod platform;
mod renderer;

pub use error::RenderError;
pub use platform::{VARIABLE, available};
pub use renderer::{Camera, Caption, Corner, LARGEST_SIDE, Picture, Renderer};
