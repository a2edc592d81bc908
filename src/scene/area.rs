//! Whether a triangle has an area, decided as exact arithmetic does.
//!
//! A triangle has none just when its projections along all three axes have none, which is what Shewchuk's orientation
//! test decides (Shewchuk, "Adaptive Precision Floating-Point Arithmetic and Fast Robust Geometric Predicates",
//! Discrete & Computational Geometry 18, 1997, section 4.2): doubles with an error bound first, which is all that most
//! triangles take, then sums of doubles without any error. A cross product in doubles alone takes (4, 4, 0) (6.1e-17,
//! 0, 0) (8, 8, 0) for a line, because 4 - 6.1e-17 rounds to 4.
//!
//! The test is exact as long as nothing over- or underflows, and nothing does: a float32 is a whole multiple of 2^-149
//! below 2^128, so that differences are multiples of it below 2^129, their products and all sums of these multiples of
//! 2^-298 below 2^262, and so are all rounding errors. Doubles go from 2^-1074 to 2^1024.

use glam::Vec3;
use robust::{Coord, orient2d};

/// The axes of each projection.
pub const PROJECTIONS: [[usize; 2]; 3] = [[0, 1], [1, 2], [2, 0]];

/// Whether three finite points do not lie on one line.
pub(crate) fn has_area(corners: [Vec3; 3]) -> bool {
    PROJECTIONS.iter().any(|&axes| projected_area(corners, axes) != 0.0)
}

/// Twice the area of three finite points as seen along the axis that `axes` leaves out. Its sign is exact, and so is
/// that it is zero.
pub fn projected_area(corners: [Vec3; 3], [x, y]: [usize; 2]) -> f64 {
    let [a, b, c] = corners.map(|p| Coord { x: f64::from(p[x]), y: f64::from(p[y]) });
    orient2d(a, b, c)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;
    use num_bigint::BigInt;

    /// Every float32 is a whole multiple of 2^-149, the smallest one above 0.
    fn multiple_of_smallest(x: f32) -> BigInt {
        let (field, fraction) = (x.to_bits() >> 23 & 0xff, x.to_bits() & 0x7f_ffff);
        let significand = if field == 0 { fraction } else { fraction | 1 << 23 };
        let magnitude = BigInt::from(significand) << field.saturating_sub(1);
        if x.is_sign_negative() { -magnitude } else { magnitude }
    }

    /// The same by exact integers.
    fn has_exact_area(corners: [Vec3; 3]) -> bool {
        let [a, b, c] = corners.map(|p| p.to_array().map(multiple_of_smallest));
        let minus = |p: &[BigInt; 3]| -> [BigInt; 3] { std::array::from_fn(|k| &p[k] - &a[k]) };
        let (edge1, edge2) = (minus(&b), minus(&c));
        PROJECTIONS.iter().any(|&[x, y]| &edge1[x] * &edge2[y] != &edge1[y] * &edge2[x])
    }

    #[test]
    fn triangles_have_area_as_in_exact_arithmetic() {
        let at = |x: f32, y: f32, z: f32| Vec3::new(x, y, z);
        let tiny = f32::from_bits(1);
        let cases = [
            ([at(1.0, 1.0, 0.0), at(0.0, 2f32.powi(-54), 0.0), at(-1.0, -1.0, 0.0)], true),
            ([at(4.0, 4.0, 0.0), at(6.123234e-17, 0.0, 0.0), at(8.0, 8.0, 0.0)], true),
            ([at(0.0, 4.0, 4.0), at(0.0, tiny, 0.0), at(0.0, 8.0, 8.0)], true),
            ([at(f32::MAX, 0.0, f32::MAX), at(tiny, 0.0, 0.0), at(-f32::MAX, 0.0, -f32::MAX)], true),
            ([at(0.0, 0.0, 0.0), at(tiny, 0.0, 0.0), at(0.0, tiny, 0.0)], true),
            ([at(f32::MAX, f32::MAX, 1.0), at(-f32::MAX, -f32::MAX, 1.0), at(-f32::MAX, f32::MAX, 1.0)], true),
            // On a line, although differences of its coordinates round.
            ([at(0.0, 0.0, 0.0), at(tiny, tiny, tiny), at(f32::MAX, f32::MAX, f32::MAX)], false),
            ([at(0.1, 0.2, 0.3), at(0.1, 0.2, 0.3), at(1e30, 1.0, 7.0)], false),
            ([at(0.1, 1e-30, 1e30), at(0.1, 3e-30, 1e30), at(0.1, -1e25, 1e30)], false),
        ];
        for (corners, expected) in cases {
            for corners in [corners, [corners[1], corners[2], corners[0]], [corners[2], corners[1], corners[0]]] {
                assert_eq!((has_area(corners), has_exact_area(corners)), (expected, expected), "{corners:?}");
            }
        }
    }

    #[test]
    fn random_triangles_on_and_beside_lines_have_area_as_in_exact_arithmetic() {
        let mut random = Random::new(11);
        let mut with_area = 0;
        const COUNT: usize = 3000;
        for i in 0..COUNT {
            // Multiples of one direction are exactly on a line; a last bit beside it they are not.
            let along = [(); 3].map(|()| random.whole(-3, 3) as f32 * random.size(-20, 20).floor());
            let mut corners = [(); 3].map(|()| {
                let factor = random.whole(-1, 1) as f32 * 2f32.powi(random.whole(-90, 60));
                Vec3::from_array(along) * factor
            });
            if i % 2 == 0 {
                let (corner, axis) = (random.below(3), random.below(3));
                let x = &mut corners[corner][axis];
                *x = if *x == 0.0 { f32::from_bits(1) } else { x.next_up() };
            }
            let expected = has_exact_area(corners);
            with_area += usize::from(expected);
            assert_eq!(has_area(corners), expected, "{corners:?}");
        }
        assert!((COUNT / 10..COUNT * 9 / 10).contains(&with_area), "{with_area}");
    }
}
