//! Writes small PLY files for the tests of their loader.

use raybrook::low_level::scene::{Scene, load};

/// Writes `bytes` as a PLY file into a fresh folder and loads it.
pub fn load_bytes(bytes: &[u8]) -> raybrook::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    std::fs::write(&path, bytes).unwrap();
    load(path)
}

/// The header of a text with `lines`, and `data` after it.
pub fn text(lines: &[&str], data: &str) -> String {
    format!("ply\nformat ascii 1.0\n{}\nend_header\n{data}", lines.join("\n"))
}

/// Properties of a position.
pub const XYZ: &str = "property float x\nproperty float y\nproperty float z";
/// The property of a face's corners.
pub const CORNERS: &str = "property list uchar int vertex_indices";

/// A text of four vertices of a unit square and `faces`, with `vertex_lines` and `face_lines` for more properties.
pub fn square(vertex_lines: &str, vertices: [&str; 4], face_lines: &str, faces: &[&str]) -> String {
    let corners = ["0 0 0", "1 0 0", "1 1 0", "0 1 0"];
    let rows: Vec<String> = (0..4).map(|i| format!("{} {}\n", corners[i], vertices[i])).collect();
    let face_count = format!("element face {}", faces.len());
    let lines = ["element vertex 4", XYZ, vertex_lines, &face_count, CORNERS, face_lines];
    let lines: Vec<&str> = lines.into_iter().filter(|l| !l.is_empty()).collect();
    text(&lines, &format!("{}{}\n", rows.concat(), faces.join("\n")))
}

/// Values of a row, to be written in any encoding: its PLY type and the number.
pub type Row = Vec<(&'static str, f64)>;

/// A file of `rows` in `format`; a list is its count and its numbers.
pub fn encode(format: &str, header: &str, rows: &[Row]) -> Vec<u8> {
    let mut file = format!("ply\nformat {format} 1.0\n{header}\nend_header\n").into_bytes();
    for row in rows {
        for &(kind, value) in row {
            let mut bytes = match kind {
                "char" | "int8" => (value as i8).to_le_bytes().to_vec(),
                "uchar" | "uint8" => (value as u8).to_le_bytes().to_vec(),
                "short" | "int16" => (value as i16).to_le_bytes().to_vec(),
                "ushort" | "uint16" => (value as u16).to_le_bytes().to_vec(),
                "int" | "int32" => (value as i32).to_le_bytes().to_vec(),
                "uint" | "uint32" => (value as u32).to_le_bytes().to_vec(),
                "float" | "float32" => (value as f32).to_le_bytes().to_vec(),
                "double" | "float64" => value.to_le_bytes().to_vec(),
                _ => panic!("{kind}"),
            };
            match format {
                "ascii" => bytes = format!("{value} ").into_bytes(),
                "binary_big_endian" => bytes.reverse(),
                _ => {}
            }
            file.extend_from_slice(&bytes);
        }
        if format == "ascii" {
            file.push(b'\n');
        }
    }
    file
}

/// Every encoding.
pub const FORMATS: [&str; 3] = ["ascii", "binary_little_endian", "binary_big_endian"];

/// Properties of a colour.
pub const RGB: &str = "property uchar red\nproperty uchar green\nproperty uchar blue";
