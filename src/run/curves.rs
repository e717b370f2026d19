//! The learning curves: `train.csv`, `eval.csv` and, apart from them, `timing.csv`.
//!
//! Wall-clock figures live in `timing.csv` alone, so that two runs of one seed are equal byte for
//! byte in the other two. A figure that does not exist in a row is an empty field.

use super::manifest::Seal;
use super::schema::{CURVES, Column, EVAL, RUN_JSON, TIMING, TRAIN, names};
use super::{DiskError, provenance};
use crate::core::files::{FileError, Files};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::path::{Path, PathBuf};

/// One row of `eval.csv`: the episodes of one evaluation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EvalRow {
    /// Environment steps taken before it.
    pub step: u64,
    /// How many episodes.
    pub episodes: usize,
    /// Mean of their returns.
    pub return_mean: f64,
    /// Standard deviation of their returns.
    pub return_std: f64,
    /// Lowest return.
    pub return_min: f64,
    /// Highest return.
    pub return_max: f64,
    /// Mean length in steps.
    pub length_mean: f64,
    /// Fraction of them that ended in success, where the task knows success.
    pub success_rate: Option<f64>,
    /// Episodes whose simulation blew up; none are told of by runs from before the column was there.
    #[serde(default)]
    pub diverged: usize,
    /// Steps in which a buffer of the simulator was full; the same.
    #[serde(default)]
    pub buffers_full: usize,
}

impl EvalRow {
    /// The first of its figures that is no finite number, and its column.
    fn not_finite(&self) -> Option<(&'static str, f64)> {
        let figures = [
            self.return_mean,
            self.return_std,
            self.return_min,
            self.return_max,
            self.length_mean,
            self.success_rate.unwrap_or_default(),
        ];
        let columns = EVAL[2..].iter().map(|column| column.name);
        let mut named = columns.zip(figures);
        named.find(|(_, figure)| !figure.is_finite())
    }
}

/// Why a curve can't be read. Every message names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum CurveError {
    /// The system does not give it.
    #[error("{}: can't read the curve: {error}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// No row is in it.
    #[error("{}: there is no evaluation in it; the run has only begun, or the file was cut short", .0.display())]
    Empty(PathBuf),
    /// Its columns are others.
    #[error(
        "{}: its columns are {found}, those of eval.csv are {}; it is another file, or another version wrote it{}",
        path.display(), names(&EVAL).join(","), versions(version.as_deref())
    )]
    Columns {
        /// The file.
        path: PathBuf,
        /// Its header.
        found: String,
        /// Version of the program, as the run's provenance tells.
        version: Option<String>,
    },
    /// A line is not what it should be.
    #[error("{}, line {line}: {reason}", path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// Counted from 1.
        line: u64,
        /// What is wrong, and what would be right.
        reason: String,
    },
}

/// The version that wrote a curve and ours, where they differ.
fn versions(theirs: Option<&str>) -> String {
    let ours = env!("CARGO_PKG_VERSION");
    match theirs.filter(|theirs| *theirs != ours) {
        Some(theirs) => format!(": mamf {theirs} by run.json, this is mamf {ours}"),
        None => String::new(),
    }
}

/// The columns that every version has written of `eval.csv`; those after them came later.
const FIRST_COLUMNS: usize = 8;

/// Whether `header` is that of a file with these columns, or of one from before the last of them were added.
fn is_header(header: &str, columns: &[Column], least: usize) -> bool {
    let found = header.split(',').count();
    found >= least && names(columns).starts_with(&header.split(',').collect::<Vec<_>>())
}

/// Reads the `eval.csv` of a run: at least one row, steps growing, returns finite.
///
/// # Errors
/// When the file is missing, empty, cut short, damaged, or of another version.
pub fn read_evaluations(path: &Path) -> Result<Vec<EvalRow>, CurveError> {
    let text = fs::read_to_string(path).map_err(|error| CurveError::Unreadable {
        path: path.to_owned(),
        error,
    })?;
    let wrong = |line: u64, reason: String| CurveError::Line {
        path: path.to_owned(),
        line,
        reason,
    };
    let header = text.lines().next().unwrap_or_default();
    if header.is_empty() {
        return Err(CurveError::Empty(path.to_owned()));
    }
    if !is_header(header, &EVAL, FIRST_COLUMNS) {
        return Err(CurveError::Columns {
            path: path.to_owned(),
            found: header.to_owned(),
            version: provenance::version(&path.with_file_name(RUN_JSON)),
        });
    }
    if !text.ends_with('\n') {
        let line = text.lines().count() as u64;
        return Err(wrong(
            line,
            "the line does not end: the file was cut short".into(),
        ));
    }
    let mut rows: Vec<EvalRow> = Vec::new();
    let mut reader = csv::Reader::from_reader(text.as_bytes());
    for row in reader.deserialize() {
        let line = rows.len() as u64 + 2;
        let row: EvalRow = row.map_err(|error| wrong(line, reason_of(&error)))?;
        if let Some((column, found)) = row.not_finite() {
            return Err(wrong(line, format!("{column} {found} is not finite")));
        }
        if let Some(before) = rows.last().filter(|before| before.step >= row.step) {
            let (step, before) = (row.step, before.step);
            return Err(wrong(
                line,
                format!("step {step} after {before}; steps must grow"),
            ));
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(CurveError::Empty(path.to_owned()));
    }
    Ok(rows)
}

/// Why a row is none, without the line, which csv counts by bytes and records as well.
fn reason_of(error: &csv::Error) -> String {
    match error.kind() {
        csv::ErrorKind::UnequalLengths {
            len, expected_len, ..
        } => {
            format!("{len} fields instead of {expected_len}: the file is damaged")
        }
        csv::ErrorKind::Deserialize { err, .. } => {
            let column = err.field().and_then(|field| EVAL.get(field as usize));
            let column = column.map_or("a field", |column| column.name);
            format!("{column}: {}", err.kind())
        }
        _ => error.to_string(),
    }
}

/// The fields of the last whole row of a curve, also of one that is being written.
pub fn last_row(path: &Path) -> Option<Vec<String>> {
    let text = fs::read_to_string(path).ok()?;
    let whole = &text[..text.rfind('\n')?];
    let row = whole.lines().skip(1).last()?;
    Some(row.split(',').map(str::to_owned).collect())
}

/// One row of `timing.csv`, seconds of wall clock since the row before.
#[derive(Debug, Serialize)]
pub struct TimingRow {
    /// Environment steps taken.
    pub step: u64,
    /// Seconds in all.
    pub seconds: f64,
    /// Environment steps a second.
    pub steps_per_second: f64,
    /// Of the seconds, acting and simulating.
    pub environment_seconds: f64,
    /// Of the seconds, learning.
    pub update_seconds: f64,
    /// Of the seconds, evaluating.
    pub evaluation_seconds: f64,
    /// Of the seconds, saving.
    pub checkpoint_seconds: f64,
    /// Of the seconds, planning.
    pub planning_seconds: f64,
}

/// The three files. Each row is written at once, so that a crash costs no row that was there.
pub struct Curves {
    files: Files,
    train: Table,
    eval: Table,
    timing: Table,
}

fn length(sealed: &BTreeMap<String, Seal>, name: &str) -> u64 {
    sealed.get(name).map_or(0, |seal| seal.bytes)
}

/// One file.
struct Table {
    path: PathBuf,
    file: File,
    /// How many columns its header has; none where that is still to be written.
    columns: Option<usize>,
}

impl Curves {
    /// Makes the files in the run directory.
    pub(crate) fn create(files: &Files, directory: &Path) -> Result<Curves, FileError> {
        let create = |name, columns: &[Column]| {
            let path = directory.join(name);
            let mut file = files.create(&path)?;
            let header = format!("{}\n", names(columns).join(","));
            files.append(&mut file, &path, header.as_bytes())?;
            Ok::<_, FileError>(Table {
                path,
                file,
                columns: Some(columns.len()),
            })
        };
        let [train, eval, timing] = CURVES;
        let curves = Curves {
            train: create(train, &TRAIN)?,
            eval: create(eval, &EVAL)?,
            timing: create(timing, &TIMING)?,
            files: files.clone(),
        };
        files.sync_dir(directory)?;
        Ok(curves)
    }

    /// Opens the files in the run directory, to go on after what is sealed of each once they are
    /// [`cut`](Curves::cut).
    pub(crate) fn open(
        files: &Files,
        directory: &Path,
        sealed: &BTreeMap<String, Seal>,
    ) -> Result<Curves, FileError> {
        let open = |name: &str| {
            let path = directory.join(name);
            let columns = match length(sealed, name) {
                0 => None,
                _ => {
                    let text = fs::read_to_string(&path).map_err(FileError::at(&path))?;
                    text.lines().next().map(|header| header.split(',').count())
                }
            };
            Ok::<_, FileError>(Table {
                file: files.open_to_append(&path)?,
                path,
                columns,
            })
        };
        let [train, eval, timing] = CURVES;
        Ok(Curves {
            train: open(train)?,
            eval: open(eval)?,
            timing: open(timing)?,
            files: files.clone(),
        })
    }

    /// Removes the rows after what is sealed.
    pub(crate) fn cut(&self, sealed: &BTreeMap<String, Seal>) -> Result<(), FileError> {
        let tables = [&self.train, &self.eval, &self.timing];
        let mut named = CURVES.iter().zip(tables);
        named.try_for_each(|(name, table)| self.files.truncate(&table.path, length(sealed, name)))
    }

    /// Waits until all rows outlive a loss of power.
    pub(crate) fn sync(&self) -> Result<(), FileError> {
        let mut tables = [&self.train, &self.eval, &self.timing].into_iter();
        tables.try_for_each(|table| self.files.sync(&table.file, &table.path))
    }

    /// Waits until all rows outlive a loss of power, and seals them.
    pub(crate) fn seal(&self) -> Result<BTreeMap<String, Seal>, FileError> {
        let tables = [&self.train, &self.eval, &self.timing];
        let seals = CURVES.iter().zip(tables).map(|(name, table)| {
            self.files.sync(&table.file, &table.path)?;
            let bytes = fs::read(&table.path).map_err(FileError::at(&table.path))?;
            Ok(((*name).to_owned(), Seal::of(&bytes)))
        });
        seals.collect()
    }

    /// Writes a row of `eval.csv`.
    pub fn evaluated(&mut self, row: &EvalRow) -> Result<(), DiskError> {
        self.eval.write(&self.files, &EVAL, row)
    }

    /// Writes a row of `train.csv`, whose fields are those of [`TRAIN`], and one of `timing.csv`.
    pub fn trained(&mut self, row: impl Serialize, timing: &TimingRow) -> Result<(), DiskError> {
        self.train.write(&self.files, &TRAIN, row)?;
        self.timing.write(&self.files, &TIMING, timing)
    }
}

impl Table {
    fn write(
        &mut self,
        files: &Files,
        columns: &[Column],
        row: impl Serialize,
    ) -> Result<(), DiskError> {
        let mut writer = csv::WriterBuilder::new()
            .has_headers(false)
            .from_writer(Vec::new());
        let header = match self.columns {
            None => writer.write_record(names(columns)),
            Some(_) => Ok(()),
        };
        let written = header.and_then(|()| writer.serialize(row));
        let wrong = |error| DiskError::Row {
            path: self.path.clone(),
            error,
        };
        written.map_err(wrong)?;
        let line = writer.into_inner();
        let mut line = line.map_err(|error| wrong(error.into_error().into()))?;
        // A run that an older version began goes on with the columns that it has.
        if let Some(kept) = self.columns.filter(|kept| *kept < columns.len()) {
            let commas = line.iter().enumerate().filter(|(_, byte)| **byte == b',');
            if let Some((end, _)) = commas.map(|(i, byte)| (i, *byte)).nth(kept - 1) {
                line.truncate(end);
                line.push(b'\n');
            }
        }
        files.append(&mut self.file, &self.path, &line)?;
        self.columns.get_or_insert(columns.len());
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_that_an_older_version_began_keeps_its_columns() {
        let directory = tempfile::tempdir().unwrap();
        let (files, path) = (Files::default(), directory.path());
        let header = names(&EVAL[..FIRST_COLUMNS]).join(",");
        let old = format!("{header}\n0,2,1.5,0.0,1.5,1.5,50.0,\n");
        for name in CURVES {
            fs::write(path.join(name), if name == "eval.csv" { &old } else { "" }).unwrap();
        }
        let seals = BTreeMap::from([("eval.csv".to_owned(), Seal::of(old.as_bytes()))]);
        let mut curves = Curves::open(&files, path, &seals).unwrap();
        let row = EvalRow {
            step: 100,
            episodes: 2,
            return_mean: 2.5,
            return_std: 0.0,
            return_min: 2.5,
            return_max: 2.5,
            length_mean: 50.0,
            success_rate: None,
            diverged: 1,
            buffers_full: 3,
        };
        curves.evaluated(&row).unwrap();
        let text = fs::read_to_string(path.join("eval.csv")).unwrap();
        assert_eq!(text, format!("{old}100,2,2.5,0.0,2.5,2.5,50.0,\n"));
        let rows = read_evaluations(&path.join("eval.csv")).unwrap();
        assert_eq!((rows[1].return_mean, rows[1].diverged), (2.5, 0));
    }

    #[test]
    fn headers_are_those_of_some_version() {
        let header = |columns: usize| names(&EVAL[..columns]).join(",");
        for columns in FIRST_COLUMNS..=EVAL.len() {
            assert!(is_header(&header(columns), &EVAL, FIRST_COLUMNS));
        }
        assert!(!is_header(&header(FIRST_COLUMNS - 1), &EVAL, FIRST_COLUMNS));
        assert!(!is_header(
            &(header(EVAL.len()) + ",more"),
            &EVAL,
            FIRST_COLUMNS
        ));
        assert!(!is_header(
            &header(EVAL.len()).replace("diverged", "else"),
            &EVAL,
            FIRST_COLUMNS
        ));
    }
}
