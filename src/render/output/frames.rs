//! Directories of numbered PNG files.

use std::fs;
use std::path::{Path, PathBuf};

use mujoco_rs::render::Picture;

use super::{Encoder, OutputError, failed, png};
use crate::core::files::NewFile;

/// `frame_00001.png` and so on in a directory.
pub(super) struct Frames {
    directory: PathBuf,
    /// Whether the directory was made for them.
    made: bool,
    written: Vec<PathBuf>,
}

impl Frames {
    /// The pictures of a directory, which is made unless it is there. Other files in it are left alone,
    /// but there must be no pictures of that kind.
    pub(super) fn create(directory: &Path) -> Result<Frames, OutputError> {
        let made = !directory.is_dir();
        fs::create_dir_all(directory).map_err(failed(directory))?;
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
        file.keep().map_err(failed(&path))?;
        self.written.push(path);
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<(), OutputError> {
        self.written.clear();
        self.made = false;
        Ok(())
    }
}

impl Drop for Frames {
    fn drop(&mut self) {
        for path in &self.written {
            let _ = fs::remove_file(path);
        }
        if self.made {
            let _ = fs::remove_dir(&self.directory);
        }
    }
}

fn is_frame(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    name.starts_with("frame_") && name.ends_with(".png")
}
