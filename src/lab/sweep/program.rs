//! The program that makes the runs: one build for all of them.

use crate::core::files::Checksum;
use std::fs::{self, Metadata};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// A program's file as it was when a sweep began.
#[derive(Debug, Clone)]
pub struct Program {
    path: PathBuf,
    mark: Option<[i64; 5]>,
    checksum: Option<Checksum>,
}

impl Program {
    /// The file at `path` as it is now.
    pub fn at(path: &Path) -> Program {
        Program::of(path, path)
    }

    /// This program, which lies at `path`: also where another file has taken its place since it was started.
    pub fn own(path: &Path) -> Program {
        let running = Path::new("/proc/self/exe");
        Program::of(path, if running.exists() { running } else { path })
    }

    fn of(path: &Path, file: &Path) -> Program {
        Program {
            path: path.to_owned(),
            mark: fs::metadata(file).ok().map(|found| mark(&found)),
            checksum: fs::read(file).ok().map(|bytes| Checksum::of(&bytes)),
        }
    }

    /// Where it lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Why no run can be begun with it any more: another file has taken its place, or none is there. A copy of the same
    /// bytes is the same program.
    pub fn changed(&self) -> Option<String> {
        let path = self.path.display();
        let found = match fs::metadata(&self.path) {
            Ok(found) => found,
            Err(error) => {
                return Some(format!(
                    "the program is no longer there ({path}: {error}); put it back, and the same command goes on"
                ));
            }
        };
        if self.mark == Some(mark(&found)) {
            return None;
        }
        let checksum = fs::read(&self.path).ok().map(|bytes| Checksum::of(&bytes));
        (checksum.is_none() || checksum != self.checksum).then(|| {
            format!(
                "the program was replaced since the sweep began ({path}), and two builds are not mixed; \
                 the same command goes on with the new one"
            )
        })
    }
}

/// What tells files apart without reading them.
fn mark(file: &Metadata) -> [i64; 5] {
    [
        file.dev() as i64,
        file.ino() as i64,
        file.size() as i64,
        file.mtime(),
        file.mtime_nsec(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_program_that_is_replaced_or_removed_is_noticed() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("program");
        fs::write(&path, "one").unwrap();
        let program = Program::at(&path);
        assert_eq!(program.changed(), None);
        // The same bytes once more.
        fs::remove_file(&path).unwrap();
        fs::write(&path, "one").unwrap();
        assert_eq!(program.changed(), None);
        fs::write(&path, "two").unwrap();
        assert!(program.changed().unwrap().contains("replaced"));
        fs::remove_file(&path).unwrap();
        assert!(program.changed().unwrap().contains("no longer there"));
    }
}
