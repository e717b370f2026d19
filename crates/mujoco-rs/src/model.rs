use std::ffi::{CStr, CString};
use std::mem::MaybeUninit;
use std::os::raw::{c_char, c_int};
use std::ptr::{self, NonNull};
use std::slice;
use std::sync::{Mutex, PoisonError};

use mujoco_sys as sys;

use crate::guard;
use crate::{Error, Object, Result};

/// A compiled model: the constant description of a simulated world.
///
/// Immutable after compilation, so one model serves any number of [`Data`](crate::Data) on any
/// threads through an `Arc`.
pub struct Model {
    raw: NonNull<sys::mjModel>,
}

// SAFETY: nothing writes to a compiled model; MuJoCo takes it as `const mjModel*` everywhere this
// crate hands it over, and `Model` has no method that changes it.
unsafe impl Send for Model {}
// SAFETY: as for `Send`; shared reading is what MuJoCo documents models for.
unsafe impl Sync for Model {}

/// The compiler keeps its parse tree in a global variable.
static COMPILER: Mutex<()> = Mutex::new(());

/// Name under which the description is handed to the compiler.
const MAIN_FILE: &str = "model.xml";

impl Model {
    /// Compiles the MJCF text `xml`.
    ///
    /// # Errors
    /// [`Error::Compile`] with MuJoCo's explanation if the text is not a valid model.
    pub fn from_xml(xml: &str) -> Result<Self> {
        Self::from_xml_with_assets(xml, &[])
    }

    /// Compiles the MJCF text `xml`, whose includes, meshes and textures are found by name in `assets`
    /// (name and content) and never on disk unless they are missing there.
    ///
    /// # Errors
    /// [`Error::Compile`] if the text is not a valid model, [`Error::Asset`] if an asset is unusable.
    pub fn from_xml_with_assets(xml: &str, assets: &[(&str, &[u8])]) -> Result<Self> {
        guard::install();
        let _compiler = COMPILER.lock().unwrap_or_else(PoisonError::into_inner);

        let mut files = FileSystem::new();
        files.add(MAIN_FILE, xml.as_bytes())?;
        for (name, content) in assets {
            files.add(name, content)?;
        }
        let name = CString::new(MAIN_FILE).map_err(|_| Error::Asset(MAIN_FILE.to_owned()))?;
        let mut explanation = [0 as c_char; 1000];
        let mut raw = ptr::null_mut();
        // SAFETY: `name` is zero-terminated, `files` is an initialised file system, `explanation` is
        // as long as stated, and `raw` receives an owned model or null.
        guard::check(unsafe {
            sys::mjguard_loadXML(
                name.as_ptr(),
                files.as_ptr(),
                explanation.as_mut_ptr(),
                explanation.len() as c_int,
                &mut raw,
            )
        })?;
        NonNull::new(raw).map(|raw| Self { raw }).ok_or_else(|| {
            // SAFETY: MuJoCo zero-terminates its explanation within the given length, and the buffer
            // began as zeros.
            let text = unsafe { CStr::from_ptr(explanation.as_ptr()) };
            Error::Compile(text.to_string_lossy().trim_end().to_owned())
        })
    }

    /// Id of the object of that kind and name.
    ///
    /// # Errors
    /// [`Error::NoSuchObject`] if the model has none.
    pub fn id(&self, kind: Object, name: &str) -> Result<usize> {
        let missing = || Error::NoSuchObject {
            kind,
            name: name.to_owned(),
        };
        let text = CString::new(name).map_err(|_| missing())?;
        // SAFETY: the model is valid while `self` lives and `text` is zero-terminated.
        let id = unsafe { sys::mj_name2id(self.as_ptr(), kind.raw(), text.as_ptr()) };
        usize::try_from(id).map_err(|_| missing())
    }

    /// Name of the object of that kind and id; `None` if it is unnamed or there is no such id.
    pub fn name(&self, kind: Object, id: usize) -> Option<&str> {
        let id = c_int::try_from(id).ok()?;
        // SAFETY: the model is valid while `self` lives; ids out of range give null.
        let text = unsafe { sys::mj_id2name(self.as_ptr(), kind.raw(), id) };
        if text.is_null() {
            return None;
        }
        // SAFETY: names are zero-terminated and live in the model's buffer, which never changes.
        let name = unsafe { CStr::from_ptr(text) }.to_str().ok()?;
        (!name.is_empty()).then_some(name)
    }

    /// Simulated seconds of one physics step.
    pub fn timestep(&self) -> f64 {
        self.raw().opt.timestep
    }

    /// Physics options, for reading.
    pub fn options(&self) -> &sys::mjOption {
        &self.raw().opt
    }

    /// Mean diagonal inertia at `qpos0`, by which the solver scales its tolerance.
    pub fn mean_inertia(&self) -> f64 {
        self.raw().stat.meaninertia
    }

    /// A copy that `change` was applied to, which may write numbers but no sizes and no pointers.
    ///
    /// # Errors
    /// [`Error::Allocation`] or [`Error::Engine`] if memory cannot be had.
    pub(crate) fn changed(&self, change: impl FnOnce(&mut sys::mjModel)) -> Result<Self> {
        let mut raw = ptr::null_mut();
        // SAFETY: the model is valid, and `raw` receives an owned model or null.
        guard::check(unsafe { sys::mjguard_copyModel(self.as_ptr(), &mut raw) })?;
        let mut raw = NonNull::new(raw).ok_or(Error::Allocation("the model"))?;
        // SAFETY: the copy is valid, and nobody else knows it yet.
        change(unsafe { raw.as_mut() });
        Ok(Self { raw })
    }

    /// The raw model, for parts of MuJoCo that this crate does not wrap. It must not be written to.
    pub fn as_ptr(&self) -> *const sys::mjModel {
        self.raw.as_ptr()
    }

    fn raw(&self) -> &sys::mjModel {
        // SAFETY: `raw` came from the compiler and is freed only in `drop`.
        unsafe { self.raw.as_ref() }
    }
}

/// Methods that read a size of the model.
macro_rules! sizes {
    ($($(#[$doc:meta])* $name:ident)*) => { impl Model { $(
        $(#[$doc])*
        pub fn $name(&self) -> usize {
            self.raw().$name as usize
        }
    )* } };
}

sizes! {
    /// Number of position coordinates.
    nq
    /// Number of degrees of freedom.
    nv
    /// Number of actuators.
    nu
    /// Number of actuator activations.
    na
    /// Number of bodies, the world included.
    nbody
    /// Number of joints.
    njnt
    /// Number of geoms.
    ngeom
    /// Number of sites.
    nsite
    /// Number of cameras.
    ncam
    /// Number of tendons.
    ntendon
    /// Number of joints, sites and geoms in the paths of all tendons.
    nwrap
    /// Number of predefined contact pairs.
    npair
    /// Number of excluded body pairs.
    nexclude
    /// Number of keyframes.
    nkey
}

/// Methods that read an array of the model: name, element type, rows, columns.
macro_rules! arrays {
    ($($(#[$doc:meta])* $name:ident: [$type:ty; $rows:ident * $columns:expr])*) => { impl Model { $(
        $(#[$doc])*
        pub fn $name(&self) -> &[$type] {
            let len = self.$rows() * $columns as usize;
            if len == 0 {
                return &[];
            }
            // SAFETY: MuJoCo allocates exactly this many elements for the array in the model's
            // buffer, which lives as long as `self` and never changes.
            unsafe { slice::from_raw_parts(self.raw().$name, len) }
        }
    )* } };
}

arrays! {
    /// Positions of the initial state, `nq`.
    qpos0: [f64; nq * 1]
    /// Positions at which joint springs rest, `nq`.
    qpos_spring: [f64; nq * 1]
    /// Parent of each body.
    body_parentid: [i32; nbody * 1]
    /// Position relative to the parent, 3 a body.
    body_pos: [f64; nbody * 3]
    /// Orientation relative to the parent as a quaternion, 4 a body.
    body_quat: [f64; nbody * 4]
    /// Position of the centre of mass in the body's frame, 3 a body.
    body_ipos: [f64; nbody * 3]
    /// Orientation of the principal axes in the body's frame, 4 a body.
    body_iquat: [f64; nbody * 4]
    /// Mass of each body in kg.
    body_mass: [f64; nbody * 1]
    /// Principal moments of inertia in kg m^2, 3 a body.
    body_inertia: [f64; nbody * 3]
    /// Type of each joint: 0 free, 1 ball, 2 slide, 3 hinge.
    jnt_type: [i32; njnt * 1]
    /// First position coordinate of each joint.
    jnt_qposadr: [i32; njnt * 1]
    /// First degree of freedom of each joint.
    jnt_dofadr: [i32; njnt * 1]
    /// Body of each joint.
    jnt_bodyid: [i32; njnt * 1]
    /// Whether the range of each joint is enforced, 0 or 1.
    jnt_limited: [u8; njnt * 1]
    /// Limit solver reference, 2 a joint.
    jnt_solref: [f64; njnt * sys::mjNREF]
    /// Limit solver impedance, 5 a joint.
    jnt_solimp: [f64; njnt * sys::mjNIMP]
    /// Anchor in the body's frame, 3 a joint.
    jnt_pos: [f64; njnt * 3]
    /// Axis in the body's frame, 3 a joint.
    jnt_axis: [f64; njnt * 3]
    /// Spring stiffness of each joint.
    jnt_stiffness: [f64; njnt * 1]
    /// Range, 2 a joint (m or rad).
    jnt_range: [f64; njnt * 2]
    /// Distance at which each joint's limit becomes active.
    jnt_margin: [f64; njnt * 1]
    /// Friction loss of each degree of freedom.
    dof_frictionloss: [f64; nv * 1]
    /// Armature of each degree of freedom.
    dof_armature: [f64; nv * 1]
    /// Damping of each degree of freedom.
    dof_damping: [f64; nv * 1]
    /// Inverse inertia of each degree of freedom at `qpos0`.
    dof_invweight0: [f64; nv * 1]
    /// Shape of each geom (MuJoCo's `mjtGeom`).
    geom_type: [i32; ngeom * 1]
    /// Contact type bits of each geom.
    geom_contype: [i32; ngeom * 1]
    /// Contact affinity bits of each geom.
    geom_conaffinity: [i32; ngeom * 1]
    /// Contact dimensionality of each geom.
    geom_condim: [i32; ngeom * 1]
    /// Body of each geom.
    geom_bodyid: [i32; ngeom * 1]
    /// Contact priority of each geom.
    geom_priority: [i32; ngeom * 1]
    /// Solver mixing weight of each geom.
    geom_solmix: [f64; ngeom * 1]
    /// Contact solver reference, 2 a geom.
    geom_solref: [f64; ngeom * sys::mjNREF]
    /// Contact solver impedance, 5 a geom.
    geom_solimp: [f64; ngeom * sys::mjNIMP]
    /// Size parameters, 3 a geom.
    geom_size: [f64; ngeom * 3]
    /// Position in the body's frame, 3 a geom.
    geom_pos: [f64; ngeom * 3]
    /// Orientation in the body's frame, 4 a geom.
    geom_quat: [f64; ngeom * 4]
    /// Sliding, torsional and rolling friction, 3 a geom.
    geom_friction: [f64; ngeom * 3]
    /// Distance below which contacts are detected.
    geom_margin: [f64; ngeom * 1]
    /// Distance subtracted from the margin for the solver.
    geom_gap: [f64; ngeom * 1]
    /// Body of each site.
    site_bodyid: [i32; nsite * 1]
    /// Position in the body's frame, 3 a site.
    site_pos: [f64; nsite * 3]
    /// Orientation in the body's frame, 4 a site.
    site_quat: [f64; nsite * 4]
    /// First path element of each tendon.
    tendon_adr: [i32; ntendon * 1]
    /// Number of path elements of each tendon.
    tendon_num: [i32; ntendon * 1]
    /// Whether the length of each tendon is limited, 0 or 1.
    tendon_limited: [u8; ntendon * 1]
    /// Length range, 2 a tendon.
    tendon_range: [f64; ntendon * 2]
    /// Distance at which each tendon's limit becomes active.
    tendon_margin: [f64; ntendon * 1]
    /// Stiffness of each tendon.
    tendon_stiffness: [f64; ntendon * 1]
    /// Damping of each tendon.
    tendon_damping: [f64; ntendon * 1]
    /// Friction loss of each tendon.
    tendon_frictionloss: [f64; ntendon * 1]
    /// Object of each path element (joint, site or geom id).
    wrap_objid: [i32; nwrap * 1]
    /// Coefficient of each path element.
    wrap_prm: [f64; nwrap * 1]
    /// What each actuator drives (MuJoCo's `mjtTrn`).
    actuator_trntype: [i32; nu * 1]
    /// Ids of what is driven, 2 an actuator.
    actuator_trnid: [i32; nu * 2]
    /// Whether the command range of each actuator is enforced, 0 or 1.
    actuator_ctrllimited: [u8; nu * 1]
    /// Command range, 2 an actuator.
    actuator_ctrlrange: [f64; nu * 2]
    /// Whether the force of each actuator is limited, 0 or 1.
    actuator_forcelimited: [u8; nu * 1]
    /// Force range, 2 an actuator.
    actuator_forcerange: [f64; nu * 2]
    /// First geom of each predefined contact pair.
    pair_geom1: [i32; npair * 1]
    /// Second geom of each predefined contact pair.
    pair_geom2: [i32; npair * 1]
    /// Contact dimensionality of each predefined pair.
    pair_dim: [i32; npair * 1]
    /// Friction, 5 a predefined pair.
    pair_friction: [f64; npair * 5]
    /// Contact solver reference, 2 a predefined pair.
    pair_solref: [f64; npair * sys::mjNREF]
    /// Contact solver impedance, 5 a predefined pair.
    pair_solimp: [f64; npair * sys::mjNIMP]
    /// Distance below which contacts of each predefined pair are detected.
    pair_margin: [f64; npair * 1]
    /// Distance subtracted from the margin of each predefined pair.
    pair_gap: [f64; npair * 1]
    /// Gear, 6 an actuator.
    actuator_gear: [f64; nu * 6]
    /// Gain parameters, 10 an actuator.
    actuator_gainprm: [f64; nu * sys::mjNGAIN]
    /// Bias parameters, 10 an actuator.
    actuator_biasprm: [f64; nu * sys::mjNBIAS]
}

impl Drop for Model {
    fn drop(&mut self) {
        // SAFETY: the model is owned, and no `Data` outlives it because each holds an `Arc` of it.
        unsafe { sys::mj_deleteModel(self.raw.as_ptr()) };
    }
}

impl std::fmt::Debug for Model {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Model")
            .field("nq", &self.nq())
            .field("nv", &self.nv())
            .field("nu", &self.nu())
            .field("nbody", &self.nbody())
            .finish_non_exhaustive()
    }
}

/// Files in memory, where the compiler looks before it looks on disk.
struct FileSystem {
    /// Two megabytes, hence on the heap and never moved.
    raw: Box<MaybeUninit<sys::mjVFS>>,
}

impl FileSystem {
    fn new() -> Self {
        let mut raw = Box::<sys::mjVFS>::new_uninit();
        // SAFETY: initialises the whole structure and reads nothing of it.
        unsafe { sys::mj_defaultVFS(raw.as_mut_ptr()) };
        Self { raw }
    }

    fn as_ptr(&self) -> *const sys::mjVFS {
        self.raw.as_ptr()
    }

    fn add(&mut self, name: &str, content: &[u8]) -> Result<()> {
        let unusable = || Error::Asset(name.to_owned());
        let text = CString::new(name).map_err(|_| unusable())?;
        if name.is_empty() || name.len() >= sys::mjMAXVFSNAME as usize {
            return Err(unusable());
        }
        let size = c_int::try_from(content.len()).map_err(|_| unusable())?;
        let files = self.raw.as_mut_ptr();
        // SAFETY: `files` is initialised, `text` is zero-terminated and shorter than the limit.
        let index = unsafe {
            if sys::mj_makeEmptyFileVFS(files, text.as_ptr(), size) != 0 {
                return Err(unusable());
            }
            sys::mj_findFileVFS(files, text.as_ptr())
        };
        let index = usize::try_from(index).map_err(|_| unusable())?;
        // SAFETY: the file was just made with room for `size` bytes at `index`, and `content` cannot
        // overlap MuJoCo's own allocation.
        unsafe {
            let room = (&raw const (*files).filedata[index]).read();
            ptr::copy_nonoverlapping(content.as_ptr(), room.cast::<u8>(), content.len());
        }
        Ok(())
    }
}

impl Drop for FileSystem {
    fn drop(&mut self) {
        // SAFETY: initialised in `new`; frees the files' contents, which MuJoCo allocated.
        unsafe { sys::mj_deleteVFS(self.raw.as_mut_ptr()) };
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BALL: &str = "<mujoco><worldbody><body name='ball'><freejoint name='free'/>\
                        <geom size='0.1' density='1000'/></body></worldbody></mujoco>";

    #[test]
    fn names_and_sizes() {
        let model = Model::from_xml(BALL).unwrap();
        assert_eq!((model.nq(), model.nv(), model.nu()), (7, 6, 0));
        assert_eq!(model.id(Object::Body, "ball"), Ok(1));
        assert_eq!(model.name(Object::Body, 1), Some("ball"));
        assert_eq!(model.name(Object::Geom, 0), None);
        assert_eq!(model.name(Object::Geom, 99), None);
        assert_eq!(
            model.id(Object::Site, "tip").unwrap_err().to_string(),
            "the model has no site called `tip`"
        );
        let volume = 4.0 / 3.0 * std::f64::consts::PI * 1e-3;
        assert!((model.body_mass()[1] - 1000.0 * volume).abs() < 1e-12);
        assert!(model.actuator_gear().is_empty());
    }

    #[test]
    fn a_broken_model_is_explained() {
        let error = Model::from_xml("<mujoco><worldbody><bodi/></worldbody></mujoco>").unwrap_err();
        assert!(
            matches!(&error, Error::Compile(text) if text.contains("bodi")),
            "{error}"
        );
        let error = Model::from_xml("not XML at all").unwrap_err();
        assert!(matches!(error, Error::Compile(_)), "{error}");
    }

    #[test]
    fn includes_are_found_among_the_assets() {
        let xml = "<mujoco><include file='ball.xml'/></mujoco>";
        let model = Model::from_xml_with_assets(xml, &[("ball.xml", BALL.as_bytes())]).unwrap();
        assert_eq!(model.nbody(), 2);
        let twice = [("a.xml", BALL.as_bytes()), ("a.xml", BALL.as_bytes())];
        let error = Model::from_xml_with_assets(xml, &twice).unwrap_err();
        assert_eq!(error, Error::Asset("a.xml".to_owned()));
    }

    #[test]
    fn threads_may_compile_at_once() {
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| Model::from_xml(BALL).unwrap());
            }
        });
    }
}
