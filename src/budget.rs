//! How much memory may be taken: what was allowed, or what the machine, its container and the shell leave.
//!
//! What needs much memory tells how much before it takes any: an allocation that fails aborts the process, and one that
//! the system promises but does not have ends it without a word. Estimates stand where the allocation is
//! ([`crate::pack`], [`crate::io::film`], [`crate::scene`], …); the functions that check them take a [`MemoryBudget`],
//! those without one take [`MemoryBudget::available`].
//!
//! Bad at: systems without `/proc`, on which nothing is known and everything is allowed; what other processes take
//! meanwhile.

pub use crate::error::{BudgetOrigin, Bytes, DecidedBy, MemoryBudget};
use crate::error::{Error, Result};
use crate::large_pages;
use bytemuck::Zeroable;
use bytemuck::allocation::try_zeroed_vec;
use std::collections::TryReserveError;
use std::path::{Path, PathBuf};

/// `count` times `value`, or none when the system has no memory for them.
pub(crate) fn try_repeat<T: Clone>(value: T, count: usize) -> std::result::Result<Vec<T>, TryReserveError> {
    let mut values = Vec::new();
    values.try_reserve_exact(count)?;
    values.resize(count, value);
    Ok(values)
}

/// `count` zeros, all of which will be written, or none when the system has no memory for them. It gives them when they
/// are first touched: by all cores, and not by one in advance.
pub(crate) fn try_zeros<T: Zeroable>(count: usize) -> Option<Vec<T>> {
    let mut zeros = try_zeroed_vec(count).ok()?;
    large_pages::ask_for(&mut zeros);
    Some(zeros)
}

/// What takes less memory is not checked: asking the system takes as long as tracing a thousand rays.
pub(crate) const CHECKED_FROM_BYTES: u64 = 16 << 20;

/// Something that is about to take memory.
#[derive(Debug, Clone)]
pub struct Need<'a> {
    /// What it is: "a picture of 65535x65535 pixels".
    pub what: &'a str,
    /// How many bytes it takes at the most at a time, beside those that the process has.
    pub bytes: u64,
    /// What decides that.
    pub decided_by: DecidedBy,
    /// What takes less: "lower --size".
    pub remedy: &'a str,
}

impl Need<'_> {
    /// Asks the system for the bytes and gives them back, so that what it refuses, whatever the figures say, is no
    /// allocation that aborts.
    fn ask_system(&self) -> Result<()> {
        let mut bytes: Vec<u8> = Vec::new();
        let given = bytes.try_reserve_exact(usize::try_from(self.bytes).unwrap_or(usize::MAX));
        std::hint::black_box(&bytes);
        given.map_err(|_| self.refused())
    }

    /// The error that the system has no memory for this, although no budget was against it.
    pub(crate) fn refused(&self) -> Error {
        self.too_much(MemoryBudget { bytes: 0, origin: BudgetOrigin::Refused })
    }

    /// The error that this is more than `budget` has.
    pub(crate) fn too_much(&self, budget: MemoryBudget) -> Error {
        Error::OutOfMemory {
            what: self.what.to_owned(),
            needed_bytes: self.bytes.saturating_add(resident_bytes()),
            budget,
            decided_by: self.decided_by,
            remedy: self.remedy.to_owned(),
        }
    }
}

/// Of what is available a tenth is left alone: estimates may be as much too low.
const AVAILABLE_SHARE: f64 = 0.9;

/// Address space that a thread reserves beside what it uses: its stack, and an arena of glibc's allocator.
const RESERVED_BY_THREAD: u64 = (2 + 64) << 20;

impl MemoryBudget {
    /// No limit.
    pub const UNLIMITED: MemoryBudget = MemoryBudget { bytes: u64::MAX, origin: BudgetOrigin::Unlimited };

    /// A limit of so many bytes.
    pub fn of_bytes(bytes: u64) -> MemoryBudget {
        MemoryBudget { bytes, origin: BudgetOrigin::Given }
    }

    /// What the process has, and nine tenths of what it can still get: the least of what the machine has available, of
    /// what its control group has left, and of what `ulimit` leaves. Without limit where the system does not tell.
    pub fn available() -> MemoryBudget {
        System { root: Path::new("/") }.available()
    }

    /// The limit in bytes.
    pub fn bytes(&self) -> u64 {
        self.bytes
    }

    /// Where the limit comes from.
    pub fn origin(&self) -> BudgetOrigin {
        self.origin
    }

    /// The bytes that the process may still take.
    pub fn left(&self) -> u64 {
        match self.origin {
            BudgetOrigin::Unlimited => u64::MAX,
            _ => self.bytes.saturating_sub(resident_bytes()),
        }
    }

    /// Checks that `need` can be met beside what the process has already, and that the system would give so much.
    ///
    /// # Errors
    /// [`Error::OutOfMemory`].
    pub fn check(&self, need: &Need) -> Result<()> {
        if self.origin == BudgetOrigin::Unlimited {
            return Ok(());
        }
        let needed_bytes = need.bytes.saturating_add(resident_bytes());
        if needed_bytes <= self.bytes {
            return need.ask_system();
        }
        Err(need.too_much(*self))
    }
}

impl Default for MemoryBudget {
    /// [`MemoryBudget::available`].
    fn default() -> Self {
        Self::available()
    }
}

/// Bytes of memory that the process has; 0 where the system does not tell.
fn resident_bytes() -> u64 {
    System { root: Path::new("/") }.resident().unwrap_or(0)
}

/// The files in which Linux tells what there is, below a folder that tests can make.
struct System<'a> {
    root: &'a Path,
}

impl System<'_> {
    fn text(&self, path: impl AsRef<Path>) -> Option<String> {
        std::fs::read_to_string(self.root.join(path)).ok()
    }

    /// The number behind `key` in a file of lines.
    fn number(&self, path: impl AsRef<Path>, key: &str) -> Option<u64> {
        let text = self.text(path)?;
        let rest =
            text.lines().find_map(|line| line.strip_prefix(key).filter(|rest| rest.starts_with([' ', '\t', ':'])));
        rest?.trim_start_matches(':').split_whitespace().next()?.parse().ok()
    }

    /// Bytes of memory that the process has.
    fn resident(&self) -> Option<u64> {
        self.number("proc/self/status", "VmRSS").map(|kib| kib << 10)
    }

    fn available(&self) -> MemoryBudget {
        let resident = self.resident().unwrap_or(0);
        let machine = self.number("proc/meminfo", "MemAvailable").map(|kib| (kib << 10, BudgetOrigin::Machine));
        let group = self.left_in_group().map(|bytes| (bytes, BudgetOrigin::ControlGroup));
        let process = self.left_by_limits().map(|bytes| (bytes, BudgetOrigin::ProcessLimit));
        match [machine, group, process].into_iter().flatten().min_by_key(|(left, _)| *left) {
            Some((left, origin)) => {
                MemoryBudget { bytes: resident.saturating_add((left as f64 * AVAILABLE_SHARE) as u64), origin }
            }
            None => MemoryBudget::UNLIMITED,
        }
    }

    /// What `ulimit -v` and `ulimit -d` leave.
    fn left_by_limits(&self) -> Option<u64> {
        let limits = self.text("proc/self/limits")?;
        let soft = |name: &str| -> Option<u64> {
            let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
            line.split_whitespace().next()?.parse().ok()
        };
        let status = |key: &str| self.number("proc/self/status", key).map_or(0, |kib| kib << 10);
        let space = soft("Max address space").map(|limit| {
            let left = limit.saturating_sub(status("VmSize"));
            let threads = std::thread::available_parallelism().map_or(1, usize::from) as u64;
            // Threads do without arenas of their own where there is no room for them.
            left - (threads * RESERVED_BY_THREAD).min(left / 4)
        });
        let data = soft("Max data size").map(|limit| limit.saturating_sub(status("VmData")));
        space.into_iter().chain(data).min()
    }

    /// The least that is left in the process's control group and those above it, of either version.
    fn left_in_group(&self) -> Option<u64> {
        let groups = self.text("proc/self/cgroup")?;
        let left = |line: &str| {
            let (controllers, path) = line.split_once(':')?.1.split_once(':')?;
            let (mount, files) = match controllers {
                "" => ("sys/fs/cgroup", ["memory.max", "memory.current", "inactive_file"]),
                _ if controllers.split(',').any(|name| name == "memory") => {
                    ("sys/fs/cgroup/memory", ["memory.limit_in_bytes", "memory.usage_in_bytes", "total_inactive_file"])
                }
                _ => return None,
            };
            // In a container the path may be that of the host; its own group is then the root.
            let inside = Path::new(path.trim_start_matches('/'));
            inside.ancestors().filter_map(|group| self.left_in(&Path::new(mount).join(group), files)).min()
        };
        groups.lines().filter_map(left).min()
    }

    fn left_in(&self, group: &Path, [limit, usage, reclaimable]: [&str; 3]) -> Option<u64> {
        let number = |file: &str| -> Option<u64> { self.text(group.join(file))?.trim().parse().ok() };
        let (limit, usage) = (number(limit)?, number(usage)?);
        // Pages of files that nobody uses go first when memory is short.
        let statistics: PathBuf = group.join("memory.stat");
        Some(limit.saturating_sub(usage.saturating_sub(self.number(statistics, reclaimable).unwrap_or(0))))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A machine of files.
    fn machine(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        root
    }

    const STATUS: (&str, &str) = ("proc/self/status", "VmSize:\t 2048 kB\nVmData:\t 512 kB\nVmRSS:\t 1024 kB\n");
    const MEMORY: (&str, &str) = ("proc/meminfo", "MemTotal: 9000000 kB\nMemAvailable: 1000000 kB\n");
    const LIMITS: &str = "Limit Soft Limit Hard Limit Units\nMax address space         unlimited unlimited bytes\n";

    #[track_caller]
    fn expect(files: &[(&str, &str)], left: u64, origin: BudgetOrigin) {
        let root = machine(files);
        let budget = System { root: root.path() }.available();
        assert_eq!(budget, MemoryBudget { bytes: (1 << 20) + (left as f64 * AVAILABLE_SHARE) as u64, origin });
    }

    #[test]
    fn the_least_of_all_limits_counts() {
        expect(&[STATUS, MEMORY], 1_000_000 << 10, BudgetOrigin::Machine);
        expect(&[STATUS, MEMORY, ("proc/self/limits", LIMITS)], 1_000_000 << 10, BudgetOrigin::Machine);
        let data = "Max data size  104857600 unlimited bytes\n";
        expect(&[STATUS, MEMORY, ("proc/self/limits", data)], 104_857_600 - (512 << 10), BudgetOrigin::ProcessLimit);
        let second = [
            ("proc/self/cgroup", "0::/a/b\n"),
            ("sys/fs/cgroup/a/memory.max", "400000000\n"),
            ("sys/fs/cgroup/a/memory.current", "150000000\n"),
            ("sys/fs/cgroup/a/memory.stat", "anon 1\ninactive_file 50000000\n"),
            ("sys/fs/cgroup/a/b/memory.max", "max\n"),
            ("sys/fs/cgroup/a/b/memory.current", "1000\n"),
        ];
        expect(&[&[STATUS, MEMORY], &second[..]].concat(), 300_000_000, BudgetOrigin::ControlGroup);
        let first = [
            ("proc/self/cgroup", "3:cpu,cpuacct:/\n2:memory:/docker/of-the-host\n"),
            ("sys/fs/cgroup/memory/memory.limit_in_bytes", "200000000\n"),
            ("sys/fs/cgroup/memory/memory.usage_in_bytes", "50000000\n"),
        ];
        expect(&[&[STATUS, MEMORY], &first[..]].concat(), 150_000_000, BudgetOrigin::ControlGroup);
    }

    #[test]
    fn address_space_is_left_to_threads_but_never_all_of_it() {
        let root = machine(&[STATUS, ("proc/self/limits", "Max address space  204800000 unlimited bytes\n")]);
        let budget = System { root: root.path() }.available();
        let left = (204_800_000 - (2 << 20)) as f64 * AVAILABLE_SHARE;
        assert_eq!(budget.origin(), BudgetOrigin::ProcessLimit);
        assert!((0.75 * left..left).contains(&(budget.bytes() as f64 - f64::from(1 << 20) + 1.0)), "{budget:?}");
    }

    #[test]
    fn without_any_file_everything_is_allowed() {
        let budget = System { root: machine(&[]).path() }.available();
        assert_eq!(budget, MemoryBudget::UNLIMITED);
        let need = Need { what: "all", bytes: u64::MAX, decided_by: DecidedBy::Input, remedy: "" };
        budget.check(&need).unwrap();
    }

    #[test]
    fn what_does_not_fit_is_told_with_its_numbers() {
        let all = Need { what: "all", bytes: 1 << 62, decided_by: DecidedBy::Input, remedy: "take less" };
        let refused = MemoryBudget::of_bytes(u64::MAX).check(&all).unwrap_err().to_string();
        assert!(refused.ends_with("but the system refuses that; take less"), "{refused}");
        let need = |decided_by| Need { what: "a mesh", bytes: 3 << 30, decided_by, remedy: "lower its segments" };
        MemoryBudget::of_bytes(1 << 40).check(&need(DecidedBy::Input)).unwrap();
        for (decided_by, code) in [(DecidedBy::Input, 3), (DecidedBy::Picture, 4)] {
            let error = MemoryBudget::of_bytes(2 << 30).check(&need(decided_by)).unwrap_err();
            let text = error.to_string();
            assert!(text.starts_with("a mesh takes the process to about 3."), "{text}");
            assert!(text.ends_with("but the memory limit is 2.0 GiB; lower its segments"), "{text}");
            assert_eq!(error.exit_code(), code);
        }
    }

    #[test]
    fn bytes_are_readable() {
        for (bytes, text) in [(17, "17 bytes"), (1536, "1.5 KiB"), (300 << 20, "300 MiB"), (u64::MAX, "16777216 TiB")] {
            assert_eq!(Bytes(bytes).to_string(), text);
        }
    }
}
