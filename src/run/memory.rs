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
        ReplayMemory::of_sizes(config, spec.obs_size, spec.action_size)
    }

    /// A full one's of a run of `config`, whose observations and actions have these sizes.
    pub fn of_sizes(config: &Config, obs_size: usize, action_size: usize) -> ReplayMemory {
        let steps = usize::try_from(config.steps).unwrap_or(usize::MAX);
        ReplayMemory {
            transitions: config.replay.capacity.min(steps),
            row: size_of::<f32>() * ReplayBuffer::row_width(obs_size, action_size),
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

/// A number of bytes for people.
pub fn bytes(n: u64) -> String {
    indicatif::DecimalBytes(n).to_string()
}

/// Bytes that can be taken without swapping: what the system has, within the limits of the control groups.
pub fn available() -> Option<u64> {
    let system = std::fs::read_to_string("/proc/meminfo").ok();
    let system = system.and_then(|text| Some(1024 * figure(&text, "MemAvailable:")?));
    [system, groups_available()].into_iter().flatten().min()
}

/// The number after `name` at the beginning of a line.
fn figure(text: &str, name: &str) -> Option<u64> {
    let line = text.lines().find_map(|line| line.strip_prefix(name))?;
    line.split_whitespace().next()?.parse().ok()
}

/// What the limits of the control groups leave, of the process's own and of all above it, if there are any. Cached files
/// count as free.
fn groups_available() -> Option<u64> {
    let own = std::fs::read_to_string("/proc/self/cgroup").ok()?;
    groups_left(&own, Path::new("/sys/fs/cgroup"))
}

/// The same for a process whose groups are `own`, as `/proc/self/cgroup` tells them, below `root`.
fn groups_left(own: &str, root: &Path) -> Option<u64> {
    let left = own.lines().filter_map(|line| {
        let [_, controllers, group] = line.splitn(3, ':').collect::<Vec<_>>().try_into().ok()?;
        let memory = controllers.split(',').any(|name| name == "memory");
        let names = match controllers {
            // Where version 1 has the other controllers too, version 2 lies in a folder.
            "" => ["memory.max", "memory.current", "inactive_file"],
            _ if memory => [
                "memory.limit_in_bytes",
                "memory.usage_in_bytes",
                "total_inactive_file",
            ],
            _ => return None,
        };
        let mounts = match controllers {
            "" => [root.to_owned(), root.join("unified")],
            _ => [root.join("memory"), root.join(controllers)],
        };
        // In a container the group's own directory may be the root; a group that is not seen there has no files.
        let group = Path::new(group.trim_start_matches('/'));
        let above = mounts
            .iter()
            .flat_map(|mount| group.ancestors().map(|group| mount.join(group)));
        above.filter_map(|group| left_in(&group, names)).min()
    });
    left.min()
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

    /// Writes a control group of version 2 or 1 that has used `used` bytes of `limit`.
    fn group(path: &Path, is_2: bool, limit: &str, used: u64) {
        std::fs::create_dir_all(path).unwrap();
        let [max, current] = match is_2 {
            true => ["memory.max", "memory.current"],
            false => ["memory.limit_in_bytes", "memory.usage_in_bytes"],
        };
        std::fs::write(path.join(max), format!("{limit}\n")).unwrap();
        std::fs::write(path.join(current), format!("{used}\n")).unwrap();
    }

    #[test]
    fn limits_of_the_groups_above_count_as_well() {
        let directory = tempfile::tempdir().unwrap();
        let root = directory.path();
        for (name, is_2, own) in [
            ("2", true, "0::/slice/job/step\n"),
            ("1", false, "5:cpu:/x\n4:memory:/slice/job/step\n"),
        ] {
            let root = root.join(name);
            let mount = if is_2 {
                root.clone()
            } else {
                root.join("memory")
            };
            let unlimited = if is_2 { "max" } else { "9223372036854771712" };
            group(&mount.join("slice/job/step"), is_2, unlimited, 10);
            group(&mount.join("slice/job"), is_2, "1000", 400);
            group(&mount.join("slice"), is_2, "5000", 900);
            assert_eq!(
                groups_left(own, &root),
                Some(600),
                "of the group above, version {name}"
            );
            group(&mount.join("slice/job/step"), is_2, "100", 10);
            assert_eq!(groups_left(own, &root), Some(90), "of its own");
            group(&mount.join("slice"), is_2, "1000", 950);
            assert_eq!(groups_left(own, &root), Some(50), "of the highest");
            std::fs::write(
                mount.join("slice/memory.stat"),
                "inactive_file 30\ntotal_inactive_file 30\n",
            )
            .unwrap();
            assert_eq!(groups_left(own, &root), Some(80), "cached files are free");
        }
        // As a container sees it that is told of a group outside.
        group(&root.join("container"), true, "700", 0);
        assert_eq!(
            groups_left("0::/not/here\n", &root.join("container")),
            Some(700)
        );
        assert_eq!(groups_left("0::/\n", &root.join("none")), None);
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
