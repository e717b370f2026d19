//! The models, embedded or composed, compiled once each.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use mujoco_rs::Model;

use super::hands::HandScene;

/// Embeds the files of `assets/mjcf` under their names.
macro_rules! embedded {
    ($($name:literal)*) => {
        &[$(($name, include_str!(concat!("../../assets/mjcf/", $name)))),*]
    };
}

/// The locomotion scenes and what scenes include.
const FILES: &[(&str, &str)] = embedded! {
    "ant.xml"
    "half_cheetah.xml"
    "hopper.xml"
    "humanoid.xml"
    "humanoid_arms.xml"
    "humanoid_parts.xml"
    "humanoid_standup.xml"
    "inverted_double_pendulum.xml"
    "inverted_pendulum.xml"
    "look.xml"
    "pusher.xml"
    "reacher.xml"
    "swimmer.xml"
    "walker2d.xml"
};

/// Where a task's model comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Scene {
    /// An embedded file, for example `half_cheetah.xml`.
    File(&'static str),
    /// Hands and objects.
    Hands(HandScene),
}

impl Scene {
    /// The name under which the compiled scene is kept.
    fn name(&self) -> String {
        match self {
            Scene::File(name) => (*name).to_owned(),
            Scene::Hands(scene) => scene.name(),
        }
    }

    fn compile(&self) -> mujoco_rs::Result<Model> {
        let (xml, composed) = match self {
            Scene::File(name) => {
                let found = FILES.iter().find(|(file, _)| file == name);
                let missing = || mujoco_rs::Error::Asset((*name).to_owned());
                (found.ok_or_else(missing)?.1.to_owned(), Vec::new())
            }
            Scene::Hands(scene) => scene.compose(),
        };
        let embedded = FILES.iter().map(|(name, xml)| (*name, xml.as_bytes()));
        let composed = composed.iter().map(|(n, xml)| (n.as_str(), xml.as_bytes()));
        Model::from_xml_with_assets(&xml, &embedded.chain(composed).collect::<Vec<_>>())
    }
}

/// The compiled scene, one for all simulations of it.
///
/// # Errors
/// If MuJoCo cannot compile it.
pub fn model(scene: &Scene) -> mujoco_rs::Result<Arc<Model>> {
    static COMPILED: LazyLock<Mutex<HashMap<String, Arc<Model>>>> = LazyLock::new(Mutex::default);
    let mut compiled = COMPILED.lock().unwrap_or_else(PoisonError::into_inner);
    let name = scene.name();
    if let Some(model) = compiled.get(&name) {
        return Ok(Arc::clone(model));
    }
    let model = Arc::new(scene.compile()?);
    compiled.insert(name, Arc::clone(&model));
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_compiled_once_and_its_includes_are_embedded() {
        let scene = Scene::File("half_cheetah.xml");
        let first = model(&scene).unwrap();
        assert!(Arc::ptr_eq(&first, &model(&scene).unwrap()));
        assert!(model(&Scene::File("no_such.xml")).is_err());
    }
}
