//! Where segments of experience begin when there are demonstrations.

use rand::RngExt;
use serde::{Deserialize, Serialize};

use crate::config::DemonstrationSettings;
use crate::core::random::Stream;

/// Where the next segment of experience begins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SegmentStart {
    /// The second environment is put into a state of a demonstration.
    Demonstration,
    /// The second environment is reset.
    Reset,
    /// The main episode goes on.
    Continue,
}

/// Chooses where segments begin; saved and restored with the run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Segments {
    probability_demonstration: f64,
    probability_reset: f64,
    decay: f64,
    /// Segments begun so far. The probabilities follow from it, so that a state that was saved in
    /// decimals goes on exactly as it would have.
    begun: u64,
}

impl Segments {
    /// The state before the first segment.
    ///
    /// The probabilities should add up to at most 1; beyond that the demonstrations go first.
    pub fn new(settings: &DemonstrationSettings) -> Segments {
        Segments {
            probability_demonstration: settings.probability,
            probability_reset: settings.reset_probability,
            decay: settings.decay,
            begun: 0,
        }
    }

    /// Probability that the next segment begins in a demonstration.
    pub fn probability_demonstration(&self) -> f64 {
        self.probability_demonstration * self.shrunk()
    }

    /// Probability that the next segment begins with a reset of the second environment.
    pub fn probability_reset(&self) -> f64 {
        self.probability_reset * self.shrunk()
    }

    /// Where the next segment begins: in a demonstration with probability `p_d`, with a reset with
    /// `p_r`, or else where the main episode stands. Both probabilities then shrink.
    ///
    /// Takes one number from `rng` whatever the probabilities.
    pub fn draw(&mut self, rng: &mut Stream) -> SegmentStart {
        let demonstration = self.probability_demonstration();
        let reset = self.probability_reset();
        self.begun += 1;
        let u: f64 = rng.random();
        if u < demonstration {
            SegmentStart::Demonstration
        } else if u < demonstration + reset {
            SegmentStart::Reset
        } else {
            SegmentStart::Continue
        }
    }

    fn shrunk(&self) -> f64 {
        self.decay.powi(self.begun.try_into().unwrap_or(i32::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::core::random::stream;

    const DRAWS: u32 = 100_000;

    /// How often each start was drawn: demonstration, reset, continue.
    fn counts(segments: &mut Segments, seed: u64) -> [u32; 3] {
        let mut rng = stream(seed, "segments");
        let mut counts = [0; 3];
        for _ in 0..DRAWS {
            counts[segments.draw(&mut rng) as usize] += 1;
        }
        counts
    }

    fn assert_near(counts: [u32; 3], means: [f64; 3]) {
        for (count, mean) in counts.into_iter().zip(means) {
            // No binomial deviation exceeds half the root of the number of draws.
            let deviation = 0.5 * f64::from(DRAWS).sqrt();
            assert!(
                (f64::from(count) - mean).abs() < 4.0 * deviation,
                "{counts:?} against {means:?}"
            );
        }
    }

    #[test]
    fn starts_come_with_their_probabilities() {
        let settings = DemonstrationSettings {
            decay: 1.0,
            ..DemonstrationSettings::default()
        };
        let counts = counts(&mut Segments::new(&settings), 1);
        assert_near(counts, [0.7, 0.2, 0.1].map(|p| p * f64::from(DRAWS)));
    }

    #[test]
    fn probabilities_shrink_with_every_segment() {
        let settings = DemonstrationSettings::default();
        let mut segments = Segments::new(&settings);
        let counts = counts(&mut segments, 2);
        let left = settings.decay.powi(DRAWS as i32);
        assert!((segments.probability_demonstration() - 0.7 * left).abs() < 1e-9);
        assert!((segments.probability_reset() - 0.2 * left).abs() < 1e-9);
        // The sum of the geometric series.
        let sum = (1.0 - left) / (1.0 - settings.decay);
        let (demonstration, reset) = (0.7 * sum, 0.2 * sum);
        let rest = f64::from(DRAWS) - demonstration - reset;
        assert_near(counts, [demonstration, reset, rest]);
    }

    #[test]
    fn certain_and_impossible_starts() {
        let start = |probability, reset_probability| {
            let settings = DemonstrationSettings {
                probability,
                reset_probability,
                ..DemonstrationSettings::default()
            };
            Segments::new(&settings).draw(&mut stream(3, "segments"))
        };
        assert_eq!(start(1.0, 0.0), SegmentStart::Demonstration);
        assert_eq!(start(0.0, 1.0), SegmentStart::Reset);
        assert_eq!(start(0.0, 0.0), SegmentStart::Continue);
    }

    #[test]
    fn a_restored_state_goes_on_alike() {
        let mut segments = Segments::new(&DemonstrationSettings::default());
        counts(&mut segments, 4);
        let saved = serde_json::to_string(&segments).unwrap();
        let mut restored: Segments = serde_json::from_str(&saved).unwrap();
        assert_eq!(restored, segments);
        assert_eq!(counts(&mut restored, 5), counts(&mut segments, 5));
    }

    #[test]
    fn an_unknown_setting_is_refused() {
        let misspelt = r#"{"path": "", "probability": 0.7, "reset_probability": 0.2, "decay": 1.0,
            "segment_steps": 15, "segments": 3}"#;
        assert!(serde_json::from_str::<DemonstrationSettings>(misspelt).is_err());
    }
}
