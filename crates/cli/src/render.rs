//! `raybrook render`.

use super::explain::{Chooser, ExplainArgs};
use super::files::{self, Files};
use super::keep::{KeepArgs, Keeper, LazyId, journal_of};
use super::open::Opened;
use super::part::PartChoice;
use super::progress::Bar;
use super::several;
use super::{DeviceArgs, MethodArgs, PictureArgs, SceneArgs, Talk, heading, open, work};
use raybrook::low_level::compare::compare_films;
use raybrook::low_level::film::{Film, ImageFormat, check_output};
use raybrook::low_level::output::check_writable;
use raybrook::low_level::renderer::{
    Crop, DEFAULT_DEPTH, Part, Picture, PictureBlocks, PictureId, render_full, render_part,
};
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::shared::WorkCounter;
use raybrook::low_level::stats::{FullPicture, RayCounts, WorkStats};
use raybrook::low_level::tracer::{MOST_SAMPLES, RenderResult, Task};
use raybrook::low_level::work::WorkSum;
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
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
    /// Picture to write: .png (sRGB), .exr or .pfm (linear) [default: the scene's name with .png].
    ///
    /// The default is in this folder, and has -render.png where .png is one of the scene's files.
    #[arg(short, long, value_name = "FILE", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    /// Bits per channel: 8 or 16 for .png [default: 8], 32 for .exr and .pfm.
    #[arg(long, value_name = "BITS", hide_short_help = true, help_heading = heading::OUTPUT)]
    bit_depth: Option<u8>,
    /// Part of the picture to render, WxH pixels from column X and row Y on.
    ///
    /// Its pixels are those of the whole picture, bit for bit. With --samples nothing else is rendered. With --error
    /// the areas of about 2048x2048 pixels are that it meets: where samples go is decided in blocks that are strewn over
    /// them.
    #[arg(long, help_heading = heading::PICTURE, hide_short_help = true, value_name = "X,Y,WxH")]
    crop: Option<Crop>,
    /// Make a .png lighter by so many stops, or darker by a negative number [default: 0].
    ///
    /// All light is multiplied by 2 to the power of EV before it becomes sRGB. Not for .exr and .pfm, which hold the
    /// light itself. --error means the picture without it.
    #[arg(long, help_heading = heading::PICTURE, hide_short_help = true, value_name = "EV", allow_hyphen_values = true)]
    exposure: Option<f32>,
    /// Render part I of N alone, for `raybrook merge`: into OUT.part-I-of-N, by as many machines as there are parts.
    ///
    /// Every Nth block of the picture, or every Nth area of a large one. `auto` takes I and N from what runs the
    /// program: an array of Slurm jobs (SLURM_ARRAY_TASK_ID), or ranks of Slurm, Open MPI, or PMI. Such a file is a
    /// journal, so that the same command goes on after whatever stopped it.
    #[arg(long, help_heading = heading::OUTPUT, hide_short_help = true, value_name = "I/N|auto", conflicts_with_all = ["counters", "aov", "measure_error", "stats"])]
    part: Option<PartChoice>,
    #[command(flatten)]
    keep: KeepArgs,
    #[command(flatten)]
    explain: ExplainArgs,
    /// Count the work on every ray: steps, leaves, tests, bytes, ... (slower; the picture stays the same).
    #[arg(long, hide_short_help = true, help_heading = heading::DIAGNOSIS)]
    counters: bool,
    #[arg(long, hide_short_help = true, help_heading = heading::DIAGNOSIS, help = format!("Write false-colour pictures of counted work beside the output, out-steps.png and so on, with --output .exr or .pfm also its numbers in that format; implies --counters. One or more of {}", WorkCounter::names()), value_name = "NAMES", value_delimiter = ',')]
    aov: Vec<WorkCounter>,
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
            work::claim_aovs(&output, format, &self.aov, &mut files).map(|()| output)
        };
        match &self.output {
            Some(output) => claim(output.clone()),
            None => files::first_free(wanted, "render", claim),
        }
    }
}

/// Checks that a picture of this format can have the exposure that was asked for.
pub fn check_exposure(stops: Option<f32>, format: ImageFormat) -> Result<()> {
    let Some(stops) = stops else { return Ok(()) };
    if matches!(format, ImageFormat::Exr | ImageFormat::Pfm) {
        let message = "an .exr or .pfm holds the light itself, which viewers expose; leave it out, or write a .png";
        return Err(Error::option("exposure", message));
    }
    Film::check_exposure(stops)
}

/// Tells of pixels that are no numbers, and exposes the picture.
pub fn finish_film(film: &mut Film, exposure: Option<f32>, talk: Talk) -> Result<()> {
    let bad = film.non_finite();
    if bad > 0 && !talk.quiet {
        tell!("warning: {bad} pixels are not finite numbers and are written as 0; please report this scene");
    }
    exposure.map_or(Ok(()), |stops| film.expose(stops))
}

/// Renders a picture whose work is counted, which is not kept on its way.
fn render_counted(opened: &mut Opened, picture: &Picture, crop: Option<Crop>, talk: Talk) -> Result<RenderResult> {
    let bar = Bar::new("render", talk);
    let (width, height) = crop.map_or(picture.size, |crop| crop.rendered_size(picture.size, picture.samples));
    let camera_rays = f64::from(width) * f64::from(height) * f64::from(picture.samples.per_pixel());
    let progress = |done: f64| bar.update(done, camera_rays / 1e6, "M camera rays");
    render_part(opened.tracer.as_mut(), &opened.buffers, picture, crop, &progress)
}

pub fn run(args: &RenderArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    let counters = args.counters || !args.aov.is_empty();
    let options = args.method.check(counters)?;
    let part = args.part.map(PartChoice::part).transpose()?;
    let wanted = match &args.output {
        Some(path) => path.clone(),
        None => open::default_output(&args.scene.scene, ".png")?,
    };
    let format = ImageFormat::from_path(&wanted)?;
    let format = args.bit_depth.map_or(Ok(format), |bits| format.with_bit_depth(bits))?;
    check_exposure(args.exposure, format)?;
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    let output = args.output(&wanted, format, part, files.clone())?;
    check_output(&output, Some(format))?;
    work::check_aovs(&output, format, &args.aov)?;
    args.stats.as_deref().map_or(Ok(()), check_writable)?;
    let opening = Instant::now();
    let devices = several::choose(&args.device, talk)?;
    if devices.len() > 1 && (counters || args.measure_error) {
        let message = "work is counted, and errors are measured, on one device; name one";
        return Err(Error::option("--device", message));
    }
    let device = devices.first().cloned().flatten();
    let device_s = opening.elapsed().as_secs_f64();
    let budget = args.scene.memory.budget();
    let rendered_size = |size, samples| args.crop.map_or(size, |crop| crop.rendered_size(size, samples));
    let check_picture = |size, samples| {
        args.crop.map_or(Ok(()), |crop| crop.check(size))?;
        open::check_picture(rendered_size(size, samples), samples, &options, device.as_ref(), format, &budget)
    };
    if let Some(size) = args.picture.size {
        check_picture(size, args.picture.samples().unwrap_or(Samples::PerPixel(1)))?;
    }
    let loaded = open::load_for_picture(&args.scene, &args.picture, &budget, talk)?;
    files.read_scene(&loaded.scene);
    let output = args.output(&wanted, format, part, files)?;
    open::note_name(&output, &wanted, talk);
    if args.measure_error && loaded.scene.picture.samples == Some(Samples::Corners) {
        let message =
            "rays through corners are no samples of pixels; leave it out, or ask for --samples N or --error E";
        return Err(Error::option("--measure-error", message));
    }
    let chooser = Chooser {
        counters,
        pictures: true,
        ..Chooser::new((&args.method, &args.device, &args.explain), device.as_ref(), talk)
    };
    let mut chosen = several::choose_methods(&chooser, &devices, &loaded)?;
    let picture = args.picture.picture(&loaded.scene);
    check_picture(picture.size, picture.samples)?;
    let mut keeper = match counters {
        true => None,
        false => {
            let (scene, options) = (&loaded.scene, chosen[0].options);
            let id: LazyId = LazyLock::new(Box::new(move || PictureId::new(scene, &picture, args.crop, &options)));
            let blocks = PictureBlocks::new(picture.size, picture.samples, args.crop);
            Some(Keeper::open(&args.keep, (&output, part), (id, blocks), talk)?)
        }
    };
    let mut opened = None;
    let (mut result, mut stats) = match &mut keeper {
        Some(keeper) if devices.len() > 1 => {
            several::render(keeper, &loaded, (&devices, &args.device), &chosen, (&picture, &budget), talk)?
        }
        keeper => {
            let tasks = (&[Task::Picture][..], &budget);
            let chosen = chosen.swap_remove(0);
            let one = open::open(&loaded, device.as_ref(), &args.device, chosen, picture.depth, tasks, talk)?;
            let opened = opened.insert(one);
            check_picture(picture.size, picture.samples)?;
            let result = match keeper {
                Some(keeper) => keeper.render(opened, &picture, talk)?,
                None => render_counted(opened, &picture, args.crop, talk)?,
            };
            (result, std::mem::take(&mut opened.stats))
        }
    };
    if part.is_some() {
        return keeper.map_or(Ok(()), |keeper| keeper.finish_part(talk));
    }

    finish_film(&mut result.film, args.exposure, talk)?;
    let writing = Instant::now();
    result.film.write(&output, Some(format))?;
    keeper.map_or(Ok(()), Keeper::finish)?;

    stats.write_s = Some(writing.elapsed().as_secs_f64());
    stats.device_s = Some(device_s);
    stats.rays = RayCounts::from_counters(&result.counts);
    if let Some(pixels) = &result.work {
        stats.work = Some(WorkStats {
            camera: WorkSum::new(stats.rays.camera.cast, pixels.iter().map(|pixel| pixel.camera)),
            all: WorkSum::new(stats.rays.total_cast(), pixels.iter().flat_map(|pixel| [pixel.camera, pixel.secondary])),
            aovs: work::write_aovs(&output, format, &args.aov, pixels, (result.film.width, result.film.height))?,
        });
    }
    stats.second_pass = result.second_pass;
    if let Some(opened) = &opened {
        stats.kernel_s = open::device_times(opened.tracer.as_ref(), vec![result.kernel_s], talk);
        stats.compile_s = Some(opened.tracer.compile_s()); // the second pass is compiled when it is needed
        stats.set_rate();
    }
    stats.read_s = Some(result.read_s);
    stats.wavefront = result.wavefront;
    stats.adaptive = result.adaptive;
    stats.total_s = start.elapsed().as_secs_f64();
    if let (true, Some(opened)) = (args.measure_error, &mut opened) {
        let bar = Bar::new("full picture", talk);
        let camera_rays = result.film.pixels.len() as f64 * f64::from(MOST_SAMPLES) / 1e6;
        let progress = |done: f64| bar.update(done, camera_rays, "M camera rays");
        let mut full = render_full(opened.tracer.as_mut(), &opened.buffers, &picture, &progress)?;
        args.exposure.map_or(Ok(()), |stops| full.film.expose(stops))?;
        stats.full_picture = Some(FullPicture {
            samples: MOST_SAMPLES,
            rays: RayCounts::from_counters(&full.counts),
            difference: compare_films(&full.film, &result.film),
        });
    }
    stats.width = Some(result.film.width);
    stats.height = Some(result.film.height);
    stats.samples = Some(picture.samples);
    stats.depth = Some(picture.depth);
    if let Some(path) = &args.stats {
        stats.write(path)?;
    }
    if !talk.quiet {
        say!(
            "{}: {}x{}, {} triangles on {}{}, {:.2} s",
            output.display(),
            result.film.width,
            result.film.height,
            stats.triangle_count,
            stats.device,
            open::rate(&stats),
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
            work::say_ranges(&output, &counted.aovs);
        }
    }
    Ok(())
}
