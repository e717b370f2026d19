//! Paths as people write them: names of what there is, and patterns. A path is bytes; nothing in it is special where it
//! names what is there.

use glob::{MatchOptions, Pattern, PatternError};
use std::ffi::OsStr;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};

/// Why the paths that a pattern means can't be told.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PatternsError {
    /// It is no pattern.
    #[error("not a pattern: {error}")]
    Malformed {
        /// Where it goes wrong; part of the message, and hence no source of it.
        error: PatternError,
    },
    /// A directory on the way can't be read.
    #[error("cannot read the directory {}: {error}", path.display())]
    Unreadable {
        /// The directory.
        path: PathBuf,
        /// What the system said; part of the message, and hence no source of it.
        error: io::Error,
    },
}

/// A name that begins with a dot is one like all others.
const OPTIONS: MatchOptions = MatchOptions {
    case_sensitive: true,
    require_literal_separator: true,
    require_literal_leading_dot: false,
};

/// The paths that `pattern` means, sorted: itself if it exists, or else all that match it (`*`, `?`, `[...]`, and `**` for any
/// number of directories). A part of it that names something there means just that, whatever characters it has. Bytes
/// that are no text are matched by `?` and `*`.
///
/// # Errors
/// When it is malformed, or a directory on the way can't be read.
pub fn matching(pattern: &Path) -> Result<Vec<PathBuf>, PatternsError> {
    if pattern.symlink_metadata().is_ok() {
        return Ok(vec![pattern.to_owned()]);
    }
    let mut found = vec![PathBuf::new()];
    for part in pattern.components() {
        let mut next = Vec::new();
        for place in found {
            match part {
                Component::Normal(name) if name == "**" => below(&place, &mut next)?,
                Component::Normal(name) => within(&place, name, &mut next)?,
                other => next.push(place.join(other)),
            }
        }
        // `**` leads to one place several times.
        next.sort();
        next.dedup();
        found = next;
    }
    Ok(found)
}

/// Adds what in `place` has the name `name`, or else matches it.
fn within(place: &Path, name: &OsStr, found: &mut Vec<PathBuf>) -> Result<(), PatternsError> {
    let path = place.join(name);
    if path.symlink_metadata().is_ok() {
        found.push(path);
        return Ok(());
    }
    let pattern = Pattern::new(&name.to_string_lossy());
    let pattern = pattern.map_err(|error| PatternsError::Malformed { error })?;
    if !name
        .as_encoded_bytes()
        .iter()
        .any(|byte| b"*?[".contains(byte))
    {
        return Ok(());
    }
    let names = entries(place)?;
    let matches =
        |name: &&std::ffi::OsString| pattern.matches_with(&name.to_string_lossy(), OPTIONS);
    found.extend(names.iter().filter(matches).map(|name| place.join(name)));
    Ok(())
}

/// Adds `place` and every directory below. Links to directories are not followed: they may lead round in a circle.
fn below(place: &Path, found: &mut Vec<PathBuf>) -> Result<(), PatternsError> {
    found.push(place.to_owned());
    for name in entries(place)? {
        let path = place.join(&name);
        let is_directory = path.symlink_metadata().is_ok_and(|found| found.is_dir());
        if is_directory {
            below(&path, found)?;
        }
    }
    Ok(())
}

/// The names in the directory `place`; none where it is no directory.
fn entries(place: &Path) -> Result<Vec<std::ffi::OsString>, PatternsError> {
    let directory = match place.as_os_str().is_empty() {
        true => Path::new("."),
        false => place,
    };
    let names = match directory.read_dir() {
        Err(error) if matches!(error.kind(), ErrorKind::NotADirectory | ErrorKind::NotFound) => {
            return Ok(Vec::new());
        }
        Err(error) => Err(error),
        Ok(entries) => entries.map(|entry| Ok(entry?.file_name())).collect(),
    };
    names.map_err(|error| PatternsError::Unreadable {
        path: directory.to_owned(),
        error,
    })
}

/// `path` as a word of a command line that is no option, whatever its first character.
pub fn operand(path: &Path) -> PathBuf {
    match path.as_os_str().as_encoded_bytes() {
        [b'-', ..] => Path::new(".").join(path),
        _ => path.to_owned(),
    }
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;
    use std::fs;
    use std::os::unix::ffi::OsStrExt;

    fn found(root: &Path, pattern: impl AsRef<OsStr>) -> Vec<String> {
        let found = matching(&root.join(pattern.as_ref())).unwrap();
        let name = |path: &PathBuf| {
            let path = path.strip_prefix(root).unwrap();
            path.as_os_str().as_bytes().escape_ascii().to_string()
        };
        found.iter().map(name).collect()
    }

    #[test]
    fn a_name_that_is_there_is_that_and_a_pattern_matches_any_bytes() {
        let place = tempfile::tempdir().unwrap();
        let root = place.path();
        let odd = OsStr::from_bytes(b"x\xff");
        for name in ["[1]", "1", "-d", "$a b\n:c", ".hidden"]
            .map(OsStr::new)
            .into_iter()
            .chain([odd])
        {
            fs::create_dir_all(root.join(name).join("mamf/deep")).unwrap();
        }
        assert_eq!(found(root, "[1]"), ["[1]"]);
        // The folder of that name, not the one that it would match.
        assert_eq!(found(root, "[1]/*"), ["[1]/mamf"]);
        assert_eq!(found(root, "[0-9]/*"), ["1/mamf"]);
        assert_eq!(found(root, "$a b\n:c/m?mf"), ["$a b\\n:c/mamf"]);
        assert_eq!(found(root, "x?/*"), ["x\\xff/mamf"]);
        assert_eq!(found(root, OsStr::from_bytes(b"x\xff/*")), ["x\\xff/mamf"]);
        assert_eq!(found(root, "*/mamf").len(), 6);
        assert_eq!(found(root, ".h*/mamf"), [".hidden/mamf"]);
        assert_eq!(found(root, "**/deep").len(), 6);
        assert_eq!(found(root, "1/**"), ["1", "1/mamf", "1/mamf/deep"]);
        assert!(found(root, "none/*").is_empty());
        assert!(found(root, "1/none").is_empty());
        let error = matching(&root.join("1/[")).unwrap_err();
        assert!(error.to_string().starts_with("not a pattern"), "{error}");
    }

    #[test]
    fn an_operand_is_no_option() {
        assert_eq!(operand(Path::new("-x/y")), Path::new("./-x/y"));
        assert_eq!(operand(Path::new("a/-x")), Path::new("a/-x"));
    }
}
