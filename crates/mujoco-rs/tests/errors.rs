//! Fatal errors and warnings of MuJoCo come back as values.

use std::path::Path;
use std::sync::Arc;

use mujoco_rs::{Data, Error, Model, Warning};

/// A ball far above the floor, with a solver stack of `nstack` numbers.
fn ball(nstack: &str) -> Arc<Model> {
    let xml = format!(
        "<mujoco><size {nstack}/><worldbody><geom type='plane' size='9 9 1'/>\
         <body pos='0 0 5'><freejoint/><geom size='0.1'/></body></worldbody></mujoco>"
    );
    Arc::new(Model::from_xml(&xml).unwrap())
}

#[test]
fn a_stack_overflow_is_an_error_until_the_reset() {
    // Free flight fits into this stack, the solver of a contact does not.
    let mut data = Data::new(ball("nstack='150'")).unwrap();
    data.step_n(5).unwrap();
    data.qpos_mut()[2] = 0.05;
    let error = data.step().unwrap_err();
    assert!(
        matches!(&error, Error::Engine(text) if text.contains("overflow")),
        "{error}"
    );
    assert_eq!(data.step(), Err(Error::Poisoned));
    assert_eq!(data.forward(), Err(Error::Poisoned));

    data.reset().unwrap();
    data.step_n(5).unwrap();
    assert!(data.qpos()[2] > 4.9);
}

#[test]
fn errors_of_one_thread_leave_the_others_alone() {
    let model = ball("nstack='150'");
    std::thread::scope(|scope| {
        for low in [true, false, true, false] {
            let mut data = Data::new(Arc::clone(&model)).unwrap();
            scope.spawn(move || {
                for _ in 0..100 {
                    data.reset().unwrap();
                    if low {
                        data.qpos_mut()[2] = 0.05;
                    }
                    assert_eq!(data.step().is_err(), low);
                }
            });
        }
    });
}

#[test]
fn a_bad_state_is_a_warning_to_read_and_to_clear() {
    let mut data = Data::new(ball("")).unwrap();
    data.step().unwrap();
    assert!(!data.warnings().diverged());
    data.qvel_mut()[0] = 1e12;
    data.step().unwrap();
    assert!(data.warnings().diverged());
    assert_eq!(data.warnings().count(Warning::BadVelocity), 1);
    assert_eq!(data.qvel()[0], 0.0, "MuJoCo resets a bad state");

    data.clear_warnings();
    assert!(!data.warnings().diverged());
    data.qpos_mut()[1] = f64::NAN;
    data.step().unwrap();
    assert_eq!(data.warnings().count(Warning::BadPosition), 1);
    data.reset().unwrap();
    assert!(!data.warnings().diverged());
    assert!(!Path::new("MUJOCO_LOG.TXT").exists());
}

#[test]
fn a_bad_acceleration_is_a_warning() {
    let xml = "<mujoco><worldbody><body><joint name='j' type='slide'/><geom size='0.1'/></body>\
               </worldbody><actuator><motor joint='j' gear='1e12'/></actuator></mujoco>";
    let mut data = Data::new(Arc::new(Model::from_xml(xml).unwrap())).unwrap();
    data.ctrl_mut()[0] = 1.0;
    data.step().unwrap();
    assert_eq!(data.warnings().count(Warning::BadAcceleration), 1);
    data.reset().unwrap();
    data.ctrl_mut()[0] = f64::NAN;
    data.step().unwrap();
    assert_eq!(data.warnings().count(Warning::BadControl), 1);
    assert!(data.warnings().diverged());
    assert!(!Path::new("MUJOCO_LOG.TXT").exists());
}

#[test]
fn stepping_repeats_to_the_bit() {
    let model = ball("");
    let run = || {
        let mut data = Data::new(Arc::clone(&model)).unwrap();
        data.step_n(600).unwrap();
        (data.qpos().to_vec(), data.qvel().to_vec(), data.time())
    };
    assert_eq!(run(), run());
}

#[test]
fn the_version_is_that_of_the_library() {
    assert!(mujoco_rs::version() >= 200);
    assert_eq!(mujoco_rs::version_string().matches('.').count(), 2);
}
