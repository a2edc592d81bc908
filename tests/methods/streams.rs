//! Batches that stream through a device, part by part, against the same rays traced at once, bit for bit.

use crate::common::{Random, SEED, device, on_oclgrind, scene_of, soup};
use crate::packets::{PACKETS, bits, scattered, trace};
use raybrook::low_level::device::OpenClBackend;
use raybrook::low_level::options::{Intersector, RayOrder, StructureKind, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::shared::{Hit, TraceRay};
use raybrook::low_level::tracer::{Backend, RayStream, is_hit};
use raybrook::{DeviceKind, Error, Result};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex};

/// Rays of the shortest parts, and how many rays there are at least, for a stream to be worth it.
const PART: usize = 1 << 16;
const LEAST: usize = 3 * PART;

const BVH2: TraceOptions = TraceOptions::of(StructureKind::Bvh2);

/// A tracer whose batches stream, if there is a device; and rays of all kinds, of which some are deferred.
fn bench(options: &TraceOptions, rays: usize) -> Option<(OpenClBackend, Vec<TraceRay>)> {
    let device = device()?;
    let mut random = Random::new(SEED);
    let triangles = soup(300, 0.4, &mut random);
    let buffers = Arc::new(SceneBuffers::new(&scene_of(&triangles), options).unwrap());
    let tracer = OpenClBackend::new(&device, &buffers, options, 1, None).unwrap();
    tracer.stage_transfers();
    // All are different, but it takes long to make them.
    let some = scattered(10_007, &triangles, &mut random);
    let mut ray = |i: usize| {
        let mut ray = some[i % some.len()];
        ray.origin_t_min.w -= random.unit() * 1e-3;
        ray
    };
    Some((tracer, (0..rays).map(&mut ray).collect()))
}

/// Streams rays; the hits of all of them, those that were deferred among them, and how many these are.
fn stream(tracer: &mut OpenClBackend, rays: &[TraceRay], any_hit: bool) -> Option<(Vec<Hit>, usize)> {
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
    let kernel_s = tracer.trace_stream(&stream, &progress).unwrap()?;
    assert!(kernel_s > 0.0 && made.iter().all(|made| made.load(Ordering::Relaxed) == 1));
    let parts = parts.into_inner().unwrap();
    assert!(parts.is_sorted() && parts.last() == Some(&1.0), "{parts:?}");

    let deferred = deferred.into_inner().unwrap();
    let mut hits: Vec<Hit> = hits.into_iter().map(|hit| hit.into_inner().unwrap().unwrap()).collect();
    let apart: Vec<TraceRay> = deferred.iter().map(|(_, ray)| *ray).collect();
    for ((number, ray), hit) in deferred.iter().zip(trace(tracer, &apart, any_hit).hits) {
        assert_eq!(bytemuck::bytes_of(ray), bytemuck::bytes_of(&rays[*number]));
        hits[*number] = hit;
    }
    Some((hits, deferred.len()))
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
            assert_eq!(streamed.is_some(), count >= LEAST);
            let Some((hits, deferred)) = streamed else { continue };
            let differ = |i: &usize| match any_hit {
                true => is_hit(&hits[*i]) != is_hit(&expected[*i]),
                false => bits(&hits[*i]) != bits(&expected[*i]),
            };
            assert_eq!((0..count).find(differ), None, "{options:?} {any_hit} {count} (seed {SEED})");
            let hit = hits.iter().filter(|hit| is_hit(hit)).count();
            assert!(hit > count / 10 && hit < count, "{hit} of {count}");
            // More than come with the hits of a part.
            let many = 1024 * count.div_ceil(PART);
            assert!(deferred > if any_hit { 0 } else { many }, "{options:?} {any_hit} {count}: {deferred}");
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
        // On a CPU packets gain by order.
        let streams = options == PACKETS && device().is_some_and(|device| device.info.kind == DeviceKind::Gpu);
        assert_eq!(stream(&mut tracer, &rays, false).is_some(), streams, "{options:?}");
    }
}

#[test]
fn streams_end_where_they_are_stopped_and_others_follow() {
    let Some((mut tracer, rays)) = bench(&BVH2, 4 * PART) else { return };
    if on_oclgrind() {
        return; // for which that is too much
    }
    let expected = trace(&mut tracer, &rays, false).hits;
    let again = |tracer: &mut OpenClBackend| {
        let (hits, _) = stream(tracer, &rays, false).unwrap();
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
        assert!(catch_unwind(AssertUnwindSafe(|| run_to_panic(&mut tracer))).is_err());
    }
    again(&mut tracer);
    // By a flag.
    let stop = Arc::new(AtomicBool::new(false));
    tracer.stop_when(stop.clone());
    let stopping = |first: usize, _: &[Hit]| stop.store(first >= PART, Ordering::Relaxed);
    let stopped = run(&mut tracer, &make, &stopping, &|_| ());
    assert!(matches!(stopped, Err(Error::Stopped)), "{stopped:?}");
    stop.store(false, Ordering::Relaxed);
    again(&mut tracer);
}
