//! Packs a scene for `cl/traverse/instances.cl`: one hierarchy of boxes for each object, in the object's coordinates,
//! and one of the instances, in tracing space, whose leaves lead to the roots of the others. Vertices and shading data
//! are there once for each object.
//!
//! Rubin and Whitted, "A 3-Dimensional Representation for Fast Rendering of Complex Scenes", SIGGRAPH 1980. Nodes are
//! those of `accel/bvh2.rs`; a leaf of the instances' hierarchy has the link [`instance_link`]. What a kernel knows of
//! an instance is a record in `bounds`, in the order of their primitives:
//!
//! ```text
//! 0-2   rows of the transform to the world (world units, as Transform::point has it)
//! 3-5   rows from tracing space to the object
//! 6     reach: |object| <= reach |tracing space| for differences, on each axis; w: number of the object's root
//! 7     blur: the padding of its boxes whatever the ray; w: the material, or NO_MATERIAL for the triangles' own
//! 8-10  rows of the transform of normals; w: first primitive, how many, and what takes a primitive to its place in the
//!       arrays
//! ```
//!
//! An instance that cannot be shared gets triangles of its own, placed beforehand: one whose inverse is not sure to a
//! quarter of float32's rounding, or that does not lose the same triangles as the object when its vertices are rounded.

use super::shading::{ShadingOf, pack_shading};
use crate::accel::{
    BuildOptions, Bvh, KeptBvh, MAX_TRIANGLES, SplitsChosen, StructureArrays, build_bvh, check_triangle_count,
    instance_link, leaf_link, move_links, pack_bvh2, tree_of, worths,
};
use crate::bounds::{EPSILON, LEAST_PADDING};
use crate::error::{Error, Result};
use crate::layout::Float4;
use crate::options::SpatialSplits;
use crate::parallel;
use crate::scene::{DropReason, Instance, MaterialId, Scene, Transform, Triangle, turned};
use crate::shared::{
    BVH_FIRST_MASK, BVH_NODE_RECORDS, INSTANCE_BLUR, INSTANCE_NORMALS, INSTANCE_REACH, INSTANCE_RECORDS,
    INSTANCE_TO_OBJECT, INSTANCE_TO_WORLD, NO_MATERIAL, Shading,
};
use glam::{DVec3, Vec2, Vec3};
use std::borrow::Cow;
use std::collections::HashMap;
use std::ops::Range;

/// The arrays; see [`super::SceneBuffers`].
pub(super) struct PackedInstances {
    pub structure: StructureArrays,
    pub vertices: Vec<Float4>,
    pub shading: Vec<Shading>,
    pub instance_count: u32,
    pub stack_entries: u32,
    pub splits_chosen: Option<SplitsChosen>,
}

/// Triangles that have their place in the arrays once.
struct Mesh {
    /// In its own coordinates.
    triangles: Vec<[Vec3; 3]>,
    /// Normals as they are given, not of unit length.
    shading: Vec<Shading>,
    /// Those that can be hit, ascending.
    listed: Vec<u32>,
    /// The largest coordinates of these.
    extent: Vec3,
}

impl Mesh {
    /// Whether the same triangles can be hit when `transform` has placed them.
    fn keeps_listed(&self, transform: &Transform) -> bool {
        let mut listed = self.listed.iter().copied().peekable();
        (0..).zip(&self.triangles).all(|(i, triangle)| {
            let is_hittable = DropReason::of(triangle.map(|p| transform.point(p))).is_none();
            is_hittable == listed.next_if_eq(&i).is_some()
        })
    }
}

/// Where a mesh is.
struct Place {
    mesh: usize,
    transform: Transform,
    material: Option<MaterialId>,
    inverse: Inverse,
}

/// The lists that a mesh is made of.
struct Source<'a> {
    positions: &'a [Vec3],
    normals: &'a [Vec3],
    uvs: &'a [Vec2],
    triangles: &'a [Triangle],
}

impl Source<'_> {
    /// `used`: of a material that is not used, because all instances have others, any will do.
    fn mesh(&self, used: &[MaterialId], is_mirrored: bool, placed: Option<&Transform>) -> Mesh {
        let point = |p: Vec3| placed.map_or(p, |transform| transform.point(p));
        let normal = |n: Vec3| placed.map_or(n, |transform| transform.normal(n));
        let vertices = |t: &Triangle| turned(t.positions, is_mirrored).map(|i| point(self.positions[i as usize]));
        let triangles = parallel::map_slice(self.triangles, vertices);
        let shading = |t: &Triangle| {
            let turned = Triangle {
                positions: t.positions,
                normals: turned(t.normals, is_mirrored),
                uvs: turned(t.uvs, is_mirrored),
                material: t.material,
            };
            let of = ShadingOf {
                normals: self.normals,
                uvs: self.uvs,
                material: used.binary_search(&t.material).unwrap_or(0),
            };
            pack_shading(&turned, &of, |normals| normals.map(normal))
        };
        let hittable = |i: usize| DropReason::of(triangles[i]).is_none().then_some(i as u32);
        let listed = parallel::flat_map_numbers(triangles.len(), hittable);
        let corners = listed.iter().flat_map(|&i| triangles[i as usize]);
        let extent = corners.fold(Vec3::ZERO, |extent, p| extent.max(p.abs()));
        Mesh { shading: parallel::map_slice(self.triangles, shading), listed, extent, triangles }
    }
}

/// From tracing space to a mesh, in float32, and how far off that may be.
#[derive(Debug, Clone, Copy)]
struct Inverse {
    rows: [[f32; 4]; 3],
    reach: Vec3,
    blur: Vec3,
}

/// What the rounding of an inverse may add to differences; a quarter of what the padding has to spare.
const REACH_MARGIN: f64 = 1.25;
/// Limits of an inverse's size: kernels' products of it stay in float32's range.
const LEAST_REACH: f64 = 1.0 / (1u128 << 101) as f64;
const LARGEST_REACH: f64 = (1u128 << 102) as f64;

impl Inverse {
    /// Of `transform` for a mesh of this extent; `None` where it is not sure enough. `cl/shared/slab.cl` says what
    /// reach and blur are for.
    fn new(transform: &Transform, extent: Vec3, scale: f32) -> Option<Inverse> {
        let scale = f64::from(scale);
        let (inverse, offset) = transform.inverse();
        let forward = transform.linear().map(|row| row * scale);
        let columns = [0, 1, 2].map(|k| DVec3::from_array(forward.map(|row| row[k])));
        let inverse = inverse.map(|row| row / scale);
        let sums = inverse.map(|row| row.abs().element_sum());
        let mut rows = [[0.0; 4]; 3];
        let (mut reach, mut blur) = (Vec3::ZERO, Vec3::ZERO);
        let extent = extent.as_dvec3();
        // How far from its true place a vertex may be, in units of the rounding.
        let summands = DVec3::from_array(transform.rows.map(|row| f64::from(row[3]).abs())) * scale;
        let magnitude = [0, 1, 2].map(|k| forward[k].abs().dot(extent) + summands[k]).into_iter().fold(0.0, f64::max);
        for k in 0..3 {
            // inverse * forward is off from the identity by the inverse's own error, relative to the true one, and by
            // rounding in f64.
            let error = |j: usize| {
                let product = inverse[k].dot(columns[j]) - if j == k { 1.0 } else { 0.0 };
                product.abs() + 8.0 * f64::EPSILON * inverse[k].abs().dot(columns[j].abs())
            };
            let relative = (0..3).map(|j| error(j) * sums[j]).sum::<f64>() / sums[k];
            let is_sure = relative <= f64::from(EPSILON) / 4.0;
            if !is_sure || !(LEAST_REACH..=LARGEST_REACH).contains(&sums[k]) {
                return None;
            }
            let [x, y, z] = inverse[k].to_array();
            rows[k] = [x, y, z, offset[k]].map(|value| value as f32);
            let (epsilon, widest) = (f64::from(EPSILON), REACH_MARGIN * sums[k]);
            reach[k] = (widest as f32).next_up();
            // Vertices of the least scenes are placed among subnormal numbers.
            let least = f64::from(LEAST_PADDING) + 4.0 * f64::from(f32::from_bits(1)) * scale;
            let needed = widest * (8.0 * epsilon * magnitude + least) + 8.0 * epsilon * extent[k];
            blur[k] = (REACH_MARGIN * needed) as f32;
        }
        (rows.as_flattened().iter().all(|x| x.is_finite()) && blur.is_finite()).then_some(Inverse { rows, reach, blur })
    }
}

/// Packs the triangles of `scene` and its instances. `used`: [`Scene::used_materials`].
///
/// # Errors
/// [`Error::Scene`] when an object has more triangles than a hierarchy of boxes can number, or there are more instances
/// than links can.
pub(super) fn pack_instances(
    scene: &Scene,
    used: &[MaterialId],
    scale: f32,
    options: &BuildOptions,
    kept: Option<&mut Vec<KeptBvh>>,
) -> Result<PackedInstances> {
    let (meshes, places) = place_all(scene, used, scale)?;
    if places.len() >= BVH_FIRST_MASK as usize {
        let reason = format!("it has {} instances, and a hierarchy of them can number {BVH_FIRST_MASK}", places.len());
        return Err(Error::Scene(reason));
    }
    let kept: Vec<Option<&mut KeptBvh>> = match kept {
        Some(kept) => {
            kept.resize_with(meshes.len(), KeptBvh::default);
            kept.iter_mut().map(Some).collect()
        }
        None => meshes.iter().map(|_| None).collect(),
    };
    let trees =
        parallel::map(meshes.iter().zip(kept), |(mesh, kept)| tree_of(kept, &mesh.triangles, &mesh.listed, options));
    let trees: Vec<Cow<Bvh>> = trees.into_iter().collect::<Result<_>>()?;
    let hittable: Vec<u32> =
        (0..).zip(&places).filter(|(_, place)| !meshes[place.mesh].listed.is_empty()).map(|(i, _)| i).collect();
    // A hierarchy of boxes is one of triangles that fill their boxes from corner to corner.
    let boxes = parallel::map_slice(&places, |place| box_of(place, &meshes[place.mesh], scale));
    let one_a_leaf = BuildOptions { leaf_size: 1, spatial_splits: SpatialSplits::NONE, ..*options };
    let top = build_bvh(&boxes, &hittable, &one_a_leaf)?;

    let mut structure = pack_bvh2(&top, &[], 0, 0.0)?;
    move_links(&mut structure.nodes, |leaf| instance_link(structure.references[leaf.start]), 0);
    structure.references.clear();
    let (mut roots, mut firsts, mut triangle_count) = (Vec::new(), Vec::new(), 0);
    for (mesh, tree) in meshes.iter().zip(&trees) {
        let mut packed = pack_bvh2(tree, &worths(tree, &mesh.triangles), 0, 0.0)?;
        let (node_count, reference_count) =
            (structure.nodes.len() as u32 / BVH_NODE_RECORDS, structure.references.len());
        check_triangle_count(reference_count + packed.references.len(), MAX_TRIANGLES)?;
        let moved = |leaf: Range<usize>| leaf_link((reference_count + leaf.start) as u32, leaf.len() as u32);
        move_links(&mut packed.nodes, moved, node_count);
        roots.push(node_count);
        firsts.push(triangle_count as u32);
        structure.nodes.append(&mut packed.nodes);
        structure.references.extend(packed.references.iter().map(|&i| i + triangle_count as u32));
        triangle_count += mesh.triangles.len();
    }
    let mut first_primitive = 0;
    for place in &places {
        let mesh = place.mesh;
        let count = meshes[mesh].triangles.len() as u32;
        let material = place.material.map_or(NO_MATERIAL, |id| used.binary_search(&id).unwrap_or(0) as u32);
        let numbers = [first_primitive, count, firsts[mesh].wrapping_sub(first_primitive)];
        structure.bounds.extend(record(place, roots[mesh], material, numbers));
        first_primitive += count;
    }
    // One more for what leads back out of an instance, one for the end.
    let deepest = trees.iter().map(|tree| tree.depth()).max().unwrap_or(0);
    let stack_entries = top.depth().max(1) + deepest.max(1) + 2;
    let corners = meshes.iter().flat_map(|mesh| mesh.triangles.iter().flatten());
    Ok(PackedInstances {
        structure,
        vertices: corners.map(|&p| Float4::new(p, 0.0)).collect(),
        shading: meshes.iter().flat_map(|mesh| mesh.shading.iter().copied()).collect(),
        instance_count: places.len() as u32,
        stack_entries,
        splits_chosen: SplitsChosen::of(trees.iter().filter_map(|tree| tree.splits_ratio)),
    })
}

/// All that is in the scene, and where, in the order of primitives.
fn place_all(scene: &Scene, used: &[MaterialId], scale: f32) -> Result<(Vec<Mesh>, Vec<Place>)> {
    let (mut meshes, mut places) = (Vec::<Mesh>::new(), Vec::new());
    // What is placed beforehand always has an inverse: scenes are never larger than the limits.
    let in_place = |mesh: &Mesh| {
        Inverse::new(&Transform::IDENTITY, mesh.extent, scale)
            .ok_or_else(|| Error::Scene("it is too large or too small for instances; take another `structure`".into()))
    };
    if !scene.triangles.is_empty() {
        let Scene { positions, normals, uvs, triangles, .. } = scene;
        let mesh = Source { positions, normals, uvs, triangles }.mesh(used, false, None);
        places.push(Place { mesh: 0, transform: Transform::IDENTITY, material: None, inverse: in_place(&mesh)? });
        meshes.push(mesh);
    }
    let source = |instance: &Instance| {
        let object = &scene.instances.objects()[instance.object as usize];
        Source {
            positions: &object.positions,
            normals: &object.normals,
            uvs: &object.uvs,
            triangles: &object.triangles,
        }
    };
    let mut known = HashMap::new();
    let mut shared_mesh = |instance: &Instance| {
        *known.entry((instance.object, instance.transform.is_mirrored)).or_insert_with(|| {
            meshes.push(source(instance).mesh(used, instance.transform.is_mirrored, None));
            meshes.len() - 1
        })
    };
    let placed = scene.instances.placed();
    let shared: Vec<usize> = placed.iter().map(&mut shared_mesh).collect();
    // With a mesh of its own where it cannot be shared.
    let place = |i: usize| -> Result<(Place, Option<Mesh>)> {
        let (instance, mesh) = (&placed[i], shared[i]);
        let &Instance { transform, material, .. } = instance;
        let inverse = Inverse::new(&transform, meshes[mesh].extent, scale);
        if let Some(inverse) = inverse.filter(|_| meshes[mesh].keeps_listed(&transform)) {
            return Ok((Place { mesh, transform, material, inverse }, None));
        }
        let own = source(instance).mesh(used, transform.is_mirrored, Some(&transform));
        Ok((Place { mesh, transform: Transform::IDENTITY, material, inverse: in_place(&own)? }, Some(own)))
    };
    for placed in parallel::map_numbers(placed.len(), place) {
        let (mut place, own) = placed?;
        if let Some(own) = own {
            place.mesh = meshes.len();
            meshes.push(own);
        }
        places.push(place);
    }
    Ok((used_meshes(meshes, &mut places), places))
}

/// The meshes that are somewhere: not what all instances have one of their own in place of.
fn used_meshes(meshes: Vec<Mesh>, places: &mut [Place]) -> Vec<Mesh> {
    let mut numbers = vec![None; meshes.len()];
    places.iter().for_each(|place| numbers[place.mesh] = Some(0));
    (0..).zip(numbers.iter_mut().flatten()).for_each(|(next, number)| *number = next);
    places.iter_mut().for_each(|place| place.mesh = numbers[place.mesh].expect("a place has its mesh"));
    meshes.into_iter().zip(numbers).filter_map(|(mesh, number)| number.map(|_| mesh)).collect()
}

/// The box around what can be hit of an instance, tracing space, as a triangle.
fn box_of(place: &Place, mesh: &Mesh, scale: f32) -> [Vec3; 3] {
    let corners = mesh.listed.iter().flat_map(|&i| mesh.triangles[i as usize]);
    let nothing = (Vec3::INFINITY, Vec3::NEG_INFINITY);
    let (low, high) =
        corners.map(|p| place.transform.point(p) * scale).fold(nothing, |(low, high), p| (low.min(p), high.max(p)));
    [low, high, low]
}

fn record(place: &Place, root: u32, material: u32, numbers: [u32; 3]) -> [Float4; INSTANCE_RECORDS as usize] {
    let mut record = [Float4::default(); INSTANCE_RECORDS as usize];
    let bits = f32::from_bits;
    for k in 0..3 {
        let of_row = |[x, y, z, w]: [f32; 4]| Float4 { x, y, z, w };
        let [x, y, z] = place.transform.normal_rows[k];
        record[INSTANCE_TO_WORLD as usize + k] = of_row(place.transform.rows[k]);
        record[INSTANCE_TO_OBJECT as usize + k] = of_row(place.inverse.rows[k]);
        record[INSTANCE_NORMALS as usize + k] = Float4 { x, y, z, w: bits(numbers[k]) };
    }
    record[INSTANCE_REACH as usize] = Float4::new(place.inverse.reach, bits(root));
    record[INSTANCE_BLUR as usize] = Float4::new(place.inverse.blur, bits(material));
    record
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bounds::HIT_ERROR;
    use crate::random::Random;
    use crate::reference::shared::ray::Ray;
    use crate::reference::shared::slab::Slabs;
    use crate::shared::NO_PRIMITIVE;
    use glam::{DAffine3, DMat3};

    const SEED: u64 = 20_081_121;

    fn transform(random: &mut Random) -> DAffine3 {
        let turn = DAffine3::from_axis_angle(random.direction().as_dvec3(), f64::from(random.unit()) * 6.3);
        let shear = DAffine3::from_mat3(DMat3::from_cols(
            DVec3::X,
            DVec3::new(f64::from(random.signed()), 1.0, 0.0),
            DVec3::new(0.0, f64::from(random.signed()), 1.0),
        ));
        let stretch = (random.vec3().as_dvec3() * 10.0).exp2();
        DAffine3::from_translation(random.vec3().as_dvec3()) * turn * DAffine3::from_scale(stretch) * shear
    }

    /// The slabs of an object's boxes hold every t at which a ray comes as near to a placed vertex as a hit may be off.
    #[test]
    fn no_box_of_an_object_is_left_before_or_entered_after_any_hit_in_it() {
        let mut random = Random::new(SEED);
        let (mut checked, mut refused, mut far) = (0, 0, 0);
        for i in 0..200_000 {
            let unit = [1.0, 1e-9, 1e12][i % 3];
            let placed = DAffine3::from_scale(DVec3::splat(unit)) * transform(&mut random);
            let transform = Transform::new(placed).unwrap();
            // Objects about their own origin, and far from it.
            let middle = random.vec3() * [0.0, 3.0, 1000.0][i / 3 % 3];
            let vertex = middle + random.vec3();
            let world = transform.point(vertex);
            let largest = world.abs().max_element();
            let scale = 2f32.powi(-(f64::from(largest).log2().floor() as i32));
            let w = world * scale;
            let Some(inverse) = Inverse::new(&transform, vertex.abs().max(middle.abs()), scale) else {
                refused += 1;
                continue;
            };
            let place = Place { mesh: 0, transform, material: None, inverse };
            let records = record(&place, 0, NO_MATERIAL, [0; 3]);

            let origin = random.vec3() * [2.0, 1e-3, 1e4, 1e15][i / 9 % 4];
            let origin = if i % 7 == 0 { w + random.vec3() * 1e-6 } else { origin };
            let (low, high) = (w.min(random.vec3() * 1.99), w.max(random.vec3() * 1.99));
            let from = |p: Vec3| (p.as_dvec3() - origin.as_dvec3()).abs().max_element();
            let distance = from(low).max(from(high));
            let error = 0.9 * f64::from(HIT_ERROR * EPSILON) * distance;
            let target = w.as_dvec3() + random.vec3().as_dvec3() * error;
            let ray = Ray::new(origin, (target - origin.as_dvec3()).as_vec3(), 0.0, f32::INFINITY, NO_PRIMITIVE);
            if ray.t_near > ray.t_far {
                continue;
            }
            let d = ray.direction.as_dvec3();
            let k = (0..3).max_by(|&a, &b| d[a].abs().total_cmp(&d[b].abs())).unwrap();
            let t = (target[k] - f64::from(origin[k])) / d[k];
            let off = (origin.as_dvec3() + d * t - w.as_dvec3()).abs().max_element();
            if off > f64::from(HIT_ERROR * EPSILON) * distance {
                continue;
            }
            let slabs = Slabs::of_instance(&ray, low, high, &records);
            far += usize::from(slabs.enter == Vec3::NEG_INFINITY);
            for axis in 0..3 {
                let t_enter = vertex[axis].mul_add(slabs.inv[axis], slabs.enter[axis]);
                let t_leave = vertex[axis].mul_add(slabs.inv[axis], slabs.leave[axis]);
                checked += 1;
                assert!(
                    f64::from(t_enter) <= t && f64::from(t_leave) >= t,
                    "{i}, axis {axis}: {t_enter}..{t_leave} without {t}, {ray:?}, {transform:?} (seed {SEED})"
                );
            }
        }
        assert!(checked > 400_000 && refused < 20_000 && far < 1000, "{checked} {refused} {far}");
    }

    #[test]
    fn inverses_that_are_not_sure_are_refused() {
        let inverse = |matrix: DMat3| {
            let transform = Transform::new(DAffine3::from_mat3(matrix)).unwrap();
            Inverse::new(&transform, Vec3::ONE, 1.0)
        };
        // Scales do no harm. Consecutive Fibonacci numbers have the determinant 1, far below the rounding of their
        // products.
        let turned = DMat3::from_axis_angle(DVec3::ONE.normalize(), 1.0);
        assert!(inverse(turned * DMat3::from_diagonal(DVec3::new(1.0, 1e-12, 1e9))).is_some());
        let [a, b, c] = [5_702_887.0, 9_227_465.0, 14_930_352.0];
        assert!(inverse(DMat3::from_cols(DVec3::new(b, a, 0.0), DVec3::new(c, b, 0.0), DVec3::Z)).is_none());
        let identity = Inverse::new(&Transform::IDENTITY, Vec3::ONE, 1.0).unwrap();
        assert_eq!(identity.rows, Transform::IDENTITY.rows);
        for scale in [2f32.powi(-100), 2f32.powi(100)] {
            assert!(Inverse::new(&Transform::IDENTITY, Vec3::ONE / scale, scale).is_some(), "{scale:e}");
        }
    }
}
