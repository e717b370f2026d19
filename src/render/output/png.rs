//! PNG files.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::{Path, PathBuf};

use mujoco_rs::render::Picture;
use png::{BitDepth, ColorType};

use super::{Encoder, OutputError, failed};
use crate::core::files::NewFile;

/// One picture; of several, the last.
pub(super) struct Png {
    path: PathBuf,
    file: NewFile,
}

impl Png {
    pub(super) fn create(path: &Path) -> Result<Png, OutputError> {
        let file = NewFile::create(path.to_owned()).map_err(failed(path))?;
        let path = path.to_owned();
        Ok(Png { path, file })
    }
}

impl Encoder for Png {
    fn push(&mut self, picture: &Picture, _: u32) -> Result<(), OutputError> {
        write(self.file.temporary(), picture).map_err(failed(&self.path))
    }

    fn finish(self: Box<Self>) -> Result<(), OutputError> {
        self.file.keep().map_err(failed(&self.path))
    }
}

/// Writes `picture` over the file `path`.
pub(super) fn write(path: &Path, picture: &Picture) -> io::Result<()> {
    let mut out = BufWriter::new(File::create(path)?);
    let [width, height] = [picture.width, picture.height].map(|side| side as u32);
    let mut encoder = png::Encoder::new(&mut out, width, height);
    encoder.set_color(ColorType::Rgb);
    encoder.set_depth(BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&picture.rgb)?;
    writer.finish()?;
    out.flush()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::io::BufReader;

    #[test]
    fn a_picture_comes_back_to_the_byte() {
        let directory = tempfile::tempdir().unwrap();
        let path = directory.path().join("picture.png");
        for (width, height) in [(1, 1), (7, 5), (64, 48)] {
            let byte = |i: usize| match i % 5 {
                0 => (i * i / 7) as u8,
                1 => (i / 3) as u8,
                _ => (i / (3 * width)) as u8,
            };
            let rgb: Vec<u8> = (0..3 * width * height).map(byte).collect();
            let picture = Picture { width, height, rgb };
            write(&path, &picture).unwrap();
            let file = BufReader::new(File::open(&path).unwrap());
            let mut reader = png::Decoder::new(file).read_info().unwrap();
            let mut rgb = vec![0; reader.output_buffer_size().unwrap()];
            let info = reader.next_frame(&mut rgb).unwrap();
            assert_eq!(
                (info.color_type, info.bit_depth),
                (ColorType::Rgb, BitDepth::Eight)
            );
            let [width, height] = [info.width, info.height].map(|side| side as usize);
            assert_eq!(Picture { width, height, rgb }, picture);
        }
    }
}
