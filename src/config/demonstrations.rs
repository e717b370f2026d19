//! Settings of demonstrations.

use serde::{Deserialize, Serialize};

/// Which demonstrations there are, how experience is divided into segments, and how often one begins in
/// a demonstration.
///
/// The scheme is that of SCDM; the default figures are those of the paper's hand tasks.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DemonstrationSettings {
    /// Where the recordings are: a directory, an archive or a glob, relative to the working directory;
    /// empty for plain episodes.
    pub path: String,
    /// Probability `p_d` that the first segment begins in a state of a demonstration.
    pub probability: f64,
    /// Probability `p_r` that the first segment begins with a reset of the second environment.
    pub reset_probability: f64,
    /// Factor on both probabilities from one segment to the next.
    pub decay: f64,
    /// Steps of a segment.
    pub segment_steps: u64,
}

impl Default for DemonstrationSettings {
    fn default() -> DemonstrationSettings {
        DemonstrationSettings {
            path: String::new(),
            probability: 0.7,
            reset_probability: 0.2,
            decay: 0.999_996,
            segment_steps: 15,
        }
    }
}
