//! Rays like those of pictures, as batches: what benches and [`super::tune_scene`] measure.

use crate::error::{Error, Result};
use crate::options::{StructureKind, TraceOptions};
use crate::pack::SceneBuffers;
use crate::random::Random;
use crate::reference::ReferenceBackend;
use crate::reference::shade::camera::camera_direction;
use crate::renderer::complete;
use crate::scene::{LightKind, Samples, Scene};
use crate::shared::TraceRay;
use crate::tracer::{Backend, TraceJob, is_hit};
use glam::Vec3;
use std::sync::Arc;

/// How far above the surface shadow and diffuse rays start, in diagonals of the scene: far enough that none of them
/// meets the triangle that it leaves, since a batch cannot say that a ray leaves one.
pub const LIFT: f32 = 1.0 / 4096.0;

/// Rays of one kind.
#[derive(Debug, Clone)]
pub struct Batch {
    /// `camera`, `shadow`, `diffuse`.
    pub name: &'static str,
    /// In tracing space.
    pub rays: Vec<TraceRay>,
    /// Whether any hit will do.
    pub any_hit: bool,
}

/// `side` x `side` camera rays of a square picture, and from what they hit one shadow ray to the first light and one
/// ray by a cosine lobe each: the same ones for the same `seed`.
///
/// `side` is a power of two up to 65,536: rays lie along a Z-curve, so that neighbours in the batch, however many, are
/// those of a tile, as in pictures. A scene without camera or light gets them as [`complete`] does it. Where the camera
/// sees nothing, there are camera rays alone.
///
/// # Errors
/// [`Error::Option`] when `side` is no such number; [`Error::Scene`] as [`SceneBuffers::new`].
pub fn batches(scene: &Scene, side: u32, seed: u64) -> Result<[Batch; 3]> {
    if !side.is_power_of_two() || side > 1 << 16 {
        return Err(Error::option("side", format!("{side} is no power of two up to 65,536")));
    }
    let mut scene = scene.clone();
    complete(&mut scene, 1.0);
    let options = TraceOptions::of(StructureKind::Bvh2);
    let buffers = Arc::new(SceneBuffers::new(&scene, &options)?);
    let camera = scene.camera.expect("a completed scene has a camera");
    let params = buffers.render_params(&camera, (side, side), Samples::PerPixel(1), 1, None);
    let directions: Vec<_> = (0..u64::from(side) * u64::from(side))
        .map(|i| camera_direction(&params, every_second_bit(i) as f32 + 0.5, every_second_bit(i >> 1) as f32 + 0.5))
        .collect();
    let camera_rays: Vec<_> =
        directions.iter().map(|&direction| buffers.trace_ray(camera.eye, direction, 0.0, f32::INFINITY)).collect();
    let job = TraceJob { extreme: &[], rays: &camera_rays, next_directions: None, any_hit: false, repeat: 1 };
    let hits = ReferenceBackend::new(buffers.clone(), options).trace(&job, &|_| ())?.hits;

    let (low, high) = scene.bounds().unwrap_or_default();
    let lift = (high - low).length() * LIFT;
    let mut random = Random::new(seed);
    let (mut shadow_rays, mut diffuse_rays) = (Vec::new(), Vec::new());
    for (hit, &direction) in hits.iter().zip(&directions).filter(|(hit, _)| is_hit(hit)) {
        let [p0, p1, p2] = scene.vertices(hit.primitive as usize);
        let normal = (p1 - p0).cross(p2 - p0).normalize();
        let normal = if normal.dot(direction) > 0.0 { -normal } else { normal };
        let origin = camera.eye + direction * hit.t + normal * lift;
        let (to_light, t_max) = to_light(&scene, origin);
        shadow_rays.push(buffers.trace_ray(origin, to_light, 0.0, t_max));
        // Normal and a point of the unit sphere make a cosine lobe.
        diffuse_rays.push(buffers.trace_ray(origin, normal + random.direction(), 0.0, f32::INFINITY));
    }
    Ok([
        Batch { name: "camera", rays: camera_rays, any_hit: false },
        Batch { name: "shadow", rays: shadow_rays, any_hit: true },
        Batch { name: "diffuse", rays: diffuse_rays, any_hit: false },
    ])
}

/// Bits 0, 2, 4, ... as one number.
fn every_second_bit(number: u64) -> u32 {
    (0..u32::BITS / 2).map(|bit| ((number >> (2 * bit)) as u32 & 1) << bit).sum()
}

/// From `point` to the scene's first light, and the t at which it is.
fn to_light(scene: &Scene, point: Vec3) -> (Vec3, f32) {
    match scene.lights[0].kind {
        LightKind::Directional { direction } => (-direction, f32::INFINITY),
        LightKind::Point { position } | LightKind::Spot { position, .. } => (position - point, 1.0),
    }
}

#[cfg(test)]
mod tests {
    use super::super::balls;
    use super::*;

    #[test]
    fn batches_are_the_same_for_a_seed_and_follow_from_the_camera() {
        let scene = balls(4).unwrap();
        let [camera, shadow, diffuse] = batches(&scene, 16, 1).unwrap();
        assert_eq!((camera.rays.len(), camera.any_hit, shadow.any_hit, diffuse.any_hit), (256, false, true, false));
        assert!(shadow.rays.len() > 100 && shadow.rays.len() == diffuse.rays.len());
        let origin = |ray: &TraceRay| (ray.origin_t_min.x, ray.origin_t_min.y, ray.origin_t_min.z);
        assert!(shadow.rays.iter().zip(&diffuse.rays).all(|(a, b)| origin(a) == origin(b)));
        assert_eq!(diffuse.rays, batches(&scene, 16, 1).unwrap()[2].rays);
        assert_ne!(diffuse.rays, batches(&scene, 16, 2).unwrap()[2].rays);
        assert!(batches(&scene, 12, 1).is_err() && batches(&scene, 1 << 17, 1).is_err());
    }

    #[test]
    fn where_the_camera_sees_nothing_there_are_camera_rays_alone() {
        let mut scene = balls(4).unwrap();
        let camera = scene.camera.as_mut().unwrap();
        camera.target = camera.eye * 2.0 - camera.target;
        assert_eq!(batches(&scene, 4, 1).unwrap().map(|batch| batch.rays.len()), [16, 0, 0]);
    }
}
