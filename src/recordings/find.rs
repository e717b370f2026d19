//! Finds recordings on disk.

use crate::core::paths::{PatternsError, matching};
use crate::core::walk::{Walk, WalkError};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// Why no recording is found. Each message names the pattern or the path.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum FindError {
    /// A directory cannot be searched.
    #[error(transparent)]
    Walk(#[from] WalkError),
    /// The pattern is malformed, or a directory on its way cannot be read.
    #[error("`{pattern}`: {error}")]
    Pattern {
        /// The pattern.
        pattern: String,
        /// What is wrong; part of the message, and hence no source of it.
        error: PatternsError,
    },
    /// There is no such path.
    #[error("nothing matches `{pattern}`")]
    NoMatch {
        /// The pattern.
        pattern: String,
    },
    /// There are only other files, or none.
    #[error("`{pattern}` holds no recording (.npz)")]
    NoRecording {
        /// The pattern.
        pattern: String,
    },
}

/// The archives of all recordings that `pattern` means, sorted, each once.
///
/// It is an `.npz` file, a directory, which is searched with all below it, or a glob (`*`, `?`,
/// `[...]`, `**`) that matches such files and directories.
///
/// # Errors
/// If there is none, the pattern is malformed or a directory cannot be read.
pub fn find(pattern: &Path) -> Result<Vec<PathBuf>, FindError> {
    let text = || pattern.display().to_string();
    let paths = matching(pattern).map_err(|error| FindError::Pattern {
        pattern: text(),
        error,
    })?;
    if paths.is_empty() {
        return Err(FindError::NoMatch { pattern: text() });
    }
    let mut search = Search::default();
    for path in paths {
        search.add(path)?;
    }
    if search.found.is_empty() {
        return Err(FindError::NoRecording { pattern: text() });
    }
    Ok(search.found.into_iter().collect())
}

#[derive(Default)]
struct Search {
    found: BTreeSet<PathBuf>,
    walk: Walk,
}

impl Search {
    fn add(&mut self, path: PathBuf) -> Result<(), FindError> {
        if !path.is_dir() {
            self.add_file(path);
            return Ok(());
        }
        for file in self.walk.files(&path, |_| true)? {
            self.add_file(file);
        }
        Ok(())
    }

    fn add_file(&mut self, path: PathBuf) {
        // Of files only: reading a pipe would wait for ever. A link that leads nowhere is kept, to be
        // told of.
        let reads = path.is_file() || !path.exists();
        if path.extension().is_some_and(|e| e == "npz") && reads {
            self.found.insert(path);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// A directory with two recordings in `a`, one in `b`, none in `c`.
    fn tree() -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for directory in ["a", "b", "c"] {
            fs::create_dir(root.path().join(directory)).unwrap();
        }
        for file in ["a/2.npz", "a/1.npz", "a/1.json", "b/3.npz", "c/notes.txt"] {
            fs::write(root.path().join(file), "").unwrap();
        }
        root
    }

    fn found(root: &tempfile::TempDir, pattern: &str) -> Result<Vec<String>, FindError> {
        let relative = |path: &PathBuf| {
            let path = path.strip_prefix(root.path()).unwrap();
            path.to_str().unwrap().to_owned()
        };
        let pattern = root.path().join(pattern);
        find(&pattern).map(|paths| paths.iter().map(relative).collect())
    }

    #[test]
    fn files_directories_and_globs() {
        let root = tree();
        assert_eq!(found(&root, "").unwrap(), ["a/1.npz", "a/2.npz", "b/3.npz"]);
        assert_eq!(found(&root, "a/2.npz").unwrap(), ["a/2.npz"]);
        assert_eq!(found(&root, "*/[13].npz").unwrap(), ["a/1.npz", "b/3.npz"]);
        assert_eq!(found(&root, "a/*").unwrap(), ["a/1.npz", "a/2.npz"]);
        // `**` matches directories and the files in them: each recording once.
        assert_eq!(found(&root, "**/*").unwrap().len(), 3);
    }

    #[test]
    fn what_is_wrong_is_told_apart() {
        let root = tree();
        let message = |pattern| found(&root, pattern).unwrap_err().to_string();
        assert!(message("c").ends_with("c` holds no recording (.npz)"));
        assert!(message("c/*.txt").contains("holds no recording"));
        assert!(message("a/1.json").contains("holds no recording"));
        let nothing = message("d/*.npz");
        assert!(nothing.starts_with("nothing matches") && nothing.contains("d/*.npz"));
        assert!(message("nowhere").starts_with("nothing matches"));
        assert!(message("a/[").contains("not a pattern"));
    }

    #[test]
    #[cfg(unix)]
    fn links_in_circles_are_named() {
        let root = tree();
        std::os::unix::fs::symlink(root.path(), root.path().join("a/up")).unwrap();
        let message = found(&root, "").unwrap_err().to_string();
        assert!(
            message.contains("a/up: this link leads back to"),
            "{message}"
        );
    }
}
