//! The rays of a picture judged one by one, by rational arithmetic.
//!
//! Rays are taken from pixels spread over the picture: the camera ray as the device makes it, and the rays that its hit
//! and the hits behind mirrors and glass send out. A device gets each secondary ray as pictures have them, as the
//! direction of a ray that starts in the very point of the triangle that the first one hits. Deeper ones leave the hit
//! of a ray that begins half-way there, at a float's point far from any surface: one that began where the ray before
//! ended, rounded, would lie on either side of that surface. Shadow rays are asked twice: for what they hit first, from
//! the very point, and for whether they hit anything, from a little above it, since only pictures' rays can leave a
//! triangle out.
//!
//! What is right, [`crate::stress::Answers`] says: strictly for the exact test, within what float32 cannot help for the
//! others.

use super::kinds::Kind;
use super::render::{Sent, Truth, TruthRay};
use super::trial::Trial;
use crate::stress::{Answers, Case, ExactTracer, Fault, Mesh, StressRay};
use glam::Vec3;
use raybrook::Result;
use raybrook::low_level::choose::tune::LIFT;
use raybrook::low_level::compare::ulp_distance;
use raybrook::low_level::options::{Intersector, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::parallel;
use raybrook::low_level::reference::shade::camera::camera_direction;
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE, RenderParams};
use raybrook::low_level::tracer::Backend;
use serde::Serialize;
use std::collections::BTreeMap;
use std::sync::Arc;

/// Rays of a picture.
#[derive(Debug, Clone, Default)]
pub struct SampledRays {
    /// From the eye.
    camera: Vec<StressRay>,
    /// By kind, each with the ray that leads to it.
    second: BTreeMap<&'static str, Vec<StressRay>>,
    /// To lights, from rounded points.
    any_hit: Vec<StressRay>,
    /// How far above the surface these start.
    lift: f64,
}

impl SampledRays {
    /// Up to `limit` rays of each kind, from pixels spread evenly over the picture. `params` is what the device makes
    /// camera rays of, `eye` where they start.
    pub fn new(truth: &Truth, params: &RenderParams, eye: Vec3, in_pixel: (f32, f32), limit: usize) -> SampledRays {
        let (width, height) = truth.size();
        let pixels = width as usize * height as usize;
        let step = spread(pixels);
        let mut sampled = SampledRays { lift: f64::from(LIFT) * truth.diagonal(), ..SampledRays::default() };
        for i in 0..pixels.min(limit) {
            let index = (i as u128 * step as u128 % pixels as u128) as u32;
            let (x, y) = (index % width, index / width);
            let direction = camera_direction(params, x as f32 + in_pixel.0, y as f32 + in_pixel.1);
            let camera = StressRay::new(eye, direction);
            sampled.camera.push(camera);
            let mut listener = |sent: Sent| sampled.add(&camera, &sent, limit);
            truth.first_sample(x, y, &mut Trial::exact(), &mut Some(&mut listener));
        }
        sampled
    }

    fn add(&mut self, camera: &StressRay, sent: &Sent, limit: usize) {
        let parent = if sent.from_camera { *camera } else { half_way(sent) };
        let direction = sent.direction.as_vec3();
        let rays = self.second.entry(sent.kind.name()).or_default();
        if rays.len() < limit {
            rays.push(parent.then(direction));
        }
        if sent.kind == Kind::Shadow && self.any_hit.len() < limit {
            let lift = sent.normal * self.lift;
            let origin = (sent.origin + lift).as_vec3();
            let to_light = if sent.t_max == 1.0 { sent.direction - lift } else { sent.direction };
            self.any_hit.push(StressRay::new(origin, to_light.as_vec3()).within(0.0, sent.t_max as f32));
        }
    }
}

/// A step that leads to each of so many pixels once, and spreads those that are met first: by the golden ratio, after
/// which each new point falls into the largest gap that is left.
fn spread(pixels: usize) -> usize {
    let common_divisor = |mut a: usize, mut b: usize| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let golden = (pixels as f64 * (5f64.sqrt() - 1.0) / 2.0) as usize;
    (golden.max(1)..).find(|&step| common_divisor(step, pixels) == 1).unwrap_or(1)
}

/// The ray that met the surface, from half-way on.
fn half_way(sent: &Sent) -> StressRay {
    let TruthRay { origin, direction, .. } = sent.parent;
    StressRay::new((origin + direction * (sent.parent_t / 2.0)).as_vec3(), direction.as_vec3())
}

/// What is to be said of one kind of rays.
#[derive(Debug, Clone, Serialize)]
pub struct RayVerdict {
    /// Of which kind.
    pub kind: String,
    /// How many were traced and judged.
    pub tested: usize,
    /// How many of them hit something.
    pub hits: usize,
    /// How many answers are wrong.
    pub wrong: usize,
    /// What is wrong with them, as the stress test calls it.
    pub faults: BTreeMap<&'static str, usize>,
    /// The largest error of t where the triangle is right, in units in the last place; `None` where only a yes or no
    /// was asked.
    pub t_ulp: Option<u32>,
    /// The same of u.
    pub u_ulp: Option<u32>,
    /// The same of v.
    pub v_ulp: Option<u32>,
}

/// What is to be said of a picture's rays.
#[derive(Debug, Clone, Serialize)]
pub struct RayVerdicts {
    /// Whether answers had to be exact to the last bit of t.
    pub strict: bool,
    /// The most of each kind that were asked for.
    pub limit: usize,
    /// By kind.
    pub kinds: Vec<RayVerdict>,
}

impl RayVerdicts {
    /// Of all kinds.
    pub fn wrong(&self) -> usize {
        self.kinds.iter().map(|kind| kind.wrong).sum()
    }
}

/// Has `tracer` trace the rays, and judges its answers. `progress` hears the part that is done.
///
/// # Errors
/// As [`Backend::trace`].
pub fn judge_rays(
    scene: &Scene,
    buffers: &SceneBuffers,
    options: &TraceOptions,
    tracer: &mut dyn Backend,
    (rays, limit): (SampledRays, usize),
    progress: &(dyn Fn(f64) + Sync),
) -> Result<RayVerdicts> {
    let exact = Arc::new(ExactTracer::new(&Mesh::of_scene(scene)));
    let strict = options.intersector == Intersector::Exact;
    let mut cases = vec![("camera".to_owned(), rays.camera, false)];
    cases.extend(rays.second.into_iter().map(|(name, rays)| (name.to_owned(), rays, false)));
    cases.push(("shadow, any hit".to_owned(), rays.any_hit, true));
    cases.retain(|(_, rays, _)| !rays.is_empty());
    let count = cases.len() as f64;
    let mut kinds = Vec::new();
    for (done, (kind, rays, any_hit)) in cases.into_iter().enumerate() {
        progress(done as f64 / count);
        let case = Case { mesh: Mesh::default(), rays, any_hit };
        kinds.push(judge_case(kind, &case, buffers, tracer, (&exact, strict))?);
    }
    Ok(RayVerdicts { strict, limit, kinds })
}

fn judge_case(
    kind: String,
    case: &Case,
    buffers: &SceneBuffers,
    tracer: &mut dyn Backend,
    (exact, strict): (&Arc<ExactTracer>, bool),
) -> Result<RayVerdict> {
    let ray = |i: usize| {
        let ray = &case.rays[i];
        (ray.origin, ray.direction, ray.t_min, ray.t_max)
    };
    let next = |i: usize| case.rays[i].next.unwrap_or(Vec3::ZERO);
    let next: Option<&(dyn Fn(usize) -> Vec3 + Sync)> = if case.has_second_rays() { Some(&next) } else { None };
    let result = tracer.trace(&buffers.batch(case.rays.len(), ray, next).job(case.any_hit, 1), &|_| ())?;
    let answers = Answers::by(exact, case);
    let judged = parallel::map_numbers(case.rays.len(), |i| {
        let next = result.next_hits.as_ref().map(|hits| &hits[i]);
        let fault = answers.judge(i, &result.hits[i], next, strict);
        let (first, second) = answers.rounded(i);
        let miss = Hit { t: f32::INFINITY, u: 0.0, v: 0.0, primitive: NO_PRIMITIVE };
        match next {
            Some(next) => (fault, *next, second.unwrap_or(miss)),
            None => (fault, result.hits[i], first),
        }
    });
    let mut faults = BTreeMap::new();
    for fault in judged.iter().filter_map(|(fault, ..)| *fault) {
        *faults.entry(fault.name()).or_default() += 1;
    }
    let alike = |(_, found, due): &&(Option<Fault>, Hit, Hit)| {
        due.primitive != NO_PRIMITIVE && found.primitive == due.primitive
    };
    let worst = |of: fn(&Hit) -> f32| {
        let errors = judged.iter().filter(alike).map(|(_, found, due)| ulp_distance(of(found), of(due)));
        (!case.any_hit).then(|| errors.max().unwrap_or(0))
    };
    Ok(RayVerdict {
        kind,
        tested: case.rays.len(),
        hits: judged.iter().filter(|(_, found, _)| found.primitive != NO_PRIMITIVE).count(),
        wrong: faults.values().sum(),
        faults,
        t_ulp: worst(|hit| hit.t),
        u_ulp: worst(|hit| hit.u),
        v_ulp: worst(|hit| hit.v),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn every_pixel_is_met_once_and_the_first_ones_are_spread() {
        for pixels in [1, 2, 7, 12, 64 * 48, 1000] {
            let step = spread(pixels);
            let met: Vec<usize> = (0..pixels).map(|i| i * step % pixels).collect();
            assert_eq!(met.iter().collect::<HashSet<_>>().len(), pixels, "{pixels}");
            let mut first: Vec<usize> = met[..pixels.min(20)].to_vec();
            first.sort_unstable();
            let widest = first.windows(2).map(|pair| pair[1] - pair[0]).max().unwrap_or(0);
            assert!(widest <= pixels.div_ceil(6), "{pixels}: {widest}");
        }
    }
}
