//! What arrives from a light, and what a matt surface with highlights makes of it: Lambert's cosine, Blinn's highlight
//! ("Models of Light Reflection for Computer Synthesized Pictures", SIGGRAPH 1977), or a few tones of them.

use super::surface::Surface;
use super::trial::{EPSILON, Trial};
use glam::DVec3;
use raybrook::low_level::scene::{Falloff, Light, LightKind, Material, Toon};
use raybrook::low_level::shared::MAX_RADIANCE;

/// A light as a point sees it.
#[derive(Debug, Clone, Copy)]
pub struct Arriving {
    /// The light is at this times `t_max` from the point.
    pub to_light: DVec3,
    /// 1, or infinite for a directional light.
    pub t_max: f64,
    /// Unit; zero in the light's very place.
    pub direction: DVec3,
    /// What arrives where nothing is in the way.
    pub radiance: DVec3,
}

/// What is brighter than that counts as that.
pub fn limited(radiance: DVec3) -> DVec3 {
    radiance.min(DVec3::splat(MAX_RADIANCE.into()))
}

/// `light` as it is seen from `position`.
pub fn arriving(light: &Light, position: DVec3, trial: &mut Trial) -> Arriving {
    let intensity = light.intensity.as_dvec3();
    let (place, axis) = match light.kind {
        LightKind::Directional { direction } => {
            let to_light = trial.vector(-unit(direction.as_dvec3()), 1.0);
            return Arriving { to_light, t_max: f64::INFINITY, direction: to_light, radiance: intensity };
        }
        LightKind::Point { position } => (position.as_dvec3(), None),
        LightKind::Spot { position, direction, inner_degrees, outer_degrees } => {
            (position.as_dvec3(), Some((direction.as_dvec3(), inner_degrees, outer_degrees)))
        }
    };
    let to_light = trial.vector(place - position, 1.0);
    let distance = to_light.length();
    let direction = trial.vector(unit(to_light), 3.0);
    let mut radiance = intensity;
    if light.falloff == Falloff::Quadratic && distance > 0.0 {
        radiance = limited(radiance / trial.number(distance * distance, 8.0));
    }
    if let Some((axis, inner, outer)) = axis {
        radiance *= in_cone(-trial.near(direction.dot(unit(axis)), 1.0, 5.0), inner, outer, trial);
    }
    Arriving { to_light, t_max: 1.0, direction, radiance }
}

fn unit(v: DVec3) -> DVec3 {
    v.normalize_or_zero()
}

/// The share of a spot light that goes into a direction: Hermite's smooth step of the cosine between those of the two
/// angles.
fn in_cone(cosine: f64, inner_degrees: f32, outer_degrees: f32, trial: &mut Trial) -> f64 {
    // An angle in float32 is off by two roundings of itself, which its sine, not above 1, brings into the cosine.
    let mut cosine_of = |degrees: f32| {
        let angle = f64::from(degrees).to_radians();
        trial.near(angle.cos(), 1.0, 1.0 + 2.0 * angle * angle.sin())
    };
    let (inner, outer) = (cosine_of(inner_degrees), cosine_of(outer_degrees));
    // A hard edge is one float wide.
    let width = (inner - outer).max(EPSILON * outer);
    let share = ((cosine - outer) / width).clamp(0.0, 1.0);
    share * share * (3.0 - 2.0 * share)
}

/// The tone of threshold shading for a cosine.
fn tone(cosine: f64, toon: Toon, trial: &mut Trial) -> f64 {
    let threshold = f64::from(toon.threshold);
    let steps = f64::from(toon.steps);
    let above = trial.near((cosine - threshold) / (1.0 - threshold), 1.0 / (1.0 - threshold), 4.0);
    let tone = if above < 0.0 { 0.0 } else { (trial.number(above * steps, 1.0).floor() + 1.0).min(steps) };
    trial.decide(tone as u32);
    tone / steps
}

/// The light that a surface of this `diffuse` colour sends back along unit `view`, towards which the viewer looks.
pub fn reflected(
    surface: &Surface,
    material: &Material,
    diffuse: DVec3,
    view: DVec3,
    light: &Arriving,
    trial: &mut Trial,
) -> DVec3 {
    let mut cosine_to = |normal: DVec3| trial.near(normal.dot(light.direction), 1.0, 4.0);
    let (cosine, geometric) = (cosine_to(surface.normal), cosine_to(surface.geometric_normal));
    let is_lit = cosine > 0.0 && (surface.is_lifted() || geometric > 0.0);
    trial.decide(u32::from(is_lit));
    if !is_lit {
        return DVec3::ZERO;
    }
    let mut sent = diffuse * material.toon.map_or(cosine, |toon| tone(cosine, toon, trial));
    if material.specular.max_element() > 0.0 {
        sent += material.specular.as_dvec3() * highlight(surface, material, view, light, trial);
    }
    limited(sent * light.radiance)
}

/// The strength of the highlight.
fn highlight(surface: &Surface, material: &Material, view: DVec3, light: &Arriving, trial: &mut Trial) -> f64 {
    /// A cartoon's highlight is where the smooth one has this strength.
    const RIM: f64 = 0.5;
    let halfway = trial.moved(light.direction - view, 4.0 * EPSILON);
    let halfway = halfway.try_normalize().unwrap_or(surface.normal);
    let cosine = trial.near(surface.normal.dot(halfway), 1.0, 5.0).clamp(0.0, 1.0);
    let power = cosine.powf(material.shininess.into());
    // Powers are within 2^-22 (1 + |ln result|), and nothing below the smallest float.
    let smallest = f64::from(f32::MIN_POSITIVE);
    let power = power + trial.error(4.0 * EPSILON * power * (1.0 + power.max(smallest).ln().abs()) + smallest);
    if material.toon.is_none() {
        return power.clamp(0.0, 1.0);
    }
    trial.decide(u32::from(power >= RIM));
    if power >= RIM { 1.0 } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;
    use glam::Vec3;

    /// A surface that faces up at the origin.
    fn floor() -> Surface {
        Surface::flat(DVec3::ZERO, DVec3::Y)
    }

    /// What a floor sends to a viewer straight above it, of light that arrives at `degrees` from above.
    fn seen(material: &Material, degrees: f64) -> f64 {
        let angle = degrees.to_radians();
        let light = Light::directional(-DVec3::new(angle.sin(), angle.cos(), 0.0).as_vec3(), Vec3::ONE);
        let mut trial = Trial::exact();
        let light = arriving(&light, DVec3::ZERO, &mut trial);
        reflected(&floor(), material, material.diffuse.as_dvec3(), DVec3::NEG_Y, &light, &mut trial).x
    }

    #[test]
    fn matt_surfaces_follow_lamberts_cosine() {
        let matt = Material::matt(Vec3::splat(0.5));
        for degrees in [0.0f64, 30.0, 60.0, 89.0] {
            assert_relative_eq!(seen(&matt, degrees), 0.5 * degrees.to_radians().cos(), max_relative = 1e-6);
        }
        assert_eq!(seen(&matt, 91.0), 0.0);
    }

    #[test]
    fn highlights_are_powers_of_half_the_angle() {
        let shiny = Material { specular: Vec3::ONE, shininess: 20.0, diffuse: Vec3::ZERO, ..Material::default() };
        for degrees in [0.0f64, 20.0, 70.0] {
            let expected = (degrees / 2.0).to_radians().cos().powf(20.0);
            assert_relative_eq!(seen(&shiny, degrees), expected, max_relative = 1e-6);
        }
    }

    #[test]
    fn cartoons_have_few_tones() {
        let toon = Material { toon: Some(Toon { steps: 2, threshold: 0.5 }), ..Material::matt(Vec3::ONE) };
        for (cosine, tone) in [(0.49f64, 0.0), (0.51, 0.5), (0.74, 0.5), (0.76, 1.0), (1.0, 1.0)] {
            assert_eq!(seen(&toon, cosine.acos().to_degrees()), tone, "{cosine}");
        }
    }

    #[test]
    fn spots_and_distance() {
        let kind = LightKind::Spot {
            position: Vec3::new(0.0, 2.0, 0.0),
            direction: Vec3::NEG_Y,
            inner_degrees: 10.0,
            outer_degrees: 40.0,
        };
        let light = Light { kind, intensity: Vec3::splat(8.0), falloff: Falloff::Quadratic };
        let at = |x: f64| arriving(&light, DVec3::new(x, 0.0, 0.0), &mut Trial::exact()).radiance.x;
        assert_relative_eq!(at(0.0), 2.0, max_relative = 1e-12); // 8 / 2^2, in the inner cone
        assert_eq!(at(2.0), 0.0); // 45 degrees
        let cosine = |degrees: f64| degrees.to_radians().cos();
        let share = (cosine(25.0) - cosine(40.0)) / (cosine(10.0) - cosine(40.0));
        let x = 2.0 * 25f64.to_radians().tan();
        assert_relative_eq!(at(x), 8.0 / (4.0 + x * x) * share * share * (3.0 - 2.0 * share), max_relative = 1e-12);
    }
}
