//! Batches that go through a device part by part, as a stream or in place, against the same rays traced at once, bit
//! for bit.

use crate::common::{APART, AT_APART, Random, SEED, device, on_oclgrind, scene_of, soup};
use crate::packets::{PACKETS, bits, scattered, trace};
use raybrook::low_level::device::OpenClBackend;
use raybrook::low_level::options::{Intersector, RayOrder, StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{Backend, RayStream, TraceResult, is_hit};
use raybrook::{DeviceKind, Error, Result};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

/// Rays of the shortest parts, and how many rays there are at least, for a stream to be worth it.
const PART: usize = 1 << 16;
const LEAST: usize = 3 * PART;
/// Rays of a part that two threads trace in place.
const PLACE: usize = 1 << 18;

const BVH2: TraceOptions = TraceOptions::of(StructureKind::Bvh2);

/// A tracer whose batches stream, if there is a device; and rays of all kinds, of which some are deferred.
fn bench(options: &TraceOptions, rays: usize) -> Option<(OpenClBackend, Vec<TraceRay>)> {
    let (tracer, rays) = bench_of(options, rays, 8)?;
    tracer.stage_transfers();
    Some((tracer, rays))
}

/// The same with a tracer that does as it does by itself.
fn whole_bench(options: &TraceOptions, rays: usize) -> Option<(OpenClBackend, Vec<TraceRay>)> {
    bench_of(options, rays, rays + 1)
}

/// The same; the second one of every so many rays is surely left to the second pass.
fn bench_of(options: &TraceOptions, rays: usize, deferred_of: usize) -> Option<(OpenClBackend, Vec<TraceRay>)> {
    let device = device()?;
    let mut random = Random::new(SEED);
    let triangles = [soup(300, 0.4, &mut random), vec![APART]].concat();
    let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles), options).unwrap());
    let tracer = OpenClBackend::new(&device, &buffers, options, 1, None).unwrap();
    // All are different, but it takes long to make them.
    let some = scattered(10_007, &triangles, &mut random);
    let deferred = buffers.trace_ray(APART[0] - AT_APART, AT_APART, 0.0, f32::INFINITY);
    let mut ray = |i: usize| {
        let mut ray = if i % deferred_of == 1 { deferred } else { some[i % some.len()] };
        ray.origin_t_min.w -= random.unit() * 1e-3;
        ray
    };
    Some((tracer, (0..rays).map(&mut ray).collect()))
}

fn is_cpu() -> bool {
    device().is_some_and(|device| device.info.kind == DeviceKind::Cpu)
}

/// What came of a stream.
struct Streamed {
    /// The hits of all rays.
    hits: Vec<Hit>,
    /// How many of them were deferred.
    deferred: usize,
    took: TraceResult,
}

/// Streams rays, if the tracer has them stream.
fn stream(tracer: &mut OpenClBackend, rays: &[TraceRay], any_hit: bool) -> Option<Streamed> {
    let hits: Vec<_> = rays.iter().map(|_| Mutex::new(None)).collect();
    let made: Vec<_> = (0..rays.len().div_ceil(RayStream::PIECE)).map(|_| AtomicU32::new(0)).collect();
    let make = |first: usize, places: &mut [TraceRay]| {
        assert_eq!(first % RayStream::PIECE, 0);
        assert!(places.len() == RayStream::PIECE || first + places.len() == rays.len(), "{first} {}", places.len());
        made[first / RayStream::PIECE].fetch_add(1, Ordering::Relaxed);
        places.copy_from_slice(&rays[first..first + places.len()]);
    };
    let take = |first: usize, taken: &[Hit]| {
        assert_eq!(first % RayStream::PIECE, 0);
        assert!(taken.len() == RayStream::PIECE || first + taken.len() == rays.len(), "{first} {}", taken.len());
        hits[first..].iter().zip(taken).for_each(|(place, hit)| {
            assert!(place.lock().unwrap().replace(*hit).is_none());
        });
    };
    let parts = Mutex::new(vec![0.0]);
    let progress = |part| parts.lock().unwrap().push(part);
    let deferred = Mutex::new(Vec::new());
    let defer = |number: usize, ray: &TraceRay| {
        assert!(hits[number].lock().unwrap().is_none(), "{number}");
        deferred.lock().unwrap().push((number, *ray));
    };
    let stream = RayStream { count: rays.len(), any_hit, make: &make, defer: &defer, take: &take };
    let took = tracer.trace_stream(&stream, &progress).unwrap()?;
    assert!(took.hits.is_empty() && (took.kernel_s.iter().sum::<f64>() > 0.0 || rays.is_empty()));
    assert!(made.iter().all(|made| made.load(Ordering::Relaxed) == 1));
    let parts = parts.into_inner().unwrap();
    assert!(parts.is_sorted() && (parts.last() == Some(&1.0) || rays.is_empty()), "{parts:?}");

    let deferred = deferred.into_inner().unwrap();
    let mut hits: Vec<Hit> = hits.into_iter().map(|hit| hit.into_inner().unwrap().unwrap()).collect();
    let apart: Vec<TraceRay> = deferred.iter().map(|(_, ray)| *ray).collect();
    for ((number, ray), hit) in deferred.iter().zip(trace(tracer, &apart, any_hit).hits) {
        assert_eq!(bytemuck::bytes_of(ray), bytemuck::bytes_of(&rays[*number]));
        hits[*number] = hit;
    }
    Some(Streamed { hits, deferred: deferred.len(), took })
}

#[test]
fn streams_have_the_hits_of_whole_batches() {
    // No parts, three, and four, of which one is short.
    let (short, long) = ([1000].as_slice(), [1000, LEAST, LEAST + 777].as_slice());
    let packets = TraceOptions { ray_order: RayOrder::Kept, ..PACKETS };
    for (options, any_hit, counts) in [(BVH2, false, long), (BVH2, true, &long[2..]), (packets, false, &long[2..])] {
        for &count in if on_oclgrind() { short } else { counts } {
            let Some((mut tracer, rays)) = bench(&options, count) else { return };
            let expected = trace(&mut tracer, &rays, any_hit).hits;
            let streamed = stream(&mut tracer, &rays, any_hit);
            // On CPUs fewer are traced in place.
            assert_eq!(streamed.is_some(), count >= LEAST || is_cpu());
            let Some(Streamed { hits, deferred, .. }) = streamed else { continue };
            check_hits((&hits, &expected), any_hit, &format!("{options:?} {any_hit} {count}"));
            // More than come with the hits of a part.
            let many = 1024 * count.div_ceil(PART);
            let is_enough = deferred > if any_hit { 0 } else { many };
            assert!(is_enough || count < LEAST, "{options:?} {any_hit} {count}: {deferred}");
        }
    }
}

/// The answers are those of the whole batch, hits and misses.
fn check_hits((hits, expected): (&[Hit], &[Hit]), any_hit: bool, what: &str) {
    let differ = |i: &usize| match any_hit {
        true => is_hit(&hits[*i]) != is_hit(&expected[*i]),
        false => bits(&hits[*i]) != bits(&expected[*i]),
    };
    assert_eq!((0..expected.len()).find(differ), None, "{what} (seed {SEED})");
    let (hit, count) = (hits.iter().filter(|hit| is_hit(hit)).count(), hits.len());
    assert!(count < 100 || hit > count / 10 && hit < count, "{what}: {hit} of {count}");
}

#[test]
fn what_is_traced_in_place_has_the_hits_of_whole_batches() {
    if !is_cpu() {
        println!("skipped: no OpenCL device that is a CPU");
        return;
    }
    // More threads have larger parts.
    let two_threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    two_threads.install(check_in_place);
}

fn check_in_place() {
    let sorted = TraceOptions { ray_order: RayOrder::Sorted, ..PACKETS };
    // Short batches before and after a long one, of two parts.
    let (short, long) = ([0, 1, 15, 1000, 15].as_slice(), [15, PLACE + 777, 15].as_slice());
    for (options, any_hit, counts) in
        [(PACKETS, false, short), (PACKETS, false, long), (PACKETS, true, long), (sorted, false, long)]
    {
        if on_oclgrind() && counts == long {
            continue; // for which that is too much
        }
        let Some((mut tracer, rays)) = whole_bench(&options, *counts.iter().max().unwrap()) else { return };
        for &count in counts {
            let what = format!("{options:?} {any_hit} {count}");
            let expected = trace(&mut tracer, &rays[..count], any_hit);
            let Streamed { hits, deferred, took } = stream(&mut tracer, &rays[..count], any_hit).unwrap();
            check_hits((&hits, &expected.hits), any_hit, &what);
            assert_eq!(deferred, 0, "{what}");
            let is_sorted = options.ray_order == RayOrder::Sorted;
            // What is left to the second pass depends on the rays of a packet, and those on what is sorted with them.
            assert!(took.second_pass == expected.second_pass || is_sorted, "{what}");
            assert!(count < 1000 || any_hit || took.second_pass > Some(0), "{what}");
            assert_eq!(took.sort_s.is_some(), is_sorted && count > 0, "{what}");
        }
    }
}

#[test]
fn what_does_not_stream_is_traced_at_once() {
    let counting = TraceOptions { counters: true, ..BVH2 };
    let sorted = TraceOptions { ray_order: RayOrder::Sorted, ..BVH2 };
    let rounded = TraceOptions { intersector: Intersector::Watertight, ray_order: RayOrder::Kept, ..PACKETS };
    for options in [counting, sorted, rounded, PACKETS] {
        let Some((mut tracer, rays)) = bench(&options, LEAST) else { return };
        // On a CPU they are traced in place, in whatever order.
        let streams = options == PACKETS || options == sorted && is_cpu();
        assert_eq!(stream(&mut tracer, &rays, false).is_some(), streams, "{options:?}");
    }
}

#[test]
fn streams_end_where_they_are_stopped_and_others_follow() {
    if on_oclgrind() {
        return; // for which that is too much
    }
    let streaming = bench(&BVH2, 4 * PART);
    let in_place = is_cpu().then(|| whole_bench(&BVH2, PLACE + PART)).flatten();
    let two_threads = rayon::ThreadPoolBuilder::new().num_threads(2).build().unwrap();
    for (mut tracer, rays) in [streaming, in_place].into_iter().flatten() {
        two_threads.install(|| check_ends(&mut tracer, &rays));
    }
}

fn check_ends(tracer: &mut OpenClBackend, rays: &[TraceRay]) {
    let expected = trace(tracer, rays, false).hits;
    let again = |tracer: &mut OpenClBackend| {
        let Streamed { hits, .. } = stream(tracer, rays, false).unwrap();
        assert!(hits.iter().zip(&expected).all(|(hit, expected)| bits(hit) == bits(expected)));
    };
    let from = |first: usize| first >= 2 * PART;
    let make = |first: usize, places: &mut [TraceRay]| places.copy_from_slice(&rays[first..first + places.len()]);
    let take = |_: usize, _: &[Hit]| ();
    let run = |tracer: &mut OpenClBackend,
               make: &(dyn Fn(usize, &mut [TraceRay]) + Sync),
               take: &(dyn Fn(usize, &[Hit]) + Sync),
               progress: &(dyn Fn(f64) + Sync)|
     -> Result<()> {
        let stream = RayStream { count: rays.len(), any_hit: false, make, defer: &|_, _| (), take };
        tracer.trace_stream(&stream, progress).map(drop)
    };
    // By whoever makes rays, takes hits, or is told of the progress: they unwind.
    let panics = |first: usize| assert!(!from(first), "as it should");
    let making = |first: usize, places: &mut [TraceRay]| {
        panics(first);
        make(first, places);
    };
    let taking = |first: usize, _: &[Hit]| panics(first);
    let watching = |part: f64| panics((part * rays.len() as f64) as usize);
    for run_to_panic in [
        &mut |tracer: &mut OpenClBackend| run(tracer, &making, &take, &|_| ()) as Result<()>,
        &mut |tracer: &mut OpenClBackend| run(tracer, &make, &taking, &|_| ()),
        &mut |tracer: &mut OpenClBackend| run(tracer, &make, &take, &watching),
    ] as [&mut dyn FnMut(&mut OpenClBackend) -> Result<()>; 3]
    {
        assert!(catch_unwind(AssertUnwindSafe(|| run_to_panic(tracer))).is_err());
    }
    again(tracer);
    // By a flag.
    let stop = Arc::new(AtomicBool::new(false));
    tracer.stop_when(stop.clone());
    let stopping = |first: usize, _: &[Hit]| stop.store(first >= PART, Ordering::Relaxed);
    let stopped = run(tracer, &make, &stopping, &|_| ());
    assert!(matches!(stopped, Err(Error::Stopped)), "{stopped:?}");
    stop.store(false, Ordering::Relaxed);
    again(tracer);
}
