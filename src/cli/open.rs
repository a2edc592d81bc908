//! What every command that traces does first: load the scene, choose the device, build, compile, upload.

use super::{DeviceArgs, PictureArgs, Talk};
use raybrook::device::{DeviceHandle, Selection, select_working};
use raybrook::options::Chosen;
use raybrook::pack::SceneBuffers;
use raybrook::scene::{self, Samples, Scene};
use raybrook::session::{build_and_open, complete};
use raybrook::stats::RunStats;
use raybrook::tracer::{Task, Tracer};
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Warnings that are printed without `-v`; the rest are counted.
const WARNINGS_SHOWN: usize = 10;

/// A scene that is loaded and has a camera and light.
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Seconds.
    pub load_s: f64,
}

/// Size of a picture that neither the scene nor an option sizes.
const DEFAULT_SIZE: (u32, u32) = (1024, 768);

/// Loads a scene, prints its warnings, and gives it what it needs to be rendered: also a size and samples, which `args` override.
pub fn load(path: &Path, args: Option<&PictureArgs>, talk: Talk) -> Result<Loaded> {
    let start = Instant::now();
    let mut scene = scene::load(path)?;
    if !talk.quiet {
        let shown = if talk.verbose { scene.warnings.len() } else { WARNINGS_SHOWN };
        for warning in scene.warnings.iter().take(shown) {
            tell!("warning: {warning}");
        }
        if scene.warnings.len() > shown {
            tell!("warning: {} more; -v shows them", scene.warnings.len() - shown);
        }
    }
    let size = args.and_then(|a| a.size).or(scene.picture.size).unwrap_or(DEFAULT_SIZE);
    let samples = args.and_then(PictureArgs::samples).or(scene.picture.samples).unwrap_or(Samples::DEFAULT);
    samples.check(size)?;
    (scene.picture.size, scene.picture.samples) = (Some(size), Some(samples));
    complete(&mut scene, samples.aspect(size) as f32);
    Ok(Loaded { scene, load_s: start.elapsed().as_secs_f64() })
}

/// A chosen device; `None` is the reference. Says which devices do not open, where nobody named one.
pub fn choose(args: &DeviceArgs, talk: Talk) -> Result<Option<DeviceHandle>> {
    let (selection, notes) = select_working(args.device.as_deref())?;
    for note in notes.iter().filter(|_| !talk.quiet) {
        tell!("note: {note}");
    }
    Ok(match selection {
        Selection::OpenCl(device) => Some(args.compiler.apply(device)?),
        Selection::Reference { .. } if args.compiler.compiler_options.is_some() => {
            let message = "the reference has no compiler; leave it out, or choose an OpenCL device";
            return Err(Error::option("--compiler-options", message));
        }
        Selection::Reference { notice } => {
            if let Some(notice) = notice.filter(|_| !talk.quiet) {
                tell!("note: {notice}");
            }
            None
        }
    })
}

/// Everything that tracing needs, and what it took.
pub struct Opened {
    /// The packed scene.
    pub buffers: Arc<SceneBuffers>,
    /// Ready to trace.
    pub tracer: Box<dyn Tracer>,
    /// Filled in as far as it is known.
    pub stats: RunStats,
}

/// Builds, uploads, and compiles what the `tasks` need.
pub fn open(
    loaded: &Loaded,
    device: Option<&DeviceHandle>,
    args: &DeviceArgs,
    Chosen { options, decisions, .. }: Chosen,
    depth: u32,
    tasks: &[Task],
    talk: Talk,
) -> Result<Opened> {
    let cache = args.cache()?;
    let (buffers, tracer) = build_and_open(device, &loaded.scene, &options, depth, cache.as_ref(), tasks)?;
    if talk.verbose {
        for note in tracer.notes() {
            tell!("note: {note}");
        }
        tell!(
            "{}: {} triangles in {}, load {:.3} s, build {:.3} s, compile {:.3} s, upload {:.3} s",
            tracer.device_name(),
            loaded.scene.triangle_count(),
            options.accel,
            loaded.load_s,
            buffers.build_s,
            tracer.compile_s(),
            tracer.upload_s()
        );
    }
    let stats = RunStats {
        device: tracer.device_name().to_owned(),
        compiler_options: device.map(|d| d.compiler_options().to_owned()).filter(|options| !options.is_empty()),
        device_kind: device.map_or("reference", |d| d.info.kind.name()).to_owned(),
        options,
        choices: decisions,
        load_s: Some(loaded.load_s),
        build_s: Some(buffers.build_s),
        compile_s: Some(tracer.compile_s()),
        upload_s: Some(tracer.upload_s()),
        triangle_count: loaded.scene.triangle_count() as u64,
        ..RunStats::default()
    };
    Ok(Opened { buffers, tracer, stats })
}

/// Seconds of device time for the statistics: none, with a note, where the device does not tell them.
pub fn device_times(tracer: &dyn Tracer, seconds: Vec<f64>, talk: Talk) -> Vec<f64> {
    if tracer.has_clock() {
        return seconds;
    }
    if !talk.quiet {
        tell!("note: device '{}' does not time its commands: there are no rates", tracer.device_name());
    }
    Vec::new()
}

/// `, 1.23 Mrays/s`, where the device tells its times.
pub fn rate(stats: &RunStats) -> String {
    match stats.kernel_s.is_empty() {
        true => String::new(),
        false => format!(", {:.2} Mrays/s", stats.mrays_per_s.unwrap_or_default()),
    }
}

/// `path` with the stem of `scene` and another ending, in the current folder.
pub fn default_output(scene: &Path, ending: &str) -> Result<PathBuf> {
    let stem = scene.file_stem().ok_or_else(|| Error::input(scene, None, "not the name of a file"))?;
    let mut name = stem.to_owned();
    name.push(ending);
    Ok(PathBuf::from(name))
}

/// Tells that an output has another name than it would have by itself.
pub fn note_name(output: &Path, wanted: &Path, talk: Talk) {
    if output != wanted && !talk.quiet {
        let (output, wanted) = (output.display(), wanted.display());
        tell!("note: the picture is '{output}': '{wanted}' belongs to the scene or is written for another option");
    }
}
