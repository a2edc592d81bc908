//! Where a method's hits are wrong: pixels whose ray hits another triangle than exact arithmetic has it, or none, or
//! one too many.

use raybrook::glam::Vec3;
use raybrook::low_level::parallel;
use raybrook::low_level::scene::Scene;
use raybrook::low_level::shared::Hit;
use raybrook::low_level::tracer::is_hit;

/// Linear radiance of a wrong pixel, of one whose ray misses, and of a surface that is seen from the side and from the
/// front: dark enough for red to stand out.
const WRONG: [f32; 3] = [1.0, 0.0, 0.0];
const MISS: f32 = 0.01;
const FROM_ASIDE: f32 = 0.03;
const FROM_AHEAD: f32 = 0.3;

/// Which of the hits are not of the triangle that exact arithmetic has.
pub fn wrong_pixels(hits: &[Hit], exact: &[Hit]) -> Vec<bool> {
    hits.iter().zip(exact).map(|(hit, exact)| hit.primitive != exact.primitive).collect()
}

/// Pixels that show the exact hits, seen along `towards`, in grey, and those that are wrong in red.
pub fn exact_colours(scene: &Scene, exact: &[Hit], wrong: &[bool], towards: Vec3) -> Vec<[f32; 3]> {
    let grey = |hit: &Hit| {
        if !is_hit(hit) {
            return [MISS; 3];
        }
        let [a, b, c] = scene.vertices(hit.primitive as usize);
        let ahead = (b - a).cross(c - a).normalize_or_zero().dot(towards).abs();
        [FROM_ASIDE + (FROM_AHEAD - FROM_ASIDE) * ahead; 3]
    };
    parallel::map_numbers(exact.len(), |i| if wrong[i] { WRONG } else { grey(&exact[i]) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use raybrook::low_level::scene::Triangle;

    #[test]
    fn other_triangles_and_misses_are_wrong_and_roundings_are_not() {
        let hit = |primitive, t| Hit { t, u: 0.25, v: 0.25, primitive };
        let exact = [hit(0, 1.0), hit(0, 1.0), Hit::NONE, hit(1, 2.0)];
        let wrong = wrong_pixels(&[hit(0, 1.000_000_1), Hit::NONE, hit(0, 3.0), hit(0, 2.0)], &exact);
        assert_eq!(wrong, [false, true, true, true]);
        let corners = [0, 1, 2];
        let triangle = Triangle { positions: corners, normals: corners, uvs: corners, material: 0 };
        let scene =
            Scene { positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y], triangles: vec![triangle; 2], ..Scene::default() };
        let colours = exact_colours(&scene, &exact, &wrong, Vec3::NEG_Z);
        assert_eq!(colours, [[FROM_AHEAD; 3], WRONG, WRONG, WRONG]);
        assert_eq!(exact_colours(&scene, &exact, &[false; 4], Vec3::X)[1..3], [[FROM_ASIDE; 3], [MISS; 3]]);
    }
}
