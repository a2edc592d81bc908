//! The models, the rays through them, and the answers that are due: those of the twin by brute force.

use crate::common::{Random, SEED, shared};
use glam::Vec3;
use raybrook::low_level::device::{Cache, DeviceHandle};
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{
    Choice, Intersector, MethodOption, PictureOptions, StructureKind, Terminator, TextureFilter, TraceOptions,
};
use raybrook::low_level::pack::{SceneBuffers, sample_positions};
use raybrook::low_level::reference::shade::camera::camera_ray;
use raybrook::low_level::reference::shade::light::sample_light;
use raybrook::low_level::reference::shade::surface::{surface_at, surface_hit, surface_point};
use raybrook::low_level::reference::shade::whitted::reflect_direction;
use raybrook::low_level::reference::shared::ray::Ray;
use raybrook::low_level::renderer::{Picture, complete, open_tracer, render};
use raybrook::low_level::scene::{Builder, Camera, Image, Material, Pattern, Procedural, Samples, Scene, load};
use raybrook::low_level::shared::{COUNTER_NAMES, COUNTERS, Hit, NO_PRIMITIVE, TraceRay};
use raybrook::low_level::tracer::{TraceJob, is_hit};
use std::collections::HashSet;
use std::fmt::Debug;
use std::sync::Arc;

/// Longest chain of rays.
const DEPTH: u32 = 4;

/// Where the box was photographed from (Cornell University Program of Computer Graphics, "Cornell Box Data"): its open
/// side.
const CORNELL_CAMERA: Camera = Camera {
    eye: Vec3::new(278.0, 273.0, -800.0),
    target: Vec3::new(278.0, 273.0, 0.0),
    up: Vec3::Y,
    fov_degrees: 39.3,
};

/// A model, and what is traced in it.
pub struct Model {
    pub name: &'static str,
    scene: Scene,
    picture: Picture,
    /// Camera rays, twice: one is followed by a ray of light, one by a bounce.
    rays: Vec<TraceRay>,
    /// Of their hits to a light, then mirrored or anywhere.
    next_directions: Vec<Float4>,
}

/// What a tracer is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Questions {
    /// Closest hits of the first rays.
    pub closest: bool,
    /// And of the second ones.
    pub next: bool,
    /// Whether there is any hit.
    pub any: bool,
    pub picture: bool,
}

impl Questions {
    /// All of them.
    pub const ALL: Questions = Questions { closest: true, next: true, any: true, picture: true };
}

/// What a tracer answers, as bits; nothing where it was not asked.
pub struct Answers {
    /// Of the first rays and of the second ones t, u, v and primitive.
    hits: [Vec<[u32; 4]>; 2],
    /// Whether there is any hit, of the first rays.
    any: Vec<bool>,
    pixels: Vec<[u32; 3]>,
    /// Rays of the picture, by kind and outcome.
    counts: [u64; COUNTERS],
}

impl Answers {
    /// How many rays they are about.
    pub fn rays(&self) -> u64 {
        let batches = self.hits[0].len() + self.hits[1].len() + self.any.len();
        batches as u64 + self.counts.iter().step_by(2).sum::<u64>()
    }
}

/// A small scene with all kinds of textures and materials.
fn room() -> Scene {
    let mut builder = Builder::new();
    let texels = (0..64u8).map(|i| if (i / 8 + i % 8) % 2 == 0 { [230, 220, 200, 255] } else { [40, 60, 90, 255] });
    let checker = Image { name: "checker".into(), width: 8, height: 8, rgba: texels.collect() };
    let diffuse_texture = Some(builder.add_texture(checker));
    builder.material(Material { diffuse_texture, mirror: Vec3::splat(0.2), ..Material::matt(Vec3::ONE) });
    builder.quad(Vec3::new(-2.0, -1.0, 2.0), Vec3::X * 4.0, Vec3::NEG_Z * 4.0, 2);
    let diffuse_texture = Some(builder.add_texture(Procedural::new(Pattern::Marble)));
    builder.material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) });
    builder.quad(Vec3::new(-2.0, -1.0, -2.0), Vec3::X * 4.0, Vec3::Y * 3.0, 1);
    builder.material(Material { transmission: Vec3::splat(0.9), ior: 1.5, ..Material::matt(Vec3::ZERO) });
    builder.sphere(0.8, 12);
    builder.finish().expect("it is whole")
}

/// The room, which needs no file, and the models, as far as they are there.
///
/// `size`: width and height of the pictures; a batch has four rays for each pixel.
pub fn models(size: (u32, u32)) -> Vec<Model> {
    let files = [
        ("scenes/bunny/bunny-948.ply", None, Vec3::ZERO),
        ("scenes/cornell/cornell_box.obj", Some(CORNELL_CAMERA), Vec3::ZERO),
        ("scenes/objects/suzanne.obj", None, Vec3::splat(0.8)),
        ("spd/tetra.nff", None, Vec3::ZERO), // has a camera
    ];
    let mut models = vec![Model::new("room", room(), size)];
    for (file, camera, transmission) in files {
        let Some(path) = shared(file) else { continue };
        let mut scene = load(path).unwrap();
        scene.camera = camera.or(scene.camera);
        for material in &mut scene.materials {
            (material.mirror, material.transmission, material.ior) = (Vec3::splat(0.5), transmission, 1.5);
        }
        models.push(Model::new(file, scene, size));
    }
    models
}

/// What pixels depend on beside the triangle test.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct Look {
    terminator: Terminator,
    texture_filter: TextureFilter,
    /// Bits of the roulette's weight.
    roulette: u32,
}

impl Look {
    pub fn of(picture: &PictureOptions) -> Look {
        let PictureOptions { terminator, texture_filter, roulette, .. } = *picture;
        Look { terminator, texture_filter, roulette: roulette.unwrap_or(0.0).to_bits() }
    }

    /// All that the values of options lead to.
    pub fn all() -> Vec<Look> {
        let mut looks = vec![TraceOptions::DEFAULT];
        for name in [Terminator::OPTION, TextureFilter::OPTION, "roulette"] {
            let option = MethodOption::find(name).expect("it is in the table");
            let with = |options: &TraceOptions| {
                let set = |choice: Choice| {
                    let mut options = *options;
                    choice.set(&mut options).unwrap();
                    options
                };
                option.choices().map(set).collect::<Vec<_>>()
            };
            let more: Vec<_> = looks.iter().flat_map(with).collect();
            looks.extend(more);
        }
        let mut all: Vec<Look> = looks.iter().map(|options| Look::of(&options.picture)).collect();
        let mut seen = HashSet::new();
        all.retain(|look| seen.insert(*look));
        all
    }
}

/// What all combinations with a triangle test whose pictures look so are to agree with.
pub fn brute_force(intersector: Intersector, look: Look) -> TraceOptions {
    let Look { terminator, texture_filter, roulette } = look;
    let roulette = Some(f32::from_bits(roulette));
    TraceOptions {
        picture: PictureOptions { terminator, texture_filter, roulette, ..PictureOptions::DEFAULT },
        intersector,
        ..TraceOptions::of(StructureKind::Brute)
    }
}

impl Model {
    /// What stands for `look`: without textures the default filter does for all.
    pub fn look(&self, look: Look) -> Look {
        let texture_filter = match self.scene.textures.is_empty() {
            true => TraceOptions::DEFAULT.picture.texture_filter,
            false => look.texture_filter,
        };
        Look { texture_filter, ..look }
    }

    fn new(name: &'static str, mut scene: Scene, size: (u32, u32)) -> Model {
        let samples = Samples::PerPixel(1);
        complete(&mut scene, samples.aspect(size) as f32);
        let picture = Picture { camera: scene.camera.unwrap(), size, samples, depth: DEPTH, kill_weight: Some(0.0) };
        let options = brute_force(Intersector::Exact, Look::of(&PictureOptions::DEFAULT));
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let params = buffers.render_params(&picture.camera, size, samples, DEPTH, picture.kill_weight);
        let in_pixel = sample_positions(samples)[0];
        let pixels = (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x as f32, y as f32)));
        let camera_rays: Vec<Ray> = pixels.map(|(x, y)| camera_ray(&params, x + in_pixel.x, y + in_pixel.y)).collect();
        let rays: Vec<_> = camera_rays
            .iter()
            .map(|ray| TraceRay {
                origin_t_min: Float4::new(ray.origin, 0.0),
                direction_t_max: Float4::new(ray.direction, f32::INFINITY),
            })
            .collect();
        let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
        let mut tracer = open_tracer(None, &buffers, &options, DEPTH, None).unwrap();
        let hits = tracer.trace(&job, &|_| ()).unwrap().hits;
        assert!(hits.iter().filter(|hit| is_hit(hit)).count() > hits.len() / 10, "{name} is hardly seen");

        let mut random = Random::new(SEED);
        let (mut to_lights, mut bounces) = (Vec::new(), Vec::new());
        for (i, (ray, hit)) in camera_rays.iter().zip(&hits).enumerate() {
            if hit.primitive == NO_PRIMITIVE {
                to_lights.push(Float4::new(Vec3::ONE, 0.0));
                bounces.push(Float4::new(Vec3::ONE, 0.0));
                continue;
            }
            let light = &buffers.lights[i % buffers.lights.len()];
            let at = surface_hit(&buffers, &options, ray, hit);
            let to_light = sample_light(light, surface_point(&buffers, &options, &at).position).to_light;
            // Mirrored rays stay on their side; through a pane, rays leave on the other.
            let mirrored = reflect_direction(&surface_at(&buffers, &options, ray, &at), ray.direction);
            to_lights.push(Float4::new(to_light, 0.0));
            bounces.push(Float4::new(if i % 2 == 0 { mirrored } else { random.vec3() }, 0.0));
        }
        let (rays, next_directions) = ([&rays[..], &rays].concat(), [to_lights, bounces].concat());
        Model { name, scene, picture, rays, next_directions }
    }

    /// What is answered on a device, or by the twin.
    pub fn answers(
        &self,
        device: Option<&DeviceHandle>,
        options: &TraceOptions,
        questions: Questions,
        cache: Option<&Cache>,
    ) -> raybrook::Result<Answers> {
        let buffers = Arc::new(SceneBuffers::new(&self.scene, options)?);
        let mut tracer = open_tracer(device, &buffers, options, DEPTH, cache)?;
        let mut answers = Answers { hits: [vec![], vec![]], any: vec![], pixels: vec![], counts: [0; COUNTERS] };
        let job = TraceJob { extreme: &[], rays: &self.rays, next_directions: None, any_hit: false, repeat: 1 };
        if questions.closest {
            let bits = |hit: Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
            let bits = |hits: Vec<Hit>| hits.into_iter().map(bits).collect();
            let next_directions = questions.next.then_some(&self.next_directions[..]);
            let result = tracer.trace(&TraceJob { next_directions, ..job }, &|_| ())?;
            answers.hits = [bits(result.hits), bits(result.next_hits.unwrap_or_default())];
        }
        if questions.any {
            let job = TraceJob { any_hit: true, ..job };
            answers.any = tracer.trace(&job, &|_| ())?.hits.iter().map(is_hit).collect();
        }
        if questions.picture {
            let result = render(tracer.as_mut(), &buffers, &self.picture, &|_| ())?;
            answers.pixels = result.film.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect();
            answers.counts = result.counts;
        }
        Ok(answers)
    }

    /// What is due: what the twin answers.
    pub fn expected(&self, brute_force: &TraceOptions) -> Answers {
        self.answers(None, brute_force, Questions::ALL, None).unwrap()
    }

    /// How much of `got` is not as `expected`, and for each kind of answer the first that is not; of what was asked.
    pub fn compare(&self, expected: &Answers, got: &Answers, questions: Questions) -> (usize, Vec<String>) {
        let mut wrong = Vec::new();
        let ray = |i: usize| format!("{:?}", self.rays[i]);
        if questions.closest {
            wrong.push(difference("hits", &expected.hits[0], &got.hits[0], &ray));
        }
        if questions.next {
            let next = |i: usize| format!("{:?}, then {:?}", self.rays[i], self.next_directions[i]);
            wrong.push(difference("second hits", &expected.hits[1], &got.hits[1], &next));
        }
        if questions.any {
            let any: Vec<_> = expected.hits[0].iter().map(|hit| hit[3] != NO_PRIMITIVE).collect();
            wrong.push(difference("any hits", &any, &got.any, &ray));
        }
        if questions.picture {
            let width = self.picture.size.0 as usize;
            let pixel = |i: usize| format!("pixel {}, {}", i % width, i / width);
            wrong.push(difference("pixels", &expected.pixels, &got.pixels, &pixel));
            wrong.push(difference("counts", &expected.counts, &got.counts, &|i| COUNTER_NAMES[i].to_owned()));
        }
        let wrong: Vec<_> = wrong.into_iter().filter(|(count, _)| *count > 0).collect();
        (wrong.iter().map(|(count, _)| count).sum(), wrong.into_iter().map(|(_, text)| text).collect())
    }
}

/// How many of `got` are not as `expected`, and the first of these, which `place` describes.
fn difference<T: PartialEq + Debug>(
    what: &str,
    expected: &[T],
    got: &[T],
    place: &dyn Fn(usize) -> String,
) -> (usize, String) {
    assert_eq!(expected.len(), got.len(), "{what}");
    let wrong: Vec<_> = (0..got.len()).filter(|&i| expected[i] != got[i]).collect();
    let text = wrong.first().map(|&i| {
        format!("{} {what} of {}: {}: {:?} instead of {:?}", wrong.len(), got.len(), place(i), got[i], expected[i])
    });
    (wrong.len(), text.unwrap_or_default())
}
