//! Scenes of which a few triangles lie very much farther out than most: a vertex at -1e38 by mistake, a backdrop among
//! buttons.
//!
//! Structures are larger than what they hold by what rounding may be off, and that grows with the distance of the
//! farthest corner: so one far vertex makes all boxes alike, and a grid's or an octree's cells hold everything else at
//! once. Here it is told how far most triangles reach. Hierarchies and lists of boxes make only those boxes larger that
//! reach beyond, by what these need (`padding_distance` in `cl/shared/slab.cl`), and others test the few triangles that
//! reach beyond for every ray.
//!
//! Bad at: rays that start farther out, for which all is as large as before; scenes whose scales are many, of which it
//! sees one.

use super::Aabb;
use crate::bounds::SLACK;
use crate::options::{Intersector, StructureKind, TraceOptions};
use glam::Vec3;

/// Scenes of fewer triangles are not looked at: those are soon tested.
const FEWEST: usize = 64;

/// What most triangles reach is so many times what half of them do: cameras and lights are about as far away.
const REACH_OF_MOST: f32 = 16.0;

/// How much farther the farthest one must reach: there the padding of its distance is a hundredth of what most
/// triangles reach, and less cost less than it would to tell them apart.
const MUCH_FARTHER: f32 = 4096.0;

/// A structure tests this part of its triangles for every ray, at most.
const FEW: usize = 16;

/// How far from 0 a triangle reaches on any axis.
fn reach_of(triangle: &[Vec3; 3]) -> f32 {
    let Aabb { low, high } = Aabb::of_triangle(triangle);
    low.abs().max(high.abs()).max_element()
}

/// The least reach with the exact test and slabs: their paddings are still normal numbers, and larger than what
/// underflows (`LEAST_PADDING`).
const LEAST: f32 = 1.0 / (1u128 << 100) as f32;

/// That with a rounded test, whose products of two differences must not underflow.
const LEAST_ROUNDED: f32 = 1.0 / (1u64 << 40) as f32;

/// That of spheres, the squares of whose slack, 2^-16 of the reach, must not underflow.
const LEAST_SPHERES: f32 = 1.0 / (1u64 << 32) as f32;

/// How far from 0 most of the triangles `primitives` reach, where the farthest one reaches very much farther and the
/// structure of `options` can make use of that; else 0.
pub fn near_reach(vertices: &[[Vec3; 3]], primitives: &[u32], options: &TraceOptions) -> f32 {
    let least = match (options.kind(), options.intersector) {
        // A kd-tree's planes are as sure as they are near; the others are of all triangles, or of objects in places of
        // their own.
        (StructureKind::Brute | StructureKind::Kd | StructureKind::Instances, _) => return 0.0,
        (StructureKind::Spheres, _) => LEAST_SPHERES,
        (_, Intersector::Exact) => LEAST,
        _ => LEAST_ROUNDED,
    };
    if primitives.len() < FEWEST {
        return 0.0;
    }
    let mut reaches: Vec<f32> = primitives.iter().map(|&i| reach_of(&vertices[i as usize])).collect();
    let farthest = reaches.iter().copied().fold(0.0, f32::max);
    let middle = reaches.len() / 2;
    let (_, &mut median, _) = reaches.select_nth_unstable_by(middle, f32::total_cmp);
    let reach = REACH_OF_MOST * median;
    if reach >= least && farthest > MUCH_FARTHER * reach { reach } else { 0.0 }
}

/// The triangles that reach beyond `near_reach`, the others, and the box around these, where the first are few; `None`
/// where they are many, or there is no such reach.
pub(super) fn few_outside(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    near_reach: f32,
) -> Option<(Vec<u32>, Vec<u32>, Aabb)> {
    if near_reach == 0.0 {
        return None;
    }
    let is_outside = |&i: &u32| reach_of(&vertices[i as usize]) > near_reach;
    let (outside, inside): (Vec<u32>, Vec<u32>) = primitives.iter().copied().partition(is_outside);
    let bounds = inside.iter().map(|&i| Aabb::of_triangle(&vertices[i as usize])).fold(Aabb::EMPTY, Aabb::union);
    (outside.len() <= primitives.len() / FEW).then_some((outside, inside, bounds))
}

/// By how much boxes are made larger than what they hold.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Padding {
    /// All of them.
    pub everywhere: f32,
    /// That of [`near_reach`]: what reaches beyond gets more.
    pub near_reach: f32,
}

impl From<f32> for Padding {
    /// The same padding for all boxes.
    fn from(everywhere: f32) -> Padding {
        Padding { everywhere, near_reach: 0.0 }
    }
}

impl Padding {
    /// That of a box: for rays that start within the reach, whose padding is for what is within it, too.
    pub fn of(&self, bounds: &Aabb) -> f32 {
        let reach = bounds.low.abs().max(bounds.high.abs()).max_element();
        if self.near_reach == 0.0 || reach <= self.near_reach {
            return self.everywhere;
        }
        // The sum of two roundings up: no less than the exact one.
        (SLACK * (reach + self.near_reach)).next_up().next_up() + self.everywhere
    }

    /// The box with its padding.
    pub(super) fn around(&self, bounds: Aabb) -> Aabb {
        match self.of(&bounds) {
            0.0 => bounds,
            padding => Aabb {
                low: (bounds.low - padding).map(f32::next_down),
                high: (bounds.high + padding).map(f32::next_up),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::Structure;
    use crate::random::Random;

    const OPTIONS: TraceOptions = TraceOptions::of(StructureKind::Grid);

    fn soup(count: usize) -> Vec<[Vec3; 3]> {
        let mut random = Random::new(20_081_121);
        (0..count)
            .map(|_| {
                let at = random.vec3();
                [at, at + 0.01 * random.vec3(), at + 0.01 * random.vec3()]
            })
            .collect()
    }

    #[test]
    fn only_what_lies_very_far_out_is_told_apart() {
        let mut triangles = soup(1000);
        let all: Vec<u32> = (0..1000).collect();
        assert_eq!(near_reach(&triangles, &all, &OPTIONS), 0.0);
        triangles[3][1].x = -1e4;
        assert_eq!(near_reach(&triangles, &all, &OPTIONS), 0.0);
        for far in [1e6, 1e38] {
            triangles[3][1].x = -far;
            let reach = near_reach(&triangles, &all, &OPTIONS);
            assert!(reach > 4.0 && reach < 17.0, "{reach}");
            let (outside, inside, bounds) = few_outside(&triangles, &all, reach).unwrap();
            assert!(outside == [3] && inside.len() == 999 && bounds.low.x > -1.1);
        }
        assert_eq!(near_reach(&triangles, &all[..FEWEST - 1], &OPTIONS), 0.0);
        // Where what float32 leaves out would count, nothing is.
        let least = |accel, intersector| {
            let small = triangles.iter().map(|triangle| triangle.map(|p| p * 2f32.powi(-70))).collect::<Vec<_>>();
            near_reach(&small, &all, &TraceOptions { structure: Structure::of(accel), intersector, ..OPTIONS })
        };
        assert!(least(StructureKind::Bvh2, Intersector::Exact) > 0.0);
        assert_eq!(
            least(StructureKind::Bvh2, Intersector::Watertight) + least(StructureKind::Spheres, Intersector::Exact),
            0.0
        );
        // As many as this are the scene, too.
        (0..100).for_each(|i| triangles[i][0].z = 1e9);
        assert!(few_outside(&triangles, &all, near_reach(&triangles, &all, &OPTIONS)).is_none());
    }

    #[test]
    fn boxes_that_reach_far_out_have_padding_for_themselves() {
        let padding = Padding { everywhere: 1e-6, near_reach: 16.0 };
        let cube = |side: f32| Aabb { low: Vec3::splat(-side), high: Vec3::splat(side) };
        assert_eq!(padding.of(&cube(16.0)), 1e-6);
        assert!(padding.of(&cube(1e10)) >= SLACK * 1e10 && padding.of(&cube(1e10)) < 2.0 * SLACK * 1e10);
        assert_eq!(Padding::from(0.0).around(cube(1e20)), cube(1e20));
        let around = padding.around(cube(1e20));
        assert!(around.high.x > 1e20 * (1.0 + SLACK) && around.low.x < -1e20 * (1.0 + SLACK));
    }
}
