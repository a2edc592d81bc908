//! The oracle: brute force in f64 over the triangles as they are, for measuring accuracy. Slow.

use crate::scene::Scene;
use glam::{DVec3, Vec3};

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
    triangles: Vec<(u32, [DVec3; 3])>,
}

impl Oracle {
    /// An oracle for `scene`, world units.
    pub fn new(scene: &Scene) -> Oracle {
        let vertices = |i: u32| scene.vertices(i as usize).map(DVec3::from);
        Oracle { triangles: scene.hittable().into_iter().map(|i| (i, vertices(i))).collect() }
    }

    /// The closest hit with t in `t_min..=t_max`; of hits at the same t the lowest triangle number. Triangles are closed and
    /// two-sided; a ray with NaN or infinite parts, or of length zero, misses.
    ///
    /// The edge functions d·(a×b) of vertices relative to the origin are the same number, but for the sign, in the two triangles
    /// of an edge, so that no ray passes between neighbours (Plücker; Davidovič et al. 2012; see `cl/intersect/plucker.cl`).
    pub fn closest_hit(&self, origin: Vec3, direction: Vec3, t_min: f32, t_max: f32) -> Option<OracleHit> {
        if !origin.is_finite() || !direction.is_finite() || direction == Vec3::ZERO {
            return None;
        }
        let (o, d) = (DVec3::from(origin), DVec3::from(direction));
        let mut best: Option<OracleHit> = None;
        for &(primitive, [p0, p1, p2]) in &self.triangles {
            let (a, b, c) = (p0 - o, p1 - o, p2 - o);
            let edges = [edge_volume(d, b, c), edge_volume(d, c, a), edge_volume(d, a, b)];
            if !(edges.iter().all(|&e| e >= 0.0) || edges.iter().all(|&e| e <= 0.0)) {
                continue;
            }
            let normal = (p1 - p0).cross(p2 - p0);
            let t = normal.dot(a) / normal.dot(d);
            let nearer = best.is_none_or(|hit| t < hit.t);
            if t.is_finite() && t >= f64::from(t_min) && t <= f64::from(t_max) && nearer {
                let sum = edges[0] + edges[1] + edges[2];
                best = Some(OracleHit { t, u: edges[1] / sum, v: edges[2] / sum, primitive });
            }
        }
        best
    }
}

/// d·(a×b), with the opposite sign to the bit when a and b are exchanged. What is too small to be sure of its sign is measured
/// from the vertex nearer to the ray, so that all edges of a vertex agree on which side of it the ray passes: without this the
/// oracle lost 17 of 40,000 rays aimed at the vertices of a sphere.
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
