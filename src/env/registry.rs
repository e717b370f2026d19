//! All tasks by id.

use std::sync::{Arc, LazyLock};

use mujoco_rs::Model;

use super::hands::{self, PenInertia};
use super::locomotion::*;
use super::scene;
use super::simulation::Simulation;
use super::{Info, Inspect};
use crate::task::{Env, Rules, VelocityReading};

/// A registered task: its constants and how to build it.
pub(super) struct Entry {
    pub info: Info,
    pub simulation: Box<BuildSimulation>,
    pub rules: Box<BuildRules>,
}

type BuildSimulation = dyn Fn(Arc<Model>) -> mujoco_rs::Result<Box<dyn Inspect>> + Send + Sync;
type BuildRules =
    dyn Fn(&Model, VelocityReading) -> mujoco_rs::Result<Arc<dyn Rules>> + Send + Sync;

fn entry<T: Locomotion>() -> Entry {
    Entry {
        info: T::INFO,
        simulation: Box::new(|model| {
            let task = T::new(&model)?;
            Ok(Box::new(Simulation::new(model, &T::INFO, task)?))
        }),
        rules: Box::new(T::rules),
    }
}

static ENTRIES: LazyLock<Vec<Entry>> = LazyLock::new(|| {
    let mut entries = vec![
        entry::<Ant>(),
        entry::<HalfCheetah>(),
        entry::<Hopper>(),
        entry::<Humanoid>(),
        entry::<HumanoidStandup>(),
        entry::<InvertedDoublePendulum>(),
        entry::<InvertedPendulum>(),
        entry::<Pusher>(),
        entry::<Reacher>(),
        entry::<Swimmer>(),
        entry::<Walker2d>(),
    ];
    entries.extend(hands::entries());
    entries
});

/// A task id that is not registered.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("there is no task `{id}`{}", nearest.as_ref().map(|n| format!("; did you mean `{n}`?")).unwrap_or_default())]
pub struct UnknownTask {
    /// The id asked for.
    pub id: String,
    /// The registered id closest to it.
    pub nearest: Option<&'static str>,
}

/// Why a task cannot be made.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MakeError {
    /// No such task.
    #[error(transparent)]
    Unknown(#[from] UnknownTask),
    /// MuJoCo cannot load or run the task's model.
    #[error(transparent)]
    Physics(#[from] mujoco_rs::Error),
}

/// A task and what its designer knows of it.
pub type Made = (Box<dyn Env>, Arc<dyn Rules>);

/// Ids of all tasks.
pub fn ids() -> impl Iterator<Item = &'static str> {
    ENTRIES.iter().map(|entry| entry.info.id)
}

/// Constants and description of the task `id`.
///
/// # Errors
/// If there is no such task.
pub fn info(id: &str) -> Result<&'static Info, UnknownTask> {
    find(id).map(|entry| &entry.info)
}

/// The task `id` and its rules, with the reward rule that is closest to the simulator.
///
/// # Errors
/// If there is no such task or MuJoCo cannot run it.
pub fn make(id: &str) -> Result<Made, MakeError> {
    make_with(id, VelocityReading::default())
}

/// The task `id` and its rules, whose forward reward reads the velocity as told.
///
/// # Errors
/// If there is no such task or MuJoCo cannot run it.
pub fn make_with(id: &str, reading: VelocityReading) -> Result<Made, MakeError> {
    Ok((make_inspect(id)?, rules(id, reading)?))
}

/// The task `id` with access to its state, for checking recordings.
///
/// # Errors
/// If there is no such task or MuJoCo cannot run it.
pub fn make_inspect(id: &str) -> Result<Box<dyn Inspect>, MakeError> {
    let entry = find(id)?;
    Ok((entry.simulation)(model(id)?)?)
}

/// The task `id` for comparing recordings: with the pens' inertia as told (other objects have one only),
/// and noticing whatever comes as near to an approximate shape as the published one may reach.
///
/// # Errors
/// If there is no such task or MuJoCo cannot run it.
pub fn make_watched(id: &str, inertia: PenInertia) -> Result<Box<dyn Inspect>, MakeError> {
    let entry = find(id)?;
    let variant = |watched| scene::model(&hands::variant(entry.info.scene, inertia, watched));
    let mut replay = (entry.simulation)(variant(false)?)?;
    if !replay.recorded().approximate_geoms.is_empty() {
        replay.watch(variant(true)?)?;
    }
    Ok(replay)
}

/// The rules of the task `id`.
///
/// # Errors
/// If there is no such task or MuJoCo cannot load its model.
pub fn rules(id: &str, reading: VelocityReading) -> Result<Arc<dyn Rules>, MakeError> {
    let entry = find(id)?;
    Ok((entry.rules)(&*model(id)?, reading)?)
}

/// The compiled model of the task `id`, shared by all its simulations.
///
/// # Errors
/// If there is no such task or MuJoCo cannot load its model.
pub fn model(id: &str) -> Result<Arc<Model>, MakeError> {
    Ok(scene::model(&find(id)?.info.scene)?)
}

fn find(id: &str) -> Result<&'static Entry, UnknownTask> {
    ENTRIES
        .iter()
        .find(|e| e.info.id == id)
        .ok_or_else(|| UnknownTask {
            id: id.to_owned(),
            nearest: nearest(id),
        })
}

/// The registered id closest to `id`, if any resembles it; the version may be left out.
fn nearest(id: &str) -> Option<&'static str> {
    const RESEMBLES: f64 = 0.6;
    let likeness = |known: &str| {
        let bare = known.split('-').next().unwrap_or(known);
        let asked = id.to_lowercase();
        let whole = strsim::normalized_damerau_levenshtein(&asked, &known.to_lowercase());
        whole.max(strsim::normalized_damerau_levenshtein(
            &asked,
            &bare.to_lowercase(),
        ))
    };
    ids()
        .map(|known| (likeness(known), known))
        .filter(|(likeness, _)| *likeness >= RESEMBLES)
        .max_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, known)| known)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_misspelt_id_is_answered_with_the_nearest() {
        let nearest = |id| info(id).unwrap_err().nearest;
        assert_eq!(nearest("HalfCheeta-v4"), Some("HalfCheetah-v4"));
        assert_eq!(nearest("halfcheetah"), Some("HalfCheetah-v4"));
        assert_eq!(nearest("Hopper-v3"), Some("Hopper-v4"));
        assert_eq!(nearest("Chess-v0"), None);
        let message = info("Reachr-v4").unwrap_err().to_string();
        assert_eq!(
            message,
            "there is no task `Reachr-v4`; did you mean `Reacher-v4`?"
        );
    }

    #[test]
    fn simulations_of_a_task_share_its_model() {
        let first = model("Ant-v4").unwrap();
        assert!(Arc::ptr_eq(&first, &model("Ant-v4").unwrap()));
    }
}
