//! Sorted batches: the answers of batches in the caller's order, ray by ray, and which batches `auto` sorts.

use crate::common::{Random, SEED, device, scene_of, sheet, soup};
use glam::Vec3;
use raybrook::low_level::device::{DeviceHandle, DeviceKind};
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{PacketSize, RayOrder, StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{TraceJob, TraceResult, is_hit};
use std::sync::Arc;

const PACKETS: TraceOptions =
    TraceOptions { packet_size: PacketSize::Sixteen, ..TraceOptions::of(StructureKind::Bvh8) };

const COUNTED: TraceOptions = TraceOptions { counters: true, ..TraceOptions::of(StructureKind::Bvh8) };

/// Triangles about the origin.
fn triangles() -> Vec<[Vec3; 3]> {
    [soup(300, 0.3, &mut Random::new(SEED)), sheet(12)].concat()
}

/// Rays from everywhere, some of them nonsense, in no order.
fn scattered(count: usize, random: &mut Random) -> Vec<TraceRay> {
    (0..count)
        .map(|i| {
            let from = 3.0 * random.vec3();
            let to = random.vec3() - from;
            let mut numbers = [from.x, from.y, from.z, 0.0, to.x, to.y, to.z, f32::INFINITY];
            match i % 16 {
                0 => numbers[random.below(8)] = f32::NAN,
                1 => numbers[random.below(8)] = f32::INFINITY * random.sign(),
                2 => numbers[4..7].fill(0.0),
                3 => numbers[random.below(8)] = random.any_float(),
                4 => numbers[7] = 1.0,
                _ => (),
            }
            let [origin_t_min, direction_t_max] =
                [0, 4].map(|k| Float4::new(Vec3::from_slice(&numbers[k..]), numbers[k + 3]));
            TraceRay { origin_t_min, direction_t_max }
        })
        .collect()
}

/// Rays through the pixels of a square picture, line by line.
fn lines(side: usize) -> Vec<TraceRay> {
    let from = Vec3::new(0.2, 0.1, 3.0);
    let to =
        |i: usize| Vec3::new((i % side) as f32, (i / side) as f32, 0.0) * (2.0 / side as f32) - Vec3::ONE.with_z(0.0);
    let ray = |i| TraceRay {
        origin_t_min: Float4::new(from, 0.0),
        direction_t_max: Float4::new(to(i) - from, f32::INFINITY),
    };
    (0..side * side).map(ray).collect()
}

fn shuffled(rays: &[TraceRay], random: &mut Random) -> Vec<TraceRay> {
    let mut rays = rays.to_vec();
    for i in (1..rays.len()).rev() {
        rays.swap(i, random.below(i + 1));
    }
    rays
}

/// What a batch's jobs give, each repeated twice: closest hits, those with secondary rays, any hits.
fn answers(
    device: Option<&DeviceHandle>,
    options: &TraceOptions,
    batches: &[(Vec<TraceRay>, Vec<Float4>)],
) -> Vec<[TraceResult; 3]> {
    let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles()), options).unwrap());
    let mut tracer = open_tracer(device, &buffers, options, 1, None).unwrap();
    let mut trace = |job: TraceJob| tracer.trace(&job, &|_| ()).unwrap();
    let of_batch = |(rays, next): &(Vec<TraceRay>, Vec<Float4>)| {
        let closest = TraceJob { extreme: &[], rays, next_directions: None, any_hit: false, repeat: 2 };
        let second = TraceJob { next_directions: Some(next), ..closest };
        [closest, second, TraceJob { any_hit: true, ..closest }].map(&mut trace)
    };
    batches.iter().map(of_batch).collect()
}

fn bits(hits: &[Hit]) -> Vec<[u32; 4]> {
    hits.iter().map(|hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive]).collect()
}

#[test]
fn sorted_batches_have_the_answers_of_those_in_the_callers_order() {
    let mut random = Random::new(SEED);
    let batches: Vec<_> = [0, 1, 15, 33, 5003]
        .map(|length| {
            let next = (0..length).map(|_| Float4::new(random.vec3(), 0.0)).collect();
            (scattered(length, &mut random), next)
        })
        .into();
    let device = device();
    let places = [None].into_iter().chain(device.as_ref().map(Some));
    for (place, options) in places.flat_map(|place| [PACKETS, COUNTED].map(|options| (place, options))) {
        let [kept, sorted] = [RayOrder::Kept, RayOrder::Sorted]
            .map(|ray_order| answers(place, &TraceOptions { ray_order, ..options }, &batches));
        for ((kept, sorted), (rays, _)) in kept.iter().zip(&sorted).zip(&batches) {
            let what = format!("{} rays, device: {}, {options:?} (seed {SEED})", rays.len(), place.is_some());
            for (job, (kept, sorted)) in kept.iter().zip(sorted).enumerate() {
                assert!(kept.sort_s.is_none() && sorted.sort_s.is_some(), "{what}");
                assert_eq!(sorted.kernel_s.len(), 2, "{what}");
                let is_any_of_packets = job == 2 && options.packet_size != PacketSize::One;
                if is_any_of_packets {
                    assert!(kept.hits.iter().map(is_hit).eq(sorted.hits.iter().map(is_hit)), "any hits of {what}");
                } else {
                    assert_eq!(bits(&sorted.hits), bits(&kept.hits), "job {job} of {what}");
                    assert_eq!(sorted.second_pass, kept.second_pass, "job {job} of {what}");
                }
                let [next, kept_next] = [sorted, kept].map(|result| result.next_hits.as_deref().map(bits));
                assert_eq!(next, kept_next, "secondary rays of {what}");
                assert_eq!(next.is_some(), job == 1);
                assert_eq!((&sorted.work, &sorted.next_work), (&kept.work, &kept.next_work), "job {job} of {what}");
                assert_eq!(sorted.work.is_some(), options.counters);
            }
        }
        let hits = kept.last().unwrap()[0].hits.iter().filter(|hit| is_hit(hit)).count();
        assert!(hits > 1000, "{hits} hits");
    }
}

#[test]
fn auto_sorts_what_is_shuffled_where_packets_gain() {
    let mut random = Random::new(SEED);
    let in_lines = lines(128);
    let mixed = shuffled(&in_lines, &mut random);
    let reversed =
        |ray: &TraceRay| TraceRay { direction_t_max: Float4::new(-ray.direction_t_max.xyz(), f32::INFINITY), ..*ray };
    // Of these sorting makes no neighbours.
    let random_ones = mixed.iter().map(|_| TraceRay {
        origin_t_min: Float4::new(random.vec3(), 0.0),
        direction_t_max: Float4::new(random.vec3(), f32::INFINITY),
    });
    let random_ones = random_ones.collect();
    let few = mixed[..1000].to_vec();
    // These leave at once, whatever their order.
    let away = mixed.iter().map(reversed).collect();
    let batches = [in_lines, mixed, random_ones, few, away];
    let is_sorted = |device: Option<&DeviceHandle>, options| {
        let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles()), options).unwrap());
        let mut tracer = open_tracer(device, &buffers, options, 1, None).unwrap();
        let mut is_sorted = |rays: &[TraceRay]| {
            let job = TraceJob { extreme: &[], rays, next_directions: None, any_hit: false, repeat: 1 };
            tracer.trace(&job, &|_| ()).unwrap().sort_s.is_some()
        };
        batches.each_ref().map(|rays| is_sorted(rays))
    };
    assert_eq!(is_sorted(None, &PACKETS), [false; 5]);
    assert_eq!(is_sorted(None, &TraceOptions { ray_order: RayOrder::Sorted, ..PACKETS }), [true; 5]);
    let Some(device) = device() else { return };
    let is_cpu = device.info.kind == DeviceKind::Cpu;
    assert_eq!(is_sorted(Some(&device), &PACKETS), [false, is_cpu, false, false, false]);
    assert_eq!(is_sorted(Some(&device), &TraceOptions { ray_order: RayOrder::Kept, ..PACKETS }), [false; 5]);
}
