//! The builder: solids are closed, face outwards and have the volume they should; transforms and materials persist.

use glam::{Affine3A, DAffine3, DVec3, Mat3A, Vec2, Vec3, Vec3A};
use raybrook::Error;
use raybrook::low_level::scene::{
    Builder, Camera, DropReason, Light, LightKind, MAX_SEGMENTS, Material, NO_INDEX, Normals, Pattern, Primitive,
    Procedural, Scene, Toon,
};
use std::collections::HashMap;
use std::f64::consts::PI;

/// Segments of the solids under test: even and odd, few and many.
const SEGMENTS: [u32; 4] = [3, 4, 7, 64];

fn build(calls: impl FnOnce(&mut Builder)) -> Scene {
    let mut builder = Builder::new();
    calls(&mut builder);
    builder.finish().expect("the scene is proper")
}

fn fault(calls: impl FnOnce(&mut Builder)) -> String {
    let mut builder = Builder::new();
    calls(&mut builder);
    match builder.finish() {
        Err(Error::Scene(message)) => message,
        other => panic!("expected a fault, got {other:?}"),
    }
}

fn corners(scene: &Scene, primitive: usize) -> [DVec3; 3] {
    scene.vertices(primitive).map(|p| p.as_dvec3())
}

/// The volume that the triangles enclose when they are counter-clockwise seen from outside.
fn signed_volume(scene: &Scene) -> f64 {
    (0..scene.triangles.len()).map(|i| corners(scene, i)).map(|[a, b, c]| a.cross(b).dot(c) / 6.0).sum()
}

fn area(scene: &Scene) -> f64 {
    (0..scene.triangles.len()).map(|i| corners(scene, i)).map(|[a, b, c]| (b - a).cross(c - a).length() / 2.0).sum()
}

/// Fails unless each directed edge occurs once and its opposite once: closed, and oriented alike everywhere.
fn assert_closed(scene: &Scene, what: &str) {
    let mut edges: HashMap<(u32, u32), u32> = HashMap::new();
    for t in &scene.triangles {
        for k in 0..3 {
            *edges.entry((t.positions[k], t.positions[(k + 1) % 3])).or_default() += 1;
        }
    }
    for (&(a, b), &count) in &edges {
        assert_eq!(count, 1, "{what}: edge {a}-{b} occurs {count} times in one direction");
        assert_eq!(edges.get(&(b, a)), Some(&1), "{what}: edge {a}-{b} has no neighbour");
    }
}

/// Fails unless every normal is of unit length and on its triangle's outside, and every triangle can be hit.
fn assert_normals(scene: &Scene, what: &str) {
    for (i, t) in scene.triangles.iter().enumerate() {
        assert_eq!(scene.drop_reason(i), None, "{what}: triangle {i}");
        let [a, b, c] = corners(scene, i);
        let geometric = (b - a).cross(c - a).normalize();
        for &n in t.normals.iter().filter(|&&n| n != NO_INDEX) {
            let normal = scene.normals[n as usize].as_dvec3();
            // Rounding the three components moves the length by at most sqrt(3)/2 ulp(1).
            assert!((normal.length() - 1.0).abs() <= f64::from(f32::EPSILON), "{what}: |{normal}|");
            assert!(normal.dot(geometric) > 0.0, "{what}: triangle {i} has a normal {normal} on its inside");
        }
    }
}

/// The area of the regular n-gon in the unit circle.
fn polygon(n: u32) -> f64 {
    f64::from(n) / 2.0 * (2.0 * PI / f64::from(n)).sin()
}

/// The volume between two similar sections of areas a and b at distance h.
fn frustum_volume(a: f64, b: f64, h: f64) -> f64 {
    h / 3.0 * (a + b + (a * b).sqrt())
}

/// The exact volume of the polyhedron that `sphere(1, n)` is: a stack of frustums of n-gons.
fn sphere_volume(n: u32) -> f64 {
    let rings = (n / 2).max(2);
    let angle = |j: u32| PI * f64::from(j) / f64::from(rings);
    let section = |j: u32| polygon(n) * angle(j).sin().powi(2);
    (0..rings).map(|j| frustum_volume(section(j), section(j + 1), angle(j).cos() - angle(j + 1).cos())).sum()
}

/// The exact volume of `torus(2, 0.5, n, sides)`: each of the n wedges between two copies of the tube's section (an
/// m-gon of area A, at distance rho from the axis) holds the integral of sin(2 pi/n) rho over A, and rho's mean is the
/// major radius.
fn torus_volume(n: u32, sides: u32) -> f64 {
    f64::from(n) * (2.0 * PI / f64::from(n)).sin() * 2.0 * 0.25 * polygon(sides)
}

/// Name, how to build it, triangles, volume of the polyhedron, volume of the ideal solid.
type ClosedSolid = (&'static str, fn(&mut Builder, u32), fn(u32) -> u32, fn(u32) -> f64, f64);

const CLOSED: [ClosedSolid; 6] = [
    ("sphere", |b, n| _ = b.sphere(1.0, n), |n| 2 * n * ((n / 2).max(2) - 1), sphere_volume, 4.0 / 3.0 * PI),
    ("box", |b, _| _ = b.cuboid(Vec3::new(1.0, 2.0, 3.0)), |_| 12, |_| 6.0, 6.0),
    ("cylinder", |b, n| _ = b.cylinder(1.0, 3.0, n), |n| 4 * n, |n| 3.0 * polygon(n), 3.0 * PI),
    ("cone", |b, n| _ = b.cone(1.0, 3.0, n), |n| 2 * n, |n| polygon(n), PI),
    (
        "frustum",
        |b, n| _ = b.frustum(0.5, 1.0, 3.0, n, true),
        |n| 4 * n,
        |n| frustum_volume(0.25, 1.0, 3.0) * polygon(n),
        1.75 * PI,
    ),
    ("torus", |b, n| _ = b.torus(2.0, 0.5, n, n + 1), |n| 2 * n * (n + 1), |n| torus_volume(n, n + 1), PI * PI),
];

#[test]
fn solids_are_closed_and_face_outwards() {
    for (name, add, triangles, volume, ideal) in CLOSED {
        for n in SEGMENTS {
            let what = format!("{name}, {n} segments");
            let scene = build(|b| add(b, n));
            assert_eq!(scene.triangles.len(), triangles(n) as usize, "{what}");
            assert_closed(&scene, &what);
            assert_normals(&scene, &what);
            // Each coordinate is rounded once: the volume moves by less than area times the largest coordinate's half
            // ulp in each of three directions; coordinates are below 4, whose half ulp is 2^-23.
            let tolerance = 3.0 * area(&scene) * 2.0f64.powi(-23);
            let found = signed_volume(&scene);
            assert!(
                (found - volume(n)).abs() <= tolerance,
                "{what}: volume {found}, expected {} +- {tolerance}",
                volume(n)
            );
            // An inscribed n-gon lacks 1 - sin(x)/x < x²/6 of its circle, x = 2 pi/n; a solid at most two such in a
            // row, and for the sphere's halved number of rings four times as much in the other direction.
            let lacking = 5.0 * (2.0 * PI / f64::from(n)).powi(2) / 6.0;
            assert!(
                found <= ideal + tolerance && found >= ideal * (1.0 - lacking) - tolerance,
                "{what}: {found} of {ideal}"
            );
        }
    }
}

#[test]
fn open_surfaces_have_their_area_and_face_their_side() {
    let slope: fn(f32, f32) -> f32 = |x, z| x + 2.0 * z;
    type Open = (&'static str, Box<dyn Fn(&mut Builder)>, usize, f64, DVec3);
    let cases: [Open; 5] = [
        ("disc", Box::new(|b| _ = b.disc(0.0, 2.0, 9)), 9, 4.0 * polygon(9), DVec3::Y),
        ("ring", Box::new(|b| _ = b.disc(1.0, 2.0, 9)), 18, 3.0 * polygon(9), DVec3::Y),
        ("quad", Box::new(|b| _ = b.quad(Vec3::ONE, Vec3::X * 2.0, Vec3::Y * 3.0, 1)), 2, 6.0, DVec3::Z),
        ("fine quad", Box::new(|b| _ = b.quad(Vec3::ONE, Vec3::X * 2.0, Vec3::Y * 3.0, 5)), 50, 6.0, DVec3::Z),
        ("slope", Box::new(move |b| _ = b.height_field(4, 5, slope)), 40, 6.0f64.sqrt(), DVec3::new(-1.0, 1.0, -2.0)),
    ];
    for (name, add, triangles, expected_area, side) in cases {
        let scene = build(add);
        assert_eq!(scene.triangles.len(), triangles, "{name}");
        assert_normals(&scene, name);
        assert!(
            (area(&scene) - expected_area).abs() < 1e-6 * expected_area,
            "{name}: {} instead of {expected_area}",
            area(&scene)
        );
        for i in 0..triangles {
            let [a, b, c] = corners(&scene, i);
            let cosine = (b - a).cross(c - a).normalize().dot(side.normalize());
            assert!(cosine > 1.0 - 1e-6, "{name}: triangle {i} faces elsewhere");
        }
    }
}

#[test]
fn an_open_tube_has_no_caps() {
    let scene = build(|b| _ = b.frustum(1.0, 1.0, 2.0, 16, false));
    assert_eq!(scene.triangles.len(), 32);
    assert!(scene.triangles.iter().all(|t| t.normals.iter().all(|&n| n != NO_INDEX)), "the side is smooth");
}

#[test]
fn smooth_solids_have_the_ideal_normals() {
    let sphere = build(|b| _ = b.sphere(2.0, 16));
    for t in &sphere.triangles {
        for k in 0..3 {
            let (p, n) = (sphere.positions[t.positions[k] as usize], sphere.normals[t.normals[k] as usize]);
            assert!((p / 2.0 - n).length() <= 2.0 * f32::EPSILON, "sphere: {p} has the normal {n}");
        }
    }
    // The side of a cone of radius 3 and height 4 has normals of slope 3/5; at the tip one for each triangle.
    let cone = build(|b| _ = b.frustum(3.0, 0.0, 4.0, 8, false));
    assert_eq!(cone.triangles.len(), 8);
    for &n in cone.triangles.iter().flat_map(|t| &t.normals) {
        assert!((cone.normals[n as usize].y - 0.6).abs() < 1e-6, "cone: {}", cone.normals[n as usize]);
    }
}

#[test]
fn textures_lie_on_solids_unmirrored_and_whole() {
    for (name, add, ..) in CLOSED {
        let scene = build(|b| add(b, 12));
        let (mut low, mut high) = (Vec2::INFINITY, Vec2::NEG_INFINITY);
        for t in &scene.triangles {
            let [a, b, c] = t.uvs.map(|i| scene.uvs[i as usize]);
            (low, high) = (low.min(a).min(b).min(c), high.max(a).max(b).max(c));
            assert!((b - a).perp_dot(c - a) > 0.0, "{name}: the texture is mirrored on {a} {b} {c}");
            // A triangle across the seam must not run backwards through the whole texture.
            assert!((a.x - b.x).abs() <= 1.0 && (b - a).perp_dot(c - a) <= 1.0, "{name}: {a} {b} {c}");
        }
        assert_eq!((low, high), (Vec2::ZERO, Vec2::ONE), "{name}");
    }
    let sphere = build(|b| _ = b.sphere(1.0, 12));
    let widest = sphere
        .triangles
        .iter()
        .map(|t| t.uvs.map(|i| sphere.uvs[i as usize].x))
        .map(|u| u[0].max(u[1]).max(u[2]) - u[0].min(u[1]).min(u[2]));
    assert!(widest.fold(0.0, f32::max) < 1.5 / 12.0, "no triangle spans more of the texture than its slice");
}

#[test]
fn transforms_persist_and_the_last_acts_first() {
    let scene = build(|b| {
        b.translate(Vec3::new(10.0, 0.0, 0.0));
        b.triangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        b.rotate(Vec3::Z * 7.0, 90.0).triangle(Vec3::X, Vec3::Y, Vec3::NEG_X);
        b.scale(Vec3::splat(2.0)).triangle(Vec3::X, Vec3::Y, Vec3::NEG_X);
        b.reset_transform().triangle(Vec3::X, Vec3::Y, Vec3::NEG_X);
    });
    // Quarter turns are exact, so that these are equal to the last bit.
    assert_eq!(scene.vertices(0), [Vec3::X * 10.0, Vec3::X * 11.0, Vec3::new(10.0, 1.0, 0.0)]);
    assert_eq!(scene.vertices(1), [Vec3::new(10.0, 1.0, 0.0), Vec3::new(9.0, 0.0, 0.0), Vec3::new(10.0, -1.0, 0.0)]);
    assert_eq!(scene.vertices(2), [Vec3::new(10.0, 2.0, 0.0), Vec3::new(8.0, 0.0, 0.0), Vec3::new(10.0, -2.0, 0.0)]);
    assert_eq!(scene.vertices(3), [Vec3::X, Vec3::Y, Vec3::NEG_X]);
}

#[test]
fn rotation_agrees_with_the_library_for_any_axis() {
    let (axis, degrees, p) = (Vec3::new(1.0, -2.0, 0.5), 37.0f32, Vec3::new(0.3, 4.0, -1.0));
    let scene = build(|b| _ = b.rotate(axis, degrees).triangle(p, Vec3::ZERO, Vec3::X));
    let expected = glam::Quat::from_axis_angle(axis.normalize(), degrees.to_radians()) * p;
    // 4 is the largest coordinate; the library's f32 rotation has some 10 operations.
    assert!((scene.positions[0] - expected).length() < 4.0 * 16.0 * f32::EPSILON, "{} {expected}", scene.positions[0]);
}

#[test]
fn push_and_pop_nest() {
    let scene = build(|b| {
        b.translate(Vec3::X).push().translate(Vec3::Y).push().translate(Vec3::Z);
        b.triangle(Vec3::ZERO, Vec3::X, Vec3::Y).pop().triangle(Vec3::ZERO, Vec3::X, Vec3::Y).pop().triangle(
            Vec3::ZERO,
            Vec3::X,
            Vec3::Y,
        );
    });
    let origins: Vec<Vec3> = (0..3).map(|i| scene.vertices(i)[0]).collect();
    assert_eq!(origins, [Vec3::ONE, Vec3::new(1.0, 1.0, 0.0), Vec3::X]);
}

#[test]
fn mirrored_and_skewed_solids_still_face_outwards() {
    let skew = Affine3A::from_mat3(
        Mat3A::from_cols(Vec3A::new(1.0, 0.5, 0.0), Vec3A::new(0.0, 2.0, 1.0), Vec3A::new(-0.5, 0.0, 3.0)).into(),
    );
    let mirrors = [
        Vec3::new(-1.0, 1.0, 1.0),
        Vec3::new(1.0, -2.0, 3.0),
        Vec3::new(-1.0, -1.0, 1.0),
        Vec3::splat(-0.5),
        Vec3::ONE,
    ];
    for (name, add, _, volume, _) in CLOSED {
        for mirror in mirrors {
            let what = format!("{name} scaled by {mirror}");
            let scene = build(|b| {
                b.translate(Vec3::new(1.0, 2.0, 3.0)).transform(skew).scale(mirror);
                add(b, 16);
            });
            assert_closed(&scene, &what);
            assert_normals(&scene, &what);
            let factor = f64::from(skew.matrix3.determinant() * mirror.x * mirror.y * mirror.z).abs();
            let expected = factor * volume(16);
            assert!(
                (signed_volume(&scene) / expected - 1.0).abs() < 1e-4,
                "{what}: {} instead of {expected}",
                signed_volume(&scene)
            );
        }
    }
}

#[test]
fn normals_go_with_the_inverse_transpose() {
    // A plane of slope 1, stretched twofold in x, has slope 1/2: normal (-1, 2, 0).
    let scene = build(|b| {
        b.scale(Vec3::new(2.0, 1.0, 1.0));
        b.mesh(
            &[Vec3::ZERO, Vec3::Z, Vec3::new(1.0, 1.0, 0.0)],
            Normals::Given(&[Vec3::new(-1.0, 1.0, 0.0); 3]),
            &[],
            &[[0, 1, 2]],
        );
    });
    assert!(
        (scene.normals[0] - Vec3::new(-1.0, 2.0, 0.0).normalize()).length() < 2.0 * f32::EPSILON,
        "{}",
        scene.normals[0]
    );
}

#[test]
fn materials_persist_and_equal_ones_are_shared() {
    let (red, blue) = (Material::matt(Vec3::X), Material::matt(Vec3::Z));
    let scene = build(|b| {
        b.triangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        b.material(red.clone()).triangle(Vec3::ZERO, Vec3::X, Vec3::Y).push().triangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        b.material(blue.clone()).pop().triangle(Vec3::ZERO, Vec3::X, Vec3::Y);
        b.material(red.clone()).triangle(Vec3::ZERO, Vec3::X, Vec3::Y);
    });
    let names: Vec<_> = scene.triangles.iter().map(|t| scene.materials[t.material as usize].diffuse).collect();
    assert_eq!(names, [Vec3::splat(0.8), Vec3::X, Vec3::X, Vec3::Z, Vec3::X]);
    assert_eq!(scene.materials.len(), 3);
    assert_eq!(scene.materials[0].name, "default");
}

#[test]
fn vertices_make_triangles_strips_and_fans() {
    let p = |i: u32| Vec3::new(i as f32, (i * i) as f32, 0.0);
    let cases = [
        (Primitive::Triangles, vec![[0, 1, 2], [3, 4, 5]]),
        (Primitive::Strip, vec![[0, 1, 2], [2, 1, 3], [2, 3, 4], [4, 3, 5]]),
        (Primitive::Fan, vec![[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5]]),
    ];
    for (primitive, expected) in cases {
        let scene = build(|b| {
            b.begin(primitive).vertex(p(0)).normal(Vec3::Z * 2.0).uv(0.5, 0.25);
            (1..6).for_each(|i| _ = b.vertex(p(i)));
            b.end();
        });
        let found: Vec<_> = scene.triangles.iter().map(|t| t.positions).collect();
        assert_eq!(found, expected, "{primitive:?}");
        assert_eq!(scene.triangles[0].normals, [NO_INDEX, 0, 0], "the normal serves from where it is set");
        assert_eq!(scene.triangles[0].uvs, [NO_INDEX, 0, 0]);
        assert_eq!((scene.normals[0], scene.uvs[0]), (Vec3::Z, Vec2::new(0.5, 0.25)));
    }
}

#[test]
fn smooth_meshes_get_the_mean_normal() {
    // Two walls of a roof: on the ridge the normal points straight up, at the eaves along the walls' own.
    let points = [
        Vec3::new(-1.0, 0.0, 0.0),
        Vec3::new(-1.0, 0.0, 1.0),
        Vec3::new(0.0, 1.0, 0.0),
        Vec3::new(0.0, 1.0, 1.0),
        Vec3::new(1.0, 0.0, 0.0),
        Vec3::new(1.0, 0.0, 1.0),
    ];
    let roof = [[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]];
    let scene = build(|b| _ = b.mesh(&points, Normals::Smooth, &[], &roof));
    let left = Vec3::new(-1.0, 1.0, 0.0).normalize();
    for (i, expected) in [(0, left), (1, left), (2, Vec3::Y), (3, Vec3::Y)] {
        assert!((scene.normals[i] - expected).length() < 2.0 * f32::EPSILON, "vertex {i}: {}", scene.normals[i]);
    }
    let flat = build(|b| _ = b.mesh(&points, Normals::Flat, &[], &roof));
    assert!(flat.normals.is_empty() && flat.triangles.iter().all(|t| t.normals == [NO_INDEX; 3]));
}

#[test]
fn scenes_merge_with_transform_and_material() {
    let ball = build(|b| {
        b.material(Material { name: "ball".into(), ..Material::matt(Vec3::X) }).sphere(1.0, 8);
        b.material(Material { name: "foot".into(), ..Material::matt(Vec3::Y) }).cuboid(Vec3::ONE);
    });
    let scene = build(|b| {
        b.material(Material::matt(Vec3::Z)).cuboid(Vec3::ONE);
        let gold = b.add_material(Material { name: "gold".into(), ..Material::default() });
        b.translate(Vec3::X * 5.0).scale(Vec3::new(1.0, 1.0, -1.0)).add_scene(&ball, None).add_scene(&ball, Some(gold));
    });
    assert_eq!(scene.triangles.len(), 12 + 2 * ball.triangles.len());
    let name = |i: usize| scene.materials[scene.triangles[i].material as usize].name.as_str();
    let n = ball.triangles.len();
    assert_eq!([name(0), name(12), name(11 + n), name(12 + n), name(11 + 2 * n)], ["", "ball", "foot", "gold", "gold"]);
    let part = Scene { triangles: scene.triangles[12..12 + n].to_vec(), ..scene.clone() };
    assert_closed(&part, "merged scene");
    assert_normals(&part, "merged scene");
    assert!(signed_volume(&part) > 0.0, "the mirror keeps the outside");
    let mean: Vec3 = (0..n).map(|i| part.vertices(i)[0]).sum::<Vec3>() / n as f32;
    assert!((mean.x - 5.0).abs() < 0.3, "moved: {mean}");
}

#[test]
fn merged_scenes_keep_triangles_that_cannot_be_hit() {
    let mut broken = build(|b| _ = b.triangle(Vec3::ZERO, Vec3::X, Vec3::Y).triangle(Vec3::ZERO, Vec3::X, Vec3::Y));
    broken.positions[1] = Vec3::NAN;
    let scene = build(|b| _ = b.add_scene(&broken, None));
    assert_eq!(scene.triangles.len(), 2);
    assert_eq!((scene.drop_reason(0), scene.drop_reason(1)), (Some(DropReason::NotFinite), None));
}

#[test]
fn lights_move_with_the_transform_and_cameras_do_not() {
    let camera = Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 30.0 };
    let scene = build(|b| {
        b.translate(Vec3::X).rotate(Vec3::Y, 90.0).camera(camera);
        b.light(Light::point(Vec3::Z, Vec3::ONE)).light(Light::directional(Vec3::Z, Vec3::ONE));
    });
    assert_eq!(scene.lights[0].kind, LightKind::Point { position: Vec3::X * 2.0 });
    assert_eq!(scene.lights[1].kind, LightKind::Directional { direction: Vec3::X });
    assert_eq!(scene.camera, Some(camera));
}

#[test]
fn uv_scale_repeats_textures() {
    let scene = build(|b| _ = b.uv_scale(Vec2::new(4.0, 2.0)).quad(Vec3::ZERO, Vec3::X, Vec3::Y, 1));
    assert_eq!(scene.uvs.iter().copied().fold(Vec2::ZERO, Vec2::max), Vec2::new(4.0, 2.0));
}

#[test]
fn faults_are_told_by_finish() {
    type Case = (&'static str, fn(&mut Builder));
    let cases: &[Case] = &[
        ("pop", |b| _ = b.push().pop().pop()),
        ("begin: not ended", |b| _ = b.begin(Primitive::Fan)),
        ("begin: the last", |b| _ = b.begin(Primitive::Fan).begin(Primitive::Fan)),
        ("end: nothing", |b| _ = b.end()),
        ("end: 4 vertices", |b| {
            b.begin(Primitive::Triangles);
            (0..4).for_each(|i| _ = b.vertex(Vec3::X * i as f32));
            b.end();
        }),
        ("vertex: outside", |b| _ = b.vertex(Vec3::ZERO)),
        ("normal: outside", |b| _ = b.normal(Vec3::Y)),
        ("uv: outside", |b| _ = b.uv(0.0, 0.0)),
        ("scale: the transform flattens", |b| _ = b.scale(Vec3::new(1.0, 0.0, 1.0))),
        ("translate: a value", |b| _ = b.translate(Vec3::NAN)),
        ("rotate: the axis", |b| _ = b.rotate(Vec3::ZERO, 20.0)),
        ("rotate: a value", |b| _ = b.rotate(Vec3::X, f32::INFINITY)),
        ("out of float32's range", |b| _ = b.scale(Vec3::splat(1e30)).scale(Vec3::splat(1e30)).sphere(1.0, 8)),
        ("there is no vertex 3", |b| _ = b.mesh(&[Vec3::ZERO; 3], Normals::Flat, &[], &[[0, 1, 3]])),
        ("2 normals for 3", |b| _ = b.mesh(&[Vec3::ZERO; 3], Normals::Given(&[Vec3::X; 2]), &[], &[[0, 1, 2]])),
        ("1 texture coordinates for 3", |b| _ = b.mesh(&[Vec3::ZERO; 3], Normals::Flat, &[Vec2::ONE], &[[0, 1, 2]])),
        ("use_material", |b| _ = b.use_material(0)),
        ("add_scene", |b| _ = b.add_scene(&Scene::default(), Some(0))),
        ("sphere: radius is -1", |b| _ = b.sphere(-1.0, 8)),
        ("sphere: radius is NaN", |b| _ = b.sphere(f32::NAN, 8)),
        ("sphere: segments is 2", |b| _ = b.sphere(1.0, 2)),
        ("sphere: segments is 4097", |b| _ = b.sphere(1.0, MAX_SEGMENTS + 1)),
        ("box: size is 0", |b| _ = b.cuboid(Vec3::new(1.0, 0.0, 1.0))),
        ("the larger radius is 0", |b| _ = b.cone(0.0, 1.0, 8)),
        ("height is inf", |b| _ = b.cylinder(1.0, f32::INFINITY, 8)),
        ("leaves nothing", |b| _ = b.disc(1.0, 1.0, 8)),
        ("parallel", |b| _ = b.quad(Vec3::ZERO, Vec3::X, Vec3::X * 2.0, 1)),
        ("not below the major", |b| _ = b.torus(1.0, 1.0, 8, 8)),
        ("not finite", |b| _ = b.height_field(2, 2, |x, _| 1.0 / x)),
        ("camera: fov", |b| _ = b.camera(Camera { eye: Vec3::Z, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 180.0 })),
        ("camera: up", |b| {
            _ = b.camera(Camera { eye: Vec3::Y * 9.0, target: Vec3::ZERO, up: Vec3::Y, fov_degrees: 40.0 })
        }),
        ("camera: target", |b| _ = b.camera(Camera { eye: Vec3::Y, target: Vec3::Y, up: Vec3::Y, fov_degrees: 40.0 })),
        ("light 0: direction", |b| _ = b.light(Light::directional(Vec3::ZERO, Vec3::ONE))),
        ("light 0: intensity", |b| _ = b.light(Light::point(Vec3::ZERO, Vec3::NEG_X))),
        ("there is no texture number 0", |b| {
            _ = b.material(Material { diffuse_texture: Some(0), ..Material::default() })
        }),
        ("texture 0: colors", |b| {
            _ = b.add_texture(Procedural { colours: [Vec3::NAN, Vec3::ONE], ..Procedural::new(Pattern::Wood) })
        }),
        ("texture 0: scale", |b| {
            _ = b.add_texture(Procedural {
                transform: DAffine3::from_scale(DVec3::new(1.0, 0.0, 1.0)),
                ..Procedural::new(Pattern::Noise)
            })
        }),
        ("material '': toon steps is 0", |b| {
            _ = b.material(Material { toon: Some(Toon { steps: 0, threshold: 0.5 }), ..Material::default() })
        }),
        ("material '': toon threshold is NaN", |b| {
            _ = b.material(Material { toon: Some(Toon { steps: 2, threshold: f32::NAN }), ..Material::default() })
        }),
        ("mirror", |b| _ = b.material(Material { mirror: Vec3::splat(1.5), ..Material::default() })),
        ("shininess", |b| _ = b.material(Material { shininess: f32::NAN, ..Material::default() })),
        ("ior", |b| _ = b.material(Material { ior: 0.0, ..Material::default() })),
        ("ambient", |b| _ = b.ambient(Vec3::NAN)),
    ];
    for (expected, calls) in cases {
        let message = fault(calls);
        assert!(message.contains(expected), "expected '{expected}' in '{message}'");
    }
    let many = fault(|b| (0..5).for_each(|_| _ = b.pop()));
    assert!(many.ends_with("and 2 more"), "{many}");
}
