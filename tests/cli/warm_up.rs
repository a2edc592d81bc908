//! `raybrook warm-up`.

use super::{assert_fails, folder, raybrook, raybrook_with, stderr, write_npz};
use std::path::Path;

/// The names of compiled kernels in a folder.
fn kept(at: &Path) -> Vec<String> {
    let files = std::fs::read_dir(at.join("cache")).unwrap();
    let mut names: Vec<_> = files.map(|file| file.unwrap().file_name().into_string().unwrap()).collect();
    names.sort_unstable();
    names
}

/// What later runs need is there: they compile nothing.
#[test]
fn later_runs_find_their_kernels() {
    let Some(device) = crate::common::device() else { return };
    let folder = folder();
    let at = folder.path();
    let (rays, ahead) = ([0.2, 0.2, 1.0, 5.0, 5.0, 1.0], [0.0, 0.0, -1.0, 0.0, 0.0, -1.0]);
    write_npz(&at.join("rays.npz"), &[("origin", 3, &rays), ("direction", 3, &ahead)]);
    write_npz(&at.join("points.npz"), &[("point", 3, &rays)]);
    let index = device.info.index.to_string();
    let run = |command: &str| {
        let arguments: Vec<_> = command.split(' ').chain(["--device", &index]).collect();
        let output = raybrook_with(at, &arguments, &[("POCL_KERNEL_CACHE", "0")]);
        assert!(output.status.success(), "{command}: {}", stderr(&output));
        String::from_utf8(output.stdout).unwrap()
    };
    let told = run("warm-up one.obj");
    for words in
        ["closest hits", "any hits", "all hits", "first hits", "crossings", "closest points", "picture of one.obj"]
    {
        assert!(told.contains(words), "'{words}' is missing in: {told}");
    }
    assert!(told.lines().last().is_some_and(|line| line.starts_with(&device.info.name)), "{told}");
    let warm = kept(at);
    assert!(warm.len() >= 5, "{warm:?}");
    let commands = [
        "trace one.obj rays.npz -o hits.npz",
        "trace one.obj rays.npz --any-hit -o hits.npz",
        "trace one.obj rays.npz --all-hits -o hits.npz",
        "trace one.obj rays.npz --count -o hits.npz",
        "trace one.obj rays.npz --crossings -o hits.npz",
        "distance one.obj points.npz -o answers.npz",
        "render one.obj --size 8x8 -o one.png",
        "render one.obj --size 8x8 --samples 4 -o one.png",
    ];
    for command in crate::common::usually_every(3, commands) {
        run(command);
        assert_eq!(kept(at), warm, "{command}");
    }
}

#[test]
fn without_kernels_there_is_nothing_to_do() {
    let folder = folder();
    let at = folder.path();
    let output = raybrook(at, &["warm-up", "--device", "reference"]);
    assert!(output.status.success() && output.stdout.is_empty(), "{}", stderr(&output));
    assert!(stderr(&output).contains("no kernels"), "{}", stderr(&output));
    assert_fails(&raybrook(at, &["warm-up", "--device", "no such device"]), 4, &["no such device"]);
    let Some(device) = crate::common::device() else { return };
    let missing = ["warm-up", "missing.obj", "--device", &device.info.index.to_string()];
    let output = raybrook(at, &missing);
    assert_fails(&output, 3, &["missing.obj"]);
    assert!(output.stdout.is_empty(), "it is told before anything is compiled");
}
