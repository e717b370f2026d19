//! Files of pictures: one format a file, each behind [`Encoder`].

mod frames;
mod gif;
mod mp4;
mod palette;
mod png;

use std::io;
use std::path::{Path, PathBuf};

use mujoco_rs::render::Picture;

use super::Ticks;

/// A file format, by the ending of the file's name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// One picture: `.png`.
    Png,
    /// An animation: `.gif`.
    Gif,
    /// A video: `.mp4`, made by `ffmpeg`.
    Mp4,
    /// A directory of numbered PNG files.
    Frames,
}

/// What keeps pictures from being written.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The name tells no format.
    #[error(
        "{}: a name must end in .png, .gif or .mp4, or in / for a directory of pictures", path.display()
    )]
    UnknownFormat {
        /// The file.
        path: PathBuf,
    },
    /// There is a file of that name, which is left alone.
    #[error("{}: exists already and is not overwritten", path.display())]
    Exists {
        /// The file.
        path: PathBuf,
    },
    /// MP4 videos have even sides.
    #[error("{}: an MP4 video of {}x{} pixels: both numbers must be even", path.display(), size[0], size[1])]
    OddSize {
        /// The file.
        path: PathBuf,
        /// Width and height.
        size: [usize; 2],
    },
    /// There is no `ffmpeg`.
    #[error(
        "{}: MP4 videos are made by `ffmpeg`, which is not installed; install it, or write a .gif file", path.display()
    )]
    NoFfmpeg {
        /// The file.
        path: PathBuf,
    },
    /// `ffmpeg` gave up.
    #[error("{}: ffmpeg cannot make the video: {message}", path.display())]
    Ffmpeg {
        /// The file.
        path: PathBuf,
        /// What it says.
        message: String,
    },
    /// A file cannot be written.
    #[error("{}: cannot be written: {error}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says; part of the message, and hence no source of it.
        error: io::Error,
    },
    /// A picture of a GIF is to stand for longer than the format can say.
    #[error(
        "{}: a picture would stand for {seconds:.0} s, but in a GIF it can for 655 s at most; take more of them \
         (--every), or play them faster (--speed)",
        path.display()
    )]
    TooSlow {
        /// The file.
        path: PathBuf,
        /// Seconds that it is to stand.
        seconds: f64,
    },
}

/// Writes pictures, all of one size, one after the other. What was begun and not finished is removed.
pub trait Encoder {
    /// Appends a picture, to be shown for so many ticks.
    ///
    /// # Errors
    /// If it cannot be written.
    fn push(&mut self, picture: &Picture, ticks: u32) -> Result<(), OutputError>;

    /// Completes the file.
    ///
    /// # Errors
    /// If it cannot be written, or another one took its name in the meantime.
    fn finish(self: Box<Self>) -> Result<(), OutputError>;
}

impl Format {
    /// The format that the name `path` tells; an existing directory means one of pictures.
    ///
    /// # Errors
    /// If it tells none.
    pub fn of(path: &Path) -> Result<Format, OutputError> {
        let text = path.as_os_str().to_string_lossy();
        if text.ends_with(std::path::MAIN_SEPARATOR) || path.is_dir() {
            return Ok(Format::Frames);
        }
        let ending = path.extension().unwrap_or_default().to_string_lossy();
        match ending.to_lowercase().as_str() {
            "png" => Ok(Format::Png),
            "gif" => Ok(Format::Gif),
            "mp4" => Ok(Format::Mp4),
            _ => Err(OutputError::UnknownFormat {
                path: path.to_owned(),
            }),
        }
    }

    /// How the format counts time. All pictures of a video last equally long, so it needs no ticks.
    pub fn ticks(self) -> Ticks {
        match self {
            // Viewers slow pictures of a single hundredth down to a tenth of a second.
            Format::Gif => Ticks {
                seconds: 0.01,
                least: 2,
            },
            Format::Png | Format::Mp4 | Format::Frames => Ticks {
                seconds: 1e-6,
                least: 1,
            },
        }
    }
}

/// Begins the file or directory `path` for pictures `[width, height]`, one every `interval` seconds of
/// playback.
///
/// # Errors
/// If it exists or cannot be written, or the format cannot be had for such pictures.
pub fn create(
    path: &Path,
    format: Format,
    size: [usize; 2],
    interval: f64,
) -> Result<Box<dyn Encoder>, OutputError> {
    Ok(match format {
        Format::Png => Box::new(png::Png::create(path)?),
        Format::Gif => Box::new(gif::Gif::create(path, size)?),
        Format::Mp4 => Box::new(mp4::Mp4::create(path, size, interval)?),
        Format::Frames => Box::new(frames::Frames::create(path)?),
    })
}

/// What the system says of the file `path`.
fn failed(path: &Path) -> impl FnOnce(io::Error) -> OutputError + use<> {
    let path = path.to_owned();
    move |error| match error.kind() {
        io::ErrorKind::AlreadyExists => OutputError::Exists { path },
        _ => OutputError::Io { path, error },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_tells_the_format() {
        let of = |name: &str| Format::of(Path::new(name)).ok();
        assert_eq!(of("a/x.png"), Some(Format::Png));
        assert_eq!(of("x.GIF"), Some(Format::Gif));
        assert_eq!(of("x.y.mp4"), Some(Format::Mp4));
        assert_eq!(of("new/"), Some(Format::Frames));
        assert_eq!(of("."), Some(Format::Frames));
        for name in ["x", "x.webm", ".gif", ""] {
            assert_eq!(of(name), None, "{name}");
        }
    }
}
