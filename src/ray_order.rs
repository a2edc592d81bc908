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
use crate::fma::with_fma;
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
/// Batches whose rays visit fewer nodes of a hierarchy of eight boxes a node leave the scene too soon to repay their
/// sorting. On two cores with PoCL, kept and sorted, with the sorting, milliseconds in Python: a million shuffled
/// camera rays through bunny (4.7 nodes) 106 and 63, through a bunny that fills a fifth of the picture (2.7) 57 and 48,
/// through sponza (3.3) 68 and 45, and gears (2.6) 54 and 51; 428 thousand of bunny's shadow rays (8) 57 and 30, 622
/// thousand of gears' (1.9) 26 and 28, 684 thousand of sponza's (1.2) 14 and 25.
const FEWEST_VISITS: f64 = 2.5;
/// So many rays of a batch are sorted to find out whether sorting makes neighbours of them.
const SORTED_SAMPLES: usize = 4096;
/// Those next to each other are then at most this part as far apart as any two. Of camera and shadow rays it is 0.03.
/// Where rays from one place go many ways, a million is too few for neighbours: random rays through the bunny (0.3)
/// took 1.1 to 1.2 times as long sorted as shuffled, and so did the diffuse rays (1) of gears; those of the bunny took
/// 0.85.
const NEIGHBOURS: f32 = 0.125;

/// Memory that sorting takes, to be kept for the next batch: new pages cost more than sorting.
#[derive(Default)]
pub(crate) struct SortRoom {
    keys: Vec<u32>,
    spare: Vec<u32>,
}

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
    room: &mut SortRoom,
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
        let order = keys.order(rays, room);
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

/// Whether rays visit so many nodes that sorting pays: a few of them, which `trace` traces and counts.
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
    let work = WorkSum::new(rays.len() as u64, trace(&trial, options)?.work.unwrap_or_default());
    Ok(work.mean(WorkCounter::Steps) + work.mean(WorkCounter::Leaves) >= FEWEST_VISITS)
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

    /// Whether rays of a shuffled batch are near those that come next once they are sorted, by direction and by origin,
    /// where two cells are near: found out by some of them.
    fn make_neighbours(&self, rays: &[TraceRay]) -> bool {
        let some = some_of(rays, SORTED_SAMPLES);
        let sorted = permuted(&some, &self.order(&some, &mut SortRoom::default()));
        let (near, far) = distances(&some, &sorted, 1, direction);
        let (near_origin, far_origin) = distances(&some, &sorted, 1, origin);
        near <= NEIGHBOURS * far && near_origin <= (NEIGHBOURS * far_origin).max(2.0 / self.cells_per_unit)
    }

    /// The key of a ray: [`KEY_BITS`] bits. One that starts outside of the scene has that of the nearest cell, one of
    /// nonsense any.
    fn key(&self, ray: &TraceRay) -> u64 {
        let (origin, direction) = (origin_key(self.cells(origin(ray))), direction_key(ray.direction_t_max.xyz()));
        u64::from(origin) << (2 * DIRECTION_BITS) | u64::from(direction)
    }

    /// Where an origin lies, in cells.
    #[inline(always)]
    fn cells(&self, origin: Vec3) -> Vec3 {
        (origin - self.low) * self.cells_per_unit
    }

    /// Which bits of their keys tell rays apart, found out by some of them.
    fn telling(&self, rays: &[TraceRay]) -> TellingBits {
        TellingBits::of(some_of(rays, TELLING_SAMPLES).iter().map(|ray| self.key(ray)).collect())
    }

    /// Numbers of rays, those with the lowest keys first, by the bits that tell them apart. More than
    /// [`parallel::MOST_ORDERED`] go in parts of so many, each of which has its neighbours.
    fn order(&self, rays: &[TraceRay], room: &mut SortRoom) -> Vec<u32> {
        let mut order = vec![0; rays.len()];
        let parts = rays.chunks(parallel::MOST_ORDERED).zip(order.chunks_mut(parallel::MOST_ORDERED));
        for (number, (rays, order)) in parts.enumerate() {
            let SortRoom { keys, spare } = room;
            keys.resize(rays.len(), 0);
            spare.resize(rays.len(), 0);
            let telling = self.telling(rays);
            parallel::each(rays.chunks(PIECE).zip(keys.chunks_mut(PIECE)), |(rays, keys)| {
                write_keys(self, &telling, rays, keys);
            });
            parallel::order_by(keys, order, spare);
            let first = (number * parallel::MOST_ORDERED) as u32;
            if first > 0 {
                parallel::each_mut(order, |_, number| *number += first);
            }
        }
        order
    }
}

/// So many rays get their keys at once, in the registers' lanes.
const BLOCK: usize = 64;
/// So many a thread.
const PIECE: usize = 64 * BLOCK;

with_fma! {
    /// The bits of each ray's key that tell.
    fn write_keys(of: &RayKeys, telling: &TellingBits, rays: &[TraceRay], keys: &mut [u32]) {
        for (rays, keys) in rays.chunks(BLOCK).zip(keys.chunks_mut(BLOCK)) {
            let (mut origins, mut directions) = ([[0.0; BLOCK]; 3], [[0.0; BLOCK]; 3]);
            for (i, ray) in rays.iter().enumerate() {
                let (origin, direction) = (ray.origin_t_min.xyz().to_array(), ray.direction_t_max.xyz().to_array());
                for axis in 0..3 {
                    origins[axis][i] = origin[axis];
                    directions[axis][i] = direction[axis];
                }
            }
            // In two loops: one alone, with both in its registers, took 1.4 times as long, without AVX twice as long.
            let mut whole = [0u64; BLOCK];
            for (i, key) in whole.iter_mut().enumerate() {
                let origin = Vec3::new(origins[0][i], origins[1][i], origins[2][i]);
                *key = u64::from(origin_key(of.cells(origin))) << (2 * DIRECTION_BITS);
            }
            for (i, key) in whole.iter_mut().enumerate() {
                *key |= u64::from(direction_key(Vec3::new(directions[0][i], directions[1][i], directions[2][i])));
            }
            keys.fill(0);
            for &(shift, mask) in &telling.runs {
                for (key, whole) in keys.iter_mut().zip(&whole) {
                    *key |= (whole >> shift) as u32 & mask;
                }
            }
        }
    }
}

/// How many rays of a batch are looked at to find out which bits tell them apart.
const TELLING_SAMPLES: usize = 1024;
/// A bit tells if it is another one in at least one of so many rays that are alike in the bits above: all rays of a
/// camera start in one cell, and those of a long lens go through four places of the square of directions, where the
/// next bits are always the same. A ray in a thousand from elsewhere changes nothing of that.
const TELLING_SHARE: usize = 256;
/// So many rays at least must be alike in the bits above, else they say nothing.
const ALIKE: usize = 16;
/// Where less than one ray in so many is like as many others, lower bits are taken to tell.
const ALIKE_SHARE: usize = 4;

/// The highest bits that tell the rays of a batch apart: no more of them than are ordered at once.
struct TellingBits {
    /// How far a whole key is moved to the right, and which bits then are those of the short one.
    runs: Vec<(u32, u32)>,
}

impl TellingBits {
    /// Those of a sample of keys.
    fn of(mut keys: Vec<u64>) -> TellingBits {
        keys.sort_unstable();
        let tells = |&bit: &u32| {
            let alike = keys.chunk_by(|a, b| a >> bit >> 1 == b >> bit >> 1).filter(|keys| keys.len() >= ALIKE);
            let (all, others) = alike.fold((0, 0), |(all, others), keys| {
                let zeros = keys.partition_point(|key| key >> bit & 1 == 0);
                (all + keys.len(), others + zeros.min(keys.len() - zeros))
            });
            all < keys.len().div_ceil(ALIKE_SHARE) || others * TELLING_SHARE >= all
        };
        let bits: Vec<_> = (0..KEY_BITS).rev().filter(tells).take(parallel::ORDERED_BITS as usize).collect();
        // The lowest of them becomes bit 0.
        let mut runs: Vec<(u32, u32)> = Vec::new();
        for (place, bit) in bits.into_iter().rev().enumerate() {
            let (shift, mask) = (bit - place as u32, 1 << place);
            match runs.last_mut().filter(|run| run.0 == shift) {
                Some(run) => run.1 |= mask,
                None => runs.push((shift, mask)),
            }
        }
        TellingBits { runs }
    }
}

/// The place of an origin, in cells, on their Z-curve.
#[inline(always)]
fn origin_key(origin: Vec3) -> u32 {
    const { assert!(ORIGIN_BITS <= u8::BITS) };
    let [x, y, z] = [cell(origin.x, ORIGIN_BITS), cell(origin.y, ORIGIN_BITS), cell(origin.z, ORIGIN_BITS)];
    zorder::index_of([x as u8, y as u8, z as u8])
}

/// The place of a direction on the Z-curve of the square's cells.
#[inline(always)]
fn direction_key(direction: Vec3) -> u32 {
    const { assert!(DIRECTION_BITS <= u16::BITS) };
    let place = square_of(direction) * (1u32 << DIRECTION_BITS) as f32;
    let [x, y] = [cell(place.x, DIRECTION_BITS), cell(place.y, DIRECTION_BITS)];
    zorder::index_of([x as u16, y as u16])
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
/// Rounded halfway between two numbers, so that the middle of the first cell is 0.
#[inline(always)]
fn cell(x: f32, bits: u32) -> u32 {
    // The lowest bits of such a sum are the integer. A conversion is not made in lanes, for the sake of numbers that
    // no integer has.
    const INTEGERS: f32 = (1 << (f32::MANTISSA_DIGITS - 1)) as f32;
    let last = (1u32 << bits) - 1;
    ((x - 0.5).max(0.0).min(last as f32) + INTEGERS).to_bits() & last
}

/// A direction of any length where it meets an octahedron.
#[inline(always)]
fn on_octahedron(direction: Vec3) -> Vec3 {
    direction / direction.abs().element_sum()
}

/// A direction on the square from 0 to 1: an octahedron with its lower half folded out.
#[inline(always)]
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
                let order = keys().order(&rays, &mut SortRoom::default());
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
            let order = keys().order(&rays, &mut SortRoom::default());
            let numbers: Vec<_> = (0..length).collect();
            assert_eq!(restored(permuted(&numbers, &order), &order), numbers);
            let whole: Vec<_> = rays.iter().map(|ray| keys().key(ray)).collect();
            assert!(whole.iter().all(|key| key >> KEY_BITS == 0));
            let telling = keys().telling(&rays);
            let mut short = vec![1; length];
            write_keys(&keys(), &telling, &rays, &mut short);
            // In lanes as alone.
            let of_one =
                |key: &u64| telling.runs.iter().map(|&(shift, mask)| (key >> shift) as u32 & mask).sum::<u32>();
            assert_eq!(short, whole.iter().map(of_one).collect::<Vec<_>>());
            assert!(permuted(&short, &order).is_sorted());
        }
        let no_scene = RayKeys::new(&SceneParams::zeroed());
        assert!(no_scene.key(&ray(Vec3::ZERO, Vec3::X)) >> KEY_BITS == 0);
    }

    #[test]
    fn the_highest_bits_that_tell_are_taken() {
        let runs = |keys: &[u64]| TellingBits::of(keys.to_vec()).runs;
        let highest = (KEY_BITS - parallel::ORDERED_BITS, (1 << parallel::ORDERED_BITS) - 1);
        assert_eq!(runs(&[0, 3, 1 << 30]), [highest]);
        assert_eq!(runs(&[5; 20]), []);
        // The third bit is as the fourth in all, and the second has one ray of a thousand to itself.
        let alike = |i: u64| (i & 1) << 3 | (i & 1) << 2 | (i >> 1 & 1);
        let mut keys: Vec<_> = (0..1000).map(alike).collect();
        assert_eq!(runs(&keys), [(0, 1), (2, 2)]);
        keys[7] |= 2;
        assert_eq!(runs(&keys), [(0, 1), (2, 2)]);
        keys.iter_mut().step_by(100).for_each(|key| *key |= 2);
        assert_eq!(runs(&keys), [(0, 3), (1, 4)]);
        let mut random = Random::new(11);
        let any: Vec<_> =
            (0..1000).map(|_| (random.below(1 << 22) as u64) << 23 | random.below(1 << 23) as u64).collect();
        assert_eq!(runs(&any), [highest]);
    }

    #[test]
    fn rays_of_large_batches_are_ordered_in_parts() {
        const PART: usize = parallel::MOST_ORDERED;
        let rays: Vec<_> = (0..PART + 100).map(|i| ray(Vec3::X * (1.0 - i as f32 / PART as f32), Vec3::X)).collect();
        let order = keys().order(&rays, &mut SortRoom::default());
        let (first, second) = order.split_at(PART);
        let is_whole = |part: &[u32], from: usize| {
            let mut part = part.to_vec();
            part.sort_unstable();
            part.iter().copied().eq(from as u32..(from + part.len()) as u32)
        };
        assert!(is_whole(first, 0) && is_whole(second, PART));
        assert!(permuted(&rays, first).iter().map(|ray| keys().key(ray)).is_sorted());
    }

    /// A camera far away, whose rays are few cells of directions, among some from elsewhere.
    #[test]
    fn rays_of_a_long_lens_become_neighbours() {
        let mut random = Random::new(9);
        let from = Vec3::new(0.0, 0.0, 20.0);
        let rays: Vec<_> = (0..SIDE * SIDE)
            .map(|i| match i % 1000 {
                0 => ray(random.vec3(), random.direction()),
                _ => ray(from, pixel(i, false).extend(0.0) - from),
            })
            .collect();
        let rays = shuffled(&rays, &mut random);
        let sorted = permuted(&rays, &keys().order(&rays, &mut SortRoom::default()));
        let (near, far) = distances(&rays, &sorted, 1, direction);
        assert!(near < 0.03 * far, "{near} of {far}");
    }

    #[test]
    fn directions_fill_the_square() {
        let mut random = Random::new(5);
        let cells = |d: Vec3| (square_of(d) * 4.0).to_array().map(|x| cell(x, 2) as usize);
        let mut counts = [[0; 4]; 4];
        for _ in 0..16_000 {
            let [x, y] = cells(random.direction());
            counts[x][y] += 1;
        }
        assert!(counts.as_flattened().iter().all(|&count| count > 500), "{counts:?}");
        // Neighbours on both sides of the fold.
        let [above, below] = [1e-6, -1e-6].map(|z| square_of(Vec3::new(0.6, -0.8, z)));
        assert!((above - below).length() < 1e-5);
    }
}
