//! Every function of `cl/` on a device against its twin in Rust, bit for bit, each reached through a small test kernel;
//! and the shared structs' layout as the device sees it. Run a second time under Oclgrind by `./test`.

use crate::common::probe::{assert_same_bits, flag, run, run_with, v3};
use crate::common::{Random, SEED, device, on_oclgrind, scene_of, soup, usually_every};
use glam::Vec3;
use raybrook::low_level::bounds::{SLACK, SPHERE_SLACK};
use raybrook::low_level::device::{CompileOptions, DeviceKind};
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{
    Intersector, KdOptions, Kernels, LEAST_ROULETTE, PictureOptions, Structure, StructureKind, TexturePass,
    TraceOptions, Traversal,
};
use raybrook::low_level::pack::{SceneBuffers, triangle_transform};
use raybrook::low_level::reference::intersect::exact::{finish_exactly, test_exactly};
use raybrook::low_level::reference::intersect::{intersect, moller_trumbore::Intersection};
use raybrook::low_level::reference::shade::light::toon_tone;
use raybrook::low_level::reference::shade::procedural::{fractal_noise, gradient_noise, procedural_colour};
use raybrook::low_level::reference::shade::roulette::Killing;
use raybrook::low_level::reference::shade::whitted::RayKind;
use raybrook::low_level::reference::shared::math;
use raybrook::low_level::reference::shared::memory::NoWork;
use raybrook::low_level::reference::shared::ray::{
    Ray, TrianglePoint, no_hit_yet, start_on_triangle, widen_down, widen_up,
};
use raybrook::low_level::reference::shared::slab::{PairSlabs, Slabs, is_padding_enough};
use raybrook::low_level::reference::traverse::spheres::may_meet_sphere;
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{Background, Builder, Camera, Image, Light, Material, Samples, Sky};
use raybrook::low_level::shared::{
    CameraSample, NO_PRIMITIVE, RAY_DEPTH_BITS, RenderParams, SHARED_STRUCTS, TEXTURE_CHECKER, TEXTURE_MARBLE,
    TEXTURE_NOISE, TEXTURE_WOOD, TextureInfo,
};
use raybrook::low_level::tracer::{TraceJob, is_hit};
use std::fmt::Write;
use std::sync::Arc;

/// Work-items of most tests; few, because Oclgrind interprets them.
const ITEMS: usize = 512;
/// One function: how the device calls it, and its twin.
struct Case {
    name: &'static str,
    body: &'static str,
    inputs: usize,
    outputs: usize,
    input: fn(&mut Random) -> f32,
    twin: fn(&[f32]) -> Vec<f32>,
}

fn ray_of(data: &[f32]) -> Ray {
    Ray::new(v3(data), v3(&data[3..]), data[6], data[7], NO_PRIMITIVE)
}

/// Mostly ordinary numbers, some zeros, repeated values and, one in sixteen, any bit pattern.
fn mixed(random: &mut Random) -> f32 {
    match random.bits() % 16 {
        0 => random.any_float(),
        1 => 0.0,
        2 => -0.0,
        3 => 1.0,
        _ => random.signed(),
    }
}

/// A coordinate for textures: mostly ordinary, many on the borders of cells and just beside them, some beyond all whole
/// numbers.
fn place(random: &mut Random) -> f32 {
    let whole = (random.bits() % 17) as f32 - 8.0;
    match random.bits() % 16 {
        0 => random.any_float(),
        1 => whole,
        2 => whole.next_down(),
        3 => whole.next_up(),
        4 => [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, 1e30, -1e30][random.bits() as usize % 5],
        // Around the last numbers that an int and that a fraction have.
        5 => random.signed() * 4_294_967_296.0,
        6 => [2_147_483_648.0, -2_147_483_648.0, 2_147_483_520.0, -2_147_483_520.0][random.bits() as usize % 4],
        7 => random.signed() * 16_777_216.0,
        _ => random.signed() * 10.0,
    }
}

const MAKE_RAY: &str = "Ray ray = make_ray(vload3(0, in), vload3(1, in), in[6], in[7], NO_PRIMITIVE);";

const SLABS: &str = "make_slabs, slabs_without_padding, clip_to_pair";

const CASES: &[Case] = &[
    Case {
        name: "farthest_distance, clip_to_thick_box, may_meet_sphere",
        body: "Ray ray = make_ray(vload3(0, in), vload3(1, in), in[6], in[7], NO_PRIMITIVE);\
               float3 low = vload3(0, in + 8), high = low + fabs(vload3(0, in + 11)); float t_near, t_far;\
               out[0] = farthest_distance(&ray, low, high);\
               bool inside = clip_to_thick_box(&ray, SLACK * out[0], low, high, &t_near, &t_far);\
               out[1] = inside ? 1.0f : 0.0f; out[2] = inside ? t_near : 0.0f; out[3] = inside ? t_far : 0.0f;\
               float4 sphere = (float4)(low, fabs(in[11]));\
               out[4] = may_meet_sphere(&ray, SPHERE_SLACK * out[0], sphere, in[12]) ? 1.0f : 0.0f;",
        inputs: 14,
        outputs: 5,
        input: mixed,
        twin: |x| {
            let (ray, low) = (ray_of(x), v3(&x[8..]));
            let high = low + v3(&x[11..]).abs();
            let distance = ray.farthest_distance(low, high);
            let inside = ray.clip_to_thick_box(SLACK * distance, low, high);
            let (t_near, t_far) = inside.unwrap_or((0.0, 0.0));
            let sphere = Float4::new(low, x[11].abs());
            let met = may_meet_sphere(&ray, SPHERE_SLACK * distance, sphere, x[12]);
            vec![distance, flag(inside.is_some()), t_near, t_far, flag(met)]
        },
    },
    Case {
        name: SLABS,
        body: "Ray ray = make_ray(vload3(0, in), vload3(1, in), in[6], in[7], NO_PRIMITIVE);\
               float3 m = vload3(0, in + 8), h = vload3(0, in + 11), low = m - fabs(h), high = m + fabs(h);\
               const Slabs slabs = make_slabs(&ray, low, high, 0.0f); const PairSlabs pair = make_pair_slabs(&slabs);\
               vstore3(slabs.inv, 0, out); vstore3(slabs.enter, 1, out); vstore3(slabs.leave, 2, out);\
               const float4 xy0 = (float4)(m.x, h.x, m.y, h.y), xy1 = (float4)(h.x, m.x, h.y, h.y), \
               zz = (float4)(m.z, h.z, h.z, h.z);\
               vstore4(clip_to_pair(&pair, ray.t_near, ray.t_far, false, xy0, xy1, zz), 0, out + 9);\
               out[13] = is_padding_enough(&ray, low, high, 0.0f, in[11]) ? 1.0f : 0.0f;\
               for (uint i = 14; i < 18u; i++) out[i] = 0.0f;\
               if (!is_padding_enough(&ray, low, high, 0.0f, 1000.0f)) return;\
               const Slabs plain = slabs_without_padding(&ray); const PairSlabs plain_pair = make_pair_slabs(&plain);\
               const float4 t = clip_to_pair(&plain_pair, fabs(ray.t_near), ray.t_far, true, xy0, xy1, zz);\
               if (t.x <= -t.y) vstore2(t.xy, 0, out + 14); if (t.z <= -t.w) vstore2(t.zw, 0, out + 16);",
        inputs: 14,
        outputs: 18,
        input: |random| if random.bits().is_multiple_of(8) { random.any_float() } else { mixed(random) },
        twin: |x| {
            let (ray, middle, half) = (ray_of(x), v3(&x[8..]), v3(&x[11..]));
            let (low, high) = (middle - half.abs(), middle + half.abs());
            let slabs = Slabs::new(&ray, low, high, 0.0);
            let (xy0, xy1) = ([middle.x, half.x, middle.y, half.y], [half.x, middle.x, half.y, half.y]);
            let zz = [middle.z, half.z, half.z, half.z];
            let t = PairSlabs::new(&slabs).clip([ray.t_near, ray.t_far], xy0, xy1, zz);
            let mut plain = [0.0; 4];
            if is_padding_enough(&ray, low, high, 0.0, 1000.0) {
                let t = PairSlabs::new(&Slabs::without_padding(&ray)).clip([ray.t_near.abs(), ray.t_far], xy0, xy1, zz);
                for i in [0, 2].into_iter().filter(|&i| t[i] <= -t[i + 1]) {
                    plain[i..i + 2].copy_from_slice(&t[i..i + 2]);
                }
            }
            let has_padding = flag(is_padding_enough(&ray, low, high, 0.0, x[11]));
            let slabs = [slabs.inv, slabs.enter, slabs.leave];
            slabs.iter().flat_map(|v| v.to_array()).chain(t).chain([has_padding]).chain(plain).collect()
        },
    },
    Case {
        name: "difference_of_products",
        body: "out[0] = difference_of_products(in[0], in[1], in[2], in[3]);",
        inputs: 4,
        outputs: 1,
        input: mixed,
        twin: |x| vec![math::difference_of_products(x[0], x[1], x[2], x[3])],
    },
    Case {
        name: "dot3, cross3, fma3",
        body: "float3 a = vload3(0, in), b = vload3(1, in); out[0] = dot3(a, b); vstore3(cross3(a, b), 0, out + 1);\
               vstore3(fma3(a, in[6], b), 0, out + 4);",
        inputs: 7,
        outputs: 7,
        input: mixed,
        twin: |x| {
            let (a, b) = (v3(x), v3(&x[3..]));
            let mut out = vec![math::dot3(a, b)];
            out.extend(math::cross3(a, b).to_array());
            out.extend(math::fma3(a, x[6], b).to_array());
            out
        },
    },
    Case {
        name: "max_or, min_or, max_component, clamp01, is_finite3",
        body: "float3 a = vload3(0, in); out[0] = max_or(in[0], in[1]); out[1] = min_or(in[0], in[1]);\
               out[2] = max_component(abs3(a)); out[3] = clamp01(in[0] * 2.0f); out[4] = is_finite3(a) ? 1.0f : 0.0f;",
        inputs: 3,
        outputs: 5,
        input: mixed,
        twin: |x| {
            vec![
                math::max_or(x[0], x[1]),
                math::min_or(x[0], x[1]),
                math::max_component(math::abs3(v3(x))),
                math::clamp01(x[0] * 2.0),
                flag(math::is_finite3(v3(x))),
            ]
        },
    },
    Case {
        name: "point_of_weights, start_on_triangle",
        body: "float3 weights = (float3)(fabs(in[9]), fabs(in[10]), fabs(in[11])); \
               uint largest = (uint)fabs(in[12]) % 3;\
               if (largest == 0) weights.x = -1.0f; else if (largest == 1) weights.y = -1.0f; else weights.z = -1.0f;\
               const TrianglePoint point = point_of_weights(vload3(0, in), vload3(1, in), vload3(2, in), weights);\
               float3 high, low; start_on_triangle(&point, &high, &low); vstore3(high, 0, out); vstore3(low, 1, out);\
               const float* base = (const float*)&point.base; const float* other1 = (const float*)&point.other1;\
               const float* other2 = (const float*)&point.other2; float16 highs, lows;\
               for (uint i = 0; i < 3; i++) {\
                   point_of_triangle16((float16)(base[i]), (float16)(other1[i]), (float16)(other2[i]), \
                                       (float16)(point.weight1),\
                                       (float16)(point.weight2), &highs, &lows);\
                   out[6 + i] = lane_of16(&highs, 11); out[9 + i] = lane_of16(&lows, 4);\
               }",
        inputs: 13,
        outputs: 12,
        input: |random| random.signed() * [1.0, 1e-3, 8.0][random.bits() as usize % 3],
        twin: |x| {
            let mut weights = v3(&x[9..]).abs();
            weights[x[12].abs() as usize % 3] = -1.0;
            let point = TrianglePoint::of_weights([v3(x), v3(&x[3..]), v3(&x[6..])], weights);
            let (high, low) = start_on_triangle(&point);
            [high.to_array(), low.to_array()].concat().repeat(2)
        },
    },
    Case {
        name: "scale_to_unit, normalize3",
        body: "float3 v = vload3(0, in); float scale = 1.0f; out[0] = scale_to_unit(&v, &scale) ? scale : 0.0f;\
               vstore3(normalize3(vload3(0, in), (float3)(7.0f)), 0, out + 1);",
        inputs: 3,
        outputs: 4,
        // Every magnitude, but all three alike, so that none hides the others.
        input: |random| if random.bits().is_multiple_of(3) { random.any_float() } else { mixed(random) },
        twin: |x| {
            let mut out = vec![math::scale_to_unit(v3(x)).map_or(0.0, |(_, scale)| scale)];
            out.extend(math::normalize3(v3(x), Vec3::splat(7.0)).to_array());
            out
        },
    },
    Case {
        name: "log2_fixed, exp2_fixed, power_fixed",
        body: "float x = fabs(in[0]); out[0] = power_fixed(x, fabs(in[1]) * 100.0f); \
               out[1] = exp2_fixed(fabs(in[1]) * -130.0f);\
               out[2] = x >= FLT_MIN && x <= 1.0f ? log2_fixed(x) : 0.0f;",
        inputs: 2,
        outputs: 3,
        input: mixed,
        twin: |x| {
            let base = x[0].abs();
            let log = if (f32::MIN_POSITIVE..=1.0).contains(&base) { math::log2_fixed(base) } else { 0.0 };
            vec![math::power_fixed(base, x[1].abs() * 100.0), math::exp2_fixed(x[1].abs() * -130.0), log]
        },
    },
    Case {
        name: "sin_turns",
        body: "out[0] = sin_turns(in[0]); out[1] = sin_turns(in[1] * 100.0f);",
        inputs: 2,
        outputs: 2,
        input: mixed,
        twin: |x| vec![math::sin_turns(x[0]), math::sin_turns(x[1] * 100.0)],
    },
    Case {
        name: "toon_tone",
        body: "out[0] = toon_tone(in[0], 1u, fabs(in[1])); out[1] = toon_tone(in[0], 3u, in[1]);\
               out[2] = toon_tone(in[2] * 0.25f, 4u, 0.0f); out[3] = toon_tone(in[2], 0xffffffffu, 0.25f);",
        inputs: 3,
        outputs: 4,
        input: |random| {
            if random.bits().is_multiple_of(4) { (random.bits() % 17) as f32 / 8.0 - 1.0 } else { mixed(random) }
        },
        twin: |x| {
            vec![
                toon_tone(x[0], 1, x[1].abs()),
                toon_tone(x[0], 3, x[1]),
                toon_tone(x[2] * 0.25, 4, 0.0),
                toon_tone(x[2], u32::MAX, 0.25),
            ]
        },
    },
    Case {
        name: "gradient_noise, fractal_noise",
        body: "float3 p = vload3(0, in); out[0] = gradient_noise(p, 0u); out[1] = gradient_noise(p, 0xfffffffbu);\
               out[2] = fractal_noise(p, 16u, 0xfffffffbu, false); out[3] = fractal_noise(p, 5u, 7u, true);",
        inputs: 3,
        outputs: 4,
        input: place,
        twin: |x| {
            let p = v3(x);
            let last = 0xffff_fffb; // the octaves' seeds wrap around
            vec![
                gradient_noise(p, 0),
                gradient_noise(p, last),
                fractal_noise(p, 16, last, false),
                fractal_noise(p, 5, 7, true),
            ]
        },
    },
    Case {
        name: "widen_up, widen_down",
        body: "out[0] = widen_up(in[0]); out[1] = widen_down(in[0]);",
        inputs: 1,
        outputs: 2,
        input: |random| random.any_float(),
        twin: |x| vec![widen_up(x[0]), widen_down(x[0])],
    },
];

#[test]
fn functions_equal_their_twins() {
    let Some(device) = device() else { return };
    for case in CASES {
        let mut random = Random::new(SEED);
        let data: Vec<f32> = (0..ITEMS * case.inputs).map(|_| (case.input)(&mut random)).collect();
        let compare = |data: &[f32], options: CompileOptions, bring: fn(f32) -> f32| {
            let expected: Vec<f32> = data.chunks_exact(case.inputs).flat_map(case.twin).map(bring).collect();
            let got = run_with(&device, options, case.body, case.inputs, case.outputs, data);
            assert_same_bits(case.name, case.inputs, data, &got.into_iter().map(bring).collect::<Vec<_>>(), &expected);
        };
        let has_slabs = case.name == SLABS;
        if !has_slabs || device.info.kind != DeviceKind::Gpu {
            compare(&data, CompileOptions::new(), |x| x);
        }
        if has_slabs {
            // GPUs take other maxima, by their bits where they may: of finite numbers, and the sign of a zero is open.
            let most = (1u128 << 64) as f32;
            let limit = |(i, &x): (usize, &f32)| if i % case.inputs < 8 { x } else { x.min(most).max(-most) };
            let finite: Vec<f32> = data.iter().enumerate().map(limit).collect();
            compare(&finite, CompileOptions::new().define("GPU", 1), |x| x + 0.0);
        }
    }
}

#[test]
fn rays_equal_their_twins() {
    let Some(device) = device() else { return };
    let body = format!(
        "{MAKE_RAY} vstore3(ray.direction, 0, out); vstore3(ray.inv_direction, 0, out + 3);\
         out[6] = ray.t_near; out[7] = ray.t_far; out[8] = ray.t_scale; float t_near, t_far;\
         float3 low = vload3(0, in + 8), high = low + fabs(vload3(0, in + 11));\
         bool inside = clip_to_box(&ray, low, high, &t_near, &t_far); out[9] = inside ? 1.0f : 0.0f;\
         out[10] = inside ? t_near : 0.0f; out[11] = inside ? t_far : 0.0f;"
    );
    let mut random = Random::new(SEED);
    let data: Vec<f32> = (0..ITEMS * 14).map(|_| mixed(&mut random)).collect();
    let expected: Vec<f32> = data
        .chunks_exact(14)
        .flat_map(|x| {
            let ray = ray_of(x);
            let low = v3(&x[8..]);
            let inside = ray.clip_to_box(low, low + v3(&x[11..]).abs());
            let (t_near, t_far) = inside.unwrap_or((0.0, 0.0));
            let mut out = [ray.direction.to_array(), ray.inv_direction.to_array()].concat();
            out.extend([ray.t_near, ray.t_far, ray.t_scale, flag(inside.is_some()), t_near, t_far]);
            out
        })
        .collect();
    assert_same_bits("make_ray, clip_to_box", 14, &data, &run(&device, &body, 14, 12, &data), &expected);
}

fn intersect_exactly(buffers: &SceneBuffers, ray: &Ray) -> Option<Intersection> {
    let mut hit = no_hit_yet(ray);
    test_exactly(buffers, ray, 0, &mut hit, &mut NoWork);
    finish_exactly(buffers, ray, &mut hit);
    is_hit(&hit).then_some(Intersection { t: hit.t, u: hit.u, v: hit.v })
}

/// Apart from the others, because it is the one that runtimes without much else must get right (`tests/runtimes.sh`).
#[test]
fn the_exact_intersector_equals_its_twin() {
    intersector_equals_its_twin(Intersector::Exact);
}

#[test]
fn fast_intersectors_equal_their_twins() {
    Intersector::ALL.iter().filter(|&&i| i != Intersector::Exact).for_each(|&i| intersector_equals_its_twin(i));
}

fn intersector_equals_its_twin(intersector: Intersector) {
    let Some(device) = device() else { return };
    let test = match intersector.cl_function() {
        Some(function) => {
            format!("float t, u, v; bool is_hit = {function}(GEOMETRY_AT(&geometry), &ray, 0, &t, &u, &v);")
        }
        // As no_hit_yet(), of which Oclgrind 21.10 makes here what it cannot run.
        None => "Hit hit = {ray.t_far, ray.t_far, 0.0f, NO_PRIMITIVE}; \
                 test_exactly(GEOMETRY_AT(&geometry), &ray, 0, 0, &hit);\
                     finish_exactly(GEOMETRY_AT(&geometry), &ray, &hit); bool is_hit = hit.primitive == 0;\
                     float t = hit.t, u = hit.u, v = hit.v;"
            .to_owned(),
    };
    let body = format!(
        "{MAKE_RAY} Geometry geometry; geometry.vertices = (__global const float4*)(in + 8);\
             geometry.transforms = (__global const float4*)(in + 20); geometry.scale = in[32];\
             geometry.low = (float3)(-1.0f); geometry.high = (float3)(1.0f); {test}\
             out[0] = is_hit ? 1.0f : 0.0f; out[1] = is_hit ? t : 0.0f; out[2] = is_hit ? u : 0.0f; \
             out[3] = is_hit ? v : 0.0f;"
    );
    // A ray, three float4, a transform of three float4, the scale, and three to align the next.
    const INPUTS: usize = 36;
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    for i in 0..4 * ITEMS {
        let triangle = [(); 3].map(|()| random.vec3());
        let origin = 3.0 * random.vec3();
        // Half the rays aim at the triangle, a quarter at its edges and vertices, the rest anywhere.
        let (a, b) = (random.unit(), random.unit());
        let (u, v) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        let target = match i % 8 {
            0..4 => triangle[0] * (1.0 - u - v) + triangle[1] * u + triangle[2] * v,
            4 => triangle[0].lerp(triangle[1], u),
            5 => triangle[i / 8 % 3],
            _ => 2.0 * random.vec3(),
        };
        data.extend(origin.to_array());
        data.extend((target - origin).to_array());
        data.extend([0.0, f32::INFINITY]);
        data.extend(triangle.iter().flat_map(|p| [p.x, p.y, p.z, 0.0]));
        data.extend(triangle_transform(triangle).iter().flat_map(|f| [f.x, f.y, f.z, f.w]));
        // Only `thesis` looks at the scale: with the larger ones its epsilon bites.
        data.extend([[0.25, 1.0, 64.0][i % 3], 0.0, 0.0, 0.0]);
    }
    let one = crate::common::scene_of(&[[Vec3::ZERO, Vec3::X, Vec3::Y]]);
    let mut buffers = SceneBuffers::new(&one, &TraceOptions::default()).unwrap();
    let mut hits = 0;
    let expected: Vec<f32> = data
        .chunks_exact(INPUTS)
        .flat_map(|x| {
            let triangle = [v3(&x[8..]), v3(&x[12..]), v3(&x[16..])];
            buffers.vertices = triangle.map(|p| Float4::new(p, 0.0)).to_vec();
            buffers.transforms = triangle_transform(triangle).to_vec();
            buffers.params.scale = x[32];
            let found = match intersector {
                Intersector::Exact => intersect_exactly(&buffers, &ray_of(x)),
                rounded => intersect(&buffers, rounded, &ray_of(x), 0, &mut NoWork),
            };
            hits += usize::from(found.is_some());
            found.map_or([0.0; 4], |f| [1.0, f.t, f.u, f.v])
        })
        .collect();
    // Back faces are half of them.
    let least = if intersector == Intersector::Thesis { ITEMS } else { 2 * ITEMS };
    assert!(hits > least, "{intersector}: only {hits} hits");
    assert_same_bits(intersector.name(), INPUTS, &data, &run(&device, &body, INPUTS, 4, &data), &expected);
    if intersector == Intersector::Exact {
        // Its answers do not depend on the kind of numbers: devices without double give them, too.
        let float_only = CompileOptions::new().define("FLOAT_ONLY", 1);
        let found = run_with(&device, float_only, &body, INPUTS, 4, &data);
        assert_same_bits("exact without double", INPUTS, &data, &found, &expected);
    }
}

/// Every kind of procedural texture, in the world and in texture coordinates, placed by rows that keep borders where
/// they are, by random ones, and by nonsense.
#[test]
fn procedural_textures_equal_their_twins() {
    let Some(device) = device() else { return };
    let body = "const TextureInfo info = *(__global const TextureInfo*)in;
                vstore3(procedural_colour(&info, in[31], in[32], vload3(0, in + 28)), 0, out);";
    const INPUTS: usize = 36; // a texture, a position, texture coordinates, and three to align the next
    let kinds = [TEXTURE_CHECKER, TEXTURE_NOISE, TEXTURE_MARBLE, TEXTURE_WOOD];
    let mut random = Random::new(SEED);
    let (mut data, mut expected) = (Vec::new(), Vec::new());
    for i in 0..8 * ITEMS {
        let row = |axis: Vec3, random: &mut Random| match i / 8 % 4 {
            0 | 1 => Float4::new(axis, 0.0),
            2 => Float4::new(4.0 * random.vec3(), random.signed()),
            _ => Float4 { x: place(random), y: place(random), z: place(random), w: place(random) },
        };
        let info = TextureInfo {
            to_x: row(Vec3::X, &mut random),
            to_y: row(Vec3::Y, &mut random),
            to_z: row(Vec3::Z, &mut random),
            colour0_turbulence: Float4::new(random.vec3().abs(), 2.0 * random.signed()),
            colour1: Float4::new(random.vec3().abs(), 0.0),
            kind: kinds[i % 4],
            octaves: (random.bits() % 6) as u32,
            seed: random.bits() as u32,
            in_uv: (i / 4 % 2) as u32,
            ..TextureInfo::default()
        };
        let at = [(); 5].map(|()| place(&mut random));
        expected.extend(procedural_colour(&info, [at[3], at[4]], v3(&at)).to_array());
        data.extend_from_slice(bytemuck::cast_slice::<_, f32>(&[info]));
        data.extend(at);
        data.resize(INPUTS * (i + 1), 0.0);
    }
    assert!(expected.iter().all(|c| (0.0..=1.0).contains(c)), "a colour beyond its two");
    assert_same_bits("procedural_colour", INPUTS, &data, &run(&device, body, INPUTS, 3, &data), &expected);
}

/// Rays of every kind, depth and weight, through every place of the picture.
#[test]
fn roulette_equals_its_twin() {
    let Some(device) = device() else { return };
    let body = "__global const float* rest = in + sizeof(RenderParams) / sizeof(float);
                const CameraSample at = *(__global const CameraSample*)rest;
                Killing killing; begin_killing((__global const RenderParams*)in, hash_place(at), &killing);
                __global const uint* way = (__global const uint*)(rest + 6); float3 weight = vload3(0, rest + 3);
                out[0] = survives(&killing, way[0], way[1], &weight) ? 1.0f : 0.0f; vstore3(weight, 0, out + 1);
                out[4] = (float)(depth_of(next_depth(way[0], way[1])));";
    // The picture, a place in it, a weight, a depth, a kind.
    const INPUTS: usize = size_of::<RenderParams>() / size_of::<f32>() + 8;
    let mut random = Random::new(SEED);
    let (mut data, mut expected) = (Vec::<f32>::new(), Vec::new());
    for i in 0..4 * ITEMS {
        let roulette_weight = random.pick(&[1.0, 0.5, 1e-3, LEAST_ROULETTE]);
        let kill_weight = random.pick(&[0.0, 1e-4]);
        let params = RenderParams { kill_weight, roulette_weight, ..RenderParams::default() };
        let at = CameraSample { x: random.unit() * 4096.0, y: random.below(4096) as f32, footprint: 1.0 };
        let nonsense = random.any_float();
        let weight = random.pick(&[0.3, 1.0, 1e-3, 3.0]) * roulette_weight * v3(&[0.9, random.unit(), random.unit()]);
        let weight = if i % 16 == 0 { Vec3::splat(nonsense) } else { weight };
        let depth = (random.below(1 << 24) << RAY_DEPTH_BITS) as u32 | random.whole(1, 63) as u32;
        let kind = random.pick(&[RayKind::Reflected, RayKind::Refracted]);
        let killing = Killing::of_path(&params, at);
        let kept = killing.survives(depth, kind, weight);
        expected.push(flag(kept.is_some()));
        expected.extend(kept.unwrap_or(weight).to_array());
        expected.push(killing.depth(killing.next_depth(depth, kind)) as f32);
        data.extend_from_slice(bytemuck::cast_slice::<_, f32>(&[params]));
        data.extend([at.x, at.y, at.footprint, weight.x, weight.y, weight.z]);
        data.extend([f32::from_bits(depth), f32::from_bits(kind as u32)]);
    }
    let alive: f32 = expected.iter().step_by(5).sum();
    assert!((0.3..0.7).contains(&(alive / (4 * ITEMS) as f32)), "{alive} live");
    let found = run_with(&device, CompileOptions::new().define("ROULETTE", 1), body, INPUTS, 5, &data);
    assert_same_bits("survives", INPUTS, &data, &found, &expected);
}

/// With counted work and without. Few rays, for Oclgrind's sake: that every traversal stays within its arrays. Hits on
/// many rays are the business of `tests/methods/traverse.rs`.
#[test]
fn traversals_equal_their_twins() {
    let Some(device) = device() else { return };
    let mut random = Random::new(SEED);
    let scene = scene_of(&soup(60, 0.3, &mut random));
    let short = |size| {
        TraceOptions::of_kd(KdOptions {
            traversal: Traversal::ShortStack,
            stack_size: Some(size),
            ..KdOptions::DEFAULT
        })
    };
    let kd = Traversal::ALL.iter().map(|&traversal| TraceOptions::of_kd(KdOptions { traversal, ..KdOptions::DEFAULT }));
    let deep = kd.chain([short(1), short(2)]).map(|o| TraceOptions {
        structure: Structure::Kd(KdOptions { leaf_size: Some(1), max_depth: Some(20), ..o.kd() }),
        ..o
    });
    let others = StructureKind::ALL.iter().map(|&accel| TraceOptions::of(accel));
    let count = if on_oclgrind() { 60 } else { 200 };
    for (i, options) in deep.chain(others).enumerate() {
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let rays: Vec<_> = (0..count)
            .map(|i| {
                let from = 2.0 * random.vec3();
                // Some along an axis, which meet many cells and planes at infinity.
                let direction = if i % 4 == 0 { Vec3::NEG_X } else { random.vec3() - from };
                buffers.trace_ray(from, direction, 0.0, f32::INFINITY)
            })
            .collect();
        let job = TraceJob { extreme: &[], rays: &rays, next_directions: None, any_hit: false, repeat: 1 };
        // Each is a program to compile.
        for counters in usually_every(2, [i % 2 == 1, i % 2 == 0]) {
            let options = TraceOptions { counters, ..options };
            let got = open_tracer(Some(&device), &buffers, &options, 1, None).unwrap().trace(&job, &|_| ()).unwrap();
            let expected = open_tracer(None, &buffers, &options, 1, None).unwrap().trace(&job, &|_| ()).unwrap();
            assert_eq!(got.hits, expected.hits, "{options:?} (seed {SEED})");
            assert_eq!(got.work, expected.work, "{options:?} (seed {SEED})");
        }
    }
}

/// A tiny picture, for Oclgrind's sake, with rays of every kind, a texture, a second pass and more paths than are in
/// flight: that the wavefront kernels stay within their arrays and do not meet in them. Larger ones are the business of
/// `tests/pictures/wavefront.rs`.
#[test]
fn wavefront_kernels_equal_the_twin() {
    let Some(device) = device() else { return };
    let mut builder = Builder::new();
    let rgba = vec![[230, 220, 200, 255], [40, 60, 90, 255]];
    let diffuse_texture = Some(builder.add_texture(Image { name: "two".into(), width: 2, height: 1, rgba }));
    builder.material(Material { diffuse_texture, mirror: Vec3::splat(0.4), ..Material::matt(Vec3::ONE) });
    builder.quad(Vec3::new(-2.0, -2.0, -1.0), Vec3::X * 4.0, Vec3::Y * 4.0, 1);
    builder.material(Material { transmission: Vec3::new(0.9, 0.8, 0.7), ior: 1.5, ..Material::matt(Vec3::ZERO) });
    builder.quad(Vec3::new(-1.0, -1.0, 0.0), Vec3::X * 2.0, Vec3::Y * 2.0, 1);
    builder.material(Material::matt(Vec3::ONE));
    builder.quad(Vec3::new(-1.0, 0.0, 1.5), Vec3::X, Vec3::Y, 1); // in the light's way
    let mut scene = builder.finish().unwrap();
    scene.lights = vec![
        Light::point(Vec3::new(0.0, 1.0, 4.0), Vec3::splat(0.5)),
        Light::directional(Vec3::new(0.3, -0.2, -1.0), Vec3::splat(0.4)),
    ];
    scene.background = Background { bottom: Vec3::X, top: Vec3::Z };
    scene.sky = Some(Sky { top: Vec3::splat(0.2), bottom: Vec3::X * 0.1, viewer: Vec3::Y * 0.1, up: Vec3::ONE });
    // The ray in the middle meets the diagonal between two triangles. It is beside the axis by so little that only
    // exact integers tell so.
    let beside = Vec3::new(1e-20, 1e-20, 0.0);
    let camera = Camera { eye: Vec3::Z * 6.0 + beside, target: beside, up: Vec3::Y, fov_degrees: 50.0 };
    let picture = Picture { camera, size: (9, 7), samples: Samples::PerPixel(1), depth: 4, kill_weight: None };
    for textures in [TexturePass::InKernel, TexturePass::HostPass] {
        let options = TraceOptions {
            picture: PictureOptions {
                kernels: Kernels::Wavefront,
                textures,
                paths_in_flight: Some(40),
                ..PictureOptions::DEFAULT
            },
            ..TraceOptions::DEFAULT
        };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let rendered = [Some(&device), None].map(|device| {
            let mut tracer = open_tracer(device, &buffers, &options, picture.depth, None).unwrap();
            render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap()
        });
        assert!(rendered[1].counts.iter().all(|&count| count > 0), "{:?}", rendered[1].counts);
        assert_eq!(rendered[0].counts, rendered[1].counts, "{textures}");
        assert!(rendered[0].second_pass > Some(0), "{textures}");
        assert_eq!(rendered[0].film.pixels, rendered[1].film.pixels, "{textures}");
    }
}

#[test]
fn structs_have_the_same_layout_on_the_device() {
    let Some(device) = device() else { return };
    let mut body = String::new();
    let mut expected = Vec::new();
    for layout in SHARED_STRUCTS {
        writeln!(body, "out[{}] = (float)sizeof({});", expected.len(), layout.name).unwrap();
        expected.push(layout.size_bytes as f32);
        for field in layout.fields {
            let name = layout.name;
            writeln!(
                body,
                "{{ {name} probe; out[{}] = (float)((char*)&probe.{} - (char*)&probe); }}",
                expected.len(),
                field.name
            )
            .unwrap();
            expected.push(field.offset_bytes as f32);
        }
    }
    assert_eq!(run(&device, &body, 1, expected.len(), &[0.0]), expected);
    assert_eq!(size_of::<Float4>(), 16);
}
