//! What every room stands on: random streams, ranges, work side by side, files that outlive a crash, what must not outlive
//! one, text, tables, paths that a pattern means, and walks through directories.

pub mod files;
pub mod leftovers;
pub mod parallel;
pub mod paths;
pub mod random;
pub mod span;
pub mod table;
pub mod text;
pub mod walk;
