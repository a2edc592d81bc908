//! What a picture knows beside light, on the command line: channels of an .exr file, or pictures beside a .png.

use super::files::Files;
use super::values::Named;
use super::{Talk, heading, work};
use clap::builder::TypedValueParser;
use raybrook::low_level::aov::AovRange;
use raybrook::low_level::film::{Film, ImageFormat};
use raybrook::low_level::layers::{Layer, check_layers, false_colours, layers_bytes, trace_layers};
use raybrook::low_level::output::check_writable;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::planes::{Plane, PlaneGroup, write_exr};
use raybrook::low_level::renderer::{Crop, Picture};
use raybrook::low_level::scene::{Numbering, Samples, Scene};
use raybrook::low_level::shared::WorkCounter;
use raybrook::low_level::tracer::{Backend, Progress, RenderResult, Sampling, Task};
use raybrook::low_level::work::PixelWork;
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};

/// A layer, or a counter of work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Asked {
    Layer(Layer),
    Counter(WorkCounter),
}

/// Everything that `--layers` takes.
fn names() -> Vec<&'static str> {
    let layers = Layer::ALL.iter().map(|layer| layer.name());
    layers.chain(WorkCounter::ALL.iter().map(|counter| counter.name())).collect()
}

/// The layer or counter of this name: whatever a file says, no other is the name of a file.
pub fn known(name: &str) -> Option<&'static str> {
    names().into_iter().find(|known| *known == name)
}

/// What layers and counters of these names may have been written to beside `output`.
pub fn files_of(output: &Path, names: &[&str]) -> Vec<PathBuf> {
    let ending = output.extension().and_then(|ending| ending.to_str()).unwrap_or("png");
    names.iter().flat_map(|name| ["png", ending].map(|ending| work::beside(output, name, ending))).collect()
}

fn parse(text: &str) -> std::result::Result<Asked, String> {
    let layer = Layer::ALL.iter().find(|layer| layer.name() == text).map(|&layer| Asked::Layer(layer));
    let counter = || WorkCounter::ALL.iter().find(|counter| counter.name() == text);
    let asked = layer.or_else(|| counter().map(|&counter| Asked::Counter(counter)));
    asked.ok_or_else(|| format!("no '{text}'; possible: {}", names().join(", ")))
}

fn parser() -> impl TypedValueParser<Value = Asked> {
    Named::new(names(), parse)
}

/// What to tell of pixels beside light.
#[derive(clap::Args)]
pub struct LayerArgs {
    #[arg(
        long,
        value_name = "NAMES",
        value_delimiter = ',',
        value_parser = parser(),
        hide_possible_values = true,
        hide_short_help = true,
        help_heading = heading::OUTPUT,
        help = format!(
            "Write what else is known of the pixels: channels of an .exr file, pictures beside a .png, out-depth.png \
             and so on. One or more of {}; or of the work on rays, which is then counted: {}",
            Layer::names(),
            WorkCounter::names()
        ),
    )]
    layers: Vec<Asked>,
    #[arg(
        long,
        hide_short_help = true,
        help_heading = heading::DIAGNOSIS,
        help = format!(
            "Write false-colour pictures of counted work beside the output, out-steps.png and so on, with --output \
             .exr or .pfm also its numbers in that format; implies --counters. The older way to ask --layers for one \
             or more of {}",
            WorkCounter::names()
        ),
        value_name = "NAMES",
        value_delimiter = ',',
    )]
    aov: Vec<WorkCounter>,
}

impl LayerArgs {
    /// The layers proper.
    fn layers(&self) -> Vec<Layer> {
        let layer = |asked: &Asked| if let Asked::Layer(layer) = asked { Some(*layer) } else { None };
        self.layers.iter().filter_map(layer).collect()
    }

    /// The counters among them.
    fn counters(&self) -> impl Iterator<Item = WorkCounter> + '_ {
        let counter = |asked: &Asked| if let Asked::Counter(counter) = asked { Some(*counter) } else { None };
        self.layers.iter().filter_map(counter)
    }

    /// Those of them that are pictures beside the output.
    fn pictured_counters(&self, format: ImageFormat) -> Vec<WorkCounter> {
        self.counters().filter(|_| format != ImageFormat::Exr).collect()
    }

    /// All counters that are pictures beside the output.
    fn aovs(&self, format: ImageFormat) -> Vec<WorkCounter> {
        [&self.aov[..], &self.pictured_counters(format)].concat()
    }

    /// Whether work is to be counted.
    pub fn wants_counters(&self) -> bool {
        !self.aov.is_empty() || self.counters().next().is_some()
    }

    /// Whether there are layers proper.
    pub fn any(&self) -> bool {
        !self.layers().is_empty()
    }

    /// Whether first hits are to be traced.
    fn wants_hits(&self) -> bool {
        self.layers().iter().any(|layer| layer.is_of_hit())
    }

    /// What a tracer is to be prepared for.
    pub fn tasks(&self) -> &'static [Task] {
        if self.wants_hits() { &[Task::Picture, Task::Batch] } else { &[Task::Picture] }
    }

    /// Whether it is to be kept how pixels are sampled.
    pub fn wants_sampling(&self) -> bool {
        self.layers().iter().any(|layer| !layer.is_of_hit())
    }

    /// The names that the numbers of materials stand for, if these are asked for.
    pub fn materials(&self, scene: &Scene) -> Vec<String> {
        match self.layers().contains(&Layer::Material) {
            true => scene.materials.iter().map(|material| material.name.clone()).collect(),
            false => Vec::new(),
        }
    }

    /// Bytes that the layers of a picture take.
    pub fn bytes(&self, size: (u32, u32)) -> u64 {
        layers_bytes(size, &self.layers())
    }

    /// Checks what does not depend on a scene: that a file of this format can have the layers.
    pub fn check(&self, format: ImageFormat) -> Result<()> {
        if format == ImageFormat::Pfm && !self.layers.is_empty() {
            let message =
                "a .pfm has no layers; write an .exr, which holds them, or a .png, which has pictures beside it";
            return Err(Error::option(Layer::OPTION, message));
        }
        let counters: Vec<_> = self.counters().collect();
        if let Some((_, twice)) = counters.iter().enumerate().find(|(i, counter)| counters[..*i].contains(counter)) {
            return Err(Error::option(Layer::OPTION, format!("{twice} is there twice; leave one out")));
        }
        // Which samples there are the scene may say.
        check_layers(&self.layers(), Samples::DEFAULT)
    }

    /// Checks that a picture of these samples has the layers.
    pub fn check_samples(&self, samples: Samples) -> Result<()> {
        check_layers(&self.layers(), samples)
    }

    /// The pictures of layers proper beside a .png.
    fn pictures<'a>(&self, output: &'a Path, format: ImageFormat) -> impl Iterator<Item = PathBuf> + 'a {
        let layers = if format == ImageFormat::Exr { Vec::new() } else { self.layers() };
        layers.into_iter().map(|layer| work::beside(output, layer.name(), "png"))
    }

    /// Keeps that these files are written.
    pub fn claim(&self, output: &Path, format: ImageFormat, files: &mut Files) -> Result<()> {
        self.pictures(output, format).try_for_each(|path| files.write(&path, "--layers"))?;
        work::claim_aovs(output, format, &self.pictured_counters(format), "--layers", files)?;
        work::claim_aovs(output, format, &self.aov, "--aov", files)
    }

    /// Checks that all files can be written.
    pub fn check_writable(&self, output: &Path, format: ImageFormat) -> Result<()> {
        self.files(output, format).iter().try_for_each(|path| check_writable(path))
    }

    /// The layers of a picture, or of a part of it.
    pub fn trace(
        &self,
        tracer: &mut dyn Backend,
        (buffers, scene): (&SceneBuffers, &Scene),
        picture: &Picture,
        (part, sampling): (Option<Crop>, Option<&Sampling>),
        progress: Progress,
    ) -> Result<Vec<PlaneGroup>> {
        let layers = self.layers();
        if layers.is_empty() {
            return Ok(Vec::new());
        }
        let numbering = Numbering::of(scene, &buffers.used_materials);
        trace_layers(tracer, (buffers, &numbering), picture, part, &layers, sampling, progress)
    }

    /// The names of all that was asked for, in its order.
    pub fn names(&self) -> Vec<&'static str> {
        let name = |asked: &Asked| match asked {
            Asked::Layer(layer) => layer.name(),
            Asked::Counter(counter) => counter.name(),
        };
        self.layers.iter().map(name).chain(self.aov.iter().map(|counter| counter.name())).collect()
    }

    /// All files beside the picture.
    pub fn files(&self, output: &Path, format: ImageFormat) -> Vec<PathBuf> {
        self.pictures(output, format).chain(work::aov_files(output, format, &self.aovs(format))).collect()
    }

    /// Writes the picture, with its layers in it or beside it; tells what the colours of those mean.
    pub fn write(
        &self,
        (output, format): (&Path, ImageFormat),
        result: &RenderResult,
        mut groups: Vec<PlaneGroup>,
        talk: Talk,
    ) -> Result<()> {
        let film: &Film = &result.film;
        if format == ImageFormat::Exr && !self.layers.is_empty() {
            let work = result.work.as_deref().unwrap_or_default();
            groups.extend(self.counters().map(|counter| counted(work, counter)));
            return write_exr(output, film, groups);
        }
        film.write(output, Some(format))?;
        for ((group, layer), path) in groups.iter().zip(self.layers()).zip(self.pictures(output, format)) {
            let colours = false_colours(layer, group, (film.width, film.height));
            colours.film.write(&path, None)?;
            if !talk.quiet {
                say!("{}: {layer}: {}", path.display(), colours.meaning);
            }
        }
        Ok(())
    }

    /// Writes the pictures of counted work and returns what their colours mean.
    pub fn write_aovs(
        &self,
        (output, format): (&Path, ImageFormat),
        work: &[PixelWork],
        size: (u32, u32),
    ) -> Result<Vec<AovRange>> {
        work::write_aovs(output, format, &self.aovs(format), work, size)
    }
}

/// The counts of all rays of each pixel.
fn counted(work: &[PixelWork], counter: WorkCounter) -> PlaneGroup {
    let counts = work.iter().map(|pixel| pixel.total().get(counter)).collect();
    PlaneGroup { name: counter.name().to_owned(), planes: vec![('X', Plane::Uint(counts))] }
}
