use crate::Object;

/// Result of this crate's operations.
pub type Result<T> = std::result::Result<T, Error>;

/// What can go wrong.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The model description does not parse or compile; MuJoCo's own explanation.
    #[error("MuJoCo cannot compile the model: {0}")]
    Compile(String),
    /// MuJoCo raised a fatal error, for example for lack of stack space.
    #[error("MuJoCo error: {0}")]
    Engine(String),
    /// The simulation was used after a fatal error without a reset in between.
    #[error("the simulation must be reset after the MuJoCo error that stopped it")]
    Poisoned,
    /// The library could not allocate memory.
    #[error("MuJoCo could not allocate memory for {0}")]
    Allocation(&'static str),
    /// An actuator, by its number from 0, has no limits of its commands, or nothing between them.
    #[error(
        "actuator {0} (from 0) has no range of commands: give it ctrllimited=\"true\" and a ctrlrange"
    )]
    NoCommandRange(usize),
    /// The model has no object of that kind and name.
    #[error("the model has no {kind} called `{name}`")]
    NoSuchObject {
        /// Kind of the object.
        kind: Object,
        /// Name that was looked up.
        name: String,
    },
    /// An asset cannot be handed to the compiler: its name is empty, too long, repeated or holds a
    /// zero byte, or its content is too large.
    #[error("the asset `{0}` cannot be handed to MuJoCo")]
    Asset(String),
}
