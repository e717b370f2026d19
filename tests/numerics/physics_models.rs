//! The compiled models agree with the measured figures of the published ones.

use std::path::Path;

use mamf::env;
use mujoco_rs::{Model, Object};
use serde_json::Value;

/// Differences of rounding size are allowed: the same pose can be written in several ways.
const TOLERANCE: f64 = 1e-12;

const SCENES: [(&str, &str); 27] = [
    ("Ant-v4", "ant"),
    ("HalfCheetah-v4", "half_cheetah"),
    ("Hopper-v4", "hopper"),
    ("Humanoid-v4", "humanoid"),
    ("HumanoidStandup-v4", "humanoidstandup"),
    ("InvertedDoublePendulum-v4", "inverted_double_pendulum"),
    ("InvertedPendulum-v4", "inverted_pendulum"),
    ("Pusher-v4", "pusher"),
    ("Reacher-v4", "reacher"),
    ("Swimmer-v4", "swimmer"),
    ("Walker2d-v4", "walker2d"),
    ("PenSpin-v0", "pen_spin"),
    ("EggHandOver-v0", "egg_handover"),
    ("BlockHandOver-v0", "block_handover"),
    ("PenHandOver-v0", "pen_handover"),
    ("EggCatchUnderarm-v0", "egg_catch_underarm"),
    ("BlockCatchUnderarm-v0", "block_catch_underarm"),
    ("PenCatchUnderarm-v0", "pen_catch_underarm"),
    ("EggCatchUnderarmHard-v0", "egg_catch_underarm_hard"),
    ("BlockCatchUnderarmHard-v0", "block_catch_underarm_hard"),
    ("PenCatchUnderarmHard-v0", "pen_catch_underarm_hard"),
    ("EggCatchOverarm-v0", "egg_catch_overarm"),
    ("BlockCatchOverarm-v0", "block_catch_overarm"),
    ("PenCatchOverarm-v0", "pen_catch_overarm"),
    ("TwoEggCatchUnderArm-v0", "two_egg_catch_underarm"),
    ("TwoBlockCatchUnderArm-v0", "two_block_catch_underarm"),
    ("TwoPenCatchUnderArm-v0", "two_pen_catch_underarm"),
];

/// Hand scenes keep the published names of everything; the others those of bodies and joints.
fn has_hands(id: &str) -> bool {
    id.ends_with("-v0")
}

fn measured(scene: &str) -> Value {
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/fixtures/models")
        .join(format!("{scene}.json"));
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

fn numbers(value: &Value) -> Vec<f64> {
    match value {
        Value::Array(values) => values.iter().map(|v| v.as_f64().unwrap()).collect(),
        Value::Bool(value) => vec![f64::from(u8::from(*value))],
        value => vec![value.as_f64().unwrap()],
    }
}

fn close(found: &[f64], measured: &[f64]) -> bool {
    found.len() == measured.len()
        && found
            .iter()
            .zip(measured)
            .all(|(a, b)| (a - b).abs() <= TOLERANCE * b.abs().max(1.0))
}

#[track_caller]
fn same(what: &str, found: &[f64], measured: &Value) {
    let measured = numbers(measured);
    assert!(
        close(found, &measured),
        "{what}: {found:?} is not {measured:?}"
    );
}

/// The `columns` numbers of object `id`.
fn of(array: &[f64], id: usize, columns: usize) -> &[f64] {
    &array[id * columns..][..columns]
}

/// The rotation matrix of a quaternion (w, x, y, z).
fn rotation(q: &[f64]) -> [[f64; 3]; 3] {
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y - w * z),
            2.0 * (x * z + w * y),
        ],
        [
            2.0 * (x * y + w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z - w * x),
        ],
        [
            2.0 * (x * z - w * y),
            2.0 * (y * z + w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

/// The inertia tensor in the body's frame: principal axes are not unique, the tensor is.
fn tensor(moments: &[f64], quaternion: &[f64]) -> Vec<f64> {
    let r = rotation(quaternion);
    let entry = |i: usize, j: usize| (0..3).map(|k| r[i][k] * moments[k] * r[j][k]).sum();
    (0..9).map(|n| entry(n / 3, n % 3)).collect()
}

#[test]
fn options() {
    let integrators = ["Euler", "RK4", "implicit"];
    let solvers = ["PGS", "CG", "Newton"];
    let cones = ["pyramidal", "elliptic"];
    let jacobians = ["dense", "sparse", "auto"];
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let (found, expected) = (model.options(), &measured["option"]);
        let name = |names: &[&str], index: i32| Value::from(names[index as usize]);
        assert_eq!(
            name(&integrators, found.integrator),
            expected["integrator"],
            "{id}"
        );
        assert_eq!(name(&solvers, found.solver), expected["solver"], "{id}");
        assert_eq!(name(&cones, found.cone), expected["cone"], "{id}");
        assert_eq!(
            name(&jacobians, found.jacobian),
            expected["jacobian"],
            "{id}"
        );
        for (key, value) in [
            ("timestep", found.timestep),
            ("iterations", found.iterations.into()),
            ("tolerance", found.tolerance),
            ("impratio", found.impratio),
            ("density", found.density),
            ("viscosity", found.viscosity),
            ("collision", found.collision.into()),
            ("disableflags", found.disableflags.into()),
            ("enableflags", found.enableflags.into()),
        ] {
            same(&format!("{id} {key}"), &[value], &expected[key]);
        }
        same(
            &format!("{id} gravity"),
            &found.gravity,
            &expected["gravity"],
        );
        same(
            &format!("{id} mean inertia"),
            &[model.mean_inertia()],
            &measured["meaninertia"],
        );
        same(&format!("{id} qpos0"), model.qpos0(), &measured["qpos0"]);
        same(
            &format!("{id} qpos_spring"),
            model.qpos_spring(),
            &measured["qpos_spring"],
        );
    }
}

#[test]
fn bodies() {
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let bodies = measured["bodies"].as_array().unwrap();
        assert_eq!(model.nbody(), bodies.len(), "{id}");
        for (i, body) in bodies.iter().enumerate() {
            let what = format!("{id} body {i} {}", body["name"]);
            if i > 0 {
                assert_eq!(model.name(Object::Body, i), body["name"].as_str(), "{what}");
            }
            same(
                &what,
                &[model.body_parentid()[i].into()],
                &body["parent_id"],
            );
            same(&what, of(model.body_pos(), i, 3), &body["pos"]);
            same(&what, of(model.body_quat(), i, 4), &body["quat"]);
            same(&what, of(model.body_mass(), i, 1), &body["mass"]);
            // Where the centre of mass of a body without mass is means nothing.
            if model.body_mass()[i] > 0.0 {
                same(&what, of(model.body_ipos(), i, 3), &body["ipos"]);
            }
            let found = tensor(of(model.body_inertia(), i, 3), of(model.body_iquat(), i, 4));
            let expected = tensor(&numbers(&body["inertia"]), &numbers(&body["iquat"]));
            assert!(
                close(&found, &expected),
                "{what}: {found:?} is not {expected:?}"
            );
        }
    }
}

#[test]
fn joints() {
    let types = ["free", "ball", "slide", "hinge"];
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let joints = measured["joints"].as_array().unwrap();
        assert_eq!(model.njnt(), joints.len(), "{id}");
        for (i, joint) in joints.iter().enumerate() {
            let what = format!("{id} joint {i} {}", joint["name"]);
            let kind = model.jnt_type()[i] as usize;
            assert_eq!(
                model.name(Object::Joint, i),
                joint["name"].as_str(),
                "{what}"
            );
            assert_eq!(types[kind], joint["type"], "{what}");
            let body = model.jnt_bodyid()[i] as usize;
            assert_eq!(
                model.name(Object::Body, body),
                joint["body"].as_str(),
                "{what}"
            );
            same(&what, &[model.jnt_qposadr()[i].into()], &joint["qposadr"]);
            same(&what, &[model.jnt_dofadr()[i].into()], &joint["dofadr"]);
            same(&what, &[model.jnt_limited()[i].into()], &joint["limited"]);
            for (key, array, columns) in [
                ("axis", model.jnt_axis(), 3),
                ("pos", model.jnt_pos(), 3),
                ("range", model.jnt_range(), 2),
                ("margin", model.jnt_margin(), 1),
                ("stiffness", model.jnt_stiffness(), 1),
                ("solref_limit", model.jnt_solref(), 2),
                ("solimp_limit", model.jnt_solimp(), 5),
            ] {
                same(&format!("{what} {key}"), of(array, i, columns), &joint[key]);
            }
            let first = model.jnt_dofadr()[i] as usize;
            let dofs = [6, 3, 1, 1][kind];
            for (key, array) in [
                ("damping", model.dof_damping()),
                ("armature", model.dof_armature()),
                ("frictionloss", model.dof_frictionloss()),
                ("dof_invweight0", model.dof_invweight0()),
            ] {
                same(
                    &format!("{what} {key}"),
                    &array[first..first + dofs],
                    &joint[key],
                );
            }
        }
    }
}

/// Geoms are found by what they are: their names and order do not matter, and a scene may have more
/// of them to look at, if these touch nothing and weigh nothing.
#[test]
fn geoms() {
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let mut left: Vec<usize> = (0..model.ngeom()).collect();
        for geom in measured["geoms"].as_array().unwrap() {
            let place = left.iter().position(|&i| is_geom(&model, i, geom));
            let place = place.unwrap_or_else(|| panic!("{id} lacks the geom {geom}"));
            left.swap_remove(place);
        }
        for i in left {
            let touch = model.geom_contype()[i] | model.geom_conaffinity()[i];
            assert_eq!(touch, 0, "{id} has a geom too many that may touch others");
        }
    }
}

fn is_geom(model: &Model, i: usize, geom: &Value) -> bool {
    let types = [
        "plane",
        "hfield",
        "sphere",
        "capsule",
        "ellipsoid",
        "cylinder",
        "box",
        "mesh",
    ];
    let body = model.geom_bodyid()[i] as usize;
    let name = if body == 0 {
        Some("world")
    } else {
        model.name(Object::Body, body)
    };
    let kind = types[model.geom_type()[i] as usize];
    let integers = [
        ("contype", model.geom_contype()),
        ("conaffinity", model.geom_conaffinity()),
        ("condim", model.geom_condim()),
        ("priority", model.geom_priority()),
    ];
    let reals = [
        ("friction", model.geom_friction(), 3),
        ("margin", model.geom_margin(), 1),
        ("gap", model.geom_gap(), 1),
        ("solmix", model.geom_solmix(), 1),
        ("solref", model.geom_solref(), 2),
        ("solimp", model.geom_solimp(), 5),
    ];
    // A sphere's further size parameters mean nothing.
    let sizes = if kind == "sphere" { 1 } else { 3 };
    let turned = rotation(of(model.geom_quat(), i, 4)).concat();
    // Of a mesh only the contacts are compared: its shape is an approximation.
    let shape = || {
        kind == "mesh" || {
            close(
                of(model.geom_size(), i, 3).split_at(sizes).0,
                &numbers(&geom["size"])[..sizes],
            ) && close(of(model.geom_pos(), i, 3), &numbers(&geom["pos"]))
                && close(&turned, &rotation(&numbers(&geom["quat"])).concat())
        }
    };
    name == geom["body"].as_str()
        && kind == geom["type"]
        && shape()
        && integers.iter().all(|(key, array)| geom[*key] == array[i])
        && reals
            .iter()
            .all(|(key, array, n)| close(of(array, i, *n), &numbers(&geom[*key])))
}

#[test]
fn actuators_and_sites() {
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let actuators = measured["actuators"].as_array().unwrap();
        assert_eq!(model.nu(), actuators.len(), "{id}");
        for (i, actuator) in actuators.iter().enumerate() {
            let what = format!("{id} actuator {i}");
            let joint = model.actuator_trnid()[2 * i] as usize;
            let target = model.name(Object::Joint, joint);
            assert_eq!(target, actuator["target"].as_str(), "{what}");
            if has_hands(id) {
                let name = model.name(Object::Actuator, i);
                assert_eq!(name, actuator["name"].as_str(), "{what}");
            }
            same(&what, of(model.actuator_gear(), i, 6), &actuator["gear"]);
            same(
                &what,
                of(model.actuator_forcerange(), i, 2),
                &actuator["forcerange"],
            );
            same(
                &what,
                of(model.actuator_ctrlrange(), i, 2),
                &actuator["ctrlrange"],
            );
            same(
                &what,
                &[model.actuator_ctrllimited()[i].into()],
                &actuator["ctrllimited"],
            );
            same(
                &what,
                &[model.actuator_forcelimited()[i].into()],
                &actuator["forcelimited"],
            );
            same(
                &what,
                &of(model.actuator_gainprm(), i, 10)[..3],
                &actuator["gainprm"],
            );
            same(
                &what,
                &of(model.actuator_biasprm(), i, 10)[..3],
                &actuator["biasprm"],
            );
        }
        let sites = measured["sites"].as_array().unwrap();
        for site in sites {
            let name = site["name"].as_str().unwrap();
            let i = model.id(Object::Site, name).unwrap();
            same(name, of(model.site_pos(), i, 3), &site["pos"]);
        }
    }
}

#[test]
fn tendons() {
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let tendons = measured["tendons"].as_array().unwrap();
        assert_eq!(model.ntendon(), tendons.len(), "{id}");
        for (i, tendon) in tendons.iter().enumerate() {
            let what = format!("{id} tendon {i} {}", tendon["name"]);
            if has_hands(id) {
                let name = model.name(Object::Tendon, i);
                assert_eq!(name, tendon["name"].as_str(), "{what}");
            }
            let limited = model.tendon_limited()[i];
            same(&what, &[limited.into()], &tendon["limited"]);
            same(&what, of(model.tendon_range(), i, 2), &tendon["range"]);
            for (key, array) in [
                ("margin", model.tendon_margin()),
                ("stiffness", model.tendon_stiffness()),
                ("damping", model.tendon_damping()),
                ("frictionloss", model.tendon_frictionloss()),
            ] {
                same(&format!("{what} {key}"), &array[i..=i], &tendon[key]);
            }
            let first = model.tendon_adr()[i] as usize;
            let joints = tendon["joints"].as_array().unwrap();
            assert_eq!(model.tendon_num()[i] as usize, joints.len(), "{what}");
            for (wrap, joint) in (first..).zip(joints) {
                let found = model.name(Object::Joint, model.wrap_objid()[wrap] as usize);
                assert_eq!(found, joint["joint"].as_str(), "{what}");
                same(&what, of(model.wrap_prm(), wrap, 1), &joint["coef"]);
            }
        }
    }
}

#[test]
fn contact_pairs() {
    for (id, scene) in SCENES {
        let (model, measured) = (env::model(id).unwrap(), measured(scene));
        let pairs = measured["contact_pairs"].as_array().unwrap();
        assert_eq!(model.npair(), pairs.len(), "{id}");
        for (i, pair) in pairs.iter().enumerate() {
            let what = format!("{id} pair {i}");
            for (key, geoms) in [("geom1", model.pair_geom1()), ("geom2", model.pair_geom2())] {
                let name = model.name(Object::Geom, geoms[i] as usize);
                assert_eq!(name, pair[key].as_str(), "{what}");
            }
            same(&what, &[model.pair_dim()[i].into()], &pair["condim"]);
            for (key, array, columns) in [
                ("friction", model.pair_friction(), 5),
                ("solref", model.pair_solref(), 2),
                ("solimp", model.pair_solimp(), 5),
                ("margin", model.pair_margin(), 1),
                ("gap", model.pair_gap(), 1),
            ] {
                same(&format!("{what} {key}"), of(array, i, columns), &pair[key]);
            }
        }
    }
}
