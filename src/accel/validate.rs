//! Whether a kd-tree is one: every promise of [`KdTree`] and of the node format as a check, for tests and debugging.
//!
//! Coverage is checked by walking every triangle down the tree, cut by every plane on its way, in f64 and apart from
//! the builders' own clipping: wherever a part of it reaches into a leaf, that leaf must refer to it.
//!
//! Bad at: speed; it costs several times what building does.

use super::subtree::Cell;
use super::{Aabb, BuildOptions, KdTree};
use crate::shared::{KD_LEAF, KdNode};
use glam::{DVec3, Vec3};

/// How far a part must reach over a plane to count there, relative to the triangle's largest coordinate. Cuts are off
/// by 12 · 2^-53 each, and there are at most 60 of them: 2^-43.5. float32 resolves 2^-24.
const REACH: f64 = 1.0 / (1u64 << 42) as f64;

/// A triangle has 3 corners, and every cut of a convex polygon adds one at most.
type Polygon = Vec<DVec3>;

/// Checks that `tree` is a right kd-tree of `primitives` within the limits of `options`.
///
/// # Errors
/// What is wrong first, in words.
pub fn check_tree(
    tree: &KdTree,
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
) -> Result<(), String> {
    check_bounds(tree, vertices, primitives)?;
    check_nodes(tree, options)?;
    check_references(tree, primitives)?;
    check_coverage(tree, vertices, primitives)
}

fn ensure(holds: bool, message: impl FnOnce() -> String) -> Result<(), String> {
    if holds { Ok(()) } else { Err(message()) }
}

/// The tree's box is the smallest one around all triangles.
fn check_bounds(tree: &KdTree, vertices: &[[Vec3; 3]], primitives: &[u32]) -> Result<(), String> {
    let around = primitives
        .iter()
        .fold(Aabb::EMPTY, |bounds, &triangle| bounds.union(Aabb::of_triangle(&vertices[triangle as usize])));
    ensure(tree.bounds == around, || format!("the box is {:?}, not {around:?}", tree.bounds))
}

/// Nodes are in left pre-order without gaps, planes lie within their nodes, leaf ranges follow each other without gaps,
/// and no leaf is too deep.
fn check_nodes(tree: &KdTree, options: &BuildOptions) -> Result<(), String> {
    let root = Cell { low: tree.bounds.low.to_array(), high: tree.bounds.high.to_array() };
    // The right children that are still to come, the next one last, with the index that their parent gives.
    let mut open = vec![(0, root, 0)];
    let mut next_reference = 0;
    for (node_index, &node) in tree.nodes.iter().enumerate() {
        let (expected, cell, depth) =
            open.pop().ok_or_else(|| format!("node {node_index} is behind the end of the tree"))?;
        ensure(expected == node_index as u32, || {
            format!("node {node_index} stands where its parent expects node {expected}")
        })?;
        if node.flags == KD_LEAF {
            ensure(depth <= options.max_depth, || format!("leaf {node_index} has depth {depth}"))?;
            check_leaf(tree, node_index, node, next_reference)?;
            next_reference += node.right;
        } else {
            ensure(node.flags < KD_LEAF, || format!("node {node_index} has flags {}", node.flags))?;
            ensure(node.left == node_index as u32 + 1, || {
                format!("the left child of node {node_index} is {}", node.left)
            })?;
            let axis = node.flags as usize;
            ensure(cell.is_split_by(axis, node.split), || {
                format!("node {node_index}: plane {} on axis {axis} is not within {cell:?}", node.split)
            })?;
            let (left, right) = cell.split(axis, node.split);
            open.push((node.right, right, depth + 1));
            open.push((node.left, left, depth + 1));
        }
    }
    ensure(open.is_empty(), || format!("{} nodes are missing at the end", open.len()))?;
    ensure(next_reference as usize == tree.references.len(), || {
        format!("the leaves have {next_reference} of {} references", tree.references.len())
    })
}

fn check_leaf(tree: &KdTree, node_index: usize, node: KdNode, next_reference: u32) -> Result<(), String> {
    ensure(node.left == next_reference, || {
        format!("leaf {node_index} starts at reference {}, not {next_reference}", node.left)
    })?;
    ensure(node.split == 0.0, || format!("leaf {node_index} has {} for a plane", node.split))?;
    let references = leaf_references(tree, node).ok_or_else(|| format!("leaf {node_index} ends behind the list"))?;
    ensure(references.is_sorted_by(|a, b| a < b), || {
        format!("the references of leaf {node_index} do not ascend: {references:?}")
    })
}

fn leaf_references(tree: &KdTree, node: KdNode) -> Option<&[u32]> {
    tree.references.get(node.left as usize..)?.get(..node.right as usize)
}

/// The tree refers to all of `primitives` and to nothing else.
fn check_references(tree: &KdTree, primitives: &[u32]) -> Result<(), String> {
    let sorted = |list: &[u32]| {
        let mut list = list.to_vec();
        list.sort_unstable();
        list.dedup();
        list
    };
    let (referenced, expected) = (sorted(&tree.references), sorted(primitives));
    let missing = expected.iter().find(|triangle| referenced.binary_search(triangle).is_err());
    ensure(missing.is_none(), || format!("no leaf refers to triangle {missing:?}"))?;
    let foreign = referenced.iter().find(|triangle| expected.binary_search(triangle).is_err());
    ensure(foreign.is_none(), || format!("triangle {foreign:?} is not among the primitives"))
}

/// Every part of every triangle lies in leaves that refer to it.
fn check_coverage(tree: &KdTree, vertices: &[[Vec3; 3]], primitives: &[u32]) -> Result<(), String> {
    for &triangle in primitives {
        let corners: Polygon = vertices[triangle as usize].iter().map(|p| p.as_dvec3()).collect();
        let largest = corners.iter().fold(0f64, |largest, p| largest.max(p.abs().max_element()));
        let walk = Walk { tree, triangle, reach: largest * REACH };
        if let Err(leaf) = walk.check_node(0, &corners) {
            return Err(format!("leaf {leaf} does not refer to triangle {triangle}, which reaches into it"));
        }
    }
    Ok(())
}

/// One triangle on its way down.
struct Walk<'a> {
    tree: &'a KdTree,
    triangle: u32,
    reach: f64,
}

impl Walk<'_> {
    /// Checks that `part` is covered below a node; else tells the leaf where it is not.
    fn check_node(&self, node_index: u32, part: &[DVec3]) -> Result<(), u32> {
        let node = self.tree.nodes[node_index as usize];
        if node.flags == KD_LEAF {
            let references = leaf_references(self.tree, node).unwrap_or_default();
            return references.binary_search(&self.triangle).map(|_| ()).map_err(|_| node_index);
        }
        let (axis, plane) = (node.flags as usize, f64::from(node.split));
        let reaches_left = part.iter().any(|p| p[axis] < plane - self.reach);
        let reaches_right = part.iter().any(|p| p[axis] > plane + self.reach);
        if reaches_left {
            self.check_node(node.left, &cut(part, axis, plane, 1.0))?;
        }
        if reaches_right {
            self.check_node(node.right, &cut(part, axis, plane, -1.0))?;
        }
        if !reaches_left && !reaches_right {
            // The part lies in the plane: either side will do.
            return self.check_node(node.left, part).or_else(|_| self.check_node(node.right, part));
        }
        Ok(())
    }
}

/// The part of a convex polygon with `sign * coordinate <= sign * plane` (Sutherland and Hodgman 1974).
fn cut(polygon: &[DVec3], axis: usize, plane: f64, sign: f64) -> Polygon {
    let mut part = Polygon::with_capacity(polygon.len() + 1);
    for (number, &corner) in polygon.iter().enumerate() {
        let next = polygon[(number + 1) % polygon.len()];
        let (distance, next_distance) = (sign * (corner[axis] - plane), sign * (next[axis] - plane));
        if distance <= 0.0 {
            part.push(corner);
        }
        if (distance < 0.0 && next_distance > 0.0) || (distance > 0.0 && next_distance < 0.0) {
            let mut crossing = corner + (next - corner) * (distance / (distance - next_distance));
            crossing[axis] = plane;
            part.push(crossing);
        }
    }
    part
}

#[cfg(test)]
mod tests {
    use super::super::build_kd_tree;
    use super::*;
    use crate::options::{Build, TraceOptions};

    /// Triangles in a row along x, and a tree of them.
    fn row() -> (Vec<[Vec3; 3]>, Vec<u32>, BuildOptions, KdTree) {
        let vertices: Vec<_> =
            (0..8).map(|i| [Vec3::ZERO, Vec3::new(1.5, 0.0, 1.0), Vec3::Y].map(|p| p + Vec3::X * i as f32)).collect();
        let primitives: Vec<_> = (0..8).collect();
        let options = BuildOptions::new(&TraceOptions::DEFAULT, primitives.len());
        let tree = build_kd_tree(Build::Sah, &vertices, &primitives, &options);
        (vertices, primitives, options, tree)
    }

    #[test]
    fn every_kind_of_damage_is_found() {
        let (vertices, primitives, options, tree) = row();
        assert_eq!(check_tree(&tree, &vertices, &primitives, &options), Ok(()));
        let full_leaf = tree.nodes.iter().position(|n| n.flags == KD_LEAF && n.right > 0).unwrap();
        type Damage = Box<dyn Fn(&mut KdTree)>;
        let cases: Vec<(&str, Damage)> = vec![
            ("the box is", Box::new(|t| t.bounds.low.x -= 1.0)),
            ("has flags 4", Box::new(|t| t.nodes[0].flags = 4)),
            ("the left child", Box::new(|t| t.nodes[0].left = 2)),
            ("its parent expects", Box::new(|t| t.nodes[0].right += 1)),
            ("is not within", Box::new(|t| t.nodes[0].split = t.bounds.high.to_array()[t.nodes[0].flags as usize])),
            ("is not within", Box::new(|t| t.nodes[0].split = f32::NAN)),
            ("missing at the end", Box::new(|t| t.nodes.truncate(t.nodes.len() - 1))),
            ("behind the end of the tree", Box::new(|t| t.nodes.push(t.nodes[t.nodes.len() - 1]))),
            ("starts at reference", Box::new(move |t| t.nodes[full_leaf].left += 1)),
            ("for a plane", Box::new(move |t| t.nodes[full_leaf].split = 1.0)),
            ("references", Box::new(|t| t.references.push(0))),
            ("is not among", Box::new(move |t| replace(t, full_leaf, 9))),
        ];
        for (message, damage) in cases {
            let mut damaged = tree.clone();
            damage(&mut damaged);
            let error = check_tree(&damaged, &vertices, &primitives, &options).unwrap_err();
            assert!(error.contains(message), "'{error}' instead of '{message}'");
        }
    }

    /// Puts another triangle at the end of a leaf.
    fn replace(tree: &mut KdTree, leaf: usize, triangle: u32) {
        let node = tree.nodes[leaf];
        tree.references[(node.left + node.right) as usize - 1] = triangle;
    }

    #[test]
    fn every_lost_reference_is_found() {
        let (vertices, primitives, options, tree) = row();
        for lost in 0..tree.references.len() {
            let mut damaged = tree.clone();
            damaged.references.remove(lost);
            for node in damaged.nodes.iter_mut().filter(|n| n.flags == KD_LEAF) {
                let range = node.left..node.left + node.right;
                node.left -= u32::from(node.left > lost as u32);
                node.right -= u32::from(range.contains(&(lost as u32)));
            }
            assert!(check_tree(&damaged, &vertices, &primitives, &options).is_err(), "reference {lost}");
        }
    }

    #[test]
    fn a_leaf_that_is_too_deep_is_found() {
        let (vertices, primitives, options, tree) = row();
        let shallow = BuildOptions { max_depth: 1, ..options };
        assert!(check_tree(&tree, &vertices, &primitives, &shallow).unwrap_err().contains("has depth"));
    }
}
