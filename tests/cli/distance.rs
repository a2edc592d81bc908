//! `raybrook distance`, and `raybrook inside` of open meshes.

use super::{assert_fails, folder, raybrook, read_npz, stderr, write_npz};
use std::path::Path;

/// A tetrahedron, closed and without its lid, and points beside it, inside of it, on a corner, and nowhere.
fn files(at: &Path) {
    let corners = "v 0 0 0\nv 4 0 0\nv 0 4 0\nv 0 0 4\n";
    std::fs::write(at.join("closed.obj"), format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")).unwrap();
    std::fs::write(at.join("open.obj"), format!("{corners}f 1 3 2\nf 1 2 4\nf 3 1 4\n")).unwrap();
    let points = [1.0, 1.0, -3.0, 1.0, 1.0, 0.5, 4.0, 0.0, 0.0, f32::NAN, 0.0, 0.0];
    write_npz(&at.join("points.npz"), &[("point", 3, &points)]);
}

fn said(at: &Path, arguments: &[&str]) -> String {
    let output = raybrook(at, &[arguments, &["-o", "answers.npz", "--device=reference"]].concat());
    assert!(output.status.success(), "{}", stderr(&output));
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn distances_are_written_and_signed_where_that_is_asked_for() {
    let folder = folder();
    let at = folder.path();
    files(at);
    let read = |name: &str| read_npz(&at.join("answers.npz"), name);
    let floats = |name: &str| read(name).into_iter().map(f32::from_bits).collect::<Vec<_>>();

    let text = said(at, &["distance", "open.obj", "points.npz"]);
    assert!(text.starts_with("4 points, distances 0 to 3, 3 triangles on reference"), "{text}");
    assert_eq!(floats("distance")[..3], [3.0, 0.5, 0.0]);
    assert!(floats("distance")[3].is_nan());
    assert_eq!(floats("closest")[..9], [1.0, 1.0, 0.0, 1.0, 1.0, 0.0, 4.0, 0.0, 0.0]);
    assert_eq!(read("primitive"), [0, 0, 0, u32::MAX]);
    assert_eq!((floats("u")[..3].to_vec(), floats("v")[..3].to_vec()), (vec![0.25, 0.25, 0.0], vec![0.25, 0.25, 1.0]));

    let text = said(at, &["distance", "closed.obj", "points.npz", "--signed"]);
    assert!(text.starts_with("4 points, distances -0.5 to 3, 4 triangles"), "{text}");
    assert_eq!(floats("distance")[..3], [3.0, -0.5, 0.0]);
    // What rays are tested by makes no difference without signs.
    said(at, &["distance", "closed.obj", "points.npz", "--precision=fast"]);
    assert_eq!(floats("distance")[..3], [3.0, 0.5, 0.0]);
}

#[test]
fn open_meshes_are_refused_without_winding_numbers() {
    let folder = folder();
    let at = folder.path();
    files(at);
    for command in [&["distance", "open.obj", "points.npz", "--signed"][..], &["inside", "open.obj", "points.npz"]] {
        let output = raybrook(at, &[command, &["--device=reference"]].concat());
        assert_fails(&output, 3, &["open.obj", "not closed", "3 of its edges"]);
    }
    let signed = ["distance", "closed.obj", "points.npz", "--signed", "--intersector=plucker", "--device=reference"];
    assert_fails(&raybrook(at, &signed), 2, &["--intersector", "exact"]);

    assert!(
        said(at, &["inside", "open.obj", "points.npz", "--winding"]).starts_with("4 points, 1 inside, 3 triangles")
    );
    let winding: Vec<_> = read_npz(&at.join("answers.npz"), "winding");
    assert_eq!(winding.len(), 2 * 4); // halves of doubles
    let number = f64::from_bits(u64::from(winding[2]) | u64::from(winding[3]) << 32);
    assert!((0.5..1.0).contains(&number), "{number}");
    assert!(said(at, &["inside", "open.obj", "points.npz", "--winding=0.99"]).starts_with("4 points, 0 inside"));
    for threshold in ["nan", "inf", "half"] {
        let inside = ["inside", "open.obj", "points.npz", &format!("--winding={threshold}")];
        assert_fails(&raybrook(at, &inside), 2, &[threshold, "expected a number, such as 0.5"]);
    }
}
