//! Generalised winding numbers: how often a surface winds around a point, also where it is open or in disorder. 1
//! inside of a closed mesh whose triangles are turned outwards, 0 outside, something between near the holes of an open
//! one.
//!
//! Jacobson, Kavan and Sorkine-Hornung, "Robust Inside-Outside Segmentation using Generalized Winding Numbers",
//! SIGGRAPH 2013. The number is the sum of the solid angles of all triangles over that of a whole sphere; each by van
//! Oosterom and Strackee, "The Solid Angle of a Plane Triangle", IEEE Transactions on Biomedical Engineering 30(2),
//! 1983. Whoever is outside of a box around some of the triangles sees them under the same angle as any other surface
//! with the same border within the box, such as a fan over that border, which mostly has far fewer triangles (the
//! paper's section 4). This is no approximation: only f64 rounds. On which side of each triangle a point is, is decided
//! exactly (`robust`); a point in a triangle's plane sees it under no angle, so that one on a face is half inside.
//!
//! All is done on the host, in f64, which not every device has. Bad at: triangles that share no vertices, whose borders
//! are as long as they are many; millions of points, which devices would answer faster.

use crate::accel::{Aabb, BuildOptions, Bvh, build_bvh};
use crate::budget::MemoryBudget;
use crate::error::Result;
use crate::options::{BvhOptions, StructureKind};
use crate::pack::{SceneBuffers, check_point_memory};
use crate::parallel;
use glam::{DVec3, Vec3};
use robust::Coord3D;
use std::collections::HashMap;
use std::f64::consts::TAU;
use std::ops::Range;

/// Edges, each from the lower number to the higher one, and how often they are there; negative: the other way round.
type Border = HashMap<[u32; 2], i32>;

/// A hierarchy over the triangles of a scene, with fans over the borders of its parts.
#[derive(Debug)]
pub struct WindingTree {
    tree: Bvh,
    /// Boxes are world units times this.
    scale: f32,
    /// Every position once, world units.
    positions: Vec<DVec3>,
    /// Positions of each triangle of the tree's order.
    triangles: Vec<[u32; 3]>,
    /// Where in `fans` that of each node is; `None` where it is no smaller than what it stands for.
    fan_of: Vec<Option<Range<usize>>>,
    /// Triangles, and how often each counts.
    fans: Vec<([u32; 3], i32)>,
}

impl WindingTree {
    /// Of the triangles of a scene that have an area.
    ///
    /// # Errors
    /// [`OutOfMemory`](crate::Error::OutOfMemory) when it takes more memory than `budget` has;
    /// [`Scene`](crate::Error::Scene) when there are too many triangles.
    pub fn new(buffers: &SceneBuffers, budget: &MemoryBudget) -> Result<WindingTree> {
        check_point_memory("winding numbers", buffers.triangle_count(), budget)?;
        let scale = buffers.params.scale;
        let given = parallel::map_numbers(buffers.triangle_count(), |i| buffers.given_triangle(i as u32));
        let has_area = |&i: &u32| {
            let [a, b, c] = given[i as usize];
            a.is_finite() && b.is_finite() && c.is_finite() && a != b && b != c && c != a
        };
        let all: Vec<u32> = (0..given.len() as u32).filter(has_area).collect();
        let scaled = parallel::map_slice(&given, |triangle| triangle.map(|p| p * scale));
        let tree = build_bvh(&scaled, &all, &BuildOptions::bvh(&BvhOptions::DEFAULT, StructureKind::Bvh2))?;
        let mut numbers = HashMap::new();
        let mut positions = Vec::new();
        let mut number = |p: Vec3| {
            *numbers.entry((p + Vec3::ZERO).to_array().map(f32::to_bits)).or_insert_with(|| {
                positions.push(DVec3::from(p));
                positions.len() as u32 - 1
            })
        };
        let triangles = tree.order.iter().map(|&i| given[i as usize].map(&mut number)).collect();
        let mut winding =
            WindingTree { fan_of: vec![None; tree.nodes.len()], tree, scale, positions, triangles, fans: Vec::new() };
        winding.close_borders();
        Ok(winding)
    }

    /// Makes the fans of all nodes, from the leaves up.
    fn close_borders(&mut self) {
        let mut open: Vec<(Border, usize)> = (0..self.tree.nodes.len()).map(|_| Default::default()).collect();
        for index in (0..self.tree.nodes.len()).rev() {
            let (border, count) = match self.tree.nodes[index].is_leaf() {
                true => {
                    let triangles = self.triangles_of(index);
                    let mut border = Border::new();
                    let edges = triangles.iter().flat_map(|&[a, b, c]| [[a, b], [b, c], [c, a]]);
                    edges.for_each(|edge| add(&mut border, edge, 1));
                    (border, triangles.len())
                }
                false => {
                    let [first, second] = self.tree.children(index).map(|child| std::mem::take(&mut open[child]));
                    let (mut larger, smaller) =
                        if first.0.len() >= second.0.len() { (first.0, second.0) } else { (second.0, first.0) };
                    smaller.into_iter().for_each(|(edge, times)| add(&mut larger, edge, times));
                    (larger, first.1 + second.1)
                }
            };
            if border.len() < count {
                self.fan_of[index] = Some(self.add_fan(&border));
            }
            open[index] = (border, count);
        }
    }

    fn add_fan(&mut self, border: &Border) -> Range<usize> {
        let start = self.fans.len();
        let mut edges: Vec<_> = border.iter().map(|(&edge, &times)| (edge, times)).collect();
        edges.sort_unstable(); // the same sums in every run
        if let Some(&([apex, _], _)) = edges.first() {
            let beyond = edges.iter().filter(|([a, b], _)| *a != apex && *b != apex);
            self.fans.extend(beyond.map(|&([a, b], times)| ([apex, a, b], times)));
        }
        start..self.fans.len()
    }

    fn triangles_of(&self, leaf: usize) -> &[[u32; 3]] {
        let node = &self.tree.nodes[leaf];
        &self.triangles[node.first as usize..(node.first + node.count) as usize]
    }

    /// The winding number of each point, world units, in the order of `points`; NaN of a point that is not finite.
    pub fn winding_numbers(&self, points: &[[f32; 3]]) -> Vec<f64> {
        let of_point = |point: &[f32; 3]| {
            let point = Vec3::from(*point);
            match (point.is_finite(), self.tree.nodes.is_empty()) {
                (false, _) => f64::NAN,
                (true, true) => 0.0,
                (true, false) => self.angle(0, point) / TAU,
            }
        };
        parallel::map_slice(points, of_point)
    }

    /// Half of the solid angle under which the point sees the triangles of a node.
    fn angle(&self, index: usize, point: Vec3) -> f64 {
        let node = &self.tree.nodes[index];
        if let Some(fan) = self.fan_of[index].clone()
            && is_well_outside(&node.bounds, point * self.scale)
        {
            let angle = |(corners, times): &([u32; 3], i32)| f64::from(*times) * self.half_angle(*corners, point);
            return self.fans[fan].iter().map(angle).sum();
        }
        match node.is_leaf() {
            true => self.triangles_of(index).iter().map(|&corners| self.half_angle(corners, point)).sum(),
            false => self.tree.children(index).into_iter().map(|child| self.angle(child, point)).sum(),
        }
    }

    /// Half of the solid angle of one triangle, positive from below, which its corners turn around clockwise.
    fn half_angle(&self, corners: [u32; 3], point: Vec3) -> f64 {
        let point = DVec3::from(point);
        let corners = corners.map(|corner| self.positions[corner as usize]);
        let coordinates = |p: DVec3| Coord3D { x: p.x, y: p.y, z: p.z };
        let [p0, p1, p2] = corners.map(coordinates);
        let across = robust::orient3d(p0, p1, p2, coordinates(point));
        if across == 0.0 {
            return 0.0;
        }
        let [a, b, c] = corners.map(|corner| corner - point);
        let [a_size, b_size, c_size] = [a.length(), b.length(), c.length()];
        let along = a_size * b_size * c_size + a.dot(b) * c_size + b.dot(c) * a_size + c.dot(a) * b_size;
        across.atan2(along)
    }
}

/// Adds an edge, or takes away one that goes the other way.
fn add(border: &mut Border, [from, to]: [u32; 2], times: i32) {
    let (edge, times) = if from < to { ([from, to], times) } else { ([to, from], -times) };
    let sum = border.entry(edge).or_insert(0);
    *sum += times;
    if *sum == 0 {
        border.remove(&edge);
    }
}

/// From within this share of a box's size a fan is not taken: f64 does not know the angle of a triangle well from near
/// its edges, and those of a fan may be where there is nothing of the surface. An angle is off by about f64's rounding
/// over the distance from the nearest edge in units of the triangle's size.
const FAN_DISTANCE: f32 = 1.0 / 1024.0;

/// Whether a point is outside of a box, and not near it. Both are scaled, which rounds, but keeps their order.
fn is_well_outside(bounds: &Aabb, point: Vec3) -> bool {
    let distance = FAN_DISTANCE * (bounds.high - bounds.low).max_element();
    point.cmplt(bounds.low - distance).any() || point.cmpgt(bounds.high + distance).any()
}
