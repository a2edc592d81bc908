//! Twin of `cl/shade/scene.cl`, whose arrays are those of [`SceneBuffers`] here: what a ray sees that misses all of
//! them.

use crate::pack::SceneBuffers;
use crate::reference::shared::math::{clamp01, dot3, fma3};
use glam::Vec3;

/// How far up unit `direction` leads, from 0 to 1. Without a sky the packed up is y, and the product y itself.
#[inline(always)]
pub fn height_of(buffers: &SceneBuffers, direction: Vec3) -> f32 {
    clamp01(0.5f32.mul_add(dot3(direction, buffers.params.sky_up.xyz()), 0.5))
}

/// The background's radiance in this direction.
#[inline(always)]
pub fn background(buffers: &SceneBuffers, direction: Vec3) -> Vec3 {
    let bottom = buffers.params.background_bottom.xyz();
    fma3(buffers.params.background_top.xyz() - bottom, height_of(buffers, direction), bottom)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::options::{StructureKind, TraceOptions};
    use crate::reference::shade::local_light::sky_light;
    use crate::scene::{Background, Scene, Sky};
    use glam::DVec3;

    const SKY: Sky =
        Sky { top: Vec3::new(0.9, 0.5, 0.25), bottom: Vec3::new(0.0, 0.5, 1.0), viewer: Vec3::X, up: Vec3::ONE };

    fn buffers(sky: Option<Sky>) -> SceneBuffers {
        let background = Background { bottom: Vec3::new(1.0, 0.25, 0.0), top: Vec3::new(0.0, 0.5, 1.0) };
        SceneBuffers::new(&Scene { sky, background, ..Scene::default() }, &TraceOptions::of(StructureKind::Brute))
            .unwrap()
    }

    /// The mean of what is seen from a plane with this normal of the halves above and below, weighted by the cosine, in
    /// f64: over rings around the normal.
    fn mean_of_halves(normal: DVec3, up: DVec3) -> [f64; 3] {
        const STEPS: usize = 400;
        let (across, along) = normal.any_orthonormal_pair();
        let mut above = 0.0;
        for i in 0..STEPS {
            // Of the same weight each: the square of the sine is even in 0 to 1.
            let sine = ((i as f64 + 0.5) / STEPS as f64).sqrt();
            let ring = |j: usize| {
                let (y, x) = (std::f64::consts::TAU * (j as f64 + 0.5) / STEPS as f64).sin_cos();
                (across * x + along * y) * sine + normal * (1.0 - sine * sine).sqrt()
            };
            above += (0..STEPS).filter(|&j| ring(j).dot(up) > 0.0).count() as f64 / (STEPS * STEPS) as f64;
        }
        (SKY.bottom.as_dvec3().lerp(SKY.top.as_dvec3(), above)).to_array()
    }

    #[test]
    fn a_surface_gets_the_mean_of_sky_and_ground() {
        let buffers = buffers(Some(SKY));
        let up = DVec3::ONE.normalize();
        for normal in [up, -up, up.any_orthonormal_vector(), DVec3::X, DVec3::new(0.6, -0.8, 0.0)] {
            // Seen along its plane, where the viewer gives nothing.
            let light = sky_light(&buffers, normal.as_vec3(), normal.any_orthonormal_vector().as_vec3());
            let expected = mean_of_halves(normal, up);
            for (light, expected) in light.to_array().into_iter().zip(expected) {
                assert!((f64::from(light) - expected).abs() < 2e-3, "{normal}: {light} {expected}");
            }
        }
    }

    #[test]
    fn the_viewer_gives_light_by_the_cosine() {
        let buffers = buffers(Some(Sky { top: Vec3::ZERO, bottom: Vec3::ZERO, ..SKY }));
        for (cosine, light) in [(1.0, 1.0), (0.5, 0.5), (0.0, 0.0), (-1.0, 0.0)] {
            let direction = Vec3::new(f32::sqrt(1.0 - cosine * cosine), 0.0, -cosine);
            assert_eq!(sky_light(&buffers, Vec3::Z, direction), Vec3::X * light);
        }
    }

    #[test]
    fn the_background_leads_evenly_from_below_to_above() {
        let (plain, tilted) = (buffers(None), buffers(Some(SKY)));
        let (bottom, top) = (Vec3::new(1.0, 0.25, 0.0), Vec3::new(0.0, 0.5, 1.0));
        for i in 0..=64 {
            let cosine = i as f32 / 32.0 - 1.0;
            let share = (1.0 + cosine) / 2.0;
            let sine = (1.0 - cosine * cosine).sqrt();
            assert_eq!(background(&plain, Vec3::new(0.0, cosine, sine)), bottom + (top - bottom) * share);
            let (up, aside) = (Vec3::ONE.normalize(), Vec3::new(1.0, -1.0, 0.0).normalize());
            let colour = background(&tilted, up * cosine + aside * sine);
            assert!((colour - (bottom + (top - bottom) * share)).abs().max_element() < 1e-6, "{cosine}");
        }
    }

    /// Kernels of other scenes read y alone.
    #[test]
    fn without_a_sky_up_is_y_to_the_bit() {
        let buffers = buffers(None);
        let mut random = crate::random::Random::new(20_081_121);
        for _ in 0..10_000 {
            let direction = random.direction();
            assert_eq!(height_of(&buffers, direction), clamp01(0.5f32.mul_add(direction.y, 0.5)));
            assert_eq!(sky_light(&buffers, direction, direction), Vec3::ZERO);
        }
    }
}
