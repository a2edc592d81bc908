//! Scene files, models, material libraries and textures.

use super::folder::Folder;
use super::scene::check_loaded;
use raybrook::low_level::scene::load_within;
use std::io::{Cursor, Write};
use std::path::Path;
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipWriter};

/// What inputs may name: a library, and a picture.
const LIBRARY: &[u8] = b"newmtl red\nKd 0.8 0.1 0.1\nmap_Kd picture.tga\nnewmtl glass\nd 0.1\nNi 1.5\nillum 7\n";
const MODEL: &[u8] = b"mtllib model.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 0 1\n\
    usemtl red\nf 1/1 2/2 3/3\nusemtl glass\nf 1 3 4\n";
/// A TGA of two by two texels: a header of 18 bytes, and blue, green and red of each.
const PICTURE: &[u8] = &[
    0, 0, 2, 0, 0, 0, 0, 0, 0, 0, 0, 0, 2, 0, 2, 0, 24, 0, //
    0, 0, 255, 0, 255, 0, 255, 0, 0, 255, 255, 255,
];

fn check(path: &Path) -> bool {
    check_loaded(load_within(path, &Folder.budget()))
}

/// Writes the model and what it names, one file of which is the input.
fn write_model(name: &str, data: &[u8]) {
    for (file, usual) in [("model.obj", MODEL), ("model.mtl", LIBRARY), ("picture.tga", PICTURE)] {
        Folder.write(file, if file == name { data } else { usual });
    }
}

/// A Wavefront model, beside a library and a picture.
pub fn obj(data: &[u8]) -> bool {
    write_model("model.obj", data);
    check(&Folder.path("model.obj"))
}

/// A library of materials, of which a model uses two.
pub fn mtl(data: &[u8]) -> bool {
    write_model("model.mtl", data);
    check(&Folder.path("model.obj"))
}

/// A picture of any kind: TGA has no signature, the others are known by theirs.
pub fn texture(data: &[u8]) -> bool {
    write_model("picture.tga", data);
    check(&Folder.path("model.obj"))
}

/// A PLY model.
pub fn ply(data: &[u8]) -> bool {
    Folder.write("picture.tga", PICTURE);
    check(&Folder.write("scene.ply", data))
}

/// An STL model.
pub fn stl(data: &[u8]) -> bool {
    check(&Folder.write("scene.stl", data))
}

/// An OFF model.
pub fn off(data: &[u8]) -> bool {
    check(&Folder.write("scene.off", data))
}

/// An NFF scene.
pub fn nff(data: &[u8]) -> bool {
    check(&Folder.write("scene.nff", data))
}

/// A glTF scene, text or binary.
pub fn gltf(data: &[u8]) -> bool {
    Folder.write("picture.tga", PICTURE);
    Folder.write("data.bin", MODEL);
    let name = if data.starts_with(b"glTF") { "scene.glb" } else { "scene.gltf" };
    check(&Folder.write(name, data))
}

/// A 3MF archive; an input that is no archive is the model in one.
pub fn threemf(data: &[u8]) -> bool {
    let archive = if data.starts_with(b"PK") { data.to_vec() } else { archive(&[("3D/3dmodel.model", data)]) };
    check(&Folder.write("scene.3mf", &archive))
}

/// A scene file beside a model and a picture.
pub fn toml(data: &[u8]) -> bool {
    write_model("", b"");
    check(&Folder.write("scene.toml", data))
}

/// An archive of these files, which are not compressed.
pub fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    for (name, data) in files {
        let options = SimpleFileOptions::DEFAULT.compression_method(CompressionMethod::Stored);
        writer.start_file(*name, options).expect("a cursor can be written");
        writer.write_all(data).expect("a cursor can be written");
    }
    writer.finish().expect("a cursor can be written").into_inner()
}
