//! All hits of a batch of rays.

use super::Hit;
use crate::parallel;
use crate::tracer;

/// All hits of each ray of a batch; from [`Tracer::all_hits`](crate::Tracer::all_hits).
///
/// ```
/// use raybrook::{Ray, Scene, Tracer};
///
/// // Two squares, one behind the other, of two triangles each.
/// let square = |z| [[0.0, 0.0, z], [4.0, 0.0, z], [4.0, 4.0, z], [0.0, 4.0, z]];
/// let positions = [square(0.0), square(1.0)].concat();
/// let scene = Scene::from_mesh(&positions, &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]])?;
/// let mut tracer = Tracer::new(&scene)?;
/// let down = |x, y| Ray::new([x, y, 3.0], [0.0, 0.0, -1.0]);
/// let all = tracer.all_hits(&[down(3.0, 1.0), down(9.0, 1.0), down(2.0, 2.0)])?;
///
/// let triangles = |ray| all.of_ray(ray).iter().map(|hit| hit.triangle).collect::<Vec<_>>();
/// assert_eq!(triangles(0), [2, 0]); // the closest first
/// assert!(triangles(1).is_empty());
/// assert_eq!(triangles(2), [2, 3, 0, 1]); // an edge belongs to both of its triangles
/// assert_eq!(all.counts().collect::<Vec<_>>(), [2, 0, 4]);
/// # Ok::<(), raybrook::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq)]
pub struct AllHits {
    starts: Vec<usize>,
    hits: Vec<Hit>,
}

impl AllHits {
    pub(super) fn new(found: tracer::AllHits) -> AllHits {
        AllHits { starts: found.starts, hits: parallel::map_slice(&found.hits, Hit::of) }
    }

    /// How many rays there were.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Whether there was no ray.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The hits of a ray, the closest first; of those at the same t that of the lower triangle number.
    ///
    /// # Panics
    /// Where there were not so many rays.
    pub fn of_ray(&self, ray: usize) -> &[Hit] {
        &self.hits[self.starts[ray]..self.starts[ray + 1]]
    }

    /// How many hits each ray has.
    pub fn counts(&self) -> impl ExactSizeIterator<Item = usize> + '_ {
        self.starts.windows(2).map(|ends| ends[1] - ends[0])
    }

    /// The hits of the first ray, then those of the second, and so on.
    pub fn hits(&self) -> &[Hit] {
        &self.hits
    }
}
