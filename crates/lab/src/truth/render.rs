//! Whitted's ray tracing in f64 ("An Improved Illumination Model for Shaded Display", CACM 23(6), 1980), written from
//! the equations and the documented model, with a structure, hits and shading of its own: no line is shared with the
//! kernels or their twin. What it takes from raybrook are the scene, what was asked for (picture, depth, the places of
//! samples in a pixel, the weight below which rays are not cast), and the hits of the f64 oracle.
//!
//! Bad at: speed. Recursion and a median hierarchy are quick to trust.

use super::lamp::{Arriving, arriving, limited, reflected};
use super::refraction::{reflect, refract};
use super::surface::{Rules, Surface};
use super::texture::{Pyramid, ellipse};
use super::trial::{EPSILON, Trial};
use super::{kinds::Kind, pattern};
use crate::stress::Tolerance;
use glam::{DVec2, DVec3};
use raybrook::Result;
use raybrook::low_level::options::{Intersector, Terminator, TextureFilter, TraceOptions};
use raybrook::low_level::reference::oracle::{Oracle, OracleHit, OracleRay};
use raybrook::low_level::renderer::Picture;
use raybrook::low_level::scene::{Material, Scene, Texture};
use raybrook::low_level::shared::{CameraSample, MAX_SHADOW_LAYERS, NO_PRIMITIVE};
use std::borrow::Cow;

/// What a ray meets who leaves the scene.
const NOTHING: u32 = u32::MAX;

/// A ray on its way.
#[derive(Debug, Clone, Copy)]
pub struct TruthRay {
    /// Where it starts, world units.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
    /// The triangle that it leaves.
    pub skip: u32,
    /// How far f64 may have put its start off the plane that it lies in.
    start_error: f64,
    /// Width of its cone at the start, and by how much that grows in a unit of length.
    cone: (f64, f64),
}

/// A ray with what it adds to its pixel.
#[derive(Debug, Clone, Copy)]
struct Cast {
    ray: TruthRay,
    kind: Kind,
    weight: DVec3,
    depth: u32,
}

/// A ray that a surface sends out, for whoever wants to try it on a device.
#[derive(Debug, Clone, Copy)]
pub struct Sent {
    /// What for.
    pub kind: Kind,
    /// The ray that met the surface.
    pub parent: TruthRay,
    /// Where on it.
    pub parent_t: f64,
    /// Whether that one was a camera ray.
    pub from_camera: bool,
    /// Where it starts.
    pub origin: DVec3,
    /// Unit normal of the triangle there, on the parent's side.
    pub normal: DVec3,
    /// Where it goes.
    pub direction: DVec3,
    /// Where it ends.
    pub t_max: f64,
}

/// Where rays are told to.
pub type Listener<'a> = Option<&'a mut dyn FnMut(Sent)>;

/// The judge's own renderer of a picture.
pub struct Truth<'a> {
    scene: Cow<'a, Scene>,
    oracle: Oracle,
    textures: Vec<Option<Pyramid>>,
    rules: Rules,
    has_footprints: bool,
    camera: Camera,
    picture: Picture,
    kill_weight: f64,
    samples: Vec<CameraSample>,
}

/// The camera in f64.
struct Camera {
    eye: DVec3,
    forward: DVec3,
    /// To the picture's right and upper rim, at distance 1.
    right: DVec3,
    up: DVec3,
    /// Pixels from rim to rim.
    across: f64,
    down: f64,
}

impl Camera {
    fn new(picture: &Picture) -> Camera {
        let camera = &picture.camera;
        let eye = camera.eye.as_dvec3();
        let forward = (camera.target.as_dvec3() - eye).normalize();
        let right = forward.cross(camera.up.as_dvec3()).normalize();
        let half = (f64::from(camera.fov_degrees).to_radians() / 2.0).tan();
        let [across, down] = [picture.size.0, picture.size.1].map(|n| f64::from(picture.samples.intervals(n)));
        Camera { eye, forward, right: right * half * across / down, up: right.cross(forward) * half, across, down }
    }

    /// Through the point that is `x` pixels right of and `y` below the upper left corner.
    fn ray(&self, x: f64, y: f64, footprint: f64, trial: &mut Trial) -> TruthRay {
        // The parts that a direction is the sum of are rounded each.
        let size = self.forward.length() + self.right.length() + self.up.length();
        let (x, y) = (2.0 * x / self.across - 1.0, 1.0 - 2.0 * y / self.down);
        let direction = trial.moved(self.forward + self.right * x + self.up * y, 3.0 * EPSILON * size);
        // A pixel's side at distance 1; one that is away from the middle is seen smaller.
        let side = (4.0 * self.right.length() * self.up.length() / (self.across * self.down)).sqrt();
        let spread = footprint * side / direction.length_squared();
        TruthRay { origin: self.eye, direction, skip: NO_PRIMITIVE, start_error: 0.0, cone: (0.0, spread) }
    }
}

impl<'a> Truth<'a> {
    /// Bytes that a triangle takes: corners, the hierarchy, and those of the exact tracer.
    pub const TRIANGLE_BYTES: u64 = 640;

    /// A renderer of `scene`, which has a camera and lights, as `options` and `picture` ask for. `samples` are the
    /// places of the samples in a pixel, and rays of less weight than `kill_weight` are not cast.
    ///
    /// # Errors
    /// As [`Scene::flattened`].
    pub fn new(
        scene: &'a Scene,
        options: &TraceOptions,
        picture: Picture,
        samples: Vec<CameraSample>,
        kill_weight: f32,
    ) -> Result<Truth<'a>> {
        let has_footprints = options.picture.texture_filter == TextureFilter::Footprint;
        let textures = scene.textures.iter().map(Texture::image);
        Ok(Truth {
            oracle: Oracle::new(scene),
            textures: textures.map(|image| image.map(|image| Pyramid::new(image, has_footprints))).collect(),
            rules: Rules {
                is_exact: options.intersector == Intersector::Exact,
                has_lift: options.picture.terminator == Terminator::Smooth,
            },
            has_footprints,
            camera: Camera::new(&picture),
            picture,
            kill_weight: kill_weight.into(),
            samples,
            scene: scene.flattened()?,
        })
    }

    /// The picture's size in pixels.
    pub fn size(&self) -> (u32, u32) {
        self.picture.size
    }

    /// The longest chain of rays.
    pub fn depth(&self) -> u32 {
        self.picture.depth
    }

    /// The length of the diagonal of the box around the scene.
    pub fn diagonal(&self) -> f64 {
        self.scene.bounds().map_or(0.0, |(low, high)| (high.as_dvec3() - low.as_dvec3()).length())
    }

    /// How many lights there are.
    pub fn light_count(&self) -> usize {
        self.scene.lights.len()
    }

    /// The colour of a pixel. `listener` is told of all rays but those of the camera.
    pub fn pixel(&self, x: u32, y: u32, trial: &mut Trial, listener: &mut Listener) -> DVec3 {
        let sum: DVec3 = self.samples.iter().map(|sample| self.sample((x, y), sample, trial, listener)).sum();
        sum / self.samples.len() as f64
    }

    /// The colour of the first sample of a pixel alone.
    pub fn first_sample(&self, x: u32, y: u32, trial: &mut Trial, listener: &mut Listener) -> DVec3 {
        self.samples.first().map_or(DVec3::ZERO, |sample| self.sample((x, y), sample, trial, listener))
    }

    fn sample(&self, (x, y): (u32, u32), sample: &CameraSample, trial: &mut Trial, listener: &mut Listener) -> DVec3 {
        let (x, y) = (f64::from(x) + f64::from(sample.x), f64::from(y) + f64::from(sample.y));
        let ray = self.camera.ray(x, y, sample.footprint.into(), trial);
        self.radiance(&Cast { ray, kind: Kind::Camera, weight: DVec3::ONE, depth: 1 }, trial, listener)
    }

    /// What comes back along a ray, times its weight.
    fn radiance(&self, cast: &Cast, trial: &mut Trial, listener: &mut Listener) -> DVec3 {
        let ray = self.within_tolerance(&cast.ray, trial);
        let direction = trial.vector(ray.direction.normalize_or_zero(), 4.0);
        let Some(hit) = self.nearest(&ray, f64::INFINITY) else {
            trial.decide(NOTHING);
            return cast.weight * limited(self.background(direction));
        };
        trial.decide(hit.primitive);
        let surface = Surface::new(&self.scene, self.rules, (ray.origin, ray.direction), &hit, trial);
        let material = self.material(hit.primitive);
        let width = ray.cone.0 + ray.cone.1 * (surface.position - ray.origin).length();
        let cast = Cast { ray, ..*cast };
        let local = self.local_light(&cast, &surface, material, (direction, width), trial, listener);
        let mut radiance = cast.weight * limited(local);
        if cast.depth < self.picture.depth {
            for (kind, direction, weight) in second_rays(&surface, material, direction, cast.weight, trial) {
                let is_cast = trial.number(weight.max_element(), 8.0) > self.kill_weight;
                trial.decide(u32::from(is_cast));
                if !is_cast {
                    continue;
                }
                let ray = leave(&surface, direction, (width, ray.cone.1));
                tell(listener, kind, (&cast, &surface), (surface.position, direction, f64::INFINITY));
                let next = Cast { ray, kind, weight, depth: cast.depth + 1 };
                radiance += self.radiance(&next, trial, listener);
            }
        }
        radiance
    }

    /// For tests that do not promise exact hits: a ray as near as they know it.
    fn within_tolerance(&self, ray: &TruthRay, trial: &mut Trial) -> TruthRay {
        if self.rules.is_exact || !trial.has_errors() {
            return *ray;
        }
        let lateral = self.nearest(ray, f64::INFINITY).map_or(0.0, |hit| {
            let corners = self.scene.vertices(hit.primitive as usize).map(DVec3::from);
            Tolerance::of_ray(ray.origin, ray.direction, corners, 0.0).lateral
        });
        // A start that is moved off its triangle may lie behind a neighbour by as much.
        let start_error = if ray.start_error > 0.0 { 2.0 * lateral } else { 0.0 };
        TruthRay { origin: trial.moved(ray.origin, lateral), start_error, ..*ray }
    }

    fn material(&self, primitive: u32) -> &Material {
        &self.scene.materials[self.scene.triangles[primitive as usize].material as usize]
    }

    /// The nearest hit up to `t_max`. A triangle in whose plane the start lies, as far as f64 knows, is met at the
    /// start and not hit: twins of the triangle that is left, and its neighbours at an edge.
    fn nearest(&self, ray: &TruthRay, t_max: f64) -> Option<OracleHit> {
        let TruthRay { origin, direction, skip, start_error, .. } = *ray;
        let mut query = OracleRay { origin, direction, t_min: 0.0, t_max, skip };
        loop {
            let hit = self.oracle.closest(&query)?;
            if start_error == 0.0 {
                return Some(hit);
            }
            let [p0, p1, p2] = self.scene.vertices(hit.primitive as usize).map(DVec3::from);
            let normal = (p1 - p0).cross(p2 - p0).normalize_or_zero();
            if normal.dot(origin - p0).abs() > start_error {
                return Some(hit);
            }
            query.t_min = hit.t.next_up();
        }
    }

    fn background(&self, direction: DVec3) -> DVec3 {
        let [bottom, top] = [self.scene.background.bottom, self.scene.background.top].map(|colour| colour.as_dvec3());
        bottom.lerp(top, self.height(direction))
    }

    /// How far up a unit direction leads, from 0 to 1.
    fn height(&self, direction: DVec3) -> f64 {
        let up = self.scene.sky.map_or(DVec3::Y, |sky| sky.up.as_dvec3().normalize());
        (0.5 + 0.5 * direction.dot(up)).clamp(0.0, 1.0)
    }

    /// What the sky, and the viewer who looks along `direction`, give to a surface with this unit normal.
    fn sky_light(&self, normal: DVec3, direction: DVec3, trial: &mut Trial) -> DVec3 {
        let Some(sky) = self.scene.sky else { return DVec3::ZERO };
        let [bottom, top, viewer] = [sky.bottom, sky.top, sky.viewer].map(|colour| colour.as_dvec3());
        let height = trial.near(self.height(normal), 1.0, 4.0);
        let towards = trial.near(-normal.dot(direction), 1.0, 3.0);
        bottom.lerp(top, height) + viewer * towards.clamp(0.0, 1.0)
    }

    /// What a surface gives off, and what it sends back of ambient light and lights.
    fn local_light(
        &self,
        cast: &Cast,
        surface: &Surface,
        material: &Material,
        (direction, width): (DVec3, f64),
        trial: &mut Trial,
        listener: &mut Listener,
    ) -> DVec3 {
        let colour = self.texture_colour(surface, material, direction, width, trial);
        let diffuse = material.diffuse.as_dvec3() * colour;
        let ambient = material.ambient.as_dvec3() * self.scene.ambient.as_dvec3() * colour;
        let sky = diffuse * self.sky_light(surface.normal, direction, trial);
        let mut radiance = ambient + sky + material.emission.as_dvec3();
        // Light arrives at the position as float32 tells it.
        let position = trial.moved(surface.position, EPSILON * surface.largest_coordinate());
        for (_, light) in self.scene.shining_lights() {
            let light = arriving(light, position, trial);
            let sent = reflected(surface, material, diffuse, direction, &light, trial);
            if sent.max_element() > 0.0 {
                radiance += sent * self.visibility(cast, surface, &light, trial, listener);
            }
        }
        radiance
    }

    fn texture_colour(
        &self,
        surface: &Surface,
        material: &Material,
        direction: DVec3,
        width: f64,
        trial: &mut Trial,
    ) -> DVec3 {
        let Some(id) = material.diffuse_texture.map(|id| id as usize) else { return DVec3::ONE };
        match (&self.scene.textures[id], &self.textures[id]) {
            (Texture::Procedural(texture), _) => pattern::colour(texture, surface, trial),
            (_, Some(pyramid)) if self.has_footprints => {
                let axes: [DVec2; 2] = ellipse(surface, direction, width);
                pyramid.mean(surface.uv, axes, trial)
            }
            (_, Some(pyramid)) => pyramid.bilinear(surface.uv, trial),
            (_, None) => DVec3::ONE,
        }
    }

    /// What is left of a light on its way to a surface: tinted by all that is transparent, nothing behind what is not.
    fn visibility(
        &self,
        cast: &Cast,
        surface: &Surface,
        light: &Arriving,
        trial: &mut Trial,
        listener: &mut Listener,
    ) -> DVec3 {
        let is_placed = light.t_max == 1.0;
        let mut origin = surface.position;
        let mut direction = light.to_light;
        if surface.is_lifted() {
            origin = trial.moved(origin + surface.lift, 2.0 * EPSILON * surface.largest_coordinate());
            direction = if is_placed { direction - surface.lift } else { direction };
        }
        let target = origin + direction;
        tell(listener, Kind::Shadow, (cast, surface), (origin, direction, light.t_max));
        let mut ray = TruthRay { origin, direction, ..leave(surface, direction, (0.0, 0.0)) };
        let mut tint = DVec3::ONE;
        for _ in 0..MAX_SHADOW_LAYERS {
            let Some(hit) = self.nearest(&self.within_tolerance(&ray, trial), light.t_max) else {
                trial.decide(NOTHING);
                return tint;
            };
            let material = self.material(hit.primitive);
            if !material.is_transparent() {
                // Which of several opaque triangles is met makes no difference.
                trial.decide(0);
                return DVec3::ZERO;
            }
            trial.decide(hit.primitive);
            tint *= material.transmission.as_dvec3();
            let passed = Surface::new(&self.scene, self.rules, (ray.origin, ray.direction), &hit, trial);
            let direction = if is_placed { target - passed.position } else { direction };
            ray = leave(&passed, trial.vector(direction, 2.0), (0.0, 0.0));
        }
        DVec3::ZERO
    }
}

fn tell(
    listener: &mut Listener,
    kind: Kind,
    (cast, surface): (&Cast, &Surface),
    (origin, direction, t_max): (DVec3, DVec3, f64),
) {
    let Some(listener) = listener else { return };
    let parent = cast.ray;
    let parent_t = (surface.position - parent.origin).length() / parent.direction.length();
    let (from_camera, normal) = (cast.kind == Kind::Camera, surface.geometric_normal);
    listener(Sent { kind, parent, parent_t, from_camera, origin, normal, direction, t_max });
}

/// A ray that leaves a surface.
fn leave(surface: &Surface, direction: DVec3, cone: (f64, f64)) -> TruthRay {
    TruthRay { origin: surface.position, direction, skip: surface.primitive, start_error: surface.f64_error(), cone }
}

/// The rays that a surface sends on, each with its weight: off a mirror, or by Fresnel's shares off and into glass.
fn second_rays(
    surface: &Surface,
    material: &Material,
    direction: DVec3,
    weight: DVec3,
    trial: &mut Trial,
) -> Vec<(Kind, DVec3, DVec3)> {
    let mut rays = Vec::new();
    let mut reflected_weight = weight * material.mirror.as_dvec3();
    if material.is_transparent() {
        let ior = f64::from(material.ior);
        let eta = trial.number(if surface.is_front { 1.0 / ior } else { ior }, 1.0);
        let eta = if ior == 1.0 { 1.0 } else { eta };
        let refraction = refract(direction, surface.normal, eta, trial);
        reflected_weight = weight * refraction.reflectance;
        if let Some(refracted) = refraction.direction {
            let share = weight * material.transmission.as_dvec3() * (1.0 - refraction.reflectance);
            rays.push((Kind::Refracted, on_side(refracted, -surface.geometric_normal, trial), share));
        }
    }
    if reflected_weight.max_element() > 0.0 {
        let mirrored = trial.vector(reflect(direction, surface.normal), 6.0);
        rays.push((Kind::Reflected, on_side(mirrored, surface.geometric_normal, trial), reflected_weight));
    }
    rays
}

/// A direction that a smooth normal sends to the wrong side of the triangle is mirrored at its plane.
fn on_side(direction: DVec3, normal: DVec3, trial: &mut Trial) -> DVec3 {
    let height = trial.near(direction.dot(normal), 1.0, 4.0);
    if height < 0.0 { reflect(direction, normal) } else { direction }
}
