//! The manifest of a checkpoint: sizes and checksums of everything it consists of.

use super::provenance;
use crate::core::files::Checksum;
use crate::run::Logged;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// Name of the manifest in a checkpoint.
pub(crate) const MANIFEST: &str = "manifest.json";

/// Version of what is written; another one is not read.
const FORMAT: u32 = 1;

/// Length and checksum of a file, or of its beginning.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Seal {
    pub bytes: u64,
    pub checksum: Checksum,
}

impl Seal {
    pub fn of(bytes: &[u8]) -> Seal {
        Seal {
            bytes: bytes.len() as u64,
            checksum: Checksum::of(bytes),
        }
    }

    /// The sealed beginning of what was `found`.
    ///
    /// # Errors
    /// Says what is wrong with it.
    pub fn open<'a>(&self, found: &'a [u8]) -> Result<&'a [u8], String> {
        let length = usize::try_from(self.bytes).unwrap_or(usize::MAX);
        let Some(sealed) = found.get(..length) else {
            let (found, bytes) = (found.len(), self.bytes);
            return Err(format!("cut short: {found} bytes of {bytes}"));
        };
        if Checksum::of(sealed) == self.checksum {
            Ok(sealed)
        } else {
            Err(format!(
                "its bytes do not have the checksum that {MANIFEST} names"
            ))
        }
    }
}

/// Everything that a checkpoint consists of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Manifest {
    format: u32,
    /// Environment steps taken.
    pub step: u64,
    /// What wrote it.
    pub build: Build,
    /// The files beside the manifest.
    pub files: BTreeMap<String, Seal>,
    /// The replay buffer, where it is saved.
    pub replay: Option<Logged>,
    /// The learning curves up to this step, where the run can go on from here.
    pub curves: BTreeMap<String, Seal>,
}

/// The program, and the processor that it ran on.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct Build {
    mamf: String,
    commit: Option<String>,
    /// Of the program's file.
    program: Option<Checksum>,
    mujoco: String,
    processor: Option<String>,
    /// Of the sources that results depend on; none of a build from before it was recorded. What is not there is not
    /// written, so that older manifests keep their checksums.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    computes: Option<String>,
    /// The instructions that matrix kernels were chosen by; the same.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    instruction_set: Option<String>,
}

impl Build {
    /// This one.
    pub fn here() -> Build {
        Build {
            mamf: env!("CARGO_PKG_VERSION").to_owned(),
            commit: option_env!("MAMF_COMMIT").map(str::to_owned),
            program: provenance::program(),
            mujoco: mujoco_rs::version_string(),
            processor: provenance::processor(),
            computes: Some(provenance::COMPUTES.to_owned()),
            instruction_set: Some(provenance::instruction_set().to_owned()),
        }
    }

    /// What of the program that results depend on is different `now`, in words. Of another build of the same sources
    /// nothing is.
    pub fn differences(&self, now: &Build) -> Vec<String> {
        let commit = |build: &Build| build.commit.clone().unwrap_or_else(|| "unknown".to_owned());
        let sources = self.computes.as_ref().zip(now.computes.as_ref());
        if sources.is_some_and(|(then, now)| then == now) {
            let [then, now] = [&self.mujoco, &now.mujoco];
            let other = (then != now).then(|| format!("version of MuJoCo: {then} then, {now} now"));
            return other.into_iter().collect();
        }
        let pairs = [
            ("version of mamf", self.mamf.clone(), now.mamf.clone()),
            ("commit of mamf", commit(self), commit(now)),
            ("version of MuJoCo", self.mujoco.clone(), now.mujoco.clone()),
        ];
        let differs = pairs.into_iter().filter(|(_, then, now)| then != now);
        let mut differences: Vec<String> = differs
            .map(|(what, then, now)| format!("{what}: {then} then, {now} now"))
            .collect();
        let programs = self.program.zip(now.program);
        if differences.is_empty() && programs.is_some_and(|(then, now)| then != now) {
            differences.push("mamf: another build of the same commit, of other sources".to_owned());
        }
        differences
    }

    /// Says so if the processor is another one `now`, or matrix kernels are chosen by other instructions.
    pub fn other_processor(&self, now: &Build) -> Option<String> {
        let pairs = [
            ("processor", &self.processor, &now.processor),
            (
                "instruction set",
                &self.instruction_set,
                &now.instruction_set,
            ),
        ];
        let changed = pairs.into_iter().find_map(|(what, then, now)| {
            let (then, now) = (then.as_ref()?, now.as_ref()?);
            (then != now).then(|| format!("the {what} was {then} and is {now}"))
        })?;
        Some(format!(
            "{changed}: from here on figures may differ in rounding"
        ))
    }
}

/// The manifest and its own checksum, as they lie in the file.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Sealed {
    manifest: Manifest,
    /// Of the manifest as compact JSON.
    checksum: Checksum,
}

impl Manifest {
    /// Of a checkpoint after `step` steps with these `files`.
    pub fn new<'a>(step: u64, files: impl IntoIterator<Item = (&'a str, &'a [u8])>) -> Manifest {
        let files = files.into_iter();
        Manifest {
            format: FORMAT,
            step,
            build: Build::here(),
            files: files
                .map(|(name, bytes)| (name.to_owned(), Seal::of(bytes)))
                .collect(),
            replay: None,
            curves: BTreeMap::new(),
        }
    }

    fn checksum(&self) -> Checksum {
        Checksum::of(&serde_json::to_vec(self).expect("plain data is JSON"))
    }

    /// As the contents of the file.
    pub fn to_json(&self) -> String {
        let sealed = Sealed {
            manifest: self.clone(),
            checksum: self.checksum(),
        };
        serde_json::to_string_pretty(&sealed).expect("plain data is JSON")
    }

    /// From the contents of the file.
    ///
    /// # Errors
    /// Says what is wrong with them.
    pub fn from_json(json: &[u8]) -> Result<Manifest, String> {
        #[derive(Deserialize)]
        struct Versioned {
            manifest: Version,
        }
        #[derive(Deserialize)]
        struct Version {
            format: u32,
        }
        if let Ok(Versioned { manifest }) = serde_json::from_slice(json)
            && manifest.format != FORMAT
        {
            let found = manifest.format;
            return Err(format!(
                "format {found} of checkpoints; this version of mamf reads format {FORMAT}"
            ));
        }
        let sealed: Sealed = serde_json::from_slice(json).map_err(|error| error.to_string())?;
        if sealed.manifest.checksum() == sealed.checksum {
            Ok(sealed.manifest)
        } else {
            Err("it does not have its own checksum".to_owned())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_changed_byte_is_noticed_or_changes_nothing() {
        let files = [("a", &b"some"[..]), ("b", &b"more"[..])];
        let mut manifest = Manifest::new(7, files);
        manifest
            .curves
            .insert("train.csv".into(), Seal::of(b"step\n"));
        let json = manifest.to_json().into_bytes();
        assert_eq!(Manifest::from_json(&json).unwrap(), manifest);
        for i in 0..json.len() {
            for flip in [1, 2, 16, 32, 128] {
                let mut changed = json.clone();
                changed[i] ^= flip;
                let read = Manifest::from_json(&changed);
                assert!(read.is_err() || read == Ok(manifest.clone()), "{i}");
            }
            assert!(Manifest::from_json(&json[..i]).is_err(), "{i}");
        }
    }

    #[test]
    fn another_format_is_named() {
        let json = Manifest::new(1, []).to_json();
        let json = json.replacen("\"format\": 1", "\"format\": 9", 1);
        let message = Manifest::from_json(json.as_bytes()).unwrap_err();
        assert!(message.contains("format 9"), "{message}");
    }

    #[test]
    fn a_sealed_beginning_may_be_followed_by_more() {
        let seal = Seal::of(b"begin");
        assert_eq!(seal.open(b"begin").unwrap(), b"begin");
        assert_eq!(seal.open(b"beginning").unwrap(), b"begin");
        assert!(seal.open(b"begi").unwrap_err().contains("4 bytes of 5"));
        assert!(seal.open(b"bogin").unwrap_err().contains("checksum"));
    }

    #[test]
    fn differences_of_builds_are_named() {
        let here = Build::here();
        assert!(here.differences(&here).is_empty());
        let mut other = here.clone();
        (other.mamf, other.processor) = ("0.0.1".into(), Some("an abacus".into()));
        other.computes = Some("other sources".into());
        let differences = here.differences(&other);
        assert_eq!(differences.len(), 1);
        assert!(differences[0].contains("0.0.1 now"), "{differences:?}");
        assert!(here.other_processor(&here).is_none());
        let mut rebuilt = here.clone();
        rebuilt.program = Some(Checksum::of(b"another program"));
        rebuilt.commit = Some("another commit".into());
        assert!(
            here.differences(&rebuilt).is_empty(),
            "what computes is the same"
        );
        rebuilt.mujoco = "0".into();
        assert!(here.differences(&rebuilt)[0].contains("MuJoCo"));
        // Builds from before it was recorded what computes are told by their commit and their file.
        let mut old = here.clone();
        old.computes = None;
        assert!(old.differences(&here).is_empty());
        old.program = Some(Checksum::of(b"another program"));
        let differences = old.differences(&here);
        assert!(differences[0].contains("another build"), "{differences:?}");
    }

    #[test]
    fn another_instruction_set_of_the_same_processor_is_noted() {
        let here = Build::here();
        let mut other = here.clone();
        other.instruction_set = Some("abacus".into());
        let note = here.other_processor(&other).unwrap();
        assert!(
            note.contains("instruction set was") && note.contains("is abacus"),
            "{note}"
        );
        other.instruction_set = None;
        assert_eq!(
            here.other_processor(&other),
            None,
            "an older one does not tell"
        );
    }

    #[test]
    fn a_manifest_from_before_it_was_recorded_what_computes_keeps_its_checksum() {
        let mut manifest = Manifest::new(7, [("a", &b"some"[..])]);
        (manifest.build.computes, manifest.build.instruction_set) = (None, None);
        let json = manifest.to_json();
        assert!(
            !json.contains("computes") && !json.contains("instruction_set"),
            "{json}"
        );
        assert_eq!(Manifest::from_json(json.as_bytes()).unwrap(), manifest);
    }
}
