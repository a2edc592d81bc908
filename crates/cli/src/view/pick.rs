//! What is under the pointer: the closest hit of a pixel's ray.
//!
//! The twin traces it on the host, with the bits of any device, so that no picture that is being made has to wait.

use super::super::open::Loaded;
use raybrook::glam::Vec3;
use raybrook::low_level::layers::PixelRays;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::ReferenceBackend;
use raybrook::low_level::renderer::Picture;
use raybrook::low_level::scene::{Scene, Triangle};
use raybrook::low_level::shared::Hit;
use raybrook::low_level::tracer::{Backend, is_hit};
use raybrook::{Camera, Result};
use serde::Serialize;
use std::sync::Arc;

/// The scene as it takes to trace single rays.
pub struct Pickable {
    loaded: Arc<Loaded>,
    buffers: Arc<SceneBuffers>,
    options: TraceOptions,
    picture: Picture,
}

/// A ray and what it hits.
#[derive(Debug, Serialize)]
pub struct Picked {
    origin: [f32; 3],
    direction: [f32; 3],
    hit: Option<PickedHit>,
}

/// What a ray hits.
#[derive(Debug, Serialize)]
struct PickedHit {
    /// In units of the direction's length.
    t: f32,
    u: f32,
    v: f32,
    triangle: u32,
    material: String,
    /// World units.
    position: [f32; 3],
}

impl Pickable {
    /// For pictures such as `picture` of the scene that was packed into `buffers` with `options`.
    pub fn new(loaded: &Arc<Loaded>, buffers: &Arc<SceneBuffers>, options: TraceOptions, picture: Picture) -> Pickable {
        let options = TraceOptions { counters: false, ..options };
        Pickable { loaded: loaded.clone(), buffers: buffers.clone(), options, picture }
    }

    /// Whether the picture has this pixel.
    pub fn has_pixel(&self, (x, y): (f64, f64)) -> bool {
        let (width, height) = self.picture.size;
        (0.0..f64::from(width)).contains(&x) && (0.0..f64::from(height)).contains(&y)
    }

    /// The ray of the pixel with the point (`x`, `y`), in pixels from the upper left corner.
    ///
    /// # Errors
    /// As [`PixelRays::new`] and [`Backend::trace`].
    pub fn pick(&self, camera: Camera, (x, y): (f64, f64)) -> Result<Picked> {
        let rays = PixelRays::new(&self.buffers, &Picture { camera, ..self.picture }, None)?;
        let pixel = y as usize * self.picture.size.0 as usize + x as usize;
        let (origin, direction) = rays.ray(pixel);
        let batch = rays.batch(&self.buffers, pixel..pixel + 1);
        let mut twin = ReferenceBackend::new(self.buffers.clone(), self.options);
        let result = twin.trace(&batch.job(false, 1), &|_| ())?;
        let hit = result.hits.first().filter(|hit| is_hit(hit)).map(|hit| self.told(hit));
        Ok(Picked { origin: origin.into(), direction: direction.into(), hit })
    }

    fn told(&self, hit: &Hit) -> PickedHit {
        let scene = &self.loaded.scene;
        let [a, b, c] = scene.vertices(hit.primitive as usize).map(Vec3::as_dvec3);
        let position = a + (b - a) * f64::from(hit.u) + (c - a) * f64::from(hit.v);
        let Hit { t, u, v, primitive: triangle, .. } = *hit;
        let material = material(scene, triangle as usize).to_owned();
        PickedHit { t, u, v, triangle, material, position: position.as_vec3().into() }
    }
}

/// The name of a triangle's material.
fn material(scene: &Scene, primitive: usize) -> &str {
    let of = |triangle: &Triangle| triangle.material;
    let material = scene.triangles.get(primitive).map(of).or_else(|| {
        let (number, instances) = (primitive - scene.triangles.len(), &scene.instances);
        let index = (0..instances.placed().len()).find(|&i| instances.range(i).contains(&(number as u32)))?;
        let instance = &instances.placed()[index];
        let own = || {
            instances.objects()[instance.object as usize].triangles.get(number - instances.range(index).start as usize)
        };
        instance.material.or_else(|| own().map(of))
    });
    material.and_then(|id| scene.materials.get(id as usize)).map_or("", |material| &material.name)
}
