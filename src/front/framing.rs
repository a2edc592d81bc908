//! A camera and light for scenes that have none: before the structure is built, and after the scene itself is
//! gone.

use crate::pack::SceneBuffers;
use crate::parallel;
use crate::renderer::complete_as;
use crate::scene::{Aim, Camera, DefaultLight, DropReason, Framed, Framing, Scene, up_by_shape};
use glam::Vec3;
use std::borrow::Cow;

/// A scene that has a light.
pub(super) struct LitScene<'a> {
    /// A copy, for as long as the structure is built, where the scene has no light of its own.
    pub scene: Cow<'a, Scene>,
    /// The camera that frames it in pictures of the aspect, where there is none and the light needed one.
    pub framed: Option<(Framing, Framed)>,
    /// Which way is up, where that is known without asking for the shape again.
    pub up: Option<Vec3>,
    /// The light that was added, if any.
    pub added: Option<DefaultLight>,
}

impl LitScene<'_> {
    /// `scene` with light for pictures of `aspect` = width / height.
    pub fn new(scene: &Scene, aspect: f32) -> LitScene<'_> {
        if scene.has_light() {
            return LitScene { scene: Cow::Borrowed(scene), framed: None, up: scene.up, added: None };
        }
        let mut lit = scene.clone();
        let placed = complete_as(&mut lit, aspect, &Aim::default());
        // Rays need no camera: one that has no place is refused when a picture asks for it.
        (lit.camera, lit.wide_cameras) = (scene.camera, scene.wide_cameras.clone());
        // The up of a camera that the scene has says nothing of other views.
        let up = scene.up.or(scene.camera.is_none().then(|| placed.sky_up()));
        LitScene { scene: Cow::Owned(lit), framed: placed.framed, up, added: Some(scene.default_light) }
    }
}

/// The camera that shows all triangles of `buffers` as `framing` says: the one that [`complete_as`] gives the scene.
pub(super) fn framing_camera(buffers: &SceneBuffers, framing: &Framing) -> Framed {
    let triangles = (0..buffers.triangle_count() as u32).map(|i| buffers.given_triangle(i));
    let hittable = triangles.filter(|&triangle| DropReason::of(triangle).is_none());
    framing.camera(hittable)
}

/// Which way is up by the shape of `buffers`.
pub(super) fn shape_up(buffers: &SceneBuffers) -> Vec3 {
    let hittable = |i: usize| DropReason::of(buffers.given_triangle(i as u32)).is_none().then_some(i as u32);
    let hittable = parallel::flat_map_numbers(buffers.triangle_count(), hittable);
    let triangle = |i: usize| buffers.given_triangle(hittable[i]);
    up_by_shape(hittable.len(), &triangle).map_or(Vec3::Y, |(up, _)| up)
}

/// Whether a camera has a place and looks at one.
pub(super) fn is_placed(camera: &Camera) -> bool {
    camera.eye.is_finite() && camera.target.is_finite()
}
