//! Kinds of memory, layouts and orders: the same hits and pictures, bit for bit, wherever the scene's arrays lie.

use crate::common::{Random, SEED, device, is_usually_taken, on_oclgrind, scene_of, sheet, usually_every};
use glam::Vec3;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::{
    ArrayOptions, Intersector, KdOptions, Layout, Memory, NodeOrder, Structure, StructureKind, TraceOptions, Traversal,
    TriangleOrder,
};
use raybrook::low_level::pack::{CONSTANT_NODES, SceneBuffers};
use raybrook::low_level::renderer::{Picture, build_and_open, complete, open_tracer, render};
use raybrook::low_level::scene::{Builder, Material, Samples, Scene};
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{Task, TraceJob};
use std::sync::Arc;

/// Every memory with every way to lay triangles out.
fn arrangements() -> Vec<TraceOptions> {
    let mut all = Vec::new();
    for &memory in Memory::ALL {
        for &layout in Layout::ALL {
            for &triangles in TriangleOrder::ALL {
                let options =
                    TraceOptions { arrays: ArrayOptions { memory, layout, triangles }, ..TraceOptions::DEFAULT };
                if options.validate().is_ok() {
                    all.push(options);
                }
            }
        }
    }
    all
}

fn rays(buffers: &SceneBuffers, count: usize) -> Vec<TraceRay> {
    let mut random = Random::new(SEED);
    let mut ray = || {
        let from = 3.0 * random.vec3();
        buffers.trace_ray(from, random.vec3() - from, 0.0, f32::INFINITY)
    };
    (0..count).map(|_| ray()).collect()
}

/// Fewer on Oclgrind, which interprets them.
fn ray_count() -> usize {
    if on_oclgrind() { 100 } else { 2000 }
}

fn trace(device: Option<&DeviceHandle>, scene: &Scene, options: &TraceOptions) -> Vec<Hit> {
    // What is in constant memory is known only once the structure is built: kernels that were compiled ahead are not
    // used then.
    let opened = build_and_open(device, scene, options, 1, None, &[Task::Batch]);
    let (buffers, mut tracer) = opened.unwrap_or_else(|error| panic!("{options:?}: {error}"));
    let rays = rays(&buffers, ray_count());
    let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
    tracer.trace(&job, &|_| ()).unwrap().hits
}

fn assert_same(hits: &[Hit], expected: &[Hit], what: &str) {
    assert_eq!(bytemuck::cast_slice::<_, u32>(hits), bytemuck::cast_slice::<_, u32>(expected), "{what} (seed {SEED})");
}

/// A tree that overflows constant memory, and one that fits together with its triangles.
fn scenes() -> [Scene; 2] {
    let scenes = [60, 4].map(|n| scene_of(&sheet(n)));
    let nodes = scenes.each_ref().map(|s| SceneBuffers::new(s, &TraceOptions::DEFAULT).unwrap().nodes.len());
    assert!(nodes[0] > CONSTANT_NODES && nodes[1] < CONSTANT_NODES / 4, "{nodes:?}");
    scenes
}

#[test]
fn every_memory_and_layout_gives_the_same_hits() {
    let Some(device) = device() else { return };
    for (which, (scene, name)) in scenes().iter().zip(["large", "small"]).enumerate() {
        let expected = trace(None, scene, &TraceOptions::DEFAULT);
        assert!(expected.iter().filter(|hit| hit.t.is_finite()).count() > ray_count() / 6);
        // In a usual run each with one of the two, and both orders of triangles with each.
        let is_tried = |number: usize| is_usually_taken(2, which + number + number / 2);
        for (_, options) in arrangements().into_iter().enumerate().filter(|&(number, _)| is_tried(number)) {
            assert_same(&trace(Some(&device), scene, &options), &expected, &format!("{name}: {options:?}"));
        }
    }
}

#[test]
fn every_array_is_found_in_every_memory() {
    // Bounds, transforms and ropes, which the default does not read.
    let Some(device) = device() else { return };
    let [scene, _] = scenes();
    let expected = trace(None, &scene, &TraceOptions::DEFAULT);
    for (which, &memory) in Memory::ALL.iter().filter(|&&memory| memory != Memory::Global).enumerate() {
        // In a usual run each array in one memory or two.
        let is_tried = |number: usize| is_usually_taken(2, which + number);
        let structures = [
            TraceOptions::of_kd(KdOptions { traversal: Traversal::Ropes, ..KdOptions::DEFAULT }),
            TraceOptions::of(StructureKind::Grid),
            TraceOptions::of(StructureKind::Bvh2),
            TraceOptions::of(StructureKind::Bvh8),
            TraceOptions::of(StructureKind::Octree),
            TraceOptions {
                arrays: ArrayOptions { triangles: TriangleOrder::LeafOrder, ..ArrayOptions::DEFAULT },
                ..TraceOptions::of(StructureKind::Boxes)
            },
        ];
        for (_, options) in structures.into_iter().enumerate().filter(|&(number, _)| is_tried(number)) {
            let options = TraceOptions { arrays: ArrayOptions { memory, ..options.arrays }, ..options };
            assert_same(&trace(Some(&device), &scene, &options), &expected, &format!("{options:?}"));
        }
        let options = TraceOptions {
            arrays: ArrayOptions { memory, ..ArrayOptions::DEFAULT },
            intersector: Intersector::Precomputed,
            ..TraceOptions::DEFAULT
        };
        let leaf_order =
            TraceOptions { arrays: ArrayOptions { triangles: TriangleOrder::LeafOrder, ..options.arrays }, ..options };
        let expected = trace(None, &scene, &options);
        for (_, options) in [options, leaf_order].into_iter().enumerate().filter(|&(number, _)| is_tried(number)) {
            assert_same(&trace(Some(&device), &scene, &options), &expected, &format!("{options:?}"));
        }
    }
}

#[test]
fn every_node_order_gives_the_same_hits() {
    let device = device();
    let [scene, _] = scenes();
    let expected = trace(None, &scene, &TraceOptions::DEFAULT);
    for &node_order in NodeOrder::ALL {
        for &traversal in Traversal::ALL.iter().filter(|traversal| traversal.is_exact()) {
            let options = TraceOptions::of_kd(KdOptions { node_order, traversal, ..KdOptions::DEFAULT });
            assert_same(&trace(None, &scene, &options), &expected, &format!("twin: {options:?}"));
        }
        for memory in [Memory::Global, Memory::Constant] {
            let options = TraceOptions {
                structure: Structure::Kd(KdOptions { node_order, traversal: Traversal::Ropes, ..KdOptions::DEFAULT }),
                arrays: ArrayOptions { memory, ..ArrayOptions::DEFAULT },
                ..TraceOptions::DEFAULT
            };
            if let Some(device) = &device {
                assert_same(&trace(Some(device), &scene, &options), &expected, &format!("{options:?}"));
            }
        }
    }
}

#[test]
fn pictures_do_not_depend_on_where_the_scene_lies() {
    let Some(device) = device() else { return };
    let mut builder = Builder::new();
    builder.material(Material { mirror: Vec3::splat(0.3), ..Material::matt(Vec3::new(0.8, 0.4, 0.2)) });
    builder.sphere(0.8, 24);
    builder.quad(Vec3::new(-2.0, -1.0, -2.0), 4.0 * Vec3::Z, 4.0 * Vec3::X, 1); // a floor to cast a shadow on
    builder.material(Material { transmission: Vec3::new(0.7, 0.9, 0.8), ior: 1.5, ..Material::matt(Vec3::splat(0.1)) });
    builder.quad(Vec3::new(-1.5, -1.0, 1.2), 3.0 * Vec3::X, 1.5 * Vec3::Y, 1);
    let mut scene = builder.finish().unwrap();
    complete(&mut scene, 1.0);
    let side = if on_oclgrind() { 16 } else { 40 };
    let picture = Picture {
        camera: scene.camera.unwrap(),
        size: (side, side),
        samples: Samples::PerPixel(2),
        depth: 4,
        kill_weight: None,
    };
    let pixels = |device: Option<&DeviceHandle>, options: &TraceOptions| {
        let buffers = Arc::new(SceneBuffers::new(&scene, options).unwrap());
        let mut tracer = open_tracer(device, &buffers, options, picture.depth, None).unwrap();
        let result = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap();
        (result.film.pixels.iter().flatten().map(|value| value.to_bits()).collect::<Vec<_>>(), result.counts)
    };
    let expected = pixels(None, &TraceOptions::DEFAULT);
    assert!(expected.1.iter().all(|&count| count > 0), "not all kinds of rays: {:?}", expected.1);
    for options in usually_every(3, arrangements()) {
        assert!(pixels(Some(&device), &options) == expected, "{options:?}");
    }
}
