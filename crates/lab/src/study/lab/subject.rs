//! A scene and its rays, and the judge of answers to them.

use crate::stress::{Case, ExactTracer, Interval, Mesh, StressRay};
use crate::study::fingerprint::fingerprint;
use glam::{DVec3, Vec3};
use raybrook::Result;
use raybrook::low_level::choose::tune::{Batch, LIFT, batches};
use raybrook::low_level::compare::ulp_distance;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::pack::scale_of;
use raybrook::low_level::parallel;
use raybrook::low_level::random::Random;
use raybrook::low_level::reference::oracle::{Oracle, OracleHit, OracleRay};
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE, TraceRay};
use raybrook::low_level::tracer::is_hit;
use std::sync::{Arc, OnceLock};

/// Answers that rational arithmetic judges, at most; the oracle's word stands for others.
const MOST_JUDGED_EXACTLY: usize = 2000;

/// A scene, its rays and what is right for them.
pub struct Subject {
    /// Its name.
    pub name: String,
    /// It.
    pub scene: Arc<Scene>,
    /// Triangles that can be hit.
    pub triangle_count: usize,
    /// Camera, shadow and diffuse rays.
    pub batches: [Batch; 3],
    /// A checksum of the scene.
    pub(super) fingerprint: String,
    scale: f32,
    truths: [OnceLock<Vec<Option<OracleHit>>>; 3],
    judges: Arc<Judges>,
}

/// Those who know the answers for a scene, when somebody asks.
#[derive(Default)]
struct Judges {
    oracle: OnceLock<Oracle>,
    exact: OnceLock<ExactTracer>,
}

impl Subject {
    /// The scene with `side` x `side` camera rays and what follows from them.
    ///
    /// # Errors
    /// As [`batches`].
    pub fn new(name: &str, scene: Scene, side: u32, seed: u64) -> Result<Subject> {
        let batches = batches(&scene, side, seed)?;
        let scale = scale_of(&scene);
        let triangle_count = scene.hittable().len();
        let fingerprint = fingerprint(&scene);
        Ok(Subject {
            name: name.to_owned(),
            scene: Arc::new(scene),
            triangle_count,
            batches,
            fingerprint,
            scale,
            truths: Default::default(),
            judges: Arc::default(),
        })
    }

    /// The same scene with rays that leave the camera rays' hits as off a mirror and as into glass, and the camera rays
    /// in random order.
    pub fn secondary(&self, seed: u64) -> Subject {
        const GLASS: f32 = 1.5;
        let camera = &self.batches[0];
        let (low, high) = self.scene.bounds().unwrap_or_default();
        let lift = (high - low).length() * LIFT * self.scale;
        let (mut reflected, mut refracted) = (Vec::new(), Vec::new());
        for (ray, hit) in camera.rays.iter().zip(self.truths(0)) {
            let Some(hit) = hit else { continue };
            let direction = ray.direction_t_max.xyz();
            let [p0, p1, p2] = self.scene.vertices(hit.primitive as usize);
            let normal = (p1 - p0).cross(p2 - p0).normalize();
            let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
            // t counts in world units.
            let at = ray.origin_t_min.xyz() + direction * (hit.t as f32 * self.scale);
            let leaving = |origin, direction| TraceRay {
                origin_t_min: Float4::new(origin, 0.0),
                direction_t_max: Float4::new(direction, f32::INFINITY),
            };
            let unit = direction.normalize();
            reflected.push(leaving(at + normal * lift, unit.reflect(normal)));
            refracted.push(leaving(at - normal * lift, unit.refract(normal, 1.0 / GLASS)));
        }
        let mut shuffled = camera.rays.clone();
        let mut random = Random::new(seed);
        for i in (1..shuffled.len()).rev() {
            shuffled.swap(i, random.below(i + 1));
        }
        let batch = |name, rays| Batch { name, rays, any_hit: false };
        Subject {
            name: self.name.clone(),
            scene: self.scene.clone(),
            triangle_count: self.triangle_count,
            batches: [batch("reflected", reflected), batch("refracted", refracted), batch("shuffled", shuffled)],
            fingerprint: self.fingerprint.clone(),
            scale: self.scale,
            truths: Default::default(),
            judges: self.judges.clone(),
        }
    }

    /// Origins, in world units, and directions of the camera rays.
    pub fn camera_rays(&self) -> Vec<(DVec3, DVec3)> {
        let in_world = self.batches[0].rays.iter().map(|ray| self.in_world(ray));
        in_world.map(|ray| (ray.origin, ray.direction)).collect()
    }

    /// The corners of the triangles that can be hit.
    pub fn triangles(&self) -> impl Iterator<Item = [DVec3; 3]> {
        let hittable = self.scene.hittable();
        hittable.into_iter().map(|i| self.scene.vertices(i as usize).map(Vec3::as_dvec3))
    }

    /// A batch in world units, with the scene's triangles by their numbers.
    ///
    /// # Errors
    /// As [`Mesh::try_from`].
    pub(in crate::study) fn case(&self, kind: usize) -> Result<Case> {
        let batch = &self.batches[kind];
        let in_world = |ray: &TraceRay| {
            let (origin, direction) = (ray.origin_t_min.xyz() / self.scale, ray.direction_t_max.xyz());
            StressRay::new(origin, direction).within(ray.origin_t_min.w, ray.direction_t_max.w)
        };
        let rays = batch.rays.iter().map(in_world).collect();
        Ok(Case { mesh: Mesh::try_from(&*self.scene)?, rays, any_hit: batch.any_hit })
    }

    /// The oracle's answers to a batch.
    fn truths(&self, kind: usize) -> &[Option<OracleHit>] {
        self.truths[kind].get_or_init(|| {
            let oracle = self.judges.oracle.get_or_init(|| Oracle::new(&self.scene));
            parallel::map_slice(&self.batches[kind].rays, |ray| oracle.closest(&self.in_world(ray)))
        })
    }

    fn in_world(&self, ray: &TraceRay) -> OracleRay {
        OracleRay {
            origin: (ray.origin_t_min.xyz() / self.scale).as_dvec3(),
            direction: ray.direction_t_max.xyz().as_dvec3(),
            t_min: ray.origin_t_min.w.into(),
            t_max: ray.direction_t_max.w.into(),
            skip: NO_PRIMITIVE,
        }
    }

    /// How many answers to a batch are wrong, and the largest error of t of the others in units in the last place.
    pub fn judge(&self, kind: usize, hits: &[Hit]) -> (usize, u32) {
        let any_hit = self.batches[kind].any_hit;
        let truths = self.truths(kind);
        let is_as_oracle = |(hit, truth): (&Hit, &Option<OracleHit>)| match truth {
            None => !is_hit(hit),
            Some(truth) => is_hit(hit) && (any_hit || hit.primitive == truth.primitive),
        };
        let largest_t_ulp = hits.iter().zip(truths).filter_map(|(hit, truth)| {
            let truth = truth.filter(|truth| !any_hit && truth.primitive == hit.primitive)?;
            Some(ulp_distance(hit.t, truth.t as f32))
        });
        let suspects: Vec<_> = (0..hits.len()).filter(|&i| !is_as_oracle((&hits[i], &truths[i]))).collect();
        let judged = &suspects[..suspects.len().min(MOST_JUDGED_EXACTLY)];
        let right = judged.iter().filter(|&&i| self.is_exactly_right(kind, i, &hits[i])).count();
        (suspects.len() - right, largest_t_ulp.max().unwrap_or(0))
    }

    /// Whether an answer is right by rational arithmetic: neighbours that are met at exactly the same t are alike.
    fn is_exactly_right(&self, kind: usize, index: usize, hit: &Hit) -> bool {
        let exact = self.judges.exact.get_or_init(|| ExactTracer::new(&Mesh::of_scene(&self.scene)));
        let batch = &self.batches[kind];
        let ray = self.in_world(&batch.rays[index]);
        let interval = Interval { near: ray.t_min as f32, far: ray.t_max as f32, is_open: false };
        let line = exact.line(ray.origin, ray.direction);
        match line.and_then(|line| exact.closest(&line, interval, &[], |_| true)) {
            None => !is_hit(hit),
            Some(closest) => is_hit(hit) && (batch.any_hit || closest.primitives.contains(&hit.primitive)),
        }
    }
}
