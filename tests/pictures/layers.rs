//! Layers of pictures have the same bits from a device and from the twin.

use crate::common::{asked, device};
use glam::{Vec2, Vec3};
use raybrook::low_level::layers::{Layer, trace_layers};
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::planes::{Plane, PlaneGroup};
use raybrook::low_level::renderer::{Picture, open_tracer};
use raybrook::low_level::scene::{Builder, Camera, Image, Material, Numbering, Samples, Scene};
use std::sync::Arc;

const SIZE: (u32, u32) = (41, 31);

/// Balls and boxes, turned and stretched, on a ground with a texture; all but the ground are instances.
fn scene() -> Scene {
    let mut builder = Builder::new();
    let rgba = (0..64u8).map(|i| [i * 4, 255 - i, i.wrapping_mul(37), 255]).collect();
    let texture = builder.add_texture(Image { name: "squares".into(), width: 8, height: 8, rgba });
    builder.material(Material { diffuse_texture: Some(texture), ..Material::matt(Vec3::new(0.9, 0.8, 0.7)) });
    builder.uv_scale(Vec2::splat(3.0));
    builder.quad(Vec3::new(-4.0, -1.0, 4.0), Vec3::X * 8.0, Vec3::NEG_Z * 8.0, 2);
    let ball = builder.begin_object().sphere(0.7, 12).end_object();
    let red = builder.add_material(Material::matt(Vec3::new(0.8, 0.1, 0.1)));
    let cube = builder.begin_object().cuboid(Vec3::ONE).end_object();
    for i in 0..6 {
        let place = Vec3::new((i % 3) as f32 * 2.0 - 2.0, 0.3 * i as f32 - 0.6, (i / 3) as f32 * -2.0);
        builder.push().translate(place).rotate(Vec3::new(0.3, 1.0, 0.2), 40.0 * i as f32);
        builder.scale(Vec3::new(1.0, 1.0 + 0.2 * i as f32, 1.0));
        builder.instance(if i % 2 == 0 { ball } else { cube }, (i == 3).then_some(red)).pop();
    }
    builder.finish().unwrap()
}

/// The bits of all numbers, by channels.
fn bits(groups: &[PlaneGroup]) -> Vec<(String, Vec<u32>)> {
    let planes = groups.iter().flat_map(|group| group.planes.iter().map(move |(letter, plane)| (group, letter, plane)));
    let bits = |plane: &Plane| match plane {
        Plane::Float(values) => values.iter().map(|value| value.to_bits()).collect(),
        Plane::Uint(values) => values.clone(),
    };
    planes.map(|(group, letter, plane)| (format!("{}.{letter}", group.name), bits(plane))).collect()
}

#[test]
fn layers_are_the_same_from_device_and_twin_and_by_every_structure() {
    let scene = scene();
    let camera = Camera { eye: Vec3::new(1.0, 3.0, 7.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 };
    let picture = Picture { camera, size: SIZE, samples: Samples::PerPixel(4), depth: 3, kill_weight: None };
    let layers = |device, options: &TraceOptions| {
        let buffers = Arc::new(SceneBuffers::new(&scene, options).unwrap());
        let mut tracer = open_tracer(device, &buffers, options, 3, None).unwrap();
        let of = (&*buffers, &Numbering::of(&scene, &buffers.used_materials));
        let all: Vec<_> = Layer::ALL.iter().copied().filter(|&layer| layer != Layer::Error).collect();
        bits(&trace_layers(tracer.as_mut(), of, &picture, None, &all, None, &|_| ()).unwrap())
    };
    let instanced = asked("structure=instances");
    let twin = layers(None, &instanced);
    let channel = |name: &str| &twin.iter().find(|(channel, _)| channel == name).unwrap().1;
    for (name, largest) in [("object.X", 2), ("instance.X", 5), ("material.X", 1)] {
        assert!((0..=largest).all(|number| channel(name).contains(&number)), "{name} has not all numbers to {largest}");
    }
    // Flat, with triangles of their own, the scene has the same numbers.
    for (name, of_kd) in layers(None, &asked("structure=kd")) {
        assert!(of_kd == *channel(&name), "{name} of the kd-tree");
    }
    let Some(device) = device() else { return };
    for (name, of_device) in layers(Some(&device), &instanced) {
        assert!(of_device == *channel(&name), "{name} of the device");
    }
}
