//! What a hit is: where, which normals, which texture coordinates.

use super::trial::{EPSILON, Trial};
use crate::stress::Tolerance;
use glam::{DVec2, DVec3};
use raybrook::low_level::reference::oracle::OracleHit;
use raybrook::low_level::scene::{Scene, Triangle};

/// A normal that cancels to less than this in every component is noise and no normal: its roundings alone may be as
/// large.
const NOISE: f64 = 8.0 * EPSILON;

/// A point of a triangle as a ray sees it.
#[derive(Debug, Clone)]
pub struct Surface {
    /// Where.
    pub position: DVec3,
    /// On which triangle.
    pub primitive: u32,
    /// Its corners.
    pub corners: [DVec3; 3],
    /// Unit normal of the triangle, on the ray's side.
    pub geometric_normal: DVec3,
    /// Unit, interpolated, on the same side.
    pub normal: DVec3,
    /// From the triangle to where shadow rays start.
    pub lift: DVec3,
    /// Texture coordinates of the corners.
    pub corner_uvs: [DVec2; 3],
    /// Those of the point.
    pub uv: DVec2,
    /// Whether the ray came from the side on which the corners run counter-clockwise.
    pub is_front: bool,
}

/// Corners of a triangle with what the scene tells of them.
struct Corners {
    positions: [DVec3; 3],
    /// Unit; all zero where one has none.
    normals: [DVec3; 3],
    uvs: [DVec2; 3],
}

impl Corners {
    fn new(scene: &Scene, triangle: &Triangle) -> Corners {
        let normal = |i: u32| scene.normals.get(i as usize).map_or(DVec3::ZERO, |n| n.as_dvec3());
        let normals =
            triangle.normals.map(normal).map(|n| if n.is_finite() { n.normalize_or_zero() } else { DVec3::ZERO });
        let has_all = !normals.contains(&DVec3::ZERO);
        Corners {
            positions: triangle.positions.map(|i| scene.positions[i as usize].as_dvec3()),
            normals: if has_all { normals } else { [DVec3::ZERO; 3] },
            uvs: triangle.uvs.map(|i| scene.uvs.get(i as usize).map_or(DVec2::ZERO, |uv| uv.as_dvec2())),
        }
    }
}

/// How rays and surfaces are to be taken.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Whether the method promises exact hits: else t and weights may be off by what its test cannot help.
    pub is_exact: bool,
    /// Whether shadow rays start where smooth normals claim the surface to be.
    pub has_lift: bool,
}

impl Surface {
    /// What a ray along `direction` from `origin` sees of its `hit`. `scene` has no instances.
    pub fn new(
        scene: &Scene,
        rules: Rules,
        (origin, direction): (DVec3, DVec3),
        hit: &OracleHit,
        trial: &mut Trial,
    ) -> Surface {
        let triangle = &scene.triangles[hit.primitive as usize];
        let Corners { positions, normals, uvs } = Corners::new(scene, triangle);
        let mut bounds = [hit.u, hit.v].map(|weight| 2.0 * EPSILON * weight);
        if trial.has_errors() && !rules.is_exact {
            bounds = Tolerance::of_ray(origin, direction, positions, 0.0).weights;
        }
        let [u, v] =
            [(hit.u, bounds[0]), (hit.v, bounds[1])].map(|(x, bound)| (x + trial.error(bound)).clamp(0.0, 1.0));
        let weights = [1.0 - u - v, u, v];
        let [edge1, edge2] = [positions[1] - positions[0], positions[2] - positions[0]];
        let position = positions[0] + edge1 * u + edge2 * v;

        let outward = edge1.cross(edge2).try_normalize().unwrap_or_else(|| -direction.normalize_or(DVec3::NEG_Z));
        let outward = trial.vector(outward, 8.0);
        let is_front = trial.near(outward.dot(direction), direction.length(), 3.0) < 0.0;
        trial.decide(u32::from(is_front));
        let geometric_normal = if is_front { outward } else { -outward };
        let mut surface = Surface {
            position,
            primitive: hit.primitive,
            corners: positions,
            geometric_normal,
            normal: geometric_normal,
            lift: DVec3::ZERO,
            corner_uvs: uvs,
            uv: DVec2::ZERO,
            is_front,
        };
        if normals[0] != DVec3::ZERO {
            surface.normal = interpolated(normals, weights, geometric_normal, trial);
            if rules.has_lift {
                surface.lift = lift(positions, normals, weights, position, geometric_normal);
                surface.lift = trial.moved(surface.lift, 8.0 * EPSILON * (edge1.length() + edge2.length()));
                surface.lift = if surface.lift.length_squared() > 0.0 { surface.lift } else { DVec3::ZERO };
            }
        }
        surface.uv = DVec2::from_array([0, 1].map(|k| {
            let terms: [f64; 3] = std::array::from_fn(|i| weights[i] * uvs[i][k]);
            trial.near(terms.iter().sum(), terms.iter().map(|x| x.abs()).sum(), 5.0)
        }));
        surface
    }

    /// A flat one without texture that is seen from the front.
    #[cfg(test)]
    pub fn flat(position: DVec3, normal: DVec3) -> Surface {
        Surface {
            position,
            primitive: 0,
            corners: [DVec3::ZERO; 3],
            geometric_normal: normal,
            normal,
            lift: DVec3::ZERO,
            corner_uvs: [DVec2::ZERO; 3],
            uv: DVec2::ZERO,
            is_front: true,
        }
    }

    /// Whether shadow rays start above the triangle.
    pub fn is_lifted(&self) -> bool {
        self.lift != DVec3::ZERO
    }

    /// The largest coordinate of the corners, without sign.
    pub fn largest_coordinate(&self) -> f64 {
        self.corners.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max)
    }

    /// How far the position, which f64 has rounded, may be off the triangle's plane: a few roundings of f64 of the
    /// largest coordinate. Where it lies in another triangle's plane, too, that one is met at the start and not hit.
    pub fn f64_error(&self) -> f64 {
        8.0 * f64::EPSILON * self.largest_coordinate()
    }
}

/// The normal at a point of a smooth surface (Phong, "Illumination for Computer Generated Pictures", CACM 18(6), 1975).
fn interpolated(normals: [DVec3; 3], weights: [f64; 3], geometric: DVec3, trial: &mut Trial) -> DVec3 {
    let sum: DVec3 = normals.iter().zip(weights).map(|(normal, weight)| *normal * weight).sum();
    let sum = trial.moved(sum, NOISE);
    let is_noise = sum.abs().max_element() <= NOISE;
    let normal = if is_noise { geometric } else { trial.vector(sum.normalize(), 3.0) };
    let is_turned = trial.near(normal.dot(geometric), 1.0, 3.0) < 0.0;
    trial.decide(u32::from(is_noise) + 2 * u32::from(is_turned));
    if is_turned { -normal } else { normal }
}

/// From the triangle to the smooth surface: the mean of the ways to the tangent planes at the corners, where those lie
/// above (Hanika, "Hacking the Shadow Terminator", Ray Tracing Gems II, 2021, chapter 4).
fn lift(positions: [DVec3; 3], normals: [DVec3; 3], weights: [f64; 3], position: DVec3, geometric: DVec3) -> DVec3 {
    let way = |k: usize| {
        let normal = if normals[k].dot(geometric) < 0.0 { -normals[k] } else { normals[k] };
        normal * (weights[k] * (positions[k] - position).dot(normal).max(0.0))
    };
    way(0) + way(1) + way(2)
}
