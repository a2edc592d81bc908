//! Twin of `cl/intersect/ties.cl`: ties that the number decides, whatever the ray is. The reasons are there.

use crate::reference::shared::integer::widen_exponents;
use glam::Vec3;

/// Whether two triangles that have area are the same set of points.
#[inline(always)]
pub fn are_same_points(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    a.iter().all(|corner| b.contains(corner))
}

/// Bits between the largest coordinate and the last one of all: differences have one more, and three products of three
/// of them 6 more in all, which `i128` holds with a sign.
const MOST_BITS: i32 = 40;

/// Whether two triangles certainly lie in one plane. Not pairs of doubles as in the kernel, but exact integers, of more
/// bits: what this leaves open is decided in longer ones, and the answer is the same.
#[inline(never)]
pub fn are_in_one_plane(a: &[Vec3; 3], b: &[Vec3; 3]) -> bool {
    let (mut low, mut high) = (1000, -1000);
    for corner in a.iter().chain(b) {
        corner.to_array().iter().for_each(|&x| widen_exponents(x, &mut low, &mut high));
    }
    if high - low > MOST_BITS {
        return false;
    }
    // Scaled twice, because one power would not always be a number of f64's.
    let half = 2f64.powi(-low / 2);
    let rest = 2f64.powi(-low - -low / 2);
    let whole = |p: &Vec3| p.to_array().map(|x| (f64::from(x) * half * rest) as i128);
    let minus = |p: [i128; 3], q: [i128; 3]| [p[0] - q[0], p[1] - q[1], p[2] - q[2]];
    let start = whole(&a[0]);
    let [e, f] = [1, 2].map(|i| minus(whole(&a[i]), start));
    let normal = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
    b.iter().all(|corner| {
        let from = minus(whole(corner), start);
        normal[0] * from[0] + normal[1] * from[1] + normal[2] * from[2] == 0
    })
}
