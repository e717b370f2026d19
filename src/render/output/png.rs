//! PNG files: ISO/IEC 15948, of the one kind that pictures need.

use std::io::{self, Write};
use std::path::{Path, PathBuf};

use flate2::write::ZlibEncoder;
use flate2::{Compression, Crc};
use mujoco_rs::render::Picture;

use super::{Encoder, OutputError, failed};
use crate::core::new_file::NewFile;

const SIGNATURE: &[u8; 8] = b"\x89PNG\r\n\x1a\n";
/// Bytes of a pixel: red, green, blue.
const CHANNELS: usize = 3;
/// 8 bits a channel, colours without a palette and without transparency; the only compression and set
/// of filters there are; rows from the top.
const KIND: [u8; 5] = [8, 2, 0, 0, 0];

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
    std::fs::write(path, encode(picture)?)
}

fn encode(picture: &Picture) -> io::Result<Vec<u8>> {
    let side = |n: usize| u32::try_from(n).unwrap_or(u32::MAX).to_be_bytes();
    let sides = [side(picture.width), side(picture.height)].concat();
    let mut zlib = ZlibEncoder::new(Vec::new(), Compression::default());
    let length = CHANNELS * picture.width;
    let mut above = vec![0; length];
    for row in picture.rgb.chunks_exact(length) {
        zlib.write_all(&filtered(row, &above))?;
        above.copy_from_slice(row);
    }
    let mut out = SIGNATURE.to_vec();
    chunk(&mut out, b"IHDR", &[&sides, &KIND[..]].concat());
    chunk(&mut out, b"IDAT", &zlib.finish()?);
    chunk(&mut out, b"IEND", &[]);
    Ok(out)
}

/// A chunk: length, name, contents, and a checksum of name and contents.
fn chunk(out: &mut Vec<u8>, name: &[u8; 4], contents: &[u8]) {
    let length = u32::try_from(contents.len()).unwrap_or(u32::MAX);
    let mut checksum = Crc::new();
    checksum.update(name);
    checksum.update(contents);
    out.extend(length.to_be_bytes());
    out.extend(name);
    out.extend(contents);
    out.extend(checksum.sum().to_be_bytes());
}

/// What a byte is expected to be, by those to the left, above, and above to the left.
type Expected = fn(u8, u8, u8) -> u8;

/// A row as differences from what its neighbours let expect, after the number of the filter that was
/// used: the one with the least sum of differences, as the standard recommends.
fn filtered(row: &[u8], above: &[u8]) -> Vec<u8> {
    let filters: [(u8, Expected); 4] = [
        (0, |_, _, _| 0),
        (1, |left, _, _| left),
        (2, |_, up, _| up),
        (4, paeth),
    ];
    let before = |bytes: &[u8], i: usize| i.checked_sub(CHANNELS).map_or(0, |i| bytes[i]);
    let apply = |(number, expected): (u8, Expected)| {
        let difference = |i: usize| {
            let expected = expected(before(row, i), above[i], before(above, i));
            row[i].wrapping_sub(expected)
        };
        let differences = (0..row.len()).map(difference);
        std::iter::once(number).chain(differences).collect()
    };
    let size = |row: &Vec<u8>| -> u32 {
        let size = |x: &u8| u32::from((*x as i8).unsigned_abs());
        row[1..].iter().map(size).sum()
    };
    let candidates = filters.into_iter().map(apply);
    candidates.min_by_key(size).unwrap_or_default()
}

/// The neighbour that is nearest to left + up - corner.
fn paeth(left: u8, up: u8, corner: u8) -> u8 {
    let [a, b, c] = [left, up, corner].map(i16::from);
    let expected = a + b - c;
    let distance = |x: i16| (expected - x).abs();
    if distance(a) <= distance(b) && distance(a) <= distance(c) {
        left
    } else if distance(b) <= distance(c) {
        up
    } else {
        corner
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::read::ZlibDecoder;
    use std::io::Read;

    /// The picture in a file that `encode` made.
    fn decode(png: &[u8]) -> Picture {
        assert_eq!(&png[..8], SIGNATURE);
        let number = |at: usize| u32::from_be_bytes(png[at..at + 4].try_into().unwrap()) as usize;
        let (width, height) = (number(16), number(20));
        assert_eq!(png[24..29], KIND);
        // Behind the header of 13 bytes: its checksum, then length and name of the second chunk.
        let data = &png[41..41 + number(33)];
        assert_eq!(&png[37..41], b"IDAT");
        assert_eq!(&png[png.len() - 8..png.len() - 4], b"IEND");
        let mut rows = Vec::new();
        ZlibDecoder::new(data).read_to_end(&mut rows).unwrap();

        let length = CHANNELS * width;
        let mut rgb: Vec<u8> = Vec::new();
        for (y, row) in rows.chunks_exact(length + 1).enumerate() {
            for i in 0..length {
                let at = y * length + i;
                let left = if i < CHANNELS { 0 } else { rgb[at - CHANNELS] };
                let up = if y == 0 { 0 } else { rgb[at - length] };
                let corner = if i < CHANNELS || y == 0 {
                    0
                } else {
                    rgb[at - length - CHANNELS]
                };
                let expected = match row[0] {
                    0 => 0,
                    1 => left,
                    2 => up,
                    4 => paeth(left, up, corner),
                    other => panic!("filter {other}"),
                };
                rgb.push(row[i + 1].wrapping_add(expected));
            }
        }
        Picture { width, height, rgb }
    }

    #[test]
    fn a_picture_comes_back_to_the_byte() {
        for (width, height) in [(1, 1), (7, 5), (64, 48)] {
            let byte = |i: usize| match i % 5 {
                0 => (i * i / 7) as u8,
                1 => (i / 3) as u8,
                _ => (i / (3 * width)) as u8,
            };
            let rgb = (0..width * height * CHANNELS).map(byte).collect();
            let picture = Picture { width, height, rgb };
            assert_eq!(decode(&encode(&picture).unwrap()), picture);
        }
    }

    #[test]
    fn checksums_are_those_of_the_standard() {
        let mut out = Vec::new();
        chunk(&mut out, b"IEND", &[]);
        assert_eq!(out, b"\0\0\0\0IEND\xae\x42\x60\x82");
    }
}
