//! Checkpoints on disk: written beside the one that stands, then put in its place by renaming.
//!
//! `last` and `previous` take turns: whatever the moment of a crash, one of them is whole. Names that end
//! in `.new` and `.old` exist only while this goes on.

use super::Contents;
use crate::core::files::{FileError, Files, beside, parent};
use crate::run::manifest::{MANIFEST, Manifest};
use std::path::{Path, PathBuf};

/// Writes a checkpoint that is to stand at `path` beside it.
pub fn write(
    files: &Files,
    path: &Path,
    contents: &Contents,
    manifest: &Manifest,
) -> Result<(), FileError> {
    let fresh = beside(path, "new");
    let write = || {
        files.remove(&fresh)?;
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
    files.remove(&old)?;
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
    files.remove(&old)
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
        files.remove(&beside(path, "new"))?;
    }
    if !last.exists() && previous.exists() {
        files.rename(&previous, &last)?;
    }
    for path in [&previous, &best] {
        let old = beside(path, "old");
        if old.exists() && !path.exists() {
            files.rename(&old, path)?;
        }
        files.remove(&old)?;
    }
    if !last.exists() && previous.exists() {
        files.rename(&previous, &last)?;
    }
    Ok(())
}
