//! `raybrook info`.

use super::explain::ExplainArgs;
use super::{MethodArgs, SceneArgs, Talk, flags, open, print};
use raybrook::Result;
use raybrook::low_level::accel::{KdTree, SplitsChosen, StructureStats, TreeStats};
use raybrook::low_level::choose::{Decision, Source, numbers_in_effect};
use raybrook::low_level::options::{StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::scene::{DropReason, Object, Texture};
use raybrook_lab::cross_check::{Compared, CrossCheck, cross_check};
use serde::Serialize;

#[derive(clap::Args)]
pub struct InfoArgs {
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    explain: ExplainArgs,
    /// Read an .obj file by another reader, too (the crate `tobj`), and tell what differs and why.
    #[arg(long)]
    cross_check: bool,
    /// Print JSON.
    #[arg(long)]
    json: bool,
}

/// What is in a scene.
#[derive(Serialize)]
struct SceneInfo {
    triangles: usize,
    instances: usize,
    stored_triangles: usize,
    dropped_not_finite: usize,
    dropped_zero_area: usize,
    vertices: usize,
    normals: usize,
    texture_coordinates: usize,
    materials: usize,
    textures: usize,
    texels: usize,
    lights: usize,
    low: [f32; 3],
    high: [f32; 3],
    load_s: f64,
    build_s: f64,
    device_bytes: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    tree: Option<TreeStats>,
    #[serde(skip_serializing_if = "Option::is_none")]
    structure: Option<StructureStats>,
    #[serde(skip_serializing_if = "Option::is_none")]
    spatial_splits: Option<SplitsChosen>,
    #[serde(skip_serializing_if = "Option::is_none")]
    cross_check: Option<CrossCheck>,
}

pub fn run(args: &InfoArgs, talk: Talk) -> Result<()> {
    let options = args.method.options(StructureKind::Kd, false)?;
    let budget = args.scene.memory.budget();
    let mut loaded = open::load(&args.scene.scene, &budget, talk)?;
    // No picture is made of it.
    let lights = std::mem::take(&mut loaded.scene.lights);
    let scene = &loaded.scene;
    // First: a file that it cannot be asked of is refused before a structure is built.
    let cross_check = match args.cross_check {
        true => Some(cross_check(&args.scene.scene, scene, &budget)?),
        false => None,
    };
    let buffers = SceneBuffers::within(scene, &options, &budget)?;
    let reasons: Vec<_> = (0..scene.triangle_count()).filter_map(|i| scene.drop_reason(i)).collect();
    let dropped = |reason: DropReason| reasons.iter().filter(|&&r| r == reason).count();
    let (low, high) = scene.bounds().unwrap_or_default();
    args.explain(&options, scene.triangle_count() - reasons.len(), talk);
    let of_objects =
        |count: fn(&Object) -> usize| -> usize { scene.instances.objects().iter().map(|object| count(object)).sum() };
    let info = SceneInfo {
        cross_check,
        triangles: scene.triangle_count(),
        instances: scene.instances.placed().len(),
        stored_triangles: buffers.shading.len(),
        dropped_not_finite: dropped(DropReason::NotFinite),
        dropped_zero_area: dropped(DropReason::ZeroArea),
        vertices: scene.positions.len() + of_objects(|object| object.positions.len()),
        normals: scene.normals.len() + of_objects(|object| object.normals.len()),
        texture_coordinates: scene.uvs.len() + of_objects(|object| object.uvs.len()),
        materials: scene.materials.len(),
        textures: scene.textures.len(),
        texels: scene.textures.iter().filter_map(Texture::image).map(|image| image.rgba.len()).sum(),
        lights: lights.len(),
        low: low.to_array(),
        high: high.to_array(),
        load_s: loaded.load_s,
        build_s: buffers.build_s,
        device_bytes: buffers.size_bytes(&options),
        spatial_splits: buffers.splits_chosen,
        structure: (!matches!(options.kind(), StructureKind::Kd | StructureKind::Brute)).then(|| {
            let triangle_count = scene.triangle_count() - reasons.len();
            StructureStats::new(options.kind(), &buffers.nodes, &buffers.references, &buffers.bounds, triangle_count)
        }),
        tree: (options.kind() == StructureKind::Kd).then(|| {
            let bounds =
                raybrook::low_level::accel::Aabb { low: buffers.params.low.xyz(), high: buffers.params.high.xyz() };
            let tree = KdTree { nodes: buffers.nodes, references: buffers.references, bounds };
            TreeStats::new(&tree, &buffers.build_options)
        }),
    };
    if args.json {
        print::json(&info);
    } else {
        print_info(&info);
        info.cross_check.iter().for_each(say_cross_check);
    }
    Ok(())
}

impl InfoArgs {
    /// Explains the structure that is told of, and the numbers of its build.
    fn explain(&self, options: &TraceOptions, triangle_count: usize, talk: Talk) {
        let (source, reason) = match self.method.has_structure() {
            true => (Source::Given, ""),
            false => (Source::Model, "info tells of kd-trees, or of what other options are for"),
        };
        let structure = Decision {
            option: StructureKind::OPTION.into(),
            value: options.kind().to_string(),
            source,
            reason: reason.to_owned(),
        };
        let decisions = [vec![structure], numbers_in_effect(options, triangle_count)].concat();
        self.explain.print(&flags::decisions(decisions), talk);
    }
}

/// What another reader has made of the file.
fn say_cross_check(check: &CrossCheck) {
    if check.agrees() {
        say!("cross-check: tobj reads the same {} triangles", check.triangles);
        return;
    }
    match (&check.tobj_error, check.tobj_triangles) {
        (Some(error), _) => say!("cross-check: tobj cannot read the file: {error}"),
        (None, Some(count)) if count != check.triangles => {
            say!("cross-check: raybrook reads {} triangles, tobj {count}", check.triangles);
        }
        _ => say!("cross-check: both readers have {} triangles", check.triangles),
    }
    for Compared { what, differing, first } in &check.compared {
        let first = first.map_or(String::new(), |first| format!(", first of triangle {first}"));
        say!("  {what}: {differing} differ{first}");
    }
    for reason in &check.reasons {
        say!("  perhaps because {}", reason.about());
    }
    if check.reasons.is_empty() {
        say!("  the file has nothing that tobj is known to read otherwise: please report it");
    }
}

/// The JSON's fields as lines, so that text and JSON cannot tell different things.
fn print_info(info: &SceneInfo) {
    fn print(prefix: &str, value: &serde_json::Value) {
        match value {
            serde_json::Value::Object(fields) => fields.iter().for_each(|(name, value)| {
                print(
                    &if prefix.is_empty() {
                        name.replace('_', " ")
                    } else {
                        format!("{prefix} {}", name.replace('_', " "))
                    },
                    value,
                );
            }),
            serde_json::Value::Array(values) => {
                let values: Vec<_> = values.iter().map(ToString::to_string).collect();
                say!("{prefix:32} {}", values.join("  "));
            }
            value => say!("{prefix:32} {value}"),
        }
    }
    let mut values = serde_json::to_value(info).expect("numbers and names serialise");
    values.as_object_mut().map(|fields| fields.shift_remove("cross_check")); // has words of its own
    print("", &values);
}
