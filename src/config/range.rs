//! What a key may be: one range, from which both the check and the words of an error follow.

use super::Method;
use crate::env;
use std::fmt;
use toml::Value;

/// Most weights between the hidden layers of a network; beyond that memory is at stake, and the CPU is the wrong
/// place.
const MOST_WEIGHTS: usize = 1 << 26;

/// Widest hidden layer.
const WIDEST: usize = 8_192;

/// The values that a key may have. As text it says what is right: in errors, in `mamf settings` and in the
/// documentation.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Range {
    /// The id of a task.
    Task,
    /// The name of a method.
    Method,
    /// Any text.
    Text,
    /// `true` or `false`.
    Flag,
    /// One of some words.
    Word(&'static [&'static str]),
    /// A whole number, both ends included.
    Whole {
        /// The smallest.
        least: u64,
        /// The largest; [`LARGEST`](Range::LARGEST) where none is named.
        most: u64,
    },
    /// A number, both ends included.
    Number {
        /// The smallest.
        least: f64,
        /// The largest.
        most: f64,
    },
    /// A number above 0.
    Positive {
        /// The largest.
        most: f64,
    },
    /// Widths of hidden layers.
    Widths,
    /// Two numbers `[low, high]`, or an empty list for none.
    Span {
        /// The largest of both; the smallest is 0.
        most: f64,
    },
}

impl Range {
    /// Largest whole number that TOML holds.
    pub const LARGEST: u64 = i64::MAX as u64;

    /// `value` as this range types it (a whole number serves as a number), if it lies within.
    pub fn admit(self, value: &Value) -> Option<Value> {
        let within = match self {
            Range::Task => env::info(value.as_str()?).is_ok(),
            Range::Method => Method::named(value.as_str()?).is_some(),
            Range::Text => value.is_str(),
            Range::Flag => value.is_bool(),
            Range::Word(words) => words.contains(&value.as_str()?),
            Range::Whole { least, most } => {
                let whole = u64::try_from(value.as_integer()?).ok()?;
                (least..=most).contains(&whole)
            }
            Range::Number { least, most } => {
                return admit_number(value, |x| (least..=most).contains(&x));
            }
            Range::Positive { most } => {
                return admit_number(value, |x| x > 0.0 && x <= most);
            }
            Range::Widths => are_widths(value.as_array()?),
            Range::Span { most } => return admit_span(value.as_array()?, most),
        };
        within.then(|| value.clone())
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Integer(whole) => Some(*whole as f64),
        value => value.as_float(),
    }
}

fn admit_number(value: &Value, within: impl Fn(f64) -> bool) -> Option<Value> {
    number(value).filter(|x| within(*x)).map(Value::Float)
}

fn are_widths(items: &[Value]) -> bool {
    let width = |item: &Value| {
        let width = usize::try_from(item.as_integer()?).ok()?;
        (1..=WIDEST).contains(&width).then_some(width)
    };
    let Some(widths) = items.iter().map(width).collect::<Option<Vec<usize>>>() else {
        return false;
    };
    let weights: usize = widths.windows(2).map(|pair| pair[0] * pair[1]).sum();
    !widths.is_empty() && weights <= MOST_WEIGHTS
}

fn admit_span(items: &[Value], most: f64) -> Option<Value> {
    let numbers: Vec<f64> = items.iter().map(number).collect::<Option<_>>()?;
    let sound = match numbers[..] {
        [] => true,
        [low, high] => 0.0 <= low && low <= high && high <= most,
        _ => false,
    };
    sound.then(|| Value::Array(numbers.into_iter().map(Value::Float).collect()))
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let one_of = |f: &mut fmt::Formatter<'_>, words: &[&str]| {
            let words: Vec<String> = words.iter().map(|word| format!("`{word}`")).collect();
            write!(f, "one of {}", words.join(", "))
        };
        match *self {
            Range::Task => write!(f, "the id of a task (`mamf envs` lists them)"),
            Range::Method => one_of(f, &Method::ALL.map(Method::name)),
            Range::Text => write!(f, "a string"),
            Range::Flag => write!(f, "true or false"),
            Range::Word(words) => one_of(f, words),
            Range::Whole { least: 0, most } if most == Range::LARGEST => {
                write!(f, "a whole number, not negative")
            }
            Range::Whole { least, most } if most == Range::LARGEST => {
                write!(f, "a whole number, at least {least}")
            }
            Range::Whole { least, most } => write!(f, "a whole number from {least} to {most}"),
            Range::Number { least, most } => write!(f, "a number from {least} to {most}"),
            Range::Positive { most } => write!(f, "a number above 0 and at most {most}"),
            Range::Widths => write!(
                f,
                "a list of whole numbers, for example [256, 256]: one or more widths from 1 to {WIDEST}, of at most {MOST_WEIGHTS} weights between them"
            ),
            Range::Span { most } => write!(
                f,
                "a list of two numbers [low, high], from 0 to {most} and low not above high, or [] for none"
            ),
        }
    }
}
