//! What makes pictures: the scene, a tracer of it, and beside that one that counts or one that is exact, once it was
//! needed.

use super::super::explain::Chooser;
use super::super::method::{AUTO, MethodArgs};
use super::super::{Talk, flags, open};
use super::ViewArgs;
use super::facts::{AskedMethod, Layer, PictureFacts, SceneFacts, Shown};
use super::hub::Job;
use super::pick::Pickable;
use super::wrong::{exact_colours, wrong_pixels};
use crate::open::Loaded;
use raybrook::glam::Vec3;
use raybrook::low_level::aov::Aov;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::film::{Film, ImageFormat};
use raybrook::low_level::layers::PixelRays;
use raybrook::low_level::options::{Intersector, StructureKind, TraceOptions, Traversal};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::shared::{Hit, Light, WorkCounter};
use raybrook::low_level::stats::RayCounts;
use raybrook::low_level::tracer::{Adaptive, Backend, Task};
use raybrook::{Camera, Result};
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Seconds that a coarse picture shall take: with what the browser does to it, it is seen within 100 ms.
const COARSE_S: f64 = 0.04;
/// Pixels of a side for one ray of the first coarse picture, when nobody knows how fast rays are, and the most.
const FIRST_DIVISOR: u32 = 8;
const MOST_DIVISOR: u32 = 64;
/// Errors of the pictures between the coarse one and the finished one.
const ERRORS_BETWEEN: [f32; 2] = [8.0, 2.5];
/// A picture on the way has at least so many times the error of the finished one: else it is not worth its time.
const WORTH: f32 = 2.0;

/// A tracer, and the scene as it has it.
struct Tracing {
    buffers: Arc<SceneBuffers>,
    tracer: Box<dyn Backend>,
    /// What shines in place of the scene's lights.
    lights: Option<Vec<Light>>,
}

impl Tracing {
    fn new(buffers: &Arc<SceneBuffers>, mut tracer: Box<dyn Backend>, stop: &Arc<AtomicBool>) -> Tracing {
        tracer.stop_when(stop.clone());
        Tracing { buffers: buffers.clone(), tracer, lights: None }
    }

    /// Has the lamp that was added, if any, shine where it belongs.
    fn light(&mut self, light: Option<raybrook::Light>) -> Result<()> {
        let Some(light) = light else { return Ok(()) };
        let lights = vec![self.buffers.packed_light(&light)?];
        if *self.lights.as_ref().unwrap_or(&self.buffers.lights) != lights {
            self.tracer.set_lights(&lights)?;
            self.lights = Some(lights);
        }
        Ok(())
    }

    /// The closest hits of the rays of all pixels, and the seconds that they took.
    fn hits(&mut self, picture: &Picture) -> Result<(Vec<Hit>, f64)> {
        let rays = PixelRays::new(&self.buffers, picture, None)?;
        let batch = rays.batch(&self.buffers, 0..rays.count());
        let result = self.tracer.trace(&batch.job(false, 1), &|_| ())?;
        Ok((result.hits, result.kernel_s.iter().sum()))
    }
}

/// What a second tracer is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Purpose {
    Counting,
    Exact,
}

/// A step of refinement.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Step {
    /// Pixels of a side for one of the picture that is made.
    divisor: u32,
    samples: Samples,
}

impl Step {
    fn label(&self) -> String {
        match (self.divisor, self.samples) {
            (1, Samples::Error(error)) => format!("error {error}"),
            (1, Samples::PerPixel(1)) => "1 sample a pixel".to_owned(),
            (1, Samples::PerPixel(count)) => format!("{count} samples a pixel"),
            (1, Samples::Corners) => "rays through corners".to_owned(),
            (divisor, _) => format!("1 ray for {divisor}x{divisor} pixels"),
        }
    }
}

/// The steps behind the coarse one, which had a ray for `divisor` x `divisor` pixels. All are finer than that, and the
/// last is the finished picture.
fn finer_steps(layer: Layer, samples: Samples, divisor: u32) -> Vec<Samples> {
    let between: Vec<Samples> = match (layer, samples) {
        (Layer::Picture, Samples::Error(error)) => {
            let is_worth = |between: &f32| *between >= WORTH * error && Adaptive::of_error(*between).lattice <= divisor;
            ERRORS_BETWEEN.into_iter().filter(is_worth).map(Samples::Error).collect()
        }
        (Layer::Picture, Samples::PerPixel(count)) => {
            let powers = std::iter::successors(Some(1_u32), |n| n.checked_mul(4));
            let finer = powers.take_while(|&power| power < count);
            finer.filter(|&power| power > 1 || divisor > 1).map(Samples::PerPixel).collect()
        }
        _ => Vec::new(),
    };
    let last = match (layer, samples) {
        (Layer::Picture, _) | (_, Samples::Corners) => samples,
        _ => Samples::PerPixel(1),
    };
    between.into_iter().chain([last]).collect()
}

/// The divisor with which a picture of `pixels` takes no longer than [`COARSE_S`].
fn divisor(pixels: f64, pixel_s: Option<f64>) -> u32 {
    let Some(pixel_s) = pixel_s else { return FIRST_DIVISOR };
    let takes = |divisor: u32| pixels * pixel_s / f64::from(divisor).powi(2);
    let mut divisor = 1;
    while divisor < MOST_DIVISOR && takes(divisor) > COARSE_S {
        divisor *= 2;
    }
    divisor
}

/// A film and what it took.
struct Made {
    film: Film,
    rays: u64,
    kernel_s: f64,
    error: Option<f32>,
    brightest: Option<u32>,
    wrong: Option<u64>,
}

/// Makes the pictures of all pages.
pub struct Engine<'a> {
    args: &'a ViewArgs,
    talk: Talk,
    device: Option<DeviceHandle>,
    stop: Arc<AtomicBool>,
    loaded: Arc<Loaded>,
    method: MethodArgs,
    main: Tracing,
    other: Option<(Purpose, Tracing)>,
    /// Seconds that a ray of the last coarse picture took, and of what that was.
    pixel_s: Option<(Layer, f64)>,
}

/// Loads the scene.
pub fn load(args: &ViewArgs, device: Option<&DeviceHandle>, talk: Talk) -> Result<Loaded> {
    let budget = args.scene.memory.budget();
    let loaded = open::load_for_picture(&args.scene, &args.picture, &budget, talk)?;
    let Picture { size, samples, .. } = args.picture.picture(&loaded.scene);
    // With the work on each ray, which takes most.
    let options = TraceOptions { counters: true, ..TraceOptions::DEFAULT };
    open::check_picture((size, 0), samples, &options, device, ImageFormat::Png8, &budget)?;
    Ok(loaded)
}

/// The diagonal of a scene, world units; never 0.
pub fn diagonal(scene: &Scene) -> f64 {
    let extent = scene.bounds().map_or(0.0, |(low, high)| (high.as_dvec3() - low.as_dvec3()).length());
    if extent > 0.0 { extent } else { 1.0 }
}

/// A file's name for shells.
fn quoted(path: &Path) -> String {
    let text = path.display().to_string();
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+".contains(c);
    if !text.is_empty() && text.chars().all(is_plain) { text } else { format!("'{}'", text.replace('\'', "'\\''")) }
}

impl<'a> Engine<'a> {
    /// Builds and opens what the options ask for.
    pub fn open(
        args: &'a ViewArgs,
        device: Option<DeviceHandle>,
        loaded: Loaded,
        stop: &Arc<AtomicBool>,
        talk: Talk,
    ) -> Result<Engine<'a>> {
        let method = args.method.with(&[])?;
        let loaded = Arc::new(loaded);
        let main = opened(args, device.as_ref(), &loaded, &method, (false, stop), talk)?;
        let stop = stop.clone();
        Ok(Engine { args, talk, device, stop, loaded, method, main, other: None, pixel_s: None })
    }

    /// The picture that is asked for, but for the camera.
    fn picture(&self) -> Picture {
        self.args.picture.picture(&self.loaded.scene)
    }

    /// The camera that sees the scene first, and the scene's diagonal.
    pub fn first_view(&self) -> (Camera, f64) {
        (self.picture().camera, diagonal(&self.loaded.scene))
    }

    /// What the pages tell of scene and method.
    pub fn facts(&self) -> SceneFacts {
        let Picture { size, samples, depth, .. } = self.picture();
        let samples = match samples {
            Samples::Error(error) => format!("--error={error}"),
            Samples::PerPixel(count) => format!("--samples={count}"),
            Samples::Corners => format!("--samples={}", Samples::CORNERS),
        };
        let options = self.main.tracer.options();
        let method = flags::arguments(options).join(" ");
        let kill = self.args.picture.kill_weight.map(|weight| format!(" --kill-weight={weight}")).unwrap_or_default();
        let scene = quoted(&self.args.scene.scene);
        let shown: String = flags::pixel_arguments(options).iter().map(|word| format!(" {word}")).collect();
        SceneFacts {
            scene: self.args.scene.scene.display().to_string(),
            triangles: self.loaded.scene.triangle_count(),
            device: self.main.tracer.device_name().to_owned(),
            size,
            method,
            command: format!(
                "raybrook render {scene} --size={}x{} {samples} --depth={depth}{kill}{shown}",
                size.0, size.1
            ),
            asked: AskedMethod {
                structure: self.method.asked(StructureKind::OPTION).to_owned(),
                traversal: self.method.asked(Traversal::OPTION).to_owned(),
                intersector: self.method.asked(Intersector::OPTION).to_owned(),
            },
            notice: None,
            busy: None,
        }
    }

    /// What tells what is under the pointer.
    pub fn pickable(&self) -> Arc<Pickable> {
        let options = *self.main.tracer.options();
        Arc::new(Pickable::new(&self.loaded, &self.main.buffers, options, self.picture()))
    }

    /// Traces by another method from now on; where that fails, by the one before.
    pub fn switch(&mut self, asked: &AskedMethod) -> Result<()> {
        let AskedMethod { structure, traversal, intersector } = asked;
        let parts = [
            (StructureKind::OPTION, &structure[..]),
            (Traversal::OPTION, traversal),
            (Intersector::OPTION, intersector),
        ];
        let method = self.args.method.with(&parts)?;
        self.main = opened(self.args, self.device.as_ref(), &self.loaded, &method, (false, &self.stop), self.talk)?;
        (self.method, self.other, self.pixel_s) = (method, None, None);
        Ok(())
    }

    /// Reads the scene's files again; where that fails, the scene stays as it was.
    pub fn reload(&mut self) -> Result<()> {
        let loaded = Arc::new(load(self.args, self.device.as_ref(), self.talk)?);
        self.main = opened(self.args, self.device.as_ref(), &loaded, &self.method, (false, &self.stop), self.talk)?;
        (self.loaded, self.other, self.pixel_s) = (loaded, None, None);
        Ok(())
    }

    /// The files that the scene was read from.
    pub fn files(&self) -> Vec<std::path::PathBuf> {
        self.loaded.scene.files.iter().map(|file| file.path.clone()).collect()
    }

    /// Whether a second tracer must be opened first to show this.
    pub fn must_open(&self, layer: Layer) -> bool {
        let purpose = match layer {
            Layer::Picture => return false,
            Layer::Work(_) => Purpose::Counting,
            Layer::Wrong => Purpose::Exact,
        };
        self.other.as_ref().is_none_or(|(known, _)| *known != purpose)
    }

    /// What is made next, and whether it is the last.
    fn step(&self, job: &Job) -> (Step, bool) {
        let Picture { size: (width, height), samples, .. } = self.picture();
        let finer = finer_steps(job.layer, samples, job.divisor);
        let pixel_s = self.pixel_s.filter(|(layer, _)| *layer == job.layer).map(|(_, seconds)| seconds);
        let step = match job.step.checked_sub(1) {
            None => {
                let divisor = divisor(f64::from(width) * f64::from(height), pixel_s);
                Step { divisor, samples: Samples::PerPixel(1) }
            }
            Some(number) => Step { divisor: 1, samples: finer[number.min(finer.len() - 1)] },
        };
        (step, job.step >= finer.len() || step == Step { divisor: 1, samples: finer[finer.len() - 1] })
    }

    /// Makes a picture.
    ///
    /// # Errors
    /// [`Error::Stopped`](raybrook::Error::Stopped) when it is not wanted any more; what opening and rendering say.
    pub fn draw(&mut self, job: &Job) -> Result<Shown> {
        let (step, is_last) = self.step(job);
        let whole = self.picture();
        let side = |side: u32| side.div_ceil(step.divisor).max(1);
        let size = (side(whole.size.0), side(whole.size.1));
        let picture = Picture { camera: job.camera, size, samples: step.samples, ..whole };
        if self.must_open(job.layer) {
            self.other = None;
        }
        let made = match job.layer {
            Layer::Picture => self.timed(job, |engine| engine.shaded(&picture)),
            Layer::Work(counter) => {
                self.other(Purpose::Counting)?;
                self.timed(job, |engine| engine.counted(&picture, counter))
            }
            Layer::Wrong => {
                self.other(Purpose::Exact)?;
                self.timed(job, |engine| engine.wrong(&picture))
            }
        };
        let Made { film, rays, kernel_s, error, brightest, wrong } = made?;
        let mrays_per_s = if kernel_s > 0.0 { rays as f64 / kernel_s * 1e-6 } else { 0.0 };
        let (label, pixels) = (step.label(), film.pixels.len());
        let facts = PictureFacts { label, rays, mrays_per_s, error, brightest, wrong, pixels };
        Ok(Shown { film: Arc::new(film), facts, divisor: step.divisor, is_last })
    }

    /// Makes a picture; of a coarse one it learns how long a ray takes.
    fn timed(&mut self, job: &Job, make: impl FnOnce(&mut Self) -> Result<Made>) -> Result<Made> {
        let start = Instant::now();
        let made = make(self)?;
        if job.step == 0 {
            let seconds = start.elapsed().as_secs_f64();
            self.pixel_s = Some((job.layer, seconds / made.film.pixels.len() as f64));
        }
        Ok(made)
    }

    fn shaded(&mut self, picture: &Picture) -> Result<Made> {
        self.main.light(self.loaded.added_lamp(&picture.camera))?;
        let result = render(self.main.tracer.as_mut(), &self.main.buffers, picture, &|_| ())?;
        Ok(Made {
            film: result.film,
            rays: RayCounts::from_counters(&result.counts).total_cast(),
            kernel_s: result.kernel_s,
            error: result.adaptive.map(|adaptive| adaptive.estimated_error),
            brightest: None,
            wrong: None,
        })
    }

    /// Opens a second tracer, unless it is there.
    fn other(&mut self, purpose: Purpose) -> Result<()> {
        if self.other.as_ref().is_none_or(|(known, _)| *known != purpose) {
            self.other = Some((purpose, self.second(purpose)?));
        }
        Ok(())
    }

    /// A tracer that counts or is exact, of the structure that is there; of another one where it cannot be that.
    fn second(&self, purpose: Purpose) -> Result<Tracing> {
        let (method, counters) = match purpose {
            Purpose::Counting => {
                let structure = self.main.tracer.options().kind().name();
                (self.method.with(&[(StructureKind::OPTION, structure)])?, true)
            }
            Purpose::Exact => {
                let exact = Intersector::Exact.name();
                (self.method.with(&[(Traversal::OPTION, AUTO), (Intersector::OPTION, exact)])?, false)
            }
        };
        let options = chosen(self.args, self.device.as_ref(), &self.loaded, &method, counters, self.talk)?.options;
        let buffers = &self.main.buffers;
        if buffers.check_made_for(&options).is_err() {
            let of = (counters, &self.stop);
            return opened(self.args, self.device.as_ref(), &self.loaded, &method, of, self.talk);
        }
        let cache = self.args.device.cache()?;
        let tracer = open_tracer(self.device.as_ref(), buffers, &options, self.picture().depth, cache.as_ref())?;
        Ok(Tracing::new(buffers, tracer, &self.stop))
    }

    /// Counted work as false colours.
    fn counted(&mut self, picture: &Picture, counter: WorkCounter) -> Result<Made> {
        let light = self.loaded.added_lamp(&picture.camera);
        let Some((_, tracing)) = &mut self.other else { unreachable!("it was just opened") };
        tracing.light(light)?;
        let result = render(tracing.tracer.as_mut(), &tracing.buffers, picture, &|_| ())?;
        let aov = Aov::new(&result.work.unwrap_or_default(), picture.size, counter);
        Ok(Made {
            film: aov.false_colours(),
            rays: RayCounts::from_counters(&result.counts).total_cast(),
            kernel_s: result.kernel_s,
            error: None,
            brightest: Some(aov.range().brightest),
            wrong: None,
        })
    }

    /// The pixels in red whose hit is not the exact one.
    fn wrong(&mut self, picture: &Picture) -> Result<Made> {
        let (hits, kernel_s) = self.main.hits(picture)?;
        let Some((_, exact)) = &mut self.other else { unreachable!("it was just opened") };
        let (exact, exact_s) = exact.hits(picture)?;
        let wrong = wrong_pixels(&hits, &exact);
        let towards = (picture.camera.target - picture.camera.eye).normalize_or(Vec3::NEG_Z);
        let pixels = exact_colours(&self.loaded.scene, &exact, &wrong, towards);
        let (width, height) = picture.size;
        Ok(Made {
            film: Film { width, height, pixels },
            rays: 2 * hits.len() as u64,
            kernel_s: kernel_s + exact_s,
            error: None,
            brightest: None,
            wrong: Some(wrong.iter().filter(|&&is_wrong| is_wrong).count() as u64),
        })
    }
}

/// What is chosen of a method for a scene.
fn chosen(
    args: &ViewArgs,
    device: Option<&DeviceHandle>,
    loaded: &Loaded,
    method: &MethodArgs,
    counters: bool,
    talk: Talk,
) -> Result<raybrook::low_level::choose::Chosen> {
    let chooser =
        Chooser { counters, pictures: true, ..Chooser::new((method, &args.device, &args.explain), device, talk) };
    chooser.choose(loaded)
}

/// Builds what a method asks for, and opens it.
fn opened(
    args: &ViewArgs,
    device: Option<&DeviceHandle>,
    loaded: &Loaded,
    method: &MethodArgs,
    (counters, stop): (bool, &Arc<AtomicBool>),
    talk: Talk,
) -> Result<Tracing> {
    let chosen = chosen(args, device, loaded, method, counters, talk)?;
    let depth = args.picture.picture(&loaded.scene).depth;
    let tasks = (&[Task::Picture][..], &args.scene.memory.budget());
    let opened = open::open(loaded, device, &args.device, chosen, depth, tasks, talk)?;
    Ok(Tracing::new(&opened.buffers, opened.tracer, stop))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_lead_to_what_is_asked_for() {
        let of = |samples, divisor| finer_steps(Layer::Picture, samples, divisor);
        let errors = |errors: &[f32]| errors.iter().map(|&error| Samples::Error(error)).collect::<Vec<_>>();
        assert_eq!(of(Samples::Error(1.0), 8), errors(&[8.0, 2.5, 1.0]));
        assert_eq!(of(Samples::Error(1.0), 4), errors(&[2.5, 1.0]));
        assert_eq!(of(Samples::Error(1.0), 1), errors(&[1.0]));
        assert_eq!(of(Samples::Error(3.0), 16), errors(&[8.0, 3.0]));
        assert_eq!(of(Samples::Error(100.0), 8), errors(&[100.0]));
        assert_eq!(of(Samples::PerPixel(5), 8), [1, 4, 5].map(Samples::PerPixel));
        assert_eq!(of(Samples::PerPixel(5), 1), [4, 5].map(Samples::PerPixel));
        assert_eq!(of(Samples::PerPixel(1), 8), [Samples::PerPixel(1)]);
        assert_eq!(of(Samples::Corners, 8), [Samples::Corners]);
        assert_eq!(finer_steps(Layer::Wrong, Samples::Error(1.0), 8), [Samples::PerPixel(1)]);
        assert_eq!(finer_steps(Layer::Wrong, Samples::Corners, 8), [Samples::Corners]);
    }

    #[test]
    fn coarse_pictures_are_as_fine_as_there_is_time_for() {
        assert_eq!(divisor(1e6, None), FIRST_DIVISOR);
        assert_eq!(divisor(1e6, Some(1e-9)), 1);
        assert_eq!(divisor(1e6, Some(1e-6)), 8);
        assert_eq!(divisor(1e6, Some(1.0)), MOST_DIVISOR);
    }

    #[test]
    fn names_of_scenes_can_be_typed() {
        assert_eq!(quoted(Path::new("scenes/a-b_1.toml")), "scenes/a-b_1.toml");
        assert_eq!(quoted(Path::new("it's $HOME")), "'it'\\''s $HOME'");
    }
}
