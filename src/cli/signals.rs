//! Signals that end a command, set up in one place.

use signal_hook::consts::{SIGINT, SIGTERM, SIGUSR1};
use signal_hook::flag;
use std::ffi::c_int;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

/// Signals that a run is saved at: an interrupt, an end from outside, and what batch systems send before a time limit.
const SAVING: [c_int; 3] = [SIGINT, SIGTERM, SIGUSR1];

/// A flag that is set by the signals at which a run is saved. With `twice_ends`, a second interrupt ends the process at
/// once.
///
/// # Errors
/// When the system refuses.
pub(super) fn stop_and_save(twice_ends: bool) -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    if twice_ends {
        // By a flag of its own: an interrupt after another signal is the first one.
        end_at_second(SIGINT, &Arc::new(AtomicBool::new(false)))?;
    }
    for signal in SAVING {
        flag::register(signal, Arc::clone(&stop))?;
    }
    Ok(stop)
}

/// A flag that an interrupt and an end from outside set. The second one ends the process at once.
///
/// # Errors
/// When the system refuses.
pub(super) fn stop() -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM] {
        end_at_second(signal, &stop)?;
    }
    Ok(stop)
}

/// Sets `seen` at `signal`, and ends the process where it was set before.
fn end_at_second(signal: c_int, seen: &Arc<AtomicBool>) -> io::Result<()> {
    // In this order: the first signal finds the flag unset and only sets it.
    flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(seen))?;
    flag::register(signal, Arc::clone(seen))?;
    Ok(())
}
