//! Reads a recorded rollout.

use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use npyz::npz::NpzArchive;
use npyz::{DType, NpyFile, Order};
use serde::Deserialize;
use std::collections::BTreeMap;

/// What keeps a rollout from being read.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum RolloutError {
    /// A file cannot be opened or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },
    /// The settings are not what they should be.
    #[error("{}: {source}", path.display())]
    Settings {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: serde_json::Error,
    },
    /// The archive cannot be read.
    #[error("{}: not a readable archive of arrays: {source}", path.display())]
    Archive {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: std::io::Error,
    },
    /// An array is missing or is not what it should be.
    #[error("{}: array `{array}`: {problem}", path.display())]
    Array {
        /// The file.
        path: PathBuf,
        /// The array.
        array: String,
        /// What is wrong.
        problem: String,
    },
}

/// What the `.json` file says; everything else in it is for people.
#[derive(Debug, Clone, Deserialize)]
pub struct Settings {
    /// Id of the task.
    pub env: String,
    /// The arrays that the `.npz` file holds.
    #[serde(default)]
    arrays: BTreeMap<String, ArraySettings>,
}

#[derive(Debug, Clone, Deserialize)]
struct ArraySettings {
    shape: Option<Vec<usize>>,
}

/// Rows of equal length.
#[derive(Debug, Clone, PartialEq)]
pub struct Rows {
    numbers: Vec<f64>,
    rows: usize,
    columns: usize,
}

impl Rows {
    /// Number of rows.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Length of a row.
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// Row `t`, if there is one.
    pub fn get(&self, t: usize) -> Option<&[f64]> {
        (t < self.rows).then(|| &self.numbers[t * self.columns..][..self.columns])
    }
}

/// A recorded rollout of one task.
///
/// Row t of a state array holds what was before action t. There is one row more than there are
/// actions, unless the recording lacks the state after the last action.
#[derive(Debug, Clone)]
pub struct Rollout {
    /// The file it came from.
    pub path: PathBuf,
    /// Id of the task.
    pub env: String,
    /// Actions, one row a step.
    pub action: Rows,
    /// Positions.
    pub qpos: Rows,
    /// Velocities.
    pub qvel: Rows,
    /// Accelerations from which the solver started.
    pub qacc_warmstart: Option<Rows>,
    /// Simulated time.
    pub time: Option<Rows>,
    /// Observations.
    pub obs: Option<Rows>,
    /// Rewards, one a step.
    pub reward: Option<Rows>,
    /// Whether the step terminated, 0 or 1, one a step.
    pub terminated: Option<Rows>,
}

impl Rollout {
    /// Reads the settings beside the archive `path`.
    ///
    /// # Errors
    /// If there are none or they name no task.
    pub fn settings(path: &Path) -> Result<Settings, RolloutError> {
        let path = path.with_extension("json");
        let text = std::fs::read(&path).map_err(|source| RolloutError::Io {
            path: path.clone(),
            source,
        })?;
        serde_json::from_slice(&text).map_err(|source| RolloutError::Settings { path, source })
    }

    /// Reads the archive `path`, whose settings are `settings`.
    ///
    /// # Errors
    /// If the archive is damaged, or an array is missing, malformed or of the wrong length.
    pub fn read(path: &Path, settings: Settings) -> Result<Self, RolloutError> {
        let mut archive = Archive::open(path, &settings)?;
        let rollout = Self {
            action: archive.required("action")?,
            qpos: archive.required("qpos")?,
            qvel: archive.required("qvel")?,
            qacc_warmstart: archive.optional("qacc_warmstart")?,
            time: archive.optional("time")?,
            obs: archive.optional("obs")?,
            reward: archive.optional("reward")?,
            terminated: archive.optional("terminated")?,
            path: path.to_owned(),
            env: settings.env,
        };
        rollout.check_lengths()?;
        Ok(rollout)
    }

    /// Number of recorded actions.
    pub fn steps(&self) -> usize {
        self.action.rows
    }

    /// Whether the rollout begins anew between rows `t - 1` and `t`.
    pub fn reset_before(&self, t: usize) -> bool {
        let at = |t| self.time.as_ref().and_then(|time| Some(time.get(t)?[0]));
        match (t.checked_sub(1).and_then(at), at(t)) {
            (Some(before), Some(now)) => now <= before,
            _ => t == 0,
        }
    }

    /// Makes sure that the array `name` has `columns` columns.
    pub(super) fn expect_columns(
        &self,
        name: &str,
        rows: &Rows,
        columns: usize,
    ) -> Result<(), RolloutError> {
        if rows.columns == columns {
            return Ok(());
        }
        Err(self.problem(
            name,
            format!(
                "rows have {} numbers where {} has {columns}",
                rows.columns, self.env
            ),
        ))
    }

    fn check_lengths(&self) -> Result<(), RolloutError> {
        let steps = self.steps();
        if steps == 0 {
            return Err(self.problem("action", "is empty".to_owned()));
        }
        let states = [
            ("qpos", Some(&self.qpos)),
            ("qvel", Some(&self.qvel)),
            ("qacc_warmstart", self.qacc_warmstart.as_ref()),
            ("time", self.time.as_ref()),
            ("obs", self.obs.as_ref()),
        ];
        for (name, rows) in states {
            if rows.is_some_and(|r| r.rows != steps && r.rows != steps + 1) {
                let rows = rows.map_or(0, Rows::rows);
                let problem = format!("has {rows} rows for {steps} actions");
                return Err(self.problem(name, problem));
            }
        }
        for (name, rows) in [("reward", &self.reward), ("terminated", &self.terminated)] {
            if rows.as_ref().is_some_and(|r| r.rows != steps) {
                let rows = rows.as_ref().map_or(0, Rows::rows);
                let problem = format!("has {rows} rows for {steps} actions");
                return Err(self.problem(name, problem));
            }
        }
        for (name, rows) in [
            ("time", &self.time),
            ("reward", &self.reward),
            ("terminated", &self.terminated),
        ] {
            if let Some(rows) = rows {
                self.expect_columns(name, rows, 1)?;
            }
        }
        Ok(())
    }

    fn problem(&self, array: &str, problem: String) -> RolloutError {
        RolloutError::Array {
            path: self.path.clone(),
            array: array.to_owned(),
            problem,
        }
    }
}

/// An open `.npz` file.
struct Archive<'a> {
    path: &'a Path,
    settings: &'a Settings,
    npz: NpzArchive<BufReader<File>>,
}

impl<'a> Archive<'a> {
    fn open(path: &'a Path, settings: &'a Settings) -> Result<Self, RolloutError> {
        let file = File::open(path).map_err(|source| RolloutError::Io {
            path: path.to_owned(),
            source,
        })?;
        let npz =
            NpzArchive::new(BufReader::new(file)).map_err(|source| RolloutError::Archive {
                path: path.to_owned(),
                source,
            })?;
        Ok(Self {
            path,
            settings,
            npz,
        })
    }

    fn required(&mut self, name: &str) -> Result<Rows, RolloutError> {
        self.optional(name)?
            .ok_or_else(|| self.problem(name, "is missing"))
    }

    fn optional(&mut self, name: &str) -> Result<Option<Rows>, RolloutError> {
        let announced = self.settings.arrays.get(name);
        let member = npyz::npz::file_name_from_array_name(name);
        if !self.npz.array_names().any(|n| n == name) {
            return match announced {
                Some(_) => Err(self.problem(name, "is announced by the settings but missing")),
                None => Ok(None),
            };
        }
        // The whole member is read first, so that its checksum is tested before it is interpreted.
        let mut bytes = Vec::new();
        let read = match self.npz.zip_archive().by_name(&member) {
            Ok(mut file) => file.read_to_end(&mut bytes).map_err(|e| e.to_string()),
            Err(e) => Err(e.to_string()),
        };
        if let Err(problem) = read {
            return Err(self.problem(name, problem));
        }
        let (shape, numbers) = parse(&bytes).map_err(|problem| self.problem(name, problem))?;
        if let Some(said) = announced.and_then(|a| a.shape.as_ref())
            && *said != shape
        {
            let problem = format!("has shape {shape:?}, but the settings say {said:?}");
            return Err(self.problem(name, problem));
        }
        let rows = match shape.first() {
            Some(&rows) => rows,
            None => return Err(self.problem(name, "is a single number")),
        };
        let columns = shape[1..].iter().product();
        Ok(Some(Rows {
            numbers,
            rows,
            columns,
        }))
    }

    fn problem(&self, array: &str, problem: impl Into<String>) -> RolloutError {
        RolloutError::Array {
            path: self.path.to_owned(),
            array: array.to_owned(),
            problem: problem.into(),
        }
    }
}

/// Shape and numbers of an `.npy` file of doubles.
fn parse(bytes: &[u8]) -> Result<(Vec<usize>, Vec<f64>), String> {
    let npy = NpyFile::new(bytes).map_err(|e| format!("is not an array: {e}"))?;
    match npy.dtype() {
        DType::Plain(kind) if kind.to_string() == "<f8" => (),
        other => return Err(format!("holds {} where doubles belong", other.descr())),
    }
    if npy.order() == Order::Fortran && npy.shape().len() > 1 {
        return Err("is stored by columns".to_owned());
    }
    let shape: Option<Vec<usize>> = npy.shape().iter().map(|&n| n.try_into().ok()).collect();
    let shape = shape.ok_or("is too large")?;
    let size = shape
        .iter()
        .try_fold(8usize, |size, &n| size.checked_mul(n));
    let data = npy.into_inner();
    if size != Some(data.len()) {
        return Err(format!(
            "has {} bytes of data, which do not fill the shape {shape:?}",
            data.len()
        ));
    }
    let numbers = data
        .as_chunks::<8>()
        .0
        .iter()
        .map(|b| f64::from_le_bytes(*b))
        .collect();
    Ok((shape, numbers))
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

    #[test]
    fn reads_doubles_and_refuses_the_rest() {
        let header = |descr, order, shape| {
            format!("{{'descr': '{descr}', 'fortran_order': {order}, 'shape': {shape}, }}")
        };
        let good = npy(&header("<f8", "False", "(2, 3)"), &[1.0; 6]);
        assert_eq!(parse(&good), Ok((vec![2, 3], vec![1.0; 6])));

        let short = npy(&header("<f8", "False", "(2, 3)"), &[1.0; 5]);
        assert!(parse(&short).unwrap_err().contains("do not fill"));
        let huge = npy(
            &header("<f8", "False", "(4611686018427387904, 4)"),
            &[1.0; 5],
        );
        assert!(parse(&huge).is_err());
        let floats = npy(&header("<f4", "False", "(2,)"), &[1.0]);
        assert!(parse(&floats).unwrap_err().contains("doubles"));
        let columns = npy(&header("<f8", "True", "(2, 3)"), &[1.0; 6]);
        assert!(parse(&columns).unwrap_err().contains("columns"));
        for cut in 0..good.len() {
            assert!(parse(&good[..cut]).is_err(), "cut at {cut}");
        }
    }
}
