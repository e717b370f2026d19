//! The `mamf` binary.
fn main() {}
