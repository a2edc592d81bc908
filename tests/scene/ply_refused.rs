//! PLY files that cannot be used: each is refused with its place, and none takes the program or the memory with it.

use crate::common::models::{check_malformed, damage, shared_scenes};
use crate::common::ply::{CORNERS, FORMATS, RGB, Row, XYZ, encode, load_bytes, square, text};

#[test]
fn what_has_no_faces_is_refused_by_name() {
    let strips = "element tristrips 1\nproperty list int int vertex_indices";
    for (lines, data, part) in [
        (vec!["element vertex 1", XYZ, strips], "0 0 0\n3 0 0 0\n", "holds triangle strips (1 of 'tristrips')"),
        (vec!["element vertex 1", XYZ], "0 0 0\n", "has no faces; it holds points only (1 of 'vertex')"),
        (vec!["element vertex 1", XYZ, "element face 0", CORNERS], "0 0 0\n", "has no faces"),
        (vec!["element range_grid 2", CORNERS], "0\n0\n", "has no vertices; it holds 2 of 'range_grid'"),
        (vec!["element vertex 0", XYZ, "element face 0", CORNERS], "", "holds nothing"),
        (vec![], "", "holds nothing"),
        (vec!["element vertex 1", "property float x", "element face 1", CORNERS], "0\n3 0 0 0\n", "no x, y and z"),
        (
            vec!["element vertex 1", XYZ, "element face 1", "property int vertex_indices"],
            "",
            "no list 'vertex_indices'",
        ),
        (
            vec!["element vertex 1", XYZ, "element face 1", CORNERS],
            "0 0 0\n2 0 0\n",
            "no face of three or more corners",
        ),
    ] {
        let message = load_bytes(text(&lines, data).as_bytes()).expect_err(part).to_string();
        assert!(message.contains("a.ply: ") && message.contains(part), "{message}");
    }
}

#[test]
fn messages_name_the_place() {
    let plain = square("", [""; 4], "", &["4 0 1 2 3"]);
    let binary = format!("element vertex 1\n{XYZ}\nelement face 1\nproperty list int int vertex_indices");
    let xyz = [("float", 0.0); 3].to_vec();
    let little = |face: Row| encode("binary_little_endian", &binary, &[xyz.clone(), face]);
    let ints = |numbers: &[i32]| numbers.iter().map(|&i| ("int", f64::from(i))).collect::<Row>();
    for (file, part) in [
        (
            plain.replace("4 0 1 2 3", "4 0 1 2 4").into_bytes(),
            "a.ply:14: face 0: vertex 4 is not one of the file's 4: '4 0 1 2 4'",
        ),
        (plain.replace("4 0 1 2 3", "4 0 1 2 -1").into_bytes(), "a.ply:14: face 0: vertex -1 is not one"),
        (plain.replace("4 0 1 2 3", "-1 0").into_bytes(), "a.ply:14: face 0: Failed to parse u8 from ASCII: '-1 0'"),
        (plain.replace("4 0 1 2 3", "x 0").into_bytes(), "a.ply:14: face 0: "),
        (plain.replace("4 0 1 2 3", "4 0 1 2.5 3").into_bytes(), "a.ply:14: face 0: "),
        (plain.replace("1 1 0", "1 1,5 0").into_bytes(), "a.ply:12: vertex 2: "),
        (plain.replace("4 0 1 2 3", "").into_bytes(), "a.ply: is cut short: it ends in face 0 of 1"),
        (plain.replace("int vertex_indices", "float vertex_indices").into_bytes(), "expected i64"),
        (plain.replace("uchar int", "float int").into_bytes(), "List count cannot be a float"),
        (
            plain.replace("float y", "flaot y").into_bytes(),
            "a.ply:5: the PLY header is wrong: Unknown scalar type: flaot",
        ),
        (
            plain.replace("vertex 4", "vertex -4").into_bytes(),
            "a.ply:3: the PLY header is wrong: Invalid element count: -4",
        ),
        (plain.replace("vertex 4", "vertex 99999999999999999999").into_bytes(), "a.ply:3: "),
        (plain.replace("vertex 4", "vertex 4294967295").into_bytes(), "more than 32-bit indices can tell apart"),
        (plain.replace("element vertex 4\n", "").into_bytes(), "a.ply:3: the PLY header is wrong: Property without"),
        (plain.replace("format ascii 1.0\n", "").into_bytes(), "the PLY header is wrong: Missing format"),
        (plain.replace("end_header\n", "").into_bytes(), "there is no 'end_header'"),
        (
            plain.replace("end_header\n", &format!("comment {}\nend_header\n", "x".repeat(1 << 20))).into_bytes(),
            "longer than 1 MiB",
        ),
        (b"".to_vec(), "does not begin with 'ply'"),
        (b"ply".to_vec(), "there is no 'end_header'"),
        (b"\x89PNG\r\n\x1a\n".to_vec(), "does not begin with 'ply'"),
        (little(ints(&[3, 0, 0, 7])), "a.ply: face 0: vertex 7 is not one of the file's 1"),
        (little(ints(&[i32::MAX, 0, 0, 0])), "a.ply: is cut short: it ends in face 0 of 1"),
        (little(ints(&[-3, 0, 0, 0])), "a.ply: face 0: Negative list count"),
        (little(ints(&[&[100_000][..], &[0; 100_000]].concat())), "a.ply: face 0: more than 65536 corners"),
    ] {
        let error = load_bytes(&file).expect_err(part);
        assert!(error.to_string().contains(part), "{part:?}: {error}");
        assert_eq!(error.exit_code(), 3, "{part:?}");
    }
}

#[test]
fn damaged_files_never_panic() {
    let lines = format!("property float s\nproperty float t\n{RGB}");
    damage("ply", square(&lines, ["0 1 1 2 3"; 4], "", &["4 0 1 2 3", "3 1 2 3"]).as_bytes());
    let header = format!("element vertex 3\n{XYZ}\nelement edge 1\nproperty char a\nelement face 1\n{CORNERS}");
    let mut rows = vec![vec![("float", 0.0), ("float", 0.5), ("float", 2.0)]; 3];
    rows.extend([vec![("char", 1.0)], vec![("uchar", 3.0), ("int", 0.0), ("int", 1.0), ("int", 2.0)]]);
    for format in FORMATS {
        damage("ply", &encode(format, &header, &rows));
    }
}

#[test]
fn every_malformed_file_behaves_as_listed() {
    let Some(table) = shared_scenes("malformed/expected.tsv") else { return };
    let checked = check_malformed(&table, ".ply");
    assert!(checked >= 11, "{checked} rows");
}
