//! `raybrook trace` for all hits.

use super::{assert_fails, folder, raybrook, read_npz, stderr, write_npz};
use raybrook::low_level::rays::RayBatch;
use std::path::Path;

/// Three triangles one behind the other, the first of them twice, and rays through all, through none and up to one.
fn files(at: &Path) -> [&'static str; 4] {
    let mut text = String::new();
    for z in 0..3 {
        text += &format!("v 0 0 {z}\nv 4 0 {z}\nv 0 4 {z}\n");
    }
    std::fs::write(at.join("layers.obj"), text + "f 1 2 3\nf 4 5 6\nf 7 8 9\nf 1 2 3\n").unwrap();
    let batch = RayBatch {
        origins: vec![[1.0, 1.0, 4.0], [9.0, 1.0, 4.0], [1.0, 2.0, 4.0]],
        directions: vec![[0.0, 0.0, -2.0]; 3],
        t_max: Some(vec![f32::INFINITY, f32::INFINITY, 1.5]),
        ..RayBatch::default()
    };
    batch.write(at.join("rays.npz")).unwrap();
    RayBatch { next_directions: Some(vec![[0.0, 0.0, 1.0]; 3]), ..batch }.write(at.join("second.npz")).unwrap();
    ["trace", "layers.obj", "rays.npz", "--device=reference"]
}

#[test]
fn all_hits_are_listed_limited_and_counted() {
    let folder = folder();
    let at = folder.path();
    let trace = files(at);
    let read = |name: &str| read_npz(&at.join("hits.npz"), name);
    let said = |more: &[&str]| {
        let output = raybrook(at, &[&trace[..], &["-o", "hits.npz"], more].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    assert!(said(&["--all-hits"]).contains("3 rays, 2 hit 6 times, 4 triangles"));
    assert_eq!((read("count"), read("primitive")), (vec![4, 0, 2], vec![2, 1, 0, 3, 2, 1]));
    assert_eq!(read("t"), [1.0, 1.5, 2.0, 2.0, 1.0, 1.5].map(f32::to_bits));
    assert_eq!((read("u")[..5].to_vec(), read("v")[4]), (vec![0.25f32.to_bits(); 5], 0.5f32.to_bits()));

    said(&["--all-hits=3", "--repeat", "2"]);
    assert_eq!((read("count"), read("primitive")), (vec![3, 0, 2], vec![2, 1, 0, 2, 1]));

    said(&["--count", "--counters"]);
    assert_eq!(read("count"), [4, 0, 2]);
    assert!(read("work_tests")[0] > 0);
    said(&["--crossings"]);
    assert_eq!(read("count"), [4, 0, 2]);
    let mut archive = zip::ZipArchive::new(std::fs::File::open(at.join("hits.npz")).unwrap()).unwrap();
    assert!(archive.by_name("count.npy").is_ok() && archive.by_name("primitive.npy").is_err());
}

#[test]
fn what_does_not_go_together_is_refused() {
    let folder = folder();
    let at = folder.path();
    let trace = files(at);
    for more in [
        &["--all-hits", "--any-hit"][..],
        &["--count", "--any-hit"],
        &["--count", "--all-hits=2"],
        &["--crossings", "--count"],
    ] {
        assert_fails(&raybrook(at, &[&trace[..], more].concat()), 2, &["cannot be used with"]);
    }
    assert_fails(&raybrook(at, &[&trace[..], &["--all-hits=0"]].concat()), 2, &["--all-hits"]);
    for option in ["--all-hits", "--count", "--crossings"] {
        let output = raybrook(at, &["trace", "layers.obj", "second.npz", "--device=reference", option]);
        assert_fails(&output, 2, &[option, "next_direction"]);
    }
    let output = raybrook(at, &[&trace[..], &["--crossings", "--precision=fast"]].concat());
    assert_fails(&output, 2, &["--intersector", "exact"]);
}

#[test]
fn points_are_told_inside_or_outside_of_closed_meshes_alone() {
    let folder = folder();
    let at = folder.path();
    let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
    std::fs::write(at.join("closed.obj"), format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")).unwrap();
    std::fs::write(at.join("open.obj"), format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\n")).unwrap();
    write_npz(&at.join("points.npz"), &[("point", 3, &[0.2, 0.2, 0.2, 0.5, 0.5, 0.5, 0.0, 0.5, 0.0])]);
    let run = |scene: &str, more: &[&str]| {
        raybrook(at, &[&["inside", scene, "points.npz", "-o", "inside.npz", "--device=reference"], more].concat())
    };
    let output = run("closed.obj", &[]);
    assert!(output.status.success(), "{}", stderr(&output));
    assert!(String::from_utf8_lossy(&output.stdout).starts_with("3 points, 2 inside, 4 triangles"));
    let mut archive = zip::ZipArchive::new(std::fs::File::open(at.join("inside.npz")).unwrap()).unwrap();
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut archive.by_name("inside.npy").unwrap(), &mut bytes).unwrap();
    assert_eq!(bytes[bytes.len() - 3..], [1, 0, 1]);

    assert_fails(&run("open.obj", &[]), 3, &["open.obj", "not closed", "3 of its edges"]);
    assert_fails(&run("closed.obj", &["--intersector=plucker"]), 2, &["--intersector", "exact"]);
    files(at);
    let output = raybrook(at, &["inside", "closed.obj", "rays.npz", "--device=reference"]);
    assert_fails(&output, 3, &["rays.npz", "'point'", "origin"]);
}
