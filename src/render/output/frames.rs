//! Directories of numbered PNG files.

use std::fs;
use std::path::{Path, PathBuf};

use mujoco_rs::render::Picture;

use super::{Encoder, OutputError, failed, png};
use crate::core::files::NewFile;
use crate::core::leftovers::Unfinished;

/// `frame_00001.png` and so on in a directory.
pub(super) struct Frames {
    directory: PathBuf,
    /// The directory, if it was made for them.
    made: Option<Unfinished>,
    written: Vec<Unfinished>,
}

impl Frames {
    /// The pictures of a directory, which is made unless it is there. Other files in it are left alone,
    /// but there must be no pictures of that kind.
    pub(super) fn create(directory: &Path) -> Result<Frames, OutputError> {
        let make = || fs::create_dir_all(directory).map_err(failed(directory));
        let made = match directory.is_dir() {
            true => None,
            false => Some(Unfinished::making(make, |()| directory.to_owned())?.1),
        };
        let frames = Frames {
            directory: directory.to_owned(),
            made,
            written: Vec::new(),
        };
        for entry in fs::read_dir(directory).map_err(failed(directory))? {
            let path = entry.map_err(failed(directory))?.path();
            if is_frame(&path) {
                return Err(OutputError::Exists { path });
            }
        }
        Ok(frames)
    }
}

impl Encoder for Frames {
    fn push(&mut self, picture: &Picture, _: u32) -> Result<(), OutputError> {
        let name = format!("frame_{:05}.png", self.written.len() + 1);
        let path = self.directory.join(name);
        let file = NewFile::create(path.clone()).map_err(failed(&path))?;
        png::write(file.temporary(), picture).map_err(failed(&path))?;
        let kept = file.keep_for_now().map_err(failed(&path))?;
        self.written.push(kept);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), OutputError> {
        self.written.clear();
        self.made = None;
        Ok(())
    }
}

impl Drop for Frames {
    fn drop(&mut self) {
        let all = self.made.take().into_iter().chain(self.written.drain(..));
        all.collect::<Vec<_>>()
            .into_iter()
            .rev()
            .for_each(Unfinished::remove);
    }
}

fn is_frame(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with("frame_") && name.ends_with(".png")
}
