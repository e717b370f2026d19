//! Memory of the replay buffer, counted before it is taken.

use crate::config::Config;
use crate::replay::ReplayBuffer;
use crate::task::Spec;
use std::fmt;
use std::path::Path;

/// What a full replay buffer takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ReplayMemory {
    /// Transitions.
    pub transitions: usize,
    /// Bytes of one.
    pub row: usize,
}

/// There is not that much.
#[derive(Debug, thiserror::Error)]
#[error(
    "replay.capacity: the buffer needs {needed}, but this machine has {} to spare; at most {} transitions fit",
    bytes(*available),
    available / needed.row as u64
)]
pub struct NotEnoughMemory {
    /// What it would take.
    pub needed: ReplayMemory,
    /// Bytes that there are.
    pub available: u64,
}

impl ReplayMemory {
    /// Of a run of `config`, which stores no more transitions than it takes steps.
    pub fn of(config: &Config, spec: &Spec) -> ReplayMemory {
        let steps = usize::try_from(config.steps).unwrap_or(usize::MAX);
        ReplayMemory {
            transitions: config.replay.capacity.min(steps),
            row: size_of::<f32>() * ReplayBuffer::row_width(spec.obs_size, spec.action_size),
        }
    }

    /// Bytes in all.
    pub fn bytes(&self) -> u64 {
        self.transitions as u64 * self.row as u64
    }

    /// Makes sure that the machine has as much to spare; one that does not tell is trusted.
    ///
    /// # Errors
    /// When it has not.
    pub fn check(self) -> Result<(), NotEnoughMemory> {
        self.check_against(available())
    }

    fn check_against(self, available: Option<u64>) -> Result<(), NotEnoughMemory> {
        match available {
            Some(available) if available < self.bytes() => Err(NotEnoughMemory {
                needed: self,
                available,
            }),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for ReplayMemory {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (n, row, all) = (self.transitions, self.row, bytes(self.bytes()));
        write!(f, "{n} transitions of {row} bytes, {all}")
    }
}

fn bytes(n: u64) -> String {
    indicatif::DecimalBytes(n).to_string()
}

/// Bytes that can be taken without swapping: what the system has, within the limit of the control
/// group.
fn available() -> Option<u64> {
    let system = std::fs::read_to_string("/proc/meminfo").ok();
    let system = system.and_then(|text| Some(1024 * figure(&text, "MemAvailable:")?));
    [system, group_available()].into_iter().flatten().min()
}

/// The number after `name` at the beginning of a line.
fn figure(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// What the limit of the control group leaves, if there is one. Cached files count as free.
fn group_available() -> Option<u64> {
    let own = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    own.lines().find_map(|line| {
        let [_, controllers, group] = line.splitn(3, ':').collect::<Vec<_>>().try_into().ok()?;
        let (root, names) = match controllers {
            "" => (
                "/sys/fs/cgroup",
                ["memory.max", "memory.current", "inactive_file"],
            ),
            list if list.split(',').any(|name| name == "memory") => (
                "/sys/fs/cgroup/memory",
                [
                    "memory.limit_in_bytes",
                    "memory.usage_in_bytes",
                    "total_inactive_file",
                ],
            ),
            _ => return None,
        };
        left_in(&Path::new(root).join(group.trim_start_matches('/')), names)
            // In a container the group's own directory is the root.
            .or_else(|| left_in(Path::new(root), names))
    })
}

fn left_in(group: &Path, [limit, usage, cached]: [&str; 3]) -> Option<u64> {
    let number = |name| -> Option<u64> {
        let text = std::fs::read_to_string(group.join(name)).ok()?;
        text.trim().parse().ok()
    };
    let stat = std::fs::read_to_string(group.join("memory.stat")).unwrap_or_default();
    let used = number(usage)?.saturating_sub(figure(&stat, cached).unwrap_or(0));
    Some(number(limit)?.saturating_sub(used))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_refused_with_what_would() {
        let memory = ReplayMemory {
            transitions: 1_000_000,
            row: 656,
        };
        assert!(memory.check_against(Some(656_000_000)).is_ok());
        assert!(memory.check_against(None).is_ok());
        let message = memory.check_against(Some(328_000_000)).unwrap_err();
        let message = message.to_string();
        for part in [
            "replay.capacity",
            "1000000 transitions of 656 bytes",
            "at most 500000",
        ] {
            assert!(message.contains(part), "{message}");
        }
    }

    #[test]
    fn the_machine_tells_what_it_has() {
        let available = available().unwrap();
        assert!(available > 1 << 20, "{available}");
        assert_eq!(
            figure("a: 1\nMemAvailable:   23 kB\n", "MemAvailable:"),
            Some(23)
        );
        assert_eq!(figure("MemFree: 1 kB", "MemAvailable:"), None);
    }
}
