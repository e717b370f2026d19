//! Ranges of numbers.

use std::fmt;

/// The numbers from `low` to `high`, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Span {
    /// The lowest.
    pub low: f64,
    /// The highest.
    pub high: f64,
}

impl Span {
    /// From minus `limit` to `limit`.
    pub const fn symmetric(limit: f64) -> Span {
        Span {
            low: -limit,
            high: limit,
        }
    }

    /// What lies between both ends.
    pub fn middle(self) -> f64 {
        (self.high + self.low) / 2.0
    }

    /// From the middle to either end.
    pub fn half(self) -> f64 {
        (self.high - self.low) / 2.0
    }

    /// The number of the range that is nearest to `x`.
    pub fn clip(self, x: f64) -> f64 {
        x.min(self.high).max(self.low)
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.low == -self.high {
            write!(f, "+-{}", self.high)
        } else {
            write!(f, "[{}, {}]", self.low, self.high)
        }
    }
}

/// Ranges in words: one that all of them are, or all of them, where equal ones that follow each other are told once
/// with their number.
pub fn in_words(spans: &[Span]) -> String {
    let runs: Vec<&[Span]> = spans.chunk_by(PartialEq::eq).collect();
    match runs[..] {
        [run] => run[0].to_string(),
        _ => {
            let words = runs.iter().map(|run| match run.len() {
                1 => run[0].to_string(),
                n => format!("{n} x {}", run[0]),
            });
            words.collect::<Vec<_>>().join(", ")
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_span_has_a_middle_two_halves_and_ends() {
        let span = Span {
            low: -1.0,
            high: 3.0,
        };
        assert_eq!((span.middle(), span.half()), (1.0, 2.0));
        assert_eq!([-5.0, 0.5, 5.0].map(|x| span.clip(x)), [-1.0, 0.5, 3.0]);
        let symmetric = Span::symmetric(0.4);
        // To the bit, so that equal ranges cost no rounding.
        assert_eq!((symmetric.middle(), symmetric.half()), (0.0, 0.4));
    }

    #[test]
    fn ranges_are_told_as_shortly_as_they_can_be() {
        let (one, other) = (
            Span::symmetric(1.0),
            Span {
                low: 0.0,
                high: 0.5,
            },
        );
        assert_eq!(in_words(&[one; 3]), "+-1");
        assert_eq!(in_words(&[one, one, other]), "2 x +-1, [0, 0.5]");
        assert_eq!(in_words(&[]), "");
    }
}
