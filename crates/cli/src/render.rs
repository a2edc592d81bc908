//! `raybrook render`.

use super::code::{Code, SUCCESS};
use super::display::DisplayArgs;
use super::explain::{Chooser, ExplainArgs};
use super::files::{self, Files};
use super::keep::{Canvas, KeepArgs, Keeper, LazyId, journal_of};
use super::layers::LayerArgs;
use super::limit::{Limit, LimitArgs};
use super::loss::LossArgs;
use super::open::{Loaded, Opened};
use super::part::PartChoice;
use super::picture_file::PictureFileArgs;
use super::progress::Bar;
use super::several::{self, Built};
use super::{DeviceArgs, MethodArgs, PictureArgs, SceneArgs, Talk, heading, open, work};
use raybrook::low_level::budget::MemoryBudget;
use raybrook::low_level::choose::Chosen;
use raybrook::low_level::compare::compare_films;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::film::{Film, ImageFormat, check_output};
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::planes::PlaneGroup;
use raybrook::low_level::renderer::{
    Crop, DEFAULT_DEPTH, Part, Picture, PictureBlocks, PictureId, render_full, render_part_noting,
};
use raybrook::low_level::rows::PutRows;
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::stats::{FullPicture, RayCounts, RunStats, WorkStats};
use raybrook::low_level::tracer::{Backend, MOST_SAMPLES, RenderResult, Spent, Task};
use raybrook::low_level::work::WorkSum;
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};
use std::time::Instant;

#[derive(clap::Args)]
pub struct RenderArgs {
    #[command(flatten)]
    picture: PictureArgs,
    #[command(flatten)]
    method: MethodArgs,
    #[command(flatten)]
    scene: SceneArgs,
    #[command(flatten)]
    device: DeviceArgs,
    #[command(flatten)]
    loss: LossArgs,
    /// Picture to write: .png (sRGB), .exr or .pfm (linear) [default: the scene's name with .png].
    ///
    /// The default is in this folder, and has -render.png where .png is one of the scene's files.
    #[arg(short, long, value_name = "FILE", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    #[command(flatten)]
    file: PictureFileArgs,
    /// Part of the picture to render, WxH pixels from column X and row Y on.
    ///
    /// Its pixels are those of the whole picture, bit for bit. With --samples nothing else is rendered. With --error
    /// the blocks are that have pixels in it: where samples go is decided for each block, whose patches are strewn over
    /// an area of about 2048x2048 pixels.
    #[arg(long, help_heading = heading::PICTURE, hide_short_help = true, value_name = "X,Y,WxH")]
    crop: Option<Crop>,
    /// Render part I of N alone, for `raybrook merge`: into OUT.part-I-of-N, by as many machines as there are parts.
    ///
    /// Every Nth block of the picture, or every Nth area of a large one. `auto` takes I and N from what runs the
    /// program: an array of Slurm jobs (SLURM_ARRAY_TASK_ID), or ranks of Slurm, Open MPI, or PMI. Such a file is a
    /// journal, so that the same command goes on after whatever stopped it.
    #[arg(
        long,
        help_heading = heading::OUTPUT,
        hide_short_help = true,
        value_name = "I/N|auto",
        conflicts_with_all = ["counters", "layers", "aov", "measure_error", "stats"],
    )]
    part: Option<PartChoice>,
    #[command(flatten)]
    keep: KeepArgs,
    #[command(flatten)]
    limit: LimitArgs,
    #[command(flatten)]
    display: DisplayArgs,
    #[command(flatten)]
    explain: ExplainArgs,
    /// Count the work on every ray: steps, leaves, tests, bytes, ... (slower; the picture stays the same).
    #[arg(long, hide_short_help = true, help_heading = heading::DIAGNOSIS)]
    counters: bool,
    #[command(flatten)]
    layers: LayerArgs,
    /// Render the full picture, too, with 256 samples in each pixel, and tell what error the one that is written has
    /// against it.
    #[arg(long, hide_short_help = true, conflicts_with = "crop", help_heading = heading::DIAGNOSIS)]
    measure_error: bool,
    /// Write device, options, ray counts and times to a JSON file.
    #[arg(long, value_name = "FILE", help_heading = heading::OUTPUT)]
    stats: Option<PathBuf>,
}

impl PictureArgs {
    /// What the options ask for, if anything.
    pub fn samples(&self) -> Option<Samples> {
        self.error.map(Samples::Error).or(self.samples)
    }

    /// The picture that the scene asks for, with what the options override. The scene is completed.
    pub fn picture(&self, scene: &Scene) -> Picture {
        Picture {
            camera: scene.camera.expect("a completed scene has a camera"),
            size: scene.picture.size.expect("a completed scene has a size"),
            samples: scene.picture.samples.expect("a completed scene has samples"),
            depth: self.depth.or(scene.picture.depth).unwrap_or(DEFAULT_DEPTH),
            kill_weight: self.kill_weight,
        }
    }
}

impl RenderArgs {
    /// The name of the picture: the one that is given, or the first one like `wanted` that takes nothing from `files`,
    /// which are read.
    fn output(&self, wanted: &Path, format: ImageFormat, part: Option<Part>, mut files: Files) -> Result<PathBuf> {
        files.write_if(self.stats.as_deref(), "--stats")?;
        let claim = |output: PathBuf| {
            let mut files = files.clone();
            files.write(&output, "-o")?;
            files.write(&journal_of(&output, part), "-o, on its way,")?;
            self.layers.claim(&output, format, &mut files).map(|()| output)
        };
        match &self.output {
            Some(output) => claim(output.clone()),
            None => files::first_free(wanted, "render", claim),
        }
    }
}

impl RenderArgs {
    /// Whether finished blocks are kept: of pictures of which no more is told than their pixels.
    fn is_kept(&self) -> bool {
        !self.counters && !self.layers.wants_counters() && !self.layers.wants_sampling()
    }

    /// Where the pixels of a picture go.
    fn canvas(&self, (size, samples): ((u32, u32), Samples), part: Option<Part>) -> Canvas {
        let size = self.crop.map_or(size, |crop| crop.size);
        match part {
            Some(_) => Canvas::Journal,
            // What is told of all pixels beside their light is in memory, too.
            None if !self.is_kept() || self.layers.any() || self.measure_error => Canvas::Film,
            None => self.keep.canvas(size, samples),
        }
    }
}

/// Renders a picture of which more is told than its pixels, and which is not kept on its way.
fn render_noting(
    opened: &mut Opened,
    picture: &Picture,
    crop: Option<Crop>,
    notes_sampling: bool,
    talk: Talk,
) -> Result<RenderResult> {
    let bar = Bar::new("render", talk);
    let (width, height) = crop.map_or(picture.size, |crop| crop.rendered_size(picture.size, picture.samples));
    let camera_rays = f64::from(width) * f64::from(height) * f64::from(picture.samples.per_pixel());
    let progress = |done: f64| bar.update(done, camera_rays / 1e6, "M camera rays");
    render_part_noting(opened.tracer.as_mut(), &opened.buffers, picture, crop, notes_sampling, &progress)
}

/// Once a picture has this error, every pixel of it has a value that tells what is there: for the time being.
const COARSE_ERROR: f32 = 8.0;

/// The picture that is rendered before the one that is asked for, where the time for that may not suffice: so many
/// times coarser that it takes a small part of the rays.
fn coarse(picture: &Picture) -> Picture {
    const TIMES: f32 = 4.0;
    let error = match picture.samples {
        Samples::Error(error) => (TIMES * error).clamp(COARSE_ERROR, Samples::MOST_ERROR),
        _ => COARSE_ERROR,
    };
    Picture { samples: Samples::Error(error), ..*picture }
}

/// The coarse picture that is rendered first where the time for a picture may be up before it is finished.
///
/// # Errors
/// [`Error::Stopped`] when the time is up already.
fn coarse_within(
    limit: Limit,
    crop: Option<Crop>,
    (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
    picture: &Picture,
    talk: Talk,
) -> Result<RenderResult> {
    let bar = Bar::new("coarse picture", talk);
    let progress = |done: f64| {
        limit.check();
        bar.update(done, 1.0, "pictures");
    };
    let coarse = coarse(picture);
    let render = || render_part_noting(tracer, buffers, &coarse, crop, false, &progress);
    limit.within(render)?.ok_or(Error::Stopped)
}

/// Writes what there is of a picture whose time is up: the coarse one, and on it the blocks that are finished.
fn write_so_far(
    mut so_far: RenderResult,
    args: &RenderArgs,
    (output, format): (&Path, ImageFormat),
    keeper: &Keeper,
    talk: Talk,
) -> Result<()> {
    let (done, of) = keeper.put_so_far(&mut so_far.film)?;
    args.file.finish(&mut so_far.film, &output.display().to_string(), talk)?;
    so_far.film.write(output, Some(format))?;
    if !talk.quiet {
        let error = so_far.adaptive.map_or(0.0, |adaptive| adaptive.estimated_error);
        tell!(
            "note: {done} of {of} blocks of '{}' are finished; the others are coarse, with an error of about \
             {error:.1} steps of 8-bit sRGB",
            output.display()
        );
    }
    Ok(())
}

pub fn run(args: &RenderArgs, talk: Talk) -> Result<Code> {
    let start = Instant::now();
    let limit = args.limit.begin(start);
    let (job, files) = Job::new(args, limit, talk)?;
    let (loaded, output) = job.load(files)?;
    let mut rendering = Rendering::begin(&job, &loaded, &output)?;
    let rendered = match rendering.render_all() {
        Err(Error::Stopped) if limit.is_over() => {
            rendering.write_so_far()?;
            return Ok(limit.end(talk));
        }
        other => other?,
    };
    match job.part {
        Some(part) => rendering.keeper.map_or(Ok(()), |keeper| keeper.finish_part(part, talk))?,
        None => rendering.finish(rendered, start)?,
    }
    Ok(SUCCESS)
}

impl RenderArgs {
    /// Whether the work on rays is counted.
    fn counts_work(&self) -> bool {
        self.counters || self.layers.wants_counters()
    }

    /// Refuses options that do not go together.
    fn check(&self, limit: Limit) -> Result<()> {
        if limit.is_set() && (self.counts_work() || self.layers.any()) {
            let message = "work is counted and layers are traced of pictures that are finished; leave out one of both";
            return Err(Error::option(limit.option(), message));
        }
        if self.display.is_given() && !self.is_kept() {
            let message =
                "a picture whose work or samples are told is not shown while it is rendered; leave out one of both";
            return Err(Error::option("--display", message));
        }
        Ok(())
    }

    /// Refuses names of files that cannot be written.
    fn check_files(&self, wanted: &Path, format: ImageFormat, part: Option<Part>, files: Files) -> Result<()> {
        let output = self.output(wanted, format, part, files)?;
        check_output(&output, Some(format))?;
        self.layers.check_writable(&output, format)?;
        self.stats.as_deref().map_or(Ok(()), check_writable)
    }

    /// The devices that are asked for, and the seconds that finding them took.
    fn devices(&self, talk: Talk) -> Result<(Vec<Option<DeviceHandle>>, f64)> {
        let start = Instant::now();
        let devices = several::choose(&self.device, talk)?;
        if devices.len() > 1 && (self.counts_work() || self.measure_error || self.layers.any()) {
            let message = "work is counted, errors are measured and layers are traced on one device; name one";
            return Err(Error::option("--device", message));
        }
        Ok((devices, start.elapsed().as_secs_f64()))
    }
}

/// What is known before the scene is read.
struct Job<'a> {
    args: &'a RenderArgs,
    limit: Limit,
    /// Those for no scene and no device in particular.
    options: TraceOptions,
    part: Option<Part>,
    /// The picture's name, if it takes nothing from the scene's files.
    wanted: PathBuf,
    format: ImageFormat,
    devices: Vec<Option<DeviceHandle>>,
    /// Seconds that finding them took.
    device_s: f64,
    budget: MemoryBudget,
    talk: Talk,
}

impl<'a> Job<'a> {
    /// Checks the options and finds the devices; with the files that are read.
    fn new(args: &'a RenderArgs, limit: Limit, talk: Talk) -> Result<(Job<'a>, Files)> {
        args.check(limit)?;
        let options = args.method.check(args.counts_work())?;
        let part = args.part.map(PartChoice::part).transpose()?;
        let wanted = match &args.output {
            Some(path) => path.clone(),
            None => open::default_output(&args.scene.scene, ".png")?,
        };
        let format = args.file.format(&wanted)?;
        args.layers.check(format)?;
        let mut files = Files::default();
        files.read(&args.scene.scene, "the scene");
        args.check_files(&wanted, format, part, files.clone())?;
        let (devices, device_s) = args.devices(talk)?;
        let budget = args.scene.memory.budget();
        Ok((Job { args, limit, options, part, wanted, format, devices, device_s, budget, talk }, files))
    }

    /// The first device; `None` is the reference.
    fn device(&self) -> Option<&DeviceHandle> {
        self.devices.first().and_then(Option::as_ref)
    }

    /// A picture whose time may be up has a coarse one beside it.
    fn has_coarse(&self) -> bool {
        self.limit.is_set() && self.part.is_none()
    }

    fn canvas(&self, size: (u32, u32), samples: Samples) -> Canvas {
        self.args.canvas((size, samples), self.part)
    }

    /// Refuses a picture that there is no memory for, and a part that lies outside of it.
    fn check_picture(&self, size: (u32, u32), samples: Samples) -> Result<()> {
        let Job { args, options, format, budget, .. } = self;
        args.crop.map_or(Ok(()), |crop| crop.check(size))?;
        if self.canvas(size, samples) != Canvas::Film && !self.has_coarse() {
            let (of, format) = ((size, args.crop), self.part.is_none().then_some(*format));
            let devices = (self.device(), self.devices.len());
            return open::check_picture_by_rows(of, samples, options, devices, format, budget);
        }
        let layer_bytes = args.layers.bytes(args.crop.map_or(size, |crop| crop.size));
        let size = args.crop.map_or(size, |crop| crop.rendered_size(size, samples));
        open::check_picture((size, layer_bytes), samples, options, self.device(), *format, budget)
    }

    /// The scene, and the name of the picture, which is none of the scene's files.
    fn load(&self, mut files: Files) -> Result<(Loaded, PathBuf)> {
        let Job { args, wanted, budget, talk, .. } = self;
        if let Some(size) = args.picture.size {
            self.check_picture(size, args.picture.samples().unwrap_or(Samples::PerPixel(1)))?;
        }
        let loaded = open::load_for_picture(&args.scene, &args.picture, budget, *talk)?;
        files.read_scene(&loaded.scene);
        let output = args.output(wanted, self.format, self.part, files)?;
        open::note_name(&output, wanted, *talk);
        if args.measure_error && loaded.scene.picture.samples == Some(Samples::Corners) {
            let message =
                "rays through corners are no samples of pixels; leave it out, or ask for --samples N or --error E";
            return Err(Error::option("--measure-error", message));
        }
        Ok((loaded, output))
    }

    /// The methods that each device uses for the scene.
    fn choose_methods(&self, loaded: &Loaded) -> Result<Vec<Chosen>> {
        let Job { args, talk, .. } = self;
        let chooser = Chooser {
            counters: args.counts_work(),
            pictures: true,
            ..Chooser::new((&args.method, &args.device, &args.explain), self.device(), *talk)
        };
        several::choose_methods(&chooser, &self.devices, loaded)
    }
}

/// A picture on its way.
struct Rendering<'a> {
    job: &'a Job<'a>,
    loaded: &'a Loaded,
    output: &'a Path,
    picture: Picture,
    blocks: PictureBlocks,
    /// Whether the file is written while the picture is rendered.
    is_by_rows: bool,
    /// Those of each device, until they are used.
    chosen: Vec<Chosen>,
    keeper: Option<Keeper<'a>>,
    /// Where there is one device.
    opened: Option<Opened>,
    /// The coarse picture, for when the time is up.
    coarse: Option<RenderResult>,
}

/// A picture, its times, and the seconds that were spent on writing it.
type Rendered = ((RenderResult, RunStats), f64);

impl<'a> Rendering<'a> {
    /// Chooses the methods, and opens what keeps the picture on its way.
    fn begin(job: &'a Job<'a>, loaded: &'a Loaded, output: &'a Path) -> Result<Self> {
        let (args, talk) = (job.args, job.talk);
        let chosen = job.choose_methods(loaded)?;
        let picture = args.picture.picture(&loaded.scene);
        job.check_picture(picture.size, picture.samples)?;
        args.layers.check_samples(picture.samples)?;
        let blocks = PictureBlocks::new(picture.size, picture.samples, args.crop);
        let canvas = job.canvas(picture.size, picture.samples);
        let is_by_rows = canvas != Canvas::Film && job.part.is_none();
        let (scene, of_first) = (&loaded.scene, chosen[0].options);
        let id = move || PictureId::new(scene, &picture, args.crop, &of_first);
        let keeper = match args.is_kept() {
            true => {
                let of = (LazyId::new(Box::new(id)), blocks, canvas);
                let display = args.display.open(output, blocks.size(), talk)?;
                Some(Keeper::open((&args.keep, job.limit), (output, job.part), of, (display, talk))?)
            }
            false => None,
        };
        let (opened, coarse) = (None, None);
        Ok(Rendering { job, loaded, output, picture, blocks, is_by_rows, chosen, keeper, opened, coarse })
    }

    /// Renders the picture, and writes it where that is done by rows.
    fn render_all(&mut self) -> Result<Rendered> {
        let Job { args, format, talk, .. } = self.job;
        match self.is_by_rows {
            true => {
                let (of, size) = ((self.output, *format), self.blocks.size());
                let (rendered, write_s) = args.file.write_rows(of, size, |put| self.render(Some(put)), *talk)?;
                // Not what was written while other rows were traced.
                let taking_s = rendered.0.taking_s.unwrap_or(f64::INFINITY);
                Ok((rendered, write_s.min(taking_s)))
            }
            false => self.render(None).map(|rendered| (rendered, 0.0)),
        }
    }

    fn render(&mut self, rows: Option<PutRows>) -> Result<(RenderResult, RunStats)> {
        let Rendering { job, loaded, picture, chosen, keeper, opened, coarse, .. } = self;
        let Job { args, devices, limit, budget, talk, .. } = job;
        let has_coarse = job.has_coarse() && keeper.as_ref().is_some_and(Keeper::has_rest);
        let render_coarse = |tracer: &mut dyn Backend, buffers: &SceneBuffers| {
            coarse_within(*limit, args.crop, (tracer, buffers), picture, *talk)
        };
        match keeper {
            Some(keeper) if devices.len() > 1 => {
                let built = Built::new(loaded, (devices, chosen), budget)?;
                let mut by = built.devices(&args.device, (Task::Picture, picture.depth), args.loss)?;
                if has_coarse {
                    *coarse = several::with_first(&mut by, render_coarse)?;
                }
                let (result, shares, lost) = keeper.render_by(by, (picture, rows), (args.loss, *talk))?;
                Ok((result, built.stats(shares, lost)))
            }
            keeper => {
                let (tasks, chosen) = ((args.layers.tasks(), budget), chosen.swap_remove(0));
                let one = open::open(loaded, job.device(), &args.device, chosen, picture.depth, tasks, *talk)?;
                let opened = opened.insert(args.loss.strict_if(args.counts_work()).guard(one, job.device(), *talk));
                job.check_picture(picture.size, picture.samples)?;
                let result = match keeper {
                    Some(keeper) => {
                        if has_coarse {
                            *coarse = Some(render_coarse(opened.tracer.as_mut(), &opened.buffers)?);
                        }
                        limit.within(|| keeper.render(opened, picture, rows, *talk))?.ok_or(Error::Stopped)?
                    }
                    None => render_noting(opened, picture, args.crop, args.layers.wants_sampling(), *talk)?,
                };
                Ok((result, std::mem::take(&mut opened.stats)))
            }
        }
    }

    /// Writes what there is of the picture when its time is up.
    fn write_so_far(self) -> Result<()> {
        let Job { args, format, talk, .. } = self.job;
        let Some((coarse, keeper)) = self.coarse.zip(self.keeper.as_ref()) else { return Ok(()) };
        write_so_far(coarse, args, (self.output, *format), keeper, *talk)
    }

    /// Traces the layers, writes what is not written yet, and tells what was rendered.
    fn finish(mut self, ((mut result, mut stats), mut write_s): Rendered, start: Instant) -> Result<()> {
        let (args, of, talk) = (self.job.args, (self.output, self.job.format), self.job.talk);
        let tracing_layers = Instant::now();
        let layers = self.trace_layers(&result)?;
        stats.layers_s = args.layers.any().then(|| tracing_layers.elapsed().as_secs_f64());
        if !self.is_by_rows {
            args.file.finish(&mut result.film, &self.output.display().to_string(), talk)?;
            let writing = Instant::now();
            args.layers.write(of, &result, layers, talk)?;
            write_s = writing.elapsed().as_secs_f64();
        }
        let earlier = self.keeper.as_ref().map_or_else(Spent::default, Keeper::earlier);
        self.keeper.take().map_or(Ok(()), Keeper::finish)?;

        stats.write_s = Some(write_s);
        stats.device_s = Some(self.job.device_s);
        stats.materials = args.layers.materials(&self.loaded.scene);
        take_note(&mut stats, &result, &self.picture);
        if let Some(pixels) = &result.work {
            stats.work = Some(WorkStats {
                camera: WorkSum::new(stats.rays.camera.cast, pixels.iter().map(|pixel| pixel.camera)),
                all: WorkSum::new(
                    stats.rays.total_cast(),
                    pixels.iter().flat_map(|pixel| [pixel.camera, pixel.secondary]),
                ),
                aovs: args.layers.write_aovs(of, pixels, (result.film.width, result.film.height))?,
            });
        }
        if let Some(opened) = &self.opened {
            opened.note_times(vec![result.kernel_s], &mut stats, talk);
        }
        stats.total_s = start.elapsed().as_secs_f64();
        if let (true, Some(opened)) = (args.measure_error, &mut self.opened) {
            stats.full_picture = Some(measure_error(args, opened, &self.picture, &result.film, talk)?);
        }
        args.stats.as_deref().map_or(Ok(()), |path| stats.write(path))?;
        tell_result(self.output, (&stats, &result.film), talk);
        args.explain.print_times(&stats, &earlier, talk);
        Ok(())
    }

    /// The layers of the picture, or of the part of it that is rendered.
    fn trace_layers(&mut self, result: &RenderResult) -> Result<Vec<PlaneGroup>> {
        let Job { args, talk, .. } = self.job;
        let Some(opened) = self.opened.as_mut().filter(|_| args.layers.any()) else { return Ok(Vec::new()) };
        let bar = Bar::new("layers", *talk);
        let (width, height) = self.blocks.size();
        let rays = f64::from(width) * f64::from(height) / 1e6;
        let progress = |done: f64| bar.update(done, rays, "M rays");
        let (scene, how) = ((&*opened.buffers, &self.loaded.scene), (args.crop, result.sampling.as_ref()));
        args.layers.trace(opened.tracer.as_mut(), scene, &self.picture, how, &progress)
    }
}

/// What was rendered, and by what.
fn take_note(stats: &mut RunStats, result: &RenderResult, picture: &Picture) {
    stats.rays = RayCounts::from_counters(&result.counts);
    stats.second_pass = result.second_pass;
    stats.read_s = Some(result.read_s);
    stats.wavefront = result.wavefront;
    stats.adaptive = result.adaptive;
    stats.width = Some(result.film.width);
    stats.height = Some(result.film.height);
    stats.samples = Some(picture.samples);
    stats.depth = Some(picture.depth);
}

/// Tells what was rendered, and what was found out about it.
fn tell_result(output: &Path, (stats, film): (&RunStats, &Film), talk: Talk) {
    if !talk.quiet {
        say!(
            "{}: {}x{}, {} triangles on {}{}, {:.2} s",
            output.display(),
            film.width,
            film.height,
            stats.triangle_count,
            stats.device,
            open::rate(stats),
            stats.total_s
        );
    }
    if let (Some(full), false) = (&stats.full_picture, talk.quiet) {
        let share = stats.rays.total_cast() as f64 / full.rays.total_cast().max(1) as f64;
        let flip = full.difference.flip_mean.map_or(String::new(), |flip| format!(", FLIP {flip:.5}"));
        say!(
            "against {} samples in each pixel: {:.1} % of the rays, error {:.3} steps of 8-bit sRGB{flip}",
            full.samples,
            100.0 * share,
            full.difference.rms_8bit
        );
    }
    if let Some(counted) = &stats.work {
        work::say_work(counted, talk);
        if !talk.quiet {
            work::say_ranges(output, &counted.aovs);
        }
    }
}

/// Renders the full picture, and tells how the one that is written differs from it.
fn measure_error(
    args: &RenderArgs,
    opened: &mut Opened,
    picture: &Picture,
    film: &Film,
    talk: Talk,
) -> Result<FullPicture> {
    let bar = Bar::new("full picture", talk);
    let camera_rays = film.pixels.len() as f64 * f64::from(MOST_SAMPLES) / 1e6;
    let progress = |done: f64| bar.update(done, camera_rays, "M camera rays");
    let mut full = render_full(opened.tracer.as_mut(), &opened.buffers, picture, &progress)?;
    args.file.expose(&mut full.film)?;
    Ok(FullPicture {
        samples: MOST_SAMPLES,
        rays: RayCounts::from_counters(&full.counts),
        difference: compare_films(&full.film, film),
    })
}
