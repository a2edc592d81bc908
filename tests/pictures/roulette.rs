//! Russian roulette: the same rays live on a device and in the twin, whatever the kernels, the structure and who
//! decides where samples go; pictures are right on average; and fewer rays are cast.

use super::wavefront::{glass_house, one_light};
use crate::common::{device, is_thorough};
use glam::{DVec3, Vec3};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::film::Film;
use raybrook::low_level::options::{
    Decisions, Kernels, PacketSize, PictureOptions, StructureKind, TexturePass, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, open_tracer, render, render_full};
use raybrook::low_level::scene::{Background, Builder, Camera, Material, Samples, Scene};
use raybrook::low_level::stats::RayCounts;
use raybrook::low_level::tracer::RenderResult;
use std::sync::Arc;

/// Chains of so many rays: between mirrors that face each other, and in glass. As many as the kernels of
/// `tests/pictures/crop.rs` have room for.
const DEPTH: u32 = 8;

fn playing(options: TraceOptions, roulette: f32) -> TraceOptions {
    TraceOptions { picture: PictureOptions { roulette: Some(roulette), ..options.picture }, ..options }
}

fn picture(scene: &Scene, size: (u32, u32), samples: Samples) -> Picture {
    Picture { camera: scene.camera.unwrap(), size, samples, depth: DEPTH, kill_weight: Some(0.0) }
}

fn rendered(scene: &Scene, picture: &Picture, options: &TraceOptions, device: Option<&DeviceHandle>) -> RenderResult {
    let buffers = Arc::new(SceneBuffers::new(scene, options).unwrap());
    let mut tracer = open_tracer(device, &buffers, options, picture.depth, None).unwrap();
    render(tracer.as_mut(), &buffers, picture, &|_| ()).unwrap()
}

fn bits(result: &RenderResult) -> (Vec<[u32; 3]>, [u64; 8]) {
    (result.film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect(), result.counts)
}

#[test]
fn the_same_rays_live_in_all_kernels_and_in_the_twin() {
    let Some(device) = device() else { return };
    let scene = glass_house(one_light());
    let kd = playing(TraceOptions::DEFAULT, 0.6);
    let bvh8 = playing(TraceOptions::of(StructureKind::Bvh8), 0.6);
    let wavefront = |textures| PictureOptions { kernels: Kernels::Wavefront, textures, ..kd.picture };
    let pictures = [Samples::PerPixel(3), Samples::Error(2.0), Samples::Corners].map(|s| picture(&scene, (29, 21), s));
    let expected = pictures.each_ref().map(|picture| rendered(&scene, picture, &kd, None));
    for result in &expected {
        let RayCounts { reflected, refracted, .. } = RayCounts::from_counters(&result.counts);
        assert!(reflected.cast > 100 && refracted.cast > 50, "{:?}", result.counts);
    }
    let all = [
        ("mega-kernel", kd),
        ("wavefront kernels", TraceOptions { picture: wavefront(TexturePass::InKernel), ..kd }),
        ("packets", TraceOptions { packet_size: PacketSize::Sixteen, ..bvh8 }),
        ("host-pass", TraceOptions { picture: wavefront(TexturePass::HostPass), ..kd }),
    ];
    // The last one's colours are computed elsewhere, its rays are those of the other wavefront kernels.
    let count = if is_thorough() { all.len() } else { 3 };
    for (name, options) in &all[..count] {
        for (picture, expected) in pictures.iter().zip(&expected) {
            let by_error = matches!(picture.samples, Samples::Error(_));
            let decided_by: &[_] = if by_error { &[Decisions::Host, Decisions::Device] } else { &[Decisions::Auto] };
            for &decisions in decided_by {
                let options = TraceOptions { picture: PictureOptions { decisions, ..options.picture }, ..*options };
                let got = rendered(&scene, picture, &options, Some(&device));
                assert!(bits(&got) == bits(expected), "{name}, {:?}, decisions {decisions}", picture.samples);
            }
        }
    }
}

/// The full picture is what others are compared with: nothing is killed at random, in kernels that could.
#[test]
fn the_full_picture_does_not_play() {
    let scene = glass_house(one_light());
    let full = |options: &TraceOptions, device: Option<&DeviceHandle>| {
        let picture = picture(&scene, (3, 2), Samples::PerPixel(1));
        let buffers = Arc::new(SceneBuffers::new(&scene, options).unwrap());
        let mut tracer = open_tracer(device, &buffers, options, DEPTH, None).unwrap();
        bits(&render_full(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap())
    };
    let expected = full(&TraceOptions::DEFAULT, None);
    assert!(full(&playing(TraceOptions::DEFAULT, 1.0), None) == expected);
    let Some(device) = device() else { return };
    assert!(full(&playing(TraceOptions::DEFAULT, 1.0), Some(&device)) == expected);
}

/// By how many standard deviations the means of blocks of a picture differ from those of another: the largest of all
/// blocks and channels. What is random in two pixels is independent, so that the sum of their differences has the sum
/// of their squares for its variance, where the mean difference is 0.
fn largest_deviation(film: &Film, from: &Film, block: usize) -> f64 {
    let difference = |i: usize| {
        let of = |film: &Film| Vec3::from(film.pixels[i]).as_dvec3();
        of(film) - of(from)
    };
    let (width, height) = (film.width as usize, film.height as usize);
    let mut largest = 0.0f64;
    for (left, top) in (0..height).step_by(block).flat_map(|y| (0..width).step_by(block).map(move |x| (x, y))) {
        let pixels = (top..top + block).flat_map(|y| (left..left + block).map(move |x| y * width + x));
        let (sum, squares) = pixels.fold((DVec3::ZERO, DVec3::ZERO), |(sum, squares), i| {
            let d = difference(i);
            (sum + d, squares + d * d)
        });
        // Where no ray was killed there is nothing to see.
        let deviation = DVec3::select(squares.cmpgt(DVec3::ZERO), sum.abs() / squares.map(f64::sqrt), DVec3::ZERO);
        largest = largest.max(deviation.max_element());
    }
    largest
}

/// A normal variable is beyond this with a probability of 5.7e-7: once in 36,000 pictures of 16 blocks and 3 channels.
const MOST_DEVIATION: f64 = 5.0;

/// Samples are those of the picture without roulette, so that nothing but the roulette is random.
#[test]
fn pictures_are_right_on_average() {
    const SIZE: (u32, u32) = (128, 128);
    const BLOCK: usize = 32;
    let scene = glass_house(one_light());
    for samples in [1, 4] {
        let picture = picture(&scene, SIZE, Samples::PerPixel(samples));
        let all = rendered(&scene, &picture, &TraceOptions::DEFAULT, None).film;
        for weight in [0.1, 0.5, 1.0] {
            let film = rendered(&scene, &picture, &playing(TraceOptions::DEFAULT, weight), None).film;
            assert!(film.pixels != all.pixels, "some rays were killed");
            let deviation = largest_deviation(&film, &all, BLOCK);
            assert!(deviation < MOST_DEVIATION, "{samples} samples, weight {weight}: {deviation}");
            // The same rays killed without making up for them: those of less weight, all of them.
            let killed = Picture { kill_weight: Some(weight), ..picture };
            let film = rendered(&scene, &killed, &TraceOptions::DEFAULT, None).film;
            let deviation = largest_deviation(&film, &all, BLOCK);
            assert!(deviation > 2.0 * MOST_DEVIATION, "{samples} samples, killed below {weight}: {deviation}");
        }
    }
}

#[test]
fn fewer_rays_are_cast_the_more_play() {
    let scene = glass_house(one_light());
    let picture = picture(&scene, (48, 36), Samples::PerPixel(2));
    let counts = [0.0, 0.05, 0.2, 0.5, 1.0].map(|weight| {
        let options = playing(TraceOptions::DEFAULT, weight);
        RayCounts::from_counters(&rendered(&scene, &picture, &options, None).counts)
    });
    let without = RayCounts::from_counters(&rendered(&scene, &picture, &TraceOptions::DEFAULT, None).counts);
    assert_eq!(counts[0], without, "a weight of 0 is no roulette");
    let secondary = counts.map(|c| c.reflected.cast + c.refracted.cast);
    assert!(secondary.is_sorted_by(|more, fewer| more > fewer) && 2 * secondary[4] < secondary[0], "{secondary:?}");
    assert!(counts.iter().all(|c| c.camera == counts[0].camera), "{counts:?}");
}

/// A room of perfect mirrors under a chain as long as there is: weights stay 1, and nobody plays; with grey mirrors
/// chains end early, and the picture is still right on average.
#[test]
fn chains_end_early_and_light_is_kept() {
    let room = |mirror: f32| {
        let mut builder = Builder::new();
        let emission = Vec3::splat(1.0 - mirror);
        builder.material(Material { mirror: Vec3::splat(mirror), emission, ..Material::matt(Vec3::ZERO) });
        builder.cuboid(Vec3::splat(2.0));
        let mut scene = builder.finish().unwrap();
        scene.background = Background { bottom: Vec3::ZERO, top: Vec3::ZERO };
        let target = Vec3::new(0.3, 0.2, -1.0);
        scene.camera = Some(Camera { eye: Vec3::ZERO, target, up: Vec3::Y, fov_degrees: 80.0 });
        scene
    };
    let rays = |scene: &Scene, roulette: f32| {
        let picture = Picture { depth: 64, ..picture(scene, (64, 64), Samples::PerPixel(1)) };
        let result = rendered(scene, &picture, &playing(TraceOptions::DEFAULT, roulette), None);
        (result.film, RayCounts::from_counters(&result.counts).reflected.cast)
    };
    let perfect = room(1.0);
    assert_eq!(rays(&perfect, 1.0).1, 63 * 64 * 64, "a weight of 1 always lives");
    let grey = room(0.8);
    let ((all, cast), (film, with_roulette)) = (rays(&grey, 0.0), rays(&grey, 1.0));
    // A chain goes on with a probability of 0.8 at each of 63 surfaces: 4 rays on average, with a variance of 20.
    let mean = with_roulette as f64 / 64.0f64.powi(2);
    assert!(cast == 63 * 64 * 64 && (mean - 4.0).abs() < MOST_DEVIATION * 20f64.sqrt() / 64.0, "{cast}, {mean}");
    // Light of 1 - mirror from each surface: 1 - 0.8^64 altogether.
    assert!(all.pixels.iter().flatten().all(|&value| (value - 1.0).abs() < 1e-5));
    assert!(largest_deviation(&film, &all, 32) < MOST_DEVIATION);
}
