//! `raybrook check`: the device against the reference, in pictures and in hits; or with `--truth` against a judge of
//! its own (`truth.rs`).

use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::explain::{Chooser, ExplainArgs};
use super::files::{self, Files};
use super::progress::Bar;
use super::{DeviceArgs, MethodArgs, PictureArgs, SceneArgs, Talk, open, truth};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::choose::Decision;
use raybrook::low_level::compare::{FilmDifference, HitDifference, compare_films, compare_hits, difference_picture};
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::film::check_output;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::{check_writable, write_json};
use raybrook::low_level::pack::{SceneBuffers, sample_positions};
use raybrook::low_level::reference::ReferenceBackend;
use raybrook::low_level::reference::shade::camera::camera_direction;
use raybrook::low_level::renderer::{Picture, picture_bytes, render};
use raybrook::low_level::scene::Samples;
use raybrook::low_level::shared::{COUNTER_NAMES, TraceRay};
use raybrook::low_level::tracer::{Backend, RenderResult, Task, TraceJob};
use raybrook::{Error, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Steps of 8-bit sRGB by which a pixel may differ. The twin repeats the kernels' arithmetic, so that a device of IEEE
/// division and square root differs nowhere; one step is left for devices whose division is only good to 2.5 ulp.
const TOLERATED_STEPS: u8 = 1;

#[derive(clap::Args)]
pub struct CheckArgs {
    #[command(flatten)]
    pub(super) scene: SceneArgs,
    /// Judge the picture and its rays by f64 and rational arithmetic, in place of the reference.
    ///
    /// The picture is rendered again in f64 by code that shares nothing with device and reference. Every pixel that
    /// float32's roundings do not explain is wrong. Rays of the picture are judged by rational arithmetic. Needs no
    /// OpenCL device. Each pixel has one sample unless --samples says otherwise.
    #[arg(long, conflicts_with = "error")]
    truth: bool,
    /// How many rays of each kind --truth judges, from pixels spread over the picture.
    #[arg(
        long,
        requires = "truth",
        value_name = "N",
        default_value_t = truth::DEFAULT_RAYS,
        value_parser = clap::value_parser!(u32).range(1..)
    )]
    pub(super) truth_rays: u32,
    /// Picture of the differences [default: the scene's name with -difference.png, in this folder].
    #[arg(short, long, value_name = "FILE")]
    output: Option<PathBuf>,
    #[command(flatten)]
    pub(super) picture: PictureArgs,
    #[command(flatten)]
    pub(super) method: MethodArgs,
    #[command(flatten)]
    pub(super) device: DeviceArgs,
    #[command(flatten)]
    pub(super) explain: ExplainArgs,
    /// Write the findings to a JSON file.
    #[arg(long, value_name = "FILE")]
    pub(super) stats: Option<PathBuf>,
}

impl CheckArgs {
    /// The name of the picture: the one that is given, or the first one like `wanted` that takes nothing from `files`,
    /// which are read.
    pub(super) fn output(&self, wanted: &Path, mut files: Files) -> Result<PathBuf> {
        files.write_if(self.stats.as_deref(), "--stats")?;
        let claim = |output: PathBuf| files.clone().write(&output, "-o").map(|()| output);
        match &self.output {
            Some(output) => claim(output.clone()),
            None => files::first_free(wanted, "check", claim),
        }
    }
}

/// What a check found.
#[derive(Serialize)]
struct Findings {
    device: String,
    options: TraceOptions,
    choices: Vec<Decision>,
    rays: u64,
    rays_differ: bool,
    hits: HitDifference,
    picture: FilmDifference,
    device_s: Option<f64>,
    reference_s: f64,
    passed: bool,
}

/// Bytes of a pixel that is compared: its ray and two hits of that on the host and on the device, and what FLIP keeps
/// of it.
const COMPARED_BYTES: u64 = 250;

/// Checks that there is memory for two pictures and all that is compared of them.
fn check_pictures(
    picture: &Picture,
    options: &TraceOptions,
    device: &DeviceHandle,
    budget: &MemoryBudget,
) -> Result<()> {
    let of = |device| picture_bytes(picture.size, picture.samples, options, device, None);
    let pixels = u64::from(picture.size.0) * u64::from(picture.size.1);
    let what = format!("comparing two pictures of {}x{} pixels", picture.size.0, picture.size.1);
    let bytes = of(Some(device)) + of(None) + COMPARED_BYTES * pixels;
    let remedy = "lower --size (a scene file's width and height), or raise --memory-limit";
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy })
}

pub fn run(args: &CheckArgs, talk: Talk) -> Result<Code> {
    args.method.check(false)?;
    let wanted = match &args.output {
        Some(path) => path.clone(),
        None => open::default_output(&args.scene.scene, "-difference.png")?,
    };
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    check_output(&args.output(&wanted, files.clone())?, None)?;
    args.stats.as_deref().map_or(Ok(()), check_writable)?;
    if args.truth {
        return truth::run(args, &wanted, files, talk);
    }
    let Some(device) = open::choose(&args.device, Talk { quiet: true, ..talk })? else {
        let message =
            "there is no OpenCL device to check against the reference; `raybrook devices` tells what is missing";
        return Err(Error::NoDevice(message.into()));
    };
    let budget = args.scene.memory.budget();
    let loaded = open::load_for_picture(&args.scene, &args.picture, &budget, talk)?;
    files.read_scene(&loaded.scene);
    let output = args.output(&wanted, files)?;
    open::note_name(&output, &wanted, talk);
    let chooser =
        Chooser { pictures: true, ..Chooser::new((&args.method, &args.device, &args.explain), Some(&device), talk) };
    let chosen = chooser.choose(&loaded)?;
    let options = chosen.options;
    let picture = args.picture.picture(&loaded.scene);
    check_pictures(&picture, &options, &device, &budget)?;
    let tasks = (&[Task::Batch, Task::Picture][..], &budget);
    let mut opened = open::open(&loaded, Some(&device), &args.device, chosen, picture.depth, tasks, talk)?;
    check_pictures(&picture, &options, &device, &budget)?;
    let mut reference = ReferenceBackend::new(opened.buffers.clone(), options);

    let rays = camera_rays(&opened.buffers, &picture);
    let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
    let silent = |_: f64| ();
    let device_hits = opened.tracer.trace(&job, &silent)?.hits;
    let reference_hits = reference.trace(&job, &silent)?.hits;

    let run_on = |tracer: &mut dyn Backend, name: &str| {
        let bar = Bar::new(name, talk);
        let camera_rays = rays.len() as f64 * f64::from(picture.samples.per_pixel()) / 1e6;
        render(tracer, &opened.buffers, &picture, &|done| bar.update(done, camera_rays, "M camera rays"))
    };
    let on_device = run_on(opened.tracer.as_mut(), "device")?;
    let on_reference = run_on(&mut reference, "reference")?;

    let picture_difference = compare_films(&on_reference.film, &on_device.film);
    let hits = compare_hits(&reference_hits, &device_hits);
    let findings = Findings {
        passed: hits.differing == 0 && picture_difference.largest_step <= TOLERATED_STEPS,
        device: opened.stats.device.clone(),
        options,
        choices: opened.stats.choices.clone(),
        rays: on_device.counts.iter().step_by(2).sum(),
        rays_differ: on_device.counts != on_reference.counts,
        device_s: opened.tracer.has_clock().then_some(on_device.kernel_s),
        reference_s: on_reference.kernel_s,
        picture: picture_difference,
        hits,
    };
    difference_picture(&on_reference.film, &on_device.film).write(&output, None)?;
    if let Some(path) = &args.stats {
        write_json(path, &findings)?;
    }
    if !talk.quiet {
        print_findings(&findings, &on_device, &on_reference, &output);
    }
    Ok(if findings.passed { SUCCESS } else { FOUND_A_DIFFERENCE })
}

/// One ray through the middle of each pixel, or through its corner.
fn camera_rays(buffers: &SceneBuffers, picture: &Picture) -> Vec<TraceRay> {
    let samples = match picture.samples {
        Samples::PerPixel(_) => Samples::PerPixel(1),
        other => other,
    };
    let params = buffers.render_params(&picture.camera, picture.size, samples, 1, None);
    let in_pixel = sample_positions(samples)[0];
    let pixels =
        (0..params.height).flat_map(|y| (0..params.width).map(move |x| (x as f32 + in_pixel.x, y as f32 + in_pixel.y)));
    pixels
        .map(|(x, y)| TraceRay {
            origin_t_min: params.eye,
            direction_t_max: raybrook::low_level::layout::Float4::new(camera_direction(&params, x, y), f32::INFINITY),
        })
        .collect()
}

fn print_findings(findings: &Findings, device: &RenderResult, reference: &RenderResult, output: &Path) {
    let Findings { hits, picture, .. } = findings;
    say!("device       {}", findings.device);
    say!("rays         {} on the device, {}", findings.rays, {
        let sum: u64 = reference.counts.iter().step_by(2).sum();
        format!("{sum} on the reference")
    });
    for (i, name) in COUNTER_NAMES.iter().enumerate().filter(|&(i, _)| device.counts[i] != reference.counts[i]) {
        say!("             {name}: {} against {}", device.counts[i], reference.counts[i]);
    }
    say!(
        "camera hits  {} of {} differ in some bit, {} in the triangle; t by up to {} ulp",
        hits.differing,
        hits.rays,
        hits.differing_primitive,
        hits.largest_t_ulp
    );
    say!(
        "pixels       {} of {} differ after 8-bit sRGB, by up to {} steps (tolerated: {TOLERATED_STEPS})",
        picture.differing_pixels,
        picture.pixels,
        picture.largest_step
    );
    let flip = picture.flip_mean.map_or("not measured".to_owned(), |flip| format!("{flip:.6}"));
    say!("difference   RMS {:.3e} (linear), FLIP {flip}", picture.rms);
    let reference_s = findings.reference_s;
    match findings.device_s {
        Some(device_s) => say!(
            "time         device {device_s:.3} s, reference {reference_s:.3} s: ratio {:.2}",
            reference_s / device_s
        ),
        None => say!("time         the device does not tell, reference {reference_s:.3} s"),
    }
    say!("picture      {}", output.display());
    say!("{}", if findings.passed { "passed" } else { "FAILED" });
}
