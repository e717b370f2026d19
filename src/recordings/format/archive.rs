//! Reads single arrays out of an `.npz` file.

use std::fs::File;
use std::io::{BufReader, Read as _};
use std::path::Path;

use zip::ZipArchive;

use super::error::RecordingError;
use super::read::Settings;
use super::rows::Rows;

/// Most bytes of one array; a damaged or hostile archive must not fill the memory.
const MOST_BYTES: u64 = 1 << 31;

/// Shape and numbers of an array, in C order.
pub(super) type Contents = (Vec<usize>, Vec<f64>);

/// An open `.npz` file.
pub(super) struct Archive<'a> {
    path: &'a Path,
    settings: &'a Settings,
    zip: ZipArchive<BufReader<File>>,
}

impl<'a> Archive<'a> {
    /// Opens the file `path`, whose arrays `settings` announces.
    pub fn open(path: &'a Path, settings: &'a Settings) -> Result<Self, RecordingError> {
        let file = File::open(path).map_err(|source| RecordingError::io(path, source))?;
        let zip =
            ZipArchive::new(BufReader::new(file)).map_err(|error| RecordingError::Archive {
                path: path.to_owned(),
                source: error.into(),
            })?;
        Ok(Self {
            path,
            settings,
            zip,
        })
    }

    /// The rows of the array `name`; it is an error if there is none.
    pub fn required(&mut self, name: &str) -> Result<Rows, RecordingError> {
        self.rows(name)?
            .ok_or_else(|| self.problem(name, "is missing"))
    }

    /// The rows of the array `name`, if there is one; the first dimension counts the rows.
    pub fn rows(&mut self, name: &str) -> Result<Option<Rows>, RecordingError> {
        let Some((shape, numbers)) = self.contents(name)? else {
            return Ok(None);
        };
        let Some((&rows, row)) = shape.split_first() else {
            return Err(self.problem(name, "is a single number where rows belong"));
        };
        match product(row) {
            Some(columns) => Ok(Some(Rows::new(numbers, rows, columns))),
            None => Err(self.problem(name, format!("has the impossible shape {shape:?}"))),
        }
    }

    /// The numbers of the one-dimensional array `name`, if there is one.
    pub fn vector(&mut self, name: &str) -> Result<Option<Vec<f64>>, RecordingError> {
        match self.contents(name)? {
            None => Ok(None),
            Some((shape, numbers)) if shape.len() == 1 => Ok(Some(numbers)),
            Some((shape, _)) => {
                let problem = format!("has shape {shape:?} where a single row [n] belongs");
                Err(self.problem(name, problem))
            }
        }
    }

    /// Shape and numbers of the array `name`, if there is one; it must be there if announced.
    pub fn contents(&mut self, name: &str) -> Result<Option<Contents>, RecordingError> {
        let announced = self.settings.arrays.get(name);
        if self.zip.index_for_name(&member_of(name)).is_none() {
            return match announced {
                Some(_) => Err(self.problem(name, "is announced by the settings but missing")),
                None => Ok(None),
            };
        }
        let bytes = self.member(name)?;
        let (shape, numbers) = parse(&bytes).map_err(|problem| self.problem(name, problem))?;
        if let Some(said) = announced.and_then(|a| a.shape.as_ref())
            && *said != shape
        {
            let problem = format!("has shape {shape:?}, but the settings say {said:?}");
            return Err(self.problem(name, problem));
        }
        Ok(Some((shape, numbers)))
    }

    /// Byte position of the first number of the array `name`, of `count` numbers, if it is stored
    /// without compression.
    pub fn offset(&mut self, name: &str, count: usize) -> Option<u64> {
        let member = member_of(name);
        let file = self.zip.by_name(&member).ok()?;
        let header = file.compressed_size().checked_sub(8 * count as u64)?;
        Some(file.data_start()? + header)
    }

    /// The member of the array `name`, whole, so that its checksum is tested before its contents are
    /// interpreted.
    fn member(&mut self, name: &str) -> Result<Vec<u8>, RecordingError> {
        let member = member_of(name);
        let mut bytes = Vec::new();
        let read = match self.zip.by_name(&member) {
            Ok(file) => file
                .take(MOST_BYTES + 1)
                .read_to_end(&mut bytes)
                .map_err(|e| e.to_string()),
            Err(e) => Err(e.to_string()),
        };
        match read {
            Ok(size) if size as u64 > MOST_BYTES => {
                Err(self.problem(name, format!("has more than {MOST_BYTES} bytes")))
            }
            Ok(_) => Ok(bytes),
            Err(problem) => Err(self.problem(name, format!("cannot be read: {problem}"))),
        }
    }

    fn problem(&self, array: &str, problem: impl Into<String>) -> RecordingError {
        RecordingError::array(self.path, array, problem)
    }
}

/// The file in the archive that holds the array `name`.
pub(super) fn member_of(name: &str) -> String {
    format!("{name}.npy")
}

/// The product of the lengths; `None` if it is absurd.
fn product(lengths: &[usize]) -> Option<usize> {
    lengths
        .iter()
        .try_fold(1usize, |size, &n| size.checked_mul(n))
}

/// Shape and numbers of an `.npy` file of doubles in C order.
fn parse(bytes: &[u8]) -> Result<Contents, String> {
    let (header, data) = split(bytes).ok_or("is not an array")?;
    let kind = field(header, "descr").ok_or("says no type of its numbers")?;
    let quoted = kind.strip_prefix(['\'', '"']);
    let (kind, _) = quoted
        .and_then(|kind| kind.split_once(['\'', '"']))
        .ok_or("holds records where doubles (<f8) belong")?;
    if kind != "<f8" {
        return Err(format!("holds {kind} where doubles (<f8) belong"));
    }
    let shape = field(header, "shape").and_then(lengths);
    let shape = shape.ok_or("has no shape, or an absurd one")?;
    let by_columns = field(header, "fortran_order").is_none_or(|order| !order.starts_with("False"));
    if by_columns && shape.len() > 1 {
        return Err("is stored by columns where rows (C order) belong".to_owned());
    }
    if product(&shape).and_then(|n| n.checked_mul(8)) != Some(data.len()) {
        return Err(format!(
            "has {} bytes of data, which do not fill the shape {shape:?}",
            data.len()
        ));
    }
    let numbers = data.as_chunks::<8>().0.iter();
    Ok((shape, numbers.map(|b| f64::from_le_bytes(*b)).collect()))
}

/// The header text of an `.npy` file, and its data.
///
/// Parsed here rather than by a general parser of Python literals, which nesting or an absurd length
/// in a damaged header can bring down.
fn split(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let (version, rest) = bytes.strip_prefix(b"\x93NUMPY")?.split_first_chunk::<2>()?;
    let (length, rest) = match version[0] {
        1 => {
            let (length, rest) = rest.split_first_chunk::<2>()?;
            (usize::from(u16::from_le_bytes(*length)), rest)
        }
        2 | 3 => {
            let (length, rest) = rest.split_first_chunk::<4>()?;
            (u32::from_le_bytes(*length).try_into().ok()?, rest)
        }
        _ => return None,
    };
    let (header, data) = rest.split_at_checked(length)?;
    Some((std::str::from_utf8(header).ok()?, data))
}

/// What follows `'key':` in the header text.
fn field<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    ["'", "\""].iter().find_map(|quote| {
        let (_, value) = header.split_once(&format!("{quote}{key}{quote}"))?;
        Some(value.trim_start().strip_prefix(':')?.trim_start())
    })
}

/// The lengths in a tuple such as `(2, 3)` or `(5,)`.
fn lengths(tuple: &str) -> Option<Vec<usize>> {
    let (inside, _) = tuple.strip_prefix('(')?.split_once(')')?;
    let inside = inside.trim();
    let inside = inside.strip_suffix(',').unwrap_or(inside);
    if inside.is_empty() {
        return Some(Vec::new());
    }
    inside.split(',').map(|n| n.trim().parse().ok()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An `.npy` file of the given header text and numbers.
    fn npy(header: &str, numbers: &[f64]) -> Vec<u8> {
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        let header = format!("{header}\n");
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(numbers.iter().flat_map(|x| x.to_le_bytes()));
        bytes
    }

    fn header(descr: &str, order: &str, shape: &str) -> String {
        format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}")
    }

    #[test]
    fn reads_doubles_and_refuses_the_rest() {
        let good = npy(&header("<f8", "False", "(2, 3)"), &[1.0; 6]);
        assert_eq!(parse(&good), Ok((vec![2, 3], vec![1.0; 6])));
        let row = npy(&header("<f8", "True", "(2,)"), &[1.0; 2]);
        assert_eq!(parse(&row), Ok((vec![2], vec![1.0; 2])));
        let single = npy(&header("<f8", "False", "()"), &[1.0]);
        assert_eq!(parse(&single), Ok((vec![], vec![1.0])));

        let short = npy(&header("<f8", "False", "(2, 3)"), &[1.0; 5]);
        assert!(parse(&short).unwrap_err().contains("do not fill"));
        let floats = npy(&header("<f4", "False", "(2,)"), &[1.0]);
        assert!(parse(&floats).unwrap_err().contains("doubles"));
        let columns = npy(&header("<f8", "True", "(2, 3)"), &[1.0; 6]);
        assert!(parse(&columns).unwrap_err().contains("columns"));
        for cut in 0..good.len() {
            assert!(parse(&good[..cut]).is_err(), "cut at {cut}");
        }
    }

    #[test]
    fn absurd_headers_are_refused_without_taking_memory() {
        for shape in [
            "(4611686018427387904, 4)",
            "(99999999999999999999,)",
            "(-1,)",
            "(2; 3)",
            "2",
            "(2, 3",
        ] {
            let absurd = npy(&header("<f8", "False", shape), &[1.0; 6]);
            assert!(parse(&absurd).is_err(), "{shape}");
        }
        let nested = npy(&"(".repeat(60_000), &[]);
        assert!(parse(&nested).is_err());
        let mut long = b"\x93NUMPY\x02\x00".to_vec();
        long.extend(u32::MAX.to_le_bytes());
        assert!(parse(&long).is_err());
    }
}
