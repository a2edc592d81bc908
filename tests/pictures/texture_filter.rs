//! What colours rays take from textures: the mean over what a ray stands for is near the converged picture where the
//! colour of a point flickers; the same bits on device and twin, in every kind of kernel; nothing changes where texels
//! are large; and nothing is lost where texture coordinates make no sense.

use crate::common::{Random, SEED, device, is_thorough};
use glam::{Vec2, Vec3};
use raybrook::Error;
use raybrook::low_level::film::{Film, srgb_from_linear};
use raybrook::low_level::options::{
    ArrayOptions, KernelFeatures, Kernels, Layout, PacketSize, PictureOptions, Structure, StructureKind, TextureFilter,
    TexturePass, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{Builder, Camera, Image, Light, Material, Normals, Samples, Scene, Texture};
use std::sync::Arc;

/// With all features: these kernels other tests of pictures compile, too.
const FOOTPRINT: TraceOptions = TraceOptions {
    picture: PictureOptions { features: KernelFeatures::All, ..PictureOptions::DEFAULT },
    ..TraceOptions::DEFAULT
};
const BILINEAR: TraceOptions = TraceOptions {
    picture: PictureOptions { texture_filter: TextureFilter::Bilinear, ..FOOTPRINT.picture },
    ..FOOTPRINT
};
const SIZE: (u32, u32) = (120, 80);

/// A picture of random dots; sides that are no powers of two, too.
fn dots(width: u32, height: u32) -> Image {
    let mut random = Random::new(SEED);
    let dot = |_| [(); 3].map(|()| if random.unit() < 0.5 { 20 } else { 230 });
    let rgba = (0..width * height).map(dot).map(|[r, g, b]| [r, g, b, 255]).collect();
    Image { name: "dots".into(), width, height, rgba }
}

/// A floor of so many tiles a side, out to the horizon, under a mirror ball and a glass one.
fn floor(tile: Image, tiles: f32) -> Scene {
    let mut builder = Builder::new();
    let diffuse_texture = Some(builder.add_texture(tile));
    builder.material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) });
    let corners = [(-1.0, 1.0), (1.0, 1.0), (1.0, -1.0), (-1.0, -1.0)];
    let positions = corners.map(|(x, z)| Vec3::new(60.0 * x, 0.0, 60.0 * z));
    let uvs = corners.map(|(x, z)| Vec2::new(tiles * x, tiles * z));
    builder.mesh(&positions, Normals::Flat, &uvs, &[[0, 1, 2], [0, 2, 3]]);
    builder.material(Material { mirror: Vec3::splat(0.7), ..Material::matt(Vec3::splat(0.1)) });
    builder.push().translate(Vec3::new(-1.5, 1.0, 0.0)).sphere(1.0, 16).pop();
    builder.material(Material { transmission: Vec3::splat(0.9), ior: 1.5, ..Material::matt(Vec3::ZERO) });
    builder.push().translate(Vec3::new(1.5, 1.0, 0.0)).sphere(1.0, 16).pop();
    builder.light(Light::directional(Vec3::new(-0.4, -1.0, -0.3), Vec3::splat(0.8)));
    builder.ambient(Vec3::splat(0.3));
    let camera =
        Camera { eye: Vec3::new(0.0, 1.5, 9.0), target: Vec3::new(0.5, 0.5, 0.0), up: Vec3::Y, fov_degrees: 50.0 };
    builder.camera(camera);
    builder.finish().unwrap()
}

fn picture(scene: &Scene, options: &TraceOptions, on_device: bool, samples: Samples) -> Film {
    let handle = device().filter(|_| on_device);
    let buffers = Arc::new(SceneBuffers::new(scene, options).unwrap());
    let mut tracer = open_tracer(handle.as_ref(), &buffers, options, 4, None).unwrap();
    let picture = Picture { camera: scene.camera.unwrap(), size: SIZE, samples, depth: 4, kill_weight: None };
    let film = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap().film;
    assert_eq!(film.non_finite(), 0);
    film
}

fn bits(film: &Film) -> Vec<[u32; 3]> {
    film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
}

/// Root of the mean squared difference in 8-bit steps.
fn difference(a: &Film, b: &Film) -> f64 {
    let shown = |c: f32| 255.0 * srgb_from_linear(f64::from(c.clamp(0.0, 1.0)));
    let (a, b) = (a.pixels.as_flattened(), b.pixels.as_flattened());
    (a.iter().zip(b).map(|(&a, &b)| (shown(a) - shown(b)).powi(2)).sum::<f64>() / a.len() as f64).sqrt()
}

#[test]
fn a_sample_of_a_footprint_is_near_the_mean_of_many_of_points() {
    // Texels from a tenth of a pixel to twenty of them. Measured: one sample errs by 0.18 and 0.27 of what it did, 16
    // by 0.51 and 0.58. What is left are outlines, and what the balls show, behind which cones are too narrow.
    for (tile, tiles) in [(dots(64, 64), 20.0), (dots(37, 21), 30.0)] {
        let scene = floor(tile, tiles);
        let truth = picture(&scene, &BILINEAR, false, Samples::PerPixel(256));
        let errors = |samples| {
            [FOOTPRINT, BILINEAR].map(|options| difference(&truth, &picture(&scene, &options, false, samples)))
        };
        let (one, many) = (errors(Samples::PerPixel(1)), errors(Samples::PerPixel(16)));
        eprintln!("one sample {one:?}, 16 samples {many:?}");
        assert!(one[0] < 0.3 * one[1], "one sample: {one:?}");
        assert!(many[0] < 0.65 * many[1], "16 samples: {many:?}");
        assert!(many[0] < one[0], "{one:?}, {many:?}");
    }
}

#[test]
fn where_a_texel_is_larger_than_a_pixel_nothing_changes() {
    let mut scene = floor(dots(5, 3), 20.0);
    // Onto the floor from near by: no pixel is as large as a texel, which is 0.6 wide.
    scene.camera = Some(Camera {
        eye: Vec3::new(8.0, 2.0, 8.0),
        target: Vec3::new(8.0, 0.0, 7.5),
        up: Vec3::Y,
        fov_degrees: 50.0,
    });
    let [footprint, bilinear] = [FOOTPRINT, BILINEAR].map(|o| bits(&picture(&scene, &o, false, Samples::PerPixel(1))));
    assert_eq!(footprint, bilinear);
    assert!(footprint.iter().collect::<std::collections::HashSet<_>>().len() > 1000, "colours are blended");
}

#[test]
fn device_and_twin_filter_alike_in_every_kernel() {
    if device().is_none() {
        return;
    }
    let scene = floor(dots(37, 64), 20.0);
    let all = [
        FOOTPRINT,
        TraceOptions { picture: PictureOptions { kernels: Kernels::Wavefront, ..FOOTPRINT.picture }, ..FOOTPRINT },
        TraceOptions { structure: Structure::of(StructureKind::Bvh8), packet_size: PacketSize::Sixteen, ..FOOTPRINT },
        BILINEAR,
        TraceOptions {
            picture: PictureOptions {
                kernels: Kernels::Wavefront,
                textures: TexturePass::HostPass,
                ..FOOTPRINT.picture
            },
            ..FOOTPRINT
        },
        TraceOptions { arrays: ArrayOptions { layout: Layout::Whole, ..FOOTPRINT.arrays }, ..FOOTPRINT },
        TraceOptions { structure: Structure::of(StructureKind::Instances), ..FOOTPRINT },
    ];
    // The first three are kinds of kernels; the others read what they read in other ways.
    let count = if is_thorough() { all.len() } else { 3 };
    for options in &all[..count] {
        for samples in [Samples::PerPixel(3), Samples::Error(2.0)] {
            let [ours, twins] = [true, false].map(|on_device| bits(&picture(&scene, options, on_device, samples)));
            let different = ours.iter().zip(&twins).filter(|(a, b)| a != b).count();
            assert_eq!(different, 0, "of {} pixels, {samples:?}, {options:?}", ours.len());
        }
    }
}

#[test]
fn one_colour_stays_one() {
    // Rounding apart: weights add up to one within 2^-22, and texels of all levels are the same 8-bit colour.
    let grey = Image { name: "grey".into(), width: 19, height: 64, rgba: vec![[120, 60, 200, 255]; 19 * 64] };
    let scene = floor(grey, 25.0);
    let pictures = [FOOTPRINT, BILINEAR].map(|options| picture(&scene, &options, false, Samples::PerPixel(1)));
    let apart = |(a, b): (&f32, &f32)| (a - b).abs() > 1e-5 * b.abs();
    let pixels = pictures.each_ref().map(|film| film.pixels.as_flattened());
    assert_eq!(pixels[0].iter().zip(pixels[1]).filter(|&pair| apart(pair)).count(), 0);
}

#[test]
fn coordinates_and_triangles_without_sense_have_colours() {
    let on_devices = if device().is_some() { vec![true, false] } else { vec![false] };
    let mut random = Random::new(SEED);
    let odd = [0.0, -0.0, 1e-45, -1e30, 3e38, 1e8, 0.5];
    for scale in [1.0, 1e-25, 1e25] {
        let mut builder = Builder::new();
        let diffuse_texture = Some(builder.add_texture(dots(16, 9)));
        builder.material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) });
        for i in 0..200 {
            let corner = random.vec3() * 3.0;
            // Needles, slivers and whole ones.
            let thin = [1.0, 1e-3, 1e-7][i % 3];
            let positions = [corner, corner + Vec3::X, corner + random.vec3() * thin].map(|p| p * scale);
            let uvs = [(); 3].map(|()| Vec2::new(odd[random.below(odd.len())], odd[random.below(odd.len())]));
            builder.mesh(&positions, Normals::Flat, &uvs, &[[0, 1, 2]]);
        }
        builder.light(Light::directional(Vec3::NEG_Z, Vec3::ONE)).ambient(Vec3::splat(0.2));
        builder.camera(Camera { eye: Vec3::Z * 9.0 * scale, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 50.0 });
        let scene = builder.finish().unwrap();
        let pictures: Vec<_> =
            on_devices.iter().map(|&on| picture(&scene, &FOOTPRINT, on, Samples::PerPixel(1))).collect();
        let twins = &pictures[pictures.len() - 1];
        assert_eq!(bits(&pictures[0]), bits(twins), "scale {scale}");
        assert!(twins.pixels.as_flattened().iter().all(|&c| (0.0..1.3).contains(&c)), "scale {scale}");
    }
}

#[test]
fn a_scene_that_was_packed_without_levels_is_refused() {
    let scene = floor(dots(8, 8), 10.0);
    let buffers = Arc::new(SceneBuffers::new(&scene, &BILINEAR).unwrap());
    let refused = open_tracer(None, &buffers, &FOOTPRINT, 4, None).map(|_| ());
    let Err(Error::Option { option, .. }) = &refused else { panic!("{refused:?}") };
    assert_eq!(*option, "texture_filter");
    // The other way round there is only more than needed, which changes nothing.
    let bilinear = picture(&scene, &BILINEAR, false, Samples::PerPixel(1));
    let buffers = Arc::new(SceneBuffers::new(&scene, &FOOTPRINT).unwrap());
    assert_eq!(buffers.textures.iter().map(|info| info.levels).collect::<Vec<_>>(), [4]);
    let mut tracer = open_tracer(None, &buffers, &BILINEAR, 4, None).unwrap();
    let samples = Samples::PerPixel(1);
    let same = Picture { camera: scene.camera.unwrap(), size: SIZE, samples, depth: 4, kill_weight: None };
    assert_eq!(bits(&render(tracer.as_mut(), &buffers, &same, &|_| ()).unwrap().film), bits(&bilinear));
    // Where there is no picture, there is nothing to have levels.
    let mut plain = scene;
    plain.materials.iter_mut().for_each(|material| material.diffuse_texture = None);
    let buffers = Arc::new(SceneBuffers::new(&plain, &BILINEAR).unwrap());
    assert!(open_tracer(None, &buffers, &FOOTPRINT, 4, None).is_ok());
}

#[test]
fn pictures_put_together_by_hand_are_checked() {
    let whole = dots(4, 3);
    let faulty = [
        (Image { width: 0, rgba: Vec::new(), ..whole.clone() }, "each side must lie between 1 and"),
        (Image { height: Image::MAX_SIDE + 1, ..whole.clone() }, "each side must lie between 1 and"),
        (Image { rgba: whole.rgba[1..].to_vec(), ..whole.clone() }, "has 11 of its 4 x 3 texels"),
    ];
    for (image, message) in faulty {
        let mut scene = floor(whole.clone(), 3.0);
        scene.textures[0] = Texture::Image(image);
        let Err(Error::Scene(told)) = SceneBuffers::new(&scene, &FOOTPRINT).map(|_| ()) else { panic!("{message}") };
        assert!(told.contains(message) && told.contains("'dots'"), "{told}");
    }
}
