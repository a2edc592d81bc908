//! Rays aimed at edges and vertices as near as float32 can, or a few floats beside them.

use super::ClosedMesh;
use glam::{DVec3, Vec3};
use raybrook::low_level::random::{Random, power_of_two};

/// A ray that must hit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AimedRay {
    /// Where it starts.
    pub origin: Vec3,
    /// Where it goes; t counts in it.
    pub direction: Vec3,
    /// It hits something at this t or before, for certain; may be infinite.
    pub by: f64,
    /// Whether it starts inside.
    pub is_inside: bool,
    /// Whether it is aimed at a vertex, not at an edge.
    pub is_at_vertex: bool,
}

/// What a ray is aimed at, by number.
#[derive(Debug, Clone, Copy)]
pub(super) enum Target {
    Vertex(u32),
    Edge(u32),
}

/// Where a ray starts.
#[derive(Debug, Clone, Copy)]
pub(super) enum Start {
    /// In a ball inside.
    Inside,
    /// Such that it passes through this ball once it is through its target.
    Towards(usize),
    /// Anywhere.
    Anywhere,
    /// Such that one or two components of the direction are zero and the target is met however far away it is.
    Along,
}

/// Distances of origins from targets, as powers of two in units of the mesh's size: 1 / 4096 to 131,072.
const DISTANCES: (i32, i32) = (-12, 17);
/// Farther away than this power of two one rounding of the direction misses by more than 2^-20 of the mesh's size.
const FAR: f32 = 16.0;
/// Lengths of a direction of which the one is taken whose rounding passes nearest to the target.
const LENGTHS: usize = 16;
/// Weights of points near the end of an edge are up to this power of two small.
const NEAR_END: i32 = -24;
/// The most floats beside the target.
const MOST_BESIDE: i32 = 4;
/// Directions are up to two to this power times longer or shorter than the way to the target.
const STRETCH: i32 = 20;
/// Aims that are given up when there is no proof that they hit, before one is taken from inside, where every ray hits.
const ATTEMPTS: usize = 16;

impl ClosedMesh {
    /// Ray number `index` of `seed`: always the same.
    pub fn ray(&self, seed: u64, index: u64) -> AimedRay {
        let mut random = Random::new(Random::new(seed).bits().wrapping_add(index));
        if let Some(ray) = self.aim_at_thin(&mut random) {
            return ray;
        }
        for _ in 0..ATTEMPTS {
            let start = match random.below(8) {
                0 | 1 => Start::Inside,
                2 | 3 => Start::Towards(random.below(self.inside.len())),
                4 | 5 => Start::Anywhere,
                _ => Start::Along,
            };
            if let Some(ray) = self.aim(start, &mut random) {
                return ray;
            }
        }
        self.aim(Start::Inside, &mut random).unwrap_or_else(|| self.any_from_inside(&mut random))
    }

    fn aim(&self, start: Start, random: &mut Random) -> Option<AimedRay> {
        let (target, exact) = self.target(random);
        let aimed = beside(exact.as_vec3(), random);
        let origin = self.origin(start, exact, aimed, random);
        let direction = self.direction(origin, exact, aimed, random);
        if !(origin.is_finite() && direction.is_finite() && direction != Vec3::ZERO) {
            return None;
        }
        let by = self.promise(origin, direction, target, start)?;
        let is_inside = matches!(start, Start::Inside);
        Some(AimedRay { origin, direction, by, is_inside, is_at_vertex: matches!(target, Target::Vertex(_)) })
    }

    /// When nothing else works, such as in a mesh near the ends of float32's range.
    fn any_from_inside(&self, random: &mut Random) -> AimedRay {
        let origin = self.inside[random.below(self.inside.len())].random_point(random);
        AimedRay { origin, direction: random.direction(), by: f64::INFINITY, is_inside: true, is_at_vertex: false }
    }

    /// A vertex, or an edge and a point on it.
    fn target(&self, random: &mut Random) -> (Target, DVec3) {
        if random.below(3) == 0 {
            let vertex = random.below(self.positions.len()) as u32;
            return (Target::Vertex(vertex), self.position(vertex));
        }
        let edge = random.below(self.edges.len());
        let [a, b] = self.edges[edge].ends.map(|i| self.position(i));
        let weight = match random.below(4) {
            0 => 0.5,
            1 => {
                let small = power_of_two(random.whole(NEAR_END, -2));
                if random.below(2) == 0 { small } else { 1.0 - small }
            }
            _ => random.unit(),
        };
        (Target::Edge(edge as u32), a + (b - a) * f64::from(weight))
    }

    fn origin(&self, start: Start, exact: DVec3, aimed: Vec3, random: &mut Random) -> Vec3 {
        let distance = (self.high - self.low).max_element() * random.size(DISTANCES.0, DISTANCES.1);
        match start {
            Start::Inside => self.inside[random.below(self.inside.len())].random_point(random),
            Start::Towards(ball) => {
                let back = (exact - self.inside[ball].center).normalize_or(DVec3::X);
                (exact + back * f64::from(distance)).as_vec3()
            }
            Start::Anywhere => aimed + random.direction() * distance,
            Start::Along => {
                let mut away = [0.0; 3];
                let axis = random.below(3);
                away[axis] = random.sign() * distance;
                if random.below(2) == 0 {
                    away[(axis + 1 + random.below(2)) % 3] = random.signed() * distance;
                }
                aimed + Vec3::from_array(away)
            }
        }
    }

    fn direction(&self, origin: Vec3, exact: DVec3, aimed: Vec3, random: &mut Random) -> Vec3 {
        let is_displaced = aimed != exact.as_vec3();
        let plain = aimed - origin;
        let is_far = plain.abs().max_element() > FAR * (self.high - self.low).max_element();
        let direction = if is_far || random.below(4) == 0 {
            let goal = if is_displaced { aimed.as_dvec3() } else { exact };
            // Rounded directions of several lengths pass at several places.
            let way = goal - origin.as_dvec3();
            let lengths = (0..LENGTHS).map(|_| (way * f64::from(1.0 + random.unit())).as_vec3());
            let passes_at = |d: &Vec3| d.as_dvec3().cross(way).length_squared() / d.as_dvec3().length_squared();
            lengths.chain([plain]).min_by(|a, b| passes_at(a).total_cmp(&passes_at(b))).unwrap_or(plain)
        } else {
            plain
        };
        if random.below(8) == 0 { direction * power_of_two(random.whole(-STRETCH, STRETCH)) } else { direction }
    }
}

/// The point itself, half of the time; else one a float or a few beside it on each axis.
fn beside(p: Vec3, random: &mut Random) -> Vec3 {
    let most = match random.below(4) {
        0 | 1 => return p,
        2 => 1,
        _ => MOST_BESIDE,
    };
    p.map(|x| {
        let floats = random.whole(-most, most);
        (0..floats.abs()).fold(x, |x, _| if floats > 0 { x.next_up() } else { x.next_down() })
    })
}
