//! 3MF files: objects, components and colours, what is refused, and damaged archives.

use crate::common::models::{assert_consistent, assert_warned, damage};
use glam::Vec3;
use raybrook::low_level::scene::{Scene, load};
use std::io::{Cursor, Write};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

const RELATIONSHIPS: &str = r#"<Relationships xmlns="http://schemas.openxmlformats.org/package/2006/relationships">
<Relationship Id="t" Target="/Metadata/t.png"
Type="http://schemas.openxmlformats.org/package/2006/relationships/metadata/thumbnail"/>
<Relationship Id="m" Target="/3D/own.model" Type="http://schemas.microsoft.com/3dmanufacturing/2013/01/3dmodel"/>
</Relationships>"#;

/// A tetrahedron.
const MESH: &str = r#"<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/><vertex x="0" y="1" z="0"/>
<vertex x="0" y="0" z="1"/></vertices><triangles><triangle v1="0" v2="2" v3="1"/><triangle v1="0" v2="1" v3="3"/>
<triangle v1="1" v2="2" v3="3"/><triangle v1="2" v2="0" v3="3"/></triangles></mesh>"#;

fn archive(parts: &[(&str, &str)]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, text) in parts {
        let options = SimpleFileOptions::default().compression_method(CompressionMethod::Deflated);
        writer.start_file(*name, options).unwrap();
        writer.write_all(text.as_bytes()).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// A model of these resources and build items.
fn model(attributes: &str, resources: &str, build: &str) -> String {
    format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?><model unit=\"millimeter\" \
         xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\" {attributes}><metadata \
         name=\"a\">b</metadata><resources>{resources}</resources><build>{build}</build></model>"
    )
}

fn load_bytes(bytes: &[u8]) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.3MF");
    std::fs::write(&path, bytes).unwrap();
    load(path)
}

fn try_load(model: &str) -> raybrook::Result<Scene> {
    load_bytes(&archive(&[("_rels/.rels", RELATIONSHIPS), ("3D/own.model", model)]))
}

#[track_caller]
fn load_model(model: &str) -> Scene {
    let scene = try_load(model).unwrap();
    assert_consistent(&scene, "a.3MF");
    scene
}

fn object(id: u32, content: &str) -> String {
    format!("<object id=\"{id}\" type=\"model\">{content}</object>")
}

#[test]
fn an_object_in_its_place() {
    let text = model("", &object(1, MESH), r#"<item objectid="1" transform="0 1 0 -1 0 0 0 0 1 5 0 0"/>"#);
    let scene = load_model(&text);
    assert_eq!((scene.triangles.len(), scene.instances.placed().len(), scene.up), (4, 0, Some(Vec3::Z)));
    // x becomes y, y becomes -x.
    assert_eq!(scene.bounds().unwrap(), (Vec3::new(4.0, 0.0, 0.0), Vec3::new(5.0, 1.0, 1.0)));
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    // Without the list of parts the model is where it is by custom.
    let scene = load_bytes(&archive(&[("3D/3dmodel.model", &text)])).unwrap();
    assert_eq!(scene.triangles.len(), 4);
}

#[test]
fn components_are_instances() {
    let pair = r#"<components><component objectid="1"/>
        <component objectid="1" transform="-1 0 0 0 1 0 0 0 1 9 0 0"/></components>"#;
    let resources = [object(1, MESH), object(2, pair), object(3, MESH)].concat();
    let build = r#"<item objectid="2"/><item objectid="2" transform="2 0 0 0 2 0 0 0 2 0 0 10"/><item objectid="3"/>"#;
    let scene = load_model(&model("", &resources, build));
    assert_eq!((scene.triangles.len(), scene.instances.placed().len(), scene.triangle_count()), (4, 4, 20));
    assert_eq!(scene.bounds().unwrap(), (Vec3::ZERO, Vec3::new(18.0, 2.0, 12.0)));
    // Flat ones are no instances.
    let build = r#"<item objectid="1" transform="1 0 0 0 1 0 0 0 0 0 0 3"/><item objectid="1"/>"#;
    let scene = load_model(&model("", &resources, build));
    assert_eq!((scene.triangles.len(), scene.instances.placed().len()), (8, 0));
}

#[test]
fn colours_become_materials() {
    let groups = r##"<basematerials id="5"><base name="a" displaycolor="#FF0000"/>
<base name="b" displaycolor="#00FF00FF"/></basematerials>
<m:colorgroup id="6"><m:color color="#000000"/><m:color color="#0000FF80"/></m:colorgroup>"##;
    let mesh = MESH
        .replacen("v3=\"1\"", "v3=\"1\" pid=\"5\" p1=\"1\"", 1)
        .replacen("v2=\"1\" v3=\"3\"", "v2=\"1\" v3=\"3\" pid=\"6\" p1=\"0\" p2=\"0\" p3=\"1\"", 1)
        .replacen("v1=\"1\"", "pid=\"99\" p1=\"3\" v1=\"1\"", 1);
    let resources = format!("{groups}<object id=\"1\" pid=\"5\" pindex=\"0\">{mesh}</object>");
    let materials =
        "xmlns:m=\"http://schemas.microsoft.com/3dmanufacturing/material/2015/02\" requiredextensions=\"m\"";
    let scene = load_model(&model(materials, &resources, r#"<item objectid="1"/>"#));
    let of = |triangle: usize| &scene.materials[scene.triangles[triangle].material as usize].name[..];
    assert_eq!([of(0), of(1), of(2), of(3)], ["#00ff00", "#000055", "", "#ff0000"]);
    assert_warned(&scene, "a.3MF: not used: transparency of colours");
    assert_warned(&scene, "mean colour of its corners");
}

#[test]
fn what_is_required_and_not_known_is_refused_by_name_and_the_rest_is_told() {
    let production = "xmlns:p=\"http://schemas.microsoft.com/3dmanufacturing/production/2015/06\"";
    let text = |required: &str| {
        let attributes = format!("{production} {required}");
        let more = "<p:slicestack id=\"8\"><p:slice/><p:slice/></p:slicestack>";
        model(&attributes, &(object(1, MESH) + more), r#"<item objectid="1"/>"#)
    };
    let error = try_load(&text("requiredextensions=\"p\"")).unwrap_err().to_string();
    assert!(
        error.contains("requires the extension 'p' (http://schemas.microsoft.com/3dmanufacturing/production/"),
        "{error}"
    );
    assert_warned(&load_model(&text("")), "a.3MF: not used: slice (2), slicestack");
}

/// Elements of extensions mean something else, whatever their names; the format's own may have a prefix.
#[test]
fn elements_are_told_apart_by_their_namespaces() {
    let slices = "xmlns:s=\"http://schemas.microsoft.com/3dmanufacturing/slice/2015/07\"";
    let stack = "<s:slicestack id=\"1\"><s:slice><s:vertices><s:vertex x=\"0\" \
                 y=\"1\"/></s:vertices><s:object/></s:slice></s:slicestack>";
    let more = format!("{stack}<s:item objectid=\"7\"/><s:basematerials/><color color=\"red\"/>");
    let text = model(slices, &(object(1, MESH) + &more), r#"<item objectid="1" s:objectid="7"/>"#);
    let scene = load_model(&text);
    assert_eq!(scene.triangles.len(), 4);
    let unused = "a.3MF: not used: basematerials, color, item, object, slice, slicestack, vertex, vertices";
    assert_warned(&scene, unused);

    let prefixed = r#"<c:model xmlns:c="http://schemas.microsoft.com/3dmanufacturing/core/2015/02"><c:resources>
        <c:object id="1"><c:mesh><c:vertices><c:vertex x="0" y="0" z="0"/><c:vertex x="1" y="0" z="0"/>
        <c:vertex x="0" y="1" z="0"/></c:vertices>
        <c:triangles><c:triangle v1="0" v2="1" v3="2"/></c:triangles></c:mesh></c:object></c:resources>
        <c:build><c:item objectid="1"/></c:build></c:model>"#;
    let scene = load_model(prefixed);
    assert_eq!((scene.triangles.len(), scene.warnings.len()), (1, 0));
    let unknown = try_load(&text.replace(slices, "")).unwrap_err().to_string();
    assert!(unknown.contains("has elements of the prefix 's', of no namespace"), "{unknown}");
}

#[test]
fn wrong_files_are_refused_with_what_is_wrong() {
    let item = r#"<item objectid="1"/>"#;
    let circle = r#"<components><component objectid="1"/></components>"#;
    let mut many = object(1, MESH);
    for id in 2..60 {
        let twice = format!("<component objectid=\"{}\"/>", id - 1).repeat(2);
        many += &object(id, &format!("<components>{twice}</components>"));
    }
    for (text, part) in [
        (model("", &object(1, circle), item), "object 1 has itself as a component"),
        (model("", &(object(2, circle) + &object(1, MESH)), item), "object 1, which is not defined before"),
        (
            model("", &object(1, &MESH.replace("v3=\"1\"", "v3=\"4\"")), item),
            "triangle 0 of object 1 names vertex 4, but there are 4",
        ),
        (model("", &object(1, &MESH.replace("x=\"1\"", "x=\"1,5\"")), item), "an element 'vertex' has x = '1,5'"),
        (model("", &object(1, &MESH.replace("x=\"1\"", "")), item), "an element 'vertex' has no 'x'"),
        (model("", &object(1, MESH), r#"<item objectid="1" transform="1 0 0"/>"#), "no transform of 12 numbers"),
        (
            model("", &object(1, MESH), r#"<item objectid="1" transform="1e300 0 0 0 1 0 0 0 1 0 0 0"/>"#),
            "object 1 cannot be placed",
        ),
        (model("", &object(1, MESH), ""), "has no triangles in its build items"),
        (model("", &(object(1, MESH) + &object(1, MESH)), item), "two objects 1"),
        (model("", &many, r#"<item objectid="59"/>"#), "of components of components; the most is"),
        (model("", &object(1, MESH), r#"<item objectid="1" p:path="/3D/b.model"/>"#), "in another part"),
        ("<svg/>".to_owned(), "is no model: it begins with 'svg'"),
        (model("", &object(1, MESH), item).replace("</model>", ""), "cut short"),
        (model("", &object(1, MESH), item).replace("</mesh>", "</mush>"), "not valid XML"),
        ("<a>".repeat(100), "is no model"),
        (model("", &"<a>".repeat(100), ""), "deep in each other"),
    ] {
        let error = try_load(&text).unwrap_err();
        assert_eq!(error.exit_code(), 3);
        assert!(error.to_string().contains("a.3MF: ") && error.to_string().contains(part), "{error}, not {part}");
    }
    for (bytes, part) in [
        (Vec::new(), "is no 3MF file"),
        (b"PK\x03\x04 no archive".to_vec(), "is no 3MF file"),
        (archive(&[("a.txt", "b")]), "its model '3D/3dmodel.model' cannot be read"),
        (archive(&[("_rels/.rels", RELATIONSHIPS)]), "its model '3D/own.model' cannot be read"),
    ] {
        let error = load_bytes(&bytes).unwrap_err().to_string();
        assert!(error.contains(part), "{error}, not {part}");
    }
}

/// A small archive that unpacks to a model of many zeros.
#[test]
fn an_archive_that_unpacks_to_much_is_bounded() {
    use raybrook::low_level::budget::MemoryBudget;
    use raybrook::low_level::scene::load_within;
    let vertices = "<vertex x=\"0\" y=\"0\" z=\"0\"/>".repeat(1 << 20);
    let text =
        model("", &object(1, &format!("<mesh><vertices>{vertices}</vertices></mesh>")), r#"<item objectid="1"/>"#);
    let bytes = archive(&[("3D/3dmodel.model", &text)]);
    assert!(bytes.len() < 1 << 20);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bomb.3mf");
    std::fs::write(&path, bytes).unwrap();
    let error = load_within(&path, &MemoryBudget::of_bytes(1 << 20)).unwrap_err().to_string();
    assert!(error.contains("bomb.3mf takes the process to about"), "{error}");
}

#[test]
fn damaged_files_never_panic() {
    let mesh = r#"<mesh><vertices><vertex x="0" y="0" z="0"/><vertex x="1" y="0" z="0"/>
<vertex x="0" y="1" z="0"/></vertices>
<triangles><triangle v1="0" v2="1" v3="2"/></triangles></mesh>"#;
    damage("3mf", &archive(&[("3D/3dmodel.model", &model("", &object(1, mesh), r#"<item objectid="1"/>"#))]));
}
