//! `raybrook stress --closed`.

use raybrook_lab::stress::Mesh;
use std::path::Path;
use std::process::{Command, Output};

fn raybrook(folder: &Path, arguments: &[&str]) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_raybrook"));
    command.args(["stress", "--device", "reference"]).args(arguments).current_dir(folder).output().unwrap()
}

#[test]
fn the_program_names_what_is_not_closed_and_what_slips_through() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("sphere.obj"), Mesh::sphere(3).to_obj()).unwrap();
    let mut open = Mesh::sphere(1);
    open.triangles.pop();
    std::fs::write(at.join("open.obj"), open.to_obj()).unwrap();
    let text = |output: &Output| String::from_utf8_lossy(&[&output.stdout[..], &output.stderr].concat()).into_owned();

    let output = raybrook(at, &["--closed", "open.obj"]);
    assert_eq!(output.status.code(), Some(3), "{}", text(&output));
    assert!(text(&output).contains("open.obj: not closed: 3 open edges"), "{}", text(&output));

    let output = raybrook(at, &["--closed", "open.obj", "sphere.obj", "--rays", "5e3", "--json", "record.json"]);
    assert_eq!(output.status.code(), Some(0), "{}", text(&output));
    assert!(text(&output).contains("left out: open.obj: not closed: 3 open edges"), "{}", text(&output));
    let record: serde_json::Value = serde_json::from_slice(&std::fs::read(at.join("record.json")).unwrap()).unwrap();
    assert_eq!(record["rays"], 5000);
    assert_eq!((&record["misses"], &record["behind"]), (&0.into(), &0.into()));
    assert_eq!(record["models"][0]["model"], "sphere.obj");
    assert_eq!(record["not_closed"][0]["open_edges"], 3);

    let wrong = ["--closed", "sphere.obj", "--rays", "50000", "--precision", "fast", "--write", "wrong"];
    let output = raybrook(at, &wrong);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output));
    let said = text(&output);
    let command = said.lines().find_map(|line| line.strip_prefix("raybrook stress ")).expect("how to trace them again");
    let words: Vec<_> = command.split_whitespace().take_while(|word| *word != "--device").collect();
    let again = raybrook(at, &words);
    assert_eq!(again.status.code(), Some(1), "{}", text(&again));
    assert!(text(&again).contains("miss"), "{}", text(&again));

    for bad in [
        &["--closed", "sphere.obj", "--rays", "0"][..],
        &["--closed", "sphere.obj", "--rays", "1.5"],
        &["--closed", "sphere.obj", "--strict"],
        &["edges", "--rays", "1e7"],
    ] {
        let output = raybrook(at, bad);
        assert_eq!(output.status.code(), Some(2), "{bad:?}: {}", text(&output));
    }
}
