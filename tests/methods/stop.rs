//! Calls that are stopped: they end at once, and leave the tracer as it was.

use crate::common::{Random, SEED, device, scene_of, soup};
use raybrook::{Error, Ray, Result, Scene, Tracer, View};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

fn scene() -> Scene {
    scene_of(&soup(500, 0.3, &mut Random::new(SEED)))
}

fn tracer(scene: &Scene, device: &str) -> (Tracer, Arc<AtomicBool>) {
    let stop = Arc::new(AtomicBool::new(false));
    (Tracer::builder(scene).device(device).method("bvh2").stop(stop.clone()).build().unwrap(), stop)
}

fn assert_stopped<T>(result: Result<T>, what: &str) {
    match result {
        Err(error @ Error::Stopped) => assert_eq!(error.exit_code(), 130),
        Err(other) => panic!("{what}: {other}"),
        Ok(_) => panic!("{what} was not stopped"),
    }
}

/// Pictures that are stopped before they begin, and on their way.
fn assert_pictures_stop(device: &str) {
    let scene = scene();
    let (mut tracer, stop) = tracer(&scene, device);
    let views = [View::new(40, 30).error(1.0), View::new(40, 30).samples(4)];
    let before = views.map(|view| tracer.render(&view).unwrap());
    stop.store(true, Ordering::Relaxed);
    views.iter().for_each(|view| assert_stopped(tracer.render(view), "a picture"));
    stop.store(false, Ordering::Relaxed);
    let long = std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_millis(100));
            stop.store(true, Ordering::Relaxed);
        });
        // It would take minutes.
        tracer.render(&View::new(4000, 3000).samples(256))
    });
    assert_stopped(long, "a long picture");
    stop.store(false, Ordering::Relaxed);
    assert_eq!(views.map(|view| tracer.render(&view).unwrap()), before);
}

#[test]
fn stopped_pictures_leave_the_tracer_as_it_was() {
    assert_pictures_stop("reference");
    if let Some(device) = device() {
        assert_pictures_stop(&device.info.index.to_string());
    }
}

#[test]
fn every_call_is_stopped() {
    let scene = scene();
    let (mut tracer, stop) = tracer(&scene, "reference");
    let mut random = Random::new(SEED);
    let rays: Vec<_> = (0..1000).map(|_| Ray::new(random.vec3().into(), random.vec3().into())).collect();
    let before = tracer.closest_hits(&rays).unwrap();
    stop.store(true, Ordering::Relaxed);
    assert_stopped(tracer.closest_hits(&rays), "closest hits");
    assert_stopped(tracer.any_hits(&rays), "any hits");
    assert_stopped(tracer.count_hits(&rays), "counts of hits");
    assert_stopped(tracer.all_hits(&rays), "all hits");
    assert_stopped(tracer.closest_points(&[[0.0; 3]; 9]), "closest points");
    assert_stopped(tracer.winding_numbers(&[[0.0; 3]; 9]), "winding numbers");
    stop.store(false, Ordering::Relaxed);
    assert_eq!(tracer.closest_hits(&rays).unwrap(), before);
}
