//! Where light goes at the border of two media, and how much of it: Snell's law and Fresnel's equations for unpolarised
//! light (Born and Wolf, "Principles of Optics", section 1.5).

use super::trial::Trial;
use glam::DVec3;

/// What happens at a border.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Refraction {
    /// Share of the light that is reflected.
    pub reflectance: f64,
    /// Where the rest goes, unit; `None` where all of it is reflected.
    pub direction: Option<DVec3>,
}

/// A ray along unit `direction` meets a surface whose unit `normal` is on the ray's side. `eta`: the index of
/// refraction on that side divided by the one beyond.
pub fn refract(direction: DVec3, normal: DVec3, eta: f64, trial: &mut Trial) -> Refraction {
    if eta == 1.0 {
        return Refraction { reflectance: 0.0, direction: Some(direction) };
    }
    // An error of each dot product of unit vectors.
    let cos_in = trial.near(-normal.dot(direction), 1.0, 4.0).clamp(0.0, 1.0);
    // The part of the ray along the surface: its length is the sine.
    let along = direction + normal * cos_in;
    let sin_out = trial.number(eta * along.length(), 5.0);
    // Infinity times 0 is NaN: such an index reflects everything.
    let is_total = sin_out.is_nan() || sin_out >= 1.0;
    trial.decide(u32::from(is_total));
    if is_total {
        return Refraction { reflectance: 1.0, direction: None };
    }
    let cos_out = trial.near(1.0 - sin_out * sin_out, 1.0, 2.0).max(0.0).sqrt();
    // The amplitudes of light that swings at a right angle to the plane of incidence and in it; the indices of
    // refraction are as eta to 1.
    let across = (eta * cos_in - cos_out) / (eta * cos_in + cos_out);
    let within = (eta * cos_out - cos_in) / (eta * cos_out + cos_in);
    let reflectance = (across * across + within * within) / 2.0;
    let direction = trial.vector(along * eta - normal * cos_out, 4.0);
    // 0 / 0 where the ray grazes the surface.
    let reflectance = if reflectance < 1.0 { trial.near(reflectance, 1.0, 8.0).clamp(0.0, 1.0) } else { 1.0 };
    Refraction { reflectance, direction: Some(direction) }
}

/// A mirrored at the plane of unit `normal`.
pub fn reflect(direction: DVec3, normal: DVec3) -> DVec3 {
    direction - normal * (2.0 * normal.dot(direction))
}

#[cfg(test)]
mod tests {
    use super::*;
    use approx::assert_relative_eq;

    /// A ray that meets the plane z = 0 from above at `degrees` from its normal.
    fn at_angle(degrees: f64) -> DVec3 {
        let angle = degrees.to_radians();
        DVec3::new(angle.sin(), 0.0, -angle.cos())
    }

    fn into(degrees: f64, eta: f64) -> Refraction {
        refract(at_angle(degrees), DVec3::Z, eta, &mut Trial::exact())
    }

    #[test]
    fn the_sines_are_as_the_indices() {
        for degrees in [0.0, 10.0, 45.0, 80.0, 89.9] {
            let direction = into(degrees, 1.0 / 1.5).direction.unwrap();
            let sine = direction.x / direction.length();
            assert_relative_eq!(sine, degrees.to_radians().sin() / 1.5, epsilon = 1e-14, max_relative = 1e-14);
            assert_relative_eq!(direction.length(), 1.0, max_relative = 1e-14);
            assert!(direction.z < 0.0);
        }
    }

    #[test]
    fn beyond_the_critical_angle_all_is_reflected() {
        let critical = (1.0f64 / 1.5).asin().to_degrees();
        assert!(into(critical - 1e-6, 1.5).direction.is_some());
        assert_eq!(into(critical + 1e-6, 1.5), Refraction { reflectance: 1.0, direction: None });
    }

    #[test]
    fn shares_are_those_of_textbooks() {
        // Straight on: ((n - 1) / (n + 1))^2, from either side.
        assert_relative_eq!(into(0.0, 1.0 / 1.5).reflectance, 0.04, max_relative = 1e-13);
        assert_relative_eq!(into(0.0, 1.5).reflectance, 0.04, max_relative = 1e-13);
        // At Brewster's angle only light across the plane of incidence: ((n^2 - 1) / (n^2 + 1))^2 / 2.
        let brewster = 1.5f64.atan().to_degrees();
        assert_relative_eq!(
            into(brewster, 1.0 / 1.5).reflectance,
            (1.25f64 / 3.25).powi(2) / 2.0,
            max_relative = 1e-12
        );
        assert!(into(89.999, 1.0 / 1.5).reflectance > 0.999);
        // The same index: nothing happens, whatever the angle.
        assert_eq!(into(70.0, 1.0), Refraction { reflectance: 0.0, direction: Some(at_angle(70.0)) });
    }

    #[test]
    fn a_mirror_turns_what_is_across_it() {
        assert_relative_eq!(
            (reflect(at_angle(30.0), DVec3::Z) - DVec3::new(0.5, 0.0, 0.75f64.sqrt())).length(),
            0.0,
            epsilon = 1e-15
        );
    }
}
