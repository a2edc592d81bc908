//! One mesh and the rays that are hard to trace through it.

use super::mesh::Mesh;
use glam::Vec3;
use raybrook::low_level::random::Random;
use raybrook::low_level::rays::RayBatch;

/// A ray, and the direction of the one that leaves its hit, if there is one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StressRay {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes; t counts in it.
    pub direction: Vec3,
    /// No hit is nearer.
    pub t_min: f32,
    /// No hit is farther.
    pub t_max: f32,
    /// Where the secondary ray goes.
    pub next: Option<Vec3>,
}

impl StressRay {
    /// A ray from zero to infinity.
    pub fn new(origin: Vec3, direction: Vec3) -> StressRay {
        StressRay { origin, direction, t_min: 0.0, t_max: f32::INFINITY, next: None }
    }

    /// The ray from `origin` to `target`, which it reaches at t = 1 but for the rounding of the direction.
    pub fn to(origin: Vec3, target: Vec3) -> StressRay {
        StressRay::new(origin, target - origin)
    }

    /// With other limits.
    #[must_use]
    pub fn within(self, t_min: f32, t_max: f32) -> StressRay {
        StressRay { t_min, t_max, ..self }
    }

    /// With a secondary ray.
    #[must_use]
    pub fn then(self, next: Vec3) -> StressRay {
        StressRay { next: Some(next), ..self }
    }
}

/// A mesh and rays. Either all rays have a second one or none has.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Case {
    /// What the rays may hit.
    pub mesh: Mesh,
    /// The rays.
    pub rays: Vec<StressRay>,
    /// Whether any hit within the limits will do, as for shadows. The rays have no second ones then.
    pub any_hit: bool,
}

impl Case {
    /// Origin, direction, t_min and t_max of a ray.
    pub fn ray(&self, index: usize) -> (Vec3, Vec3, f32, f32) {
        let ray = &self.rays[index];
        (ray.origin, ray.direction, ray.t_min, ray.t_max)
    }

    /// `count` rays, each made by `ray` from the mesh, random numbers and its number.
    pub fn new(
        mesh: Mesh,
        count: usize,
        random: &mut Random,
        mut ray: impl FnMut(&Mesh, &mut Random, usize) -> StressRay,
    ) -> Case {
        let rays = (0..count).map(|i| ray(&mesh, random, i)).collect();
        Case { mesh, rays, any_hit: false }
    }

    /// Everything `factor` times as large, directions too: for a power of two nothing but exponents change.
    #[must_use]
    pub fn scaled(mut self, factor: f32) -> Case {
        self.mesh = self.mesh.mapped(|p| p * factor);
        for ray in &mut self.rays {
            ray.origin *= factor;
            ray.direction *= factor;
        }
        self
    }

    /// Whether the rays have second ones.
    pub fn has_second_rays(&self) -> bool {
        self.rays.first().is_some_and(|ray| ray.next.is_some())
    }

    /// The rays of the given numbers as a batch for the tracers.
    pub fn batch(&self, numbers: &[usize]) -> RayBatch {
        let rays = || numbers.iter().map(|&i| self.rays[i]);
        RayBatch {
            origins: rays().map(|ray| ray.origin.into()).collect(),
            directions: rays().map(|ray| ray.direction.into()).collect(),
            t_min: Some(rays().map(|ray| ray.t_min).collect()),
            t_max: Some(rays().map(|ray| ray.t_max).collect()),
            next_directions: self
                .has_second_rays()
                .then(|| rays().filter_map(|ray| ray.next).map(Into::into).collect()),
            ignored: Vec::new(),
        }
    }

    /// A case of any mesh and rays.
    pub fn from_batch(mesh: Mesh, batch: &RayBatch) -> Case {
        let limit = |limits: &Option<Vec<f32>>, i: usize, default| limits.as_ref().map_or(default, |limits| limits[i]);
        let ray = |i: usize| StressRay {
            origin: batch.origins[i].into(),
            direction: batch.directions[i].into(),
            t_min: limit(&batch.t_min, i, 0.0),
            t_max: limit(&batch.t_max, i, f32::INFINITY),
            next: batch.next_directions.as_ref().map(|next| next[i].into()),
        };
        Case { mesh, rays: (0..batch.len()).map(ray).collect(), any_hit: false }
    }
}
