//! What shading computes where arguments are at their limits, on a device and on its twin: total reflection, smooth
//! normals against their triangle, needles, lamps that touch a surface, texture coordinates without sense. Run a second
//! time under Oclgrind by `./test`. Whole pictures of such scenes are the business of `tests/scene/hostile.rs`.

use crate::common::probe::{assert_same_bits, run, v3};
use crate::common::{Random, SEED, device};
use glam::{DVec3, Vec2, Vec3};
use raybrook::low_level::bounds::EPSILON;
use raybrook::low_level::layout::Float4;
use raybrook::low_level::options::{KernelFeatures, Kernels, PictureOptions, Terminator, TexturePass, TraceOptions};
use raybrook::low_level::pack::SceneBuffers;
use raybrook::low_level::reference::shade::light::{blinn_phong, sample_light};
use raybrook::low_level::reference::shade::normal::{interpolated_normal, smooth_lift, triangle_normal};
use raybrook::low_level::reference::shade::surface::{Surface, SurfacePoint};
use raybrook::low_level::reference::shade::texture::wrap_texel;
use raybrook::low_level::reference::shade::whitted::{reflect_direction, refract_direction};
use raybrook::low_level::reference::shared::math::{dot3, normalize3};
use raybrook::low_level::renderer::{Picture, open_tracer, render};
use raybrook::low_level::scene::{Background, Builder, Camera, Image, Light, Material, Normals, Samples};
use raybrook::low_level::shared::{self, LIGHT_DIRECTIONAL, LIGHT_POINT, LIGHT_SPOT, MAX_RADIANCE};
use std::sync::Arc;

/// Work-items of most tests; few, because Oclgrind interprets them.
const ITEMS: usize = 512;

fn surface_with(geometric_normal: Vec3, normal: Vec3) -> Surface {
    Surface {
        point: SurfacePoint {
            position: Vec3::ZERO,
            position_low: Vec3::ZERO,
            weights: Vec3::ZERO,
            error: 0.0,
            primitive: 0,
        },
        geometric_normal,
        normal,
        lift: Vec3::ZERO,
        largest_coordinate: 0.0,
        texture_uv: [0.0; 2],
        material: 0,
        front: true,
    }
}

/// Finite numbers of every size, either sign.
fn finite(random: &mut Random) -> f32 {
    loop {
        let x = random.any_float();
        if x.is_finite() {
            return x;
        }
    }
}

/// Runs `body` on the device, if there is one, and compares with what the twin makes of the same inputs.
fn compare(name: &str, body: &str, inputs: usize, data: &[f32], twin: impl Fn(&[f32]) -> Vec<f32>) {
    let expected: Vec<f32> = data.chunks_exact(inputs).flat_map(twin).collect();
    let Some(device) = device() else { return };
    let outputs = expected.len() / (data.len() / inputs);
    assert_same_bits(name, inputs, data, &run(&device, body, inputs, outputs, data), &expected);
}

// ---- reflection and refraction
// -----------------------------------------------------------------------------------------------

const DIRECTIONS: &str = "Surface surface; surface.geometric_normal = vload3(0, in); surface.normal = vload3(1, in);\
     float3 d = vload3(2, in); Refraction r = refract_direction(&surface, d, in[9]);\
     out[0] = r.reflectance; vstore3(r.direction, 0, out + 1); vstore3(reflect_direction(&surface, d), 0, out + 4);";

/// Geometric normal, normal, unit direction against the geometric normal, and eta.
fn compare_directions(name: &str, data: &[f32], check: impl Fn(&Surface, Vec3, f32, f32, Vec3, Vec3)) {
    compare(name, DIRECTIONS, 10, data, |x| {
        let (surface, direction) = (surface_with(v3(x), v3(&x[3..])), v3(&x[6..]));
        let refraction = refract_direction(&surface, direction, x[9]);
        let reflected = reflect_direction(&surface, direction);
        assert!((0.0..=1.0).contains(&refraction.reflectance), "{x:?}: {refraction:?}");
        assert!(refraction.direction.is_finite() && reflected.is_finite(), "{x:?}: {refraction:?}, {reflected}");
        check(&surface, direction, x[9], refraction.reflectance, refraction.direction, reflected);
        let mut out = vec![refraction.reflectance];
        out.extend(refraction.direction.to_array());
        out.extend(reflected.to_array());
        out
    });
}

/// sin^2 of the refracted ray as the kernel computes it.
fn sin2_out(normal: Vec3, direction: Vec3, eta: f32) -> f32 {
    let along = raybrook::low_level::reference::shared::math::fma3(normal, -dot3(normal, direction), direction);
    eta * eta * dot3(along, along)
}

/// Within 4 ulp of sin^2 = 1, on both sides of it, for indices from glass to nonsense.
#[test]
fn total_reflection_begins_without_nonsense() {
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    let (mut near, mut total) = (0, 0);
    let etas = [1.0 + 2.0 * EPSILON, 1.000001, 1.5, 1.33, 2.42, 10.0, 1e3, 1e6, 1e12];
    for i in 0..ITEMS {
        let eta: f32 = etas[i % etas.len()];
        let normal = normalize3(random.vec3(), Vec3::Z);
        let across = normalize3(normal.cross(random.vec3()), Vec3::X);
        // The sine of the critical angle, and floats around it until sin^2 as computed is as near to 1 as asked for.
        let mut best = (f32::INFINITY, Vec3::ZERO);
        let wanted = (i / etas.len() % 9) as f32 - 4.0; // ulp from 1
        for k in -200..200 {
            let sine = (1.0 / f64::from(eta)) * (1.0 + f64::from(k) * f64::from(EPSILON) / 2.0);
            let cosine = (1.0 - sine * sine).max(0.0).sqrt();
            let direction = (across.as_dvec3() * sine - normal.as_dvec3() * cosine).as_vec3();
            let off = ((sin2_out(normal, direction, eta) - 1.0) / EPSILON - wanted).abs();
            if off < best.0 {
                best = (off, direction);
            }
        }
        let sin2 = sin2_out(normal, best.1, eta);
        near += usize::from((sin2 - 1.0).abs() <= 8.0 * EPSILON);
        total += usize::from(sin2 >= 1.0);
        data.extend(normal.to_array());
        data.extend(normal.to_array());
        data.extend(best.1.to_array());
        data.push(eta);
    }
    assert!(near > ITEMS / 2 && total > ITEMS / 8 && total < ITEMS, "{near} near, {total} total");
    compare_directions("at total reflection", &data, |surface, _, eta, reflectance, refracted, _| {
        if reflectance < 1.0 && eta < 100.0 {
            // It leaves along the surface: sin = 1 to within 2^-12 and the roundings.
            assert!(dot3(refracted, surface.normal) <= 0.0 && (refracted.length() - 1.0).abs() < 16.0 * eta * EPSILON);
        }
    });
}

/// Every kind of eta and of direction: against the normal, grazing, along it, of other lengths than 1, tiny and huge.
#[test]
fn refraction_is_defined_for_every_finite_argument() {
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    for i in 0..4 * ITEMS {
        let geometric = normalize3(random.vec3(), Vec3::Z);
        let normal = match i % 3 {
            0 => geometric,
            _ => normalize3(geometric + random.vec3(), geometric),
        };
        let normal = if dot3(normal, geometric) < 0.0 { -normal } else { normal };
        let across = normalize3(normal.cross(random.vec3()), Vec3::X);
        let direction = match random.below(6) {
            0 => -normal,
            1 => across,
            2 => normalize3(across - normal * random.size(-30, -20), across),
            3 => random.vec3() * random.size(-140, 20),
            _ => normalize3(random.vec3(), -normal),
        };
        let direction = if dot3(direction, geometric) > 0.0 { -direction } else { direction };
        let eta = match random.below(3) {
            0 => random.pick(&[0.0, 1e-45, 1e-30, 1e-6, 1.0, 1e6, 1e19, 2e19, 1e30, f32::MAX, f32::INFINITY, f32::NAN]),
            1 => finite(&mut random).abs(),
            _ => 0.3 + 2.0 * random.unit(),
        };
        data.extend([geometric, normal, direction].iter().flat_map(|v| v.to_array()));
        data.push(eta);
    }
    compare_directions("any refraction", &data, |surface, direction, eta, reflectance, refracted, reflected| {
        if eta == 1.0 {
            assert_eq!((reflectance, refracted), (0.0, direction), "nothing changes");
        }
        if (direction.length() - 1.0).abs() > 1e-6 {
            return;
        }
        // Neither ends on the wrong side, but for the roundings of three products.
        assert!(dot3(reflected, surface.geometric_normal) > -8.0 * EPSILON, "{direction}: {reflected}");
        if reflectance < 1.0 && eta < 100.0 {
            let size = 16.0 * eta.max(1.0) * EPSILON;
            assert!(dot3(refracted, surface.geometric_normal) < size, "{direction}: {refracted}");
            assert!((refracted.length() - 1.0).abs() < size, "{direction}, {eta}: {refracted}");
        }
    });
}

/// Where the smooth normal would begin to send the reflection through the triangle there is no jump.
#[test]
fn reflections_change_smoothly_where_they_meet_the_triangle() {
    let surface = surface_with(Vec3::Z, Vec3::new(0.6, 0.0, 0.8));
    let direction = |step: u32| {
        let angle = step as f32 * 1e-3;
        Vec3::new(angle.cos(), 0.2, -angle.sin()).normalize()
    };
    let mut mirrored = 0;
    for step in 1..1500 {
        let [a, b] = [step, step + 1].map(|step| reflect_direction(&surface, direction(step)));
        // A mirror turns no direction by more than that itself turns, which is by a thousandth.
        assert!((a - b).length() < 1.01e-3 && a.z >= 0.0, "step {step}: from {a} to {b}");
        let without = direction(step) - 2.0 * direction(step).dot(surface.normal) * surface.normal;
        mirrored += usize::from(without.z < 0.0);
    }
    assert!((100..1400).contains(&mirrored), "{mirrored}");
}

// ---- normals
// -----------------------------------------------------------------------------------------------------------------

/// The normal in f64; differences of coordinates within 2^29 of each other are exact there.
fn exact_normal([p0, p1, p2]: [Vec3; 3]) -> (DVec3, f64) {
    let (edge1, edge2) = (p1.as_dvec3() - p0.as_dvec3(), p2.as_dvec3() - p0.as_dvec3());
    let cross = edge1.normalize().cross(edge2.normalize());
    (cross.normalize(), cross.length())
}

/// Needles down to angles of 2^-40, far from the origin and near it, and specks of every size.
#[test]
fn normals_of_needles_and_specks_are_right() {
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    while data.len() < 9 * 4 * ITEMS {
        // Down to the least size at which doubling the coordinates changes no bit.
        let unit = random.size(-60, 40);
        let center = random.vec3() * random.pick(&[0.0, 1.0, 100.0]);
        let long = random.vec3();
        let width = random.size(-30, 0);
        let triangle = [center, center + long, center + long * random.unit() + random.vec3() * width].map(|p| p * unit);
        data.extend(triangle.iter().flat_map(|p| p.to_array()));
    }
    let mut thin = 0;
    for x in data.chunks_exact(9) {
        let triangle = [v3(x), v3(&x[3..]), v3(&x[6..])];
        let (exact, sine) = exact_normal(triangle);
        if sine.is_nan() || sine <= 1e-12 {
            continue;
        }
        thin += usize::from(sine < 1e-6);
        let epsilon = f64::from(EPSILON);
        let bound = 8.0 * epsilon + 48.0 * epsilon * epsilon / sine;
        let off = (triangle_normal(triangle).as_dvec3() - exact).length();
        assert!(off <= bound, "off by {off:e}, allowed {bound:e}, of a needle with {sine:e}: {triangle:?}");
    }
    assert!(thin > 100, "{thin}");
    // Beyond all that has a normal in f64: it is a unit vector all the same, or zero.
    for i in 0..ITEMS {
        let size = [1e-45, 1e-38, 1e-30, 1e30][i % 4];
        data.extend((0..9).map(|_| random.signed() * size));
        data.extend((0..9).map(|_| if random.below(4) > 0 { 0.5 } else { random.any_float() }));
    }
    let body = "vstore3(triangle_normal(vload3(0, in), vload3(1, in), vload3(2, in)), 0, out);";
    compare("triangle_normal", body, 9, &data, |x| {
        let normal = triangle_normal([v3(x), v3(&x[3..]), v3(&x[6..])]);
        assert!(normal == Vec3::ZERO || (normal.length() - 1.0).abs() < 4.0 * EPSILON, "{x:?}: {normal}");
        normal.to_array().to_vec()
    });
    // Sixteen at a time, where that is sure of them; which it is of most, and says so behind the normals.
    let body = "float16 corners[9], normals[3];\
                for (uint i = 0; i < 9 * 16; i++) set_lane16(&corners[i % 9], i / 9, in[i]);\
                const int16 is_sure = triangle_normals(corners, corners + 3, corners + 6, normals);\
                const ulong sure = lanes_where16(is_sure);\
                out[48] = (float)count_lanes16(sure);\
                for (uint i = 0; i < 16; i++) {\
                    const bool is_known = (sure & lane_bit16(i)) != 0ul;\
                    const float3 one = triangle_normal(vload3(3 * i, in), vload3(3 * i + 1, in), \
                                                          vload3(3 * i + 2, in));\
                    vstore3(is_known ? three_of_lane(normals, i) : one, i, out);\
                }";
    let Some(device) = device() else { return };
    let got = run(&device, body, 9 * 16, 49, &data);
    let sure: f32 = got.chunks_exact(49).map(|out| out[48]).sum();
    assert!(sure > 0.6 * data.len() as f32 / 9.0, "{sure}");
    let normals: Vec<f32> = got.chunks_exact(49).flat_map(|out| &out[..48]).copied().collect();
    let normal = |x: &[f32]| triangle_normal([v3(x), v3(&x[3..]), v3(&x[6..])]).to_array();
    let expected: Vec<f32> = data.chunks_exact(9).flat_map(normal).collect();
    assert_same_bits("triangle_normals", 9 * 16, &data, &normals, &expected);
}

/// Zeros, opposite normals and all that cancels to noise: the geometric normal.
#[test]
fn normals_without_direction_are_the_geometric_one() {
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    for i in 0..2 * ITEMS {
        let mut unit = || normalize3(random.vec3(), Vec3::X);
        let (a, b) = (unit(), unit());
        let geometric = unit();
        // Weights of which two are equal: in the middle of an edge, where its normals cancel.
        let (u, normals) = match i % 4 {
            0 => (0.5, [a, -a, b]),
            1 => (0.5, [Vec3::ZERO; 3]),
            2 => (0.25, [a, b, -a]),
            _ => (random.unit(), [a, b, geometric]),
        };
        let v = if i % 4 < 2 { 0.0 } else { (1.0 - u) * random.unit() };
        data.extend(normals.iter().flat_map(|n| n.to_array()));
        data.extend([(1.0 - u) - v, u, v]);
        data.extend(geometric.to_array());
    }
    let body = "vstore3(interpolated_normal(vload3(0, in), vload3(1, in), vload3(2, in), \
                in[9], in[10], in[11], vload3(4, in)),\
                0, out);";
    compare("interpolated_normal", body, 15, &data, |x| {
        let geometric = v3(&x[12..]);
        let normal = interpolated_normal([v3(x), v3(&x[3..]), v3(&x[6..])], [x[9], x[10], x[11]], geometric);
        assert!((normal.length() - 1.0).abs() < 4.0 * EPSILON && dot3(normal, geometric) >= 0.0, "{x:?}: {normal}");
        if x[11] == 0.0 && v3(x) == -v3(&x[3..]) {
            assert_eq!(normal, geometric, "{x:?}");
        }
        normal.to_array().to_vec()
    });
}

// ---- light
// -------------------------------------------------------------------------------------------------------------------

/// The height of the smooth surface: nothing where normals are flat, at the vertices and where the mesh is hollow; that
/// of the ideal sphere, to second order, on a triangle of it.
#[test]
fn shadow_rays_start_where_the_normals_claim_the_surface() {
    let lift = |x: &[f32]| {
        let normals = [v3(&x[6..]), v3(&x[9..]), v3(&x[12..])];
        smooth_lift(v3(x), v3(&x[3..]), normals, [x[15], x[16], x[17]], v3(&x[18..]))
    };
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    for i in 0..2 * ITEMS {
        let near = random.direction();
        let corners = [(); 3].map(|()| normalize3(near + 0.2 * random.vec3(), near));
        let [p0, p1, p2] = if i % 4 == 3 { [(); 3].map(|()| random.vec3() * 1e6) } else { corners };
        let normals = match i % 4 {
            0 => [Vec3::ZERO; 3],
            1 => corners,
            2 => corners.map(|n| -n),
            _ => [(); 3].map(|()| normalize3(random.vec3(), Vec3::X)),
        };
        let mut geometric = triangle_normal([p0, p1, p2]);
        // The outside of the ball, but for a few of its inside.
        if i % 16 != 1 && dot3(geometric, near) < 0.0 {
            geometric = -geometric;
        }
        let (a, b) = (random.unit(), random.unit());
        let (u, v) = if a + b > 1.0 { (1.0 - a, 1.0 - b) } else { (a, b) };
        let [u, v] = if i % 32 == 5 { [0.0, 1.0] } else { [u, v] };
        let x = [p1 - p0, p2 - p0, normals[0], normals[1], normals[2], Vec3::new((1.0 - u) - v, u, v), geometric];
        data.extend(x.iter().flat_map(|v| v.to_array()));
        let [point, lifted] = [p0 + (p1 - p0) * u + (p2 - p0) * v, lift(&data[21 * i..])];
        assert!(lifted.is_finite() && dot3(lifted, geometric) >= -1e-6 * lifted.length(), "{i}: {lifted}");
        match i % 4 {
            0 => assert_eq!(lifted, Vec3::ZERO),
            1 | 2 if dot3(geometric, near) > 0.0 => {
                // As near to the ball as the triangle, or nearer: no start is far above what the normals claim.
                let depth = 1.0 - point.length();
                let left = 1.0 - (point + lifted).length();
                assert!(left.abs() <= depth + 1e-6, "{i}: {left} of {depth}");
            }
            // On the inside the ball is hollow: the triangle is nearer than the ball.
            1 | 2 => assert!(lifted.length() < 1e-6, "{i}: {lifted}"),
            _ => {}
        }
        if u == 0.0 && v == 1.0 {
            assert!(lifted.length() < 1e-6, "{i}: {lifted}");
        }
    }
    let body = "vstore3(smooth_lift(vload3(0, in), vload3(1, in), vload3(2, in), vload3(3, in), vload3(4, in), \
                in[15], in[16],\
                in[17], vload3(6, in)), 0, out);";
    compare("smooth_lift", body, 21, &data, |x| lift(x).to_array().to_vec());
}

/// The dark steps that light ends in on a coarse ball under a light from the side: every pixel that is dark though its
/// smooth normal faces the light.
#[test]
fn light_ends_smoothly_on_coarse_balls() {
    let dark = |terminator: Terminator| {
        let mut builder = Builder::new();
        builder.material(Material { ambient: Vec3::ZERO, ..Material::matt(Vec3::ONE) });
        builder.sphere(1.0, 24).light(Light::directional(Vec3::new(-1.0, -0.3, -0.2), Vec3::ONE));
        builder.background(Background { bottom: Vec3::ZERO, top: Vec3::ZERO });
        let scene = builder.finish().unwrap();
        let options =
            TraceOptions { picture: PictureOptions { terminator, ..PictureOptions::DEFAULT }, ..TraceOptions::DEFAULT };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let camera = Camera { eye: Vec3::Z * 1e3, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 0.1 };
        let size = (100, 100);
        let picture = Picture { camera, size, samples: Samples::PerPixel(1), depth: 1, kill_weight: None };
        let mut tracer = open_tracer(None, &buffers, &options, 1, None).unwrap();
        let film = render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap().film;
        let half = 1e3 * 0.05f32.to_radians().tan();
        let to_light = Vec3::new(1.0, 0.3, 0.2).normalize();
        let mut wrong = 0;
        for (i, pixel) in film.pixels.iter().enumerate() {
            let (x, y) = ((i as u32 % size.0) as f32 + 0.5, (i as u32 / size.0) as f32 + 0.5);
            let (x, y) = ((x / 50.0 - 1.0) * half, (1.0 - y / 50.0) * half);
            let z2 = 0.9 - x * x - y * y; // away from the outline
            let normal = Vec3::new(x, y, (z2.max(0.0) + 0.1).sqrt());
            // The normals of a mesh of 24 segments are those of the ball to within a degree.
            wrong += usize::from(z2 > 0.0 && normal.dot(to_light) > 0.02 && pixel[0] == 0.0);
        }
        wrong
    };
    let (smooth, hard) = (dark(Terminator::Smooth), dark(Terminator::Hard));
    println!("dark pixels: smooth {smooth}, hard {hard}");
    assert!(hard > 50 && smooth * 20 < hard, "smooth {smooth}, hard {hard}");
}

/// Lamps in the very point, just beside it and at the end of all numbers; colours and exponents likewise.
#[test]
fn light_is_a_number_whatever_lamp_and_material_are() {
    let mut random = Random::new(SEED);
    let colour = |random: &mut Random| {
        let sizes = [0.0, 1e-45, 1e-19, 1.0, 1e19, MAX_RADIANCE];
        Float4 { x: random.pick(&sizes), y: random.pick(&sizes), z: random.pick(&sizes), w: 0.0 }
    };
    const LIGHT: usize = size_of::<shared::Light>() / 4;
    const MATERIAL: usize = size_of::<shared::Material>() / 4;
    const INPUTS: usize = LIGHT + MATERIAL + 16;
    let mut data: Vec<f32> = Vec::new();
    let mut brightest = 0;
    for i in 0..4 * ITEMS {
        let position = random.vec3() * 1e6;
        let place = match i % 4 {
            0 => position,
            1 => position + random.vec3() * random.size(-149, -10),
            2 => Vec3::from([(); 3].map(|()| finite(&mut random))),
            _ => random.vec3() * 3e6,
        };
        let mut intensity = colour(&mut random);
        if i % 8 == 0 {
            intensity.y = f32::MAX;
        }
        let cos_outer = random.pick(&[0.0, 0.5, 1f32.next_down().next_down()]);
        let light = shared::Light {
            position: Float4::new(place, 0.0),
            direction: Float4::new(normalize3(random.vec3(), Vec3::X), 0.0),
            intensity,
            kind: random.pick(&[LIGHT_POINT, LIGHT_DIRECTIONAL, LIGHT_SPOT]),
            falloff_scale: random.pick(&[0.0, 1.0, 2f32.powi(-126), 2f32.powi(20), 2f32.powi(127)]),
            cos_inner: cos_outer.next_up().max(random.unit()),
            cos_outer,
        };
        let material = shared::Material {
            specular_shininess: Float4 { w: random.pick(&[0.0, 1e-45, 1.0, 10_000.0]), ..colour(&mut random) },
            toon_steps: random.pick(&[0, 0, 1, 255]),
            toon_threshold: random.pick(&[0.0, 1f32.next_down()]),
            ..shared::Material::default()
        };
        let geometric = normalize3(random.vec3(), Vec3::Z);
        let normal = if i % 3 == 0 { geometric } else { normalize3(geometric * 1.8 + random.vec3(), geometric) };
        let view = normalize3(random.vec3(), Vec3::Z);
        data.extend_from_slice(bytemuck::cast_slice::<_, f32>(&[light]));
        data.extend_from_slice(bytemuck::cast_slice::<_, f32>(&[material]));
        let diffuse = Vec3::new(colour(&mut random).x, colour(&mut random).y, 0.5);
        data.extend([position, geometric, normal, view, diffuse].iter().flat_map(|v| v.to_array()));
        data.push(0.0);
    }
    let body = format!(
        "LightSample sample = sample_light((__global const Light*)in, 0u, vload3(0, in + {at}));\
         Material material = *(__global const Material*)(in + {LIGHT});\
         Surface surface; surface.geometric_normal = vload3(1, in + {at}); surface.normal = vload3(2, in + {at}); \
         surface.lift = (float3)(0.0f);\
         vstore3(blinn_phong(&surface, &material, vload3(4, in + {at}), vload3(3, in + {at}), &sample, 0), 0, out);\
         vstore3(sample.to_light, 0, out + 3); vstore3(sample.direction, 0, out + 6); \
         vstore3(sample.radiance, 0, out + 9);\
         out[12] = sample.t_far;",
        at = LIGHT + MATERIAL
    );
    for x in data.chunks_exact(INPUTS) {
        let light: shared::Light = bytemuck::pod_read_unaligned(bytemuck::cast_slice(&x[..LIGHT]));
        let sample = sample_light(&light, v3(&x[LIGHT + MATERIAL..]));
        assert!(sample.radiance.is_finite() && sample.direction.is_finite(), "{light:?}: {sample:?}");
        brightest += usize::from(sample.radiance.max_element() == MAX_RADIANCE);
    }
    assert!(brightest > 50, "{brightest} lamps too bright for a number");
    compare("sample_light, blinn_phong", &body, INPUTS, &data, |x| {
        let light: shared::Light = bytemuck::pod_read_unaligned(bytemuck::cast_slice(&x[..LIGHT]));
        let material: shared::Material =
            bytemuck::pod_read_unaligned(bytemuck::cast_slice(&x[LIGHT..LIGHT + MATERIAL]));
        let at = &x[LIGHT + MATERIAL..];
        let sample = sample_light(&light, v3(at));
        let surface = surface_with(v3(&at[3..]), v3(&at[6..]));
        let light = blinn_phong(&surface, &material, v3(&at[12..]), v3(&at[9..]), &sample);
        assert!(light.is_finite() && light.min_element() >= 0.0, "{sample:?} {material:?}: {light}");
        let mut out = Vec::new();
        for v in [light, sample.to_light, sample.direction, sample.radiance] {
            out.extend(v.to_array());
        }
        out.push(sample.t_far);
        out
    });
}

// ---- textures
// ----------------------------------------------------------------------------------------------------------------

/// Any bits as texture coordinate: two texels that exist, next to each other, and a weight between them.
#[test]
fn texture_coordinates_without_sense_meet_texels_that_exist() {
    let mut random = Random::new(SEED);
    let mut data = Vec::new();
    for i in 0..8 * ITEMS {
        let whole = (random.bits() % 9) as f32 - 4.0;
        let t = match i % 8 {
            0..3 => random.any_float(),
            3 => random.pick(&[f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -f32::MAX, -1e-45, 1e-45, -0.0]),
            4 => whole.next_down(),
            5 => whole.next_up(),
            6 => whole,
            _ => random.signed() * 4.0,
        };
        data.extend([t, random.pick(&[1.0, 2.0, 3.0, 255.0, 16_384.0])]);
    }
    let body = "uint low, high; out[0] = wrap_texel(in[0], (uint)in[1], &low, &high);\
                out[1] = (float)low; out[2] = (float)high;";
    compare("wrap_texel", body, 2, &data, |x| {
        let size = x[1] as u32;
        let (low, high, weight) = wrap_texel(x[0], size);
        assert!(low < size && high < size && high == (low + 1) % size, "{x:?}: {low}, {high}");
        assert!((0.0..=1.0).contains(&weight), "{x:?}: {weight}");
        if !x[0].is_finite() {
            assert_eq!((low, high, weight), wrap_texel(0.0, size));
        }
        vec![weight, low as f32, high as f32]
    });
}

/// A tiny picture with a texture at the end of all texels: no texel is read that does not exist (Oclgrind
/// sees to that), no pixel is without a number.
#[test]
fn pictures_with_texture_coordinates_without_sense_are_numbers() {
    let mut random = Random::new(SEED);
    let mut builder = Builder::new();
    let rgba = (0..6u8).map(|i| [40 * i, 255 - 40 * i, 20 * i, 255]).collect();
    let diffuse_texture = Some(builder.add_texture(Image { name: "six".into(), width: 2, height: 3, rgba }));
    builder.material(Material { diffuse_texture, ..Material::matt(Vec3::ONE) });
    let n = 5;
    let positions: Vec<_> = (0..n * n).map(|i| Vec3::new((i % n) as f32 - 2.0, (i / n) as f32 - 2.0, 0.0)).collect();
    let nonsense = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -f32::MAX, 1e30, -1e-45, 0.5];
    let uvs: Vec<_> = positions.iter().map(|_| Vec2::new(random.pick(&nonsense), random.pick(&nonsense))).collect();
    let cells = (0..n - 1).flat_map(|y| (0..n - 1).map(move |x| (y * n + x) as u32));
    let triangles: Vec<_> = cells.flat_map(|i| [[i, i + 1, i + 6], [i, i + 6, i + 5]]).collect();
    builder.mesh(&positions, Normals::Flat, &uvs, &triangles);
    builder.ambient(Vec3::ONE);
    let scene = builder.finish().unwrap();
    let camera = Camera { eye: Vec3::Z * 5.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 30.0 };
    let picture = Picture { camera, size: (16, 12), samples: Samples::PerPixel(1), depth: 1, kill_weight: None };
    // The wavefront kernels, which Oclgrind runs; tests/scene/hostile.rs has both. With all features, as those of
    // tests/pictures/wavefront.rs.
    for textures in [TexturePass::InKernel, TexturePass::HostPass] {
        let options = TraceOptions {
            picture: PictureOptions {
                kernels: Kernels::Wavefront,
                textures,
                features: KernelFeatures::All,
                ..PictureOptions::DEFAULT
            },
            ..TraceOptions::DEFAULT
        };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let rendered = |device: Option<&_>| {
            let mut tracer = open_tracer(device, &buffers, &options, 1, None).unwrap();
            render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap()
        };
        let expected = rendered(None);
        assert_eq!((expected.film.non_finite(), expected.counts[1]), (0, 16 * 12));
        if let Some(device) = device() {
            assert_eq!(rendered(Some(&device)).film.pixels, expected.film.pixels, "{textures}");
        }
    }
}

/// Where normals are flat nothing is lifted: the same pixels and rays, to the last bit.
#[test]
fn flat_scenes_do_not_depend_on_the_terminator() {
    let path = crate::common::root().join("scenes/cornell.toml");
    let scene = raybrook::low_level::scene::load(path).unwrap();
    let [smooth, hard] = [Terminator::Smooth, Terminator::Hard].map(|terminator| {
        let options =
            TraceOptions { picture: PictureOptions { terminator, ..PictureOptions::DEFAULT }, ..TraceOptions::DEFAULT };
        let buffers = Arc::new(SceneBuffers::new(&scene, &options).unwrap());
        let (camera, samples) = (scene.camera.unwrap(), Samples::PerPixel(1));
        let picture = Picture { camera, size: (64, 48), samples, depth: 6, kill_weight: None };
        let mut tracer = open_tracer(None, &buffers, &options, picture.depth, None).unwrap();
        render(tracer.as_mut(), &buffers, &picture, &|_| ()).unwrap()
    });
    assert_eq!((smooth.film.pixels, smooth.counts), (hard.film.pixels, hard.counts));
}
