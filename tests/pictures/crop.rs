//! Parts of pictures have the bits of the whole one, whatever kernels render them.

use super::wavefront::{glass_house, one_light};
use crate::common::{device, usually_every};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::{
    Decisions, Kernels, PacketSize, PictureOptions, StructureKind, TexturePass, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Crop, Picture, open_tracer, render_part};
use raybrook::low_level::scene::Samples;
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
    let split = |textures| PictureOptions { kernels: Kernels::Wavefront, textures, ..roulette };
    let bvh8 = TraceOptions { packet_size: PacketSize::Sixteen, ..TraceOptions::of(StructureKind::Bvh8) };
    check_parts("reference", &TraceOptions { picture: roulette, ..kd }, None);
    check_parts("reference, counting", &TraceOptions { counters: true, ..kd }, None);
    let Some(device) = device() else { return };
    let all = [
        ("packets", TraceOptions { picture: roulette, ..bvh8 }),
        ("mega-kernel", TraceOptions { picture: roulette, ..kd }),
        (
            "decided by the device",
            TraceOptions { picture: PictureOptions { decisions: Decisions::Device, ..kd.picture }, ..kd },
        ),
        ("wavefront kernels", TraceOptions { picture: split(TexturePass::InKernel), ..kd }),
        ("host-pass", TraceOptions { picture: split(TexturePass::HostPass), ..kd }),
        ("counting", TraceOptions { counters: true, ..kd }),
    ];
    for (name, options) in usually_every(2, all) {
        check_parts(name, &options, Some(&device));
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
