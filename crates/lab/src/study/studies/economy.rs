//! What scenes need, what is chosen for them, and what that saves.

use super::super::lab::PictureVariant;
use super::super::outcome::Outcome;
use super::super::table::{Row, known, name, number, row};
use super::super::{Chart, ChartKind, Findings, Lab, Measured, Study, Table, scenes};
use super::pareto::fast_options;
use super::pictures::{WAITED, picture_scenes};
use super::{PICTURE, Verdict, by_scene, ratio_of};
use raybrook::Result;
use raybrook::low_level::device::{Looked, kernel_resources};
use raybrook::low_level::options::{
    KernelFeatures, PacketSize, PictureOptions, Structure, StructureKind, TraceOptions,
};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::complete;
use raybrook::low_level::scene::{Scene, TextureId};
use raybrook::low_level::shared::Feature;
use raybrook::low_level::shared::Material;
use serde_json::json;

pub const STUDY: Study = Study {
    name: "economy",
    title: "No more than a scene needs",
    claim: "What a scene does not need shall cost nothing: kernels have the features that it uses and no others; rays \
            go where they change the picture. The claim tested: the FLIP of 16 samples a pixel takes at most 40 % of \
            their rays.",
    own_shapes: None,
    source: include_str!("economy.rs"),
    measure: economy,
    judge: judge_economy,
};

/// Chains of rays in all pictures.
const DEPTH: u32 = 8;
/// Samples a pixel that the others are measured by.
const FIXED: u32 = 16;
/// The part of the rays of fixed samples that shall do.
const MOST_RAYS: f64 = 0.4;

/// The scenes of pictures, and one that needs nothing but a light.
fn economy_scenes(lab: &Lab) -> Result<Vec<(String, Scene)>> {
    let mut all = picture_scenes(lab)?;
    if lab.scenes.is_empty() {
        all.push(("boulder".to_owned(), scenes::named("boulder", lab.quick)?));
    }
    // With the light that pictures of them have.
    let (width, height) = lab.picture_size();
    all.iter_mut().for_each(|(_, scene)| complete(scene, width as f32 / height as f32));
    Ok(all)
}

fn economy(lab: &mut Lab) -> Result<Vec<Table>> {
    let options = fast_options(lab);
    let all = TraceOptions { picture: PictureOptions { features: KernelFeatures::All, ..options.picture }, ..options };
    let one = |label: &str, options| PictureVariant::new(label, options, 1, DEPTH);
    let errors: &[f32] = if lab.quick { &[1.0] } else { &[1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12] };
    let mut variants = vec![
        one(ONE, options),
        one(ONE_ALL, all),
        one(ONE_EVERY, options).without_killing(),
        PictureVariant::new(fixed_samples(), options, FIXED, DEPTH),
        PictureVariant::new("2 samples", options, 2, DEPTH),
        PictureVariant::new("4 samples", options, 4, DEPTH),
        PictureVariant::new("8 samples", options, 8, DEPTH),
    ];
    variants.extend(errors.iter().map(|&error| PictureVariant::of_error(options, error, DEPTH)));
    let (mut pictures, mut kernels, mut summary) = (Vec::new(), Vec::new(), Vec::new());
    for (scene_name, scene) in economy_scenes(lab)? {
        let rows = lab.pictures(&scene_name, &scene, &variants, Some((if lab.quick { 64 } else { 256 }, DEPTH)))?;
        // What kernels can do is no matter of the arrays.
        let buffers = lab.pack(&scene, &options)?;
        let taken = resources(lab, &scene_name, &buffers, [options, all])?;
        let table = Table::new("pictures", "", rows);
        summary.push(saved(&scene_name, &scene, &buffers, &options, &Pictures::of(&table)?, &taken));
        pictures.extend(table.rows);
        kernels.extend(taken);
    }
    let instances = instances(lab, options)?;
    Ok(vec![
        Table::new("saved", "Scenes: what they need, and what that saves", summary),
        Table::new("pictures", "Pictures: rays, time and error", pictures),
        Table::new("kernels", "What the kernel of pictures takes, with the scene's features and with all", kernels),
        Table::new("instances", "Instances: triangles of their own, or one copy of each object", instances),
    ])
}

fn judge_economy(found: &Measured) -> Result<Findings> {
    let mut saved = found.table("saved", &["scene"])?;
    let pictures = found.table("pictures", &PICTURE)?;
    let mut parts = Vec::new();
    let mut verdict = Verdict::default();
    for row in &mut saved.rows {
        let scene = name(row, "scene");
        let fixed = pictures.one(&[("scene", &scene), ("method", &fixed_samples())])?;
        let of_scene = pictures.rows.iter().filter(|row| name(row, "scene") == scene);
        let by_error: Vec<_> = of_scene.filter(|row| row.contains_key("asked")).collect();
        let Some(fixed) = fixed.filter(|fixed| fixed.contains_key("flip")) else {
            row.shift_remove("rays_at_flip");
            verdict.outcomes.push(Outcome::Undecided);
            parts.push(format!("{scene}: not measured"));
            continue;
        };
        let share = fewest_rays(fixed, &by_error);
        verdict.outcomes.push(Outcome::of(share.is_some_and(|share| share <= MOST_RAYS)));
        match share {
            Some(share) => row.insert("rays_at_flip".into(), json!(share)),
            None => row.shift_remove("rays_at_flip"),
        };
        parts.push(match share {
            Some(share) => format!("{scene}: {:.0} %", 100.0 * share),
            None => format!("{scene}: no picture is as good"),
        });
    }
    let fails = verdict.outcomes.iter().filter(|outcome| **outcome == Outcome::Fails).count();
    let (most, count) = (100.0 * MOST_RAYS, parts.len());
    let text = format!(
        "{fails} of {count} scenes take more than {most:.0} % of the rays of {FIXED} samples a pixel for their FLIP: \
         {}.",
        parts.join("; ")
    );
    let charts = by_scene(
        ChartKind::Front,
        &pictures,
        "pictures",
        "pictures a second against error",
        ["flip", "frames_per_s"],
        |chart: Chart| {
            chart.log(true, true).caption(
                "Exact hits; by the wall clock. The error is FLIP to the converged picture. Left and high is better.",
            )
        },
    );
    // Rays are counted, not timed: no spread is in the way. In a hurry the pictures are too small to tell.
    let outcome = if found.header.quick { Outcome::Undecided } else { verdict.all() };
    let notes = vec![WAITED.to_owned()];
    // Earlier versions had no instances.
    let is_further = |table: &&Table| ![&saved.name, &pictures.name].contains(&&table.name);
    let others: Vec<_> = found.tables.iter().filter(is_further).cloned().collect();
    let tables = [saved, pictures].into_iter().chain(others).collect();
    Ok(Findings { outcome, verdict: text, notes, tables, charts })
}

/// The picture that the others are measured by.
fn fixed_samples() -> String {
    format!("{FIXED} samples")
}

/// The fewest rays with which a picture by its error has the FLIP of fixed samples, of theirs; `None` if none has it.
fn fewest_rays(fixed: &Row, by_error: &[&Row]) -> Option<f64> {
    let flip = number(fixed, "flip")?;
    let as_good = by_error.iter().filter(|row| number(row, "flip").is_some_and(|other| other <= flip));
    as_good.filter_map(|row| ratio_of(row, fixed, "rays")).min_by(f64::total_cmp)
}

/// What it takes to make the triangles of all instances, and to leave them shared: scenes with instances as the
/// structure that is fastest without them, and as two levels. One sample a pixel; both have the same bits.
fn instances(lab: &mut Lab, options: TraceOptions) -> Result<Vec<Row>> {
    let scenes: Vec<_> = match (lab.scenes.is_empty(), lab.quick) {
        (false, _) => lab.scenes.iter().filter(|(_, scene)| !scene.instances.is_empty()).cloned().collect(),
        (true, true) => vec![("20 boulders".to_owned(), scenes::boulder_field(2, 20)?)],
        (true, false) => vec![
            ("100 boulders".to_owned(), scenes::boulder_field(4, 100)?),
            ("1000 boulders".to_owned(), scenes::boulder_field(4, 1000)?),
        ],
    };
    let one_by_one =
        TraceOptions { structure: Structure::of(StructureKind::Bvh2), packet_size: PacketSize::One, ..options };
    let shared = TraceOptions { structure: Structure::of(StructureKind::Instances), ..one_by_one };
    let mut all = vec![options];
    all.extend((one_by_one != options).then_some(one_by_one));
    all.push(shared);
    let variants: Vec<_> =
        all.iter().map(|options| PictureVariant::new(options.kind().name(), *options, 1, DEPTH)).collect();
    let mut rows = Vec::new();
    for (scene_name, mut scene) in scenes {
        complete(&mut scene, 1.0);
        let pictures = lab.pictures(&scene_name, &scene, &variants, None)?;
        for (mut out, options) in pictures.into_iter().zip(&all) {
            let buffers = lab.pack(&scene, options)?;
            out.extend(row([
                ("stored_triangles", json!(buffers.shading.len())),
                ("device_bytes", json!(buffers.size_bytes(options))),
                ("build_s", json!(buffers.build_s)),
            ]));
            rows.push(out);
        }
    }
    Ok(rows)
}

/// One sample a pixel: with the kernels for the scene, with those for all scenes, and with the rays that cannot change
/// a pixel.
const ONE: &str = "1 sample";
const ONE_ALL: &str = "1 sample, all features";
const ONE_EVERY: &str = "1 sample, every ray";

/// The rows of a scene's pictures; `None`: not measured.
struct Pictures<'a> {
    one: Option<&'a Row>,
    one_all: Option<&'a Row>,
    one_every: Option<&'a Row>,
    /// [`FIXED`] samples a pixel.
    fixed: Option<&'a Row>,
    /// By an error of 1.
    error_1: Option<&'a Row>,
}

impl Pictures<'_> {
    fn of(table: &Table) -> Result<Pictures<'_>> {
        let one = |method: &str| table.one(&[("method", method)]);
        Ok(Pictures {
            one: one(ONE)?,
            one_all: one(ONE_ALL)?,
            one_every: one(ONE_EVERY)?,
            fixed: one(&fixed_samples())?,
            error_1: one("error 1")?,
        })
    }
}

/// What the kernel for pictures takes with each of some options; of the first pass, which does nearly all of the work.
fn resources(lab: &Lab, scene_name: &str, buffers: &SceneBuffers, each: [TraceOptions; 2]) -> Result<Vec<Row>> {
    let Some(device) = lab.device else { return Ok(Vec::new()) };
    let mut rows = Vec::new();
    for options in each {
        (lab.progress)(&format!("{scene_name}: registers with the features of {}", options.picture.features));
        let programs = kernel_resources(device, buffers, &options, DEPTH, Looked::Pictures)?;
        let found = programs.first().and_then(|program| Some((program, program.kernels.first()?)));
        let Some((program, kernel)) = found else { continue };
        let mut out = row([
            ("scene", json!(scene_name)),
            ("features", json!(options.picture.features.name())),
            ("feature_count", json!(buffers.features.in_kernels(options.picture.features).iter().count())),
        ]);
        out.extend(known([
            ("registers", kernel.registers),
            ("frame_bytes", kernel.stack_frame_bytes),
            ("private_bytes", kernel.private_memory_bytes),
            ("binary_bytes", program.binary_bytes),
        ]));
        rows.push(out);
    }
    Ok(rows)
}

/// The row of a scene: what it needs, what is chosen, and ratios of what that takes to what it would take otherwise.
fn saved(
    scene_name: &str,
    scene: &Scene,
    buffers: &SceneBuffers,
    options: &TraceOptions,
    pictures: &Pictures,
    kernels: &[Row],
) -> Row {
    let Pictures { one, one_all, one_every, fixed, error_1 } = *pictures;
    let ratio = |a: Option<&Row>, b: Option<&Row>, column: &str| ratio_of(a?, b?, column);
    let error = |row: Option<&Row>| number(row?, "error");
    let of_kernels = |column: &str| match kernels {
        [of_scene, of_all] => ratio_of(of_scene, of_all, column),
        _ => None,
    };
    let triangle_count = scene.hittable().len();
    let mut out = row([
        ("scene", json!(scene_name)),
        ("triangles", json!(triangle_count)),
        ("needs", json!(buffers.features.to_string())),
        ("feature_count", json!(format!("{} of {}", buffers.features.iter().count(), Feature::ALL.len()))),
        ("method", json!(options.kind().name())),
        ("bytes_per_triangle", json!(buffers.size_bytes(options) as f64 / triangle_count.max(1) as f64)),
        ("unused_bytes", json!(unused_bytes(scene, buffers, options))),
    ]);
    out.extend(known([
        ("time_of_all", ratio(one, one_all, "wall_s")),
        ("private_of_all", of_kernels("private_bytes")),
        ("binary_of_all", of_kernels("binary_bytes")),
        ("rays_of_every", ratio(one, one_every, "rays")),
        ("rays_of_fixed", ratio(error_1, fixed, "rays")),
        ("time_of_fixed", ratio(error_1, fixed, "wall_s")),
        ("error", error(error_1)),
        ("error_of_fixed", error(fixed)),
    ]));
    out
}

/// Bytes of the scene's materials and textures (without smaller copies) that no triangle has, and of shading data that
/// nothing reads, as a device would hold them.
fn unused_bytes(scene: &Scene, buffers: &SceneBuffers, options: &TraceOptions) -> usize {
    let material_bytes = size_of::<Material>() * (scene.materials.len() - buffers.materials.len());
    let used = scene.used_materials();
    let is_used = |id: TextureId| used.iter().any(|&m| scene.materials[m as usize].diffuse_texture == Some(id));
    let unused_textures = (0..).zip(&scene.textures).filter(|(id, _)| !is_used(*id));
    let texels: usize = unused_textures.filter_map(|(_, texture)| texture.image()).map(|image| image.rgba.len()).sum();
    let shading_bytes = size_of_val(&buffers.shading[..]) - size_of_val(&buffers.arrange(options).shading[..]);
    material_bytes + size_of::<u32>() * texels + shading_bytes
}

#[cfg(test)]
mod tests {
    use super::super::rows_of::{header, judge};
    use super::*;

    #[test]
    fn the_flip_of_fixed_samples_must_be_reached_with_few_of_their_rays() {
        let picture = |scene: &str, method: &str, rays: u32, flip: f64| {
            let mut out =
                row([("scene", json!(scene)), ("method", json!(method)), ("rays", json!(rays)), ("flip", json!(flip))]);
            out.extend(method.starts_with("error").then(|| ("asked".to_owned(), json!(1.0))));
            out
        };
        let found = |rays: u32, flip: f64, is_quick: bool| {
            let pictures = vec![
                picture("s", &fixed_samples(), 1000, 0.1),
                picture("s", "1 sample", 10, 0.05),
                picture("s", "error 1", rays, flip),
                picture("s", "error 0.5", 900, 0.01),
                // Of another scene, and cheaper.
                picture("t", "error 1", 1, 0.0),
            ];
            let tables = vec![
                Table::new("saved", "", vec![row([("scene", json!("s"))])]),
                Table::new("pictures", "", pictures),
                Table::new("kernels", "", Vec::new()),
                Table::new("instances", "", Vec::new()),
            ];
            judge(&STUDY, tables, &header(is_quick)).unwrap()
        };
        let holds = found(300, 0.1, false);
        let share = number(&holds.tables[0].rows[0], "rays_at_flip");
        assert_eq!((holds.outcome, share), (Outcome::Holds, Some(0.3)));
        assert!(
            holds.verdict.starts_with("0 of 1 scenes") && holds.verdict.ends_with(": s: 30 %."),
            "{}",
            holds.verdict
        );
        let fails = found(500, 0.1, false);
        assert!(fails.outcome == Outcome::Fails && fails.verdict.starts_with("1 of 1 scenes"), "{}", fails.verdict);
        assert!(found(300, 0.2, false).verdict.ends_with("s: 90 %."));
        assert_eq!(found(300, 0.1, true).outcome, Outcome::Undecided);
    }
}
