//! What a process that a signal ends must not leave behind: files and directories in the making.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, MutexGuard, PoisonError};

/// What is in the making, in the order in which it was begun.
static UNFINISHED: Mutex<Vec<PathBuf>> = Mutex::new(Vec::new());

fn unfinished() -> MutexGuard<'static, Vec<PathBuf>> {
    // A list of paths is whole whatever its holder did.
    UNFINISHED.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A file or a directory that goes with the process, until this is dropped.
#[derive(Debug)]
pub struct Unfinished(PathBuf);

impl Unfinished {
    /// Has `make` make something, which lies where `path` says. No signal comes between the two.
    ///
    /// # Errors
    /// Those of `make`.
    pub fn making<T, E>(
        make: impl FnOnce() -> Result<T, E>,
        path: impl FnOnce(&T) -> PathBuf,
    ) -> Result<(T, Unfinished), E> {
        let mut all = unfinished();
        let made = make()?;
        let path = path(&made);
        all.push(path.clone());
        Ok((made, Unfinished(path)))
    }
}

impl Unfinished {
    /// Removes it, a directory only if it is empty.
    pub fn remove(self) {
        remove(&self.0);
    }
}

/// What can't be removed stays; there is nobody to be told.
fn remove(path: &Path) {
    let _ = match path.symlink_metadata() {
        Ok(found) if found.is_dir() => fs::remove_dir(path),
        _ => fs::remove_file(path),
    };
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        let mut all = unfinished();
        if let Some(place) = all.iter().rposition(|path| *path == self.0) {
            all.remove(place);
        }
    }
}

/// Removes all that is in the making, a directory only if it is empty then. Nothing more can be begun: the process is to
/// end at once.
pub fn remove_all() {
    let all = unfinished();
    all.iter().rev().for_each(|path| remove(path));
    std::mem::forget(all);
}
