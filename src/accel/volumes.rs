//! Bounding volumes: a flat list of clusters of triangles, each in a box or a sphere (thesis, section 2.2.2).
//!
//! Clusters come from halving the triangles at the median of their centroids along the axis on which these spread
//! widest, until no half is larger than asked for: by default the square root of the number of triangles, where the
//! tests of the volumes cost about as much as those of the triangles in one of them. The scene's own objects would be
//! as good a choice, but a file need not have any.
//!
//! Bad at: large scenes; every ray meets the whole list.

use super::near::few_outside;
use super::{Aabb, Padding, StructureArrays};
use crate::layout::Float4;
use crate::shared::KdNode;
use glam::{DVec3, Vec3};

/// The least default: a volume around fewer triangles costs more than it saves.
const SMALLEST_CLUSTER: f64 = 4.0;

/// By how much a sphere that reaches far out is larger than what it holds, in units of a box's padding. The slack of
/// spheres is 2.4 times that of boxes; it is for the radius and again for the times of entry and exit, which move by no
/// less than the radius grows by over the length of a direction, of up to 3.5: 2.4 (1 + 3.5) = 10.8, and some for
/// roundings.
const SPHERE_PADDING: f32 = 16.0;

/// Boxes around clusters of at most `cluster_size` triangles; `primitives` are indices into `vertices`. Boxes that
/// reach beyond `near_reach`, which is that of [`near_reach`](super::near_reach), are larger by what the slack of rays
/// from within leaves out.
pub fn build_boxes(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    cluster_size: Option<u32>,
    near_reach: f32,
) -> StructureArrays {
    let padding = Padding { everywhere: 0.0, near_reach };
    build(vertices, primitives, cluster_size, near_reach, |cluster, bounds| {
        let around = padding.around(bounds_of(vertices, cluster));
        bounds.extend([Float4::new(around.low, 0.0), Float4::new(around.high, 0.0)]);
    })
}

/// Spheres around clusters of at most `cluster_size` triangles. A sphere's centre is that of the box, its radius the
/// distance of the farthest vertex, rounded up. `near_reach` as for [`build_boxes`].
pub fn build_spheres(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    cluster_size: Option<u32>,
    near_reach: f32,
) -> StructureArrays {
    let padding = Padding { everywhere: 0.0, near_reach };
    build(vertices, primitives, cluster_size, near_reach, |cluster, bounds| {
        let around = bounds_of(vertices, cluster);
        let centre = (around.low * 0.5 + around.high * 0.5).clamp(around.low, around.high);
        let distance = |p: &Vec3| (p.as_dvec3() - DVec3::from(centre)).length();
        let farthest = cluster.iter().flat_map(|&i| &vertices[i as usize]).map(distance).fold(0.0, f64::max);
        // Twice up: to float32, and for the roundings of f64, which are smaller than a step of float32.
        let radius = (farthest as f32).next_up().next_up();
        let padding = SPHERE_PADDING * padding.of(&around);
        bounds.push(Float4::new(centre, if padding > 0.0 { (radius + padding).next_up() } else { radius }));
    })
}

/// Triangles of a cluster, unless something else is asked for.
pub(super) fn cluster_size(triangle_count: usize) -> u32 {
    (triangle_count as f64).sqrt().max(SMALLEST_CLUSTER) as u32
}

fn bounds_of(vertices: &[[Vec3; 3]], primitives: &[u32]) -> Aabb {
    let triangle = |&i: &u32| Aabb::of_triangle(&vertices[i as usize]);
    primitives.iter().map(triangle).fold(Aabb::EMPTY, Aabb::union)
}

fn build(
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    cluster_size: Option<u32>,
    near_reach: f32,
    push_bounds: impl Fn(&[u32], &mut Vec<Float4>),
) -> StructureArrays {
    let size = cluster_size.unwrap_or_else(|| self::cluster_size(primitives.len())).max(1) as usize;
    // What reaches very far out shares no cluster with anything else.
    let (outside, inside) = few_outside(vertices, primitives, near_reach)
        .map_or_else(|| (Vec::new(), primitives.to_vec()), |(outside, inside, _)| (outside, inside));
    let mut references = [&outside[..], &inside].concat();
    let mut structure =
        StructureArrays { nodes: vec![KdNode { left: 1, ..KdNode::default() }], references: vec![], bounds: vec![] };
    // Ranges of `references` that are still to be halved or taken, the first one last.
    let mut open = vec![(outside.len(), references.len()), (0, outside.len())];
    while let Some((start, end)) = open.pop() {
        let part = &mut references[start..end];
        if part.is_empty() {
            continue;
        }
        if part.len() > size {
            let half = part.len() / 2;
            halve(vertices, part, half);
            open.push((start + half, end));
            open.push((start, start + half));
            continue;
        }
        part.sort_unstable();
        push_bounds(part, &mut structure.bounds);
        structure.nodes.push(StructureArrays::leaf(start, end));
    }
    structure.nodes[0].right = structure.nodes.len() as u32 - 1;
    structure.references = references;
    structure
}

/// Puts the `half` triangles with the lower centroids, along the axis on which the centroids spread widest, in front.
fn halve(vertices: &[[Vec3; 3]], part: &mut [u32], half: usize) {
    let centroid = |i: u32| vertices[i as usize].iter().map(|p| p.as_dvec3()).sum::<DVec3>();
    let spread = |axis: usize| {
        let (low, high) = part.iter().fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &i| {
            let c = centroid(i)[axis];
            (low.min(c), high.max(c))
        });
        high - low
    };
    let spreads = [spread(0), spread(1), spread(2)];
    let axis = (0..3).fold(0, |widest, axis| if spreads[axis] > spreads[widest] { axis } else { widest });
    part.select_nth_unstable_by(half, |&a, &b| centroid(a)[axis].total_cmp(&centroid(b)[axis]).then(a.cmp(&b)));
}
