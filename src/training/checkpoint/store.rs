//! Checkpoints on disk: written beside the one that stands, then put in its place by renaming.
//!
//! `last` and `previous` take turns: whatever the moment of a crash, one of them is whole. Names that end
//! in `.new` and `.old` exist only while this goes on.

use super::Contents;
use crate::files::{FileError, Files, beside, parent};
use crate::training::manifest::{MANIFEST, Manifest};
use std::path::Path;

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
