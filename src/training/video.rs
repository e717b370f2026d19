//! Videos of the policy while it is trained.

use super::{Evaluator, Watch};
use crate::agent::Policy;
use crate::config::Config;
use crate::core::random::stream;
use crate::env::Inspect;
use crate::render::{
    self, Film, FilmError, Format, OutputError, PaintError, Painter, Playback, RenderError, develop,
};
use crate::task::Step;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Width and height in pixels.
const SIZE: [usize; 2] = [480, 360];

/// Keeps the states of each episode, to be drawn afterwards.
#[derive(Debug, Clone, Copy)]
pub struct Camera {
    /// Most steps of an episode that are kept.
    pub limit: usize,
}

impl Watch for Camera {
    type Seen = Film;

    fn begin(&self, env: &dyn Inspect, _: &[f64]) -> Film {
        Film::begin(env)
    }

    fn step(&self, film: &mut Film, env: &dyn Inspect, _: &[f64], step: &Step, _: &[f64]) {
        if film.shots().len() <= self.limit {
            film.step(env, step);
        }
    }

    fn ends(&self, film: &Film, step: &Step) -> bool {
        step.terminated || step.truncated || film.shots().len() > self.limit
    }
}

/// Makes sure that the videos which `config` asks for, if any, can be made here.
///
/// # Errors
/// If there is nothing to draw with.
pub fn check_video(config: &Config) -> Result<(), RenderError> {
    match config.video.every {
        0 => Ok(()),
        _ => render::available().map(|_| ()),
    }
}

/// Records an episode of `policy` as `videos/step_<step>.gif` in the run directory, unless it is there
/// already: a resumed run repeats what it made before. The episode begins in the same state at every
/// step, in an environment and from a stream of its own. When `stop` becomes true, none is made.
///
/// # Errors
/// If it cannot be simulated, drawn or written.
pub(super) fn record(
    config: &Config,
    directory: &Path,
    step: u64,
    policy: &Policy,
    stop: &AtomicBool,
) -> Result<(), FilmError> {
    let videos = directory.join("videos");
    let path = videos.join(format!("step_{step:09}.gif"));
    if path.exists() {
        return Ok(());
    }
    std::fs::create_dir_all(&videos).map_err(|error| OutputError::Io {
        path: videos.clone(),
        error,
    })?;
    remove_leftovers(&videos);
    let evaluator = Evaluator::new(config, stream(config.seed, "video"));
    let mut evaluator = evaluator.map_err(PaintError::Task)?;
    let camera = Camera { limit: usize::MAX };
    let films = evaluator.evaluate_watched(policy, 1, &camera);

    let spec = evaluator.spec();
    let mut painter = Painter::new(spec, SIZE, None)?;
    let mut playback = Playback::new(spec.dt, 1.0, None, Format::Gif.ticks());
    let mut encoder = render::create(&path, Format::Gif, SIZE, playback.interval())?;
    for (_, film) in &films {
        let go_on = || !stop.load(Ordering::Relaxed);
        if !develop(film, &mut playback, &mut painter, encoder.as_mut(), go_on)? {
            return Ok(());
        }
    }
    Ok(encoder.finish()?)
}

/// Removes the beginnings of videos that a killed process left: one process at a time works on a run.
fn remove_leftovers(videos: &Path) {
    let entries = std::fs::read_dir(videos).into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if name.starts_with("step_") && name.ends_with(".tmp") {
            // One that stays is named when it is in the way.
            let _ = std::fs::remove_file(&path);
        }
    }
}
