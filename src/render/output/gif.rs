//! GIF animations.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use gif::{DisposalMethod, EncodingError, Frame, Repeat};
use mujoco_rs::render::Picture;

use super::palette::{COLOURS, Palette};
use super::{Encoder, Format, OutputError, failed};
use crate::core::files::NewFile;

/// The index of pixels that stay as they are, after those of the palette.
const UNCHANGED: u8 = COLOURS as u8;
/// Growth of the mean square error of the colours past which a palette is made anew, and the error (a
/// channel of 8 bits) below which none is.
const WORSE: f64 = 1.5;
const GOOD_ENOUGH: f64 = 12.0;

/// An animation that repeats for ever.
///
/// Pictures share the palette of the first one, so that what stands still does not flicker, and a
/// picture holds only what changed since the one before. A picture whose colours the palette does not
/// have gets a new one, which the following ones share.
pub(super) struct Gif {
    path: PathBuf,
    file: NewFile,
    /// Begun with the first picture.
    encoder: Option<gif::Encoder<BufWriter<File>>>,
    size: [usize; 2],
    palette: Option<Palette>,
    /// Whether the palette is the one that the file begins with.
    is_first: bool,
    /// Mean square error of the picture that the palette was made for.
    error: f64,
    /// Indices of the picture before.
    shown: Vec<u8>,
}

/// The part of a picture that changed.
struct Changed {
    left: usize,
    top: usize,
    width: usize,
    height: usize,
}

impl Gif {
    pub(super) fn create(path: &Path, size: [usize; 2]) -> Result<Gif, OutputError> {
        let file = NewFile::create(path.to_owned()).map_err(failed(path))?;
        Ok(Gif {
            path: path.to_owned(),
            file,
            encoder: None,
            size,
            palette: None,
            is_first: true,
            error: 0.0,
            shown: Vec::new(),
        })
    }

    /// Begins the file, with the palette of its first picture.
    fn begin(&self, palette: &[u8]) -> io::Result<gif::Encoder<BufWriter<File>>> {
        let out = BufWriter::new(File::create(self.file.temporary())?);
        let [width, height] = self.size.map(side);
        let mut encoder = gif::Encoder::new(out, width, height, palette).map_err(plain)?;
        encoder.set_repeat(Repeat::Infinite).map_err(plain)?;
        Ok(encoder)
    }

    /// The picture in the colours of a palette that suits it, and whether that is another one than
    /// that of the picture before.
    fn indices(&mut self, picture: &Picture) -> (Vec<u8>, bool) {
        if let Some(palette) = &mut self.palette {
            let (indices, error) = palette.indices(&picture.rgb);
            if error <= GOOD_ENOUGH.max(WORSE * self.error) {
                return (indices, false);
            }
        }
        self.is_first = self.palette.is_none();
        let palette = self.palette.insert(Palette::of(&picture.rgb));
        let (indices, error) = palette.indices(&picture.rgb);
        self.error = error;
        (indices, true)
    }

    /// Where `indices` differ from what is shown; one pixel where they do not.
    fn changed(&self, indices: &[u8]) -> Changed {
        let [width, height] = self.size;
        let differs = |x: usize, y: usize| indices[y * width + x] != self.shown[y * width + x];
        let row = |y: &usize| (0..width).any(|x| differs(x, *y));
        let column = |x: &usize| (0..height).any(|y| differs(*x, y));
        let top = (0..height).find(row).unwrap_or(0);
        let bottom = (top..height).rev().find(row).unwrap_or(top);
        let left = (0..width).find(column).unwrap_or(0);
        let right = (left..width).rev().find(column).unwrap_or(left);
        Changed {
            left,
            top,
            width: right - left + 1,
            height: bottom - top + 1,
        }
    }
}

impl Encoder for Gif {
    fn push(&mut self, picture: &Picture, ticks: u32) -> Result<(), OutputError> {
        let delay = u16::try_from(ticks).map_err(|_| OutputError::TooSlow {
            path: self.path.clone(),
            seconds: f64::from(ticks) * Format::Gif.ticks().seconds,
        })?;
        let (indices, fresh) = self.indices(picture);
        let [width, height] = self.size;
        let all = Changed {
            left: 0,
            top: 0,
            width,
            height,
        };
        let part = if fresh { all } else { self.changed(&indices) };
        let pixels = (part.top..part.top + part.height).flat_map(|y| {
            let row = y * width + part.left;
            row..row + part.width
        });
        let pixels = pixels.map(|i| match self.shown.get(i) {
            Some(shown) if !fresh && *shown == indices[i] => UNCHANGED,
            _ => indices[i],
        });
        let palette = self
            .palette
            .as_ref()
            .map_or(&[][..], Palette::bytes)
            .to_vec();
        let frame = Frame {
            delay,
            dispose: DisposalMethod::Keep,
            transparent: Some(UNCHANGED),
            left: side(part.left),
            top: side(part.top),
            width: side(part.width),
            height: side(part.height),
            palette: (!self.is_first).then(|| palette.clone()),
            buffer: pixels.collect::<Vec<u8>>().into(),
            ..Frame::default()
        };
        let mut encoder = match self.encoder.take() {
            Some(encoder) => encoder,
            None => self.begin(&palette).map_err(failed(&self.path))?,
        };
        let written = encoder.write_frame(&frame).map_err(plain);
        written.map_err(failed(&self.path))?;
        self.encoder = Some(encoder);
        self.shown = indices;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<(), OutputError> {
        let flush = |encoder: gif::Encoder<BufWriter<File>>| -> io::Result<()> {
            // Ends the file, which dropping the encoder would do without telling of errors.
            encoder.into_inner().map_err(plain)?.flush()
        };
        if let Some(encoder) = self.encoder {
            flush(encoder).map_err(failed(&self.path))?;
        }
        self.file.keep().map_err(failed(&self.path))
    }
}

fn side(pixels: usize) -> u16 {
    u16::try_from(pixels).unwrap_or(u16::MAX)
}

fn plain(error: EncodingError) -> io::Error {
    match error {
        EncodingError::Io(error) => error,
        error => io::Error::other(error),
    }
}
