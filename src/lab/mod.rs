//! Many runs: made from one file, and compared.

pub mod comparison;
pub mod sweep;
