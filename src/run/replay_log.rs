//! The replay buffer on disk: a log of transitions in chunk files, to which saving appends what is new.
//!
//! A chunk is the file `<number of its first transition>.f32`: rows `s | p | a | s' | r | d` of
//! little-endian single-precision numbers. It is only ever appended to, so that what a checkpoint refers
//! to (how many rows of which chunks, with their checksums) stays as it was while the next one is
//! written; what lies beyond is cut off when a run goes on from that checkpoint.

use crate::core::files::{Checksum, Checksummer, FileError, Files, parent};
use crate::replay::ReplayBuffer;
use serde::{Deserialize, Serialize};
use std::fs::{self, File};
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};

/// Transitions a chunk holds at most; few in tests of this crate, so that small runs have several.
const CHUNK_ROWS: u64 = if cfg!(test) { 16 } else { 65_536 };
/// Bytes that are read or written at a time.
const PIECE: usize = 1 << 20;

/// The first rows of a chunk file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Chunk {
    /// Number of its first transition, counted from the first one of the run.
    pub first: u64,
    /// Transitions.
    pub rows: u64,
    /// Of their bytes.
    pub checksum: Checksum,
}

impl Chunk {
    fn end(&self) -> u64 {
        self.first.saturating_add(self.rows)
    }
}

/// What a checkpoint must say of the log to have it read back.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Logged {
    /// Transitions ever stored.
    pub pushed: u64,
    /// The chunks that hold those still in the buffer, in order.
    pub chunks: Vec<Chunk>,
}

/// Why a log can't be read back.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ReplayLogError {
    /// The system refused.
    #[error(transparent)]
    File(#[from] FileError),
    /// A chunk is not what the checkpoint says.
    #[error("{}: {reason}", path.display())]
    Damaged {
        /// The chunk.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
}

/// The log of a run.
#[derive(Debug)]
pub struct ReplayLog {
    directory: PathBuf,
    chunks: Vec<Chunk>,
    /// Of the last chunk.
    checksummer: Checksummer,
}

impl ReplayLog {
    /// The log of a new run, in `directory`, which is made with the first chunk.
    pub fn new(directory: &Path) -> ReplayLog {
        ReplayLog {
            directory: directory.to_owned(),
            chunks: Vec::new(),
            checksummer: Checksummer::default(),
        }
    }

    /// The log in `directory` as it was when a checkpoint said `logged`, to be [trimmed](ReplayLog::trim).
    pub fn of(directory: &Path, logged: &Logged) -> ReplayLog {
        ReplayLog {
            chunks: logged.chunks.clone(),
            ..ReplayLog::new(directory)
        }
    }

    /// Appends the transitions of `buffer` that the log lacks, and waits until they outlive a loss of
    /// power. Returns what a checkpoint must say of them.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn append(&mut self, files: &Files, buffer: &ReplayBuffer) -> Result<Logged, FileError> {
        let stored = buffer.stored();
        let mut next = stored.start.max(self.chunks.last().map_or(0, Chunk::end));
        while next < stored.end {
            next = self.extend(files, buffer, next)?;
        }
        let needed = |chunk: &&Chunk| chunk.end() > stored.start;
        Ok(Logged {
            pushed: stored.end,
            chunks: self.chunks.iter().filter(needed).cloned().collect(),
        })
    }

    /// Appends transitions from number `next` on, as many as one chunk takes; the number after them.
    fn extend(
        &mut self,
        files: &Files,
        buffer: &ReplayBuffer,
        next: u64,
    ) -> Result<u64, FileError> {
        let open = self.chunks.last();
        let open = open.filter(|chunk| chunk.end() == next && chunk.rows < CHUNK_ROWS);
        let first = open.map_or(next, |chunk| chunk.first);
        let path = self.path(first);
        let mut file = if open.is_some() {
            files.open_to_append(&path)?
        } else {
            files.create_dir(&self.directory)?;
            self.checksummer = Checksummer::default();
            self.chunks.push(Chunk {
                first,
                rows: 0,
                checksum: self.checksummer.checksum(),
            });
            files.create(&path)?
        };
        let end = buffer.pushed().min(first + CHUNK_ROWS);
        for rows in buffer.rows(next..end) {
            for piece in rows.chunks(PIECE / size_of::<f32>()) {
                let bytes: Vec<u8> = piece.iter().flat_map(|x| x.to_le_bytes()).collect();
                files.append(&mut file, &path, &bytes)?;
                self.checksummer.add(&bytes);
            }
        }
        files.sync(&file, &path)?;
        if first == next {
            files.sync_dir(&self.directory)?;
            files.sync_dir(parent(&self.directory))?;
        }
        if let Some(chunk) = self.chunks.last_mut() {
            chunk.rows = end - first;
            chunk.checksum = self.checksummer.checksum();
        }
        Ok(end)
    }

    /// Removes the chunks that hold no transition from number `needed` on.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn prune(&mut self, files: &Files, needed: u64) -> Result<(), FileError> {
        while let Some(chunk) = self.chunks.first().filter(|chunk| chunk.end() <= needed) {
            files.remove(&self.path(chunk.first))?;
            self.chunks.remove(0);
        }
        Ok(())
    }

    /// Fills the empty `buffer` from the log in `directory` as it was when a checkpoint said `logged`.
    /// Nothing is changed on disk; see [`trim`](ReplayLog::trim).
    ///
    /// # Errors
    /// When a chunk is missing, cut short or damaged, or they do not hold what the buffer needs.
    pub fn read(
        directory: &Path,
        logged: &Logged,
        buffer: &mut ReplayBuffer,
    ) -> Result<ReplayLog, ReplayLogError> {
        let mut log = ReplayLog::of(directory, logged);
        let mut next = buffer.stored_of(logged.pushed).start;
        buffer.skip_to(next);
        for chunk in &logged.chunks {
            let path = log.path(chunk.first);
            if chunk.first > next || chunk.end() <= next {
                return Err(damaged(
                    &path,
                    format!("it does not hold transition {next}"),
                ));
            }
            log.checksummer = read_chunk(&path, chunk, next - chunk.first, buffer)?;
            next = chunk.end();
        }
        if next != logged.pushed {
            let reason = format!("no chunk of the checkpoint holds transition {next}");
            return Err(damaged(directory, reason));
        }
        Ok(log)
    }

    /// Has the log keep the chunks of an `older` checkpoint too, until they are [pruned](ReplayLog::prune).
    pub fn keep(&mut self, older: &Logged) {
        let first = self.chunks.first().map_or(u64::MAX, |chunk| chunk.first);
        let before = |chunk: &&Chunk| chunk.first < first;
        let kept: Vec<Chunk> = older.chunks.iter().filter(before).cloned().collect();
        self.chunks.splice(0..0, kept);
    }

    /// Cuts off and removes what was written after the checkpoint that the log was read for.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn trim(&self, files: &Files, width: usize) -> Result<(), FileError> {
        let entries = match fs::read_dir(&self.directory) {
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            entries => entries.map_err(FileError::at(&self.directory))?,
        };
        for entry in entries {
            let entry = entry.map_err(FileError::at(&self.directory))?;
            let path = entry.path();
            let known = self.chunks.iter().find(|c| self.path(c.first) == path);
            let length = entry.metadata().map_err(FileError::at(&path))?.len();
            match known {
                None if is_chunk(&path) => files.remove(&path)?,
                // Somebody else's.
                None => (),
                Some(chunk) if length > bytes(chunk.rows, width) => {
                    files.truncate(&path, bytes(chunk.rows, width))?;
                }
                Some(_) => (),
            }
        }
        Ok(())
    }

    fn path(&self, first: u64) -> PathBuf {
        self.directory.join(format!("{first:012}.f32"))
    }

    /// Removes the log in `directory`, and the directory unless something else lies there.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn remove(files: &Files, directory: &Path) -> Result<(), FileError> {
        let entries = directory.read_dir().into_iter().flatten().flatten();
        let (ours, others): (Vec<PathBuf>, Vec<PathBuf>) = entries
            .map(|entry| entry.path())
            .partition(|path| is_chunk(path));
        match others.is_empty() {
            true => files.remove(directory),
            false => ours.iter().try_for_each(|path| files.remove(path)),
        }
    }
}

/// Whether `path` has the name of a chunk.
fn is_chunk(path: &Path) -> bool {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let number = name.strip_suffix(".f32");
    number.is_some_and(|number| number.len() >= 12 && number.bytes().all(|b| b.is_ascii_digit()))
}

fn bytes(rows: u64, width: usize) -> u64 {
    rows.saturating_mul((width * size_of::<f32>()) as u64)
}

fn damaged(path: &Path, reason: String) -> ReplayLogError {
    ReplayLogError::Damaged {
        path: path.to_owned(),
        reason,
    }
}

/// Stores the rows of a chunk from row `skipped` on.
fn read_chunk(
    path: &Path,
    chunk: &Chunk,
    skipped: u64,
    buffer: &mut ReplayBuffer,
) -> Result<Checksummer, ReplayLogError> {
    let mut file = File::open(path).map_err(FileError::at(path))?;
    let found = file.metadata().map_err(FileError::at(path))?.len();
    let width = buffer.width();
    let mut left = bytes(chunk.rows, width);
    if found < left {
        let reason = format!("{found} bytes, of which the checkpoint needs {left}");
        return Err(damaged(path, reason));
    }
    let mut skipped = bytes(skipped, width);
    let row = bytes(1, width);
    let mut checksummer = Checksummer::default();
    let mut piece = vec![0; (PIECE as u64 / row).max(1) as usize * row as usize];
    let mut numbers = Vec::with_capacity(piece.len() / size_of::<f32>());
    while left > 0 {
        let length = left.min(piece.len() as u64);
        let piece = &mut piece[..length as usize];
        file.read_exact(piece).map_err(FileError::at(path))?;
        checksummer.add(piece);
        let needed = &piece[skipped.min(length) as usize..];
        numbers.clear();
        numbers.extend(needed.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b)));
        buffer.push_rows(&numbers);
        skipped -= skipped.min(length);
        left -= length;
    }
    if checksummer.checksum() == chunk.checksum {
        Ok(checksummer)
    } else {
        let reason = "its bytes do not have the checksum that the checkpoint names";
        Err(damaged(path, reason.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::replay::Transition;

    const CAPACITY: usize = 50;

    fn buffer() -> ReplayBuffer {
        ReplayBuffer::new(CAPACITY, 2, 1)
    }

    fn push(buffer: &mut ReplayBuffer, transitions: u64) {
        for _ in 0..transitions {
            let i = buffer.pushed() as f32;
            buffer.push(Transition {
                obs: &[i, i + 0.1],
                action: &[i + 0.2],
                reward: i + 0.3,
                next_obs: &[i + 1.0, i + 1.1],
                terminated: buffer.pushed().is_multiple_of(7),
                previous_action: &[i - 0.8],
            });
        }
    }

    fn names(directory: &Path) -> Vec<String> {
        let entries = fs::read_dir(directory).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn a_buffer_comes_back_from_the_log_whenever_it_is_saved() {
        let directory = tempfile::tempdir().unwrap();
        let (files, path) = (Files::default(), directory.path().join("replay"));
        let (mut written, mut log) = (buffer(), ReplayLog::new(&path));
        // Nothing, a few, the ring's first turn, and more than a whole turn between two saves.
        for more in [0, 3, 40, 10, 30, 170, 1, 0] {
            push(&mut written, more);
            let logged = log.append(&files, &written).unwrap();
            let mut read = buffer();
            log = ReplayLog::read(&path, &logged, &mut read).unwrap();
            assert_eq!(read.pushed(), written.pushed());
            assert_eq!(read.newest(CAPACITY), written.newest(CAPACITY));
            // Sampling indices lead to the same rows.
            let sample = |b: &ReplayBuffer| {
                b.sample(
                    20,
                    &crate::replay::Uniform,
                    &mut crate::core::random::stream(1, "replay"),
                )
            };
            assert!(written.is_empty() || sample(&read) == sample(&written));
        }
        // More than the ring holds was pushed in between: a gap.
        assert!(names(&path).contains(&"000000000203.f32".to_owned()));
        log.trim(&files, written.width()).unwrap();
        assert_eq!(names(&path)[0], "000000000203.f32");
    }

    #[test]
    fn what_an_earlier_checkpoint_needs_outlives_later_saves() {
        let directory = tempfile::tempdir().unwrap();
        let (files, path) = (Files::default(), directory.path().join("replay"));
        let (mut written, mut log) = (buffer(), ReplayLog::new(&path));
        push(&mut written, 30);
        let first = log.append(&files, &written).unwrap();
        let then = written.newest(CAPACITY);
        push(&mut written, 45);
        log.append(&files, &written).unwrap();
        fs::write(path.join("000000000099.f32"), "left by a crash").unwrap();
        fs::write(path.join("stranger"), "somebody else's").unwrap();

        let mut read = buffer();
        let log = ReplayLog::read(&path, &first, &mut read).unwrap();
        assert_eq!(read.newest(CAPACITY), then);
        log.trim(&files, read.width()).unwrap();
        let kept = ["000000000000.f32", "000000000016.f32", "stranger"];
        assert_eq!(names(&path), kept);
        let length = fs::metadata(path.join("000000000016.f32")).unwrap().len();
        assert_eq!(length, bytes(14, read.width()));
    }

    #[test]
    fn chunks_are_of_limited_length() {
        const CAPACITY: usize = 3 * CHUNK_ROWS as usize;
        let directory = tempfile::tempdir().unwrap();
        let mut written = ReplayBuffer::new(CAPACITY, 2, 1);
        push(&mut written, CHUNK_ROWS + 5);
        let mut log = ReplayLog::new(directory.path());
        let logged = log.append(&Files::default(), &written).unwrap();
        let rows: Vec<u64> = logged.chunks.iter().map(|chunk| chunk.rows).collect();
        assert_eq!(rows, [CHUNK_ROWS, 5]);
        let mut read = ReplayBuffer::new(CAPACITY, 2, 1);
        ReplayLog::read(directory.path(), &logged, &mut read).unwrap();
        assert_eq!(read.newest(CAPACITY), written.newest(CAPACITY));
        log.prune(&Files::default(), CHUNK_ROWS - 1).unwrap();
        assert_eq!(names(directory.path()).len(), 2);
        log.prune(&Files::default(), CHUNK_ROWS).unwrap();
        assert_eq!(names(directory.path()), [format!("{CHUNK_ROWS:012}.f32")]);
    }

    #[test]
    fn chunks_that_only_an_older_checkpoint_needs_are_kept_until_they_are_pruned() {
        let directory = tempfile::tempdir().unwrap();
        let (files, path) = (Files::default(), directory.path().join("replay"));
        let (mut written, mut log) = (buffer(), ReplayLog::new(&path));
        push(&mut written, 60);
        let older = log.append(&files, &written).unwrap();
        let then = written.newest(CAPACITY);
        push(&mut written, 30);
        let newer = log.append(&files, &written).unwrap();
        assert!(newer.chunks[0].first > older.chunks[0].first);
        push(&mut written, 20);
        log.append(&files, &written).unwrap();

        let mut read = buffer();
        let mut log = ReplayLog::read(&path, &newer, &mut read).unwrap();
        log.keep(&older);
        log.trim(&files, read.width()).unwrap();
        let mut old = buffer();
        ReplayLog::read(&path, &older, &mut old).unwrap();
        assert_eq!(old.newest(CAPACITY), then);
        log.prune(&files, read.stored().start).unwrap();
        assert!(ReplayLog::read(&path, &older, &mut buffer()).is_err());
        ReplayLog::read(&path, &newer, &mut buffer()).unwrap();
        // The log goes on where it was cut.
        push(&mut read, 40);
        let newest = log.append(&files, &read).unwrap();
        let mut again = buffer();
        ReplayLog::read(&path, &newest, &mut again).unwrap();
        assert_eq!(again.newest(CAPACITY), read.newest(CAPACITY));
    }

    #[test]
    fn every_damaged_byte_every_cut_and_every_missing_chunk_is_noticed() {
        let directory = tempfile::tempdir().unwrap();
        let (mut written, mut log) = (buffer(), ReplayLog::new(directory.path()));
        push(&mut written, 4);
        let logged = log.append(&Files::default(), &written).unwrap();
        let path = directory.path().join("000000000000.f32");
        let whole = fs::read(&path).unwrap();
        let message = |logged: &Logged| {
            let read = ReplayLog::read(directory.path(), logged, &mut buffer());
            read.unwrap_err().to_string()
        };
        for i in 0..whole.len() {
            let mut flipped = whole.clone();
            flipped[i] ^= 1 << (i % 8);
            fs::write(&path, flipped).unwrap();
            assert!(message(&logged).contains("000000000000.f32: its bytes"));
            fs::write(&path, &whole[..i]).unwrap();
            assert!(message(&logged).contains(&format!("{i} bytes, of which")));
        }
        fs::write(&path, whole).unwrap();
        let mut wrong = logged.clone();
        wrong.pushed = 5;
        assert!(message(&wrong).contains("transition 4"));
        wrong = logged.clone();
        wrong.chunks[0].rows = u64::MAX;
        assert!(message(&wrong).contains("of which the checkpoint needs"));
        wrong.chunks[0].first = 1;
        assert!(message(&wrong).contains("transition 0"));
        fs::remove_file(&path).unwrap();
        assert!(message(&logged).contains("000000000000.f32: No such file"));
    }
}
