//! Checkpoints on disk: written beside the one that stands, then put in its place by renaming.
//!
//! `last` and `previous` take turns: whatever the moment of a crash, one of them is whole. Names that end
//! in `.new`, `.old` and `.copy` exist only while this goes on. A directory that must give way and can't be removed, or holds what is not of a
//! checkpoint, is put aside under a name that ends in `.left-<n>`.

use super::Contents;
use crate::core::files::{COPY, FileError, Files, beside, parent};
use crate::run::manifest::{MANIFEST, Manifest};
use std::ffi::OsStr;
use std::path::{Path, PathBuf};

/// The files that a checkpoint may consist of.
const FILES: [&str; 6] = [
    MANIFEST,
    "weights.safetensors",
    "config.toml",
    "checkpoint.json",
    "optimizers.safetensors",
    "state.cbor",
];
/// The checkpoints that are put in place here.
const NAMES: [&str; 3] = ["last", "previous", "best"];
/// What the names of directories end in that had to give way.
const LEFT: &str = "left-";

/// Whether `name` is that of a file of a checkpoint, or what a network file system calls one that somebody still reads.
fn is_ours(name: &OsStr) -> bool {
    let name = name.as_encoded_bytes();
    FILES.iter().any(|file| file.as_bytes() == name) || name.starts_with(b".nfs")
}

/// Whether nothing lies in `directory` but files of a checkpoint.
fn holds_ours_alone(directory: &Path) -> bool {
    let entries = directory.read_dir().into_iter().flatten();
    entries.flatten().all(|entry| is_ours(&entry.file_name()))
}

/// Has the directory `path`, if it is there, make room: removed if it can be, else under another name.
pub fn make_room(files: &Files, path: &Path) -> Result<(), FileError> {
    if path.symlink_metadata().is_err() {
        return Ok(());
    }
    let removed = match holds_ours_alone(path) {
        true => files.remove(path).is_ok(),
        false => false,
    };
    if removed {
        return Ok(());
    }
    let mut names = (1..).map(|n| beside(path, &format!("{LEFT}{n}")));
    let free = names.find(|name| name.symlink_metadata().is_err());
    files.rename(path, &free.expect("numbers do not end"))
}

/// Tries again to remove what had to give way. What can't be removed, or is somebody else's, stays.
fn remove_left(files: &Files, checkpoints: &Path) {
    let entries = checkpoints.read_dir().into_iter().flatten().flatten();
    for path in entries.map(|entry| entry.path()) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        let is_left = NAMES.iter().any(|of| {
            let rest = name.strip_prefix(of);
            rest.is_some_and(|rest| rest.starts_with('.') && rest.contains(LEFT))
        });
        if is_left && holds_ours_alone(&path) {
            let _ = files.remove(&path);
        }
    }
}

/// Writes a checkpoint that is to stand at `path` beside it.
pub fn write(
    files: &Files,
    path: &Path,
    contents: &Contents,
    manifest: &Manifest,
) -> Result<(), FileError> {
    let fresh = beside(path, "new");
    let write = || {
        make_room(files, &fresh)?;
        files.create_dir(&fresh)?;
        for (name, bytes) in contents {
            files.write(&fresh.join(name), bytes)?;
        }
        files.write(&fresh.join(MANIFEST), manifest.to_json().as_bytes())?;
        files.sync_dir(&fresh)
    };
    let written = write();
    if written.is_err() {
        // On a full disk half a checkpoint is of no use; what stands is left.
        let _ = files.remove(&fresh);
    }
    written
}

/// Puts the checkpoint that was written beside `path` there; the one that stood there goes to `previous`, or
/// is removed.
pub fn stand(files: &Files, path: &Path, previous: Option<&Path>) -> Result<(), FileError> {
    let kept = previous.unwrap_or(path);
    let old = beside(kept, "old");
    make_room(files, &old)?;
    if kept.exists() {
        files.rename(kept, &old)?;
    }
    if let Some(previous) = previous
        && path.exists()
    {
        files.rename(path, previous)?;
    }
    files.rename(&beside(path, "new"), path)?;
    files.sync_dir(parent(path))?;
    // The checkpoint stands. What is in the way of tidying up is none of its: it is tried again next time.
    if make_room(files, &old).is_ok() {
        remove_left(files, parent(path));
    }
    Ok(())
}

/// The checkpoints that a run can go on from, the newest first, wherever a crash has left them.
pub fn standing(checkpoints: &Path) -> Vec<PathBuf> {
    let names = ["last", "previous", "previous.old"];
    let paths = names.map(|name| checkpoints.join(name));
    paths.into_iter().filter(|path| path.is_dir()).collect()
}

/// Keeps `last`, which is damaged, under another name, and has `previous` take its place. Returns the name.
pub fn set_aside(files: &Files, checkpoints: &Path) -> Result<PathBuf, FileError> {
    let mut names = (1..).map(|n| match n {
        1 => checkpoints.join("damaged"),
        n => checkpoints.join(format!("damaged-{n}")),
    });
    let aside = names
        .find(|name| !name.exists())
        .expect("numbers do not end");
    let [last, previous] = ["last", "previous"].map(|name| checkpoints.join(name));
    files.rename(&last, &aside)?;
    files.rename(&previous, &last)?;
    Ok(aside)
}

/// Tidies up in the directory of checkpoints after a crash, so that `last` is the newest one that stood.
pub fn recover(files: &Files, checkpoints: &Path) -> Result<(), FileError> {
    let [last, previous, best] = ["last", "previous", "best"].map(|name| checkpoints.join(name));
    for path in [&last, &best] {
        make_room(files, &beside(path, "new"))?;
    }
    for path in [&last, &previous, &best] {
        for copied in [path, &beside(path, "old"), &beside(path, "new")] {
            make_room(files, &beside(copied, COPY))?;
        }
    }
    if !last.exists() && previous.exists() {
        files.rename(&previous, &last)?;
    }
    for path in [&previous, &best] {
        let old = beside(path, "old");
        if old.exists() && !path.exists() {
            files.rename(&old, path)?;
        }
        make_room(files, &old)?;
    }
    if !last.exists() && previous.exists() {
        files.rename(&previous, &last)?;
    }
    remove_left(files, checkpoints);
    Ok(())
}

/// Removes all checkpoints, whatever a crash has left of them.
pub fn remove_all(files: &Files, checkpoints: &Path) -> Result<(), FileError> {
    for path in NAMES.map(|name| checkpoints.join(name)) {
        for path in ["new", "old"]
            .map(|ending| beside(&path, ending))
            .iter()
            .chain([&path])
        {
            make_room(files, &beside(path, COPY))?;
            make_room(files, path)?;
        }
    }
    remove_left(files, checkpoints);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    /// A place with the checkpoints of two saves.
    fn two_saves(files: &Files) -> tempfile::TempDir {
        let place = tempfile::tempdir().unwrap();
        for step in 1..=2 {
            save(files, place.path(), step).unwrap();
        }
        place
    }

    fn save(files: &Files, place: &Path, step: u64) -> Result<(), FileError> {
        let contents: Contents = vec![("checkpoint.json", step.to_string().into_bytes())];
        let of = contents
            .iter()
            .map(|(name, bytes)| (*name, bytes.as_slice()));
        let [last, previous] = ["last", "previous"].map(|name| place.join(name));
        write(files, &last, &contents, &Manifest::new(step, of))?;
        stand(files, &last, Some(&previous))
    }

    fn step_of(place: &Path, name: &str) -> String {
        fs::read_to_string(place.join(name).join("checkpoint.json")).unwrap()
    }

    fn names(place: &Path) -> Vec<String> {
        let entries = fs::read_dir(place).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn checkpoints_of_a_lower_layer_take_turns_like_others() {
        let place = two_saves(&Files::default());
        let lower = ["last", "previous"].map(|name| place.path().join(name));
        let files = Files::over(&lower);
        for step in 3..=5 {
            save(&files, place.path(), step).unwrap();
            assert_eq!(step_of(place.path(), "last"), step.to_string());
            assert_eq!(step_of(place.path(), "previous"), (step - 1).to_string());
            assert_eq!(names(place.path()), ["last", "previous"]);
        }
    }

    #[test]
    fn what_cannot_be_removed_or_is_not_ours_gives_way() {
        let files = Files::default();
        let place = two_saves(&files);
        // A note of somebody, in a checkpoint that the next save would remove.
        fs::write(place.path().join("previous/notes.txt"), "mine").unwrap();
        for step in 3..=6 {
            save(&files, place.path(), step).unwrap();
        }
        let left = ["last", "previous", "previous.old.left-1"];
        assert_eq!(names(place.path()), left);
        let note = place.path().join("previous.old.left-1/notes.txt");
        assert_eq!(fs::read_to_string(&note).unwrap(), "mine");
        // An old one that a network file system lets go of later only.
        fs::remove_file(&note).unwrap();
        fs::write(place.path().join("previous.old.left-1/.nfs0001"), "").unwrap();
        save(&files, place.path(), 7).unwrap();
        assert_eq!(names(place.path()), ["last", "previous"]);
        assert_eq!(step_of(place.path(), "last"), "7");
    }

    #[test]
    fn a_save_that_stands_is_one_whatever_tidying_up_meets() {
        // The last operations of a save are those that tidy up: with a disk that fails at them it has succeeded.
        let mut succeeded = 0;
        for operations in 0..40 {
            let place = two_saves(&Files::default());
            let files = Files::failing_after(operations);
            let saved = save(&files, place.path(), 3);
            if files.failed() && saved.is_ok() {
                succeeded += 1;
                assert_eq!(step_of(place.path(), "last"), "3");
                assert_eq!(step_of(place.path(), "previous"), "2");
            }
        }
        assert!(succeeded > 0);
    }
}
