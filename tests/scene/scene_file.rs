//! Scene files: every documented key is read, every fault names its line and key, and our own scenes load.

#[path = "../../crates/lab/examples/make_scenes.rs"]
#[allow(dead_code)] // its main writes the files that are checked here
mod make_scenes;

use glam::{DVec3, Vec2, Vec3};
use raybrook::low_level::renderer::{complete, complete_as};
use raybrook::low_level::scene::{
    Aim, DefaultLight, Falloff, LightKind, Material, NO_INDEX, Pattern, Procedural, Samples, Scene, Sky, Texture,
    TextureSpace, load,
};
use raybrook::{Error, Result};
use std::path::{Path, PathBuf};

/// A folder with the scene file `text` in it, gone after the test.
struct Folder(tempfile::TempDir);

impl Folder {
    fn new(text: &str) -> Folder {
        let folder = Folder(tempfile::tempdir().expect("a folder"));
        folder.write("scene.toml", text);
        folder
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        let path = self.0.path().join(name);
        std::fs::create_dir_all(path.parent().expect("a folder")).expect("a folder");
        std::fs::write(path, content).expect("a file");
    }

    fn load(&self) -> Result<Scene> {
        load(self.0.path().join("scene.toml"))
    }
}

fn scene(text: &str) -> Scene {
    Folder::new(text).load().unwrap_or_else(|e| panic!("{e}\nin\n{text}"))
}

/// Line and message of the fault that `folder`'s scene has.
fn fault_in(folder: &Folder) -> (Option<usize>, String) {
    match folder.load() {
        Err(Error::Input { path, line, message }) if path.ends_with("scene.toml") => (line, message),
        other => panic!("expected a fault in the scene file, got {other:?}"),
    }
}

#[track_caller]
fn assert_fault(text: &str, line: usize, words: &[&str]) {
    let (found_line, message) = fault_in(&Folder::new(text));
    assert_eq!(found_line, Some(line), "{message}\nin\n{text}");
    for word in words {
        assert!(message.contains(word), "expected '{word}' in '{message}' of\n{text}");
    }
}

/// A 2 x 2 PNG with the given reds.
fn png(reds: [u8; 4]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, 2, 2);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header().expect("a header");
    writer.write_image_data(reds.map(|red| [red, 1, 2]).as_flattened()).expect("pixels");
    writer.finish().expect("a picture");
    bytes
}

fn corners(scene: &Scene) -> (Vec3, Vec3) {
    scene.bounds().expect("triangles")
}

// ---- what is read
// ----------------------------------------------------------------------------------------------------

#[test]
fn an_empty_file_is_an_empty_scene() {
    let empty = scene("");
    assert!(empty.triangles.is_empty() && empty.lights.is_empty() && empty.camera.is_none());
    assert_eq!((empty.picture.size, empty.picture.samples, empty.picture.depth), (None, None, None));
    assert_eq!((empty.ambient, empty.background), (Vec3::ZERO, Default::default()));
}

#[test]
fn image_camera_and_trace_are_read() {
    let full = scene(
        "[image]\nwidth = 640\nheight = 0x1e0\nsamples = 9\n\
         [camera]\neye = [1, 2.5, 3]\ntarget = [0, 0, -1]\nup = [0, 0, 2]\nfov = 55.5\n\
         [trace]\ndepth = 7\nambient = 0.25\nbackground = { bottom = [1, 0.5, 0], top = \"#0000ff\" }\n",
    );
    assert_eq!(
        (full.picture.size, full.picture.samples, full.picture.depth),
        (Some((640, 480)), Some(Samples::PerPixel(9)), Some(7))
    );
    let camera = full.camera.expect("a camera");
    assert_eq!((camera.eye, camera.target), (Vec3::new(1.0, 2.5, 3.0), Vec3::NEG_Z));
    assert_eq!((camera.up, camera.fov_degrees), (Vec3::Z * 2.0, 55.5));
    assert_eq!(full.ambient, Vec3::splat(0.25));
    assert_eq!((full.background.bottom, full.background.top), (Vec3::new(1.0, 0.5, 0.0), Vec3::Z));

    let short = scene("[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\n[trace]\nbackground = 0.5\n");
    let camera = short.camera.expect("a camera");
    assert_eq!((camera.up, camera.fov_degrees), (Vec3::Y, 40.0));
    assert_eq!((short.background.bottom, short.background.top), (Vec3::splat(0.5), Vec3::splat(0.5)));
}

#[test]
fn a_sky_and_the_light_without_lights_are_read() {
    let full = scene("[sky]\ntop = [0.1, 0.2, 0.3]\nbottom = 0.5\nviewer = \"#0000ff\"\nup = [0, 0, 2]\n");
    let sky = Sky { top: Vec3::new(0.1, 0.2, 0.3), bottom: Vec3::splat(0.5), viewer: Vec3::Z, up: Vec3::Z * 2.0 };
    assert_eq!(full.sky, Some(sky));
    assert!(full.has_light());
    assert_eq!(scene("[sky]\n").sky, Some(Sky::default()));
    let none = scene("[trace]\ndepth = 3\n");
    assert_eq!((none.sky, none.default_light, none.has_background), (None, DefaultLight::Studio, false));
    let plain = scene("[trace]\ndefault-light = \"plain\"\nbackground = 0.05\n");
    assert_eq!((plain.default_light, plain.has_background, plain.has_light()), (DefaultLight::Plain, true, false));
}

#[test]
fn cameras_of_wide_pictures_are_read() {
    let text = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\nfov = 90\n\
                [[camera.wide]]\naspect = 1\n[[camera.wide]]\naspect = 2\neye = [0, 1, 4]\nfov = 50\n";
    let of_aspect = |aspect: f32| {
        let mut scene = scene(text);
        complete(&mut scene, aspect);
        let camera = scene.camera.expect("a camera");
        (camera.eye, camera.target, camera.fov_degrees)
    };
    for aspect in [0.1, 1.0] {
        assert_eq!(of_aspect(aspect), (Vec3::Z * 5.0, Vec3::ZERO, 90.0), "{aspect}");
    }
    // A wider picture shows as much across.
    let near = |found: (Vec3, Vec3, f32), eye: Vec3, across: f32, aspect: f32| {
        let shown = (found.2.to_radians() / 2.0).tan() * aspect;
        found.0 == eye && found.1 == Vec3::ZERO && (shown - across).abs() < 1e-5
    };
    assert!(near(of_aspect(1.25), Vec3::Z * 5.0, 1.0, 1.25) && near(of_aspect(2.0), Vec3::Z * 5.0, 1.0, 2.0));
    let across = 2.0 * 25f32.to_radians().tan();
    assert!(near(of_aspect(2.5), Vec3::new(0.0, 1.0, 4.0), across, 2.5), "{:?}", of_aspect(2.5));
    // A part that is given takes the place of that camera's.
    let aim = Aim { fov_degrees: Some(30.0), ..Aim::default() };
    let mut other = scene(text);
    complete_as(&mut other, 3.0, &aim);
    assert_eq!(other.camera.map(|camera| (camera.eye, camera.fov_degrees)), Some((Vec3::new(0.0, 1.0, 4.0), 30.0)));
}

/// Its box is open towards the camera, and nothing is beside it.
#[test]
fn the_box_fills_pictures_of_every_width() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("scenes/cornell.toml");
    let cornell = load(&path).expect("a scene");
    let square = cornell.camera.expect("a camera");
    let mut tracer = raybrook::Tracer::builder(&cornell).device("reference").build().expect("a tracer");
    for aspect in [0.5625, 1.0, 1.01, 1.2, 1.25, 1.26, 4.0 / 3.0, 1.45, 1.5, 1.6, 1.7, 16.0 / 9.0, 2.39, 3.6] {
        let mut scene = cornell.clone();
        complete(&mut scene, aspect);
        let camera = scene.camera.expect("a camera");
        assert!(aspect > 1.0 || camera == square, "{aspect}");
        let forward = (camera.target - camera.eye).normalize();
        let right = forward.cross(camera.up).normalize();
        let half = (camera.fov_degrees.to_radians() / 2.0).tan();
        let rays: Vec<_> = (0..=100)
            .flat_map(|i| {
                let at = i as f32 / 50.0 - 1.0;
                [(at, -1.0), (at, 1.0), (-1.0, at), (1.0, at)]
            })
            .map(|(x, y)| {
                let direction = forward + right * (x * half * aspect) + right.cross(forward) * (y * half);
                raybrook::Ray::new(camera.eye.to_array(), direction.to_array())
            })
            .collect();
        let missed = tracer.closest_hits(&rays).expect("hits").iter().filter(|hit| hit.is_none()).count();
        assert_eq!(missed, 0, "{aspect}");
    }
}

#[test]
fn lights_are_read() {
    let lights = scene(
        "[[light]]\nkind = \"point\"\nposition = [1, 2, 3]\nintensity = 2\ncolor = [1, 0.5, 0]\n\
         falloff = \"quadratic\"\n\
         [[light]]\nkind = \"directional\"\ndirection = [0, -1, 0]\nintensity = [3, 2, 1]\n\
         [[light]]\nkind = \"directional\"\nposition = [0, 5, 0]\ntarget = [1, 4, 0]\n\
         [[light]]\nkind = \"spot\"\nposition = [0, 5, 0]\ntarget = [0, 0, 1]\ninner = 10\nouter = 15\n\
         [[light]]\nkind = \"spot\"\nposition = [0, 5, 0]\ndirection = [1, 0, 0]\nfalloff = \"none\"\n",
    )
    .lights;
    assert_eq!(lights[0].kind, LightKind::Point { position: Vec3::new(1.0, 2.0, 3.0) });
    assert_eq!((lights[0].intensity, lights[0].falloff), (Vec3::new(2.0, 1.0, 0.0), Falloff::Quadratic));
    assert_eq!(lights[1].kind, LightKind::Directional { direction: Vec3::NEG_Y });
    assert_eq!((lights[1].intensity, lights[1].falloff), (Vec3::new(3.0, 2.0, 1.0), Falloff::None));
    assert_eq!(lights[2].kind, LightKind::Directional { direction: Vec3::new(1.0, -1.0, 0.0) });
    assert_eq!(lights[2].intensity, Vec3::ONE);
    let spot = |direction, inner_degrees, outer_degrees| LightKind::Spot {
        position: Vec3::Y * 5.0,
        direction,
        inner_degrees,
        outer_degrees,
    };
    assert_eq!(lights[3].kind, spot(Vec3::new(0.0, -5.0, 1.0), 10.0, 15.0));
    assert_eq!(lights[4].kind, spot(Vec3::X, 24.0, 30.0));
}

#[test]
fn materials_are_read() {
    let folder = Folder::new(
        "[material.all]\nambient = 0.1\ndiffuse = [0.2, 0.3, 0.4]\ntexture = \"pictures/a.png\"\nspecular = 0.5\n\
         shininess = 60\nmirror = 0.7\ntransmission = 0.8\nior = 1.3\nemission = 9\n\
         [material.plain]\n[material.\"a red\"]\ndiffuse = \"#ff0000\"\n\
         [material.shown]\ntexture = \"pictures/a.png\"\n",
    );
    folder.write("pictures/a.png", png([1, 2, 3, 4]));
    let scene = folder.load().expect("a scene");
    let expected = Material {
        name: "all".into(),
        ambient: Vec3::splat(0.1),
        diffuse: Vec3::new(0.2, 0.3, 0.4),
        diffuse_texture: Some(0),
        specular: Vec3::splat(0.5),
        shininess: 60.0,
        mirror: Vec3::splat(0.7),
        transmission: Vec3::splat(0.8),
        ior: 1.3,
        emission: Vec3::splat(9.0),
        toon: None,
    };
    assert_eq!(scene.materials[0], expected);
    let plain = Material { name: "plain".into(), shininess: 50.0, ior: 1.5, ..Material::default() };
    assert_eq!(scene.materials[1], plain);
    assert_eq!((scene.materials[2].name.as_str(), scene.materials[2].diffuse), ("a red", Vec3::X));
    assert_eq!(scene.materials[2].ambient, Vec3::X, "ambient is diffuse unless told otherwise");
    assert_eq!((scene.materials[3].diffuse, scene.materials[3].diffuse_texture), (Vec3::ONE, Some(0)));
    assert_eq!(scene.textures.len(), 1, "one file is one texture");
    assert_eq!(scene.textures[0].image().expect("a picture").rgba[2], [3, 1, 2, 255]);
}

#[test]
fn procedural_textures_are_read() {
    let scene = scene(
        "[material.a]\ntexture = { kind = \"checker\" }\n\
         [material.b]\ndiffuse = 0.5\ntexture = { kind = \"marble\", colors = [[0.1, 0.2, 0.3], \"#ffffff\"], scale = \
         [2, 4, 8], rotate = [0, 0, 90], translate = [1, 2, 3], turbulence = -0.5, octaves = 16, seed = 4294967295 }\n\
         [material.c.texture]\nkind = \"wood\"\nspace = \"uv\"\nrotate = { axis = [0, 0, 2], degrees = 180 }\n\
         [material.d]\ntexture = { kind = \"noise\", octaves = 2, seed = 3, space = \"world\" }\n\
         [material.e]\ntexture = { kind = \"checker\" }\n",
    );
    let texture = |material: usize| {
        let id = scene.materials[material].diffuse_texture.expect("a texture");
        match &scene.textures[id as usize] {
            Texture::Procedural(procedural) => procedural.clone(),
            Texture::Image(image) => panic!("a picture: {image:?}"),
        }
    };
    assert_eq!(texture(0), Procedural::new(Pattern::Checker));
    assert_eq!((scene.materials[0].diffuse, scene.materials[1].diffuse), (Vec3::ONE, Vec3::splat(0.5)));
    let marble = texture(1);
    assert_eq!((marble.pattern, marble.colours), (Pattern::Marble, [Vec3::new(0.1, 0.2, 0.3), Vec3::ONE]));
    assert_eq!((marble.turbulence, marble.octaves, marble.seed), (-0.5, 16, u32::MAX));
    // Placed as objects are: scaled, then rotated, then moved.
    assert_eq!(marble.transform.transform_point3(DVec3::X), DVec3::new(1.0, 4.0, 3.0));
    let wood = texture(2);
    assert_eq!((wood.pattern, wood.space), (Pattern::Wood, TextureSpace::Uv));
    assert_eq!(wood.transform.transform_point3(DVec3::X), DVec3::NEG_X);
    assert_eq!(texture(3), Procedural { octaves: 2, seed: 3, ..Procedural::new(Pattern::Noise) });
    assert_eq!(scene.textures.len(), 4, "equal textures are one");
}

#[test]
fn threshold_shading_is_read() {
    let toons = scene(
        "[material.a]\ntoon = 4\n[material.b]\ntoon = { steps = 2, threshold = 0.1 }\n[material.c]\n\
         toon = { steps = 1 }\n\
         [material.d]\ntoon = 0\n[material.e]\n",
    )
    .materials
    .into_iter()
    .map(|m| m.toon.map(|toon| (toon.steps, toon.threshold)))
    .collect::<Vec<_>>();
    assert_eq!(toons, [Some((4, 0.2)), Some((2, 0.1)), Some((1, 0.5)), None, None]);
}

#[test]
fn solids_are_read() {
    // The keys of the solid, its triangles, its bounds.
    let cases = [
        ("solid = \"sphere\"", 2 * 64 * 31, [-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]),
        ("solid = \"sphere\"\nradius = 2\nsegments = 8", 48, [-2.0; 3], [2.0; 3]),
        ("solid = \"box\"", 12, [-0.5; 3], [0.5; 3]),
        ("solid = \"box\"\nsize = 3", 12, [-1.5; 3], [1.5; 3]),
        ("solid = \"box\"\nsize = [2, 4, 6]", 12, [-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]),
        ("solid = \"cylinder\"\nradius = 2\nheight = 3\nsegments = 8", 32, [-2.0, 0.0, -2.0], [2.0, 3.0, 2.0]),
        ("solid = \"cylinder\"\ncaps = false\nsegments = 8", 16, [-1.0, 0.0, -1.0], [1.0; 3]),
        ("solid = \"cone\"\nradius = 2\nheight = 3\nsegments = 8", 16, [-2.0, 0.0, -2.0], [2.0, 3.0, 2.0]),
        ("solid = \"cone\"\ntop-radius = 2\ncaps = true\nsegments = 8", 32, [-2.0, 0.0, -2.0], [2.0, 1.0, 2.0]),
        ("solid = \"disc\"\nradius = 2\nsegments = 8", 8, [-2.0, 0.0, -2.0], [2.0, 0.0, 2.0]),
        ("solid = \"disc\"\ninner-radius = 0.5\nsegments = 8", 16, [-1.0, 0.0, -1.0], [1.0, 0.0, 1.0]),
        ("solid = \"quad\"", 2, [-0.5, 0.0, -0.5], [0.5, 0.0, 0.5]),
        (
            "solid = \"quad\"\norigin = [1, 2, 3]\nedge-u = [2, 0, 0]\nedge-v = [0, 1, 0]\nsegments = 3",
            18,
            [1.0, 2.0, 3.0],
            [3.0, 3.0, 3.0],
        ),
        ("solid = \"torus\"\nsegments = 8\nsides = 4", 64, [-1.25, -0.25, -1.25], [1.25, 0.25, 1.25]),
        (
            "solid = \"torus\"\nmajor-radius = 2\nminor-radius = 1\nsegments = 4\nsides = 4",
            32,
            [-3.0, -1.0, -3.0],
            [3.0, 1.0, 3.0],
        ),
        (
            "solid = \"height-field\"\nformula = \"waves\"\namplitude = 3\nfrequency = 1\nsegments = 4\nsize = [2, 6]",
            32,
            [-1.0, -3.0, -3.0],
            [1.0, 3.0, 3.0],
        ),
        (
            "solid = \"height-field\"\nformula = \"ripples\"\namplitude = 2\nfrequency = 0.0001\nsegments = 2",
            8,
            [-0.5, 2.0 * (-2.0f32).exp(), -0.5],
            [0.5, 2.0, 0.5],
        ),
    ];
    for (keys, triangles, low, high) in cases {
        let scene = scene(&format!("[[object]]\n{keys}\n"));
        assert_eq!(scene.triangles.len(), triangles, "{keys}");
        let (found_low, found_high) = corners(&scene);
        let near = |a: Vec3, b: [f32; 3]| (a - Vec3::from(b)).length() < 1e-5;
        assert!(near(found_low, low) && near(found_high, high), "{keys}: {found_low} {found_high}");
        assert_eq!(scene.materials[0].name, "default", "{keys}");
    }
}

#[test]
fn noise_follows_its_seed() {
    let heights = |seed: u32| {
        scene(&format!("[[object]]\nsolid = \"height-field\"\nformula = \"noise\"\nseed = {seed}\nsegments = 8\n"))
            .positions
    };
    assert_eq!(heights(1), heights(1));
    assert_ne!(heights(1), heights(2));
}

#[test]
fn heights_come_from_pictures() {
    let folder = Folder::new("[[object]]\nsolid = \"height-field\"\npicture = \"heights.png\"\nheight = 10\n");
    folder.write("heights.png", png([0, 51, 102, 255]));
    let scene = folder.load().expect("a scene");
    assert_eq!(scene.triangles.len(), 2, "one cell between each two texels");
    let height = |x: f32, z: f32| scene.positions.iter().find(|p| (p.x, p.z) == (x, z)).expect("a grid point").y;
    // The picture's top row lies at the far side, -z.
    for (x, z, expected) in [(-0.5, -0.5, 0.0), (0.5, -0.5, 2.0), (-0.5, 0.5, 4.0), (0.5, 0.5, 10.0)] {
        assert!((height(x, z) - expected).abs() < 1e-5, "at {x}, {z}: {}", height(x, z));
    }
}

#[test]
fn objects_are_scaled_then_rotated_then_moved() {
    let quad = "[[object]]\nsolid = \"quad\"\norigin = [1, 0, 0]\nedge-u = [0, 1, 0]\nedge-v = [0, 0, 1]\n";
    let first = |keys: &str| scene(&format!("{quad}{keys}")).positions[0];
    assert_eq!(first("translate = [5, 6, 7]\n"), Vec3::new(6.0, 6.0, 7.0));
    assert_eq!(first("scale = 2\n"), Vec3::X * 2.0);
    assert_eq!(first("scale = [-3, 1, 1]\n"), Vec3::X * -3.0);
    assert_eq!(first("rotate = [0, 0, 90]\n"), Vec3::Y);
    assert_eq!(first("rotate = { axis = [0, 2, 0], degrees = 90 }\n"), Vec3::NEG_Z);
    assert_eq!(
        first("rotate = [0, 90, 90]\n"),
        Vec3::NEG_Z,
        "about y, which leads to -z, then about z, which leaves it"
    );
    assert_eq!(first("rotate = [0, 0, 90]\ntranslate = [5, 0, 0]\nscale = [2, 3, 4]\n"), Vec3::new(5.0, 2.0, 0.0));
    let two = scene(&format!("{quad}translate = [9, 9, 9]\n{quad}"));
    assert_eq!(two.positions[4], Vec3::X, "an object's transform ends with it");
}

#[test]
fn objects_have_their_material_and_texture_scale() {
    let text = "[material.red]\ndiffuse = [1, 0, 0]\n\
                [[object]]\nsolid = \"quad\"\nmaterial = \"red\"\nuv-scale = [3, 2]\n[[object]]\nsolid = \"quad\"\n";
    let scene = scene(text);
    let name = |i: usize| scene.materials[scene.triangles[i].material as usize].name.as_str();
    assert_eq!([name(0), name(1), name(2), name(3)], ["red", "red", "default", "default"]);
    let largest =
        |i: usize| scene.triangles[i].uvs.map(|k| scene.uvs[k as usize]).into_iter().fold(Vec2::ZERO, Vec2::max);
    assert_eq!((largest(0), largest(2)), (Vec2::new(3.0, 2.0), Vec2::ONE));
}

#[test]
fn objects_stand_where_their_instances_say() {
    let text = r#"
        [material.red]
        diffuse = [1, 0, 0]
        [material.blue]
        diffuse = [0, 0, 1]
        [[object]]
        solid = "box"
        material = "red"
        translate = [1, 0, 0]
        instances = [{}, { translate = [0, 5, 0], rotate = [0, 0, 90] }, { scale = [-2, 1, 1], material = "blue" }]
        [[object]]
        solid = "sphere"
        segments = 4
    "#;
    let scene = scene(text);
    assert_eq!((scene.instances.placed().len(), scene.instances.shared_triangle_count()), (3, 12));
    // The object's own transform comes first.
    let boxes = [([0.5, -0.5], [1.5, 0.5]), ([-0.5, 5.5], [0.5, 6.5]), ([-3.0, -0.5], [-1.0, 0.5])];
    for (index, (low, high)) in boxes.into_iter().enumerate() {
        let corners = scene.instances.range(index).flat_map(|i| scene.instances.vertices(i as usize));
        let (found_low, found_high) = corners.fold((Vec3::MAX, Vec3::MIN), |(a, b), p| (a.min(p), b.max(p)));
        let (low, high) = (Vec3::new(low[0], low[1], -0.5), Vec3::new(high[0], high[1], 0.5));
        assert!(found_low.abs_diff_eq(low, 1e-6) && found_high.abs_diff_eq(high, 1e-6), "{found_low} {found_high}");
    }
    // Own triangles come first, those of instances behind them.
    let flat = scene.flattened().unwrap();
    let colour = |i: usize| scene.materials[flat.triangles[i].material as usize].diffuse;
    let first = scene.triangles.len();
    assert_eq!([first, first + 12, first + 24].map(colour), [Vec3::X, Vec3::X, Vec3::Z]);

    assert_fault("[[object]]\nsolid = \"box\"\ninstances = 3", 3, &["instances", "an array of tables"]);
    assert_fault("[[object]]\nsolid = \"box\"\ninstances = [\n{ move = [1, 2, 3] }]", 4, &["move"]);
    assert_fault("[[object]]\nsolid = \"box\"\ninstances = [\n{ scale = [1, 0, 1] }]", 4, &["scale", "flattens"]);
    assert_fault(
        "[[object]]\nsolid = \"box\"\ninstances = [\n{},\n{ translate = [3e38, 0, 0] }]",
        5,
        &["cannot be placed", "float32's range"],
    );
    assert_fault("[[object]]\nsolid = \"box\"\ninstances = [{ material = \"gold\" }]", 3, &["'gold' is not defined"]);
}

#[test]
fn obj_files_keep_their_materials_unless_the_object_has_one() {
    let folder = Folder::new(
        "[material.gold]\n[[object]]\nfile = \"models/t.obj\"\ntranslate = [0, 0, 4]\n\
         [[object]]\nfile = \"models/t.obj\"\nmaterial = \"gold\"\n",
    );
    folder.write("models/t.obj", "mtllib t.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl own\nf 1 2 3\n");
    folder.write("models/t.mtl", "newmtl own\nKd 0.1 0.2 0.3\n");
    let scene = folder.load().expect("a scene");
    assert_eq!(scene.triangles.len(), 2);
    let material = |i: usize| &scene.materials[scene.triangles[i].material as usize];
    assert_eq!((material(0).name.as_str(), material(0).diffuse), ("own", Vec3::new(0.1, 0.2, 0.3)));
    assert_eq!(material(1).name, "gold");
    assert_eq!((scene.vertices(0)[0], scene.vertices(1)[0]), (Vec3::Z * 4.0, Vec3::ZERO));
}

#[test]
fn ply_and_stl_files_are_objects_too() {
    let folder = Folder::new(
        "[material.gold]\n[[object]]\nfile = \"models/t.PLY\"\ntranslate = [0, 0, 4]\n\
         [[object]]\nfile = \"t.Stl\"\nscale = 2\n[[object]]\nfile = \"models/t.PLY\"\nmaterial = \"gold\"\n",
    );
    let header = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
                  element face 1\nproperty list uchar int vertex_indices\n\
                  property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n";
    folder.write("models/t.PLY", format!("{header}0 0 0\n1 0 0\n0 1 0\n3 0 1 2 255 0 0\n"));
    let vertices = "vertex 1 0 0\nvertex 0 1 0\nvertex 0 0 1\n";
    let facet = format!("facet normal 0 0 0\nouter loop\n{vertices}endloop\nendfacet\n");
    folder.write("t.Stl", format!("solid\n{facet}endsolid\n"));
    let scene = folder.load().expect("a scene");
    let names: Vec<_> = scene.triangles.iter().map(|t| scene.materials[t.material as usize].name.as_str()).collect();
    assert_eq!(names, ["#ff0000", "", "gold"]);
    assert_eq!(
        [scene.vertices(0)[0], scene.vertices(1)[0], scene.vertices(2)[1]],
        [Vec3::Z * 4.0, Vec3::X * 2.0, Vec3::X]
    );
    // A fault of the model names the model.
    folder.write("t.Stl", "solid\n");
    let error = folder.load().expect_err("no end").to_string();
    assert!(error.contains("t.Stl: ") && error.contains("cut short"), "{error}");
}

#[test]
fn warnings_of_a_file_are_told_once() {
    let object = "[[object]]\nfile = \"t.obj\"\n";
    let folder = Folder::new(&object.repeat(3));
    folder.write("t.obj", "mtllib missing.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    let scene = folder.load().expect("a scene");
    assert_eq!(scene.triangles.len(), 3);
    assert_eq!(scene.warnings.iter().filter(|w| w.contains("missing.mtl")).count(), 1, "{:?}", scene.warnings);
}

// ---- what is refused
// -------------------------------------------------------------------------------------------------

#[test]
fn unknown_keys_name_the_nearest_and_their_line() {
    let cases: [(&str, usize, &[&str]); 17] = [
        ("\n\n[camra]\neye = [0, 0, 0]\n", 3, &["'camra'", "did you mean 'camera'?"]),
        ("[image]\nwidth = 4\nheigth = 4\n", 3, &["[image]", "'heigth'", "did you mean 'height'?"]),
        ("[camera]\neye = [0, 0, 1]\n\ntraget = [0, 0, 0]\n", 4, &["'traget'", "did you mean 'target'?"]),
        ("[trace]\ndpeth = 4\n", 2, &["'dpeth'", "did you mean 'depth'?"]),
        ("[trace]\nbackground = { botom = 1, top = 1 }\n", 2, &["'botom'", "did you mean 'bottom'?"]),
        ("[sky]\ntop = 1\nbottm = 1\n", 3, &["'bottm'", "did you mean 'bottom'?"]),
        ("[[light]]\nkind = \"point\"\nposition = [0, 0, 0]\ncolour = 1\n", 4, &["point light", "'color'?"]),
        ("[[light]]\nkind = \"directional\"\nfalloff = \"none\"\n", 3, &["a directional light has no key 'falloff'"]),
        ("[material.x]\n# a line\ndifuse = 1\n", 3, &["[material.x]", "did you mean 'diffuse'?"]),
        ("[[object]]\nsolid = \"sphere\"\nheight = 2\n", 3, &["the solid sphere has no key 'height'", "radius"]),
        ("[[object]]\nfile = \"a.obj\"\nradius = 2\n", 3, &["an object from a file has no key 'radius'"]),
        ("[[object]]\nsold = \"sphere\"\n", 2, &["'sold'", "did you mean 'solid'?"]),
        (
            "[material.x]\ntexture = { kind = \"checker\", colours = [0, 1] }\n",
            2,
            &["the texture checker has no key 'colours'", "did you mean 'colors'?"],
        ),
        (
            "[material.x]\n[material.x.texture]\nkind = \"noise\"\n\nturbulence = 1\n",
            5,
            &["the texture noise", "'turbulence'"],
        ),
        (
            "[material.x]\ntexture = { kind = \"checker\", octaves = 2 }\n",
            2,
            &["the texture checker has no key 'octaves'"],
        ),
        ("[material.x]\ntoon = { step = 2 }\n", 2, &["[material.x] toon", "'step'", "did you mean 'steps'?"]),
        ("[image]\nzebra = 1\nyak = 2\n", 2, &["'zebra'", "possible: width, height, samples"]),
    ];
    for (text, line, words) in cases {
        assert_fault(text, line, words);
    }
}

#[test]
fn unknown_names_name_the_nearest_and_their_line() {
    assert_fault("[[object]]\nsolid = \"shpere\"\n", 2, &["solid", "'shpere'", "did you mean 'sphere'?"]);
    assert_fault("[[light]]\nkind = \"pont\"\n", 2, &["kind", "did you mean 'point'?"]);
    let marbel = "[material.x]\ntexture = { kind = \"marbel\" }\n";
    assert_fault(marbel, 2, &["[material.x] texture: kind", "'marbel'", "did you mean 'marble'?"]);
    let space = "[material.x]\ntexture = { kind = \"checker\", space = \"object\" }\n";
    assert_fault(space, 2, &["[material.x] texture: space", "'object'", "possible: world, uv"]);
    assert_fault(
        "[[light]]\nkind = \"spot\"\nposition = [0, 0, 0]\ndirection = [1, 0, 0]\nfalloff = \"linear\"\n",
        5,
        &["falloff"],
    );
    let text = "[material.gold]\n[material.glass]\n[[object]]\nsolid = \"box\"\nmaterial = \"glas\"\n";
    assert_fault(text, 5, &["'glas' is not defined", "did you mean 'glass'?"]);
    assert_fault("[[object]]\nsolid = \"box\"\nmaterial = \"x\"\n", 3, &["'x' is not defined", "there is none"]);
}

#[test]
fn wrong_types_name_key_and_line() {
    let cases: [(&str, usize, &[&str]); 20] = [
        ("image = 4\n", 1, &["[image]", "table", "a whole number"]),
        ("[light]\nkind = \"point\"\n", 1, &["[[light]]"]),
        ("light = [1]\n", 1, &["[[light]]", "table"]),
        ("[image]\nwidth = \"4\"\n", 2, &["width", "a whole number", "a text"]),
        ("[image]\nwidth = 4.5\nheight = 4\n", 2, &["width", "a whole number", "a number"]),
        ("[camera]\neye = 3\n", 2, &["eye", "an array of 3 numbers", "a whole number"]),
        ("[camera]\neye = [1, 2]\n", 2, &["eye", "2 values", "3 numbers"]),
        ("[camera]\neye = [1, 2, \"3\"]\n", 2, &["eye", "a number", "a text"]),
        ("[camera]\neye = [0, 0, 1]\ntarget = [0, 0, 0]\nfov = true\n", 4, &["fov", "a number", "true or false"]),
        ("[trace]\nambient = \"red\"\n", 2, &["ambient", "#rrggbb"]),
        ("[trace]\nambient = [1, 2, 3, 4]\n", 2, &["ambient", "4 values"]),
        ("[material.x]\ntexture = 3\n", 2, &["texture", "a path in quotes or a table", "a whole number"]),
        ("[material.x]\ntexture = { colors = [0, 1] }\n", 2, &["[material.x] texture: kind is missing"]),
        ("[material.x]\ntexture = { kind = \"noise\", colors = 1 }\n", 2, &["colors", "an array of two colours"]),
        (
            "[material.x]\ntexture = { kind = \"noise\", colors = [1, 0, 1] }\n",
            2,
            &["colors", "an array of two colours"],
        ),
        ("[material.x]\n\ntoon = true\n", 3, &["toon", "a whole number", "true or false"]),
        ("[material.x]\ntoon = { threshold = 0.5 }\n", 2, &["[material.x] toon: steps is missing"]),
        ("[[object]]\nsolid = 3\n", 2, &["solid", "a text"]),
        ("[[object]]\nsolid = \"cone\"\ncaps = 1\n", 3, &["caps", "true or false", "a whole number"]),
        ("[[object]]\nsolid = \"cone\"\nscale = 2020-01-01\n", 3, &["scale", "a date"]),
    ];
    for (text, line, words) in cases {
        assert_fault(text, line, words);
    }
}

#[test]
fn values_out_of_range_name_key_and_line() {
    let camera = "[camera]\neye = [0, 0, 5]\ntarget = [0, 0, 0]\n";
    let with_camera = |line: &str| format!("{camera}{line}\n");
    for (line, word) in [("fov = 0", "fov"), ("fov = 180", "fov"), ("fov = nan", "fov"), ("up = [0, 0, -3]", "up")] {
        assert_fault(&with_camera(line), 4, &["[camera]", word]);
    }
    let light = |keys: &str| format!("[[light]]\nkind = \"spot\"\nposition = [0, 0, 0]\n{keys}\n");
    let texture = |keys: &str| format!("[material.x.texture]\nkind = \"marble\"\n{keys}\n");
    let solid = |name: &str, keys: &str| format!("[[object]]\nsolid = \"{name}\"\n{keys}\n");
    let cases = [
        ("[image]\nwidth = 0\nheight = 4\n".to_owned(), 2, "width"),
        ("[image]\nwidth = 4\nheight = 65536\n".to_owned(), 3, "65535"),
        ("[image]\nwidth = -4\nheight = 4\n".to_owned(), 2, "width"),
        ("[image]\nwidth = 4\n".to_owned(), 1, "height is missing"),
        ("[image]\nsamples = 99999999999999999999\n".to_owned(), 2, "samples"),
        ("[image]\nerror = 0\n".to_owned(), 2, "error"),
        ("[image]\nerror = 300\n".to_owned(), 2, "0 to 255"),
        ("[image]\nsamples = 4\nerror = 1\n".to_owned(), 3, "either"),
        ("[trace]\ndepth = 0\n".to_owned(), 2, "depth"),
        ("[trace]\nambient = [0, -1, 0]\n".to_owned(), 2, "ambient"),
        ("[trace]\ndefault-light = \"plan\"\n".to_owned(), 2, "plain"),
        ("[sky]\ntop = [0, -1, 0]\n".to_owned(), 2, "top"),
        ("[sky]\nviewer = 1\nup = [0, 0, 0]\n".to_owned(), 3, "up"),
        (format!("{camera}[[camera.wide]]\nfov = 30\n"), 4, "aspect is missing"),
        (format!("{camera}[[camera.wide]]\naspect = 0\n"), 5, "aspect"),
        (format!("{camera}[[camera.wide]]\naspect = 2\n[[camera.wide]]\naspect = 2\n"), 7, "the one before it, 2"),
        (format!("{camera}[[camera.wide]]\naspect = 2\nfov = 190\n"), 6, "fov"),
        ("[trace]\nbackground = { bottom = 1 }\n".to_owned(), 2, "top is missing"),
        ("[camera]\neye = [0, 0, inf]\ntarget = [0, 0, 0]\n".to_owned(), 2, "finite"),
        ("[camera]\neye = [0, 0, 1e39]\ntarget = [0, 0, 0]\n".to_owned(), 2, "finite"),
        ("[camera]\neye = [0, 0, 1]\n".to_owned(), 1, "target is missing"),
        ("[camera]\neye = [0, 0, 1]\ntarget = [0, 0, 1]\n".to_owned(), 3, "looks nowhere"),
        ("[camera]\neye = [0, 9, 0]\ntarget = [0, 0, 0]\n".to_owned(), 3, "parallel"),
        ("[[light]]\nposition = [0, 0, 0]\n".to_owned(), 1, "kind is missing"),
        ("[[light]]\nkind = \"point\"\n".to_owned(), 1, "position is missing"),
        ("[[light]]\nkind = \"directional\"\n".to_owned(), 1, "needs a direction"),
        (light("direction = [0, 0, 0]"), 4, "no direction"),
        (light("target = [0, 0, 0]"), 4, "target"),
        (light("target = [1, 0, 0]\ndirection = [1, 0, 0]"), 4, "keep one"),
        (light("target = [1, 0, 0]\nouter = 90"), 5, "outer"),
        (light("target = [1, 0, 0]\nouter = 20\ninner = 21"), 6, "inner"),
        (light("target = [1, 0, 0]\nintensity = -1"), 5, "intensity"),
        ("[material.x]\nmirror = 1.1\n".to_owned(), 2, "mirror"),
        ("[material.x]\n\ntransmission = [0, 2, 0]\n".to_owned(), 3, "transmission"),
        ("[material.x]\nshininess = -1\n".to_owned(), 2, "shininess"),
        ("[material.x]\nshininess = 10001\n".to_owned(), 2, "shininess"),
        ("[material.x]\nior = 0\n".to_owned(), 2, "ior"),
        ("[material.x]\ndiffuse = -0.5\n".to_owned(), 2, "diffuse"),
        ("[material.x]\ndiffuse = \"#12345\"\n".to_owned(), 2, "#rrggbb"),
        ("[material.x]\ntoon = 256\n".to_owned(), 2, "toon is 256; it must lie between 0 and 255"),
        ("[material.x]\ntoon = { steps = 0 }\n".to_owned(), 2, "toon: steps is 0; it must lie between 1 and 255"),
        (
            "[material.x]\ntoon = { steps = 2, threshold = 1 }\n".to_owned(),
            2,
            "threshold is 1; it must be at least 0 and below 1",
        ),
        ("[material.x]\ntoon = { steps = 2, threshold = -0.1 }\n".to_owned(), 2, "threshold is -0.1"),
        (texture("colors = [0, 1.5]"), 3, "colors is [1.5, 1.5, 1.5]; no component may be above 1"),
        (texture("colors = [[0, -1, 0], 1]"), 3, "colors is [0, -1, 0]; no component may be negative"),
        (texture("octaves = 0"), 3, "octaves is 0; it must lie between 1 and 16"),
        (texture("octaves = 17"), 3, "octaves is 17"),
        (texture("turbulence = inf"), 3, "turbulence is inf; it must be finite"),
        (texture("seed = -1"), 3, "seed is -1"),
        (texture("scale = [1, 0, 1]"), 3, "scale is 0 along an axis"),
        (texture("rotate = { axis = [0, 0, 0], degrees = 3 }"), 3, "texture rotate: axis is zero"),
        (solid("sphere", "radius = 0"), 3, "radius"),
        (solid("sphere", "segments = 2"), 3, "segments"),
        (solid("sphere", "segments = 5000"), 3, "4096"),
        (solid("sphere", "scale = [1, 0, 1]"), 3, "scale"),
        (solid("sphere", "rotate = { axis = [0, 0, 0], degrees = 3 }"), 3, "axis"),
        (solid("sphere", "scale = 1e30\ntranslate = [0, 0, 0]\nradius = 1e30"), 1, "range"),
        (solid("box", "size = [1, -1, 1]"), 1, "size"),
        (solid("torus", "minor-radius = 2"), 1, "minor radius"),
        (solid("disc", "inner-radius = 2"), 1, "inner radius"),
        (solid("quad", "edge-u = [0, 0, 2]"), 1, "parallel"),
        (solid("height-field", ""), 1, "formula is missing"),
        (solid("height-field", "formula = \"waves\"\nsize = [0, 1]"), 4, "size"),
        (solid("height-field", "formula = \"waves\"\nheight = 1"), 4, "height"),
        ("[[object]]\nmaterial = \"x\"\n".to_owned(), 1, "needs a file or a solid"),
        ("[[object]]\nfile = \"a.obj\"\nsolid = \"box\"\n".to_owned(), 3, "one of them"),
    ];
    for (text, line, word) in cases {
        assert_fault(&text, line, &[word]);
    }
}

#[test]
fn broken_text_names_its_line() {
    assert_fault("[image]\nwidth = = 4\n", 2, &["TOML"]);
    assert_fault("[image]\nwidth = 4\nwidth = 5\n", 3, &["TOML"]);
    let folder = Folder::new("");
    folder.write("scene.toml", b"# fine\n# \xff\n");
    assert_eq!(fault_in(&folder).0, Some(2));
    let missing = load(folder.0.path().join("nothing.toml"));
    assert!(matches!(missing, Err(Error::Io { action: "read", .. })), "{missing:?}");
}

#[test]
fn nothing_outside_of_the_folder_is_opened() {
    let outside = tempfile::tempdir().expect("a folder");
    std::fs::write(outside.path().join("t.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("a file");
    std::fs::write(outside.path().join("t.png"), png([0; 4])).expect("a file");
    let absolute = |name: &str| outside.path().join(name).display().to_string();
    let cases = [
        format!("\n[[object]]\nfile = '{}'\n", absolute("t.obj")),
        format!("\n[material.x]\ntexture = '{}'\n", absolute("t.png")),
        "\n[[object]]\nfile = '../t.obj'\n".to_owned(),
        "\n[[object]]\nfile = 'a/../../t.obj'\n".to_owned(),
        "\n[material.x]\ntexture = '../nothing.png'\n".to_owned(),
    ];
    for text in cases {
        assert_fault(&text, 3, &["leads out of the scene file's folder"]);
    }
    let text = "\n[[object]]\nsolid = 'height-field'\npicture = '../t.png'\n";
    assert_fault(text, 4, &["picture", "leads out of the scene file's folder"]);
    // What stays inside may go up and down.
    let folder = Folder::new("[[object]]\nfile = 'a/../b/t.obj'\n");
    folder.write("a/other", "");
    folder.write("b/t.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n");
    assert_eq!(folder.load().expect("a scene").triangles.len(), 1);
}

#[cfg(unix)]
#[test]
fn links_do_not_lead_out_of_the_folder() {
    let outside = tempfile::tempdir().expect("a folder");
    std::fs::write(outside.path().join("t.obj"), "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n").expect("a file");
    let folder = Folder::new("[[object]]\nfile = 'link/t.obj'\n");
    std::os::unix::fs::symlink(outside.path(), folder.0.path().join("link")).expect("a link");
    let (line, message) = fault_in(&folder);
    assert_eq!(line, Some(2));
    assert!(message.contains("leads out"), "{message}");
}

#[test]
fn missing_and_foreign_files_name_key_and_line() {
    assert_fault("[[object]]\n\nfile = 'none.obj'\n", 3, &["file", "'none.obj'"]);
    assert_fault("[material.x]\ntexture = 'none.png'\n", 2, &["texture", "'none.png'"]);
    let folder = Folder::new("[[object]]\nfile = 'scene.toml'\n");
    assert!(fault_in(&folder).1.contains("not a model; possible: .obj, .ply, .stl, .gltf, .glb, .off, .3mf, .nff"));
    let folder = Folder::new("[material.x]\ntexture = 'scene.toml'\n");
    let (line, message) = fault_in(&folder);
    assert!(line == Some(2) && message.contains("texture 'scene.toml'"), "{message}");
}

// ---- our own scenes
// --------------------------------------------------------------------------------------------------

fn scenes_folder() -> PathBuf {
    crate::common::root().join("scenes")
}

#[test]
fn our_scenes_load_without_a_warning_and_as_documented() {
    let readme = std::fs::read_to_string(scenes_folder().join("README.md")).expect("scenes/README.md");
    let mut loaded = 0;
    for entry in std::fs::read_dir(scenes_folder()).expect("scenes") {
        let path = entry.expect("an entry").path();
        if path.extension().is_none_or(|e| e != "toml") {
            continue;
        }
        let name = path.file_name().and_then(|n| n.to_str()).expect("a name").to_owned();
        let scene = load(&path).unwrap_or_else(|e| panic!("{e}"));
        assert!(scene.warnings.is_empty(), "{name}: {:?}", scene.warnings);
        assert_eq!(scene.hittable().len(), scene.triangle_count(), "{name} has triangles that cannot be hit");
        assert!(scene.camera.is_some() && !scene.lights.is_empty() && scene.picture.size.is_some(), "{name}");
        let row = format!("| `{name}` | {} |", scene.triangle_count());
        assert!(readme.contains(&row), "scenes/README.md should say: {row}");
        loaded += 1;
    }
    assert!(loaded >= 4, "{loaded} scenes");
}

#[test]
fn the_showcase_shows_everything() {
    let scene = load(scenes_folder().join("showcase.toml")).expect("the showcase");
    assert!(scene.materials.iter().any(|m| m.mirror.max_element() > 0.5), "a mirror");
    assert!(scene.materials.iter().filter(|m| m.is_transparent()).count() >= 2, "glass");
    assert!(scene.materials.iter().any(|m| m.diffuse_texture.is_some()), "a texture");
    assert_eq!(
        (scene.picture.size, scene.picture.samples, scene.picture.depth),
        (Some((1280, 720)), Some(Samples::PerPixel(9)), Some(8))
    );
    assert_eq!(scene.lights.len(), 2);
    // The models come with their normals; these agree with the triangles' sides.
    for (i, t) in scene.triangles.iter().enumerate() {
        let [a, b, c] = scene.vertices(i);
        let geometric = (b - a).cross(c - a).normalize();
        for &n in t.normals.iter().filter(|&&n| n != NO_INDEX) {
            assert!(scene.normals[n as usize].dot(geometric) > 0.0, "triangle {i} has a normal on its inside");
        }
    }
}

/// Words that are numbers agree to one unit of their fourth decimal, others are equal: the libraries of different
/// systems differ in the last bit of a sine, which can tip the rounding.
fn assert_same_text(name: &str, found: &str, expected: &str) {
    assert_eq!(found.lines().count(), expected.lines().count(), "{name}");
    for (number, (found, expected)) in found.lines().zip(expected.lines()).enumerate() {
        let same = found.split_whitespace().count() == expected.split_whitespace().count()
            && found.split_whitespace().zip(expected.split_whitespace()).all(|(a, b)| {
                let number = |word: &str| word.trim_matches([',', '[', ']']).parse::<f64>();
                a == b || matches!((number(a), number(b)), (Ok(a), Ok(b)) if (a - b).abs() < 1.01e-3)
            });
        assert!(same, "{name}:{}: '{found}', but make_scenes makes '{expected}'", number + 1);
    }
}

#[test]
fn generated_files_are_what_their_generator_makes() {
    for (name, expected) in make_scenes::texts() {
        let found = std::fs::read_to_string(scenes_folder().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        assert_same_text(name, &found, &expected);
    }
    for (name, expected) in make_scenes::pictures() {
        let file = std::fs::File::open(scenes_folder().join(name)).unwrap_or_else(|e| panic!("{name}: {e}"));
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().expect("a PNG");
        let mut bytes = vec![0; reader.output_buffer_size().expect("a size")];
        let info = reader.next_frame(&mut bytes).expect("pixels");
        assert_eq!((info.width, info.height), (expected.side, expected.side), "{name}");
        let differs = bytes.iter().zip(expected.rgb.as_flattened()).any(|(&a, &b)| a.abs_diff(b) > 1);
        assert!(!differs && bytes.len() == expected.rgb.len() * 3, "{name} is not what make_scenes makes");
    }
}
