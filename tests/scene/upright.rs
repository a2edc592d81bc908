//! Which way is up: by formats, by the programs that wrote files, and by the shapes of models that people know.

use crate::common::models::shared_scenes;
use crate::common::root;
use raybrook::low_level::renderer::complete_as;
use raybrook::low_level::scene::{Aim, AimSource, Placed, Scene, load};
use raybrook::{Light, Tracer, View, Viewpoint};
use std::path::Path;

fn placed(path: &Path) -> Placed {
    let mut scene = load(path).unwrap_or_else(|error| panic!("{error}"));
    complete_as(&mut scene, 1.5, &Aim::default())
}

fn up_of(placed: &Placed) -> &'static str {
    match placed.camera.up.to_array() {
        [0.0, 1.0, 0.0] => "y",
        [0.0, 0.0, 1.0] => "z",
        up => panic!("{up:?}"),
    }
}

/// None that stands by y falls over, and of those with z up all stand that a rule covers. `fuze` is a bottle, whose
/// round base tells nothing: y-up guns and rockets look like it.
#[test]
fn known_models_stand() {
    for (up, paths) in [
        (
            "z",
            "spd/gears.obj spd/mount.obj spd/tree.obj viking-room/viking_room.obj ply/cube_blender_uv.ply \
             stl/featuretype.STL",
        ),
        (
            "y",
            "bunny/bunny-16301.ply bunny/bunny-3851.ply bunny/bunny-69451.obj bunny/bunny-948.ply \
             bunny/bunny-closed-16302.ply bunny/bunny-closed-948.ply cornell/cornell_box.obj \
             cornell/cornellbox_suzanne.obj gltf/BoxTextured.gltf gltf/CesiumMilkTruck.glb gltf/CornellBox.glb \
             objects/cow.obj objects/fandisk.obj objects/suzanne.obj objects/teapot.obj ply/cube.ply \
             ply/dragon-47794.ply ply/fuze.ply ply/reference.ply ply/sphere.ply quirks/quad_not_planar.obj \
             quirks/textured_quad.obj spider/spider.obj sponza/sponza.obj spot/spot.obj spot/spot_control_mesh.obj",
        ),
    ] {
        for path in paths.split_whitespace() {
            let Some(model) = shared_scenes(path) else { return };
            let placed = placed(&model);
            assert_eq!(up_of(&placed), up, "{path}: {:?}", placed.up);
        }
    }
    for model in ["vase.obj", "knot.obj"] {
        assert_eq!(up_of(&placed(&root().join("scenes").join(model))), "y", "{model}");
    }
}

/// A plane of `y` = 0 or `z` = 0 with a pillar on it.
fn pillar(up: usize) -> (Vec<[f32; 3]>, Vec<[u32; 3]>) {
    let upright = |[x, y, z]: [f32; 3]| if up == 1 { [x, y, z] } else { [x, -z, y] };
    let ground = [[-3.0, 0.0, -3.0], [-3.0, 0.0, 3.0], [3.0, 0.0, 3.0], [3.0, 0.0, -3.0]];
    let corner = |i: u32| [0, 1, 2].map(|axis| [[-0.5, 0.0, -0.5], [0.5, 4.0, 0.5]][(i >> axis & 1) as usize][axis]);
    let sides = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]];
    let quads = std::iter::once([0, 1, 2, 3]).chain(sides.into_iter().map(|side: [u32; 4]| side.map(|i| i + 4)));
    let triangles = quads.flat_map(|[a, b, c, d]| [[a, b, c], [a, c, d]]).collect();
    (ground.into_iter().chain((0..8).map(corner)).map(upright).collect(), triangles)
}

fn obj_of((positions, triangles): &(Vec<[f32; 3]>, Vec<[u32; 3]>)) -> String {
    let vertices = positions.iter().map(|[x, y, z]| format!("v {x} {y} {z}\n"));
    vertices.chain(triangles.iter().map(|t| format!("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1))).collect()
}

#[test]
fn the_source_of_up_is_known() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let triangle = "v 0 0 0\nv 1 0 0\nv 0 1 1\nf 1 2 3\n";
    let ply = "element vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n\
        property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 1\n3 0 1 2\n";
    let scene_file = "[[object]]\nfile = \"ground.obj\"\n";
    let format = AimSource::Format;
    let shape = AimSource::Automatic("the model has level ground across z, and none across y".into());
    let default = AimSource::Automatic("y is up where neither scene, format nor shape says".into());
    for (name, text, up, source) in [
        ("ground.obj", obj_of(&pillar(2)), "z", &shape),
        ("standing.obj", obj_of(&pillar(1)), "y", &default),
        ("scene.toml", scene_file.into(), "y", &format),
        ("a.obj", triangle.into(), "y", &default),
        ("b.obj", format!("# Created by FreeCAD <https://www.freecad.org>\n{triangle}"), "z", &format),
        ("c.OBJ", format!("# OpenSCAD obj exporter\r\n{triangle}"), "z", &format),
        ("d.obj", format!("# Blender 4.2\n# www.blender.org\n{triangle}"), "y", &default),
        ("e.ply", format!("ply\nformat ascii 1.0\ncomment Created by Blender 2.82 (sub 7)\n{ply}"), "z", &format),
        ("f.ply", format!("ply\nformat ascii 1.0\ncomment Created in Blender version 4.2\n{ply}"), "z", &format),
        ("g.ply", format!("ply\nformat ascii 1.0\ncomment VCGLIB generated\n{ply}"), "y", &default),
    ] {
        std::fs::write(at.join(name), text).unwrap();
        let placed = placed(&at.join(name));
        assert_eq!((up_of(&placed), &placed.up), (up, source), "{name}");
    }
}

/// A tracer of arrays finds out by itself, before and after they change, and does as it is told.
#[test]
fn pictures_of_arrays_stand_too() {
    let picture =
        |scene: &Scene, view: View| Tracer::builder(scene).device("reference").build().unwrap().render(&view).unwrap();
    let view = || View::new(24, 18).samples(1);
    let of = |up: usize| Scene::from_mesh(&pillar(up).0, &pillar(up).1).unwrap();
    let (lying, standing) = (of(2), of(1));
    let pixels = |scene: &Scene, view: View| picture(scene, view).pixels().to_vec();
    let upright = pixels(&lying, view());
    assert!(upright == pixels(&lying, view().up([0.0, 0.0, 1.0])));
    assert!(upright != pixels(&lying, view().up([0.0, 1.0, 0.0])));
    let lit = |mut scene: Scene| {
        scene.lights.push(Light::point([9.0, 9.0, 9.0].into(), [1.0; 3].into()));
        scene
    };
    assert!(pixels(&lit(of(2)), view()) == pixels(&lit(of(2)), view().up([0.0, 0.0, 1.0])));
    let mut tracer = Tracer::builder(&standing).device("reference").build().unwrap();
    let first = tracer.render(&view()).unwrap().pixels().to_vec();
    assert!(first == pixels(&standing, view().up([0.0, 1.0, 0.0])));
    tracer.update(&lying).unwrap();
    assert!(tracer.render(&view()).unwrap().pixels() == &upright[..]);
    let top = view().viewpoint(Viewpoint::Top);
    assert!(tracer.render(&top).unwrap().pixels() == &pixels(&lying, top.up([0.0, 0.0, 1.0]))[..]);
}
