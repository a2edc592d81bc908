//! `raybrook render`.

use super::explain::{Chooser, ExplainArgs};
use super::files::{self, Files};
use super::layers::LayerArgs;
use super::picture_file::PictureFileArgs;
use super::progress::Bar;
use super::{DeviceArgs, MethodArgs, PictureArgs, SceneArgs, Talk, heading, open, work};
use raybrook::low_level::compare::compare_films;
use raybrook::low_level::film::{ImageFormat, check_output};
use raybrook::low_level::output::check_writable;
use raybrook::low_level::renderer::{Crop, DEFAULT_DEPTH, Picture, render_full, render_part_noting};
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::stats::{FullPicture, RayCounts, WorkStats};
use raybrook::low_level::tracer::{MOST_SAMPLES, Task};
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
    /// all of the picture is, and the part is cut out: where samples go is decided in blocks that are strewn over it.
    #[arg(long, help_heading = heading::PICTURE, hide_short_help = true, value_name = "X,Y,WxH")]
    crop: Option<Crop>,
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
    fn output(&self, wanted: &Path, format: ImageFormat, mut files: Files) -> Result<PathBuf> {
        files.write_if(self.stats.as_deref(), "--stats")?;
        let claim = |output: PathBuf| {
            let mut files = files.clone();
            files.write(&output, "-o")?;
            self.layers.claim(&output, format, &mut files).map(|()| output)
        };
        match &self.output {
            Some(output) => claim(output.clone()),
            None => files::first_free(wanted, "render", claim),
        }
    }
}

pub fn run(args: &RenderArgs, talk: Talk) -> Result<()> {
    let start = Instant::now();
    let counters = args.counters || args.layers.wants_counters();
    let options = args.method.check(counters)?;
    let wanted = match &args.output {
        Some(path) => path.clone(),
        None => open::default_output(&args.scene.scene, ".png")?,
    };
    let format = args.file.format(&wanted)?;
    args.layers.check(format)?;
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    let output = args.output(&wanted, format, files.clone())?;
    check_output(&output, Some(format))?;
    args.layers.check_writable(&output, format)?;
    args.stats.as_deref().map_or(Ok(()), check_writable)?;
    let opening = Instant::now();
    let device = open::choose(&args.device, talk)?;
    let device_s = opening.elapsed().as_secs_f64();
    let budget = args.scene.memory.budget();
    let rendered_size = |size, samples| args.crop.map_or(size, |crop| crop.rendered_size(size, samples));
    let check_picture = |size, samples| {
        args.crop.map_or(Ok(()), |crop| crop.check(size))?;
        let layer_bytes = args.layers.bytes(args.crop.map_or(size, |crop| crop.size));
        let size = rendered_size(size, samples);
        open::check_picture((size, layer_bytes), samples, &options, device.as_ref(), format, &budget)
    };
    if let Some(size) = args.picture.size {
        check_picture(size, args.picture.samples().unwrap_or(Samples::PerPixel(1)))?;
    }
    let loaded = open::load_for_picture(&args.scene, &args.picture, &budget, talk)?;
    files.read_scene(&loaded.scene);
    let output = args.output(&wanted, format, files)?;
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
    let chosen = chooser.choose(&loaded)?;
    let picture = args.picture.picture(&loaded.scene);
    check_picture(picture.size, picture.samples)?;
    args.layers.check_samples(picture.samples)?;
    let tasks = if args.layers.wants_hits() { &[Task::Picture, Task::Batch][..] } else { &[Task::Picture] };
    let tasks = (tasks, &budget);
    let mut opened = open::open(&loaded, device.as_ref(), &args.device, chosen, picture.depth, tasks, talk)?;
    check_picture(picture.size, picture.samples)?;

    let bar = Bar::new("render", talk);
    let (width, height) = rendered_size(picture.size, picture.samples);
    let camera_rays = f64::from(width) * f64::from(height) * f64::from(picture.samples.per_pixel());
    let progress = |done: f64| bar.update(done, camera_rays / 1e6, "M camera rays");
    let notes = args.layers.wants_sampling();
    let mut result =
        render_part_noting(opened.tracer.as_mut(), &opened.buffers, &picture, args.crop, notes, &progress)?;
    drop(bar);
    let tracing_layers = Instant::now();
    let scene = (&*opened.buffers, &loaded.scene);
    let layers =
        args.layers.trace(opened.tracer.as_mut(), scene, &picture, (args.crop, result.sampling.as_ref()), talk)?;
    let layers_s = args.layers.any().then(|| tracing_layers.elapsed().as_secs_f64());

    let bad = result.film.non_finite();
    if bad > 0 && !talk.quiet {
        tell!("warning: {bad} pixels are not finite numbers and are written as 0; please report this scene");
    }
    args.file.expose(&mut result.film)?;
    let writing = Instant::now();
    args.layers.write((&output, format), &result, layers, talk)?;

    let stats = &mut opened.stats;
    stats.write_s = Some(writing.elapsed().as_secs_f64());
    stats.device_s = Some(device_s);
    stats.layers_s = layers_s;
    stats.materials = args.layers.materials(&loaded.scene);
    stats.rays = RayCounts::from_counters(&result.counts);
    if let Some(pixels) = &result.work {
        stats.work = Some(WorkStats {
            camera: WorkSum::new(stats.rays.camera.cast, pixels.iter().map(|pixel| pixel.camera)),
            all: WorkSum::new(stats.rays.total_cast(), pixels.iter().flat_map(|pixel| [pixel.camera, pixel.secondary])),
            aovs: args.layers.write_aovs((&output, format), pixels, (result.film.width, result.film.height))?,
        });
    }
    stats.kernel_s = open::device_times(opened.tracer.as_ref(), vec![result.kernel_s], talk);
    stats.second_pass = result.second_pass;
    stats.compile_s = Some(opened.tracer.compile_s()); // the second pass is compiled when it is needed
    stats.set_rate();
    stats.read_s = Some(result.read_s);
    stats.wavefront = result.wavefront;
    stats.adaptive = result.adaptive;
    stats.total_s = start.elapsed().as_secs_f64();
    if args.measure_error {
        let bar = Bar::new("full picture", talk);
        let camera_rays = result.film.pixels.len() as f64 * f64::from(MOST_SAMPLES) / 1e6;
        let progress = |done: f64| bar.update(done, camera_rays, "M camera rays");
        let mut full = render_full(opened.tracer.as_mut(), &opened.buffers, &picture, &progress)?;
        args.file.expose(&mut full.film)?;
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
            work::say_ranges(&output, &counted.aovs);
        }
    }
    Ok(())
}
