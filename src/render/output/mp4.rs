//! MP4 videos, by `ffmpeg`.

use std::ffi::OsString;
use std::io::{self, Read, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread::JoinHandle;

use mujoco_rs::render::Picture;

use super::{Encoder, OutputError, failed};
use crate::core::files::NewFile;

/// A video in the making: pictures go to a running `ffmpeg`.
pub(super) struct Mp4 {
    path: PathBuf,
    /// Dropped before the file, which it writes.
    ffmpeg: Ffmpeg,
    file: NewFile,
}

/// Bytes that are kept of what `ffmpeg` says: the last ones, and as many again for a while.
const KEPT: usize = 1 << 14;

/// A running `ffmpeg`, ended when it is dropped.
struct Ffmpeg {
    child: Child,
    /// Listens to what it says from the first byte on: a full pipe would have it wait for ever, and us with it.
    listener: Option<JoinHandle<Vec<u8>>>,
}

/// The end of all that comes from `pipe`.
fn listen(mut pipe: impl Read) -> Vec<u8> {
    let mut said = Vec::new();
    let mut piece = vec![0; KEPT];
    while let Ok(length @ 1..) = pipe.read(&mut piece) {
        said.extend_from_slice(&piece[..length]);
        if said.len() > 2 * KEPT {
            said.drain(..said.len() - KEPT);
        }
    }
    said
}

/// `path` as `ffmpeg` takes it for a file, whatever it begins with: options begin with a dash, and names of protocols
/// end in a colon.
fn file_url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}

impl Mp4 {
    /// Begins a video with a picture every `interval` seconds.
    pub(super) fn create(path: &Path, size: [usize; 2], interval: f64) -> Result<Mp4, OutputError> {
        let path = path.to_owned();
        // Colours are stored for two by two pixels.
        if size.iter().any(|side| side % 2 != 0) {
            return Err(OutputError::OddSize { path, size });
        }
        let file = NewFile::create(path.clone()).map_err(failed(&path))?;
        let [width, height] = size;
        let child = Command::new("ffmpeg")
            .args(["-hide_banner", "-loglevel", "error", "-y"])
            .args(["-f", "rawvideo", "-pixel_format", "rgb24"])
            .args(["-video_size", &format!("{width}x{height}")])
            .args(["-framerate", &format!("{:.6}", 1.0 / interval)])
            .args(["-i", "pipe:0"])
            .args(["-pix_fmt", "yuv420p", "-movflags", "+faststart"])
            .args(["-f", "mp4"])
            .arg(file_url(file.temporary()))
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn();
        match child {
            Ok(mut child) => {
                let errors = child.stderr.take();
                let listener = errors.map(|pipe| std::thread::spawn(move || listen(pipe)));
                Ok(Mp4 {
                    path,
                    ffmpeg: Ffmpeg { child, listener },
                    file,
                })
            }
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                Err(OutputError::NoFfmpeg { path })
            }
            Err(error) => Err(OutputError::Ffmpeg {
                path,
                message: format!("it can't be started: {error}; write a .gif file instead"),
            }),
        }
    }
}

impl Encoder for Mp4 {
    fn push(&mut self, picture: &Picture, _: u32) -> Result<(), OutputError> {
        let written = match &mut self.ffmpeg.child.stdin {
            Some(pipe) => pipe.write_all(&picture.rgb),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        };
        match written {
            Err(error) if error.kind() == io::ErrorKind::BrokenPipe => Err(OutputError::Ffmpeg {
                path: self.path.clone(),
                message: self.ffmpeg.end().1,
            }),
            written => written.map_err(failed(&self.path)),
        }
    }

    fn finish(mut self: Box<Self>) -> Result<(), OutputError> {
        match self.ffmpeg.end() {
            (true, _) => self.file.keep().map_err(failed(&self.path)),
            (false, message) => Err(OutputError::Ffmpeg {
                path: self.path,
                message,
            }),
        }
    }
}

impl Ffmpeg {
    /// Waits for the end of the video; whether it was made, and what was said.
    fn end(&mut self) -> (bool, String) {
        drop(self.child.stdin.take());
        let listener = self.listener.take();
        let text = listener.and_then(|listener| listener.join().ok());
        let text = text.unwrap_or_default();
        let made = self.child.wait().is_ok_and(|status| status.success());
        let text = String::from_utf8_lossy(&text);
        let last = text.trim().lines().last().unwrap_or("it says nothing");
        (made, last.to_owned())
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // A video that is finished has ended it already.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}
