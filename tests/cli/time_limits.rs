//! `--time-limit` and `--deadline`.

use super::{assert_fails, folder, raybrook, stderr};
use raybrook::low_level::rays::RayBatch;
use std::path::Path;
use std::process::Output;

fn run(at: &Path, command: &str) -> Output {
    run_on("reference", at, command)
}

fn run_on(devices: &str, at: &Path, command: &str) -> Output {
    raybrook(at, &format!("{command} --device {devices}").split(' ').collect::<Vec<_>>())
}

#[test]
fn what_is_finished_stays_and_goes_on() {
    let folder = folder();
    let at = folder.path();
    let rays = RayBatch {
        origins: vec![[0.2, 0.2, 1.0]; 5000],
        directions: vec![[0.0, 0.0, -1.0]; 5000],
        ..RayBatch::default()
    };
    rays.write(at.join("rays.npz")).unwrap();
    for (command, output, says) in [
        ("render one.obj --size 300x200 --samples 4 -o a.pfm", "a.pfm", "0 of 1 blocks are kept in 'a.pfm.partial'"),
        (
            "render one.obj --size 300x200 -o b.pfm --part 1/1",
            "b.pfm.part-1-of-1",
            "0 of 1 blocks are kept in 'b.pfm.part-1-of-1'",
        ),
        ("trace one.obj rays.npz -o hits.npz", "hits.npz", "0 of 1 runs are kept in 'hits.npz.partial'"),
        ("turntable one.obj --size 30x20 --frames 3 -o turn.png", "turn-0003.png", "0 of 3 frames are in 'turn.png'"),
    ] {
        let limited = run(at, &format!("{command} --time-limit 1us"));
        assert_fails(&limited, 124, &[says, "the same command", "stopped by --time-limit"]);
        assert!(output.contains("part") || !at.join(output).exists(), "{command}");
        let finished = run(at, &format!("{command} --deadline 9999-12-30T00:00Z"));
        assert!(finished.status.success(), "{command}: {}", stderr(&finished));
        assert!(at.join(output).exists() && !at.join(format!("{output}.partial")).exists(), "{command}");
    }
}

#[test]
fn a_picture_whose_time_is_up_is_coarse_where_it_is_not_finished() {
    assert_is_coarse_where_it_is_not_finished("reference");
}

#[test]
fn a_picture_by_several_devices_is_coarse_there_too() {
    let Some(device) = crate::common::device() else { return };
    // The first has nothing to compile, so that the coarse picture is there in time.
    assert_is_coarse_where_it_is_not_finished(&format!("reference,{}", device.info.index));
}

fn assert_is_coarse_where_it_is_not_finished(devices: &str) {
    let folder = folder();
    let at = folder.path();
    let limited = run_on(devices, at, "render one.obj --size 2048x1024 --samples 256 -o a.pfm --time-limit 1500ms");
    if limited.status.success() || !at.join("a.pfm").exists() {
        return crate::common::skip("this machine is too fast, or too slow");
    }
    let says = [
        "blocks of 'a.pfm' are finished; the others are coarse, with an error of about",
        "are kept in 'a.pfm.partial'",
    ];
    assert_fails(&limited, 124, &says);
    let picture = std::fs::read(at.join("a.pfm")).unwrap();
    let pixels: &[f32] = &bytemuck::pod_collect_to_vec(&picture[picture.len() - 2048 * 1024 * 12..]);
    assert!(pixels.iter().all(|value| value.is_finite()) && pixels.iter().any(|value| *value != pixels[0]));
}

#[test]
fn what_is_no_limit_is_refused() {
    let folder = folder();
    let at = folder.path();
    for (more, says) in [
        ("--time-limit 90", &["--time-limit", "such as 90s"][..]),
        ("--deadline noon", &["--deadline", "such as 18:30"]),
        ("--deadline 2020-01-01T00:00", &["--deadline", "is over"]),
        ("--deadline 18:30 --time-limit 2h", &["cannot be used with"]),
        ("--time-limit 2h --keep never", &["--keep", "--time-limit"]),
        ("--time-limit 2h --counters", &["--time-limit", "work is counted"]),
        ("--time-limit 2h --layers depth", &["--time-limit", "layers"]),
    ] {
        assert_fails(&run(at, &format!("render one.obj --size 8x8 -o a.png {more}")), 2, says);
    }
    assert_fails(&run(at, "trace one.obj rays.npz --time-limit 2h"), 2, &["--time-limit", "-o"]);
    assert!(!at.join("a.png").exists() && !at.join("a.png.partial").exists());
}
