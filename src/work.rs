//! Counted work: what tracing took, apart from time. Havran (PhD thesis, 2000) and Horn et al. (I3D 2007) compare
//! methods so.
//!
//! Kernels built with `COUNT_WORK` and the twin count the same; [`WorkCounter`] says what. A ray's or a pixel's count
//! that outgrows 32 bits stays at [`u32::MAX`]; sums of many are [`WorkSum`]s of 64 bits.
//!
//! Bad at: telling what the cache did. Bytes are what a traversal asked for.

use crate::shared::{WORK_COUNTERS, WorkCounter};
use bytemuck::{Pod, Zeroable};
use serde::ser::{Serialize, SerializeMap, SerializeStruct, Serializer};

/// The work on one ray, or on some rays of one pixel; as the kernels store it.
#[repr(transparent)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct RayWork([u32; WORK_COUNTERS]);

impl RayWork {
    /// The count of one counter.
    pub fn get(&self, counter: WorkCounter) -> u32 {
        self.0[counter as usize]
    }

    /// Counts `n` more, up to the largest number; of a maximum, raises it to `n`.
    #[inline(always)]
    pub fn count(&mut self, counter: WorkCounter, n: u32) {
        let sum = &mut self.0[counter as usize];
        *sum = if counter.is_maximum() { n.max(*sum) } else { sum.saturating_add(n) };
    }

    /// Counts the work on other rays, too.
    pub fn add(&mut self, other: &RayWork) {
        for &counter in WorkCounter::ALL {
            self.count(counter, other.get(counter));
        }
    }

    /// Whether some count stands at the largest number: what there was may have been more.
    pub fn is_saturated(&self) -> bool {
        self.0.contains(&u32::MAX)
    }
}

/// The work on all rays of one pixel.
#[repr(C)]
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Pod, Zeroable)]
pub struct PixelWork {
    /// On its camera rays.
    pub camera: RayWork,
    /// On its shadow, reflected and refracted rays.
    pub secondary: RayWork,
}

impl PixelWork {
    /// Adds the work on other rays of the pixel.
    pub fn add(&mut self, other: &PixelWork) {
        self.camera.add(&other.camera);
        self.secondary.add(&other.secondary);
    }

    /// On all of them.
    pub fn total(&self) -> RayWork {
        let mut total = self.camera;
        total.add(&self.secondary);
        total
    }
}

/// The work on many rays.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct WorkSum {
    /// How many rays.
    pub rays: u64,
    sums: [u64; WORK_COUNTERS],
    /// How many of the counts that were added had outgrown 32 bits: with any, the sums are too small.
    pub saturated: u64,
}

impl WorkSum {
    /// Sums the work on `rays` rays.
    pub fn new(rays: u64, all: impl IntoIterator<Item = RayWork>) -> Self {
        let mut sum = WorkSum { rays, ..WorkSum::default() };
        for work in all {
            for &counter in WorkCounter::ALL {
                let (sum, n) = (&mut sum.sums[counter as usize], u64::from(work.get(counter)));
                *sum = if counter.is_maximum() { n.max(*sum) } else { *sum + n };
            }
            sum.saturated += u64::from(work.is_saturated());
        }
        sum
    }

    /// The sum, or the maximum, of one counter.
    pub fn get(&self, counter: WorkCounter) -> u64 {
        self.sums[counter as usize]
    }

    /// The sum a ray; 0 without rays.
    pub fn mean(&self, counter: WorkCounter) -> f64 {
        self.get(counter) as f64 / self.rays.max(1) as f64
    }
}

/// Some counters that are sums, as a map by their keys.
struct ByCounter<F>(F);

impl<T: Serialize, F: Fn(WorkCounter) -> T> Serialize for ByCounter<F> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        for &counter in WorkCounter::ALL.iter().filter(|c| !c.is_maximum()) {
            map.serialize_entry(&counter.key(), &self.0(counter))?;
        }
        map.end()
    }
}

impl Serialize for WorkSum {
    /// `rays`, `sum` and `mean` (a ray) by counter, `deepest_stack`, and, unless it is 0, `saturated`.
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut out = serializer.serialize_struct("WorkSum", 5)?;
        out.serialize_field("rays", &self.rays)?;
        out.serialize_field("sum", &ByCounter(|counter| self.get(counter)))?;
        out.serialize_field("mean", &ByCounter(|counter| self.mean(counter)))?;
        out.serialize_field("deepest_stack", &self.get(WorkCounter::DeepestStack))?;
        match self.saturated {
            0 => out.skip_field("saturated")?,
            _ => out.serialize_field("saturated", &self.saturated)?,
        }
        out.end()
    }
}
