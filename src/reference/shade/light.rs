//! Twin of `cl/shade/light.cl`: direct light. The reasons are there.

#![allow(clippy::neg_cmp_op_on_partial_ord)] // `!(x >= 0)` is also true for NaN, and that is meant

use super::surface::Surface;
use crate::reference::shared::math::{
    clamp01, dot3, fma3, max_component, min_or, normalize3, power_fixed, scale_to_unit,
};
use crate::shared::constants::TOON_HIGHLIGHT;
use crate::shared::{LIGHT_DIRECTIONAL, LIGHT_SPOT, Light, MAX_RADIANCE, Material};
use glam::Vec3;

/// A light as seen from a point.
#[derive(Debug, Clone, Copy)]
pub struct LightSample {
    /// The light is at `to_light * t_far`.
    pub to_light: Vec3,
    /// `to_light`, unit.
    pub direction: Vec3,
    /// What arrives if nothing is in the way.
    pub radiance: Vec3,
    /// 1, or infinity for a directional light.
    pub t_far: f32,
}

/// Radiance limited to what the sum of a pixel's samples can hold.
#[inline(always)]
pub fn limit_radiance(radiance: Vec3) -> Vec3 {
    Vec3::new(min_or(MAX_RADIANCE, radiance.x), min_or(MAX_RADIANCE, radiance.y), min_or(MAX_RADIANCE, radiance.z))
}

/// The light as seen from `position`.
#[inline(always)]
pub fn sample_light(light: &Light, position: Vec3) -> LightSample {
    let mut radiance = light.intensity.xyz();
    if light.kind == LIGHT_DIRECTIONAL {
        let to_light = -light.direction.xyz();
        return LightSample { to_light, direction: to_light, radiance, t_far: f32::INFINITY };
    }
    let to_light = light.position.xyz() - position;
    let mut direction = Vec3::ZERO;
    if let Some((towards, scale)) = scale_to_unit(to_light) {
        let inv_length = 1.0 / dot3(towards, towards).sqrt();
        direction = towards * inv_length;
        if light.falloff_scale > 0.0 {
            let inv_distance = min_or(light.falloff_scale * scale * inv_length, f32::MAX);
            radiance = limit_radiance(radiance * inv_distance * inv_distance);
        }
    }
    if light.kind == LIGHT_SPOT {
        let cosine = -dot3(direction, light.direction.xyz());
        let edge = clamp01((cosine - light.cos_outer) / (light.cos_inner - light.cos_outer));
        radiance *= edge * edge * (3.0 - 2.0 * edge);
    }
    LightSample { to_light, direction, radiance, t_far: 1.0 }
}

/// The tone of threshold shading for a cosine.
#[inline(always)]
pub fn toon_tone(cosine: f32, steps: u32, threshold: f32) -> f32 {
    let above = (cosine - threshold) / (1.0 - threshold);
    if !(above >= 0.0) {
        return 0.0;
    }
    let count = steps as f32;
    let step = (above * count).floor() + 1.0;
    if step < count { step / count } else { 1.0 }
}

/// Light sent towards `-view_direction` for a light that is not in shadow.
#[inline(always)]
pub fn blinn_phong(
    surface: &Surface,
    material: &Material,
    diffuse: Vec3,
    view_direction: Vec3,
    sample: &LightSample,
) -> Vec3 {
    let cosine = dot3(surface.normal, sample.direction);
    let is_lifted = surface.lift != Vec3::ZERO;
    if !(cosine > 0.0 && (is_lifted || dot3(surface.geometric_normal, sample.direction) > 0.0)) {
        return Vec3::ZERO;
    }
    let toon = material.toon_steps > 0;
    let tone = if toon { toon_tone(cosine, material.toon_steps, material.toon_threshold) } else { cosine };
    let mut reflected = diffuse * tone;
    let specular = material.specular_shininess.xyz();
    if max_component(specular) > 0.0 {
        let halfway = normalize3(sample.direction - view_direction, surface.normal);
        let mut highlight = power_fixed(clamp01(dot3(surface.normal, halfway)), material.specular_shininess.w);
        if toon {
            highlight = if highlight >= TOON_HIGHLIGHT { 1.0 } else { 0.0 };
        }
        reflected = fma3(specular, highlight, reflected);
    }
    limit_radiance(reflected * sample.radiance)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tones_rise_at_their_thresholds() {
        // Even thresholds of two steps: a third each of dark, half and full.
        for (cosine, tone) in [(0.0, 0.0), (0.33, 0.0), (0.34, 0.5), (0.66, 0.5), (0.67, 1.0), (1.0, 1.0)] {
            assert_eq!(toon_tone(cosine, 2, 1.0 / 3.0), tone, "{cosine}");
        }
        // A threshold is reached where the cosine equals it, in numbers without rounding.
        for (cosine, tone) in [(0.25f32.next_down(), 0.0), (0.25, 1.0), (1.0, 1.0)] {
            assert_eq!(toon_tone(cosine, 1, 0.25), tone, "{cosine}");
        }
        assert_eq!([0.0, 0.5, 1.0f32.next_up()].map(|c| toon_tone(c, 2, 0.0)), [0.5, 1.0, 1.0]);
        for steps in 1..=255 {
            let tones: Vec<_> = (0..=4096).map(|i| toon_tone(i as f32 / 4096.0, steps, 0.125)).collect();
            assert!(tones.is_sorted() && tones[511] == 0.0 && tones[512] > 0.0 && tones[4096] == 1.0, "{steps}");
            let mut different = tones;
            different.dedup();
            assert_eq!(different.len(), steps as usize + 1);
        }
        assert_eq!(toon_tone(f32::NAN, 3, 0.5), 0.0);
    }
}
