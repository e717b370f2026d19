use mujoco_sys as sys;

/// Conditions that MuJoCo warns about.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Warning {
    /// The inertia matrix is close to singular.
    Inertia,
    /// The contact list is full; some contacts were dropped.
    ContactFull,
    /// The constraint list is full; some constraints were dropped.
    ConstraintFull,
    /// A position is not a number or too large.
    BadPosition,
    /// A velocity is not a number or too large.
    BadVelocity,
    /// An acceleration is not a number or too large.
    BadAcceleration,
    /// A command is not a number or too large.
    BadControl,
}

impl Warning {
    /// Every warning.
    pub const ALL: [Warning; 7] = [
        Warning::Inertia,
        Warning::ContactFull,
        Warning::ConstraintFull,
        Warning::BadPosition,
        Warning::BadVelocity,
        Warning::BadAcceleration,
        Warning::BadControl,
    ];

    fn index(self) -> usize {
        let index = match self {
            Warning::Inertia => sys::mjWARN_INERTIA,
            Warning::ContactFull => sys::mjWARN_CONTACTFULL,
            Warning::ConstraintFull => sys::mjWARN_CNSTRFULL,
            Warning::BadPosition => sys::mjWARN_BADQPOS,
            Warning::BadVelocity => sys::mjWARN_BADQVEL,
            Warning::BadAcceleration => sys::mjWARN_BADQACC,
            Warning::BadControl => sys::mjWARN_BADCTRL,
        };
        index as usize
    }
}

/// How often each warning was raised since the last reset or [`clear`](crate::Data::clear_warnings).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Warnings {
    counts: [i32; Self::LEN],
}

impl Warnings {
    const LEN: usize = sys::mjNWARNING as usize;

    pub(crate) fn new(stats: &[sys::mjWarningStat; Self::LEN]) -> Self {
        Self {
            counts: stats.map(|stat| stat.number),
        }
    }

    /// How often `warning` was raised.
    pub fn count(&self, warning: Warning) -> usize {
        self.counts[warning.index()].max(0) as usize
    }

    /// How often the buffer of contacts or that of constraints was full, so that some were left out of the physics.
    pub fn buffers_full(&self) -> usize {
        self.count(Warning::ContactFull) + self.count(Warning::ConstraintFull)
    }

    /// Whether the simulation left the range of sound numbers.
    ///
    /// [`Data::step_n`](crate::Data::step_n) has then put the model back into its initial state (or
    /// ignored the command, if that was bad), so what it holds is not the continuation of the motion.
    pub fn diverged(&self) -> bool {
        [
            Warning::BadPosition,
            Warning::BadVelocity,
            Warning::BadAcceleration,
            Warning::BadControl,
        ]
        .iter()
        .any(|&w| self.count(w) > 0)
    }
}
