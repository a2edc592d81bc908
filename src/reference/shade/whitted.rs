//! Twin of `cl/shade/whitted.cl`: reflection and refraction. The reasons are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x < 1)` is also true for NaN, and that is meant

use super::footprint::RayCone;
use super::roulette::Killing;
use super::surface::{Surface, leave_surface};
use crate::reference::shared::math::{clamp01, dot3, fma3};
use crate::reference::shared::ray::Ray;
use crate::shared::Material;
use glam::Vec3;

#[inline(always)]
fn keep_side(direction: Vec3, normal: Vec3) -> Vec3 {
    let height = dot3(direction, normal);
    if height < 0.0 { fma3(normal, -2.0 * height, direction) } else { direction }
}

/// The mirrored direction.
#[inline(always)]
pub fn reflect_direction(surface: &Surface, direction: Vec3) -> Vec3 {
    let reflected = fma3(surface.normal, -2.0 * dot3(surface.normal, direction), direction);
    keep_side(reflected, surface.geometric_normal)
}

/// What becomes of a ray at a dielectric surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refraction {
    /// 1: total reflection.
    pub reflectance: f32,
    /// Direction of the refracted ray.
    pub direction: Vec3,
}

/// Snell's law and Fresnel's reflectance.
#[inline(always)]
pub fn refract_direction(surface: &Surface, direction: Vec3, eta: f32) -> Refraction {
    if eta == 1.0 {
        return Refraction { reflectance: 0.0, direction };
    }
    let cos_in = clamp01(-dot3(surface.normal, direction));
    let along = fma3(surface.normal, cos_in, direction);
    let sin2_out = eta * eta * dot3(along, along);
    if !(sin2_out < 1.0) {
        return Refraction { reflectance: 1.0, direction };
    }
    let cos_out = (1.0 - sin2_out).sqrt();
    let s = eta.mul_add(cos_in, -cos_out) / eta.mul_add(cos_in, cos_out);
    let p = eta.mul_add(cos_out, -cos_in) / eta.mul_add(cos_out, cos_in);
    let reflectance = 0.5 * s.mul_add(s, p * p);
    Refraction {
        reflectance: if reflectance < 1.0 { reflectance } else { 1.0 },
        direction: keep_side(fma3(surface.normal, -cos_out, along * eta), -surface.geometric_normal),
    }
}

/// What a ray is for; the values index the counters.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(usize)]
pub enum RayKind {
    /// From the eye.
    Camera = 0,
    /// Towards a light.
    Shadow = 2,
    /// Mirrored.
    Reflected = 4,
    /// Refracted.
    Refracted = 6,
}

/// A ray that waits to be traced.
#[derive(Debug, Clone, Copy)]
pub struct PendingRay {
    /// The ray.
    pub ray: Ray,
    /// What a unit of its radiance adds to the pixel.
    pub weight: Vec3,
    /// 1 for a camera ray; see [`Killing::next_depth`].
    pub depth: u32,
    /// What it is for.
    pub kind: RayKind,
    /// What it stands for.
    pub cone: RayCone,
}

/// Puts the rays that leave the surface on the stack of pending ones.
#[inline(always)]
pub fn push_secondary_rays(
    surface: &Surface,
    material: &Material,
    pending: &PendingRay,
    direction: Vec3,
    killing: &Killing,
    stack: &mut Vec<PendingRay>,
) {
    let cone = pending.cone.at(pending.ray.origin, surface.point.position);
    let mut push = |weight: Vec3, direction: Vec3, kind: RayKind| {
        let ray = leave_surface(&surface.point, direction, f32::INFINITY);
        stack.push(PendingRay { ray, weight, depth: killing.next_depth(pending.depth, kind), kind, cone });
    };
    let mut reflected_weight = pending.weight * material.mirror.xyz();
    if material.transparent != 0 {
        let ior = material.transmission_ior.w;
        let refraction = refract_direction(surface, direction, if surface.front { 1.0 / ior } else { ior });
        reflected_weight = pending.weight * refraction.reflectance;
        let weight = pending.weight * material.transmission_ior.xyz() * (1.0 - refraction.reflectance);
        if let Some(weight) = killing.survives(pending.depth, RayKind::Refracted, weight) {
            push(weight, refraction.direction, RayKind::Refracted);
        }
    }
    if let Some(weight) = killing.survives(pending.depth, RayKind::Reflected, reflected_weight) {
        push(weight, reflect_direction(surface, direction), RayKind::Reflected);
    }
}

#[cfg(test)]
mod tests {
    use super::super::surface::SurfacePoint;
    use super::*;
    use crate::shared::{CameraSample, RenderParams};

    #[test]
    fn cones_go_on_where_rays_leave() {
        let point = SurfacePoint {
            position: Vec3::new(0.0, 0.0, 2.0),
            position_low: Vec3::ZERO,
            weights: Vec3::ZERO,
            error: 0.0,
            primitive: 0,
        };
        let surface = Surface {
            point,
            geometric_normal: Vec3::NEG_Z,
            normal: Vec3::NEG_Z,
            lift: Vec3::ZERO,
            largest_coordinate: 2.0,
            texture_uv: [0.0; 2],
            material: 0,
            front: true,
        };
        let transmission_ior = crate::layout::Float4::new(Vec3::ONE, 1.5);
        let material = Material { transmission_ior, transparent: 1, ..Material::default() };
        let ray = Ray::new(Vec3::ZERO, Vec3::Z, 0.0, f32::INFINITY, crate::shared::NO_PRIMITIVE);
        let cone = RayCone { width: 0.5, spread: 0.25 };
        let pending = PendingRay { ray, weight: Vec3::ONE, depth: 1, kind: RayKind::Camera, cone };
        let mut stack = Vec::new();
        let (params, at) = (RenderParams::default(), CameraSample::default());
        push_secondary_rays(&surface, &material, &pending, Vec3::Z, &Killing::of_path(&params, at), &mut stack);
        assert_eq!(stack.len(), 2, "refracted and reflected");
        assert!(stack.iter().all(|next| next.cone == RayCone { width: 1.0, spread: 0.25 }), "{stack:?}");
    }
}
