//! Text that people wrote with whatever editor they have: UTF-8, with or without a byte-order mark, or UTF-16 with one.

use std::io::{self, ErrorKind};
use std::path::Path;

/// The text of the file `path`.
///
/// # Errors
/// When the system refuses, or it is no text.
pub fn read(path: &Path) -> io::Result<String> {
    decode(std::fs::read(path)?)
}

/// `bytes` as text, without its byte-order mark.
///
/// # Errors
/// When they are no text.
pub fn decode(bytes: Vec<u8>) -> io::Result<String> {
    let wide = |bytes: &[u8], unit: fn([u8; 2]) -> u16| {
        let (pairs, odd) = bytes.as_chunks::<2>();
        let units: Vec<u16> = pairs.iter().map(|pair| unit(*pair)).collect();
        let text = String::from_utf16(&units).ok().filter(|_| odd.is_empty());
        text.ok_or_else(|| no_text("it begins as UTF-16 and is none"))
    };
    match bytes.as_slice() {
        [0xFF, 0xFE, rest @ ..] => wide(rest, u16::from_le_bytes),
        [0xFE, 0xFF, rest @ ..] => wide(rest, u16::from_be_bytes),
        [0xEF, 0xBB, 0xBF, rest @ ..] => utf_8(rest.to_vec()),
        _ => utf_8(bytes),
    }
}

fn utf_8(bytes: Vec<u8>) -> io::Result<String> {
    String::from_utf8(bytes).map_err(|error| {
        let place = error.utf8_error().valid_up_to();
        no_text(&format!("not UTF-8 from byte {place} on; save it as UTF-8"))
    })
}

fn no_text(reason: &str) -> io::Error {
    io::Error::new(ErrorKind::InvalidData, reason)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_read_however_it_was_saved() {
        let text = "a = \"é🖐\"\n";
        let mut marked = vec![0xEF, 0xBB, 0xBF];
        marked.extend(text.bytes());
        let units = || std::iter::once(0xFEFF).chain(text.encode_utf16());
        let little: Vec<u8> = units().flat_map(u16::to_le_bytes).collect();
        let big: Vec<u8> = units().flat_map(u16::to_be_bytes).collect();
        for bytes in [text.as_bytes().to_vec(), marked, little.clone(), big] {
            assert_eq!(decode(bytes).unwrap(), text);
        }
        let message = |bytes: &[u8]| decode(bytes.to_vec()).unwrap_err().to_string();
        assert!(message(b"abc\xFF").contains("byte 3"));
        assert!(message(&little[..little.len() - 1]).contains("UTF-16"));
        assert!(message(&[0xFE, 0xFF, 0xD8, 0x00]).contains("UTF-16"));
    }
}
