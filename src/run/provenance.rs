//! Where a run's figures come from: `run.json`.

use crate::core::files::Checksum;
use serde::Serialize;
use serde_json::{Map, Value};
use std::path::Path;
use std::sync::OnceLock;
use std::time::SystemTime;

/// Versions, commit, host and command of a run.
#[derive(Debug, Serialize)]
pub(crate) struct Provenance {
    mamf: &'static str,
    commit: Option<&'static str>,
    /// Whether files differed from the commit when the program was built.
    dirty: Option<bool>,
    /// Checksum of the program's file.
    program: Option<Checksum>,
    /// Checksum of the sources that compute.
    computes: &'static str,
    mujoco: String,
    rustc: &'static str,
    command: Vec<String>,
    started: String,
    host: Option<String>,
    cpu: Option<String>,
    instruction_set: &'static str,
    cpus: Option<usize>,
}

/// A continuation of a run: from which step, and by which process.
#[derive(Debug, Serialize)]
struct Resumed {
    step: u64,
    #[serde(flatten)]
    by: Provenance,
}

/// Version of the program that began the run whose provenance is the file at `path`.
pub(crate) fn version(path: &Path) -> Option<String> {
    let json = std::fs::read_to_string(path).ok()?;
    let run: Value = serde_json::from_str(&json).ok()?;
    Some(run.get("mamf")?.as_str()?.to_owned())
}

impl Provenance {
    /// As the contents of the file.
    pub(crate) fn to_json(&self) -> String {
        serde_json::to_string_pretty(self).expect("plain data is JSON")
    }

    /// The contents of a file that held `json`, with this process as one that goes on from `step`. A file
    /// that can't be read is begun anew.
    pub(crate) fn after(self, json: &str, step: u64) -> String {
        let mut run: Map<String, Value> = serde_json::from_str(json).unwrap_or_default();
        let resumed = Resumed { step, by: self };
        let resumed = serde_json::to_value(resumed).expect("plain data is JSON");
        match run
            .entry("resumed")
            .or_insert_with(|| Value::Array(Vec::new()))
        {
            Value::Array(list) => list.push(resumed),
            other => *other = Value::Array(vec![resumed]),
        }
        serde_json::to_string_pretty(&run).expect("plain data is JSON")
    }

    /// Of this process.
    pub(crate) fn here() -> Provenance {
        Provenance {
            mamf: env!("CARGO_PKG_VERSION"),
            commit: option_env!("MAMF_COMMIT"),
            dirty: option_env!("MAMF_DIRTY").map(|dirty| dirty == "true"),
            program: program(),
            computes: COMPUTES,
            mujoco: mujoco_rs::version_string(),
            rustc: env!("MAMF_RUSTC"),
            command: std::env::args_os()
                .map(|word| word.to_string_lossy().into_owned())
                .collect(),
            started: humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
            host: host(),
            cpu: processor(),
            instruction_set: instruction_set(),
            cpus: std::thread::available_parallelism().ok().map(usize::from),
        }
    }
}

/// What the program computes with: a checksum of the sources that results depend on, of the libraries and the compiler.
pub(crate) const COMPUTES: &str = env!("MAMF_COMPUTES");

/// Checksum of this program's file, as it was when it was first asked for.
pub(crate) fn program() -> Option<Checksum> {
    static PROGRAM: OnceLock<Option<Checksum>> = OnceLock::new();
    // This name leads to the file that runs, also where another has taken its place.
    let running =
        || std::fs::read("/proc/self/exe").or_else(|_| std::fs::read(std::env::current_exe()?));
    *PROGRAM.get_or_init(|| Some(Checksum::of(&running().ok()?)))
}

/// The widest instructions that matrix kernels find here, by which these are chosen.
pub(crate) fn instruction_set() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") {
            return "avx512f";
        }
        if std::arch::is_x86_feature_detected!("avx2") && std::arch::is_x86_feature_detected!("fma")
        {
            return "avx2+fma";
        }
        if std::arch::is_x86_feature_detected!("avx") {
            return "avx";
        }
        "sse2"
    }
    #[cfg(not(target_arch = "x86_64"))]
    std::env::consts::ARCH
}

/// Name of this machine.
pub(crate) fn host() -> Option<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").ok()?;
    Some(name.trim().to_owned())
}

/// Model of the processor.
pub(crate) fn processor() -> Option<String> {
    let text = std::fs::read_to_string("/proc/cpuinfo").ok()?;
    let line = text.lines().find(|line| line.starts_with("model name"))?;
    Some(line.split_once(':')?.1.trim().to_owned())
}
