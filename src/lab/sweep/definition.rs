//! A file of an experiment: configurations x variants x seeds, as runs with names.

use crate::config::{self, Config, ConfigError, Overrides};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Why an experiment can't be made. Every message names the file.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum SweepError {
    /// The file can't be read.
    #[error("{}: can't read the experiment: {error}", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system said.
        error: std::io::Error,
    },
    /// It is no TOML, or a key is unknown or of a wrong type.
    #[error("{}: {error}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// Position and reason.
        error: Box<toml::de::Error>,
    },
    /// Something in it is of no use.
    #[error("{}: {reason}", path.display())]
    Wrong {
        /// The file.
        path: PathBuf,
        /// What is wrong, and what would be right.
        reason: String,
    },
    /// The settings of a run can't be used.
    #[error("{}: run {run}: {error}", path.display())]
    Run {
        /// The file.
        path: PathBuf,
        /// Name of the run.
        run: String,
        /// What is wrong with its settings; part of the message, and hence no source of it.
        error: Box<ConfigError>,
    },
}

/// The file as it is written.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    /// Configurations, relative to the file.
    configs: Vec<PathBuf>,
    seeds: Vec<u64>,
    /// Settings of all runs, each for those that have a use for it.
    #[serde(default)]
    settings: Table,
    /// Settings of each variant.
    variants: BTreeMap<String, Table>,
    /// Settings of one variant with one configuration.
    #[serde(default)]
    on: BTreeMap<String, BTreeMap<String, Table>>,
}

/// What the command line says besides.
#[derive(Debug, Clone, Default)]
pub struct Changes {
    /// Seeds instead of the file's.
    pub seeds: Option<Vec<u64>>,
    /// Settings on top of all others, as options and `KEY=VALUE`.
    pub settings: Vec<String>,
}

/// An experiment: its runs in order.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Its name: that of the file, without the ending.
    pub name: String,
    /// Its runs, seeds innermost.
    pub runs: Vec<PlannedRun>,
}

/// One run of an experiment.
#[derive(Debug, Clone)]
pub struct PlannedRun {
    /// Its place among all runs of the experiment, from 0.
    pub index: usize,
    /// `<configuration>/<variant>/seed-<n>`; also where it goes, below the folder of the experiment.
    pub name: String,
    /// File of its configuration.
    pub file: PathBuf,
    /// Its settings on top, each as `KEY=VALUE`.
    pub settings: Vec<String>,
    /// Its seed.
    pub seed: u64,
    /// All of it, resolved.
    pub config: Config,
}

impl Sweep {
    /// Reads an experiment and checks the settings of each run.
    ///
    /// # Errors
    /// When the file is unreadable or not TOML, a key is unknown, a configuration is missing, two runs have one
    /// name, or the settings of a run can't be used.
    pub fn read(path: &Path, changes: &Changes) -> Result<Sweep, SweepError> {
        let text = crate::core::text::read(path).map_err(|error| SweepError::Unreadable {
            path: path.to_owned(),
            error,
        })?;
        let file: File = toml::from_str(&text).map_err(|error| SweepError::Syntax {
            path: path.to_owned(),
            error: Box::new(error),
        })?;
        let wrong = |reason: String| SweepError::Wrong {
            path: path.to_owned(),
            reason,
        };
        let configs = file.configs(path).map_err(wrong)?;
        let seeds = changes.seeds.as_ref().unwrap_or(&file.seeds);
        for (key, empty) in [
            ("configs", configs.is_empty()),
            ("seeds", seeds.is_empty()),
            ("variants", file.variants.is_empty()),
        ] {
            if empty {
                return Err(wrong(format!("`{key}` is empty; at least one is needed")));
            }
        }
        if let Some(seed) = repeated(seeds) {
            return Err(wrong(format!(
                "seed {seed} is there twice; each seed is a run of its own"
            )));
        }
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        let mut sweep = Sweep {
            name: name.into_owned(),
            runs: Vec::new(),
        };
        for (config, file_of_config) in &configs {
            for (variant, own) in &file.variants {
                let on = file.on.get(config).and_then(|on| on.get(variant));
                let mut of_all: Vec<String> = Vec::new();
                flatten("", &file.settings, &mut of_all);
                let mut settings: Vec<String> = Vec::new();
                for table in [Some(own), on].into_iter().flatten() {
                    flatten("", table, &mut settings);
                }
                settings.extend(changes.settings.iter().cloned());
                let all = of_all.iter().chain(&settings);
                if let Some((key, instead)) = all.clone().find_map(|s| decided(s)) {
                    return Err(wrong(format!(
                        "variant {variant}: `{key}` is not a setting of an experiment; {instead}"
                    )));
                }
                for &seed in seeds {
                    let run = format!("{config}/{variant}/seed-{seed}");
                    let useful = useful(file_of_config, &of_all, &settings, seed);
                    let resolved = useful.and_then(|settings| {
                        let config = resolve(file_of_config, &[], &settings, seed)?;
                        Ok((settings, config))
                    });
                    let (settings, config) = resolved.map_err(|error| SweepError::Run {
                        path: path.to_owned(),
                        run: run.clone(),
                        error: Box::new(error),
                    })?;
                    sweep.runs.push(PlannedRun {
                        index: sweep.runs.len(),
                        config,
                        name: run,
                        file: file_of_config.clone(),
                        settings,
                        seed,
                    });
                }
            }
        }
        Ok(sweep)
    }
}

/// The key of a setting that the experiment itself decides for each run, and what to use instead.
fn decided(setting: &str) -> Option<(&str, &'static str)> {
    let key = key(setting);
    let instead = match key {
        "seed" => "`seeds` or --seeds say which there are",
        "compute.threads" => "--jobs says among how many runs the cores are divided",
        _ => return None,
    };
    Some((key, instead))
}

/// The key of a `KEY=VALUE`.
fn key(setting: &str) -> &str {
    setting.split('=').next().unwrap_or(setting).trim()
}

/// The settings of a run: those `of_all` that it has a use for, then its `own`.
fn useful(
    file: &Path,
    of_all: &[String],
    own: &[String],
    seed: u64,
) -> Result<Vec<String>, ConfigError> {
    let config = resolve(file, of_all, own, seed)?;
    let of_all = of_all.iter().filter(|s| config.has_use_for(key(s)));
    Ok(of_all.chain(own).cloned().collect())
}

/// The configuration of a run, as `mamf train` would make it of its `own` words. Those `of_all` may mean nothing to
/// it.
fn resolve(
    file: &Path,
    of_all: &[String],
    own: &[String],
    seed: u64,
) -> Result<Config, ConfigError> {
    let mut overrides = Overrides::default();
    for setting in of_all {
        overrides.set_for_all(setting)?;
    }
    for setting in own {
        overrides.set_for_variant(setting)?;
    }
    // A seed past the whole numbers of TOML comes out negative, and is refused as such.
    overrides.push(format!("seed {seed}"), "seed", seed as i64);
    config::read(file, &overrides)
}

impl File {
    /// Name and file of each configuration; also makes sure that all names mean something.
    fn configs(&self, path: &Path) -> Result<Vec<(String, PathBuf)>, String> {
        let folder = crate::core::files::parent(path);
        let mut configs: Vec<(String, PathBuf)> = Vec::new();
        for config in &self.configs {
            let name = config.file_stem().unwrap_or_default();
            let name = name.to_string_lossy().into_owned();
            if let Some((_, other)) = configs.iter().find(|(taken, _)| *taken == name) {
                let (one, two) = (other.display(), config.display());
                return Err(format!(
                    "configs: {one} and {two} would give runs of one name, `{name}`; name one of the files otherwise"
                ));
            }
            let file = plain(&folder.join(config));
            if !file.is_file() {
                let (config, file) = (config.display(), file.display());
                return Err(format!(
                    "configs: \"{config}\": there is no file {file}; paths are relative to the experiment"
                ));
            }
            configs.push((name, file));
        }
        for variant in self.variants.keys() {
            if !is_plain_name(variant) {
                return Err(format!(
                    "variants.\"{variant}\": not a name for a folder; letters, digits, `-`, `_` and `.` are"
                ));
            }
        }
        for (config, variants) in &self.on {
            if !configs.iter().any(|(name, _)| name == config) {
                let names: Vec<&str> = configs.iter().map(|(name, _)| name.as_str()).collect();
                let names = names.join(", ");
                return Err(format!(
                    "on.{config}: no such configuration; there are {names}"
                ));
            }
            for variant in variants.keys() {
                if !self.variants.contains_key(variant) {
                    let names: Vec<&str> = self.variants.keys().map(String::as_str).collect();
                    let names = names.join(", ");
                    return Err(format!(
                        "on.{config}.{variant}: no such variant; there are {names}"
                    ));
                }
            }
        }
        Ok(configs)
    }
}

fn is_plain_name(name: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_.".contains(c);
    !name.is_empty() && name.chars().all(plain) && !name.starts_with('.')
}

/// `a/b/../c` as `a/c`, to be read by people.
fn plain(path: &Path) -> PathBuf {
    let mut plain = PathBuf::new();
    for part in path.components() {
        match part {
            std::path::Component::ParentDir if plain.file_name().is_some() => {
                plain.pop();
            }
            std::path::Component::CurDir => (),
            part => plain.push(part),
        }
    }
    plain
}

fn repeated(seeds: &[u64]) -> Option<u64> {
    let mut seen = BTreeSet::new();
    seeds.iter().copied().find(|seed| !seen.insert(*seed))
}

/// Every value of a table as `KEY=VALUE`.
fn flatten(prefix: &str, table: &Table, settings: &mut Vec<String>) {
    for (key, value) in table {
        match value {
            Value::Table(inner) if !inner.is_empty() => {
                flatten(&format!("{prefix}{key}."), inner, settings);
            }
            value => settings.push(format!("{prefix}{key}={value}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CONFIG: &str = "task = \"Reacher-v4\"\nsteps = 100\n[imagination]\nbias_factor = 0.1\n";

    fn read(text: &str, changes: &Changes) -> Result<Sweep, SweepError> {
        let directory = tempfile::tempdir().unwrap();
        let folder = directory.path().join("experiments");
        std::fs::create_dir(&folder).unwrap();
        std::fs::write(directory.path().join("reacher.toml"), CONFIG).unwrap();
        std::fs::write(folder.join("reacher.toml"), CONFIG).unwrap();
        std::fs::write(directory.path().join("other.toml"), CONFIG).unwrap();
        let path = folder.join("e.toml");
        std::fs::write(&path, text).unwrap();
        Sweep::read(&path, changes)
    }

    const GOOD: &str = "configs = [\"../reacher.toml\", \"../other.toml\"]\nseeds = [3, 1]\n\
        [settings]\nrandom_steps = 50\nmodel_start = 10\nbatch_size = 10\n\
        [variants.td3]\nmethod = \"td3\"\n[variants.mamf]\nimagination.optimism = false\n\
        [on.other.mamf]\n\"imagination.optimism\" = true\n\"imagination.bias_factor\" = 0.5\n";

    #[test]
    fn runs_are_configurations_times_variants_times_seeds() {
        let sweep = read(GOOD, &Changes::default()).unwrap();
        assert_eq!(sweep.name, "e");
        let names: Vec<&str> = sweep.runs.iter().map(|run| run.name.as_str()).collect();
        assert_eq!(
            names,
            [
                "reacher/mamf/seed-3",
                "reacher/mamf/seed-1",
                "reacher/td3/seed-3",
                "reacher/td3/seed-1",
                "other/mamf/seed-3",
                "other/mamf/seed-1",
                "other/td3/seed-3",
                "other/td3/seed-1",
            ]
        );
        let [reacher, other] = [&sweep.runs[0], &sweep.runs[5]];
        assert!(!reacher.config.imagination.optimism);
        assert_eq!((reacher.seed, reacher.config.seed), (3, 3));
        assert!(other.config.imagination.optimism);
        assert_eq!(other.config.imagination.bias_factor, 0.5);
        assert_eq!(other.config.random_steps, 50);
        assert!(!reacher.file.to_str().unwrap().contains(".."));
    }

    #[test]
    fn the_command_line_has_the_last_word() {
        let changes = Changes {
            seeds: Some(vec![7]),
            settings: vec!["steps=60".into(), "batch_size=20".into()],
        };
        let sweep = read(GOOD, &changes).unwrap();
        assert_eq!(sweep.runs.len(), 4);
        for run in sweep.runs {
            let config = run.config;
            assert_eq!((config.steps, config.batch_size, config.seed), (60, 20, 7));
        }
    }

    #[test]
    fn settings_of_all_runs_are_for_those_that_have_a_use_for_them() {
        let more = "[settings]\nimagination.target_comparison = \"greater\"\n\
            imagination.bias_factor = 0.2\nexploration_noise = 0.2\n";
        let text = GOOD.replacen("[settings]\n", more, 1) + "[variants.sac]\nmethod = \"sac\"\n";
        let sweep = read(&text, &Changes::default()).unwrap();
        for run in &sweep.runs {
            let has = |key: &str| run.settings.iter().any(|setting| setting.starts_with(key));
            let is_mamf = run.name.contains("/mamf/");
            assert_eq!(
                has("imagination.target_comparison"),
                is_mamf,
                "{}",
                run.name
            );
            assert_eq!(
                has("exploration_noise"),
                !run.name.contains("/sac/"),
                "{}",
                run.name
            );
            // Without an optimistic start there is no bias.
            let is_optimistic = run.name.starts_with("other/mamf");
            assert_eq!(
                has("imagination.bias_factor"),
                is_optimistic,
                "{}",
                run.name
            );
        }
        // What a variant says itself has to mean something to it.
        let own = text.replacen(
            "method = \"sac\"",
            "method = \"sac\"\nexploration_noise = 0.2",
            1,
        );
        let message = read(&own, &Changes::default()).unwrap_err().to_string();
        assert!(
            message.contains("exploration_noise") && message.contains("`sac`"),
            "{message}"
        );
        let wrong = text.replacen("exploration_noise = 0.2", "exploration_noise = 11", 1);
        let message = read(&wrong, &Changes::default()).unwrap_err().to_string();
        assert!(
            message.contains("[settings] exploration_noise=11"),
            "{message}"
        );
        assert!(message.contains("from 0 to 10"), "{message}");
    }

    #[test]
    fn seeds_may_have_63_bits() {
        let changes = Changes {
            seeds: Some(vec![u64::MAX >> 1]),
            settings: vec![],
        };
        let sweep = read(GOOD, &changes).unwrap();
        assert_eq!(sweep.runs[0].config.seed, u64::MAX >> 1);
        let changes = Changes {
            seeds: Some(vec![u64::MAX]),
            settings: vec![],
        };
        let message = read(GOOD, &changes).unwrap_err().to_string();
        assert!(message.contains("not negative"), "{message}");
    }

    #[test]
    fn what_is_wrong_is_named() {
        let changed = |from: &str, to: &str| {
            assert!(GOOD.contains(from), "{from}");
            let read = read(&GOOD.replacen(from, to, 1), &Changes::default());
            read.unwrap_err().to_string()
        };
        for (from, to, parts) in [
            ("seeds = [3, 1]", "seed = [3]", ["unknown field", "`seed`"]),
            ("seeds = [3, 1]", "seeds = [3, 3]", ["seed 3", "twice"]),
            ("seeds = [3, 1]", "seeds = []", ["`seeds`", "at least one"]),
            ("seeds = [3, 1]", "seeds = [-1]", ["line 2", "-1"]),
            (
                "../other.toml",
                "../none.toml",
                ["none.toml", "relative to"],
            ),
            ("../other.toml", "reacher.toml", ["one name", "`reacher`"]),
            (
                "[on.other.mamf]",
                "[on.oter.mamf]",
                ["on.oter", "reacher, other"],
            ),
            (
                "[on.other.mamf]",
                "[on.other.mam]",
                ["on.other.mam", "mamf, td3"],
            ),
            ("[variants.td3]", "[variants.\"t/d\"]", ["t/d", "a folder"]),
            (
                "batch_size = 10",
                "batch_size = 0",
                ["reacher/mamf/seed-3", "from 2 to 1000000"],
            ),
            ("batch_size", "batchsize", ["`batchsize`", "`batch_size`"]),
            ("batch_size = 10", "seed = 4", ["`seed`", "`seeds`"]),
            (
                "batch_size = 10",
                "compute = { threads = 2 }",
                ["`compute.threads`", "--jobs"],
            ),
            ("[settings]", "[settings", ["line 3", "e.toml"]),
        ] {
            let message = changed(from, to);
            assert!(message.contains("e.toml"), "{message}");
            assert!(
                parts.iter().all(|part| message.contains(part)),
                "{to}: {message}"
            );
        }
    }

    #[test]
    fn paths_are_made_plain() {
        assert_eq!(plain(Path::new("a/b/../c.toml")), Path::new("a/c.toml"));
        assert_eq!(plain(Path::new("../a.toml")), Path::new("../a.toml"));
        assert_eq!(plain(Path::new("/a/./b")), Path::new("/a/b"));
    }
}
