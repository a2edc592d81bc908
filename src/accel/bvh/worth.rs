//! In which order the children of a node are best searched where any hit will do: those first that most likely have
//! one, for what it costs to find it. Ize and Hansen, "RTSAH Traversal Order for Occlusion Rays", Computer Graphics
//! Forum 30(2), 2011; Nah and Manocha, "SATO: Surface Area Traversal Order for Shadow Ray Tracing", Computer Graphics
//! Forum 33(6), 2014.
//!
//! Large triangles among small ones, such as the walls of a room, are worth more than what stands before them.

use super::Bvh;
#[cfg(test)]
use crate::accel::{BuildOptions, build_bvh};
#[cfg(test)]
use crate::options::{BvhOptions, StructureKind};
use crate::parallel;
use glam::Vec3;

/// What a step costs in a binary tree, where a leaf costs 1: a wide node stands for some three of its nodes.
const STEP: f32 = 0.35;

/// What a ray that enters a node's box finds below it.
#[derive(Clone, Copy)]
struct Chance {
    /// That there is a hit.
    hit: f32,
    /// Expected cost until it is found, or that there is none.
    cost: f32,
}

impl Chance {
    fn worth(self) -> f32 {
        self.hit / self.cost
    }

    /// Of a leaf whose triangles have the surface `area`, in a box with half the surface `half_area`: a line through
    /// the box meets so many triangles as that is of this. The chance is less by those that are met together. Without
    /// exponentials, which are not everywhere the same.
    fn of_leaf(area: f32, half_area: f32) -> Chance {
        let hits = (area / half_area).min(f32::MAX);
        // A box without surface is entered by no ray, and so are numbers that are none.
        Chance { hit: if hits >= 0.0 { hits / (1.0 + hits) } else { 0.0 }, cost: 1.0 }
    }

    /// Of an inner node, of its children and the chance that a ray through the node enters each.
    fn of_node(children: [(Chance, f32); 2]) -> Chance {
        let [a, b] = children;
        let [(first, enters_first), (second, enters_second)] = if b.0.worth() > a.0.worth() { [b, a] } else { [a, b] };
        let goes_on = 1.0 - enters_first * first.hit;
        Chance {
            hit: 1.0 - goes_on * (1.0 - enters_second * second.hit),
            cost: STEP + enters_first * first.cost + goes_on * enters_second * second.cost,
        }
    }
}

/// For each node of a tree of the triangles `vertices`: the larger, the sooner it is best searched.
pub fn worths(tree: &Bvh, vertices: &[[Vec3; 3]]) -> Vec<f32> {
    let area = |index: usize| {
        let of = |&triangle: &u32| {
            let [a, b, c] = vertices[triangle as usize];
            0.5 * (b - a).cross(c - a).length()
        };
        if tree.nodes[index].is_leaf() { tree.triangles(index).iter().map(of).sum() } else { 0.0 }
    };
    let areas: Vec<f32> = parallel::map_numbers(tree.nodes.len(), area);
    let mut chances = vec![Chance { hit: 0.0, cost: 1.0 }; tree.nodes.len()];
    // Children come behind their parents.
    for index in (0..tree.nodes.len()).rev() {
        let half_area = |index: usize| tree.nodes[index].bounds.half_area() as f32;
        let whole = half_area(index);
        chances[index] = if tree.nodes[index].is_leaf() {
            Chance::of_leaf(areas[index], whole)
        } else {
            // All of a box that has no surface is as likely.
            let enters = |child: usize| if whole > 0.0 { (half_area(child) / whole).min(1.0) } else { 1.0 };
            Chance::of_node(tree.children(index).map(|child| (chances[child], enters(child))))
        };
    }
    chances.into_iter().map(Chance::worth).collect()
}

/// Small triangles before a wall, which is the last of them, in a tree for `structure`.
#[cfg(test)]
pub fn before_a_wall(structure: StructureKind, leaf_size: Option<u32>) -> (Bvh, Vec<[Vec3; 3]>) {
    let small = |i: u16| {
        let at = Vec3::new(f32::from(i * 37 % 101), f32::from(i * 53 % 103), f32::from(i * 71 % 97));
        [at, at + Vec3::X, at + Vec3::Y]
    };
    let wall = [Vec3::new(-200.0, -200.0, 99.0), Vec3::new(400.0, -200.0, 99.0), Vec3::new(50.0, 500.0, 99.0)];
    let vertices: Vec<_> = (0..500).map(small).chain([wall]).collect();
    let primitives: Vec<_> = (0..vertices.len() as u32).collect();
    let options = BvhOptions { leaf_size, ..BvhOptions::DEFAULT };
    (build_bvh(&vertices, &primitives, &BuildOptions::bvh(&options, structure)).unwrap(), vertices)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wall_is_worth_more_than_what_stands_before_it() {
        let (tree, vertices) = before_a_wall(StructureKind::Bvh2, Some(1));
        let worths = worths(&tree, &vertices);
        let wall = vertices.len() as u32 - 1;
        let of_wall = (0..tree.nodes.len()).find(|&i| tree.nodes[i].is_leaf() && tree.triangles(i) == [wall]).unwrap();
        let dust = (1..tree.nodes.len()).filter(|&i| !tree.nodes[i].is_leaf());
        assert!(dust.clone().count() > 450 && dust.clone().all(|i| worths[i] < 0.8 * worths[of_wall]), "{worths:?}");
    }

    #[test]
    fn every_node_has_a_number() {
        let at = [Vec3::ZERO, Vec3::ONE, Vec3::splat(3e38), Vec3::splat(-3e38)];
        for vertices in [
            vec![],
            vec![[Vec3::ONE; 3]; 5],
            at.map(|p| [p; 3]).to_vec(),
            at.map(|p| [p, -p, p + Vec3::X]).to_vec(),
            vec![[Vec3::ZERO, Vec3::X, 2.0 * Vec3::X]; 3],
        ] {
            let primitives: Vec<_> = (0..vertices.len() as u32).collect();
            let options = BuildOptions::bvh(&BvhOptions::DEFAULT, StructureKind::Bvh2);
            let tree = build_bvh(&vertices, &primitives, &options).unwrap();
            let worths = worths(&tree, &vertices);
            assert_eq!(worths.len(), tree.nodes.len());
            assert!(worths.iter().all(|worth| (0.0..=1.0).contains(worth)), "{worths:?}");
        }
    }
}
