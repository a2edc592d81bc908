//! Twin of `cl/shade/footprint.cl`: how much of a surface and of its texture a ray stands for. The reasons are there.

use super::surface::Surface;
use crate::pack::SceneBuffers;
use crate::reference::shared::math::{cross3, dot3, max_or, normalize3};
use crate::reference::shared::memory::{load_shading, vertices};
use crate::shared::Shading;
use crate::shared::constants::LEAST_CONE_COSINE;
use glam::Vec3;

/// A ray is the axis of a cone.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct RayCone {
    /// Where the ray begins, tracing space.
    pub width: f32,
    /// By how much it grows along a unit of the ray.
    pub spread: f32,
}

impl RayCone {
    /// The cone of a ray from `from`, at `to`.
    #[inline(always)]
    pub fn at(self, from: Vec3, to: Vec3) -> RayCone {
        let way = to - from;
        RayCone { width: self.spread.mul_add(dot3(way, way).sqrt(), self.width), ..self }
    }
}

/// Two axes of the ellipse that a cone cuts out of a triangle's plane, from end to end, in texture coordinates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    /// The one that leans with the ray.
    pub along: [f32; 2],
    /// The one at a right angle to the ray.
    pub across: [f32; 2],
}

#[inline(always)]
fn texture_way(at: &Shading, [edge1, edge2]: [Vec3; 2], normal: Vec3, area: f32, way: Vec3) -> [f32; 2] {
    let weight1 = dot3(cross3(way, edge2), normal) / area;
    let weight2 = dot3(cross3(edge1, way), normal) / area;
    let [u0, u1, u2] = [at.normal0_u0.w, at.normal1_u1.w, at.normal2_u2.w];
    [weight1.mul_add(u1 - u0, weight2 * (u2 - u0)), weight1.mul_add(at.v1 - at.v0, weight2 * (at.v2 - at.v0))]
}

/// What a cone of `width` about a ray along unit `direction` cuts out of a surface.
#[inline(always)]
pub fn footprint_at(buffers: &SceneBuffers, surface: &Surface, direction: Vec3, width: f32) -> Footprint {
    let [p0, p1, p2] = vertices(buffers, surface.point.primitive);
    let edges = [p1 - p0, p2 - p0];
    let at = load_shading(buffers, surface.point.primitive);
    let normal = surface.geometric_normal;
    let area = dot3(cross3(edges[0], edges[1]), normal);
    let across = normalize3(cross3(normal, direction), normalize3(edges[0], Vec3::ZERO));
    let along = cross3(across, normal);
    let cosine = max_or(-dot3(normal, direction), LEAST_CONE_COSINE);
    Footprint {
        along: texture_way(&at, edges, normal, area, along * (width / cosine)),
        across: texture_way(&at, edges, normal, area, across * width),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::TraceOptions;
    use crate::reference::shade::surface::surface_at;
    use crate::reference::shared::ray::Ray;
    use crate::scene::{Builder, Normals};
    use crate::shared::{NO_PRIMITIVE, SurfaceHit};
    use glam::Vec2;

    /// A triangle in the plane z = 0 whose texture coordinates are x / 2 and 3 y.
    fn buffers() -> SceneBuffers {
        let positions = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let uvs = positions.map(|p| Vec2::new(p.x / 2.0, 3.0 * p.y));
        let mut builder = Builder::new();
        builder.mesh(&positions, Normals::Flat, &uvs, &[[0, 1, 2]]);
        SceneBuffers::new(&builder.finish().unwrap(), &TraceOptions::DEFAULT).unwrap()
    }

    /// The footprint of a ray of this direction in the middle of the triangle, of a cone as wide as 0.01 there.
    fn footprint(direction: Vec3) -> Footprint {
        let buffers = buffers();
        let direction = direction.normalize();
        let ray = Ray::new(-direction, direction, 0.0, f32::INFINITY, NO_PRIMITIVE);
        let hit = SurfaceHit { weight0: 0.25, u: 0.5, v: 0.25, primitive: 0 };
        let surface = surface_at(&buffers, &TraceOptions::DEFAULT, &ray, &hit);
        footprint_at(&buffers, &surface, direction, 0.01)
    }

    fn assert_near(way: [f32; 2], expected: [f32; 2]) {
        let near = |sign: f32| (0..2).all(|k| (way[k] - sign * expected[k]).abs() < 1e-6);
        assert!(near(1.0) || near(-1.0), "{way:?}, {expected:?}");
    }

    #[test]
    fn cones_grow_with_the_distance() {
        let cone = RayCone { width: 0.5, spread: 0.25 };
        assert_eq!(cone.at(Vec3::ZERO, Vec3::new(0.0, 3.0, 4.0)), RayCone { width: 1.75, spread: 0.25 });
    }

    #[test]
    fn axes_are_those_of_the_cut() {
        // Straight down: a circle, whose axes are the triangle's own.
        let straight = footprint(Vec3::NEG_Z);
        assert_near(straight.across, [0.005, 0.0]);
        assert_near(straight.along, [0.0, 0.03]);
        // At 60 degrees to the normal, along x: twice as long that way.
        let slant = footprint(Vec3::new(3f32.sqrt(), 0.0, -1.0));
        assert_near(slant.along, [0.01, 0.0]);
        assert_near(slant.across, [0.0, 0.03]);
        // From below, too.
        let below = footprint(Vec3::new(0.0, 3f32.sqrt(), 1.0));
        assert_near(below.along, [0.0, 0.06]);
        assert_near(below.across, [0.005, 0.0]);
    }

    /// Against what the plane's own map from places to texture coordinates makes of the cone's ellipse.
    #[test]
    fn a_triangle_of_any_shape_has_the_footprint_of_its_plane() {
        let plane = |x: f32, y: f32| Vec3::new(x, y, 0.5 * x - y);
        let uv = |p: Vec3| Vec2::new(0.7 * p.x - 0.2 * p.y + 0.1, 0.3 * p.x + 1.1 * p.y);
        let positions = [plane(0.1, -0.2), plane(0.9, 0.3), plane(-0.4, 0.8)];
        let mut builder = Builder::new();
        builder.mesh(&positions, Normals::Flat, &positions.map(uv), &[[0, 1, 2]]);
        let buffers = SceneBuffers::new(&builder.finish().unwrap(), &TraceOptions::DEFAULT).unwrap();
        let scale = buffers.params.scale;
        for direction in [Vec3::new(0.3, 0.2, -1.0), Vec3::new(-0.6, 0.1, 0.8)] {
            let direction = direction.normalize();
            let ray = Ray::new(-direction, direction, 0.0, f32::INFINITY, NO_PRIMITIVE);
            let hit = SurfaceHit { weight0: 0.25, u: 0.5, v: 0.25, primitive: 0 };
            let surface = surface_at(&buffers, &TraceOptions::DEFAULT, &ray, &hit);
            let got = footprint_at(&buffers, &surface, direction, 0.01 * scale);
            let normal = Vec3::new(0.5, -1.0, -1.0).normalize();
            let across = normal.cross(direction).normalize();
            let along = normal.cross(across) / normal.dot(direction).abs();
            for (got, axis) in [(got.across, across), (got.along, along)] {
                assert_near(got, (uv(axis * 0.01) - uv(Vec3::ZERO)).to_array());
            }
        }
    }

    #[test]
    fn grazing_rays_see_no_more_than_a_bound() {
        let grazing = footprint(Vec3::new(1.0, 0.0, -1e-6));
        assert_near(grazing.along, [0.005 * 128.0, 0.0]);
    }
}
