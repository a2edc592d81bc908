//! Samples of pixels: camera rays through pixel corners, and more samples than one launch traces.

use crate::common::{device, quick_device};
use glam::Vec3;
use raybrook::low_level::options::{PacketSize, StructureKind, TraceOptions};
use raybrook::low_level::pack::{SceneBuffers, sample_positions};
use raybrook::low_level::reference::shade::camera::camera_direction;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{Background, Builder, Camera, Material, Samples, Scene, load};
use raybrook::low_level::shared::CameraSample;
use raybrook::low_level::tracer::RenderResult;
use std::sync::Arc;

fn ball() -> Scene {
    let mut builder = Builder::new();
    builder.material(Material::matt(Vec3::ONE)).sphere(1.0, 24);
    builder.camera(Camera { eye: Vec3::Z * 4.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 90.0 });
    builder.background(Background::default());
    let mut scene = builder.finish().unwrap();
    complete(&mut scene, 1.0);
    scene
}

#[test]
fn corner_rays_pass_exactly_through_the_rim() {
    let scene = ball();
    let buffers = SceneBuffers::new(&scene, &TraceOptions::DEFAULT).unwrap();
    assert_eq!(sample_positions(Samples::Corners), [CameraSample { x: 0.0, y: 0.0, footprint: 1.0 }]);
    // Towards -z at 90 degrees: x and y of the direction are the place in the picture, within the rounding of tan(45°).
    let params = buffers.render_params(&scene.camera.unwrap(), (513, 513), Samples::Corners, 1, None);
    assert_eq!((params.right.xyz(), params.up.xyz()), (Vec3::X, Vec3::Y));
    for i in 0..=512u16 {
        let at = f32::from(i) / 256.0 - 1.0;
        assert_eq!(camera_direction(&params, f32::from(i), f32::from(i)), Vec3::new(at, -at, -1.0));
    }
    // Rays are as far apart across as upwards: 4 x 2 intervals.
    let params = buffers.render_params(&scene.camera.unwrap(), (5, 3), Samples::Corners, 1, None);
    assert_eq!(camera_direction(&params, 0.0, 0.0), Vec3::new(-2.0, 1.0, -1.0));
    assert_eq!(camera_direction(&params, 4.0, 2.0), Vec3::new(2.0, -1.0, -1.0));
    assert_eq!(camera_direction(&params, 3.0, 1.0), Vec3::new(1.0, 0.0, -1.0));
}

fn picture_of(scene: &Scene, on_device: bool, size: (u32, u32), samples: Samples) -> raybrook::Result<RenderResult> {
    let options = TraceOptions::DEFAULT;
    let device = if on_device { device() } else { None };
    let buffers = Arc::new(SceneBuffers::new(scene, &options)?);
    let picture = Picture { camera: scene.camera.unwrap(), size, samples, depth: 3, kill_weight: None };
    let mut tracer = open_tracer(device.as_ref(), &buffers, &options, picture.depth, None)?;
    render(tracer.as_mut(), &buffers, &picture, &|_| ())
}

#[test]
fn device_and_twin_agree_and_the_middle_is_a_corner() {
    let scene = ball();
    let twin = picture_of(&scene, false, (33, 33), Samples::Corners).unwrap();
    let device = picture_of(&scene, true, (33, 33), Samples::Corners).unwrap();
    assert_eq!((device.counts, &device.film.pixels), (twin.counts, &twin.film.pixels));
    assert_eq!(twin.counts[0], 33 * 33);
    // The ball is symmetrical about the middle of the picture, and so are corner rays: as many hit it on either side.
    let lit = |x: usize| twin.film.pixels[x..].iter().step_by(33).filter(|p| p[0] != 0.05).count();
    let columns: Vec<_> = (0..33).map(lit).collect();
    assert!(columns[16] > 8 && columns.iter().eq(columns.iter().rev()), "{columns:?}");
}

#[test]
fn pictures_without_two_corners_are_refused() {
    let scene = ball();
    for (size, samples) in [
        ((1, 5), Samples::Corners),
        ((5, 1), Samples::Corners),
        ((0, 0), Samples::Corners),
        ((5, 5), Samples::PerPixel(0)),
        ((5, 5), Samples::PerPixel(65_537)),
    ] {
        let error = picture_of(&scene, false, size, samples).unwrap_err().to_string();
        assert!(error.starts_with("option samples: "), "{error}");
    }
    assert!(picture_of(&scene, false, (2, 2), Samples::Corners).is_ok());
}

#[test]
fn scene_files_can_ask_for_corners() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.toml");
    let load_image = |keys: &str| {
        std::fs::write(&path, format!("[image]\n{keys}")).unwrap();
        load(&path).map_err(|e| e.to_string())
    };
    assert_eq!(load_image("samples = \"corners\"\n").unwrap().picture.samples, Some(Samples::Corners));
    let error = load_image("width = 1\nheight = 9\nsamples = \"corners\"\n").unwrap_err();
    assert!(error.ends_with("a.toml:4: [image]: samples corners need a picture of at least 2x2, not 1x9"), "{error}");
    let error = load_image("samples = \"corner\"\n").unwrap_err();
    assert!(error.contains("a.toml:2:") && error.contains("did you mean 'corners'?"), "{error}");
}

/// More samples than one launch traces, also in packets, and of rays that are deferred: along the edges of a box.
#[test]
fn samples_of_several_launches_add_up() {
    let Some(device) = quick_device() else { return };
    let mut builder = Builder::new();
    builder.material(Material { mirror: Vec3::splat(0.4), ..Material::default() });
    builder.cuboid(Vec3::ONE);
    builder.quad(Vec3::new(-2.0, -0.5, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 2);
    let mut scene = builder.finish().unwrap();
    complete(&mut scene, 1.2);
    let picture = Picture {
        camera: scene.camera.unwrap(),
        size: (24, 20),
        samples: Samples::PerPixel(35),
        depth: 3,
        kill_weight: None,
    };
    for (accel, packet_size) in [(StructureKind::Bvh2, PacketSize::One), (StructureKind::Bvh8, PacketSize::Sixteen)] {
        let options = TraceOptions { packet_size, ..TraceOptions::of(accel) };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let [got, expected] = [Some(&device), None].map(|device| {
            let mut tracer = open_tracer(device, &buffers, &options, picture.depth, None).unwrap();
            let result = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap();
            (result.film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect::<Vec<_>>(), result.counts)
        });
        assert!(got == expected, "{accel} {packet_size}");
        assert_eq!(got.1[0], 24 * 20 * 35);
    }
}
