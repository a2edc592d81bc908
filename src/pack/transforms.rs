//! The triangles' transforms for `cl/intersect/precomputed.cl`, where the layout is described.
//!
//! Baldwin and Weber, "Fast Ray-Triangle Intersections by Coordinate Transformation", JCGT 5(3), 2016. Computed in f64,
//! whose products of float32 differences are almost always exact, and rounded once.

use crate::layout::Float4;
use glam::{DVec3, Vec3};

/// The transform of one triangle; NaN, which every ray misses, for one without area.
pub fn triangle_transform(vertices: [Vec3; 3]) -> [Float4; 3] {
    let [a, b, c] = vertices.map(DVec3::from);
    let (edge1, edge2) = (b - a, c - a);
    let normal = edge1.cross(edge2);
    let size = normal.abs();
    let k = if size.x >= size.y && size.x >= size.z {
        0
    } else if size.y >= size.z {
        1
    } else {
        2
    };
    let (x, y) = ((k + 1) % 3, (k + 2) % 3);
    let divided = |value: f64| (value / normal[k]) as f32;
    [
        Float4::new(vertices[0], f32::from_bits(k as u32)),
        // The triangle projected along axis k: u is 1 along edge1 and 0 along edge2, v the other way round.
        Float4 { x: divided(normal[x]), y: divided(normal[y]), z: divided(edge2[y]), w: divided(-edge2[x]) },
        Float4 { x: divided(-edge1[y]), y: divided(edge1[x]), z: 0.0, w: 0.0 },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `weights` of a point of the triangle, by its transform.
    fn weights(transform: [Float4; 3], point: Vec3) -> (f32, f32) {
        let k = transform[0].w.to_bits() as usize;
        let from = point - transform[0].xyz();
        let (x, y) = (from[(k + 1) % 3], from[(k + 2) % 3]);
        (transform[1].z * x + transform[1].w * y, transform[2].x * x + transform[2].y * y)
    }

    #[test]
    fn vertices_have_their_weights_however_small_the_triangle() {
        let [a, b, c] = [Vec3::new(0.5, 0.25, 0.75), Vec3::new(0.75, 0.5, 0.25), Vec3::new(0.125, 0.75, 0.5)];
        for size in [1.0, 2f32.powi(-40), 2f32.powi(20)] {
            for turn in 0..3 {
                // Another axis leads in each turn.
                let place = |p: Vec3| size * Vec3::from_array(std::array::from_fn(|i| p[(i + turn) % 3]));
                let triangle = [place(a), place(b), place(c)];
                let transform = triangle_transform(triangle);
                for (corner, expected) in [(0, (0.0, 0.0)), (1, (1.0, 0.0)), (2, (0.0, 1.0))] {
                    let (u, v) = weights(transform, triangle[corner]);
                    assert!((u - expected.0).abs() < 1e-6 && (v - expected.1).abs() < 1e-6, "{size} {turn}: {u} {v}");
                }
            }
        }
    }

    #[test]
    fn no_area_is_nan() {
        let [_, normal_u, _] = triangle_transform([Vec3::ZERO; 3]);
        assert!(normal_u.x.is_nan() && normal_u.z.is_nan());
    }
}
