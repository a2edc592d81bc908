//! `raybrook turntable`: numbered pictures of a scene from all around, by one tracer. It goes on where it was stopped.

pub mod frames;
pub mod manifest;
mod sums;

use super::code::{Code, SUCCESS};
use super::explain::{Chooser, ExplainArgs};
use super::files::Files;
use super::layers::LayerArgs;
use super::limit::{Limit, LimitArgs};
use super::loss::LossArgs;
use super::open::{self, Loaded};
use super::picture_file::PictureFileArgs;
use super::progress::Bar;
use super::{DeviceArgs, MethodArgs, PictureArgs, SceneArgs, Talk, heading, work};
use frames::Frames;
use manifest::{Kept, Manifest, ToMake};
use raybrook::low_level::animation::write_animation;
use raybrook::low_level::film::ImageFormat;
use raybrook::low_level::output::check_writable;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, render_part_noting};
use raybrook::low_level::scene::{Camera, CameraKey, CameraPath, Samples, Scene};
use raybrook::low_level::tracer::{Backend, Progress};
use raybrook::{Error, Result};
use std::cell::Cell;
use std::path::{Path, PathBuf};
use std::time::Instant;

const MOST_FRAMES: u32 = 99_999;

#[derive(clap::Args)]
pub struct TurntableArgs {
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
    /// How many pictures to make [default: up to the scene's last camera key].
    #[arg(
        long,
        value_name = "N",
        value_parser = clap::value_parser!(u32).range(1..=i64::from(MOST_FRAMES)),
        help_heading = heading::CAMERA,
    )]
    frames: Option<u32>,
    /// How far to turn, counter-clockwise as seen from above, to where the frame after the last one would be
    /// [default: 360].
    ///
    /// A scene with camera keys ([[camera.key]]) has the camera follow these instead, unless this, --eye, --target or
    /// --view is given.
    #[arg(
        long,
        value_name = "DEGREES",
        allow_hyphen_values = true,
        value_parser = parse_degrees,
        help_heading = heading::CAMERA,
    )]
    degrees: Option<f32>,
    /// Folder for frame-0001.png and so on, or a picture's name: turn.png makes turn-0001.png
    /// [default: the scene's name with -turntable].
    #[arg(short, long, value_name = "DIR|FILE", help_heading = heading::OUTPUT)]
    output: Option<PathBuf>,
    #[command(flatten)]
    file: PictureFileArgs,
    #[command(flatten)]
    layers: LayerArgs,
    /// Write all frames to one animated .png as well, once they are there.
    #[arg(long, value_name = "FILE", help_heading = heading::OUTPUT)]
    animation: Option<PathBuf>,
    /// Pictures a second of --animation.
    #[arg(
        long,
        value_name = "N",
        default_value_t = 25,
        value_parser = clap::value_parser!(u16).range(1..=1000),
        help_heading = heading::OUTPUT,
    )]
    fps: u16,
    /// Make all frames anew, and remove those that are there.
    ///
    /// Without it the frames that are there stay, if they are of the same scene and options, and those that are missing
    /// or damaged are made.
    #[arg(long, help_heading = heading::OUTPUT)]
    restart: bool,
    #[command(flatten)]
    limit: LimitArgs,
    #[command(flatten)]
    explain: ExplainArgs,
}

fn parse_degrees(text: &str) -> std::result::Result<f32, String> {
    let degrees = text.parse().ok().filter(|degrees: &f32| degrees.is_finite() && degrees.abs() <= 36_000.0);
    degrees.ok_or_else(|| "expected degrees from -36000 to 36000".into())
}

/// Degrees of a turntable.
const FULL_TURN: f32 = 360.0;

impl TurntableArgs {
    /// The files, of which the number is not known yet where the scene says it.
    fn frames(&self) -> Result<Frames> {
        let output = match &self.output {
            Some(output) => output.clone(),
            None => open::default_output(&self.scene.scene, "-turntable")?,
        };
        Frames::of(&output, self.frames.unwrap_or(0))
    }

    /// How many frames there are.
    fn count(&self, way: Option<&[CameraKey]>) -> Result<u32> {
        let last = way.and_then(|keys| keys.last()).map(|key| key.frame);
        let message = "the scene has no camera keys that say how many pictures there are; give a number, such as 48";
        self.frames.or(last).ok_or_else(|| Error::option("--frames", message))
    }

    /// The camera's keys, if it follows them, with what the options say of all of them.
    fn keys(&self, scene: &Scene) -> Option<Vec<CameraKey>> {
        let aim = self.picture.camera.aim();
        let is_placed = aim.eye.is_some() || aim.target.is_some() || aim.viewpoint.is_some();
        if scene.camera_keys.is_empty() || is_placed || self.degrees.is_some() {
            return None;
        }
        let with_options = |key: &CameraKey| {
            let (up, fov_degrees) =
                (aim.up.unwrap_or(key.camera.up), aim.fov_degrees.unwrap_or(key.camera.fov_degrees));
            CameraKey { camera: Camera { up, fov_degrees, ..key.camera }, ..*key }
        };
        Some(scene.camera_keys.iter().map(with_options).collect())
    }

    /// The files beside a frame.
    fn beside(&self, format: ImageFormat) -> impl Fn(&Path) -> Vec<PathBuf> + '_ {
        move |frame| self.layers.files(frame, format)
    }

    /// Checks that the frames can be in an animation, and keeps that it is written.
    fn claim_animation(&self, format: ImageFormat, files: &mut Files) -> Result<()> {
        let Some(path) = &self.animation else { return Ok(()) };
        let is_png = |format| matches!(format, ImageFormat::Png8 | ImageFormat::Png16);
        if !is_png(format) || !ImageFormat::from_path(path).is_ok_and(is_png) {
            let message = format!("'{}': an animation is a .png of frames that are .png", path.display());
            return Err(Error::option("--animation", message));
        }
        files.write(path, "--animation")
    }
}

pub fn run(args: &TurntableArgs, talk: Talk) -> Result<Code> {
    let start = Instant::now();
    let limit = args.limit.begin(start);
    let counters = args.layers.wants_counters();
    let options = args.method.check(counters)?;
    let mut frames = args.frames()?;
    let format = args.file.format(&frames.path(1))?;
    args.layers.check(format)?;
    let mut files = Files::default();
    files.read(&args.scene.scene, "the scene");
    let claim = |frames: &Frames, mut files: Files| {
        frames.claim(&mut files)?;
        frames.paths().iter().try_for_each(|frame| args.layers.claim(frame, format, &mut files))?;
        args.claim_animation(format, &mut files)
    };
    claim(&frames, files.clone())?;
    args.animation.as_deref().map_or(Ok(()), check_writable)?;
    let device = open::choose(&args.device, talk)?.map(|device| device.ask_host());
    let budget = args.scene.memory.budget();
    let check_picture = |size, samples| {
        let of = (size, args.layers.bytes(size));
        open::check_picture(of, samples, &options, device.as_ref(), format, &budget)
    };
    if let Some(size) = args.picture.size {
        check_picture(size, args.picture.samples().unwrap_or(Samples::PerPixel(1)))?;
    }
    let loaded = open::load_for_picture(&args.scene, &args.picture, &budget, talk)?;
    files.read_scene(&loaded.scene);
    let keys = args.keys(&loaded.scene);
    frames = frames.with_count(args.count(keys.as_deref())?);
    claim(&frames, files)?;
    let chooser = Chooser {
        counters,
        pictures: true,
        ..Chooser::new((&args.method, &args.device, &args.explain), device.as_ref(), talk)
    };
    let chosen = chooser.choose(&loaded)?;
    let picture = args.picture.picture(&loaded.scene);
    check_picture(picture.size, picture.samples)?;
    args.layers.check_samples(picture.samples)?;
    let way = match keys {
        Some(keys) => CameraPath::Keys(keys),
        None => turn(args, &loaded, &picture, frames.count())?,
    };
    way.check(frames.count())?;
    let manifest = Manifest::new(args, &loaded.scene, (&way, frames.count()), (&picture, format), &chosen.options);
    frames.make_folder()?;
    let mut kept = manifest.take_over(&frames, args.restart, args.beside(format))?;
    check_writable(&frames.path(1))?;
    args.layers.check_writable(&frames.path(1), format)?;
    let to_make = frames_to_make(args, (&frames, format), &mut kept, talk)?;
    let found = frames.count() as usize - to_make.len();
    if !to_make.is_empty() {
        let tasks = (args.layers.tasks(), &budget);
        let opened = open::open(&loaded, device.as_ref(), &args.device, chosen, picture.depth, tasks, talk)?;
        check_picture(picture.size, picture.samples)?;
        let loss = args.loss.strict_if(counters);
        let mut opened = loss.guard(opened, device.as_ref(), talk);
        let turntable = Turntable { args, frames: &frames, format, way: &way, picture: &picture, loaded: &loaded };
        let made = Cell::new(0);
        let keep = |frame: &Path| {
            made.set(made.get() + 1);
            kept.note(&[vec![frame.to_owned()], args.layers.files(frame, format)].concat())
        };
        let render = || turntable.render(&to_make, (opened.tracer.as_mut(), &opened.buffers), keep, (limit, talk));
        if limit.within(render)?.is_none() {
            if !talk.quiet {
                let (done, of) = (found + made.get(), frames.count());
                let name = frames.name().display();
                tell!("note: {done} of {of} frames are in '{name}'; the same command makes the others");
            }
            return Ok(limit.end(talk));
        }
    }
    if let Some(path) = &args.animation {
        write_animation(path, &frames.paths(), args.fps)?;
    }
    if !talk.quiet {
        let found = if found > 0 { format!(", of which {found} were there") } else { String::new() };
        let seconds = start.elapsed().as_secs_f64();
        say!("{}: {} frames{found}, {seconds:.2} s", frames.name().display(), frames.count());
    }
    Ok(SUCCESS)
}

/// The frames that are not there, or not as they were written, which is told.
fn frames_to_make(
    args: &TurntableArgs,
    (frames, format): (&Frames, ImageFormat),
    kept: &mut Kept,
    talk: Talk,
) -> Result<Vec<u32>> {
    let (bar, count) = (Bar::new("check", talk), f64::from(frames.count()));
    let progress = |frame: u32| bar.update(f64::from(frame) / count, count, "frames");
    let ToMake { frames, damaged } = kept.to_make(frames, args.beside(format), progress)?;
    if let Some(first) = damaged.first().filter(|_| !talk.quiet) {
        let first = first.display();
        match damaged.len() - 1 {
            0 => tell!("warning: '{first}' is not what was written; its frame is made anew"),
            more => tell!("warning: '{first}' and {more} more are not what was written; their frames are made anew"),
        }
    }
    Ok(frames)
}

/// Around the scene.
fn turn(args: &TurntableArgs, loaded: &Loaded, picture: &Picture, frames: u32) -> Result<CameraPath> {
    let placed = loaded.placed.as_ref().ok_or_else(|| Error::Scene("it has no camera".into()))?;
    let aspect = picture.samples.aspect(picture.size) as f32;
    Ok(CameraPath::turn(placed, &loaded.scene, aspect, args.degrees.unwrap_or(FULL_TURN), frames))
}

/// What all frames have in common.
struct Turntable<'a> {
    args: &'a TurntableArgs,
    frames: &'a Frames,
    format: ImageFormat,
    way: &'a CameraPath,
    picture: &'a Picture,
    loaded: &'a Loaded,
}

impl Turntable<'_> {
    /// Makes frames; `keep` is told of each that is written.
    fn render(
        &self,
        to_make: &[u32],
        (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
        mut keep: impl FnMut(&Path) -> Result<()>,
        (limit, talk): (Limit, Talk),
    ) -> Result<()> {
        let bar = Bar::new("turntable", talk);
        for (made, &frame) in to_make.iter().enumerate() {
            let progress = |done: f64| {
                limit.check();
                bar.update((made as f64 + done) / to_make.len() as f64, to_make.len() as f64, "frames");
            };
            self.render_frame(frame, (tracer, buffers), &progress, (talk, made == 0))?;
            keep(&self.frames.path(frame))?;
        }
        Ok(())
    }

    fn render_frame(
        &self,
        frame: u32,
        (tracer, buffers): (&mut dyn Backend, &SceneBuffers),
        progress: Progress,
        (talk, is_first): (Talk, bool),
    ) -> Result<()> {
        let Turntable { args, format, .. } = *self;
        let picture = Picture { camera: self.way.camera(frame), ..*self.picture };
        self.light(picture.camera, (tracer, buffers))?;
        let notes_sampling = args.layers.wants_sampling();
        let mut result = render_part_noting(tracer, buffers, &picture, None, notes_sampling, progress)?;
        let of = (buffers, &self.loaded.scene);
        let sampling = result.sampling.as_ref();
        let layers = args.layers.trace(tracer, of, &picture, (None, sampling), &|_| progress(1.0))?;
        args.file.finish(&mut result.film, &format!("frame {frame}"), talk)?;
        let path = self.frames.path(frame);
        // What the colours of layers mean is told once.
        let talk = Talk { quiet: talk.quiet || !is_first && !talk.verbose, ..talk };
        args.layers.write((&path, format), &result, layers, talk)?;
        if let Some(work) = &result.work {
            let ranges = args.layers.write_aovs((&path, format), work, picture.size)?;
            if !talk.quiet {
                work::say_ranges(&path, &ranges);
            }
        }
        Ok(())
    }

    /// Has the lamp that was added to a scene without light go with the camera, as in a picture of this frame alone.
    fn light(&self, camera: Camera, (tracer, buffers): (&mut dyn Backend, &SceneBuffers)) -> Result<()> {
        let Some(lamp) = self.loaded.added_lamp(&camera) else { return Ok(()) };
        tracer.set_lights(&[buffers.packed_light(&lamp)?])
    }
}
