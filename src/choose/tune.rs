//! Which methods are the fastest on a device, by measuring, and a file that remembers it for
//! [`Request::choose`](super::Request::choose).
//!
//! Candidates are structures with every size of packets that goes together with exact hits. They trace the same rays by
//! turns, round by round, so that a machine that grows slower or faster meanwhile does so for all; the median of each
//! counts. All of them must give the same answers to the bit ([`SceneTuning::differing`]): tuning changes times, never
//! hits.
//!
//! Bad at: what is not measured. The best for camera, shadow and diffuse rays together need not be the best for each,
//! nor for pictures with glass, which [`Request::choose`](super::Request::choose) therefore leaves to its model.

mod rays;
mod scenes;
mod store;

pub use rays::LIFT;
pub use rays::{Batch, batches};
pub use scenes::{balls, cubes, scene_of};
pub use store::{DeviceKey, TunedFile, Tuning};

use super::{Request, SceneSize, Workload};
use crate::budget::MemoryBudget;
use crate::device::{Cache, DeviceHandle};
use crate::error::{Error, Result};
use crate::io::compare::compare_hits;
use crate::math::median;
use crate::options::{PacketSize, StructureKind, TraceOptions};
use crate::pack::SceneBuffers;
use crate::renderer::open_tracer;
use crate::scene::Scene;
use crate::shared::Hit;
use crate::tracer::{Backend, TraceJob, is_hit, require_clock};
use serde::{Serialize, Serializer};
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

/// What can be chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Candidate {
    /// The structure.
    pub structure: StructureKind,
    /// How many rays are traced together.
    pub packet_size: PacketSize,
}

impl Candidate {
    fn of(options: &TraceOptions) -> Candidate {
        Candidate { structure: options.kind(), packet_size: options.packet_size }
    }

    /// The options, everything else at its default: exact hits.
    pub fn options(self) -> TraceOptions {
        TraceOptions { packet_size: self.packet_size, ..TraceOptions::of(self.structure) }
    }

    /// What the model takes on `device` for a scene of so many triangles.
    fn of_model(device: Option<&DeviceHandle>, triangle_count: usize) -> Result<Candidate> {
        let device = device.map(|device| &device.info);
        let workload = Workload { triangle_count: Some(triangle_count), ..Workload::without_scene(device) };
        Ok(Candidate::of(&Request::default().choose(&workload, None)?.options))
    }
}

/// Such as `bvh2`, or `bvh8, 16 rays at a time`.
impl fmt::Display for Candidate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.packet_size {
            PacketSize::One => write!(f, "{}", self.structure),
            size => write!(f, "{}, {size} rays at a time", self.structure),
        }
    }
}

impl Serialize for Candidate {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        use serde::ser::SerializeStruct;
        let mut fields = serializer.serialize_struct("Candidate", 2)?;
        fields.serialize_field("accel", self.structure.name())?;
        fields.serialize_field("packet_size", self.packet_size.name())?;
        fields.end()
    }
}

/// What is measured, and how thoroughly.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    /// The structures; that of the model is measured beside them in any case. Those whose time is in proportion to the
    /// triangles are left out of scenes of more than [`Plan::MOST_FOR_LISTS`].
    pub structures: Vec<StructureKind>,
    /// Camera rays, from [`Plan::LEAST_RAYS`] on; rounded down to the next square of a power of two.
    pub rays: u32,
    /// How often each candidate traces each batch; at least 1.
    pub rounds: u32,
    /// Which diffuse rays.
    pub seed: u64,
    /// How much memory each structure may take; `None`: what there is when it is built.
    pub memory: Option<MemoryBudget>,
}

impl Default for Plan {
    /// Every structure, 262,144 camera rays, seven rounds.
    fn default() -> Self {
        Plan { structures: StructureKind::ALL.to_vec(), rays: 1 << 18, rounds: 7, seed: 1, memory: None }
    }
}

impl Plan {
    /// Triangles up to which structures that look at all triangles, or at a list of all clusters, are measured.
    pub const MOST_FOR_LISTS: usize = 300;

    /// The fewest camera rays.
    pub const LEAST_RAYS: u32 = 16;

    /// The most camera rays: hits of all candidates are compared in memory.
    pub const MOST_RAYS: u32 = 1 << 24;

    /// Width and height of the picture whose camera rays are traced.
    fn side(&self) -> Result<u32> {
        if !(Self::LEAST_RAYS..=Self::MOST_RAYS).contains(&self.rays) {
            let message = format!("{} is not in {} to {}", self.rays, Self::LEAST_RAYS, Self::MOST_RAYS);
            return Err(Error::option("rays", message));
        }
        Ok(1 << (self.rays.ilog2() / 2))
    }

    /// What is measured in a scene of so many triangles, the model's choice first.
    fn candidates(&self, model: Candidate, triangle_count: usize) -> Vec<Candidate> {
        let is_list = |accel| matches!(accel, StructureKind::Brute | StructureKind::Boxes | StructureKind::Spheres);
        let structures =
            self.structures.iter().filter(|&&accel| triangle_count <= Self::MOST_FOR_LISTS || !is_list(accel));
        let all = structures.flat_map(|&accel| PacketSize::ALL.iter().map(move |&packet_size| (accel, packet_size)));
        let mut candidates = vec![model];
        for (accel, packet_size) in all {
            let candidate = Candidate { structure: accel, packet_size };
            if candidate.options().validate().is_ok() && !candidates.contains(&candidate) {
                candidates.push(candidate);
            }
        }
        candidates
    }
}

/// What was measured of one candidate in one scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Measured {
    /// Which.
    #[serde(flatten)]
    pub candidate: Candidate,
    /// Seconds that building its structure took.
    pub build_s: f64,
    /// Median seconds of device time of camera, shadow and diffuse rays.
    pub kernel_s: [f64; 3],
    /// The same as million rays a second; 0 where there are no such rays.
    pub mrays_per_s: [f64; 3],
    /// The geometric mean, over the kinds of rays, of how many times as fast it is as the model's choice.
    pub ratio: f64,
    /// Answers that differ from those of the model's choice in any bit; of shadow rays in whether there is a hit.
    pub differing: usize,
}

/// What was measured in one scene.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SceneTuning {
    /// The scene's name.
    pub scene: String,
    /// Its triangles that can be hit.
    pub triangle_count: usize,
    /// Its size.
    pub size: SceneSize,
    /// How many camera, shadow and diffuse rays were traced.
    pub rays: [usize; 3],
    /// The candidates, the model's choice first.
    pub measured: Vec<Measured>,
}

impl SceneTuning {
    /// Answers that differ, of all candidates together. Anything but 0 is a fault of a kernel or driver.
    pub fn differing(&self) -> usize {
        self.measured.iter().map(|measured| measured.differing).sum()
    }
}

/// `scene`, or where it is so large that a camera which frames it has no place in float32's range, a smaller one:
/// structures are as fast in it, as all of them are built in one range of numbers.
fn moderate(scene: &Scene) -> Result<Cow<'_, Scene>> {
    let (low, high) = scene.bounds().unwrap_or_default();
    if low.abs().max(high.abs()).max_element() < LARGE {
        return Ok(Cow::Borrowed(scene));
    }
    let mut smaller = scene.flattened()?.into_owned();
    smaller.positions.iter_mut().for_each(|p| *p /= LARGE);
    smaller.camera = None;
    smaller.lights.clear();
    Ok(Cow::Owned(smaller))
}

/// Far from both ends of float32.
const LARGE: f32 = (1u64 << 60) as f32;

/// Measures the candidates of `plan` on `device` (`None`: the reference) in a scene named `name`. `progress` is told
/// what is being done.
///
/// # Errors
/// [`Error::Option`] when `plan` asks for too few or too many rays; else as [`open_tracer`], [`SceneBuffers::new`] and
/// [`Backend::trace`].
pub fn tune_scene(
    device: Option<&DeviceHandle>,
    cache: Option<&Cache>,
    (name, scene): (&str, &Scene),
    plan: &Plan,
    progress: &dyn Fn(&str),
) -> Result<SceneTuning> {
    let scene = &moderate(scene)?;
    let batches = batches(scene, plan.side()?, plan.seed)?;
    let triangle_count = scene.hittable().len();
    let candidates = plan.candidates(Candidate::of_model(device, triangle_count)?, triangle_count);
    let mut runs = Vec::new();
    for (i, candidate) in candidates.iter().enumerate() {
        progress(&format!("{name}: candidate {} of {}: {candidate}", i + 1, candidates.len()));
        let memory = plan.memory.unwrap_or_else(MemoryBudget::available);
        runs.push(Run::new((device, cache), scene, *candidate, &batches, &memory)?);
    }
    for round in 0..plan.rounds.max(1) {
        progress(&format!("{name}: round {} of {}", round + 1, plan.rounds.max(1)));
        for (kind, batch) in batches.iter().enumerate() {
            // Each time another one begins: what a pause before it does to clocks and caches is shared out.
            for turn in 0..runs.len() {
                let next = (turn + round as usize) % runs.len();
                runs[next].time(kind, batch)?;
            }
        }
    }
    let model = runs[0].medians();
    let differing: Vec<usize> = runs.iter().map(|run| run.differing_from(&runs[0], &batches)).collect();
    let measured = runs.iter().zip(differing).map(|(run, differing)| run.measured(&model, &batches, differing));
    Ok(SceneTuning {
        scene: name.to_owned(),
        triangle_count,
        size: SceneSize::of(triangle_count),
        rays: batches.each_ref().map(|batch| batch.rays.len()),
        measured: measured.collect(),
    })
}

/// A candidate that is ready to trace, and what came of that.
struct Run {
    candidate: Candidate,
    build_s: f64,
    tracer: Box<dyn Backend>,
    /// Answers to each batch.
    hits: [Vec<Hit>; 3],
    /// Seconds of each round of each batch.
    seconds: [Vec<f64>; 3],
}

impl Run {
    /// Builds, compiles, and traces each batch once, which is not timed: drivers do much at a first launch.
    fn new(
        (device, cache): (Option<&DeviceHandle>, Option<&Cache>),
        scene: &Scene,
        candidate: Candidate,
        batches: &[Batch; 3],
        memory: &MemoryBudget,
    ) -> Result<Run> {
        let options = candidate.options();
        let buffers = Arc::new(SceneBuffers::within(scene, &options, memory)?);
        let build_s = buffers.build_s;
        let mut tracer = open_tracer(device, &buffers, &options, 1, cache)?;
        let mut hits = [const { Vec::new() }; 3];
        for (hits, batch) in hits.iter_mut().zip(batches) {
            *hits = tracer.trace(&job(batch), &|_| ())?.hits;
        }
        Ok(Run { candidate, build_s, tracer, hits, seconds: [const { Vec::new() }; 3] })
    }

    fn time(&mut self, kind: usize, batch: &Batch) -> Result<()> {
        let result = self.tracer.trace(&job(batch), &|_| ())?;
        require_clock(self.tracer.as_ref())?;
        self.seconds[kind].extend(result.kernel_s);
        Ok(())
    }

    fn medians(&self) -> [f64; 3] {
        self.seconds.each_ref().map(|seconds| median(seconds).unwrap_or_default())
    }

    fn differing_from(&self, other: &Run, batches: &[Batch; 3]) -> usize {
        let pairs = self.hits.iter().zip(&other.hits).zip(batches);
        let differing = pairs.map(|((a, b), batch)| match batch.any_hit {
            // Which hit is found first depends on the structure.
            true => a.iter().zip(b).filter(|(a, b)| is_hit(a) != is_hit(b)).count(),
            false => compare_hits(a, b).differing,
        });
        differing.sum()
    }

    fn measured(&self, model: &[f64; 3], batches: &[Batch; 3], differing: usize) -> Measured {
        let kernel_s = self.medians();
        let rate = |kind: usize| match kernel_s[kind] {
            seconds if seconds > 0.0 => batches[kind].rays.len() as f64 / seconds / 1e6,
            _ => 0.0,
        };
        let ratios = model.iter().zip(&kernel_s).zip(batches);
        let ratios = ratios.filter(|((model, own), batch)| !batch.rays.is_empty() && **model > 0.0 && **own > 0.0);
        Measured {
            candidate: self.candidate,
            build_s: self.build_s,
            kernel_s,
            mrays_per_s: std::array::from_fn(rate),
            ratio: geometric_mean(ratios.map(|((model, own), _)| model / own)),
            differing,
        }
    }
}

fn job(batch: &Batch) -> TraceJob<'_> {
    TraceJob { extreme: &[], rays: &batch.rays, next_directions: None, any_hit: batch.any_hit, repeat: 1 }
}

/// 1 of no numbers.
fn geometric_mean(numbers: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = numbers.fold((0.0, 0), |(sum, count), number| (sum + number.ln(), count + 1));
    if count == 0 { 1.0 } else { (sum / f64::from(count)).exp() }
}

/// How many times as fast as the model's choice another one must be to be taken: what differs by less is noise of the
/// measurement, and the next one might find the opposite.
const LEAST_GAIN: f64 = 1.05;

/// The fastest candidate of scenes of one size, of those that were measured in all of them, and how many times as fast
/// as the model's choice it is; the latter itself, and 1, where nothing is clearly faster. `None` for no scenes, and
/// where answers differ.
pub fn fastest(scenes: &[&SceneTuning]) -> Option<(Candidate, f64)> {
    let (first, others) = scenes.split_first()?;
    if scenes.iter().any(|scene| scene.differing() > 0) {
        return None;
    }
    let ratio_in = |scene: &SceneTuning, candidate: Candidate| {
        scene.measured.iter().find(|measured| measured.candidate == candidate).map(|measured| measured.ratio)
    };
    let of_all = |measured: &Measured| {
        let ratios: Option<Vec<f64>> = others.iter().map(|scene| ratio_in(scene, measured.candidate)).collect();
        Some((measured.candidate, geometric_mean(ratios?.into_iter().chain([measured.ratio]))))
    };
    let model = first.measured.first()?.candidate;
    let best = first.measured.iter().filter_map(of_all).max_by(|(_, a), (_, b)| a.total_cmp(b))?;
    Some(if best.1 >= LEAST_GAIN { best } else { (model, 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    const ONE: PacketSize = PacketSize::One;

    fn scene(ratios: &[(StructureKind, f64)]) -> SceneTuning {
        let measured = |&(accel, ratio): &(StructureKind, f64)| Measured {
            candidate: Candidate { structure: accel, packet_size: ONE },
            build_s: 0.0,
            kernel_s: [1.0; 3],
            mrays_per_s: [1.0; 3],
            ratio,
            differing: 0,
        };
        SceneTuning {
            scene: "made up".to_owned(),
            triangle_count: 1000,
            size: SceneSize::Small,
            rays: [1; 3],
            measured: ratios.iter().map(measured).collect(),
        }
    }

    #[test]
    fn the_fastest_is_that_of_all_scenes_and_clearly_faster() {
        let (bvh2, kd, grid) = (StructureKind::Bvh2, StructureKind::Kd, StructureKind::Grid);
        let fastest_of = |scenes: &[SceneTuning]| {
            let found = fastest(&scenes.iter().collect::<Vec<_>>());
            found.map(|(candidate, ratio)| (candidate.structure, (ratio * 1000.0).round()))
        };
        for (ratios, expected) in [
            (vec![vec![(bvh2, 1.0), (kd, 1.2), (grid, 1.1)]], Some((kd, 1200.0))),
            (vec![vec![(bvh2, 1.0), (kd, 1.04)]], Some((bvh2, 1000.0))),
            (vec![vec![(bvh2, 1.0), (kd, 2.0)], vec![(bvh2, 1.0), (kd, 0.5)]], Some((bvh2, 1000.0))),
            (vec![vec![(bvh2, 1.0), (kd, 2.0), (grid, 1.5)], vec![(bvh2, 1.0), (grid, 1.5)]], Some((grid, 1500.0))),
            (vec![], None),
        ] {
            assert_eq!(fastest_of(&ratios.iter().map(|ratios| scene(ratios)).collect::<Vec<_>>()), expected);
        }
        let mut wrong = scene(&[(bvh2, 1.0), (kd, 1.2)]);
        wrong.measured[1].differing = 1;
        assert_eq!(fastest_of(&[wrong]), None);
    }

    #[test]
    fn candidates_go_together_with_exact_hits_and_lists_are_for_few_triangles() {
        let plan = Plan::default();
        let model = Candidate { structure: StructureKind::Bvh2, packet_size: ONE };
        let few = plan.candidates(model, Plan::MOST_FOR_LISTS);
        let many = plan.candidates(model, Plan::MOST_FOR_LISTS + 1);
        assert_eq!(few[0], model);
        assert_eq!((few.len(), many.len()), (StructureKind::ALL.len() + 2, StructureKind::ALL.len() - 1));
        for accel in [StructureKind::Kd, StructureKind::Bvh8] {
            assert!(few.contains(&Candidate { structure: accel, packet_size: PacketSize::Sixteen }));
        }
        let one = Plan { structures: vec![StructureKind::Kd], ..plan }.candidates(model, 10);
        assert_eq!(
            one.iter().map(|candidate| candidate.structure).collect::<Vec<_>>(),
            [StructureKind::Bvh2, StructureKind::Kd, StructureKind::Kd]
        );
    }
}
