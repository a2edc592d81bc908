//! The triangles of a hierarchy while it is built: their boxes, and how lists of them are divided.

use crate::accel::clip::Reference;
use crate::accel::{Aabb, half_area};
use crate::parallel;
use glam::{Vec3, Vec4};

/// Lists of at least this many items are read and divided by all cores.
pub(super) const PARALLEL_ITEMS: usize = 1 << 15;

/// What one task reads of such a list.
pub(super) const CHUNK: usize = 1 << 13;

/// A box in two registers; the fourth components mean nothing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Bounds {
    pub low: Vec4,
    pub high: Vec4,
}

impl Bounds {
    pub const EMPTY: Bounds = Bounds { low: Vec4::INFINITY, high: Vec4::NEG_INFINITY };

    #[inline(always)]
    pub fn union(self, other: Bounds) -> Bounds {
        Bounds { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// That of [`Aabb::half_area`].
    #[inline(always)]
    pub fn half_area(&self) -> f64 {
        // One subtraction of registers, where that of an `Aabb` is three.
        half_area((self.high - self.low).truncate().to_array().map(f64::from))
    }

    /// The common part; empty, with a low coordinate above the high one, when there is none.
    #[inline(always)]
    pub fn intersection(self, other: Bounds) -> Bounds {
        Bounds { low: self.low.max(other.low), high: self.high.min(other.high) }
    }

    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.low.truncate().cmpgt(self.high.truncate()).any()
    }

    pub fn to_aabb(self) -> Aabb {
        Aabb { low: self.low.truncate(), high: self.high.truncate() }
    }
}

/// The box of a triangle or of a part of it, and in the bits of `low.w` the triangle's number ([`tag`]).
#[derive(Debug, Clone, Copy)]
pub(super) struct Item {
    low: Vec4,
    high: Vec4,
}

/// Added to triangles' numbers. By themselves the bits of small ones are subnormal floats, on which arithmetic with all
/// four components takes a hundred cycles; these are 2 and more.
const TAG: u32 = 0x4000_0000;

/// A float that keeps a triangle's number in its bits.
fn tag(triangle: u32) -> f32 {
    f32::from_bits(triangle.wrapping_add(TAG))
}

impl Item {
    pub fn new(vertices: &[Vec3; 3], triangle: u32) -> Item {
        // Adding 0 turns -0 into +0: else the sign of a zero would depend on the order of unions.
        let Aabb { low, high } = Aabb::of_triangle(vertices);
        Item { low: (low + 0.0).extend(tag(triangle)), high: (high + 0.0).extend(0.0) }
    }

    /// A part of a triangle, of which no coordinate is -0.
    pub fn of_part(part: &Reference) -> Item {
        let (low, high) = (Vec3::from_array(part.low), Vec3::from_array(part.high));
        Item { low: low.extend(tag(part.triangle)), high: high.extend(0.0) }
    }

    pub fn to_part(self) -> Reference {
        Reference {
            low: self.low.truncate().to_array(),
            high: self.high.truncate().to_array(),
            triangle: self.triangle(),
        }
    }

    #[inline(always)]
    pub fn triangle(&self) -> u32 {
        self.low.w.to_bits().wrapping_sub(TAG)
    }

    #[inline(always)]
    pub fn bounds(&self) -> Bounds {
        Bounds { low: self.low, high: self.high }
    }

    /// Halved before they are added, so that no sum overflows.
    #[inline(always)]
    pub fn centroid(&self) -> Vec4 {
        self.low * 0.5 + self.high * 0.5
    }
}

/// The boxes around some items and around their centroids.
#[derive(Debug, Clone, Copy)]
pub(super) struct Extent {
    pub bounds: Bounds,
    pub centroids: Bounds,
}

impl Extent {
    const EMPTY: Extent = Extent { bounds: Bounds::EMPTY, centroids: Bounds::EMPTY };

    /// That of `items`.
    pub fn of(items: &[Item]) -> Extent {
        if items.len() >= PARALLEL_ITEMS {
            let parts = parallel::map(items.chunks(CHUNK), Self::of_few);
            return parts.into_iter().fold(Self::EMPTY, Self::union);
        }
        Self::of_few(items)
    }

    fn of_few(items: &[Item]) -> Extent {
        items.iter().fold(Self::EMPTY, |extent, item| {
            let (bounds, centroid) = (item.bounds(), item.centroid());
            extent.union(Extent { bounds, centroids: Bounds { low: centroid, high: centroid } })
        })
    }

    #[inline(always)]
    fn union(self, other: Extent) -> Extent {
        Extent { bounds: self.bounds.union(other.bounds), centroids: self.centroids.union(other.centroids) }
    }
}

/// Brings the items that are `before` the others to the front, in any order, and returns how many these are.
pub(super) fn partition(items: &mut [Item], before: &(impl Fn(&Item) -> bool + Sync)) -> usize {
    if items.len() < PARALLEL_ITEMS {
        return partition_few(items, before);
    }
    let half = items.len() / 2;
    let (low, high) = items.split_at_mut(half);
    let (low_count, high_count) = rayon::join(|| partition(low, before), || partition(high, before));
    // Before, behind, before, behind: the two in the middle change places, as many as the shorter one has.
    let swapped = (half - low_count).min(high_count);
    low[low_count..low_count + swapped].swap_with_slice(&mut high[high_count - swapped..high_count]);
    low_count + high_count
}

fn partition_few(items: &mut [Item], before: &impl Fn(&Item) -> bool) -> usize {
    // Without branches on what `before` says, which nobody can predict (Lomuto's scheme), nor on what was just written.
    let mut count = 0;
    for i in 0..items.len() {
        let item = items[i];
        items.swap(i, count);
        count += usize::from(before(&item));
    }
    count
}

/// Brings the half with the lower centroids, along the axis on which these spread widest, to the front; of equal ones
/// those of lower triangles.
pub(super) fn halve(items: &mut [Item], extent: &Extent) -> usize {
    let spread = (extent.centroids.high - extent.centroids.low).to_array();
    let axis = (1..3).fold(0, |widest, axis| if spread[axis] > spread[widest] { axis } else { widest });
    let half = items.len() / 2;
    items.select_nth_unstable_by(half, |a, b| {
        a.centroid()[axis].total_cmp(&b.centroid()[axis]).then(a.triangle().cmp(&b.triangle()))
    });
    half
}
