//! Files that appear whole or not at all, and never in the place of others.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};

/// A file in the making, under another name until it is whole; removed unless it is kept.
#[derive(Debug)]
pub struct NewFile {
    target: PathBuf,
    temporary: PathBuf,
}

impl NewFile {
    /// Begins the file `target`.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] if there is a file of that name; whatever the system says if
    /// none can be written there.
    pub fn create(target: PathBuf) -> io::Result<NewFile> {
        // A link that leads nowhere is in the way as well.
        if target.symlink_metadata().is_ok() {
            return Err(io::ErrorKind::AlreadyExists.into());
        }
        let mut temporary = target.as_os_str().to_owned();
        temporary.push(format!(".{}.tmp", std::process::id()));
        let temporary = PathBuf::from(temporary);
        match File::create_new(&temporary) {
            Ok(_) => Ok(NewFile { target, temporary }),
            // It is the temporary file that exists.
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                let temporary = temporary.display();
                Err(io::Error::other(format!("{temporary} is in the way")))
            }
            Err(error) => Err(error),
        }
    }

    /// Where it is written.
    pub fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// Where it will be.
    pub fn target(&self) -> &Path {
        &self.target
    }

    /// Gives the file its name.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] if another one took the name in the meantime.
    pub fn keep(self) -> io::Result<()> {
        match fs::hard_link(&self.temporary, &self.target) {
            Err(error) if error.kind() != io::ErrorKind::AlreadyExists => {
                // Not every file system has links.
                fs::rename(&self.temporary, &self.target)
            }
            linked => linked,
        }
    }
}

impl Drop for NewFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.temporary);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_appears_whole_or_not_at_all_and_over_no_other() {
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("a.txt");
        let file = NewFile::create(path.clone()).unwrap();
        fs::write(file.temporary(), "half").unwrap();
        assert!(!path.exists());
        drop(file);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 0);

        let (first, file) = (
            NewFile::create(path.clone()).unwrap(),
            NewFile::create(path.with_extension("png")).unwrap(),
        );
        fs::write(first.temporary(), "whole").unwrap();
        first.keep().unwrap();
        assert_eq!(fs::read_to_string(&path).unwrap(), "whole");
        let error = NewFile::create(path).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        fs::write(file.target(), "another's").unwrap();
        let error = file.keep().unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::AlreadyExists);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 2);
    }
}
