//! What scenes need, what is chosen for them, and what that saves.

use super::super::lab::PictureVariant;
use super::super::table::{Row, name, number, row};
use super::super::{Chart, ChartKind, Findings, Lab, Study, Table, scenes};
use super::by_scene;
use super::pareto::fast_options;
use crate::device::kernel_resources;
use crate::error::Result;
use crate::features::{Feature, Features};
use crate::options::{KernelFeatures, TraceOptions};
use crate::pack::SceneBuffers;
use crate::scene::Scene;
use crate::session::complete;
use serde_json::json;

pub const STUDY: Study = Study {
    name: "economy",
    title: "No more than a scene needs",
    claim: "What a scene does not need shall cost nothing: kernels have the features that it uses and no others; rays go where they change the \
            picture. The claim tested: the FLIP of 16 samples a pixel takes at most 40 % of their rays.",
    run: economy,
};

/// Chains of rays in all pictures.
const DEPTH: u32 = 8;
/// Samples a pixel that the others are measured by.
const FIXED: u32 = 16;
/// The part of the rays of fixed samples that shall do.
const MOST_RAYS: f64 = 0.4;

/// The user's scenes, or some that need little and some that need much.
fn economy_scenes(lab: &Lab) -> Result<Vec<(String, Scene)>> {
    if !lab.scenes.is_empty() {
        return Ok(lab.scenes.to_vec());
    }
    let (levels, detail) = if lab.quick { (2, 12) } else { (6, 96) };
    let mut own = vec![
        ("boulder".to_owned(), scenes::boulder(levels)?),
        ("still life".to_owned(), scenes::still_life(detail, false)?),
    ];
    if !lab.quick {
        own.push(("still life of marble and wood".to_owned(), scenes::still_life(detail, true)?));
        own.push(("still life with glass".to_owned(), scenes::glass_still_life(detail)?));
    }
    // With the light that pictures of them have.
    own.iter_mut().for_each(|(_, scene)| complete(scene, 1.0));
    Ok(own)
}

fn economy(lab: &mut Lab) -> Result<Findings> {
    let options = fast_options(lab);
    let all = TraceOptions { features: KernelFeatures::All, ..options };
    let one = |label: &str, options| PictureVariant::new(label, options, 1, DEPTH);
    let errors: &[f32] = if lab.quick { &[1.0] } else { &[1.0, 0.5, 0.25, 0.15] };
    let of_error = |&error| PictureVariant::of_error(format!("error {error}"), options, error, DEPTH);
    let mut variants = vec![
        one(ONE, options),
        one(ONE_ALL, all),
        one(ONE_EVERY, options).without_killing(),
        PictureVariant::new(FIXED_LABEL, options, FIXED, DEPTH),
    ];
    variants.extend(errors.iter().map(of_error));
    let (mut pictures, mut kernels, mut summary) = (Vec::new(), Vec::new(), Vec::new());
    for (scene_name, scene) in economy_scenes(lab)? {
        let rows = lab.pictures(&scene_name, &scene, &variants, Some((if lab.quick { 64 } else { 256 }, DEPTH)))?;
        let taken = resources(lab, &scene_name, &scene, [options, all])?;
        summary.push(saved(&scene_name, &scene, &options, &rows, &taken)?);
        pictures.extend(rows);
        kernels.extend(taken);
    }
    let shares: Vec<_> = summary.iter().map(|row| (name(row, "scene"), number(row, "rays_at_flip"))).collect();
    let told = shares.iter().map(|(scene, share)| match share {
        Some(share) => format!("{scene}: {:.0} %", 100.0 * share),
        None => format!("{scene}: no picture is as good"),
    });
    let verdict = format!(
        "Rays with which the FLIP of {FIXED} samples a pixel is reached, of theirs: {}.",
        told.collect::<Vec<_>>().join("; ")
    );
    let table = Table::new("pictures", "Pictures: rays, time and error", pictures);
    let charts = by_scene(
        ChartKind::Front,
        &table,
        "pictures",
        "pictures a second against error",
        ["flip", "frames_per_s"],
        |chart: Chart| {
            chart.log(true, true).caption(
                "Exact hits; kernel time. The error is FLIP to the converged picture. Left and high is better.",
            )
        },
    );
    Ok(Findings {
        holds: (!lab.quick).then(|| shares.iter().all(|(_, share)| share.is_some_and(|share| share <= MOST_RAYS))),
        verdict,
        notes: vec![
            "Seconds are the device's; of pictures by their error the host decides between the rounds, which takes further time.".to_owned(),
        ],
        tables: vec![
            Table::new("saved", "Scenes: what they need, and what that saves", summary),
            table,
            Table::new("kernels", "What the kernel of pictures takes, with the scene's features and with all", kernels),
        ],
        charts,
    })
}

const ONE: &str = "1 sample";
const ONE_ALL: &str = "1 sample, all features";
const ONE_EVERY: &str = "1 sample, every ray";
const FIXED_LABEL: &str = "16 samples";

/// What kernels for pictures take with each of some options; of the first pass, which does nearly all of the work.
fn resources(lab: &Lab, scene_name: &str, scene: &Scene, each: [TraceOptions; 2]) -> Result<Vec<Row>> {
    let Some(device) = lab.device else { return Ok(Vec::new()) };
    let mut rows = Vec::new();
    for options in each {
        (lab.progress)(&format!("{scene_name}: registers with the features of {}", options.features));
        let buffers = SceneBuffers::new(scene, &options)?;
        let programs = kernel_resources(device, &buffers, &options, DEPTH)?;
        let is_picture = |name: &str| name.starts_with("render");
        // Packets have a program of their own, behind that of single rays.
        let programs: Vec<_> =
            programs.iter().filter(|program| program.kernels.iter().any(|k| is_picture(&k.kernel))).collect();
        let first_pass = if options.packet_size == crate::options::PacketSize::Sixteen { 1 } else { 0 };
        let Some(program) = programs.get(first_pass) else { continue };
        let Some(kernel) = program.kernels.iter().find(|kernel| is_picture(&kernel.kernel)) else { continue };
        let features = match options.features {
            KernelFeatures::Scene => buffers.features,
            _ => Features::ALL,
        };
        let mut out = row([
            ("scene", json!(scene_name)),
            ("features", json!(options.features.name())),
            ("feature_count", json!(features.iter().count())),
        ]);
        let numbers = [
            ("registers", kernel.registers),
            ("frame_bytes", kernel.stack_frame_bytes),
            ("private_bytes", kernel.private_memory_bytes),
            ("binary_bytes", program.binary_bytes),
        ];
        out.extend(numbers.into_iter().filter_map(|(name, value)| Some((name.to_owned(), json!(value?)))));
        rows.push(out);
    }
    Ok(rows)
}

/// The row of a scene: what it needs, what is chosen, and ratios of what that takes to what it would take otherwise.
fn saved(scene_name: &str, scene: &Scene, options: &TraceOptions, pictures: &[Row], kernels: &[Row]) -> Result<Row> {
    let buffers = SceneBuffers::new(scene, options)?;
    let of = |method: &str, column: &str| {
        pictures.iter().find(|row| name(row, "method") == method).and_then(|row| number(row, column))
    };
    let ratio = |a: (&str, &str), b: (&str, &str)| Some(of(a.0, a.1)? / of(b.0, b.1)?);
    let error_1 = "error 1";
    let flip_of_fixed = of(FIXED_LABEL, "flip");
    let as_good = pictures.iter().filter(|row| {
        name(row, "method").starts_with("error") && number(row, "flip").is_some_and(|flip| Some(flip) <= flip_of_fixed)
    });
    let fewest_rays = as_good.filter_map(|row| number(row, "rays")).min_by(f64::total_cmp);
    let of_kernels = |column: &str| {
        let [of_scene, of_all] = [0, 1].map(|i| kernels.get(i).and_then(|row| number(row, column)));
        Some(of_scene? / of_all?)
    };
    let mut out = row([
        ("scene", json!(scene_name)),
        ("triangles", json!(scene.hittable().len())),
        ("needs", json!(buffers.features.to_string())),
        ("feature_count", json!(format!("{} of {}", buffers.features.iter().count(), Feature::ALL.len()))),
        ("method", json!(options.accel.name())),
        ("bytes_per_triangle", json!(buffers.size_bytes(options) as f64 / scene.hittable().len().max(1) as f64)),
        ("unused_bytes", json!(unused_bytes(scene, &buffers))),
    ]);
    let ratios = [
        ("time_of_all", ratio((ONE, "seconds"), (ONE_ALL, "seconds"))),
        ("private_of_all", of_kernels("private_bytes")),
        ("binary_of_all", of_kernels("binary_bytes")),
        ("rays_of_every", ratio((ONE, "rays"), (ONE_EVERY, "rays"))),
        ("rays_of_fixed", ratio((error_1, "rays"), (FIXED_LABEL, "rays"))),
        ("time_of_fixed", ratio((error_1, "seconds"), (FIXED_LABEL, "seconds"))),
        ("error", of(error_1, "error")),
        ("error_of_fixed", of(FIXED_LABEL, "error")),
        ("rays_at_flip", fewest_rays.zip(of(FIXED_LABEL, "rays")).map(|(fewest, fixed)| fewest / fixed)),
    ];
    out.extend(ratios.into_iter().filter_map(|(name, value)| Some((name.to_owned(), json!(value?)))));
    Ok(out)
}

/// Bytes of the scene's materials and textures that no triangle has, as a device would hold them.
fn unused_bytes(scene: &Scene, buffers: &SceneBuffers) -> usize {
    let material_bytes = size_of::<crate::shared::Material>() * (scene.materials.len() - buffers.materials.len());
    let texels: usize = scene.textures.iter().filter_map(|texture| texture.image()).map(|image| image.rgba.len()).sum();
    material_bytes + size_of::<u32>() * (texels - buffers.texels.len())
}
