//! Files that appear whole or not at all, and directories that outlive a crash.
//!
//! What a run keeps is written through [`Files`]. A file that is replaced is written beside the old one,
//! synced, and renamed; whatever the moment of a crash, one of the two is there, whole. This is not left to a crate
//! for two reasons: the tests go through every single operation with a disk that fails at it
//! (`Files::failing_after`), and the file beside has one fixed name, so that a process that is killed again and again leaves one
//! such file at most. [`NewFile`] is for what the user asked for: it never takes the place of another file.

use super::leftovers::Unfinished;
use serde::{Deserialize, Serialize};
use std::fs::{self, File, OpenOptions};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::TempPath;
use xxhash_rust::xxh3::{Xxh3Default, xxh3_64};

/// What the system refused, and where.
#[derive(Debug, thiserror::Error)]
#[error("{}: {error}{}", path.display(), hint(error))]
pub struct FileError {
    /// The file or directory.
    pub path: PathBuf,
    /// What the system said; part of the message, and hence no source of it.
    pub error: io::Error,
}

/// What to think of where the system's words leave it open.
fn hint(error: &io::Error) -> &'static str {
    match error.kind() {
        ErrorKind::FileTooLarge => {
            "; a limit on the size of files (`ulimit -f`), or that of the file system"
        }
        _ => "",
    }
}

impl FileError {
    /// To be used as `map_err(FileError::at(path))`.
    pub fn at(path: &Path) -> impl FnOnce(io::Error) -> FileError {
        let path = path.to_owned();
        move |error| FileError { path, error }
    }
}

/// A file layer: the system's; in tests also one that fails.
#[derive(Debug, Clone, Default)]
pub struct Files {
    #[cfg(test)]
    failure: Option<failure::Failure>,
    #[cfg(test)]
    below: failure::LowerLayer,
}

/// Whether an operation is done as a whole or in part.
#[derive(Clone, Copy, PartialEq)]
enum Extent {
    Whole,
    /// The disk fails on the way, in tests.
    #[cfg_attr(not(test), expect(dead_code))]
    Half,
}

impl Files {
    /// Counts an operation on `path`.
    #[cfg(test)]
    fn begin(&self, path: &Path) -> Result<Extent, FileError> {
        self.failure
            .as_ref()
            .map_or(Ok(Extent::Whole), |failure| failure.begin(path))
    }

    #[cfg(not(test))]
    fn begin(&self, _: &Path) -> Result<Extent, FileError> {
        Ok(Extent::Whole)
    }

    /// Does `operation`, or nothing of it when the disk fails.
    fn at_once(
        &self,
        path: &Path,
        operation: impl FnOnce() -> io::Result<()>,
    ) -> Result<(), FileError> {
        match self.begin(path)? {
            Extent::Half => Err(full(path)),
            Extent::Whole => operation().map_err(FileError::at(path)),
        }
    }

    /// Makes the directory `path` and those above it.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn create_dir(&self, path: &Path) -> Result<(), FileError> {
        self.at_once(path, || fs::create_dir_all(path))
    }

    /// Makes the file `path`, or empties it, to be appended to.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn create(&self, path: &Path) -> Result<File, FileError> {
        self.at_once(path, || Ok(()))?;
        File::create(path).map_err(FileError::at(path))
    }

    /// Opens the file `path` to be appended to.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn open_to_append(&self, path: &Path) -> Result<File, FileError> {
        let opened = OpenOptions::new().append(true).open(path);
        opened.map_err(FileError::at(path))
    }

    /// Appends `bytes` to `file`, which lies at `path`.
    ///
    /// # Errors
    /// When the system refuses; some of the bytes may have been written.
    pub fn append(&self, file: &mut File, path: &Path, bytes: &[u8]) -> Result<(), FileError> {
        let extent = self.begin(path)?;
        let end = match extent {
            Extent::Whole => bytes.len(),
            Extent::Half => bytes.len() / 2,
        };
        file.write_all(&bytes[..end]).map_err(FileError::at(path))?;
        match extent {
            Extent::Whole => Ok(()),
            Extent::Half => Err(full(path)),
        }
    }

    /// Waits until what was written to `file` outlives a loss of power.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn sync(&self, file: &File, path: &Path) -> Result<(), FileError> {
        self.at_once(path, || file.sync_all())
    }

    /// Waits until the names in the directory `path` outlive a loss of power.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn sync_dir(&self, path: &Path) -> Result<(), FileError> {
        self.at_once(path, || match File::open(path)?.sync_all() {
            // Some file systems do not sync directories, and need not.
            Err(error) if error.kind() == ErrorKind::InvalidInput => Ok(()),
            synced => synced,
        })
    }

    /// Writes a file, and waits until its contents outlive a loss of power.
    ///
    /// # Errors
    /// When the system refuses; a part of the file may be there.
    pub fn write(&self, path: &Path, bytes: &[u8]) -> Result<(), FileError> {
        let mut file = self.create(path)?;
        self.append(&mut file, path, bytes)?;
        self.sync(&file, path)
    }

    /// Writes a file so that at any moment either what was there before or all of `bytes` is there.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn replace(&self, path: &Path, bytes: &[u8]) -> Result<(), FileError> {
        let fresh = beside(path, "new");
        self.write(&fresh, bytes)?;
        self.rename(&fresh, path)?;
        self.sync_dir(parent(path))
    }

    /// Gives `from` the name `to`, which must be free or a file. A directory that the file system does not rename, though it
    /// stays there, is copied instead: one of a lower layer of overlayfs, as containers have it.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn rename(&self, from: &Path, to: &Path) -> Result<(), FileError> {
        #[cfg(test)]
        let renames = self.below.renames(from);
        #[cfg(not(test))]
        let renames = true;
        let renamed = self.at_once(to, || match renames {
            true => fs::rename(from, to),
            false => Err(ErrorKind::CrossesDevices.into()),
        });
        match renamed {
            Err(refused) if is_to_be_copied(&refused.error) && from.is_dir() => {
                self.rename_copied(from, to)
            }
            renamed => renamed,
        }
    }

    /// Copies the directory `from`, which holds files alone, gives the copy the name `to`, and removes `from`. Whenever that
    /// ends, one of both is whole.
    fn rename_copied(&self, from: &Path, to: &Path) -> Result<(), FileError> {
        let copy = beside(to, COPY);
        self.remove(&copy)?;
        self.create_dir(&copy)?;
        for entry in fs::read_dir(from).map_err(FileError::at(from))? {
            let path = entry.map_err(FileError::at(from))?.path();
            let bytes = fs::read(&path).map_err(FileError::at(&path))?;
            let name = path.file_name().unwrap_or_default();
            self.write(&copy.join(name), &bytes)?;
        }
        self.sync_dir(&copy)?;
        self.rename(&copy, to)?;
        self.remove(from)
    }

    /// Cuts the file `path` to `length` bytes.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn truncate(&self, path: &Path, length: u64) -> Result<(), FileError> {
        self.at_once(path, || {
            let file = OpenOptions::new().write(true).open(path)?;
            file.set_len(length)?;
            file.sync_all()
        })
    }

    /// Removes the file or the directory `path`, if it is there, with all in it.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn remove(&self, path: &Path) -> Result<(), FileError> {
        let remove = || match path.symlink_metadata() {
            Err(error) if error.kind() == ErrorKind::NotFound => Ok(()),
            Err(error) => Err(error),
            Ok(found) if found.is_dir() => fs::remove_dir_all(path),
            Ok(_) => fs::remove_file(path),
        };
        match self.begin(path)? {
            Extent::Whole => remove().map_err(FileError::at(path)),
            Extent::Half => {
                // A directory loses some of its files.
                let entries = fs::read_dir(path).into_iter().flatten().flatten();
                for entry in entries.take(2) {
                    let _ = fs::remove_file(entry.path());
                }
                Err(full(path))
            }
        }
    }
}

/// What the name of a directory's copy ends in, until that has the name of the directory.
pub const COPY: &str = "copy";

/// Whether a directory that was not renamed because of `error` can be copied instead.
fn is_to_be_copied(error: &io::Error) -> bool {
    error.kind() == ErrorKind::CrossesDevices
}

fn full(path: &Path) -> FileError {
    FileError::at(path)(ErrorKind::StorageFull.into())
}

/// What the system said of a file that can't be made in `folder`, without the name of a temporary file, which the user does
/// not know.
fn plain(error: &io::Error, folder: &Path) -> io::Error {
    let kind = error.kind();
    if kind == ErrorKind::NotFound {
        let folder = folder.display();
        return io::Error::new(kind, format!("there is no folder {folder}; make it first"));
    }
    let text = error.to_string();
    let said = text.split(" at path \"").next().unwrap_or_default();
    io::Error::new(kind, said)
}

/// `path` with `.suffix` after its name.
pub fn beside(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_owned();
    name.push(".");
    name.push(suffix);
    path.with_file_name(name)
}

/// The directory that `path` lies in.
pub fn parent(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if parent.as_os_str().is_empty() => Path::new("."),
        Some(parent) => parent,
        None => path,
    }
}

/// A file in the making, under another name until it is whole; removed unless it is kept.
#[derive(Debug)]
pub struct NewFile {
    target: PathBuf,
    temporary: TempPath,
    unfinished: Unfinished,
}

impl NewFile {
    /// Begins the file `target`, in its directory.
    ///
    /// # Errors
    /// [`ErrorKind::AlreadyExists`] if there is a file of that name; whatever the system says if none can be
    /// written there.
    pub fn create(target: PathBuf) -> io::Result<NewFile> {
        // A link that leads nowhere is in the way as well.
        if target.symlink_metadata().is_ok() {
            return Err(ErrorKind::AlreadyExists.into());
        }
        let mut prefix = target.file_name().unwrap_or_default().to_owned();
        prefix.push(".");
        let mut builder = tempfile::Builder::new();
        builder.prefix(&prefix).suffix(".tmp");
        // Unlike most temporary files it is to be one that others may read, if the umask lets them.
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        let folder = parent(&target);
        let make = || {
            let file = builder.tempfile_in(folder);
            file.map_err(|error| plain(&error, folder))
        };
        let (file, unfinished) = Unfinished::making(make, |file| file.path().to_owned())?;
        Ok(NewFile {
            target,
            temporary: file.into_temp_path(),
            unfinished,
        })
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
    /// [`ErrorKind::AlreadyExists`] if another one took the name in the meantime.
    pub fn keep(self) -> io::Result<()> {
        self.keep_for_now().map(drop)
    }

    /// As [`keep`](NewFile::keep), for a file that is part of something in the making: it goes with the process until what
    /// is returned is dropped.
    ///
    /// # Errors
    /// As [`keep`](NewFile::keep).
    pub fn keep_for_now(self) -> io::Result<Unfinished> {
        let NewFile {
            target,
            temporary,
            unfinished,
        } = self;
        let keep = || {
            let kept = temporary.persist_noclobber(&target);
            kept.map_err(|error| error.error)
        };
        let kept = Unfinished::making(keep, |()| target.clone());
        drop(unfinished);
        kept.map(|((), unfinished)| unfinished)
    }
}

/// XXH3 of some bytes, written as sixteen hexadecimal digits.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Checksum(u64);

impl Checksum {
    /// Of `bytes`.
    pub fn of(bytes: &[u8]) -> Checksum {
        Checksum(xxh3_64(bytes))
    }
}

impl From<Checksum> for String {
    fn from(checksum: Checksum) -> String {
        format!("{:016x}", checksum.0)
    }
}

impl TryFrom<String> for Checksum {
    type Error = String;

    fn try_from(text: String) -> Result<Checksum, String> {
        let digits = text.len() == 16 && text.bytes().all(|b| b.is_ascii_hexdigit());
        let number = u64::from_str_radix(&text, 16).ok().filter(|_| digits);
        let wrong = || format!("`{text}` is no checksum: sixteen hexadecimal digits expected");
        number.map(Checksum).ok_or_else(wrong)
    }
}

/// A [`Checksum`] of bytes that come in parts.
#[derive(Clone, Default)]
pub struct Checksummer(Xxh3Default);

impl Checksummer {
    /// Takes the next part.
    pub fn add(&mut self, bytes: &[u8]) {
        self.0.update(bytes);
    }

    /// Of all parts so far.
    pub fn checksum(&self) -> Checksum {
        Checksum(self.0.digest())
    }
}

impl std::fmt::Debug for Checksummer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.checksum().fmt(f)
    }
}

/// A disk that fills up or loses power at a chosen operation.
#[cfg(test)]
mod failure {
    use super::{Extent, FileError, Files, full};
    use std::collections::BTreeSet;
    use std::os::unix::fs::MetadataExt;
    use std::path::{Path, PathBuf};
    use std::sync::Arc;
    use std::sync::atomic::{AtomicU64, Ordering};
    use std::time::SystemTime;

    /// Operations left until it fails; `u64::MAX` once it has.
    #[derive(Debug, Clone)]
    pub(super) struct Failure(Arc<AtomicU64>);

    impl Failure {
        pub(super) fn begin(&self, path: &Path) -> Result<Extent, FileError> {
            match self.0.load(Ordering::Relaxed) {
                u64::MAX => Err(full(path)),
                0 => {
                    self.0.store(u64::MAX, Ordering::Relaxed);
                    Ok(Extent::Half)
                }
                n => {
                    self.0.store(n - 1, Ordering::Relaxed);
                    Ok(Extent::Whole)
                }
            }
        }
    }

    /// Directories of a lower layer of overlayfs: they are not renamed. An inode is used again, and then made later.
    #[derive(Debug, Clone, Default)]
    pub(super) struct LowerLayer(Arc<BTreeSet<(u64, SystemTime)>>);

    impl LowerLayer {
        pub(super) fn renames(&self, path: &Path) -> bool {
            self.0.is_empty() || !self.0.contains(&which(path))
        }
    }

    fn which(path: &Path) -> (u64, SystemTime) {
        let found = path.metadata().unwrap();
        (found.ino(), found.created().unwrap())
    }

    impl Files {
        /// A file system on which `directories` are not renamed, as overlayfs does not rename those of a lower layer.
        pub(crate) fn over(directories: &[PathBuf]) -> Files {
            Files {
                below: LowerLayer(Arc::new(
                    directories.iter().map(|path| which(path)).collect(),
                )),
                ..Files::default()
            }
        }

        /// A disk on which `operations` more operations succeed. The next one is done by half; then nothing
        /// is done any more.
        pub(crate) fn failing_after(operations: u64) -> Files {
            let left = Arc::new(AtomicU64::new(operations));
            Files {
                failure: Some(Failure(left)),
                ..Files::default()
            }
        }

        /// Whether it has failed; never so of the system's.
        pub(crate) fn failed(&self) -> bool {
            let failure = self.failure.as_ref();
            failure.is_some_and(|failure| failure.0.load(Ordering::Relaxed) == u64::MAX)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_replaced_file_is_the_old_or_the_new_one_wherever_the_disk_fails() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("file");
        let mut outcomes = [0; 2];
        for operations in 0.. {
            Files::default().write(&path, b"before").unwrap();
            let files = Files::failing_after(operations);
            let replaced = files.replace(&path, b"and after");
            match fs::read(&path).unwrap().as_slice() {
                b"before" => outcomes[0] += 1,
                b"and after" => outcomes[1] += 1,
                other => panic!("{operations}: {other:?}"),
            }
            if replaced.is_ok() {
                break;
            }
            let message = replaced.unwrap_err().to_string();
            assert!(message.contains("no storage space"), "{message}");
            assert!(files.failed());
        }
        // Creation, contents, sync, name; the directory's sync, and the end.
        assert_eq!(outcomes, [4, 2]);
    }

    #[test]
    fn a_directory_that_is_not_renamed_is_copied() {
        let place = tempfile::tempdir().unwrap();
        let [from, to] = ["from", "to"].map(|name| place.path().join(name));
        fs::create_dir(&from).unwrap();
        fs::write(from.join("a"), "one").unwrap();
        fs::create_dir(beside(&to, COPY)).unwrap();
        fs::write(beside(&to, COPY).join("b"), "of a crash").unwrap();
        let files = Files::over(std::slice::from_ref(&from));
        files.rename(&from, &to).unwrap();
        assert_eq!(fs::read_to_string(to.join("a")).unwrap(), "one");
        assert_eq!(fs::read_dir(&to).unwrap().count(), 1);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 1);
        // What the system says of overlayfs, and what is no reason to copy.
        assert!(is_to_be_copied(&io::Error::from_raw_os_error(18)));
        assert!(!is_to_be_copied(&io::Error::from_raw_os_error(13)));
    }

    #[test]
    fn a_limit_on_the_size_of_files_is_named() {
        let error = FileError::at(Path::new("a"))(io::Error::from_raw_os_error(27));
        assert!(error.to_string().contains("ulimit -f"), "{error}");
    }

    #[test]
    fn parts_have_the_checksum_of_the_whole_and_it_reads_back() {
        let mut parts = Checksummer::default();
        parts.add(b"one ");
        parts.add(b"two");
        let whole = Checksum::of(b"one two");
        assert_eq!(parts.checksum(), whole);
        let text = serde_json::to_string(&whole).unwrap();
        assert_eq!(serde_json::from_str::<Checksum>(&text).unwrap(), whole);
        for wrong in ["\"\"", "\"12\"", "\"+123456789abcdef\"", "3"] {
            assert!(serde_json::from_str::<Checksum>(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn names_beside_a_path() {
        assert_eq!(
            beside(Path::new("a/b.toml"), "new"),
            Path::new("a/b.toml.new")
        );
        assert_eq!(parent(Path::new("b")), Path::new("."));
        assert_eq!(parent(Path::new("a/b")), Path::new("a"));
    }

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
        #[cfg(unix)]
        {
            // Others may do with it what they may do with any file that is made here.
            use std::os::unix::fs::PermissionsExt;
            let plain = place.path().join("plain");
            fs::write(&plain, "").unwrap();
            let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
            assert_eq!(mode(&path), mode(&plain));
            fs::remove_file(plain).unwrap();
        }
        let error = NewFile::create(path).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        fs::write(file.target(), "another's").unwrap();
        let error = file.keep().unwrap_err();
        assert_eq!(error.kind(), ErrorKind::AlreadyExists);
        assert_eq!(fs::read_dir(place.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_file_that_cannot_be_made_is_refused_without_its_temporary_name() {
        let place = tempfile::tempdir().unwrap();
        let said = |path: PathBuf| NewFile::create(path).unwrap_err().to_string();
        let missing = said(place.path().join("none/a.txt"));
        assert!(missing.starts_with("there is no folder /"), "{missing}");
        fs::write(place.path().join("file"), "").unwrap();
        let below = said(place.path().join("file/a.txt"));
        assert!(
            !below.contains(" at path ") && below.contains("irectory"),
            "{below}"
        );
    }
}
