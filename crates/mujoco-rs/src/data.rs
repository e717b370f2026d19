use std::os::raw::c_int;
use std::ptr::{self, NonNull};
use std::slice;
use std::sync::Arc;

use mujoco_sys as sys;

use crate::guard;
use crate::{Error, Model, Result, Warnings};

/// One simulation of a [`Model`]: its state and everything computed from it.
///
/// Positions of bodies and sites, centre-of-mass quantities and forces are those of the last
/// evaluation. [`step_n`](Data::step_n) evaluates first and integrates last, so after it these arrays
/// are one sub-step older than `qpos` and `qvel`; [`forward`](Data::forward) brings them up to date.
///
/// After an [`Error::Engine`] the simulation is poisoned: it refuses to compute until it is
/// [`reset`](Data::reset), because MuJoCo was interrupted half way.
pub struct Data {
    raw: NonNull<sys::mjData>,
    model: Arc<Model>,
    poisoned: bool,
}

// SAFETY: the structure is owned by this value alone and MuJoCo keeps no thread-bound state in it.
unsafe impl Send for Data {}

impl Data {
    /// A simulation of `model` in its initial state; derived quantities are not computed yet.
    ///
    /// # Errors
    /// [`Error::Allocation`] or [`Error::Engine`] if memory cannot be had.
    pub fn new(model: Arc<Model>) -> Result<Self> {
        let mut raw = ptr::null_mut();
        // SAFETY: the model is valid, and `raw` receives an owned structure or null.
        guard::check(unsafe { sys::mjguard_makeData(model.as_ptr(), &mut raw) })?;
        let raw = NonNull::new(raw).ok_or(Error::Allocation("the simulation"))?;
        Ok(Self {
            raw,
            model,
            poisoned: false,
        })
    }

    /// The simulated model.
    pub fn model(&self) -> &Arc<Model> {
        &self.model
    }

    /// Back to the initial state: positions `qpos0`, everything else zero, warnings cleared.
    ///
    /// # Errors
    /// [`Error::Engine`] if MuJoCo fails; the simulation is then poisoned.
    pub fn reset(&mut self) -> Result<()> {
        self.poisoned = false;
        // SAFETY: the data belong to this model.
        self.guarded(|m, d| unsafe { sys::mjguard_resetData(m, d) })
    }

    /// One physics step.
    ///
    /// # Errors
    /// [`Error::Engine`] if MuJoCo fails, [`Error::Poisoned`] if it failed before.
    pub fn step(&mut self) -> Result<()> {
        self.step_n(1)
    }

    /// `n` physics steps with the same command.
    ///
    /// A state that blows up is no error: MuJoCo warns, and resets the simulation by itself. Look at
    /// [`warnings`](Data::warnings) afterwards.
    ///
    /// # Errors
    /// [`Error::Engine`] if MuJoCo fails, [`Error::Poisoned`] if it failed before.
    pub fn step_n(&mut self, n: usize) -> Result<()> {
        let n = c_int::try_from(n).unwrap_or(c_int::MAX);
        // SAFETY: the data belong to this model.
        self.guarded(|m, d| unsafe { sys::mjguard_step(m, d, n) })
    }

    /// Computes everything derived from the state, without integrating.
    ///
    /// # Errors
    /// [`Error::Engine`] if MuJoCo fails, [`Error::Poisoned`] if it failed before.
    pub fn forward(&mut self) -> Result<()> {
        // SAFETY: the data belong to this model.
        self.guarded(|m, d| unsafe { sys::mjguard_forward(m, d) })
    }

    /// Computes where bodies, geoms, sites, tendons, cameras and lights are, and nothing else.
    ///
    /// # Errors
    /// [`Error::Engine`] if MuJoCo fails, [`Error::Poisoned`] if it failed before.
    pub fn pose(&mut self) -> Result<()> {
        // SAFETY: the data belong to this model.
        self.guarded(|m, d| unsafe { sys::mjguard_pose(m, d) })
    }

    /// Computes accelerations and forces of bodies (`cfrc_ext` among them) from the last evaluation.
    ///
    /// # Errors
    /// [`Error::Engine`] if MuJoCo fails, [`Error::Poisoned`] if it failed before.
    pub fn rne_post_constraint(&mut self) -> Result<()> {
        // SAFETY: the data belong to this model.
        self.guarded(|m, d| unsafe { sys::mjguard_rnePostConstraint(m, d) })
    }

    /// Simulated seconds since the reset.
    pub fn time(&self) -> f64 {
        self.raw().time
    }

    /// Sets the clock.
    pub fn set_time(&mut self, time: f64) {
        // SAFETY: the structure is owned and borrowed mutably.
        unsafe { self.raw.as_mut() }.time = time;
    }

    /// How often each warning was raised since the last reset.
    pub fn warnings(&self) -> Warnings {
        Warnings::new(&self.raw().warning)
    }

    /// Sets all warning counts to zero.
    pub fn clear_warnings(&mut self) {
        // SAFETY: the structure is owned and borrowed mutably.
        for stat in &mut unsafe { self.raw.as_mut() }.warning {
            stat.lastinfo = 0;
            stat.number = 0;
        }
    }

    /// Number of contacts of the last evaluation.
    pub fn ncon(&self) -> usize {
        self.raw().ncon as usize
    }

    /// The pairs of geoms that are in contact in the last evaluation.
    pub fn contacts(&self) -> impl Iterator<Item = [usize; 2]> + '_ {
        let n = self.ncon();
        let contacts = if n == 0 {
            &[]
        } else {
            // SAFETY: MuJoCo keeps at least `ncon` contacts in an array that lives as long as `self`.
            unsafe { slice::from_raw_parts(self.raw().contact, n) }
        };
        contacts
            .iter()
            .map(|c| [c.geom1 as usize, c.geom2 as usize])
    }

    /// The raw structure, for parts of MuJoCo that this crate does not wrap.
    pub fn as_mut_ptr(&mut self) -> *mut sys::mjData {
        self.raw.as_ptr()
    }

    fn raw(&self) -> &sys::mjData {
        // SAFETY: `raw` came from `mj_makeData` and is freed only in `drop`.
        unsafe { self.raw.as_ref() }
    }

    fn guarded(
        &mut self,
        call: impl FnOnce(*const sys::mjModel, *mut sys::mjData) -> c_int,
    ) -> Result<()> {
        if self.poisoned {
            return Err(Error::Poisoned);
        }
        let result = guard::check(call(self.model.as_ptr(), self.raw.as_ptr()));
        self.poisoned = result.is_err();
        result
    }
}

/// Methods that read (and, after `|`, write) an array of the data: name, rows, columns.
macro_rules! arrays {
    ($($(#[$doc:meta])* $name:ident $(| $mut:ident)?: [$rows:ident * $columns:literal])*) => {
        impl Data { $(
            $(#[$doc])*
            pub fn $name(&self) -> &[f64] {
                let len = self.model.$rows() * $columns;
                if len == 0 {
                    return &[];
                }
                // SAFETY: MuJoCo allocates exactly this many numbers for the array in the data's
                // buffer, which lives as long as `self`.
                unsafe { slice::from_raw_parts(self.raw().$name, len) }
            }
            $(
                #[doc = concat!("[`", stringify!($name), "`](Data::", stringify!($name), "), for writing.")]
                pub fn $mut(&mut self) -> &mut [f64] {
                    let len = self.model.$rows() * $columns;
                    if len == 0 {
                        return &mut [];
                    }
                    // SAFETY: as for reading; `self` is borrowed mutably, so nothing else reads it.
                    unsafe { slice::from_raw_parts_mut(self.raw().$name, len) }
                }
            )?
        )* }
    };
}

arrays! {
    /// Positions, `nq`.
    qpos | qpos_mut: [nq * 1]
    /// Velocities, `nv`.
    qvel | qvel_mut: [nv * 1]
    /// Actuator activations, `na`.
    act | act_mut: [na * 1]
    /// Accelerations from which the solver starts, `nv`.
    qacc_warmstart | qacc_warmstart_mut: [nv * 1]
    /// Command of each actuator, `nu`.
    ctrl | ctrl_mut: [nu * 1]
    /// Position of each body's frame in the world, 3 a body.
    xpos: [nbody * 3]
    /// Orientation of each body's frame in the world, 4 a body.
    xquat: [nbody * 4]
    /// Position of each body's centre of mass in the world, 3 a body.
    xipos: [nbody * 3]
    /// Position of each site in the world, 3 a site.
    site_xpos: [nsite * 3]
    /// Inertia about the root's centre of mass (6), mass times offset from it (3), mass: 10 a body.
    cinert: [nbody * 10]
    /// Velocity about the root's centre of mass, rotation then translation: 6 a body.
    cvel: [nbody * 6]
    /// Force of the actuators on each degree of freedom.
    qfrc_actuator: [nv * 1]
    /// Force of the constraints on each degree of freedom.
    qfrc_constraint: [nv * 1]
    /// External force about the root's centre of mass, rotation then translation: 6 a body.
    cfrc_ext: [nbody * 6]
    /// Accelerations, `nv`.
    qacc: [nv * 1]
}

impl Drop for Data {
    fn drop(&mut self) {
        // SAFETY: the structure is owned; freeing it reads no state that an interrupted call could
        // have left inconsistent.
        unsafe { sys::mj_deleteData(self.raw.as_ptr()) };
    }
}

impl std::fmt::Debug for Data {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Data")
            .field("time", &self.time())
            .field("qpos", &self.qpos())
            .field("qvel", &self.qvel())
            .finish_non_exhaustive()
    }
}
