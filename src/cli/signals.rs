//! Signals that end a command, set up in one place.

use super::tell;
use crate::core::leftovers;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGUSR1, SIGXFSZ};
use signal_hook::iterator::Signals;
use signal_hook::{flag, low_level};
use std::ffi::c_int;
use std::io;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Signals that a run is saved at: an interrupt, an end from outside, and what batch systems send before a time limit.
const SAVING: [c_int; 3] = [SIGINT, SIGTERM, SIGUSR1];

/// Interrupts within so short a time are one: `timeout -s INT` sends its signal to the process, and then to the group that
/// the process belongs to. Nobody presses keys so fast.
const ONE: Duration = Duration::from_millis(200);

/// Has a write past a limit on the size of files (`ulimit -f`) be an error that can be told, instead of the end of the
/// process without a word.
///
/// # Errors
/// When the system refuses.
pub(super) fn survive_limits() -> io::Result<()> {
    flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false)))?;
    Ok(())
}

/// A flag that is set by the signals at which a run is saved. With `twice_ends`, a second interrupt ends the process at
/// once.
///
/// # Errors
/// When the system refuses.
pub(super) fn stop_and_save(twice_ends: bool) -> io::Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    for signal in SAVING {
        flag::register(signal, Arc::clone(&stop))?;
    }
    if twice_ends {
        // Apart from the flag: an interrupt after another signal is the first one.
        let mut interrupts = Signals::new([SIGINT])?;
        spawn(move || {
            let mut first = None;
            for _ in interrupts.forever() {
                if is_second(*first.get_or_insert_with(Instant::now), Instant::now()) {
                    low_level::exit(128 + SIGINT);
                }
            }
        })?;
    }
    Ok(stop)
}

/// Whether an interrupt at `now` comes after the one at `first` by the will of somebody.
fn is_second(first: Instant, now: Instant) -> bool {
    now.duration_since(first) >= ONE
}

/// Has the signals that end a command remove what it has in the making, and say so. SIGHUP is left alone where it is ignored, as
/// `nohup` has it.
///
/// # Errors
/// When the system refuses.
pub(super) fn leave_nothing_behind() -> io::Result<()> {
    let mut ending = vec![SIGINT, SIGTERM];
    if !is_ignored(SIGHUP) {
        ending.push(SIGHUP);
    }
    let mut signals = Signals::new(ending)?;
    spawn(move || {
        if let Some(signal) = signals.forever().next() {
            leftovers::remove_all();
            tell("interrupted; nothing was written");
            low_level::exit(128 + signal);
        }
    })
}

fn spawn(wait: impl FnOnce() + Send + 'static) -> io::Result<()> {
    let thread = std::thread::Builder::new().name("signals".into());
    let spawned = thread.spawn(wait);
    spawned.map(drop).map_err(|error| {
        let reason = format!("the thread that waits for signals can't be started: {error}");
        io::Error::new(error.kind(), reason)
    })
}

/// Whether this process was started with `signal` ignored.
fn is_ignored(signal: c_int) -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    ignored(&status).is_some_and(|mask| mask >> (signal - 1) & 1 == 1)
}

/// The mask of ignored signals in a `/proc/<pid>/status`.
fn ignored(status: &str) -> Option<u64> {
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))?;
    u64::from_str_radix(line.trim(), 16).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pair_of_interrupts_within_a_moment_is_one() {
        let first = Instant::now();
        assert!(!is_second(first, first));
        assert!(!is_second(first, first + Duration::from_millis(50)));
        assert!(is_second(first, first + Duration::from_millis(250)));
    }

    #[test]
    fn the_mask_of_ignored_signals_is_read() {
        let mask = ignored("SigBlk:\t0000000000000000\nSigIgn:\t0000000000001001\n");
        assert_eq!(mask, Some(0x1001));
        assert_eq!(ignored(""), None);
    }
}
