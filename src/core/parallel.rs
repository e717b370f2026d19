//! Whole tasks side by side on a few threads.
//!
//! Work is cut the same way whatever the number of threads, so results do not depend on it.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, Ordering};

/// Cores that this process has: those that it may run on, within the quota of its control groups.
pub fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Makes sure that so many threads can be started.
///
/// # Errors
/// When they can't.
pub fn check_threads(threads: usize) -> Result<(), rayon::ThreadPoolBuildError> {
    pool(threads).map(drop)
}

/// A pool of so many threads, but no more than there are cores: a thread without a core of its own takes the time of one
/// that works.
fn pool(threads: usize) -> Result<rayon::ThreadPool, rayon::ThreadPoolBuildError> {
    let threads = threads.min(cores()).max(1);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build()
}

/// Runs `task` on a pool of `threads` threads, or of as many as there are cores if these are fewer, a second one of which
/// stays awake until `task` ends.
///
/// An update is a dozen pieces of a fraction of a millisecond. A sleeping thread takes about 70
/// microseconds to take up its half of each of them; one that keeps looking for work takes none.
///
/// # Errors
/// When the threads can't be started.
pub fn with_threads<T: Send>(
    threads: usize,
    task: impl FnOnce() -> T + Send,
) -> Result<T, rayon::ThreadPoolBuildError> {
    let pool = pool(threads)?;
    let done = AtomicBool::new(false);
    let (result, ()) = pool.join(
        || {
            let _done = SetOnDrop(&done);
            task()
        },
        || look_for_work_until(&done),
    );
    Ok(result)
}

/// Runs two tasks side by side when there are two threads, one after the other otherwise.
///
/// The thread that is done first stays awake until the other one is.
pub fn join<A: Send, B: Send>(
    first: impl FnOnce() -> A + Send,
    second: impl FnOnce() -> B + Send,
) -> (A, B) {
    let done = AtomicBool::new(false);
    rayon::join(
        || {
            let result = first();
            look_for_work_until(&done);
            result
        },
        || {
            let _done = SetOnDrop(&done);
            second()
        },
    )
}

/// Also a task that panics must let the waiting thread go.
struct SetOnDrop<'a>(&'a AtomicBool);

impl Drop for SetOnDrop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Release);
    }
}

/// Takes up whatever there is to do, be it of this thread or another, until `done`. After a while
/// without work it gives way to other processes between two looks.
fn look_for_work_until(done: &AtomicBool) {
    const PATIENCE: u32 = 10_000;
    let mut idle = 0;
    while !done.load(Ordering::Acquire) {
        match rayon::yield_now() {
            Some(rayon::Yield::Executed) => idle = 0,
            // Outside a pool there is nothing to take up.
            None => std::thread::yield_now(),
            Some(rayon::Yield::Idle) if idle < PATIENCE => {
                idle += 1;
                std::hint::spin_loop();
            }
            Some(rayon::Yield::Idle) => std::thread::yield_now(),
        }
    }
}

/// Runs `task` on the first and the second half of `rows` rows, side by side when there are two
/// threads.
pub fn halves<T: Send>(rows: usize, task: impl Fn(Range<usize>) -> T + Sync) -> [T; 2] {
    let middle = rows / 2;
    let (first, second) = join(|| task(0..middle), || task(middle..rows));
    [first, second]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_of_threads_gives_the_same_result() {
        let sums = |threads| {
            with_threads(threads, || {
                halves(101, |range| range.map(|i| (i as f32).sqrt()).sum::<f32>())
            })
        };
        let one = sums(1).unwrap();
        assert_eq!(one, sums(2).unwrap());
        assert_eq!(one, sums(3).unwrap());
    }

    #[test]
    fn no_thread_is_without_a_core() {
        for threads in [1, 2, 100] {
            let started = with_threads(threads, rayon::current_num_threads).unwrap();
            assert_eq!(started, threads.min(cores()));
        }
    }

    #[test]
    fn a_panic_reaches_the_caller() {
        let result = std::panic::catch_unwind(|| with_threads(2, || panic!("as intended")));
        assert!(result.is_err());
    }
}
