//! The light of a scene that has none: what pictures add to it.
//!
//! A studio has three sources: the key, a lamp beside the camera that casts shadows; the fill, here at the camera
//! itself, where it sees all that is seen and needs no shadow rays; and a soft sky, whose light depends on the normal
//! alone. By the last two every side shows its form where the key does not reach: two normals on the same side of the
//! picture's middle never have the same cosines with both up and the viewer. There is no lamp behind the model: it
//! would cost a shadow ray where it shines, to part dark outlines from a dark background, and this one is light.
//!
//! The key goes with the camera, and the rest stays as it is. In a room, whose walls would keep the key out, a lamp
//! hangs under the ceiling, left of the middle and nearer to the camera: at the camera it would light back wall and
//! furniture alike, and cast no shadow that is seen. It stays there when the camera moves.

use super::{Background, Camera, Light, Placed, Scene, Sky};
use crate::names::names;
use glam::Vec3;

names! {
    /// The light that pictures add to a scene that has none.
    pub enum DefaultLight ("default-light") {
        /// A lamp above the camera's left shoulder, light from the viewer and from a sky, and a light background.
        Studio = "studio",
        /// The lamp alone, with a little light from everywhere, and the dark background of scenes with lights.
        Plain = "plain",
    }
}

#[allow(clippy::derivable_impls)] // the macro derives none
impl Default for DefaultLight {
    fn default() -> Self {
        DefaultLight::Studio
    }
}

/// The studio's key, fill and sky, from straight down to straight up. A white matt surface sends 0.9 of white where it
/// is lightest, so that none is burnt out; and in the key's shadow 0.28 to 0.07, by the way that it faces.
const KEY: f32 = 0.65;
const FILL: f32 = 0.09;
const SKY: (f32, f32) = (0.07, 0.22);

/// The studio's background. The usual view sees 0.7 to 0.82 of it: lighter than the outlines of a white surface, which
/// the fill does not reach, and far from those of dark ones.
const BACKGROUND: (f32, f32) = (0.62, 1.0);

/// The plain lamp, and the light from everywhere beside it.
const PLAIN_KEY: f32 = 0.9;
const PLAIN_AMBIENT: f32 = 0.15;

impl DefaultLight {
    /// The lamp of a picture from `camera`: directional, from above its left shoulder; of one inside of a room, where a
    /// lamp hangs at `room_lamp`, there, and with plain light at the camera.
    pub fn lamp(self, camera: &Camera, room_lamp: Option<Vec3>) -> Light {
        let intensity = Vec3::splat(match self {
            DefaultLight::Studio => KEY,
            DefaultLight::Plain => PLAIN_KEY,
        });
        if let Some(place) = room_lamp {
            let is_plain = self == DefaultLight::Plain;
            return Light::point(if is_plain { camera.eye } else { place }, intensity);
        }
        let forward = (camera.target - camera.eye).normalize_or(Vec3::NEG_Z);
        let right = forward.cross(camera.up).normalize_or(Vec3::X);
        let up = right.cross(forward);
        Light::directional(forward * 0.8 - up * 0.6 + right * 0.45, intensity)
    }

    /// The sky of pictures in whose world `up` is up.
    pub(crate) fn sky(self, up: Vec3) -> Option<Sky> {
        let (bottom, top) = SKY;
        let sky = Sky { top: Vec3::splat(top), bottom: Vec3::splat(bottom), viewer: Vec3::splat(FILL), up };
        (self == DefaultLight::Studio).then_some(sky)
    }
}

impl Scene {
    /// Whether it has a light or a sky of its own, so that pictures add none.
    pub fn has_light(&self) -> bool {
        !self.lights.is_empty() || self.sky.is_some()
    }

    /// Adds the light of a scene that has none, for a picture from the camera as it was placed.
    pub(crate) fn add_default_light(&mut self, placed: &Placed) {
        self.lights.push(placed.lamp(self.default_light));
        self.sky = placed.sky(self.default_light);
        if self.default_light == DefaultLight::Plain || self.has_unlit_material() {
            self.ambient = self.ambient.max(Vec3::splat(PLAIN_AMBIENT));
        }
        let has_background = self.has_background || self.background != Background::default();
        if self.default_light == DefaultLight::Studio && !has_background {
            let (bottom, top) = BACKGROUND;
            self.background = Background { bottom: Vec3::splat(bottom), top: Vec3::splat(top) };
        }
    }

    /// Whether a material that triangles have answers to ambient light and to no other.
    fn has_unlit_material(&self) -> bool {
        let materials = self.used_materials().into_iter().map(|id| &self.materials[id as usize]);
        materials.into_iter().any(|m| m.diffuse == Vec3::ZERO && m.ambient != Vec3::ZERO)
    }
}

impl Placed {
    /// The lamp that [`DefaultLight::lamp`] adds to a picture from this camera.
    pub fn lamp(&self, light: DefaultLight) -> Light {
        light.lamp(&self.camera, self.room_lamp())
    }

    /// The sky that is added to it.
    pub(crate) fn sky(&self, light: DefaultLight) -> Option<Sky> {
        light.sky(self.sky_up())
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Aim, Builder, LightKind, Material, Viewpoint};
    use super::*;
    use crate::renderer::complete_as;

    fn ball(change: impl Fn(&mut Builder)) -> Scene {
        let mut builder = Builder::new();
        builder.sphere(1.0, 8);
        change(&mut builder);
        builder.finish().unwrap()
    }

    fn completed(mut scene: Scene, aim: Aim) -> Scene {
        complete_as(&mut scene, 1.5, &aim);
        scene
    }

    #[test]
    fn scenes_with_light_of_their_own_get_none() {
        let lamp = Light::point(Vec3::Y * 9.0, Vec3::ONE);
        let black = Light::point(Vec3::Y * 9.0, Vec3::ZERO);
        let sky = Sky { top: Vec3::X, ..Sky::default() };
        for (lights, sky) in [(vec![lamp], None), (vec![black], None), (vec![], Some(sky))] {
            let scene = completed(Scene { lights: lights.clone(), sky, ..ball(|_| ()) }, Aim::default());
            assert_eq!((scene.lights, scene.sky), (lights, sky));
            assert_eq!((scene.background, scene.ambient), (Background::default(), Vec3::ZERO));
        }
    }

    #[test]
    fn the_studio_burns_nothing_out_and_leaves_nothing_black_or_flat() {
        let scene = completed(ball(|_| ()), Aim::default());
        let (camera, sky) = (scene.camera.unwrap(), scene.sky.unwrap());
        let to_viewer = (camera.eye - camera.target).normalize();
        let LightKind::Directional { direction } = scene.lights[0].kind else { panic!("{:?}", scene.lights) };
        let to_lamp = -direction.normalize();
        // On a white matt surface: by the lamp, and by all else.
        let light = |normal: Vec3| {
            let height = (1.0 + normal.dot(sky.up)) / 2.0;
            let soft = sky.bottom.lerp(sky.top, height) + sky.viewer * normal.dot(to_viewer).max(0.0);
            (scene.lights[0].intensity.x * normal.dot(to_lamp).max(0.0), soft.x)
        };
        let mut random = crate::random::Random::new(20_081_121);
        let seen = (0..10_000).map(|_| random.direction()).filter(|normal| normal.dot(to_viewer) > 0.0);
        let all: Vec<_> = seen.map(light).collect();
        let most = all.iter().map(|(key, soft)| key + soft).fold(0.0, f32::max);
        assert!((0.85..=0.95).contains(&most), "{most}");
        let softest = all.iter().map(|(_, soft)| *soft).fold(f32::INFINITY, f32::min);
        assert!(softest > 0.07, "{softest}");
        // In the lamp's shadow sides still differ by this factor.
        let lightest = all.iter().map(|(_, soft)| *soft).fold(0.0, f32::max);
        assert!(lightest > 2.5 * softest, "{lightest} {softest}");
        assert!(scene.background.bottom.x < scene.background.top.x && scene.background.top.x <= 1.0);
    }

    #[test]
    fn the_sky_is_where_up_is() {
        let up_of = |scene: Scene, aim: Aim| completed(scene, aim).sky.unwrap().up;
        assert_eq!(up_of(ball(|_| ()), Aim::default()), Vec3::Y);
        let on_z = || Scene { up: Some(Vec3::Z), ..ball(|_| ()) };
        assert_eq!(up_of(on_z(), Aim::default()), Vec3::Z);
        assert_eq!(up_of(on_z(), Aim { viewpoint: Some(Viewpoint::Top), ..Aim::default() }), Vec3::Z);
        assert_eq!(up_of(on_z(), Aim { up: Some(Vec3::NEG_X), ..Aim::default() }), Vec3::NEG_X);
        let from_above = Aim { eye: Some(Vec3::Y * 5.0), target: Some(Vec3::ZERO), ..Aim::default() };
        assert_eq!(up_of(ball(|_| ()), from_above), Vec3::Y, "though the picture's up is another");
    }

    #[test]
    fn inside_the_lamp_hangs_above_on_the_left_or_is_at_the_camera_where_light_is_plain() {
        let inside = Aim { viewpoint: Some(Viewpoint::Inside), ..Aim::default() };
        let LightKind::Point { position } = completed(ball(|_| ()), inside).lights[0].kind else { panic!() };
        // The camera is in the middle of the ball and looks along x or -z.
        assert!((0.5..0.7).contains(&position.y), "{position}");
        assert!((position * Vec3::new(1.0, 0.0, 1.0)).length() > 0.3, "{position}");
        let plain = completed(ball(|b| _ = b.default_light(DefaultLight::Plain)), inside);
        assert_eq!(plain.lights[0].kind, LightKind::Point { position: plain.camera.unwrap().eye });
    }

    #[test]
    fn a_background_that_was_given_stays() {
        for given in [Background::default(), Background { bottom: Vec3::ZERO, top: Vec3::ZERO }] {
            let scene = completed(ball(|b| _ = b.background(given)), Aim::default());
            assert_eq!(scene.background, given);
        }
        let by_hand = Scene { background: Background { bottom: Vec3::X, top: Vec3::X }, ..ball(|_| ()) };
        assert_eq!(completed(by_hand, Aim::default()).background.top, Vec3::X);
    }

    #[test]
    fn plain_light_is_a_lamp_and_a_little_from_everywhere() {
        let scene = completed(ball(|b| _ = b.default_light(DefaultLight::Plain)), Aim::default());
        assert_eq!((scene.sky, scene.background, scene.ambient), (None, Background::default(), Vec3::splat(0.15)));
        assert_eq!((scene.lights.len(), scene.lights[0].intensity), (1, Vec3::splat(0.9)));
    }

    #[test]
    fn surfaces_of_ambient_colour_alone_have_ambient_light() {
        let material = |ambient, diffuse| Material { ambient, diffuse, ..Material::default() };
        for (ambient, diffuse, light) in
            [(Vec3::ONE, Vec3::ZERO, 0.15), (Vec3::ZERO, Vec3::ZERO, 0.0), (Vec3::ZERO, Vec3::ONE, 0.0)]
        {
            let mut scene = ball(|_| ());
            scene.materials[0] = material(ambient, diffuse);
            assert_eq!(completed(scene, Aim::default()).ambient, Vec3::splat(light), "{ambient} {diffuse}");
        }
    }
}
