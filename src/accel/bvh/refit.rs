//! New boxes for a tree whose triangles have moved: its nodes stay, their boxes are those around the triangles as they
//! are now.
//!
//! Wald, Boulos and Shirley, "Ray Tracing Deformable Scenes using Dynamic Bounding Volume Hierarchies", ACM
//! Transactions on Graphics 26(1), 2007, section 3.2. Bad at triangles that change their neighbours: boxes overlap more
//! and more.

use super::{Bvh, build_bvh};
use crate::accel::{Aabb, BuildOptions};
use crate::error::Result;
use glam::Vec3;
use std::borrow::Cow;
use std::time::Instant;

/// A tree that is kept from one shape of a moving scene to the next.
///
/// Refitting is several times as fast as building, but makes every ray slower from then on. How many rays will come
/// nobody knows; so the tree is built anew as soon as the time that slower rays have lost since it was built is as long
/// as building took. With that both together take at most twice as long as with the best choice of moments (the
/// problem of renting or buying skis; Karlin, Manasse, Rudolph and Sleator, "Competitive Snoopy Caching", Algorithmica
/// 3, 1988).
#[derive(Debug, Default)]
pub struct KeptBvh {
    kept: Option<Kept>,
}

#[derive(Debug)]
struct Kept {
    tree: Bvh,
    /// The triangles that it was built of.
    primitives: Vec<u32>,
    built_cost: f64,
    build_s: f64,
    /// As a part of the time of tracing.
    loss: f64,
    lost_s: f64,
}

impl KeptBvh {
    /// Takes note that rays were traced through the tree for so many seconds.
    pub fn add_traced(&mut self, seconds: f64) {
        if let Some(kept) = &mut self.kept {
            kept.lost_s += kept.loss * seconds;
        }
    }

    /// A tree of the triangles `primitives` of `vertices`: the one that was there, with new boxes, where it holds the
    /// same triangles and has not yet lost as much time as building takes; else a new one.
    ///
    /// # Errors
    /// As [`build_bvh`].
    fn tree(&mut self, vertices: &[[Vec3; 3]], primitives: &[u32], options: &BuildOptions) -> Result<&Bvh> {
        let is_worth_it = |kept: &Kept| kept.primitives == primitives && kept.lost_s < kept.build_s;
        let kept = match self.kept.take().filter(is_worth_it) {
            Some(kept) => kept.refitted(vertices, options),
            None => Kept::new(vertices, primitives, options)?,
        };
        Ok(&self.kept.insert(kept).tree)
    }
}

/// The tree of the triangles `primitives` of `vertices`: what is kept, with new boxes, while that is worth it, else a
/// new one. Of a scene that does not move nothing is kept, so that its tree takes no memory once it is packed.
///
/// # Errors
/// As [`build_bvh`].
pub fn tree_of<'a>(
    kept: Option<&'a mut KeptBvh>,
    vertices: &[[Vec3; 3]],
    primitives: &[u32],
    options: &BuildOptions,
) -> Result<Cow<'a, Bvh>> {
    match kept {
        Some(kept) => kept.tree(vertices, primitives, options).map(Cow::Borrowed),
        None => build_bvh(vertices, primitives, options).map(Cow::Owned),
    }
}

impl Kept {
    fn new(vertices: &[[Vec3; 3]], primitives: &[u32], options: &BuildOptions) -> Result<Kept> {
        let start = Instant::now();
        let tree = build_bvh(vertices, primitives, options)?;
        let build_s = start.elapsed().as_secs_f64();
        let built_cost = tree.expected_cost(options);
        Ok(Kept { tree, primitives: primitives.to_vec(), built_cost, build_s, loss: 0.0, lost_s: 0.0 })
    }

    fn refitted(mut self, vertices: &[[Vec3; 3]], options: &BuildOptions) -> Kept {
        self.tree.refit(vertices);
        // Of a twisted bunny the time of rays grew as the cost to the power of 0.37 to 0.54, up to the 5.6-fold cost
        // (docs/record/2026-11-25-pocl-moving-scenes.md). A cost without a surface is NaN, and max gives 0.
        let ratio = self.tree.expected_cost(options) / self.built_cost;
        self.loss = (1.0 - ratio.sqrt().recip()).max(0.0);
        self
    }
}

impl Bvh {
    /// Makes the boxes those around `vertices`. Parts of triangles that splits of space have cut get the boxes of whole
    /// triangles.
    fn refit(&mut self, vertices: &[[Vec3; 3]]) {
        let of = |&triangle: &u32| Aabb::of_triangle(&vertices[triangle as usize]);
        // Children come behind their parents.
        for index in (0..self.nodes.len()).rev() {
            self.nodes[index].bounds = if self.nodes[index].is_leaf() {
                self.triangles(index).iter().map(of).fold(Aabb::EMPTY, Aabb::union)
            } else {
                let [first, second] = self.children(index);
                self.nodes[first].bounds.union(self.nodes[second].bounds)
            };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{BvhOptions, StructureKind};

    fn triangles(count: u32, moved: impl Fn(Vec3) -> Vec3) -> Vec<[Vec3; 3]> {
        let triangle = |i: u32| {
            let at = Vec3::new((i * 37 % 101) as f32, (i * 53 % 103) as f32, (i * 71 % 97) as f32);
            [at, at + Vec3::X, at + Vec3::Y].map(&moved)
        };
        (0..count).map(triangle).collect()
    }

    #[test]
    fn a_tree_is_refitted_until_slow_rays_have_lost_the_time_of_building() {
        let options = BuildOptions::bvh(&BvhOptions::DEFAULT, StructureKind::Bvh2);
        let before = triangles(500, |p| p);
        let after = triangles(500, |p| (p * 1e4).map(f32::sin));
        let primitives: Vec<u32> = (0..500).collect();
        let mut kept = KeptBvh::default();
        let built = kept.tree(&before, &primitives, &options).unwrap().clone();
        assert_eq!(built, build_bvh(&before, &primitives, &options).unwrap());
        kept.add_traced(1e9);

        // The time before was not lost: the tree was new.
        let refitted = kept.tree(&after, &primitives, &options).unwrap();
        assert_eq!(refitted.order, built.order);
        for (index, node) in refitted.nodes.iter().enumerate() {
            let below: Vec<Aabb> = match node.is_leaf() {
                true => refitted.triangles(index).iter().map(|&i| Aabb::of_triangle(&after[i as usize])).collect(),
                false => refitted.children(index).map(|child| refitted.nodes[child].bounds).to_vec(),
            };
            assert_eq!(node.bounds, below.into_iter().fold(Aabb::EMPTY, Aabb::union));
        }
        let refitted = refitted.clone();
        assert_eq!(*kept.tree(&after, &primitives, &options).unwrap(), refitted);
        kept.add_traced(1e9);
        assert_eq!(
            *kept.tree(&after, &primitives, &options).unwrap(),
            build_bvh(&after, &primitives, &options).unwrap()
        );
    }

    #[test]
    fn other_triangles_get_another_tree() {
        let options = BuildOptions::bvh(&BvhOptions::DEFAULT, StructureKind::Bvh2);
        let vertices = triangles(500, |p| p);
        let mut kept = KeptBvh::default();
        for primitives in [(0..500).collect::<Vec<u32>>(), (1..500).collect(), (1..500).step_by(2).collect(), vec![]] {
            let tree = kept.tree(&vertices, &primitives, &options).unwrap();
            assert_eq!(*tree, build_bvh(&vertices, &primitives, &options).unwrap());
        }
    }
}
