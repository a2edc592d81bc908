//! All hits of rays: against exact arithmetic, against closest and any hits, and device against twin.

use super::closed::{meshes, structures, thin};
use crate::common::{Random, SEED, asked, device, quick_device, usually_every};
use glam::Vec3;
use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::extreme::TracingBatch;
use raybrook::low_level::options::{Intersector, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::renderer::open_tracer;
use raybrook::low_level::shared::{Hit, MOST_LISTED, NO_PRIMITIVE};
use raybrook::low_level::tracer::{AllHits, AllHitsJob, Backend, is_hit};
use raybrook::{Ray, Scene, Tracer};
use raybrook_lab::stress::closed::ClosedMesh;
use raybrook_lab::stress::{Crossing, ExactTracer, Interval, Mesh, Ratio, StressRay};
use std::sync::{Arc, LazyLock};

/// Rays of each mesh: half of them aimed at edges and vertices.
const RAYS: u64 = 240;

/// A mesh, rays that meet much of it, and what exact arithmetic says of them.
struct Model {
    name: &'static str,
    mesh: Mesh,
    rays: Vec<StressRay>,
    expected: Vec<Vec<Crossing>>,
}

impl Model {
    fn new(name: &'static str, mesh: Mesh, rays: Vec<StressRay>) -> Model {
        let tracer = ExactTracer::new(&mesh);
        let expected = rays.iter().map(|ray| crossings(&tracer, mesh.triangles.len(), ray)).collect();
        Model { name, mesh, rays, expected }
    }

    /// Made once: exact arithmetic takes its time.
    fn all() -> &'static [Model] {
        static ALL: LazyLock<Vec<Model>> = LazyLock::new(Model::make_all);
        &ALL
    }

    fn make_all() -> Vec<Model> {
        let mut models: Vec<_> = meshes().into_iter().map(|(name, mesh)| Model::of_closed(name, mesh)).collect();
        // Sheets of triangles in one place and in one plane, so that all ties are of many.
        let mut sheets = Mesh::sheet(4, |_, _| 0.0);
        sheets.append(&Mesh::sheet(3, |_, _| 0.0).turned_around());
        sheets.append(&Mesh::sheet(4, |_, _| 0.0));
        sheets.append(&Mesh::sheet(4, |x, y| (x + y) as f32 * 0.25));
        let mut random = Random::new(SEED);
        let rays = (0..RAYS).map(|i| {
            let from = (random.vec3() - 0.5) * 8.0;
            let to = if i % 2 == 0 { sheets.random_seam(&mut random) } else { random.vec3() };
            StressRay::to(from, to).within(-2.0, [f32::INFINITY, 1.0, 1.5][i as usize % 3])
        });
        let rays = rays.collect();
        models.push(Model::new("sheets", sheets, rays));
        // Rays from exactly 0 along the faces of boxes: the padding of boxes must not vanish with the origin.
        let along = [Vec3::X, Vec3::Y, Vec3::NEG_Z, Vec3::new(1.0, 1.0, 0.0), Vec3::new(1.0, 1.0, -1.0)];
        let from_zero = along.iter().flat_map(|&to| {
            [StressRay::new(Vec3::ZERO, to).within(1.0, f32::INFINITY), StressRay::new(Vec3::ZERO, to)]
        });
        models.push(Model::new("from zero", thin(), from_zero.collect()));
        models.push(Model::landscape());
        models
    }

    /// Rays straight down and aslant at vertices, and at quarters of edges, of steps and slopes: weights that are zero,
    /// distances in the middle between two floats, and triangles along the way. Some rays start there.
    fn landscape() -> Model {
        let mut random = Random::new(SEED);
        let mut mesh = Mesh::sheet(6, |_, _| 2.0 * random.unit());
        mesh.append(&Mesh::cube(Vec3::new(0.25, 0.25, 0.0), Vec3::new(0.5, 0.75, 1.0)));
        mesh.append(&Mesh::cube(Vec3::new(0.5, 0.25, 0.0), Vec3::new(1.0, 0.75, 0.5)));
        let rays = (0..2 * RAYS).map(|i| {
            let [a, b, _] = mesh.corners(random.below(mesh.triangles.len()));
            let to = a.lerp(b, [0.0, 0.0, 0.5, 0.25][i as usize % 4]);
            let direction = match random.below(8) {
                0 => Vec3::X,
                1 => Vec3::NEG_Y,
                2 => Vec3::new(0.5, 0.25, -1.0),
                3 => b - a,
                _ => Vec3::NEG_Z,
            };
            let ray = StressRay::new(to - direction * [0.0, 1.0, 4.0][random.below(3)], direction);
            let t_min = [0.0, 0.0, 1.0, -1.0][random.below(4)];
            ray.within(t_min, [f32::INFINITY, f32::INFINITY, 1.0, 0.0][random.below(4)])
        });
        let rays = rays.filter(|ray| ray.direction != Vec3::ZERO && ray.t_min <= ray.t_max).collect();
        Model::new("landscape", mesh, rays)
    }

    fn of_closed(name: &'static str, closed: ClosedMesh) -> Model {
        let ray = |index| closed.ray(SEED, index);
        let rays = (0..RAYS).map(|index| StressRay::new(ray(index).origin, ray(index).direction)).collect();
        Model::new(name, closed.mesh().clone(), rays)
    }

    fn batch(&self, buffers: &SceneBuffers) -> TracingBatch {
        let ray = |i: usize| (self.rays[i].origin, self.rays[i].direction, self.rays[i].t_min, self.rays[i].t_max);
        buffers.batch(self.rays.len(), ray, None)
    }

    fn tracer(&self, options: &TraceOptions, device: Option<&DeviceHandle>) -> (Box<dyn Backend>, TracingBatch) {
        let buffers = Arc::new(SceneBuffers::new(&self.mesh.scene(), options).unwrap());
        let batch = self.batch(&buffers);
        (open_tracer(device, &buffers, options, 1, None).unwrap(), batch)
    }

    fn all_hits(&self, options: &TraceOptions, device: Option<&DeviceHandle>) -> AllHits {
        let (mut tracer, batch) = self.tracer(options, device);
        let job = AllHitsJob::of(&batch.job(false, 1));
        let all = tracer.trace_all(&job, &|_| ()).unwrap();
        // The closest few are the first of all, and counting alone gives the same numbers.
        for most in [0, 1, 2, 5] {
            let few = tracer.trace_all(&AllHitsJob { most, ..job }, &|_| ()).unwrap();
            let counted = tracer.trace_all(&AllHitsJob { most, wants_hits: false, ..job }, &|_| ()).unwrap();
            assert_eq!(counted.starts, few.starts, "{} {options:?}", self.name);
            for i in 0..self.rays.len() {
                let first = &all.of_ray(i)[..all.count(i).min(most as usize)];
                // Rounded tests lose hits where t is off by more than the cells of a kd-tree are wide.
                let is_same = few.of_ray(i).iter().zip(first).all(|(few, first)| same(few, first));
                let is_same = is_same || options.intersector != Intersector::Exact;
                assert!(few.count(i) == first.len() && is_same, "{} {options:?}: {most} of ray {i}", self.name);
            }
        }
        all
    }

    /// What closest and any hits say of the same rays.
    fn closest_and_any(&self, options: &TraceOptions) -> (Vec<Hit>, Vec<bool>) {
        let (mut tracer, batch) = self.tracer(options, None);
        let closest = tracer.trace(&batch.job(false, 1), &|_| ()).unwrap().hits;
        let any = tracer.trace(&batch.job(true, 1), &|_| ()).unwrap().hits;
        (closest, any.iter().map(is_hit).collect())
    }

    /// Compares with exact arithmetic, bit for bit.
    fn check(&self, who: &str, found: &AllHits) {
        for (i, expected) in self.expected.iter().enumerate() {
            let bits = |hit: [f32; 3], primitive| (primitive, hit.map(f32::to_bits));
            let got: Vec<_> = found.of_ray(i).iter().map(|hit| bits([hit.t, hit.u, hit.v], hit.primitive)).collect();
            let rounded = |hit: &Crossing| [hit.t.to_f32(), hit.u.to_f32(), hit.v.to_f32()];
            let expected: Vec<_> = expected.iter().map(|hit| bits(rounded(hit), hit.primitive)).collect();
            assert_eq!(got, expected, "{}, {who}: ray {i} {:?}", self.name, self.rays[i]);
        }
    }
}

/// Every crossing of a ray inside of its limits, by t and number.
fn crossings(tracer: &ExactTracer, triangles: usize, ray: &StressRay) -> Vec<Crossing> {
    let Some(line) = tracer.line(ray.origin.as_dvec3(), ray.direction.as_dvec3()) else { return Vec::new() };
    let limits = Interval { near: ray.t_min, far: ray.t_max, is_open: false };
    let all = (0..triangles as u32).filter_map(|i| tracer.crossing(&line, i));
    let mut all: Vec<_> = all.filter(|hit| limits.contains(&hit.t)).collect();
    all.sort_by(|a, b| a.t.cmp(&b.t).then(a.primitive.cmp(&b.primitive)));
    all
}

fn same(hit: &Hit, other: &Hit) -> bool {
    let bits = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
    bits(hit) == bits(other)
}

#[test]
fn they_are_those_of_exact_arithmetic_in_every_structure() {
    let mut ties = 0;
    for model in Model::all() {
        ties += model.expected.iter().flat_map(|hits| hits.windows(2)).filter(|two| two[0].t == two[1].t).count();
        for options in structures() {
            let all = model.all_hits(&options, None);
            let (closest, any) = model.closest_and_any(&options);
            model.check(&format!("{options:?}"), &all);
            for (i, (closest, any)) in closest.iter().zip(any).enumerate() {
                let first = all.of_ray(i).first();
                assert!(first.map_or(!is_hit(closest), |first| same(first, closest)), "{} ray {i}", model.name);
                assert_eq!(any, first.is_some(), "{} ray {i}", model.name);
            }
        }
    }
    assert!(ties > 1000, "{ties}");
}

/// What kernels have of their own: structures, records of packets, memory, layouts, and rounded tests.
const ON_DEVICES: [&str; 10] = [
    "structure=bvh8 packet_size=16 ray_order=sorted triangles=leaf-order",
    "structure=bvh8 packet_size=16",
    "structure=bvh2 spatial_splits=1",
    "structure=kd traversal=ropes",
    "structure=bvh2",
    "structure=kd packet_size=16 intersector=moller-trumbore",
    "structure=bvh2 intersector=watertight",
    "structure=bvh8 intersector=precomputed",
    "structure=bvh8 spatial_splits=auto",
    "structure=grid triangles=leaf-order",
];

#[test]
fn device_and_twin_agree() {
    let Some(device) = quick_device() else { return };
    let models = Model::all();
    for text in usually_every(3, ON_DEVICES) {
        let options = asked(text);
        for model in models {
            let got = model.all_hits(&options, Some(&device));
            let expected = model.all_hits(&options, None);
            assert_eq!(got.starts, expected.starts, "{} {text}", model.name);
            let differing = got.hits.iter().zip(&expected.hits).position(|(got, expected)| !same(got, expected));
            assert_eq!(differing, None, "{} {text}", model.name);
            if !text.contains("intersector") {
                model.check(text, &got);
            }
        }
    }
}

/// Packets list hits but for those of rays with very many. Where the rays of a part have more hits than there is room
/// for, it is listed again as shorter ones. All are listed, in batches of several parts, too.
#[test]
fn packets_list_all_but_rays_with_very_many_hits() {
    let Some(device) = quick_device() else { return };
    let mut layers = Mesh::default();
    let count = MOST_LISTED as usize + 8;
    (0..count).for_each(|z| layers.append(&Mesh::sheet(1, |_, _| z as f32)));
    let options = asked("structure=bvh8 packet_size=16 triangles=leaf-order");
    let buffers = Arc::new(SceneBuffers::new(&layers.scene(), &options).unwrap());
    let mut random = Random::new(SEED);
    let mut ray = |hits: usize| {
        let from = random.vec3() * 0.25 + Vec3::splat(0.5);
        (from.with_z(hits as f32 - 0.5), (random.vec3() * 1e-3).with_z(-1.0), 0.0, f32::INFINITY)
    };
    let many: Vec<_> = (0..600).map(|i| ray([count, MOST_LISTED as usize, 20][i % 3])).collect();
    // More than are traced at a time.
    let several: Vec<_> = (0..(1 << 18) + 128).map(|i| ray(usize::from(i % 5 == 0))).collect();
    // With more hits than there is room for at a time; the last ones have few. None is near a sheet's diagonal, where
    // packets may put too much aside.
    let beside = |hits: usize, (from, direction, t_min, t_max): (Vec3, Vec3, f32, f32)| {
        let middle = Vec3::new(0.8, 0.5, hits as f32 - 0.5);
        (middle + 0.4 * (from - Vec3::new(0.5, 0.5, middle.z)), direction, t_min, t_max)
    };
    let hits_of = |i: usize| if i < 20_000 { 100 } else { 1 };
    let dense: Vec<_> = (0..24_000).map(|i| beside(hits_of(i), ray(hits_of(i)))).collect();
    for (rays, are_left) in [(many, true), (several, false), (dense, false)] {
        let batch = buffers.batch(rays.len(), |i| rays[i], None);
        let list = |device: Option<&DeviceHandle>| {
            let mut tracer = open_tracer(device, &buffers, &options, 1, None).unwrap();
            tracer.trace_all(&AllHitsJob::of(&batch.job(false, 1)), &|_| ()).unwrap()
        };
        let (got, expected) = (list(Some(&device)), list(None));
        assert_eq!(got.starts, expected.starts);
        assert_eq!(got.hits.iter().zip(&expected.hits).position(|(got, expected)| !same(got, expected)), None);
        let due: usize = rays.iter().map(|ray| (ray.0.z + 0.5) as usize).sum();
        assert_eq!(got.hits.len(), due);
        assert_eq!(got.kernel_s[1] > 0.0, are_left, "{} rays, seconds of single ones {:?}", rays.len(), got.kernel_s);
    }
}

/// Whoever asks again from the float behind each hit gets the next one whose exact t is not less, never the same one;
/// all hits are those of the list, which also has what lies between.
#[test]
fn asking_again_behind_each_hit_finds_the_others() {
    let mut steps = 0;
    for model in Model::all() {
        let mut tracer = Tracer::builder(&model.mesh.scene()).device("reference").build().unwrap();
        let ray =
            |ray: &StressRay| Ray::new(ray.origin.to_array(), ray.direction.to_array()).between(ray.t_min, ray.t_max);
        let mut rays: Vec<_> = model.rays.iter().map(ray).collect();
        let all = tracer.all_hits(&rays).unwrap();
        assert_eq!(all.len(), rays.len());
        let counts: Vec<_> = all.counts().map(|count| count as u32).collect();
        assert_eq!(tracer.count_hits(&rays).unwrap(), counts);
        let two = tracer.first_hits(&rays, 2).unwrap();
        for i in 0..rays.len() {
            assert_eq!(two.of_ray(i), &all.of_ray(i)[..all.of_ray(i).len().min(2)]);
        }
        loop {
            let hits = tracer.closest_hits(&rays).unwrap();
            for (i, hit) in hits.iter().enumerate() {
                let is_behind = |hit: &Crossing| {
                    let near = rays[i].t_min;
                    near.is_finite() && hit.t >= Ratio::from_float(near.into())
                };
                let next = model.expected[i].iter().position(is_behind).map(|place| all.of_ray(i)[place]);
                assert_eq!(*hit, next, "{} ray {i}", model.name);
            }
            steps += hits.iter().flatten().count();
            if hits.iter().all(Option::is_none) {
                break;
            }
            for (ray, hit) in rays.iter_mut().zip(&hits) {
                *ray = ray.between(hit.map_or(f32::INFINITY, |hit| hit.t.next_up()), ray.t_max);
            }
        }
    }
    assert!(steps > 3000, "{steps}");
}

#[test]
fn extreme_and_unsound_rays_are_told_as_by_closest_hits() {
    // Two triangles in one place and one behind them, in a scene that tracing space makes 2^70 times as large.
    let size = 1e-20;
    let corners = [[0.0, 0.0, 0.0], [size, 0.0, 0.0], [0.0, size, 0.0]];
    let behind = corners.map(|[x, y, _]| [x, y, -size]);
    let scene = Scene::from_mesh(&[corners, behind].concat(), &[[0, 1, 2], [3, 4, 5], [0, 1, 2]]).unwrap();
    let at = |z: f32, t_max: f32| Ray::new([size / 4.0, size / 4.0, z], [0.0, 0.0, -1.0]).between(0.0, t_max);
    let rays = [
        at(1e20, f32::INFINITY), // tracing space cannot hold it
        at(1e30, 1e30),
        at(1.0, f32::INFINITY),
        Ray::new([f32::NAN, 0.0, 1.0], [0.0, 0.0, -1.0]),
        Ray::new([0.0, 0.0, 1.0], [0.0; 3]),
        at(1.0, f32::NAN),
    ];
    let devices = std::iter::once("reference".to_owned()).chain(device().map(|device| device.info.index.to_string()));
    for device in devices {
        let mut tracer = Tracer::builder(&scene).device(&device).build().unwrap();
        let all = tracer.all_hits(&rays).unwrap();
        let triangles = |i: usize| all.of_ray(i).iter().map(|hit| hit.triangle).collect::<Vec<_>>();
        assert_eq!((triangles(0), triangles(1)), (vec![0, 2, 1], vec![0, 2]), "{device}");
        assert_eq!(triangles(2), [0, 2, 1], "{device}");
        assert!((3..6).all(|i| triangles(i).is_empty()), "{device}");
        let closest = tracer.closest_hits(&rays).unwrap();
        for (i, hit) in closest.iter().enumerate() {
            assert_eq!(hit.as_ref(), all.of_ray(i).first(), "{device} ray {i}");
        }
        assert_eq!(tracer.count_hits(&rays).unwrap(), [3, 2, 3, 0, 0, 0], "{device}");
        assert_eq!(tracer.all_hits(&[]).unwrap().len(), 0);
    }
}

#[test]
fn work_is_counted_alike() {
    let Some(device) = device() else { return };
    let model = &Model::all()[0];
    let options = TraceOptions { counters: true, ..asked("structure=bvh2") };
    let (got, expected) = (model.all_hits(&options, Some(&device)), model.all_hits(&options, None));
    assert!(got.work.is_some() && got.work == expected.work);
    let misses = (0..model.rays.len()).filter(|&i| expected.count(i) == 0).count();
    assert!(misses < model.rays.len());
    assert!(
        expected.hits.iter().all(|hit| hit.primitive != NO_PRIMITIVE && Vec3::new(hit.t, hit.u, hit.v).is_finite())
    );
}
