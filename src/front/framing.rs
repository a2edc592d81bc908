//! A camera and light for scenes that have none: before the structure is built, and after the scene itself is
//! gone.

use crate::pack::SceneBuffers;
use crate::renderer::complete_as;
use crate::scene::{Aim, Camera, DefaultLight, DropReason, Framed, Framing, Scene};
use std::borrow::Cow;

/// A scene that has a light.
pub(super) struct LitScene<'a> {
    /// A copy, for as long as the structure is built, where the scene has no light of its own.
    pub scene: Cow<'a, Scene>,
    /// The camera that frames it in pictures of the aspect, where there is none and the light needed one.
    pub framed: Option<(Framing, Framed)>,
    /// The light that was added, if any.
    pub added: Option<DefaultLight>,
}

impl LitScene<'_> {
    /// `scene` with light for pictures of `aspect` = width / height.
    pub fn new(scene: &Scene, aspect: f32) -> LitScene<'_> {
        if scene.has_light() {
            return LitScene { scene: Cow::Borrowed(scene), framed: None, added: None };
        }
        let mut lit = scene.clone();
        let placed = complete_as(&mut lit, aspect, &Aim::default());
        // Rays need no camera: one that has no place is refused when a picture asks for it.
        (lit.camera, lit.wide_cameras) = (scene.camera, scene.wide_cameras.clone());
        LitScene { scene: Cow::Owned(lit), framed: placed.framed, added: Some(scene.default_light) }
    }
}

/// The camera that shows all triangles of `buffers` as `framing` says: the one that [`complete_as`] gives the scene.
pub(super) fn framing_camera(buffers: &SceneBuffers, framing: &Framing) -> Framed {
    let triangles = (0..buffers.triangle_count() as u32).map(|i| buffers.given_triangle(i));
    let hittable = triangles.filter(|&triangle| DropReason::of(triangle).is_none());
    framing.camera(hittable)
}

/// Whether a camera has a place and looks at one.
pub(super) fn is_placed(camera: &Camera) -> bool {
    camera.eye.is_finite() && camera.target.is_finite()
}
