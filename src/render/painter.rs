//! A task's picture: the scene at a state, and what can be read on it.

use mujoco_rs::render::{Camera, Caption, Corner, Picture, RenderError, Renderer};
use mujoco_rs::{Model, Object};

use super::Shot;
use crate::env::{self, MakeError};
use crate::task::Spec;

/// The group of geoms that targets belong to, in the scenes whose targets are bodies of their own.
const TARGETS: usize = 2;

/// Why a task cannot be drawn.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PaintError {
    /// The task is unknown or MuJoCo cannot load it.
    #[error(transparent)]
    Task(#[from] MakeError),
    /// The task has no camera of that name.
    #[error("{task} has no camera `{name}`; it has {cameras}")]
    Camera {
        /// Id of the task.
        task: String,
        /// Name that was asked for.
        name: String,
        /// Those that there are.
        cameras: String,
    },
    /// Nothing can be drawn, or not this.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// Draws the states of one task.
pub struct Painter {
    renderer: Renderer,
}

impl Painter {
    /// A painter of pictures `[width, height]` in pixels, by the camera of that name or by the task's
    /// first one.
    ///
    /// # Errors
    /// If there is no such task or camera, or nothing can be drawn.
    pub fn new(task: &Spec, size: [usize; 2], camera: Option<&str>) -> Result<Painter, PaintError> {
        let model = env::model(&task.id)?;
        let camera = match camera {
            None => Camera::Model(0),
            Some(name) => Camera::Model(camera_called(&model, &task.id, name)?),
        };
        let mut renderer = Renderer::new(&model, size)?;
        renderer.set_camera(camera);
        // A target that follows no goal means nothing.
        renderer.show_group(TARGETS, task.goal_size > 0);
        Ok(Painter { renderer })
    }

    /// The picture of `shot`.
    ///
    /// # Errors
    /// If it belongs to another task, or drawing fails.
    pub fn paint(&mut self, shot: &Shot) -> Result<Picture, PaintError> {
        Ok(self.renderer.picture(&shot.qpos, &[caption(shot)])?)
    }
}

fn camera_called(model: &Model, task: &str, name: &str) -> Result<usize, PaintError> {
    let names = || (0..model.ncam()).filter_map(|id| model.name(Object::Camera, id));
    model
        .id(Object::Camera, name)
        .map_err(|_| PaintError::Camera {
            task: task.to_owned(),
            name: name.to_owned(),
            cameras: names()
                .map(|n| format!("`{n}`"))
                .collect::<Vec<_>>()
                .join(", "),
        })
}

/// Step, reward and return, and whether the goal is reached.
fn caption(shot: &Shot) -> Caption {
    let number = |x: Option<f64>, digits| x.map_or("-".to_owned(), |x| format!("{x:.digits$}"));
    let mut lines = vec![
        ("step", shot.step.to_string()),
        ("reward", number(shot.reward, 3)),
        ("return", number(shot.episode_return, 2)),
    ];
    if let Some(success) = shot.success {
        let reached = if success { "reached" } else { "not reached" };
        lines.push(("goal", reached.to_owned()));
    }
    let (left, right): (Vec<_>, Vec<_>) = lines.into_iter().unzip();
    Caption {
        corner: Corner::TopLeft,
        left: left.join("\n"),
        right: right.join("\n"),
    }
}
