//! `raybrook check --truth`: a picture and its rays against a judge who shares no code with what is judged.

use super::check::CheckArgs;
use super::code::{Code, FOUND_A_DIFFERENCE, SUCCESS};
use super::explain::Chooser;
use super::files::Files;
use super::progress::Bar;
use super::{Talk, flags, open};
use raybrook::low_level::budget::{DecidedBy, MemoryBudget, Need};
use raybrook::low_level::choose::Decision;
use raybrook::low_level::compare::difference_picture;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::output::write_json;
use raybrook::low_level::pack::sample_positions;
use raybrook::low_level::renderer::{Picture, picture_bytes, render};
use raybrook::low_level::scene::{Samples, Scene, Texture};
use raybrook::low_level::tracer::Task;
use raybrook::{Error, Result};
use raybrook_lab::truth::{
    PictureVerdict, PixelFault, Pyramid, RayVerdict, RayVerdicts, SampledRays, Truth, judge_picture, judge_rays,
};
use serde::Serialize;
use std::path::Path;

/// Rays of each kind that are judged unless more or fewer are asked for: a second or two of rational arithmetic.
pub const DEFAULT_RAYS: u32 = 10_000;
/// Bytes of a ray that is judged: as it is sampled, traced and answered.
const RAY_BYTES: u64 = 1200;
/// Bytes of a pixel beside those of the picture: its colour in f64, verdict, difference, and what FLIP keeps of it.
const JUDGED_BYTES: u64 = 300;

/// What the judge found.
#[derive(Serialize)]
struct Findings {
    device: String,
    choices: Vec<Decision>,
    options: TraceOptions,
    samples: Samples,
    depth: u32,
    rays: RayVerdicts,
    picture: PictureVerdict,
    passed: bool,
}

/// Checks that there is memory for the judge.
fn check_memory(
    (scene, picture, limit): (&Scene, &Picture, u32),
    options: &TraceOptions,
    device: Option<&DeviceHandle>,
    budget: &MemoryBudget,
) -> Result<()> {
    let pixels = u64::from(picture.size.0) * u64::from(picture.size.1);
    let texels: u64 = scene.textures.iter().filter_map(Texture::image).map(|image| image.rgba.len() as u64).sum();
    // Five lists of rays.
    let of_rays = 5 * RAY_BYTES * u64::from(limit).min(pixels.saturating_mul(u64::from(picture.depth)));
    let of_scene = Truth::TRIANGLE_BYTES * scene.triangle_count() as u64 + Pyramid::TEXEL_BYTES * texels;
    let of_picture = picture_bytes(picture.size, picture.samples, options, device, None) + JUDGED_BYTES * pixels;
    let what = format!(
        "judging a picture of {}x{} pixels and {} triangles in f64",
        picture.size.0,
        picture.size.1,
        scene.triangle_count()
    );
    let bytes = of_rays + of_scene + of_picture;
    let remedy = "lower --size (a scene file's width and height) or --truth-rays, or raise --memory-limit";
    budget.check(&Need { what: &what, bytes, decided_by: DecidedBy::Picture, remedy })
}

/// Renders the picture, judges it and its rays, and writes the findings. `output` and `files` are checked.
pub fn run(args: &CheckArgs, wanted: &Path, mut files: Files, talk: Talk) -> Result<Code> {
    if args.method.check(false)?.picture.roulette.is_some() {
        let message = "random killing leaves rays to chance, which the judge cannot follow; leave `roulette` out";
        return Err(Error::option("roulette", message));
    }
    let device = open::choose(&args.device, Talk { quiet: true, ..talk })?;
    let budget = args.scene.memory.budget();
    let loaded = open::load_for_picture(&args.scene, &args.picture, &budget, talk)?;
    files.read_scene(&loaded.scene);
    let output = args.output(wanted, files)?;
    open::note_name(&output, wanted, talk);
    let chooser =
        Chooser { pictures: true, ..Chooser::new((&args.method, &args.device, &args.explain), device.as_ref(), talk) };
    let chosen = chooser.choose(&loaded)?;
    let options = chosen.options;
    let picture = fixed_samples(args.picture.picture(&loaded.scene));
    let limit = args.truth_rays;
    check_memory((&loaded.scene, &picture, limit), &options, device.as_ref(), &budget)?;
    let tasks = (&[Task::Batch, Task::Picture][..], &budget);
    let mut opened = open::open(&loaded, device.as_ref(), &args.device, chosen, picture.depth, tasks, talk)?;
    check_memory((&loaded.scene, &picture, limit), &options, device.as_ref(), &budget)?;

    let tracer = opened.tracer.as_mut();
    let pixels = f64::from(picture.size.0) * f64::from(picture.size.1) / 1e6;
    let bar = Bar::new("picture", talk);
    let film = render(tracer, &opened.buffers, &picture, &|done| bar.update(done, pixels, "M pixels"))?.film;
    drop(bar);

    let params = opened.buffers.render_params(
        &picture.camera,
        picture.size,
        picture.samples,
        picture.depth,
        picture.kill_weight,
    );
    let places = sample_positions(picture.samples);
    let in_pixel = places.first().map_or((0.5, 0.5), |place| (place.x, place.y));
    let truth = Truth::new(&loaded.scene, &options, picture, places, params.kill_weight)?;
    let sampled = SampledRays::new(&truth, &params, picture.camera.eye, in_pixel, limit as usize);
    let bar = Bar::new("rays", talk);
    let rays = judge_rays(&loaded.scene, &opened.buffers, &options, tracer, (sampled, limit as usize), &|done| {
        bar.update(done, f64::from(limit) / 1e6, "M rays")
    })?;
    drop(bar);
    let bar = Bar::new("truth", talk);
    let (verdict, shown, _) = judge_picture(&truth, &film, &|done| bar.update(done, pixels, "M pixels"));
    drop(bar);

    let findings = Findings {
        passed: rays.wrong() == 0 && verdict.wrong == 0,
        device: opened.stats.device.clone(),
        choices: opened.stats.choices.clone(),
        options,
        samples: picture.samples,
        depth: picture.depth,
        rays,
        picture: verdict,
    };
    difference_picture(&shown, &film).write(&output, None)?;
    if let Some(path) = &args.stats {
        write_json(path, &findings)?;
    }
    if !talk.quiet {
        say_findings(&findings, &output);
    }
    Ok(if findings.passed { SUCCESS } else { FOUND_A_DIFFERENCE })
}

/// One sample a pixel where nobody asks for a number: which pixels need more is decided by what was seen, and not by
/// what is right.
fn fixed_samples(picture: Picture) -> Picture {
    match picture.samples {
        Samples::Error(_) => Picture { samples: Samples::PerPixel(1), ..picture },
        _ => picture,
    }
}

fn say_findings(findings: &Findings, output: &Path) {
    let Findings { rays, picture, .. } = findings;
    say!("device       {}", findings.device);
    say!("method       {}", flags::arguments(&findings.options).join(" "));
    say!("rays              tested      hits     wrong   t ulp   u ulp   v ulp");
    rays.kinds.iter().for_each(say_rays);
    let counts = [("equal", picture.equal), ("rounded", picture.rounded), ("on an edge", picture.edge)];
    let counts: Vec<String> = counts.iter().map(|(what, count)| format!("{count} {what}")).collect();
    say!("pixels       {} wrong of {} ({})", picture.wrong, picture.pixels, counts.join(", "));
    say_pixel("worst wrong", picture.worst_wrong.as_ref());
    say_pixel("worst right", picture.worst_right.as_ref());
    let flip = picture.difference.flip_mean.map_or("not measured".to_owned(), |flip| format!("{flip:.6}"));
    say!("difference   RMS {:.3e} (linear), FLIP {flip}", picture.difference.rms);
    say!("picture      {}", output.display());
    say!("{}", if findings.passed { "passed" } else { "FAILED" });
}

fn say_rays(rays: &RayVerdict) {
    let ulp = |ulp: Option<u32>| ulp.map_or("-".to_owned(), |ulp| ulp.to_string());
    let RayVerdict { kind, tested, hits, wrong, t_ulp, u_ulp, v_ulp, .. } = rays;
    let [t, u, v] = [t_ulp, u_ulp, v_ulp].map(|x| ulp(*x));
    let faults: Vec<String> = rays.faults.iter().map(|(name, count)| format!("{count} {name}")).collect();
    let faults = if faults.is_empty() { String::new() } else { format!("  {}", faults.join(", ")) };
    say!("  {kind:15} {tested:>6} {hits:>9} {wrong:>9} {t:>7} {u:>7} {v:>7}{faults}");
}

fn say_pixel(what: &str, fault: Option<&PixelFault>) {
    if let Some(PixelFault { x, y, steps, found, truth }) = fault {
        let words = |rgb: [f64; 3]| rgb.map(|c| format!("{c:.6}")).join(" ");
        say!(
            "{what}  ({x}, {y}) by {steps:.2} steps of 8-bit sRGB: {} in place of {}",
            words(found.map(f64::from)),
            words(*truth)
        );
    }
}
