//! Items that the first pass defers to the second one.

use super::{Buffer, DeviceContext};
use crate::error::Result;
use std::cell::Cell;

/// The items that the first pass defers, and how many there were in all.
pub(super) struct Deferred {
    /// Their number, then which.
    pub items: Buffer<u32>,
    resolved: Cell<Option<u64>>,
}

impl Deferred {
    /// Room for `count` items, if any can be deferred.
    pub fn new(context: &DeviceContext, defers: bool, count: usize) -> Result<Self> {
        let items = Buffer::empty(context, "deferred items", if defers { count + 1 } else { 1 })?;
        items.write(&[0])?;
        Ok(Deferred { items, resolved: Cell::new(defers.then_some(0)) })
    }

    /// How many items took the second pass; `None` when there was none to take.
    pub fn resolved(&self) -> Option<u64> {
        self.resolved.get()
    }

    /// How many items are deferred now, which counts them.
    pub fn take_count(&self) -> Result<usize> {
        let mut count = [0];
        self.items.read_into(0, &mut count)?;
        self.resolved.set(self.resolved.get().map(|n| n + u64::from(count[0])));
        Ok(count[0] as usize)
    }
}
