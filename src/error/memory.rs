//! What is said of memory: numbers of bytes, and where a limit comes from. How it is found out, `src/budget.rs` says.

use std::fmt;

/// The most memory that the process may have, all together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct MemoryBudget {
    pub(crate) bytes: u64,
    pub(crate) origin: BudgetOrigin,
}

/// Where a [`MemoryBudget`] comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum BudgetOrigin {
    /// The caller gave it.
    Given,
    /// What the machine has available, and what the process has already.
    Machine,
    /// What the control group of the process (a container's, or a service's) has left.
    ControlGroup,
    /// What the process's limits of address space or data leave (`ulimit -v`, `ulimit -d`).
    ProcessLimit,
    /// There is none.
    Unlimited,
    /// The system refused an allocation, whatever was left by the figures.
    Refused,
}

/// Who decides how much memory something takes, and so what is at fault where that is too much.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DecidedBy {
    /// A scene, or another input.
    Input,
    /// The picture that is asked for.
    Picture,
}

impl fmt::Display for MemoryBudget {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let bytes = Bytes(self.bytes);
        match self.origin {
            BudgetOrigin::Given => write!(f, "the memory limit is {bytes}"),
            BudgetOrigin::Machine => write!(f, "{bytes} are available"),
            BudgetOrigin::ControlGroup => write!(f, "{bytes} are available to this container or service"),
            BudgetOrigin::ProcessLimit => write!(f, "the limits of the process (ulimit) leave {bytes}"),
            BudgetOrigin::Unlimited => write!(f, "there is no limit of memory"),
            BudgetOrigin::Refused => write!(f, "the system refuses that"),
        }
    }
}

/// A number of bytes as people read it: `1.5 GiB`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bytes(pub u64);

impl fmt::Display for Bytes {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        const UNITS: [&str; 4] = ["KiB", "MiB", "GiB", "TiB"];
        let mut value = self.0 as f64 / 1024.0;
        let mut unit = 0;
        while value >= 1024.0 && unit + 1 < UNITS.len() {
            value /= 1024.0;
            unit += 1;
        }
        match self.0 {
            0..1024 => write!(f, "{} bytes", self.0),
            _ => write!(f, "{value:.*} {}", if value < 10.0 { 1 } else { 0 }, UNITS[unit]),
        }
    }
}
