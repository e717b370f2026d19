//! The embedded models, compiled once each.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, PoisonError};

use mujoco_rs::Model;

/// Embeds the files of `assets/mjcf` under their names.
macro_rules! embedded {
    ($($name:literal)*) => {
        &[$(($name, include_str!(concat!("../../assets/mjcf/", $name)))),*]
    };
}

/// The scenes and what they include.
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

/// The compiled scene of the embedded file `name`, one for all simulations of it.
///
/// # Errors
/// If MuJoCo cannot compile it.
pub fn model(name: &'static str) -> mujoco_rs::Result<Arc<Model>> {
    static COMPILED: LazyLock<Mutex<HashMap<&str, Arc<Model>>>> = LazyLock::new(Mutex::default);
    let mut compiled = COMPILED.lock().unwrap_or_else(PoisonError::into_inner);
    if let Some(model) = compiled.get(name) {
        return Ok(Arc::clone(model));
    }
    let assets: Vec<_> = FILES.iter().map(|(n, xml)| (*n, xml.as_bytes())).collect();
    let (_, xml) = FILES
        .iter()
        .find(|(n, _)| *n == name)
        .ok_or_else(|| mujoco_rs::Error::Asset(name.to_owned()))?;
    let model = Arc::new(Model::from_xml_with_assets(xml, &assets)?);
    compiled.insert(name, Arc::clone(&model));
    Ok(model)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_is_compiled_once_and_its_includes_are_embedded() {
        let first = model("half_cheetah.xml").unwrap();
        assert!(Arc::ptr_eq(&first, &model("half_cheetah.xml").unwrap()));
        assert!(model("no_such.xml").is_err());
    }
}
