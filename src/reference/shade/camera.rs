//! Twin of `cl/shade/camera.cl`: where the rays of a picture begin, and where they are counted. The reasons are there.

use super::footprint::RayCone;
use super::whitted::{PendingRay, RayKind};
use crate::reference::shared::math::{dot3, fma3};
use crate::reference::shared::ray::Ray;
use crate::shared::{COUNTERS, CameraSample, NO_PRIMITIVE, RenderParams};
use glam::Vec3;

/// Camera ray through the point (x, y) of the picture, in pixels from its upper left corner.
#[inline(always)]
pub fn camera_ray(params: &RenderParams, x: f32, y: f32) -> Ray {
    Ray::new(params.eye.xyz(), camera_direction(params, x, y), 0.0, f32::INFINITY, NO_PRIMITIVE)
}

/// Direction of that ray; its component along the view is 1.
#[inline(always)]
pub fn camera_direction(params: &RenderParams, x: f32, y: f32) -> Vec3 {
    let right = x.mul_add(params.pixel_width, -1.0);
    let up = (-y).mul_add(params.pixel_height, 1.0);
    fma3(params.right.xyz(), right, fma3(params.up.xyz(), up, params.forward.xyz()))
}

/// Where a pixel of the film lies in the picture, of which the film may be a part.
#[inline(always)]
fn place_in_picture(params: &RenderParams, (x, y): (usize, usize)) -> (usize, usize) {
    (x + (params.first_pixel & 0xffff) as usize, y + (params.first_pixel >> 16) as usize)
}

/// A ray's place in the picture, in pixels from the upper left corner: that of a pixel's sample, or of a list which has
/// this place in the film.
#[inline(always)]
pub fn camera_sample(
    params: &RenderParams,
    samples: &[CameraSample],
    (x, y): (usize, usize),
    sample: usize,
) -> CameraSample {
    if params.ray_count != 0 {
        return samples[y * params.width as usize + x];
    }
    let (x, y) = place_in_picture(params, (x, y));
    let at = samples[sample];
    CameraSample { x: x as f32 + at.x, y: y as f32 + at.y, ..at }
}

/// The camera ray through that place.
#[inline(always)]
pub fn first_of_path(params: &RenderParams, CameraSample { x, y, footprint }: CameraSample) -> PendingRay {
    let direction = camera_direction(params, x, y);
    PendingRay {
        ray: Ray::new(params.eye.xyz(), direction, 0.0, f32::INFINITY, NO_PRIMITIVE),
        weight: Vec3::ONE,
        depth: 1,
        kind: RayKind::Camera,
        cone: RayCone { width: 0.0, spread: footprint * params.pixel_size / dot3(direction, direction) },
    }
}

/// Counts a ray of this kind, and whether it hit.
#[inline(always)]
pub fn count_ray(counts: &mut [u32; COUNTERS], kind: RayKind, hit: bool) {
    counts[kind as usize] += 1;
    counts[kind as usize + 1] += u32::from(hit);
}
