//! Measures of whole pictures.

use super::{Lab, Variant, errors, promise, spread_of};
use crate::study::fingerprint::fingerprint;
use crate::study::lookup::Clock;
use crate::study::scenes::mirror_room;
use crate::study::table::{Row, number, row};
use raybrook::Result;
use raybrook::low_level::compare::compare_films;
use raybrook::low_level::device::{DeviceHandle, DeviceKind};
use raybrook::low_level::film::Film;
use raybrook::low_level::options::{PacketSize, StructureKind, TexturePass, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::parallel;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{Samples, Scene};
use raybrook::low_level::stats::{RayCounts, median};
use raybrook::low_level::tracer::{Backend, RenderResult, require_clock};
use serde_json::{Value, json};
use std::sync::Arc;
use std::time::Instant;

/// Samples a pixel of pictures that the reference renders, too, at most, and their size, at most: it takes its time.
const MOST_SAMPLES_CHECKED: u32 = 4;
const LARGEST_CHECKED: (u32, u32) = (256, 144);

/// A way to render a picture.
pub struct PictureVariant {
    /// Its name.
    pub label: String,
    /// The method.
    pub options: TraceOptions,
    /// Where camera rays pass.
    pub samples: Samples,
    /// Longest chain of rays.
    pub depth: u32,
    /// As [`Picture::kill_weight`].
    pub kill_weight: Option<f32>,
    /// Further columns of its row.
    pub columns: Row,
}

impl PictureVariant {
    /// A picture of so many samples a pixel and chains of so many rays.
    pub fn new(label: impl Into<String>, options: TraceOptions, samples: u32, depth: u32) -> PictureVariant {
        let samples = Samples::PerPixel(samples);
        PictureVariant { label: label.into(), options, samples, depth, kill_weight: None, columns: Row::new() }
    }

    /// A picture by its error, in steps of 8-bit sRGB, by which it is called.
    pub fn of_error(options: TraceOptions, error: f32, depth: u32) -> PictureVariant {
        let variant = PictureVariant::new(format!("error {error}"), options, 1, depth);
        PictureVariant { samples: Samples::Error(error), ..variant }
    }

    /// With every ray, also those that cannot change a pixel.
    #[must_use]
    pub fn without_killing(self) -> PictureVariant {
        PictureVariant { kill_weight: Some(0.0), ..self }
    }

    /// With a further column.
    #[must_use]
    pub fn with(mut self, name: &str, value: impl Into<Value>) -> PictureVariant {
        self.columns.insert(name.to_owned(), value.into());
        self
    }
}

/// A picture that is ready to be rendered, and what came of it.
struct Run {
    picture: Picture,
    buffers: Arc<SceneBuffers>,
    tracer: Box<dyn Backend>,
    times: Times,
}

/// Seconds of each round.
#[derive(Default)]
struct Times {
    /// By the wall clock, from the call to the finished picture.
    wall: Vec<f64>,
    /// Device and host together, without what lies between them.
    work: Vec<f64>,
    /// The host's parts.
    decide: Vec<f64>,
    textures: Vec<f64>,
}

impl Times {
    /// Their columns.
    fn columns(&self) -> Row {
        let mut out = row([("passes", json!(self.wall.len())), (Clock::Wall.column(), json!(self.wall))]);
        let spreads = [
            (&self.wall, ["wall_s", "wall_low", "wall_high"]),
            (&self.work, ["seconds", "seconds_low", "seconds_high"]),
        ];
        for (seconds, columns) in spreads {
            let Some(middle) = median(seconds).filter(|&seconds| seconds > 0.0) else { continue };
            let [low, high] = spread_of(seconds);
            out.extend(
                columns.into_iter().zip([middle, low, high]).map(|(name, value)| (name.to_owned(), json!(value))),
            );
        }
        if let Some(wall_s) = number(&out, "wall_s") {
            out.insert("frames_per_s".into(), json!(1.0 / wall_s));
        }
        for (column, host_s) in [("decide_s", &self.decide), ("textures_s", &self.textures)] {
            out.extend(median(host_s).filter(|&s| s > 0.0).map(|s| (column.to_owned(), json!(s))));
        }
        out
    }
}

impl Run {
    fn render(&mut self) -> Result<RenderResult> {
        self.render_sized(self.picture.size)
    }

    /// The same picture in another size.
    fn render_sized(&mut self, size: (u32, u32)) -> Result<RenderResult> {
        let picture = Picture { size, ..self.picture };
        render(self.tracer.as_mut(), &self.buffers, &picture, &|_| ())
    }

    /// Renders the picture and keeps what it took.
    fn time(&mut self) -> Result<()> {
        let start = Instant::now();
        let result = self.render()?;
        let wall_s = start.elapsed().as_secs_f64();
        require_clock(self.tracer.as_ref())?;
        // Between the rounds of a picture by its error the device waits for the host, who decides what is traced next
        // or starts what does; and for the host's colours.
        let decide_s = result.adaptive.map_or(0.0, |adaptive| adaptive.decide_s);
        let textures_s = result.wavefront.map_or(0.0, |wavefront| wavefront.host_pass_s);
        let Times { wall, work, decide, textures } = &mut self.times;
        wall.push(wall_s);
        work.push(result.kernel_s + decide_s + textures_s);
        decide.push(decide_s);
        textures.push(textures_s);
        Ok(())
    }
}

impl Lab<'_> {
    /// Width and height of pictures: less where no GPU makes them, and little in a hurry.
    pub fn picture_size(&self) -> (u32, u32) {
        match (self.quick, self.device) {
            (true, Some(_)) => (160, 90),
            (true, None) => (96, 54),
            (false, Some(device)) if device.info.kind == DeviceKind::Gpu => (1920, 1080),
            (false, Some(_)) => (960, 540),
            (false, None) => (192, 108),
        }
    }

    /// Renders pictures of a scene by turns with all `variants`, and tells of each what it took, how many pixels
    /// of a small one differ from the reference's (where samples are few), and how far it is from the picture of
    /// `converged` samples and depth, if that is given.
    ///
    /// # Errors
    /// As [`SceneBuffers::new`], [`open_tracer`] and [`Backend::render`].
    pub fn pictures(
        &mut self,
        scene_name: &str,
        scene: &Scene,
        variants: &[PictureVariant],
        converged: Option<(u32, u32)>,
    ) -> Result<Vec<Row>> {
        let settings: Vec<_> = variants
            .iter()
            .map(|v| json!([v.label, v.options, format!("{:?}", v.samples), v.depth, v.kill_weight, v.columns]))
            .collect();
        let triangle_count = scene.hittable().len();
        let key = json!(["pictures", scene_name, fingerprint(scene), self.picture_size(), settings, converged]);
        if let Some(rows) = self.journal.find(&key) {
            return Ok(rows);
        }
        let size = self.picture_size();
        let mut scene = scene.clone();
        complete(&mut scene, size.0 as f32 / size.1 as f32);
        let truth = match (converged, variants.first()) {
            (Some((samples, depth)), Some(first)) => {
                (self.progress)(&format!("{scene_name}: {samples} samples a pixel"));
                let best = PictureVariant::new("", first.options, samples, depth);
                Some(self.start_picture(self.device, &scene, &best, size)?.render()?.film)
            }
            _ => None,
        };
        let (mut runs, mut rows, mut films) = (Vec::new(), Vec::new(), Vec::new());
        for variant in variants {
            (self.progress)(&format!("{scene_name}: {}", variant.label));
            let mut run = self.start_picture(self.device, &scene, variant, size)?;
            // Not timed: drivers do much at a first launch.
            let result = run.render()?;
            let mut out = row([
                ("scene", json!(scene_name)),
                ("triangles", json!(triangle_count)),
                ("method", json!(variant.label)),
                ("depth", json!(variant.depth)),
                ("pixels", json!(result.film.pixels.len())),
            ]);
            match variant.samples {
                Samples::Error(error) => out.insert("asked".into(), json!(error)),
                fixed => out.insert("samples".into(), json!(fixed.per_pixel())),
            };
            out.extend(variant.columns.clone());
            out.insert("rays".into(), json!(result.counts.iter().step_by(2).sum::<u64>()));
            if let Some(wavefront) = result.wavefront {
                out.insert("launches".into(), json!(wavefront.launches));
                if variant.options.picture.textures == TexturePass::HostPass {
                    out.insert("host_colours".into(), json!(wavefront.host_colours));
                }
            }
            out.extend(self.differing_pixels(&scene, variant, &mut run)?);
            films.push(result.film);
            runs.push(run);
            rows.push(out);
        }
        if let Some(truth) = &truth {
            // FLIP takes seconds for a large picture, on one core.
            let errors = parallel::map_slice(&films, |film| errors_to(truth, film));
            rows.iter_mut().zip(errors).for_each(|(out, errors)| out.extend(errors));
        }
        drop(films);
        let start = Instant::now();
        let mut round = 0;
        while self.goes_on(round, start) {
            for turn in 0..runs.len() {
                let next = (turn + round) % runs.len();
                runs[next].time()?;
            }
            round += 1;
        }
        for (out, run) in rows.iter_mut().zip(&runs) {
            out.extend(run.times.columns());
        }
        self.journal.keep(&key, &rows)?;
        Ok(rows)
    }

    /// A small picture of a scene, by the reference.
    ///
    /// # Errors
    /// As [`SceneBuffers::new`] and [`Backend::render`].
    pub(in crate::study) fn picture(&self, scene: &Scene, size: (u32, u32)) -> Result<Film> {
        let mut scene = scene.clone();
        complete(&mut scene, size.0 as f32 / size.1 as f32);
        let variant = PictureVariant::new("", TraceOptions::of(StructureKind::Bvh2), 4, 8);
        Ok(self.start_picture(None, &scene, &variant, size)?.render()?.film)
    }

    /// Renders a closed room of mirrors from inside with all `variants` and chains of `depth` rays, and tells of each
    /// how many chains escaped: one row each.
    ///
    /// # Errors
    /// As [`SceneBuffers::new`], [`open_tracer`] and [`Backend::render`].
    pub fn lost_paths(&mut self, variants: &[Variant], depth: u32) -> Result<Vec<Row>> {
        let settings: Vec<_> = variants.iter().map(|v| json!([v.label, v.options])).collect();
        let key = json!(["lost paths", depth, self.picture_size(), settings]);
        if let Some(rows) = self.journal.find(&key) {
            return Ok(rows);
        }
        (self.progress)(&format!("chains of {depth} rays"));
        let scene = mirror_room()?;
        let mut rows = Vec::new();
        for Variant { label, options, .. } in variants {
            let variant = PictureVariant::new(label, *options, 1, depth).without_killing();
            let result = self.start_picture(self.device, &scene, &variant, self.picture_size())?.render()?;
            let RayCounts { camera, reflected, .. } = RayCounts::from_counters(&result.counts);
            let lost = camera.cast + reflected.cast - camera.hit - reflected.hit;
            let mut out = row([("method", json!(label)), ("depth", json!(depth))]);
            out.extend(promise(options));
            out.extend(errors(lost as usize, camera.cast as usize));
            rows.push(out);
        }
        self.journal.keep(&key, &rows)?;
        Ok(rows)
    }

    fn start_picture(
        &self,
        device: Option<&DeviceHandle>,
        scene: &Scene,
        variant: &PictureVariant,
        size: (u32, u32),
    ) -> Result<Run> {
        let buffers = Arc::new(self.pack(scene, &variant.options)?);
        let tracer = open_tracer(device, &buffers, &variant.options, variant.depth, self.cache)?;
        let picture = Picture {
            camera: scene.camera.expect("a completed scene has a camera"),
            size,
            samples: variant.samples,
            depth: variant.depth,
            kill_weight: variant.kill_weight,
        };
        Ok(Run { picture, buffers, tracer, times: Times::default() })
    }

    /// How many pixels of a small picture the reference has otherwise; nothing where that would take too long.
    fn differing_pixels(&self, scene: &Scene, variant: &PictureVariant, run: &mut Run) -> Result<Row> {
        let are_few = matches!(variant.samples, Samples::PerPixel(samples) if samples <= MOST_SAMPLES_CHECKED);
        if self.device.is_none() || !are_few {
            return Ok(Row::new());
        }
        let (width, height) = self.picture_size();
        let size = (width.min(LARGEST_CHECKED.0), height.min(LARGEST_CHECKED.1));
        // One ray at a time gives the same pixels as packets.
        let options = TraceOptions { packet_size: PacketSize::One, ..variant.options };
        let same = PictureVariant { label: String::new(), options, columns: Row::new(), ..*variant };
        let reference = self.start_picture(None, scene, &same, size)?.render()?.film;
        let found = run.render_sized(size)?.film;
        Ok(row([
            ("wrong_pixels", json!(compare_films(&reference, &found).differing_pixels)),
            ("checked_pixels", json!(size.0 * size.1)),
        ]))
    }
}

/// How far a picture is from the converged one.
fn errors_to(truth: &Film, film: &Film) -> Row {
    let difference = compare_films(truth, film);
    let mut out = row([("rmse", json!(difference.rms)), ("error", json!(difference.rms_8bit))]);
    out.extend(difference.flip_mean.map(|flip| ("flip".to_owned(), json!(flip))));
    out
}
