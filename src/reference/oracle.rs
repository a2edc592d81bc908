//! The oracle: hits in f64 over the triangles as they are, for measuring accuracy.

mod bvh;

use crate::scene::Scene;
use crate::shared::NO_PRIMITIVE;
pub(crate) use bvh::{Box64, Bvh, Line};
use glam::{DVec3, Vec3};

/// A ray in f64.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OracleRay {
    /// World units.
    pub origin: DVec3,
    /// Any length.
    pub direction: DVec3,
    /// Start of the closed interval, in units of |direction|.
    pub t_min: f64,
    /// End of the closed interval.
    pub t_max: f64,
    /// A triangle that is never hit, such as the one that the ray starts on; [`NO_PRIMITIVE`] for none.
    pub skip: u32,
}

/// A hit in f64.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OracleHit {
    /// Distance in units of |direction|.
    pub t: f64,
    /// Weight of vertex 1.
    pub u: f64,
    /// Weight of vertex 2.
    pub v: f64,
    /// The triangle.
    pub primitive: u32,
}

/// The oracle over one scene.
pub struct Oracle {
    /// Number and vertices of each triangle that can be hit.
    triangles: Vec<(u32, [DVec3; 3])>,
    bvh: Bvh,
}

impl Oracle {
    /// An oracle for `scene`, world units.
    pub fn new(scene: &Scene) -> Oracle {
        let vertices = |i: u32| scene.vertices(i as usize).map(DVec3::from);
        Oracle::over(scene.hittable().into_iter().map(|i| (i, vertices(i))).collect())
    }

    /// An oracle for triangles whose vertices float32 may not hold, each finite; their numbers are their places in the
    /// list.
    pub fn of_triangles(triangles: &[[DVec3; 3]]) -> Oracle {
        Oracle::over((0..).zip(triangles.iter().copied()).collect())
    }

    fn over(triangles: Vec<(u32, [DVec3; 3])>) -> Oracle {
        let boxes: Vec<_> = triangles.iter().map(|(_, vertices)| Box64::around(vertices)).collect();
        Oracle { triangles, bvh: Bvh::new(&boxes) }
    }

    /// As [`Oracle::closest`], for a ray in f32.
    pub fn closest_hit(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<OracleHit> {
        self.closest(&OracleRay {
            origin: origin.into(),
            direction: direction.into(),
            t_min: t_min.into(),
            t_max: t_max.into(),
            skip: NO_PRIMITIVE,
        })
    }

    /// The closest hit with t in `t_min..=t_max`; of hits at the same t the lowest triangle number. Triangles are
    /// closed and two-sided; a ray with NaN or infinite parts, or of length zero, misses.
    pub fn closest(&self, ray: &OracleRay) -> Option<OracleHit> {
        self.search(ray, false)
    }

    /// Whether there is a hit with t in `t_min..=t_max`.
    pub fn is_blocked(&self, ray: &OracleRay) -> bool {
        self.search(ray, true).is_some()
    }

    fn search(&self, ray: &OracleRay, any_hit: bool) -> Option<OracleHit> {
        let line = ray.line()?;
        let mut best: Option<OracleHit> = None;
        self.bvh.visit(&line, ray.t_min, ray.t_max, |index| {
            let (primitive, vertices) = &self.triangles[index as usize];
            best = nearer(best, hit(ray, &line, *primitive, vertices));
            match best {
                None => ray.t_max,
                Some(_) if any_hit => f64::NEG_INFINITY,
                Some(hit) => hit.t,
            }
        });
        best
    }
}

impl OracleRay {
    fn line(&self) -> Option<Line> {
        let sound = self.origin.is_finite() && self.direction.is_finite() && self.direction != DVec3::ZERO;
        sound.then(|| Line::new(self.origin, self.direction))
    }
}

fn nearer(best: Option<OracleHit>, hit: Option<OracleHit>) -> Option<OracleHit> {
    match (best, hit) {
        (Some(a), Some(b)) if (a.t, a.primitive) < (b.t, b.primitive) => Some(a),
        (best, hit) => hit.or(best),
    }
}

/// The hit of `ray`, whose line is `line`, with one triangle.
///
/// The edge functions d·(a×b) of vertices relative to the origin are the same number, but for the sign, in the two
/// triangles of an edge, so that no ray passes between neighbours (Plücker; Davidovič et al. 2012; see
/// `cl/intersect/plucker.cl`).
///
/// t is a quotient of two numbers that are both mostly rounding error for a triangle seen edge-on. It is therefore held
/// between the line's entrance into the triangle's box and its exit; where the line passes the box by, the signs were
/// wrong.
fn hit(ray: &OracleRay, line: &Line, primitive: u32, vertices: &[DVec3; 3]) -> Option<OracleHit> {
    if primitive == ray.skip {
        return None;
    }
    let [p0, p1, p2] = *vertices;
    let (o, d) = (ray.origin, ray.direction);
    let (a, b, c) = (p0 - o, p1 - o, p2 - o);
    let edges = [edge_volume(d, b, c), edge_volume(d, c, a), edge_volume(d, a, b)];
    if !(edges.iter().all(|&e| e >= 0.0) || edges.iter().all(|&e| e <= 0.0)) {
        return None;
    }
    let (enter, leave) = line.passage(&Box64::around(vertices));
    let normal = (p1 - p0).cross(p2 - p0);
    let t = normal.dot(a) / normal.dot(d);
    if !(t.is_finite() && enter <= leave) {
        return None;
    }
    let t = t.clamp(enter, leave);
    let sum = edges[0] + edges[1] + edges[2];
    (t >= ray.t_min && t <= ray.t_max).then(|| OracleHit { t, u: edges[1] / sum, v: edges[2] / sum, primitive })
}

/// d·(a×b), with the opposite sign to the bit when a and b are exchanged. What is too small to be sure of its sign is
/// measured from the vertex nearer to the ray, so that all edges of a vertex agree on which side of it the ray passes:
/// without this the oracle lost 17 of 40,000 rays aimed at the vertices of a sphere.
fn edge_volume(d: DVec3, a: DVec3, b: DVec3) -> f64 {
    const ROUNDING: f64 = 4.0 * f64::EPSILON; // 8 roundings, of f64::EPSILON / 2 each, more than the longest chain has
    let volume = d.dot(a.cross(b));
    let size = |v: DVec3| v.abs().element_sum();
    if volume.abs() > ROUNDING * size(d) * (size(a) * size(b)) {
        return volume;
    }
    let (moment_a, moment_b) = (accurate_cross(d, a), accurate_cross(d, b));
    let (distance_a, distance_b) = (moment_a.length_squared(), moment_b.length_squared());
    if distance_a < distance_b {
        b.dot(moment_a)
    } else if distance_b < distance_a {
        -a.dot(moment_b)
    } else {
        0.5 * (b.dot(moment_a) - a.dot(moment_b))
    }
}

/// The vector product, each component right to 1.5 ulp (Kahan; see `cl/shared/math.cl`).
fn accurate_cross(a: DVec3, b: DVec3) -> DVec3 {
    let difference_of_products = |a: f64, b: f64, c: f64, d: f64| {
        let cd = c * d;
        a.mul_add(b, -cd) + (-c).mul_add(d, cd)
    };
    DVec3::new(
        difference_of_products(a.y, b.z, a.z, b.y),
        difference_of_products(a.z, b.x, a.x, b.z),
        difference_of_products(a.x, b.y, a.y, b.x),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The same hit by testing every triangle.
    fn brute_force(oracle: &Oracle, ray: &OracleRay) -> Option<OracleHit> {
        let line = ray.line()?;
        oracle
            .triangles
            .iter()
            .fold(None, |best, (primitive, vertices)| nearer(best, hit(ray, &line, *primitive, vertices)))
    }

    /// SplitMix64 (Steele, Lea and Flood 2014), in -1..1; every third number is a multiple of 1/4, so that rays run in
    /// planes and along axes.
    fn random(state: &mut u64) -> f64 {
        *state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (*state ^ (*state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        let signed = (z >> 11) as f64 / (1u64 << 52) as f64 - 1.0;
        if z.is_multiple_of(3) { (signed * 4.0).round() / 4.0 } else { signed }
    }

    #[test]
    fn the_hierarchy_loses_no_hit() {
        let mut state = 20_081_121;
        let mut vector = move || DVec3::from_array(std::array::from_fn(|_| random(&mut state)));
        let mut hits = 0;
        for size in [0.05, 0.5, 1e-9] {
            for count in [0, 1, 5, 300] {
                let triangles: Vec<_> = (0..count)
                    .map(|i| {
                        let centre = vector();
                        (i, [(); 3].map(|()| (centre + vector() * size).as_vec3().as_dvec3()))
                    })
                    .collect();
                let oracle = Oracle::over(triangles);
                for i in 0..3000 {
                    let [a, b, c] = oracle.triangles.get(i % count.max(1) as usize).map_or([DVec3::ONE; 3], |t| t.1);
                    let (origin, direction) = match i % 6 {
                        0 => (vector(), vector()),
                        1 => (a + (a - b), b - a), // along an edge
                        2 => (vector(), a - vector()),
                        3 => (a * 2.0 - b, (b - a) + (c - a) * 0.25), // in the triangle's plane
                        4 => (vector() * 1e6, a.lerp(b, 0.5)),
                        _ => (a.lerp(b, 0.25) - vector().with_x(0.0), vector().with_x(0.0)),
                    };
                    let direction = if i % 6 == 4 { direction - origin } else { direction };
                    let skip = if i % 7 == 0 { 0 } else { NO_PRIMITIVE };
                    let (t_min, t_max) = if i % 2 == 0 { (0.0, f64::INFINITY) } else { (-2.0, 1.5) };
                    let ray = OracleRay { origin, direction, t_min, t_max, skip };
                    let expected = brute_force(&oracle, &ray);
                    let bits = |hit: Option<OracleHit>| {
                        hit.map(|h| (h.t.to_bits(), h.u.to_bits(), h.v.to_bits(), h.primitive))
                    };
                    assert_eq!(bits(oracle.closest(&ray)), bits(expected), "{ray:?} in {count} triangles of {size}");
                    assert_eq!(oracle.is_blocked(&ray), expected.is_some(), "{ray:?} in {count} triangles of {size}");
                    hits += usize::from(expected.is_some());
                }
            }
        }
        assert!(hits > 5000, "{hits} hits test little");
    }
}
