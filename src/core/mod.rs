//! What every room stands on: random streams, ranges, work side by side, files that outlive a crash, tables, and walks
//! through directories.

pub mod files;
pub mod parallel;
pub mod random;
pub mod span;
pub mod table;
pub mod walk;
