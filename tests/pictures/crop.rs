//! Parts of pictures have the bits of the whole one, whatever kernels render them.

use super::wavefront::{glass_house, one_light};
use crate::common::{device, usually_every};
use glam::Vec3;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::{
    Decisions, Kernels, PacketSize, PictureOptions, StructureKind, TexturePass, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Crop, Picture, open_tracer, render_part, render_part_noting};
use raybrook::low_level::scene::{Builder, Camera, Light, Material, Samples, Scene};
use raybrook::low_level::tracer::{Backend, RenderResult};
use std::sync::Arc;

const SIZE: (u32, u32) = (37, 29);

/// In the middle, at the corners, a row, a column and all of it.
const PARTS: [Crop; 6] = [
    Crop { place: (9, 6), size: (17, 11) },
    Crop { place: (0, 0), size: (5, 8) },
    Crop { place: (30, 20), size: (7, 9) },
    Crop { place: (0, 13), size: (37, 1) },
    Crop { place: (36, 0), size: (1, 29) },
    Crop { place: (0, 0), size: SIZE },
];

/// The bits of the part that a film of `SIZE` has.
fn cut(whole: &RenderResult, Crop { place, size }: Crop) -> Vec<[u32; 3]> {
    let pixel = |x: u32, y: u32| whole.film.pixels[(y * SIZE.0 + x) as usize].map(f32::to_bits);
    let rows = place.1..place.1 + size.1;
    rows.flat_map(|y| (place.0..place.0 + size.0).map(move |x| pixel(x, y))).collect()
}

fn check_parts(name: &str, options: &TraceOptions, device: Option<&DeviceHandle>) {
    let scene = glass_house(one_light());
    let buffers = Arc::new(SceneBuffers::new(&scene, options).unwrap());
    let mut tracer = open_tracer(device, &buffers, options, 6, None).unwrap();
    for samples in [Samples::PerPixel(1), Samples::PerPixel(3), Samples::Corners, Samples::Error(2.0)] {
        let picture = Picture { camera: scene.camera.unwrap(), size: SIZE, samples, depth: 6, kill_weight: Some(0.0) };
        let mut rendered =
            |part| render_part(tracer.as_mut() as &mut dyn Backend, &buffers, &picture, part, &|_| ()).unwrap();
        let whole = rendered(None);
        for crop in PARTS {
            let part = rendered(Some(crop));
            assert_eq!((part.film.width, part.film.height), crop.size);
            let bits: Vec<_> = part.film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect();
            assert!(bits == cut(&whole, crop), "{name}, {samples:?}, {crop}");
            // Nothing else is rendered where samples are fixed.
            if !matches!(samples, Samples::Error(_)) {
                let rays = u64::from(crop.size.0 * crop.size.1 * samples.per_pixel());
                assert_eq!(part.counts[0], rays, "{name}, {samples:?}, {crop}");
            }
            let work = |result: &RenderResult| result.work.as_ref().map(Vec::len);
            assert_eq!(work(&part), work(&whole).map(|_| bits.len()));
        }
    }
}

#[test]
fn parts_have_the_bits_of_the_whole_picture() {
    let kd = TraceOptions::DEFAULT;
    let roulette = PictureOptions { roulette: Some(0.6), ..kd.picture };
    let wavefront = |textures| PictureOptions { kernels: Kernels::Wavefront, textures, ..roulette };
    let bvh8 = TraceOptions { packet_size: PacketSize::Sixteen, ..TraceOptions::of(StructureKind::Bvh8) };
    check_parts("reference", &TraceOptions { picture: roulette, ..kd }, None);
    check_parts("reference, counting", &TraceOptions { counters: true, ..kd }, None);
    let Some(device) = device() else { return };
    let all = [
        ("packets", TraceOptions { picture: roulette, ..bvh8 }),
        ("mega-kernel", TraceOptions { picture: roulette, ..kd }),
        (
            "decided by the device",
            TraceOptions { picture: PictureOptions { decisions: Decisions::Device, ..roulette }, ..kd },
        ),
        ("host-pass", TraceOptions { picture: wavefront(TexturePass::HostPass), ..kd }),
        ("wavefront kernels", TraceOptions { picture: wavefront(TexturePass::InKernel), ..kd }),
        ("counting", TraceOptions { counters: true, ..kd }),
    ];
    // Those of a usual run are compiled for `tests/pictures/roulette.rs`, too.
    for (name, options) in usually_every(2, all) {
        check_parts(name, &options, Some(&device));
    }
}

/// A ball over a ground that is lit: cheap, and with edges.
fn ball() -> Scene {
    let mut builder = Builder::new();
    builder.material(Material::matt(Vec3::new(0.8, 0.6, 0.3)));
    builder.quad(Vec3::new(-3.0, -1.0, 3.0), Vec3::X * 6.0, Vec3::NEG_Z * 6.0, 1);
    builder.sphere(1.0, 8).light(Light::point(Vec3::new(2.0, 5.0, 4.0), Vec3::ONE));
    builder.finish().unwrap()
}

/// Of a picture of two blocks one is rendered where the part meets one; what is told of the pixels is that of the whole
/// picture.
#[test]
fn blocks_that_a_part_does_not_meet_are_not_rendered() {
    const SIZE: (u32, u32) = (512, 384);
    let scene = ball();
    let options = TraceOptions { counters: true, ..TraceOptions::DEFAULT };
    let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
    let mut tracer = open_tracer(None, &buffers, &options, 1, None).unwrap();
    let camera = Camera { eye: Vec3::new(1.0, 2.0, 6.0), target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 };
    let picture = Picture { camera, size: SIZE, samples: Samples::Error(1.5), depth: 1, kill_weight: None };
    let mut rendered = |part: Option<Crop>| {
        let result = render_part_noting(tracer.as_mut(), &buffers, &picture, part, true, &|_| ()).unwrap();
        let stats = result.adaptive.unwrap();
        (result, stats)
    };
    let (whole, of_whole) = rendered(None);
    let sampling = whole.sampling.as_ref().unwrap();
    assert!(of_whole.pixels[2] > 0 && of_whole.rounds > 1, "{of_whole:?}");
    for (place, size, all) in [((230, 200), (20, 19), false), ((210, 220), (90, 70), true), ((0, 0), SIZE, true)] {
        let (part, of_part) = rendered(Some(Crop { place, size }));
        let told = part.sampling.as_ref().unwrap();
        let work = |result: &RenderResult, pixel: usize| result.work.as_ref().unwrap()[pixel];
        for (pixel, radiance) in part.film.pixels.iter().enumerate() {
            let (x, y) = (place.0 as usize + pixel % size.0 as usize, place.1 as usize + pixel / size.0 as usize);
            let of_whole = y * SIZE.0 as usize + x;
            assert_eq!(radiance.map(f32::to_bits), whole.film.pixels[of_whole].map(f32::to_bits), "{x} {y}");
            assert_eq!(told.samples[pixel], sampling.samples[of_whole], "{x} {y}");
            assert_eq!(told.errors[pixel].to_bits(), sampling.errors[of_whole].to_bits(), "{x} {y}");
            assert_eq!(work(&part, pixel), work(&whole, of_whole), "{x} {y}");
        }
        assert_eq!(told.samples.len() as u32, size.0 * size.1);
        let share = part.counts[0] as f64 / whole.counts[0] as f64;
        assert!(if all { share == 1.0 } else { (0.4..0.65).contains(&share) }, "{place:?}: {share} of the rays");
        let pixels: u64 = of_part.pixels.iter().sum();
        assert_eq!(pixels, u64::from(SIZE.0 * SIZE.1) / if all { 1 } else { 2 });
    }
}

#[test]
fn parts_beyond_the_picture_are_refused() {
    let scene = glass_house(one_light());
    let options = TraceOptions::DEFAULT;
    let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
    let mut tracer = open_tracer(None, &buffers, &options, 2, None).unwrap();
    let camera = scene.camera.unwrap();
    let picture = Picture { camera, size: SIZE, samples: Samples::PerPixel(1), depth: 2, kill_weight: None };
    let beyond = Crop { place: (30, 20), size: (8, 9) };
    let error = render_part(tracer.as_mut(), &buffers, &picture, Some(beyond), &|_| ()).unwrap_err().to_string();
    assert!(error.contains("crop: 30,20,8x9 reaches beyond the picture of 37x29"), "{error}");
}
