//! One process a run: a lock file with the process that holds it.

use crate::core::files::{FileError, Files};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{ErrorKind, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Name of the lock in a run directory.
pub(super) const LOCK: &str = "run.lock";

/// Time between two looks at a lock whose holder has not named itself yet.
const PAUSE: Duration = Duration::from_millis(10);

/// Why a run can't be locked.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LockError {
    /// Another process has it.
    #[error("{}: process {holder} is working on this run; wait for it, or end it", path.display())]
    Held {
        /// The lock file.
        path: PathBuf,
        /// The process, and its host where that is another one.
        holder: String,
    },
    /// The system refused.
    #[error(transparent)]
    File(#[from] FileError),
}

/// A held lock; the file goes when it is dropped.
///
/// The system's own lock on the file decides. It ends with the process, however that ends, so that a file
/// left by a crash is in nobody's way. Where the file system knows no locks, the process named in the
/// file decides.
#[derive(Debug)]
pub(super) struct RunLock {
    path: PathBuf,
    /// Holds the system's lock.
    _file: File,
    /// The process that left the file behind, if one did.
    pub left_by: Option<String>,
}

impl RunLock {
    /// Locks the run in `directory`.
    pub fn take(directory: &Path) -> Result<RunLock, LockError> {
        let path = directory.join(LOCK);
        let at = |error| LockError::File(FileError::at(&path)(error));
        let mut patience = 50;
        loop {
            let mut options = OpenOptions::new();
            options.read(true).write(true).create(true).truncate(false);
            let mut file = options.open(&path).map_err(at)?;
            let mut holder = String::new();
            // What is no text names nobody.
            let _ = file.read_to_string(&mut holder);
            let holder = holder.trim().to_owned();
            let held = match file.try_lock() {
                Ok(()) => false,
                Err(TryLockError::WouldBlock) => true,
                Err(TryLockError::Error(error)) if knows_no_locks(&error) => is_running(&holder),
                Err(TryLockError::Error(error)) => return Err(at(error)),
            };
            if held {
                // Its holder may be about to write the file.
                if holder.is_empty() && patience > 0 {
                    patience -= 1;
                    std::thread::sleep(PAUSE);
                    continue;
                }
                return Err(LockError::Held { path, holder });
            }
            // Its holder may have removed the file since it was opened: then it is no lock any more.
            if !is_at(&file, &path) {
                continue;
            }
            let me = format!("{} on {}\n", std::process::id(), host());
            file.rewind().map_err(at)?;
            file.write_all(me.as_bytes()).map_err(at)?;
            file.set_len(me.len() as u64).map_err(at)?;
            return Ok(RunLock {
                path,
                _file: file,
                left_by: Some(holder).filter(|holder| !holder.is_empty()),
            });
        }
    }
}

impl Drop for RunLock {
    fn drop(&mut self) {
        // A file that stays is taken over by the next process.
        let _ = Files::default().remove(&self.path);
    }
}

/// Whether a lock was refused because the file system knows none, in whatever words: network file systems without their
/// lock service say that no locks are left, others that the request means nothing to them or is not permitted, although
/// the file was opened to be written.
fn knows_no_locks(error: &std::io::Error) -> bool {
    const ENOLCK: i32 = 37;
    let kinds = [
        ErrorKind::Unsupported,
        ErrorKind::InvalidInput,
        ErrorKind::PermissionDenied,
    ];
    kinds.contains(&error.kind()) || error.raw_os_error() == Some(ENOLCK)
}

/// Whether `file` is what lies at `path`.
fn is_at(file: &File, path: &Path) -> bool {
    use std::os::unix::fs::MetadataExt;
    let same =
        |a: std::fs::Metadata, b: std::fs::Metadata| (a.dev(), a.ino()) == (b.dev(), b.ino());
    let found = file.metadata().ok().zip(path.metadata().ok());
    found.is_some_and(|(a, b)| same(a, b))
}

/// Whether the process `<pid> on <host>` may still run; one on another host may.
fn is_running(holder: &str) -> bool {
    match holder.split_once(" on ") {
        Some((pid, at)) if at == host() => Path::new("/proc").join(pid).exists(),
        Some(_) => true,
        None => false,
    }
}

fn host() -> String {
    super::provenance::host().unwrap_or_else(|| "an unnamed host".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_lock_is_held_once_and_names_its_holder() {
        let directory = tempfile::tempdir().unwrap();
        let lock = RunLock::take(directory.path()).unwrap();
        assert_eq!(lock.left_by, None);
        let message = RunLock::take(directory.path()).unwrap_err().to_string();
        let me = std::process::id().to_string();
        assert!(message.contains(&me) && message.contains(LOCK), "{message}");
        drop(lock);
        assert!(!directory.path().join(LOCK).exists());
        RunLock::take(directory.path()).unwrap();
    }

    #[test]
    fn what_a_dead_process_left_is_taken_over() {
        let directory = tempfile::tempdir().unwrap();
        for left in ["4294967295 on here", "\u{fffd}"] {
            std::fs::write(directory.path().join(LOCK), left).unwrap();
            let lock = RunLock::take(directory.path()).unwrap();
            assert_eq!(lock.left_by.as_deref(), Some(left));
        }
    }

    #[test]
    fn a_file_system_without_locks_is_known_by_what_it_says() {
        let said = |code| knows_no_locks(&std::io::Error::from_raw_os_error(code));
        // ENOLCK, EINVAL, EPERM, EACCES, ENOSYS, EOPNOTSUPP.
        assert!([37, 22, 1, 13, 38, 95].into_iter().all(said));
        // EIO, EINTR, EBADF, ENOSPC.
        assert!(![5, 4, 9, 28].into_iter().any(said));
    }

    #[test]
    fn without_locks_of_the_system_the_process_decides() {
        let me = |pid: u32| format!("{pid} on {}", host());
        assert!(is_running(&me(std::process::id())));
        assert!(!is_running(&me(u32::MAX)));
        assert!(is_running("1 on a host elsewhere"));
        assert!(!is_running(""));
    }
}
