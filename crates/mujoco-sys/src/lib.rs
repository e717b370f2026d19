//! Raw bindings to the MuJoCo C library, generated from the installed headers.
//!
//! The `mjguard_*` functions are this crate's own: guarded calls that return an error code where
//! MuJoCo would end the process (see `shim/guard.c`).

#![allow(
    missing_docs,
    non_camel_case_types,
    non_snake_case,
    non_upper_case_globals,
    clippy::all,
    clippy::undocumented_unsafe_blocks
)]

include!(concat!(env!("OUT_DIR"), "/bindings.rs"));
