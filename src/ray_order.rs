//! The order in which a batch of rays is traced: sorted, those come one after the other that are neighbours in space,
//! as packets of rays and every cache want them. Hits come in the caller's order.
//!
//! Keys are those of Meister, Boksansky, Guthe and Bittner, "On Ray Reordering Techniques for Faster GPU Ray Tracing",
//! I3D 2020, that begin with the origin: the Z-curve through origins, then, among those of a cell, the Z-curve through
//! directions, as Cigolle et al., "A Survey of Efficient Representations for Independent Unit Vectors", JCGT 2014, put
//! them on a square. The other way around diffuse rays took twice the time of shuffled ones.
//!
//! Bad at: rays that take less time than their sorting, such as those that leave a scene at once.

use crate::error::Result;
use crate::options::{PacketSize, RayOrder, TraceOptions};
use crate::parallel;
use crate::shared::{SceneParams, TraceRay, WorkCounter};
use crate::tracer::{TraceJob, TraceResult};
use crate::work::WorkSum;
use glam::{Vec2, Vec2Swizzles, Vec3};
use std::time::Instant;

/// Cells of origins along the scene's longest side, as a power of two. With 5 or 10 bits in place of 7 diffuse rays
/// took up to a third longer, with 6 or 8 as long.
const ORIGIN_BITS: u32 = 7;
/// Cells of directions along each side of their square, as a power of two: a camera's rays share a small part of it.
const DIRECTION_BITS: u32 = 12;
const KEY_BITS: u32 = 3 * ORIGIN_BITS + 2 * DIRECTION_BITS;

/// Batches of fewer rays are not sorted by themselves: in what they take (0.2 to 2 ms on PoCL) threads hardly wake up
/// to sort.
const FEWEST_RAYS: usize = 1 << 14;
/// How many rays of a batch are looked at to find out whether it is shuffled, each with one near it in the batch.
const SAMPLES: usize = 64;
/// Its multiples fill every interval evenly, and never in step with anything.
const GOLDEN_RATIO: f64 = 1.618_033_988_749_895;
/// How far the other one is away: such rays share a packet.
const NEAR: usize = PacketSize::Sixteen.rays() / 2;
/// Rays near each other in an ordered batch are at most this part as far apart in space as any two of it. Of shuffled
/// batches the quotient is 1.
const NEARER: f32 = 0.5;
/// How many rays of a shuffled batch are traced beforehand, on the reference, to find out what they take.
const TRIAL_RAYS: usize = 64;
/// Batches whose rays take fewer steps through a hierarchy of eight boxes a node leave the scene too soon to repay
/// their sorting. On two cores with PoCL, kept and sorted, with the sorting, milliseconds: a million camera rays
/// through bunny (3.9 steps) 79 and 47, sponza (2.1) 48 and 39, gears (2.0) 36 and 41; 428 thousand of bunny's shadow
/// rays (7.0) 44 and 21, 622 thousand of gears' (1.7) 13 and 23. About two steps either is the faster.
const FEWEST_STEPS: f64 = 3.0;
/// So many rays of a batch are sorted to find out whether sorting makes neighbours of them.
const SORTED_SAMPLES: usize = 4096;
/// Those next to each other are then at most this part as far apart as any two. Of camera and shadow rays it is 0.03.
/// Where rays from one place go many ways, a million is too few for neighbours: random rays through the bunny (0.3)
/// took as long sorted as shuffled, and its diffuse rays (1) gained what their sorting took.
const NEIGHBOURS: f32 = 0.125;

/// In which order the rays of a batch are traced that is sorted.
pub(crate) struct Sorted {
    /// Their numbers.
    pub order: Vec<u32>,
    /// Seconds that it took to find it.
    pub sort_s: f64,
}

/// The order in which rays are traced, if it is not theirs: as it is asked for. With [`RayOrder::Auto`] shuffled
/// batches are sorted where that `pays` ([`gains_by_sorted_rays`](TraceOptions::gains_by_sorted_rays)), makes
/// neighbours of their rays, and these `go_far` enough.
///
/// # Errors
/// Those of `go_far`.
pub(crate) fn sorted(
    rays: &[TraceRay],
    asked: RayOrder,
    params: &SceneParams,
    pays: bool,
    go_far: impl FnOnce() -> Result<bool>,
) -> Result<Option<Sorted>> {
    let start = Instant::now();
    let keys = RayKeys::new(params);
    let is_sorted = match asked {
        RayOrder::Kept => false,
        RayOrder::Sorted => true,
        RayOrder::Auto => pays && are_shuffled(rays) && keys.make_neighbours(rays) && go_far()?,
    };
    // Kernels number rays in 32 bits.
    let may_be_sorted = u32::try_from(rays.len()).is_ok();
    Ok((is_sorted && may_be_sorted).then(|| {
        let order = keys.order(rays);
        Sorted { order, sort_s: start.elapsed().as_secs_f64() }
    }))
}

/// Traces `job` in that order, by `trace`, which knows of none.
///
/// # Errors
/// Those of `trace`.
pub(crate) fn trace_sorted(
    job: &TraceJob,
    Sorted { order, sort_s }: &Sorted,
    trace: impl FnOnce(&TraceJob) -> Result<TraceResult>,
) -> Result<TraceResult> {
    let start = Instant::now();
    let rays = permuted(job.rays, order);
    let next_directions = job.next_directions.map(|directions| permuted(directions, order));
    let copied_s = start.elapsed().as_secs_f64();
    let result = trace(&TraceJob { rays: &rays, next_directions: next_directions.as_deref(), ..*job })?;
    let start = Instant::now();
    let mut result = TraceResult {
        hits: restored(result.hits, order),
        next_hits: result.next_hits.map(|hits| restored(hits, order)),
        work: result.work.map(|work| restored(work, order)),
        next_work: result.next_work.map(|work| restored(work, order)),
        ..result
    };
    result.sort_s = Some(sort_s + copied_s + start.elapsed().as_secs_f64());
    Ok(result)
}

/// Whether rays take so many steps of the traversal that sorting pays: a few of them, which `trace` traces and counts.
///
/// # Errors
/// Those of `trace`.
pub(crate) fn go_far(
    job: &TraceJob,
    options: &TraceOptions,
    trace: impl FnOnce(&TraceJob, TraceOptions) -> Result<TraceResult>,
) -> Result<bool> {
    let rays = some_of(job.rays, TRIAL_RAYS);
    let options = TraceOptions { ray_order: RayOrder::Kept, counters: true, ..*options };
    let trial = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: job.any_hit, repeat: 1 };
    let work = trace(&trial, options)?.work;
    Ok(WorkSum::new(rays.len() as u64, work.unwrap_or_default()).mean(WorkCounter::Steps) >= FEWEST_STEPS)
}

/// Up to `most` rays of a batch, evenly spread over it.
fn some_of(rays: &[TraceRay], most: usize) -> Vec<TraceRay> {
    rays.iter().step_by(rays.len().div_ceil(most).max(1)).copied().collect()
}

/// `values` in another order: number `i` of them is `values[order[i]]`.
fn permuted<T: Copy + Send + Sync>(values: &[T], order: &[u32]) -> Vec<T> {
    parallel::map_slice(order, |&i| values[i as usize])
}

/// What was in the order of `values` before they were [`permuted`]. One thread writes all, which took half of the time
/// that two took with the inverse of the order.
fn restored<T: Copy>(values: Vec<T>, order: &[u32]) -> Vec<T> {
    let mut restored = values.clone();
    for (value, &i) in values.into_iter().zip(order) {
        restored[i as usize] = value;
    }
    restored
}

/// Keys of a scene's rays: the nearer two keys, the nearer the rays.
struct RayKeys {
    low: Vec3,
    cells_per_unit: f32,
}

impl RayKeys {
    fn new(params: &SceneParams) -> RayKeys {
        let low = params.low.xyz();
        let side = (params.high.xyz() - low).max_element();
        RayKeys { low, cells_per_unit: (1u32 << ORIGIN_BITS) as f32 / side }
    }

    /// The key of a ray: [`KEY_BITS`] bits. One that starts outside of the scene has that of the nearest cell, one of
    /// nonsense any.
    fn key(&self, ray: &TraceRay) -> u64 {
        let origin = (ray.origin_t_min.xyz() - self.low) * self.cells_per_unit;
        let direction = square_of(ray.direction_t_max.xyz()) * (1u32 << DIRECTION_BITS) as f32;
        let origin: u64 = zorder::index_of(origin.to_array().map(|x| cell(x, ORIGIN_BITS)));
        let direction: u32 = zorder::index_of(direction.to_array().map(|x| cell(x, DIRECTION_BITS)));
        origin << (2 * DIRECTION_BITS) | u64::from(direction)
    }

    /// Whether rays of a shuffled batch are near those that come next once they are sorted, by direction and by origin,
    /// where two cells are near: found out by some of them.
    fn make_neighbours(&self, rays: &[TraceRay]) -> bool {
        let some = some_of(rays, SORTED_SAMPLES);
        let sorted = permuted(&some, &self.order(&some));
        let (near, far) = distances(&some, &sorted, 1, direction);
        let (near_origin, far_origin) = distances(&some, &sorted, 1, origin);
        near <= NEIGHBOURS * far && near_origin <= (NEIGHBOURS * far_origin).max(2.0 / self.cells_per_unit)
    }

    /// Numbers of rays, those with the lowest keys first. Of half a million rays or more the lowest bits of directions
    /// do not count.
    fn order(&self, rays: &[TraceRay]) -> Vec<u32> {
        // A key and the number of its ray are one integer, so that no two are equal, and integers alone are sorted.
        let index_bits = usize::BITS - rays.len().leading_zeros();
        let dropped = (KEY_BITS + index_bits).saturating_sub(u64::BITS);
        let entry = |i: usize| self.key(&rays[i]) >> dropped << index_bits | i as u64;
        let sorted = parallel::sorted(&parallel::map_numbers(rays.len(), entry));
        parallel::map_slice(&sorted, |entry| (entry & ((1 << index_bits) - 1)) as u32)
    }
}

/// Whether rays that are near each other in a large batch are no nearer in space than any two of its rays, neither by
/// origin, as diffuse rays of a picture are, nor by direction, as those through a lens.
fn are_shuffled(rays: &[TraceRay]) -> bool {
    let is_no_nearer = |part| {
        let (near, far) = distances(rays, rays, NEAR, part);
        near >= NEARER * far
    };
    rays.len() >= FEWEST_RAYS && is_no_nearer(origin) && is_no_nearer(direction)
}

fn origin(ray: &TraceRay) -> Vec3 {
    ray.origin_t_min.xyz()
}

fn direction(ray: &TraceRay) -> Vec3 {
    on_octahedron(ray.direction_t_max.xyz())
}

/// How far apart a part of rays `step` from each other in `ordered` is, in the middle, and that of any two of `rays`.
fn distances(rays: &[TraceRay], ordered: &[TraceRay], step: usize, part: fn(&TraceRay) -> Vec3) -> (f32, f32) {
    // Steps of the golden ratio: equal ones could meet a picture's lines at their ends alone.
    let place = |i: usize| ((i as f64 * GOLDEN_RATIO).fract() * (rays.len() - step) as f64) as usize;
    let distance = |a: &TraceRay, b: &TraceRay| (part(a) - part(b)).length();
    let near = median(|i| distance(&ordered[place(i)], &ordered[place(i) + step]));
    // Multiplied by an odd number all samples are partners once; the sum with another odd one makes none its own
    // partner.
    let far = median(|i| distance(&rays[place(i)], &rays[place((97 * i + 51) % SAMPLES)]));
    (near, far)
}

/// The middle one of a number for each sample.
fn median(of: impl Fn(usize) -> f32) -> f32 {
    let mut numbers: [f32; SAMPLES] = std::array::from_fn(of);
    *numbers.select_nth_unstable_by(SAMPLES / 2, f32::total_cmp).1
}

/// The cell in which `x` lies, of 2^`bits` of side 1; the nearest one of a number outside, and the first of NaN.
fn cell(x: f32, bits: u32) -> u16 {
    (x as u16).min((1 << bits) - 1)
}

/// A direction of any length where it meets an octahedron.
fn on_octahedron(direction: Vec3) -> Vec3 {
    direction / direction.abs().element_sum()
}

/// A direction on the square from 0 to 1: an octahedron with its lower half folded out.
fn square_of(direction: Vec3) -> Vec2 {
    let d = on_octahedron(direction);
    let upper = d.truncate();
    let p = if d.z < 0.0 { (Vec2::ONE - upper.yx().abs()) * upper.signum() } else { upper };
    (p + 1.0) * 0.5
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::Float4;
    use crate::random::Random;
    use bytemuck::Zeroable;

    const SIDE: usize = 128;

    /// Keys of the scene that is the cube from -1 to 1.
    fn keys() -> RayKeys {
        let (low, high) = (Float4::new(Vec3::NEG_ONE, 0.0), Float4::new(Vec3::ONE, 0.0));
        RayKeys::new(&SceneParams { low, high, ..SceneParams::zeroed() })
    }

    fn ray(origin: Vec3, direction: Vec3) -> TraceRay {
        TraceRay { origin_t_min: Float4::new(origin, 0.0), direction_t_max: Float4::new(direction, f32::INFINITY) }
    }

    /// A pixel's place on the square from -1 to 1, of pixels line by line or in tiles of 8 x 8.
    fn pixel(i: usize, is_tiled: bool) -> Vec2 {
        let (tile, inside) = (i / 64, i % 64);
        let (x, y) = match is_tiled {
            true => (tile % (SIDE / 8) * 8 + inside % 8, tile / (SIDE / 8) * 8 + inside / 8),
            false => (i % SIDE, i / SIDE),
        };
        Vec2::new(x as f32, y as f32) / (SIDE as f32 * 0.5) - 1.0
    }

    fn shuffled(rays: &[TraceRay], random: &mut Random) -> Vec<TraceRay> {
        let mut rays = rays.to_vec();
        for i in (1..rays.len()).rev() {
            rays.swap(i, random.below(i + 1));
        }
        rays
    }

    #[test]
    fn batches_in_the_order_of_pixels_are_not_shuffled() {
        let mut random = Random::new(7);
        let from = Vec3::new(0.3, 0.5, 3.0);
        for is_tiled in [false, true] {
            let mut batch = |ray_through: &dyn Fn(Vec2, &mut Random) -> TraceRay| -> Vec<TraceRay> {
                (0..SIDE * SIDE).map(|i| ray_through(pixel(i, is_tiled), &mut random)).collect()
            };
            let batches = [
                ("camera", batch(&|p, _| ray(from, p.extend(0.0) - from))),
                ("parallel", batch(&|p, _| ray(p.extend(2.0), Vec3::NEG_Z))),
                (
                    "lens",
                    batch(&|p, random| {
                        let from = from + random.vec3() * 0.01;
                        ray(from, p.extend(0.0) - from)
                    }),
                ),
                ("shadow", batch(&|p, _| ray(p.extend(p.x * p.y), from - p.extend(p.x * p.y)))),
                ("diffuse", batch(&|p, random| ray(p.extend(p.x * p.y), random.direction()))),
                ("random", batch(&|p, random| ray(p.extend(p.x * p.y), random.vec3() - p.extend(p.x * p.y)))),
            ];
            for (name, rays) in batches {
                assert!(!are_shuffled(&rays), "{name}, tiled: {is_tiled}");
                let rays = shuffled(&rays, &mut random);
                assert!(are_shuffled(&rays), "{name}, shuffled");
                let make_neighbours = !matches!(name, "diffuse" | "random");
                assert_eq!(keys().make_neighbours(&rays), make_neighbours, "{name}, shuffled");
                let order = keys().order(&rays);
                assert!(!are_shuffled(&permuted(&rays, &order)), "{name}, sorted");
                assert!(!are_shuffled(&rays[..FEWEST_RAYS - 1]), "few rays of {name}");
            }
        }
    }

    #[test]
    fn every_ray_has_a_key_and_comes_back_to_its_place() {
        let mut random = Random::new(3);
        for length in [0, 1, 2, 15, 64, 5000] {
            let any = |random: &mut Random| Vec3::from_array([(); 3].map(|()| random.any_float()));
            let rays: Vec<_> = (0..length).map(|_| ray(any(&mut random), any(&mut random))).collect();
            let order = keys().order(&rays);
            let numbers: Vec<_> = (0..length).collect();
            assert_eq!(restored(permuted(&numbers, &order), &order), numbers);
            let keys: Vec<_> = permuted(&rays, &order).iter().map(|ray| keys().key(ray)).collect();
            assert!(keys.is_sorted() && keys.iter().all(|key| key >> KEY_BITS == 0));
        }
        let no_scene = RayKeys::new(&SceneParams::zeroed());
        assert!(no_scene.key(&ray(Vec3::ZERO, Vec3::X)) >> KEY_BITS == 0);
    }

    #[test]
    fn directions_fill_the_square() {
        let mut random = Random::new(5);
        let cells = |d: Vec3| (square_of(d) * 4.0).to_array().map(|x| cell(x, 2));
        let mut counts = [[0; 4]; 4];
        for _ in 0..16_000 {
            let [x, y] = cells(random.direction());
            counts[usize::from(x)][usize::from(y)] += 1;
        }
        assert!(counts.as_flattened().iter().all(|&count| count > 500), "{counts:?}");
        // Neighbours on both sides of the fold.
        let [above, below] = [1e-6, -1e-6].map(|z| square_of(Vec3::new(0.6, -0.8, z)));
        assert!((above - below).length() < 1e-5);
    }
}
