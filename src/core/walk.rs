//! Walks through directories: links are followed, and every directory is searched once.

use std::collections::BTreeSet;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};
use walkdir::WalkDir;

/// Why a directory can't be searched.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum WalkError {
    /// The system does not give it.
    #[error("cannot read the directory {}: {error}", path.display())]
    Unreadable {
        /// The directory, or what of it can't be read.
        path: PathBuf,
        /// What the system said; part of the message, and hence no source of it.
        error: io::Error,
    },
    /// A link leads round in a circle.
    #[error("{}: this link leads back to {}, which it lies in; remove it", link.display(), above.display())]
    Loop {
        /// The link.
        link: PathBuf,
        /// Where it leads.
        above: PathBuf,
    },
}

/// A walk through one directory or several.
#[derive(Debug, Default)]
pub struct Walk {
    /// Directories that were searched, as the system names them: links may lead to one several times.
    searched: BTreeSet<PathBuf>,
}

impl Walk {
    /// The files in `directory` and below, sorted by name within each directory, but for those in directories that
    /// `enters` refuses or that this walk was in before. Whatever is no directory counts as a file, a link that leads
    /// nowhere among them.
    ///
    /// # Errors
    /// When a directory can't be read, or a link leads back to one that it lies in.
    pub fn files(
        &mut self,
        directory: &Path,
        mut enters: impl FnMut(&Path) -> bool,
    ) -> Result<Vec<PathBuf>, WalkError> {
        let mut files = Vec::new();
        let walk = WalkDir::new(directory).follow_links(true);
        let mut walk = walk.sort_by_file_name().into_iter();
        while let Some(entry) = walk.next() {
            let entry = match entry {
                Ok(entry) => entry,
                Err(error) => {
                    files.push(dangling(error, directory)?);
                    continue;
                }
            };
            let path = entry.path();
            if !entry.file_type().is_dir() {
                files.push(entry.into_path());
                continue;
            }
            let name = path.canonicalize().map_err(|error| WalkError::Unreadable {
                path: path.to_owned(),
                error,
            })?;
            if !self.searched.insert(name) || !enters(path) {
                walk.skip_current_dir();
            }
        }
        Ok(files)
    }
}

/// The link that leads nowhere, if that is the error.
fn dangling(error: walkdir::Error, directory: &Path) -> Result<PathBuf, WalkError> {
    let path = error.path().unwrap_or(directory).to_owned();
    if let Some(above) = error.loop_ancestor() {
        let above = above.to_owned();
        return Err(WalkError::Loop { link: path, above });
    }
    let error = error
        .into_io_error()
        .unwrap_or_else(|| ErrorKind::Other.into());
    let is_link = path
        .symlink_metadata()
        .is_ok_and(|found| found.is_symlink());
    if is_link && error.kind() == ErrorKind::NotFound {
        return Ok(path);
    }
    Err(WalkError::Unreadable { path, error })
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::fs::symlink;

    #[test]
    fn links_are_followed_and_directories_searched_once() {
        let root = tempfile::tempdir().unwrap();
        let path = |name: &str| root.path().join(name);
        for directory in ["a", "b", "left"] {
            fs::create_dir(path(directory)).unwrap();
        }
        for file in ["a/2", "a/1", "left/3"] {
            fs::write(path(file), "").unwrap();
        }
        symlink(path("a"), path("b/again")).unwrap();
        symlink(path("nowhere"), path("b/nowhere")).unwrap();
        let elsewhere = tempfile::tempdir().unwrap();
        fs::write(elsewhere.path().join("4"), "").unwrap();
        symlink(elsewhere.path(), path("elsewhere")).unwrap();
        let mut walk = Walk::default();
        let files = walk.files(root.path(), |directory| !directory.ends_with("left"));
        let expected = ["a/1", "a/2", "b/nowhere", "elsewhere/4"].map(path);
        assert_eq!(files.unwrap(), expected);
        assert!(walk.files(&path("a"), |_| true).unwrap().is_empty());
    }

    #[test]
    fn a_circle_is_an_error_that_names_the_link() {
        let root = tempfile::tempdir().unwrap();
        let inner = root.path().join("inner");
        fs::create_dir(&inner).unwrap();
        let link = inner.join("up");
        symlink(root.path(), &link).unwrap();
        let error = Walk::default().files(root.path(), |_| true).unwrap_err();
        let message = error.to_string();
        assert!(
            message.starts_with(&link.display().to_string()),
            "{message}"
        );
        let error = Walk::default().files(&root.path().join("none"), |_| true);
        assert!(
            error
                .unwrap_err()
                .to_string()
                .contains("none: No such file")
        );
    }
}
