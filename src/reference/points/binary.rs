//! Twin of `cl/points/binary.cl`: points in a hierarchy of two children a node. The reasons are there.

use super::Search;
use crate::bounds::BOX_DISTANCE_DOWN;
use crate::math::{abs3, dot3, max_or};
use crate::options::TraceOptions;
use crate::pack::PointScene;
use crate::shared::{BVH_COUNT_SHIFT, BVH_FIRST_MASK, BVH_LEAF, BVH_NODE_RECORDS, KdNode};
use glam::Vec3;

/// The square of a distance that is no larger than that to a box.
#[inline(always)]
fn box_square(point: Vec3, middle: Vec3, half_size: Vec3) -> f32 {
    let away = abs3(point - middle) * BOX_DISTANCE_DOWN - half_size;
    let outside = Vec3::new(max_or(away.x, 0.0), max_or(away.y, 0.0), max_or(away.z, 0.0));
    dot3(outside, outside)
}

/// Goes through all leaves that may have what is looked for, nearer ones first.
#[inline(always)]
pub fn visit_triangles(scene: &PointScene, point: Vec3, search: &mut Search) {
    let nodes = scene.nodes();
    let (mut links, mut squares) =
        ([0; TraceOptions::MAX_DEPTH as usize + 1], [0.0; TraceOptions::MAX_DEPTH as usize + 1]);
    let (mut stacked, mut link) = (0, 0u32);
    loop {
        while link & BVH_LEAF == 0 {
            let first = (BVH_NODE_RECORDS * link) as usize;
            let numbers = |record: usize| bytemuck::cast::<KdNode, [f32; 4]>(nodes[first + record]);
            let (xy0, xy1, z0, z1) = (numbers(0), numbers(1), numbers(2), numbers(3));
            let square = |xy: [f32; 4], middle: f32, half_size: f32| {
                box_square(point, Vec3::new(xy[0], xy[2], middle), Vec3::new(xy[1], xy[3], half_size))
            };
            let (square0, square1) = (square(xy0, z0[2], z0[3]), square(xy1, z1[0], z1[1]));
            let (link0, link1) = (z0[0].to_bits(), z0[1].to_bits());
            let goes_to1 = square1 < square0;
            let (near, far) = if goes_to1 { (square1, square0) } else { (square0, square1) };
            if far <= search.limit {
                links[stacked] = if goes_to1 { link0 } else { link1 };
                squares[stacked] = far;
                stacked += 1;
            }
            link = match near <= search.limit {
                true if goes_to1 => link1,
                true => link0,
                false => BVH_LEAF,
            };
        }
        let first = link & BVH_FIRST_MASK;
        for i in first..first + ((link & !BVH_LEAF) >> BVH_COUNT_SHIFT) {
            let primitive = scene.references()[i as usize];
            search.take(primitive, scene.vertices(primitive).map(|corner| corner - point));
        }
        loop {
            if stacked == 0 {
                return;
            }
            stacked -= 1;
            link = links[stacked];
            if squares[stacked] <= search.limit {
                break;
            }
        }
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
        let mut random = Random::new(20_081_122);
        let mut close = 0;
        for i in 0..300_000 {
            let (middle, half_size) = (random.vec3(), random.vec3().abs() * random.size(-20, 0));
            let point = middle + random.vec3() * [0.1, 1.0, 100.0][i % 3];
            let away = (DVec3::from(point) - DVec3::from(middle)).abs() - DVec3::from(half_size);
            let exact = away.max(DVec3::ZERO).length();
            // The least distance that the box is as near as, and one that is a bit less.
            let reached = reached(exact);
            assert!(box_square(point, middle, half_size) <= limit_of(reached.max(LEAST_DISTANCE_ERROR)));
            close += usize::from(exact > 0.0 && box_square(point, middle, half_size) > limit_of(0.999 * reached));
        }
        assert!(close > 100_000, "{close}");
    }
}
