//! Twin of `cl/points/wide.cl`: points in a hierarchy of eight children a node, one box and one triangle after the
//! other. The reasons are there.

use super::Search;
use crate::accel::leaf_range;
use crate::layout::Float4;
use crate::math::{dot3, max_or};
use crate::pack::PointScene;
use crate::reference::traverse::wide_stack::{WIDTH, WideStack};
use crate::shared::{BVH_LEAF, BVH8_LINKS, BVH8_NODE_RECORDS, BVH8_PACKET_RECORDS};
use glam::Vec3;

/// The square of a distance that is no larger than that to a child's box.
#[inline(always)]
fn box_square(node: &[u32], lane: usize, point: Vec3) -> f32 {
    let plane = |axis: usize, high: usize| f32::from_bits(node[WIDTH * (2 * axis + high) + lane]);
    let outside = |axis: usize| max_or(max_or(plane(axis, 0) - point[axis], point[axis] - plane(axis, 1)), 0.0);
    let outside = Vec3::new(outside(0), outside(1), outside(2));
    dot3(outside, outside)
}

/// A triangle of a packet, from the point as the origin.
#[inline(always)]
fn corners_from(packet: &[Float4], lane: usize, point: Vec3) -> [Vec3; 3] {
    let numbers: &[f32] = bytemuck::cast_slice(packet);
    let corner = |i: usize| Vec3::from_array([0, 1, 2].map(|axis| numbers[WIDTH * (3 * i + axis) + lane]));
    [0, 1, 2].map(|i| corner(i) - point)
}

/// As `visit_triangles` of `binary.rs`.
#[inline(always)]
pub fn visit_triangles(scene: &PointScene, point: Vec3, search: &mut Search) {
    let words: &[u32] = bytemuck::cast_slice(scene.nodes());
    let node_words = 4 * BVH8_NODE_RECORDS as usize;
    let mut stack = WideStack::new(scene.stack_entries());
    let mut link = 0u32;
    loop {
        if link & BVH_LEAF == 0 {
            let node = &words[node_words * link as usize..][..node_words];
            let met = (0..WIDTH).map(|lane| (lane, box_square(node, lane, point)));
            stack.push(link, met.filter(|(_, square)| *square <= search.limit), search.list.is_some());
        } else {
            let references = leaf_range(link).expect("it is no inner node");
            let records = BVH8_PACKET_RECORDS as usize;
            let packet = scene.triangles().get(references.start / WIDTH * records..).unwrap_or_default();
            for (lane, reference) in references.enumerate() {
                search.take(scene.references()[reference], corners_from(packet, lane, point));
            }
        }
        let Some((node, lane)) = stack.next(search.limit) else { return };
        link = words[node_words * node as usize + 4 * BVH8_LINKS as usize + lane];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::LEAST_DISTANCE_ERROR;
    use crate::random::Random;
    use crate::reference::points::distance::limit_of;
    use crate::reference::points::reached;
    use glam::DVec3;

    #[test]
    fn boxes_are_not_left_out_too_early() {
        let mut random = Random::new(20_081_124);
        let mut close = 0;
        for i in 0..300_000 {
            let (low, size) = (random.vec3(), random.vec3().abs() * random.size(-20, 0));
            let high = low + size;
            let point = low + random.vec3() * [0.1, 1.0, 100.0][i % 3];
            let mut node = [0; WIDTH * 6];
            for axis in 0..3 {
                node[WIDTH * 2 * axis + i % WIDTH] = low[axis].to_bits();
                node[WIDTH * (2 * axis + 1) + i % WIDTH] = high[axis].to_bits();
            }
            let [low, high, at] = [low, high, point].map(DVec3::from);
            let exact = (low - at).max(at - high).max(DVec3::ZERO).length();
            // The least distance that the box is as near as, and one that is a bit less.
            let reached = reached(exact);
            let square = box_square(&node, i % WIDTH, point);
            assert!(square <= limit_of(reached.max(LEAST_DISTANCE_ERROR)));
            close += usize::from(exact > 0.0 && square > limit_of(0.999 * reached));
        }
        assert!(close > 100_000, "{close}");
    }
}
