//! Progress as JSON: what a program reads that wraps this one.

use super::{folder, raybrook};
use serde_json::Value;
use std::path::Path;

/// The events of a run, and its exit code.
fn events(at: &Path, words: &str) -> (Vec<Value>, Option<i32>) {
    let output = raybrook(at, &words.split(' ').collect::<Vec<_>>());
    let lines = String::from_utf8(output.stderr).unwrap();
    let parse = |line: &str| serde_json::from_str(line).unwrap_or_else(|error| panic!("{error}: {line}"));
    (lines.lines().map(parse).collect(), output.status.code())
}

#[test]
fn every_line_is_an_event_from_the_start_of_a_task_to_the_exit_code() {
    let folder = folder();
    let at = folder.path();
    let render = "render one.obj --device reference -o a.png --layers depth --progress json";
    let (all, code) = events(at, &format!("{render} --size 300x300 --samples 64 -v"));
    assert_eq!(code, Some(0), "{all:?}");
    let of = |event: &str| all.iter().filter(|line| line["event"] == event).collect::<Vec<_>>();
    let tasks =
        |event: &str| of(event).iter().map(|line| line["task"].as_str().unwrap().to_owned()).collect::<Vec<_>>();
    assert_eq!(tasks("start"), ["render", "layers"]);
    assert_eq!(tasks("end"), ["render", "layers"]);
    assert!(of("end").iter().all(|end| end["elapsed_s"].as_f64().unwrap() > 0.0), "{all:?}");
    for line in of("progress") {
        let done = line["done"].as_f64().unwrap();
        assert!((0.0..=1.0).contains(&done) && line["elapsed_s"].as_f64().unwrap() >= 0.25, "{line}");
        assert!(line["unit"].is_string() && line["task"].is_string() && line["rate"].is_number(), "{line}");
    }
    assert!(!of("message").is_empty(), "-v tells of the scene: {all:?}");
    let last = all.last().unwrap();
    assert!(last["event"] == "done" && last["exit_code"] == 0 && last["elapsed_s"].as_f64().unwrap() > 0.0, "{last}");
}

#[test]
fn errors_are_events_too() {
    let folder = folder();
    let at = folder.path();
    for (words, code, part) in [
        ("render none.obj --progress=json", 3, "none.obj"),
        ("render one.obj --progress json --size 3", 2, "WIDTHxHEIGHT"),
        ("render one.obj --progress json --device reference -o a.gif", 2, "a.gif"),
    ] {
        let (all, ended) = events(at, words);
        assert_eq!(ended, Some(code), "{all:?}");
        let told = |line: &Value| line["event"] == "message" && line["text"].as_str().is_some_and(|t| t.contains(part));
        assert!(all.iter().any(told), "{words}: {all:?}");
        assert_eq!(all.last().unwrap()["exit_code"], code);
    }
}
