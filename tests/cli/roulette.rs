//! `--roulette` from outside.

use super::{folder, raybrook, stderr};
use crate::common::device;
use serde_json::Value;

/// A glass ball, of which roulette kills rays: the files tell of it, and device and reference kill the same ones.
#[test]
fn roulette_is_told_in_files() {
    let folder = folder();
    let at = folder.path();
    let scene =
        "[material.glass]\ntransmission = 0.9\nior = 1.5\n[[object]]\nsolid = \"sphere\"\nmaterial = \"glass\"\n";
    std::fs::write(at.join("ball.toml"), scene).unwrap();
    let stats = |arguments: &[&str]| -> Value {
        let picture = ["ball.toml", "--size", "24x18", "--samples", "2", "--stats", "s.json"];
        let output = raybrook(at, &[arguments, &picture].concat());
        assert!(output.status.success(), "{}", stderr(&output));
        serde_json::from_slice(&std::fs::read(at.join("s.json")).unwrap()).unwrap()
    };
    let render = ["render", "--device", "reference"];
    let all = stats(&render);
    let random = stats(&[&render[..], &["--roulette", "0.5"]].concat());
    assert_eq!((&all["options"]["roulette"], &random["options"]["roulette"]), (&Value::Null, &0.5.into()));
    let refracted = |stats: &Value| stats["rays"]["refracted"]["cast"].as_u64().unwrap();
    assert!(refracted(&random) > 0 && refracted(&random) < refracted(&all), "{random} {all}");
    if device().is_some() {
        let checked = stats(&["check", "--device", "cpu", "--roulette", "0.5"]);
        assert_eq!((&checked["options"]["roulette"], &checked["rays_differ"]), (&0.5.into(), &false.into()));
        assert_eq!(checked["picture"]["differing_pixels"], 0);
    }
}
