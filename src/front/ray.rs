//! Rays and what they hit.

use crate::shared;
use crate::streamed::OfHit;
use crate::tracer::is_hit;

/// A ray with an interval of t: its points are `origin + t * direction`.
///
/// Every float32 number is taken as it is given, however large or small; see
/// [`Tracer::closest_hits`](crate::Tracer::closest_hits) for NaN, infinities and zero.
///
/// ```
/// use raybrook::Ray;
///
/// let ray = Ray::new([0.0, 0.0, 5.0], [0.0, 0.0, -1.0]);
/// assert_eq!((ray.t_min, ray.t_max), (0.0, f32::INFINITY));
/// let shadow_ray = ray.between(0.0, 1.0); // from the origin to origin + direction
/// assert_eq!(shadow_ray.t_max, 1.0);
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Ray {
    /// Where it starts, world units.
    pub origin: [f32; 3],
    /// Where it goes; any length but zero.
    pub direction: [f32; 3],
    /// Hits nearer than this do not count; in units of |direction|.
    pub t_min: f32,
    /// Hits farther than this do not count; in units of |direction|. A hit at exactly `t_min` or `t_max` counts.
    pub t_max: f32,
}

impl Ray {
    /// A ray from `origin`, with t from 0 to infinity.
    pub const fn new(origin: [f32; 3], direction: [f32; 3]) -> Ray {
        Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }
    }

    /// The same ray with t from `t_min` to `t_max`, both included. Where `t_min` is the greater one, nothing is hit.
    #[must_use]
    pub const fn between(self, t_min: f32, t_max: f32) -> Ray {
        Ray { t_min, t_max, ..self }
    }
}

/// The closest triangle on a ray.
///
/// The point is `origin + t * direction`, or more exactly `(1 - u - v) * p0 + u * p1 + v * p2` of the triangle's
/// vertices.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Hit {
    /// Distance in units of |direction|.
    pub t: f32,
    /// Barycentric weight of vertex 1.
    pub u: f32,
    /// Barycentric weight of vertex 2.
    pub v: f32,
    /// Number of the triangle: of [`Scene::from_mesh`](crate::Scene::from_mesh) its place in the slice; of a file its
    /// place there, after polygons are cut into triangles.
    pub triangle: u32,
}

impl Hit {
    pub(super) fn of(hit: &shared::Hit) -> Hit {
        Hit { t: hit.t, u: hit.u, v: hit.v, triangle: hit.primitive }
    }
}

impl OfHit for Option<Hit> {
    fn of(hit: &shared::Hit) -> Option<Hit> {
        is_hit(hit).then(|| Hit::of(hit))
    }
}

/// Whether there is any.
impl OfHit for bool {
    fn of(hit: &shared::Hit) -> bool {
        is_hit(hit)
    }
}

/// The closest hits of many rays, from [`Tracer::closest_hits_of`](crate::Tracer::closest_hits_of).
#[derive(Debug, Clone, Default)]
pub struct Hits(pub(super) Vec<shared::Hit>);

impl Hits {
    /// How many rays there were.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there were none.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The closest hit of ray number `ray`, `None` for a miss.
    ///
    /// # Panics
    /// Where there is no such ray.
    pub fn get(&self, ray: usize) -> Option<Hit> {
        OfHit::of(&self.0[ray])
    }
}
