//! What every command that traces does first: load the scene, choose the device, build, compile, upload.

use super::flags::{self, in_flags};
use super::{DeviceArgs, PictureArgs, SceneArgs, Talk};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::choose::{Chosen, Decision, camera_decisions};
use raybrook::low_level::device::{DeviceHandle, Selection, select_working};
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{
    Crop, DEFAULT_SIZE, build_and_open_within, complete_as, picture_bytes, picture_bytes_by_rows,
};
use raybrook::low_level::scene::{self, Camera, Light, Placed, Samples, Scene};
use raybrook::low_level::stats::RunStats;
use raybrook::low_level::tracer::{Backend, Task};
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// Warnings that are printed without `-v`; the rest are counted.
const WARNINGS_SHOWN: usize = 10;

/// A scene that is loaded.
pub struct Loaded {
    /// The scene.
    pub scene: Scene,
    /// Where its camera comes from, part by part, if it was given one.
    pub camera: Vec<Decision>,
    /// Its camera as it was placed, if it was given one.
    pub placed: Option<Placed>,
    /// Whether it has no light of its own: pictures add some, of which a lamp goes with the camera.
    pub has_added_light: bool,
    /// Seconds.
    pub load_s: f64,
}

impl Loaded {
    /// The lamp that was added to a scene without light, in a picture from `camera`.
    pub fn added_lamp(&self, camera: &Camera) -> Option<Light> {
        let placed = self.placed.as_ref().filter(|_| self.has_added_light)?;
        Some(self.scene.default_light.lamp(camera, placed.room_lamp()))
    }
}

/// Loads the scene that is asked for, which must have objects unless it may be empty, and gives it what it needs to be
/// rendered: a camera, light, a size and samples, which `args` override.
pub fn load_for_picture(scene: &SceneArgs, args: &PictureArgs, budget: &MemoryBudget, talk: Talk) -> Result<Loaded> {
    args.camera.aim().check()?;
    let mut loaded = load_with_objects(&scene.scene, scene.allow_empty, budget, talk)?;
    let start = Instant::now();
    let placed = complete_for_picture(&mut loaded.scene, &scene.scene, Some(args))?;
    loaded.camera = flags::decisions(camera_decisions(&placed).to_vec());
    loaded.placed = Some(placed);
    loaded.load_s += start.elapsed().as_secs_f64();
    Ok(loaded)
}

/// Loads a scene for rays alone, which need neither camera nor light.
pub fn load_for_rays(path: &Path, may_be_empty: bool, budget: &MemoryBudget, talk: Talk) -> Result<Loaded> {
    let mut loaded = load_with_objects(path, may_be_empty, budget, talk)?;
    loaded.scene.lights.clear();
    Ok(loaded)
}

/// Loads a scene that must have objects unless it `may_be_empty`.
pub fn load_with_objects(path: &Path, may_be_empty: bool, budget: &MemoryBudget, talk: Talk) -> Result<Loaded> {
    let loaded = load(path, budget, talk)?;
    if loaded.scene.triangle_count() == 0 && !may_be_empty {
        let message =
            "has no objects, so that there is nothing to see or to hit; is it whole? --allow-empty takes it as it is";
        return Err(Error::input(path, None, message));
    }
    Ok(loaded)
}

/// Loads a scene that must have objects, for pictures and rays of any size.
pub fn load_completed(path: &Path, budget: &MemoryBudget, talk: Talk) -> Result<Scene> {
    let mut scene = load_with_objects(path, false, budget, talk)?.scene;
    complete_for_picture(&mut scene, path, None)?;
    Ok(scene)
}

fn complete_for_picture(scene: &mut Scene, path: &Path, args: Option<&PictureArgs>) -> Result<Placed> {
    let size = args.and_then(|args| args.size).or(scene.picture.size).unwrap_or(DEFAULT_SIZE);
    let samples = args.and_then(PictureArgs::samples).or(scene.picture.samples).unwrap_or(Samples::DEFAULT);
    samples.check(size)?;
    (scene.picture.size, scene.picture.samples) = (Some(size), Some(samples));
    let aim = args.map(|args| args.camera.aim()).unwrap_or_default();
    let placed = complete_as(scene, samples.aspect(size) as f32, &aim);
    if !(placed.camera.eye.is_finite() && placed.camera.target.is_finite()) {
        return Err(cannot_be_framed(scene, path));
    }
    placed.check(&aim)?;
    Ok(placed)
}

/// Why there is no place for a camera: which vertex is too far away.
fn cannot_be_framed(scene: &Scene, path: &Path) -> Error {
    let reach = |i: u32| scene.vertices(i as usize).map(|p| p.abs().max_element()).into_iter().fold(0.0, f32::max);
    let farthest = scene.hittable().into_iter().max_by(|&a, &b| reach(a).total_cmp(&reach(b)));
    let Some(primitive) = farthest else { return Error::input(path, None, "cannot be framed") };
    let corners = scene.vertices(primitive as usize);
    let corner = (0..3).max_by(|&a, &b| corners[a].abs().max_element().total_cmp(&corners[b].abs().max_element()));
    let position = corners[corner.unwrap_or(0)];
    let vertex = scene.triangles.get(primitive as usize).map(|t| t.positions[corner.unwrap_or(0)] as usize);
    let line = vertex.and_then(|vertex| scene::line_of_vertex(path, vertex));
    let message = format!(
        "the vertex ({:e}, {:e}, {:e}) of triangle {primitive} is so far away that no camera which shows the scene has \
         a place in float32's range; correct it, make the scene smaller, or give a camera by --eye and --target",
        position.x, position.y, position.z
    );
    Error::input(path, line, message)
}

/// Loads a scene as it is, and prints its warnings.
pub fn load(path: &Path, budget: &MemoryBudget, talk: Talk) -> Result<Loaded> {
    let start = Instant::now();
    let scene = scene::load_within(path, budget)?;
    check_list(&scene, path, budget)?;
    if !talk.quiet {
        let shown = if talk.verbose { scene.warnings.len() } else { WARNINGS_SHOWN };
        for warning in scene.warnings.iter().take(shown) {
            tell!("warning: {}", in_flags(&warning.to_string()));
        }
        if scene.warnings.len() > shown {
            tell!("warning: {} more; -v shows them", scene.warnings.len() - shown);
        }
    }
    let (has_added_light, load_s) = (!scene.has_light(), start.elapsed().as_secs_f64());
    Ok(Loaded { scene, camera: Vec::new(), placed: None, has_added_light, load_s })
}

/// Checks that there is memory for the numbers of all triangles, which instances can make many of.
fn check_list(scene: &Scene, path: &Path, budget: &MemoryBudget) -> Result<()> {
    let what = format!("{}: the list of {} triangles", path.display(), scene.triangle_count());
    let bytes = size_of::<u32>() as u64 * scene.triangle_count() as u64;
    budget.check(&Need {
        what: &what,
        bytes,
        decided_by: DecidedBy::Input,
        remedy: "take fewer instances, or raise --memory-limit",
    })
}

/// Checks that there is memory for a picture, and so many bytes beside it.
pub fn check_picture(
    (size, more_bytes): ((u32, u32), u64),
    samples: Samples,
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
    format: ImageFormat,
    budget: &MemoryBudget,
) -> Result<()> {
    check_bytes(size, picture_bytes(size, samples, options, device, Some(format)) + more_bytes, budget)
}

/// The same of a picture that is written by rows, or only kept where there is no `format`.
pub fn check_picture_by_rows(
    (size, crop): ((u32, u32), Option<Crop>),
    samples: Samples,
    options: &TraceOptions,
    devices: (Option<&DeviceHandle>, usize),
    format: Option<ImageFormat>,
    budget: &MemoryBudget,
) -> Result<()> {
    check_bytes(size, picture_bytes_by_rows((size, crop), samples, options, devices, format), budget)
}

fn check_bytes(size: (u32, u32), bytes: u64, budget: &MemoryBudget) -> Result<()> {
    let what = format!("a picture of {}x{} pixels", size.0, size.1);
    let remedy = "lower --size (a scene file's width and height), or raise --memory-limit";
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy })
}

/// A chosen device; `None` is the reference. Says which devices do not open, where nobody named one.
pub fn choose(args: &DeviceArgs, talk: Talk) -> Result<Option<DeviceHandle>> {
    let (selection, notes) = select_working(args.device.as_deref())?;
    for note in notes.iter().filter(|_| !talk.quiet) {
        tell!("note: {}", in_flags(note));
    }
    taken(selection, args, talk)
}

/// What was selected, with the options for its compiler; `None` is the reference.
pub fn taken(selection: Selection, args: &DeviceArgs, talk: Talk) -> Result<Option<DeviceHandle>> {
    Ok(match selection {
        Selection::OpenCl(device) => Some(args.compiler.apply(device)?),
        Selection::Reference { .. } if args.compiler.compiler_options.is_some() => {
            let message = "the reference has no compiler; leave it out, or choose an OpenCL device";
            return Err(Error::option("--compiler-options", message));
        }
        Selection::Reference { notice } => {
            if let Some(notice) = notice.filter(|_| !talk.quiet) {
                tell!("note: {}", in_flags(&notice));
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
    pub tracer: Box<dyn Backend>,
    /// Filled in as far as it is known.
    pub stats: RunStats,
}

impl Opened {
    /// Puts into the statistics of a run what the tracer knows at its end, with its seconds of device time.
    pub fn note_times(&self, kernel_s: Vec<f64>, stats: &mut RunStats, talk: Talk) {
        stats.kernel_s = device_times(self.tracer.as_ref(), kernel_s, talk);
        // The second pass is compiled when it is needed, and everything waits for it.
        let compile_s = self.tracer.compile_s();
        let later_s = compile_s - stats.compile_s.unwrap_or(compile_s);
        stats.wait_s = stats.wait_s.map(|wait_s| wait_s + later_s);
        stats.compile_s = Some(compile_s);
        stats.lost.extend(self.tracer.lost().cloned());
        stats.set_rate();
    }
}

/// Builds, uploads, and compiles what the `tasks` need.
pub fn open(
    loaded: &Loaded,
    device: Option<&DeviceHandle>,
    args: &DeviceArgs,
    Chosen { options, decisions, .. }: Chosen,
    depth: u32,
    (tasks, budget): (&[Task], &MemoryBudget),
    talk: Talk,
) -> Result<Opened> {
    let cache = args.cache()?;
    let start = Instant::now();
    let (buffers, tracer) =
        build_and_open_within(device, &loaded.scene, &options, depth, cache.as_ref(), tasks, budget)?;
    let wait_s = (start.elapsed().as_secs_f64() - buffers.build_s - tracer.upload_s()).max(0.0);
    if talk.verbose {
        for note in tracer.notes() {
            tell!("note: {}", in_flags(note));
        }
        tell!(
            "{}: {} triangles in {}, load {:.3} s, build {:.3} s, compile {:.3} s, upload {:.3} s",
            tracer.device_name(),
            loaded.scene.triangle_count(),
            options.kind(),
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
        spatial_splits: buffers.splits_chosen,
        load_s: Some(loaded.load_s),
        build_s: Some(buffers.build_s),
        compile_s: Some(tracer.compile_s()),
        wait_s: Some(wait_s),
        upload_s: Some(tracer.upload_s()),
        triangle_count: loaded.scene.triangle_count() as u64,
        ..RunStats::default()
    };
    Ok(Opened { buffers, tracer, stats })
}

/// Seconds of device time for the statistics: none, with a note, where the device does not tell them.
pub fn device_times(tracer: &dyn Backend, seconds: Vec<f64>, talk: Talk) -> Vec<f64> {
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
