//! What learning goes on from beside the networks.

use super::{WeightError, Weights};
use crate::core::random::Stream;
use burn::tensor::TensorData;
use std::collections::BTreeMap;

/// Arrays, exact numbers and random streams by name: the moments of optimisers, counters, and whatever else
/// learning carries from update to update. Each owner uses names of its own.
#[derive(Debug, Clone, Default)]
pub struct LearningState {
    /// Single-precision arrays.
    pub arrays: Weights,
    /// Numbers that must not be rounded to single precision.
    pub numbers: BTreeMap<String, f64>,
    /// Random streams.
    pub streams: BTreeMap<String, Stream>,
}

impl LearningState {
    /// Saves a number.
    pub fn set(&mut self, name: &str, number: f64) {
        self.numbers.insert(name.to_owned(), number);
    }

    /// The number `name`.
    ///
    /// # Errors
    /// When it is missing.
    pub fn number(&self, name: &str) -> Result<f64, WeightError> {
        let number = self.numbers.get(name).copied();
        number.ok_or_else(|| WeightError::Missing(name.to_owned()))
    }

    /// The count `name`.
    ///
    /// # Errors
    /// When it is missing, or no whole number from 0 to 2^53.
    pub fn count(&self, name: &str) -> Result<u64, WeightError> {
        const LARGEST: f64 = (1u64 << f64::MANTISSA_DIGITS) as f64;
        let number = self.number(name)?;
        if number.fract() == 0.0 && (0.0..=LARGEST).contains(&number) {
            Ok(number as u64)
        } else {
            Err(WeightError::NotACount {
                name: name.to_owned(),
                number,
            })
        }
    }

    /// Saves a random stream.
    pub fn set_stream(&mut self, name: &str, stream: &Stream) {
        self.streams.insert(name.to_owned(), stream.clone());
    }

    /// The random stream `name`.
    ///
    /// # Errors
    /// When it is missing.
    pub fn stream(&self, name: &str) -> Result<Stream, WeightError> {
        let stream = self.streams.get(name).cloned();
        stream.ok_or_else(|| WeightError::Missing(name.to_owned()))
    }

    /// Saves an array of the given shape.
    pub fn set_array(&mut self, name: &str, numbers: &[f32], shape: &[usize]) {
        let data = TensorData::new(numbers.to_vec(), shape.to_vec());
        self.arrays.insert(name.to_owned(), data);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_whole_and_there() {
        let mut state = LearningState::default();
        state.set("steps", 16_777_217.0);
        state.set("eta", 0.5);
        state.set("below", -1.0);
        state.set("none", f64::NAN);
        assert_eq!(state.count("steps").unwrap(), 16_777_217);
        for name in ["eta", "below", "none", "missing"] {
            assert!(state.count(name).is_err(), "{name}");
        }
    }
}
