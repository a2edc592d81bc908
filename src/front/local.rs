//! Coordinates of f64: float32 numbers around an origin, and what is lost of them.

use std::ops::AddAssign;

/// Where float32 coordinates count from, so that as little as possible of f64 ones gets lost.
///
/// Scenes and rays are float32 numbers. Places on the earth in metres, as surveys have them, need f64: the next float32
/// number after 4,649,776 is half a metre away. What is near them fits into float32 when it counts from a place nearby.
/// What does not fit is rounded, and [`Rounding`] tells how much of it and by how much.
///
/// ```
/// use raybrook::{LocalSpace, Ray, Scene, Tracer};
///
/// let (x, y) = (500_000.25, 4_649_776.125);
/// let positions = [[x, y, 0.0], [x + 4.0, y, 0.0], [x, y + 4.0, 0.0]];
/// let space = LocalSpace::around(&positions);
/// let (local, rounding) = space.points(&positions);
/// assert!(rounding.is_none()); // by float32 alone y would be off by 0.125
///
/// let mut tracer = Tracer::new(&Scene::from_mesh(&local, &[[0, 1, 2]])?)?;
/// let (origins, _) = space.points(&[[x + 1.0, y + 1.0, 5.0]]);
/// let hit = tracer.closest_hits(&[Ray::new(origins[0], [0.0, 0.0, -1.0])])?[0].expect("it hits the triangle");
/// assert_eq!((hit.t, hit.u, hit.v), (5.0, 0.25, 0.25));
/// assert_eq!(space.world_point([0.0, 0.0, 0.0]), space.origin());
/// # Ok::<(), raybrook::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct LocalSpace {
    origin: [f64; 3],
}

/// How many coordinates were rounded, and by how much.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Rounding {
    /// How many numbers there were.
    pub count: usize,
    /// How many of them are another number now.
    pub rounded: usize,
    /// The largest difference, in the units of the numbers; infinite where one is beyond float32's range.
    pub largest: f64,
}

impl Rounding {
    /// Whether all numbers are as they were.
    pub fn is_none(&self) -> bool {
        self.rounded == 0
    }

    fn of(given: f64, origin: f64) -> (f32, Rounding) {
        let from_origin = given - origin;
        let local = from_origin as f32;
        // What the difference itself has lost: Knuth's exact sum of two numbers (The Art of Computer Programming, vol.
        // 2, 4.2.2).
        let lost = {
            let back = from_origin - given;
            (given - (from_origin - back)) + (-origin - back)
        };
        let difference = ((from_origin - f64::from(local)) + lost).abs();
        // What is no number stays what it is.
        let largest = if given.is_finite() { difference } else { 0.0 };
        (local, Rounding { count: 1, rounded: usize::from(largest != 0.0), largest })
    }
}

impl AddAssign for Rounding {
    fn add_assign(&mut self, other: Rounding) {
        self.count += other.count;
        self.rounded += other.rounded;
        self.largest = self.largest.max(other.largest);
    }
}

impl LocalSpace {
    /// The space for what is around `points`. Its origin is 0 where they are float32 numbers already, and on every axis
    /// on which they are as far from each other as from 0; else a round number among them, so that differences to it
    /// stay exact.
    pub fn around(points: &[[f64; 3]]) -> LocalSpace {
        let is_float = |&x: &f64| f64::from(x as f32) == x || !x.is_finite();
        if points.as_flattened().iter().all(is_float) {
            return LocalSpace::default();
        }
        LocalSpace { origin: [0, 1, 2].map(|axis| round_middle(points.iter().map(|p| p[axis]))) }
    }

    /// The space with (0, 0, 0) at `origin`.
    pub fn at(origin: [f64; 3]) -> LocalSpace {
        LocalSpace { origin }
    }

    /// A coordinate on `axis` (0, 1 or 2) in float32, from the origin on, and what got lost.
    ///
    /// # Panics
    /// When there is no such axis.
    pub fn coordinate(&self, axis: usize, given: f64) -> (f32, Rounding) {
        Rounding::of(given, self.origin[axis])
    }

    /// Where (0, 0, 0) is.
    pub fn origin(&self) -> [f64; 3] {
        self.origin
    }

    /// Points in float32, from the origin on, and what got lost.
    pub fn points(&self, points: &[[f64; 3]]) -> (Vec<[f32; 3]>, Rounding) {
        self.rounded(points)
    }

    /// Directions in float32, and what got lost.
    pub fn directions(&self, directions: &[[f64; 3]]) -> (Vec<[f32; 3]>, Rounding) {
        LocalSpace::default().rounded(directions)
    }

    /// Where a point is in the world.
    pub fn world_point(&self, point: [f32; 3]) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(point[axis]) + self.origin[axis])
    }

    fn rounded(&self, points: &[[f64; 3]]) -> (Vec<[f32; 3]>, Rounding) {
        let mut rounding = Rounding::default();
        let mut coordinate = |axis: usize, given: f64| {
            let (local, lost) = self.coordinate(axis, given);
            rounding += lost;
            local
        };
        let points = points.iter().map(|p| [coordinate(0, p[0]), coordinate(1, p[1]), coordinate(2, p[2])]).collect();
        (points, rounding)
    }
}

/// A number near the middle of `numbers` that is a multiple of a power of two not below their extent: it has so few
/// bits that a difference to one of them has no more than that had. 0 where they reach to both sides of 0.
fn round_middle(numbers: impl Iterator<Item = f64>) -> f64 {
    let finite = numbers.filter(|x| x.is_finite());
    let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), x| (low.min(x), high.max(x)));
    // Halves, so that the extent is a number.
    let (middle, half_extent) = (0.5 * low + 0.5 * high, 0.5 * high - 0.5 * low);
    let is_far_away = half_extent < middle.abs(); // not so of no numbers at all, either
    if !is_far_away {
        return 0.0;
    }
    if half_extent == 0.0 {
        return middle;
    }
    let step = (2.0 * half_extent).log2().ceil().exp2();
    (middle / step).round() * step
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    #[test]
    fn what_is_float32_stays_where_it_is() {
        let points = [[1e30, 0.5, -1.0], [1e30f32.into(), f64::NAN, f64::INFINITY], [3.0, 1.25, 2.0]];
        let points = points.map(|p: [f64; 3]| p.map(|x| f64::from(x as f32)));
        let space = LocalSpace::around(&points);
        assert_eq!(space.origin(), [0.0; 3]);
        let (local, rounding) = space.points(&points);
        assert_eq!((rounding, local[2]), (Rounding { count: 9, rounded: 0, largest: 0.0 }, [3.0, 1.25, 2.0]));
        assert!(local[1][1].is_nan() && local[1][2] == f32::INFINITY);
        assert_eq!(LocalSpace::around(&[]), LocalSpace::default());
    }

    #[test]
    fn far_away_nothing_gets_lost_that_fits() {
        let mut random = Random::new(20_081_121);
        for far in [1e3, 4_649_776.0, -3e9, 1e12] {
            // Multiples of 2^-14 within a few hundred: 24 bits.
            let number = |x: f32| far + (f64::from(x) * 200.0 * 16384.0).round() / 16384.0;
            let points: Vec<[f64; 3]> =
                (0..1000).map(|_| random.vec3()).map(|p| [number(p.x), number(p.y), f64::from(p.z)]).collect();
            let space = LocalSpace::around(&points);
            let (local, rounding) = space.points(&points);
            assert_eq!((space.origin()[2], rounding.rounded), (0.0, 0), "{far}: {space:?}, {rounding:?}");
            assert!(local.iter().zip(&points).all(|(&local, &given)| space.world_point(local) == given));
        }
    }

    #[test]
    fn what_gets_lost_is_told() {
        let space = LocalSpace::around(&[[0.1, 1e6 + 0.1, 1e-20], [0.3, 1e6 + 0.3, 1e6 + 0.3]]);
        assert_eq!(space.origin()[2], 0.0);
        let given = [0.1, 1e6 + 0.1, 1e300];
        let (local, rounding) = space.points(&[given]);
        assert_eq!((rounding.count, rounding.rounded, rounding.largest), (3, 3, f64::INFINITY));
        let (_, of_first) = space.points(&[[given[0], space.origin()[1], 0.0]]);
        assert_eq!(space.origin()[0], 0.25);
        assert_eq!((of_first.rounded, of_first.largest), (1, (f64::from((0.1 - 0.25) as f32) - (0.1 - 0.25)).abs()));
        // Float32 alone would round by up to 1/32.
        assert!((space.world_point(local[0])[1] - given[1]).abs() < 1e-7);
        // A tiny number far away from the origin: the difference itself is rounded.
        let far = LocalSpace { origin: [1024.0; 3] };
        let (_, rounding) = far.points(&[[1e-20, 1024.0, 1025.0]]);
        assert_eq!((rounding.rounded, rounding.largest), (1, 1e-20));
        let (_, rounding) = far.directions(&[[0.1, 1.0, 0.0]]);
        assert_eq!((rounding.rounded, rounding.largest), (1, (f64::from(0.1f32) - 0.1).abs()));
    }
}
