//! `raybrook tune`: measures what is fastest on a device, prints it, and remembers it for later runs.

use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::{DeviceArgs, MemoryArgs, Talk, open, print};
use raybrook::Result;
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::choose::SceneSize;
use raybrook::low_level::choose::tune::{
    DeviceKey, Measured, Plan, SceneTuning, TunedFile, Tuning, scene_of, tune_scene,
};
use raybrook::low_level::device::cache_folder;
use raybrook::low_level::options::{PacketSize, StructureKind};
use raybrook::low_level::scene::Scene;
use serde::Serialize;
use std::path::{Path, PathBuf};

#[derive(clap::Args)]
pub struct TuneArgs {
    /// Scenes to measure in, as for render [default: four made in code, of 38 to 990,002 triangles].
    #[arg(value_name = "SCENE")]
    scenes: Vec<PathBuf>,
    /// Camera rays; as many shadow and diffuse rays start where they hit [default: 262144, rounded down to the next
    /// square of a power of two].
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(i64::from(Plan::LEAST_RAYS)..=i64::from(Plan::MOST_RAYS)),
    )]
    rays: Option<u32>,
    #[arg(
        long,
        help = format!(
            "Structures to measure, with every packet size, beside what the program takes by itself: {} [default: \
             all; brute, boxes and spheres only up to {} triangles]",
            StructureKind::names(),
            Plan::MOST_FOR_LISTS
        ),
        alias = "accel",
        value_name = "NAMES",
        value_delimiter = ',',
    )]
    structure: Vec<StructureKind>,
    /// Print JSON.
    #[arg(long)]
    json: bool,
    /// Measure nothing: remove what is remembered, of all devices.
    #[arg(long, conflicts_with_all = ["scenes", "rays", "structure", "json", "no_cache", "compiler_options"])]
    forget: bool,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    memory: MemoryArgs,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Report<'a> {
    device: &'a DeviceKey,
    scenes: &'a [SceneTuning],
    fastest: &'a [Tuning],
    remembered: Option<PathBuf>,
}

pub fn run(args: &TuneArgs, talk: Talk) -> Result<Code> {
    let file = cache_folder().map(TunedFile::in_folder);
    if args.forget {
        return forget(file, talk);
    }
    let defaults = Plan::default();
    let plan = Plan {
        structures: if args.structure.is_empty() { defaults.structures } else { args.structure.clone() },
        rays: args.rays.unwrap_or(defaults.rays),
        memory: args.memory.memory_limit.map(MemoryBudget::of_bytes),
        ..defaults
    };
    let file = file.filter(|_| !args.device.no_cache);
    // Before minutes of measurements, not after them.
    file.as_ref().map_or(Ok(()), TunedFile::check_writable)?;
    let device = open::choose(&args.device, talk)?;
    let budget = args.memory.budget();
    let cache = args.device.cache()?;
    let progress = |what: &str| {
        if !talk.quiet {
            tell!("{what}");
        }
    };
    let mut scenes = Vec::new();
    for source in Source::all(&args.scenes) {
        let (name, scene) = (source.name(), source.scene(&budget, talk)?);
        scenes.push(tune_scene(device.as_ref(), cache.as_ref(), (&name, &scene), &plan, &progress)?);
    }
    let key = DeviceKey::new(device.as_ref().map(|device| &device.info));
    let fastest = Tuning::of(&scenes);
    let differing: usize = scenes.iter().map(SceneTuning::differing).sum();
    let file = file.filter(|_| differing == 0);
    if let Some(note) = file.as_ref().map(|file| file.remember(&key, &fastest)).transpose()?.flatten() {
        progress(&format!("note: {note}"));
    }
    let remembered = file.map(|file| file.path().to_owned());
    if args.json {
        let report = Report { device: &key, scenes: &scenes, fastest: &fastest, remembered };
        print::json(&report);
    } else if !talk.quiet {
        scenes.iter().for_each(print_scene);
        print_fastest(&fastest, remembered);
    }
    if differing > 0 {
        tell!(
            "raybrook: {differing} answers differ between structures, so nothing is remembered; `raybrook check` and \
             `raybrook stress` tell more"
        );
        return Ok(FOUND_A_DIFFERENCE);
    }
    Ok(SUCCESS)
}

fn forget(file: Option<TunedFile>, talk: Talk) -> Result<Code> {
    let forgotten = match &file {
        Some(file) => file.forget()?.then(|| file.path()),
        None => None,
    };
    if !talk.quiet {
        match forgotten {
            Some(path) => say!("removed {}", path.display()),
            None => say!("nothing was remembered"),
        }
    }
    Ok(SUCCESS)
}

/// Where a scene comes from; it is loaded or made when its turn comes.
enum Source<'a> {
    File(&'a Path),
    Made(SceneSize),
}

impl Source<'_> {
    fn all(paths: &[PathBuf]) -> Vec<Source<'_>> {
        match paths {
            [] => SceneSize::ALL.into_iter().map(Source::Made).collect(),
            paths => paths.iter().map(|path| Source::File(path)).collect(),
        }
    }

    fn name(&self) -> String {
        match self {
            Source::File(path) => path.display().to_string(),
            Source::Made(size) => size.to_string(),
        }
    }

    fn scene(&self, budget: &MemoryBudget, talk: Talk) -> Result<Scene> {
        match self {
            Source::File(path) => open::load_with_objects(path, false, budget, talk).map(|loaded| loaded.scene),
            Source::Made(size) => scene_of(*size),
        }
    }
}

/// A table of a scene's candidates, in million rays a second.
fn print_scene(scene: &SceneTuning) {
    let [camera, shadow, diffuse] = scene.rays;
    say!(
        "{}: {} triangles ({}); Mrays/s of {camera} camera, {shadow} shadow and {diffuse} diffuse rays",
        scene.scene,
        scene.triangle_count,
        scene.size
    );
    say!("  structure  packets    camera    shadow   diffuse   ratio  build s");
    for (i, measured) in scene.measured.iter().enumerate() {
        let Measured { candidate, mrays_per_s: [camera, shadow, diffuse], ratio, build_s, differing, .. } = measured;
        let packets = if candidate.packet_size == PacketSize::One { "-" } else { candidate.packet_size.name() };
        let accel = candidate.structure.name();
        let model = if i == 0 { "  taken by default" } else { "" };
        let wrong = if *differing > 0 { format!("  {differing} DIFFERENT ANSWERS") } else { String::new() };
        say!(
            "  {accel:9}  {packets:>7}  {camera:8.2}  {shadow:8.2}  {diffuse:8.2}  {ratio:6.2}  \
             {build_s:7.3}{model}{wrong}"
        );
    }
}

fn print_fastest(fastest: &[Tuning], remembered: Option<PathBuf>) {
    for Tuning { size, fastest, ratio, model, .. } in fastest {
        match fastest == model {
            true => say!("{size}: {fastest}: nothing is clearly faster"),
            false => say!("{size}: {fastest}: {ratio:.2} times the speed of {model}"),
        }
    }
    if let Some(path) = remembered {
        say!("remembered in {}", path.display());
    }
}
