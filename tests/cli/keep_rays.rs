//! Batches of rays that are kept on their way: `trace` with `OUT.partial`, `--part`, and `raybrook merge`.

use super::keep::TWO_DEVICES;
use super::{assert_fails, folder, raybrook, raybrook_with, stderr};
use raybrook::low_level::rays::RayBatch;
use raybrook::low_level::runs::RUN_RAYS;
use std::path::Path;
use std::process::{Command, Output};

/// A batch of four runs, the last of which is short. A third of the rays hit the triangle.
fn batch() -> RayBatch {
    let count = 3 * RUN_RAYS + 1000;
    let origin = |i: usize| [(i % 1237) as f32 / 1000.0, (i % 1543) as f32 / 1000.0, 1.0];
    RayBatch {
        origins: (0..count).map(origin).collect(),
        directions: vec![[0.0, 0.0, -1.0]; count],
        ..RayBatch::default()
    }
}

/// A folder with a triangle and the batch.
fn with_rays() -> tempfile::TempDir {
    let folder = folder();
    batch().write(folder.path().join("rays.npz")).unwrap();
    folder
}

fn words(text: &str) -> Vec<&str> {
    text.split(' ').collect()
}

fn trace(at: &Path, more: &str) -> Output {
    raybrook(at, &words(&format!("trace one.obj rays.npz --device reference {more}")))
}

fn bytes(at: &Path, name: &str) -> Vec<u8> {
    std::fs::read(at.join(name)).unwrap()
}

fn assert_succeeds(output: &Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    format!("{}{}", stderr(output), String::from_utf8_lossy(&output.stdout))
}

/// Starts a trace that is kept, and stops it by a signal as soon as something is; or it was faster than that.
fn stopped(at: &Path, signal: &str, kept: u64) -> Output {
    super::keep::stopped(
        at,
        "trace one.obj rays.npz --device reference --keep always -o hits.npz",
        "hits.npz.partial",
        (signal, kept),
    )
}

#[cfg(unix)]
#[test]
fn a_batch_that_was_stopped_goes_on_with_the_same_bits() {
    let folder = with_rays();
    let (at, journal) = (folder.path(), folder.path().join("hits.npz.partial"));
    let output = stopped(at, "-INT", 1000);
    if output.status.success() {
        return crate::common::skip("the batch was traced before the signal came");
    }
    assert_fails(&output, 130, &["of 4 runs are kept in 'hits.npz.partial'", "the same command goes on", "SIGINT"]);
    let length = journal.metadata().unwrap().len();
    assert!(length > 16 * RUN_RAYS as u64 && !at.join("hits.npz").exists());
    // Whoever asks for something else is told, and loses nothing.
    assert_fails(
        &trace(at, "--any-hit -o hits.npz"),
        3,
        &["hits.npz.partial", "another batch", "its question is closest"],
    );
    std::fs::write(at.join("two.obj"), "v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n").unwrap();
    let other = raybrook(at, &words("trace two.obj rays.npz --device reference -o hits.npz"));
    assert_fails(&other, 3, &["hits.npz.partial", "its scene has other triangles", "--restart"]);
    let mut others = batch();
    others.origins[RUN_RAYS][0] += 1.0;
    others.write(at.join("others.npz")).unwrap();
    let other = raybrook(at, &words("trace one.obj others.npz --device reference -o hits.npz"));
    assert_fails(&other, 3, &["hits.npz.partial", "its rays are others", "--restart"]);
    assert_fails(&trace(at, "-o hits.npz.partial"), 2, &["hits.npz.partial", "is a journal"]);
    assert_eq!(journal.metadata().unwrap().len(), length);

    let output = stopped(at, "-KILL", length);
    assert!(stderr(&output).contains("goes on with 'hits.npz.partial'"), "{}", stderr(&output));
    let told = assert_succeeds(&trace(at, "-o hits.npz"));
    assert!(told.contains(&format!("{} rays", 3 * RUN_RAYS + 1000)) && !journal.exists(), "{told}");
    assert_succeeds(&trace(at, "--keep never -o whole.npz"));
    assert!(bytes(at, "hits.npz") == bytes(at, "whole.npz"));
}

#[test]
fn parts_of_a_batch_make_the_whole_one() {
    let folder = with_rays();
    let at = folder.path();
    let merge = |journals: &[&str], output: &str, more: &[&str]| {
        raybrook(at, &[&["merge"][..], journals, &["-o", output], more].concat())
    };
    for (number, asked) in ["--any-hit", "--all-hits", "--count"].into_iter().enumerate() {
        assert_succeeds(&trace(at, &format!("{asked} -o whole.npz")));
        let [first, second] = [1, 2].map(|part| format!("{number}.npz.part-{part}-of-2"));
        let told = assert_succeeds(&trace(at, &format!("{asked} -o {number}.npz --part 2/2")));
        assert!(told.contains(&format!("{second}: part 2/2, 2 runs")), "{told}");
        let missing = ["2 of 4 runs are missing", "--part 1/2"];
        assert_fails(&merge(&[&second], "hits.npz", &[]), 3, &missing);
        let auto = format!("trace one.obj rays.npz --device reference {asked} -o {number}.npz --part auto");
        let rank = [("PMI_RANK", "0"), ("PMI_SIZE", "2")];
        assert_succeeds(&raybrook_with(at, &words(&auto), &rank));
        let told = assert_succeeds(&merge(&[&second, &first, &second], "hits.npz", &[]));
        assert!(told.contains("2 runs are in more than one journal") && told.contains("of 3 journals"), "{told}");
        assert!(bytes(at, "hits.npz") == bytes(at, "whole.npz"), "{asked}");
    }
    assert!(!at.join("0.npz").exists() && !at.join("whole.npz.partial").exists());
    // What does not belong together, and what is no batch.
    let of_any = "0.npz.part-1-of-2";
    let of_all = ["1.npz.part-2-of-2", "another batch: its question is all hits, not any hits"];
    assert_fails(&merge(&[of_any, of_all[0]], "hits.npz", &[]), 3, &of_all);
    assert_succeeds(&raybrook(
        at,
        &words("render one.obj --size 8x8 --samples 1 --device reference --part 1/1 -o a.png"),
    ));
    let picture = "a.png.part-1-of-1";
    let mixed = [picture, "is of a picture, but '0.npz.part-1-of-2' is of a batch of rays"];
    assert_fails(&merge(&[of_any, picture], "hits.npz", &[]), 3, &mixed);
    assert_fails(&merge(&[of_any, "one.obj"], "hits.npz", &[]), 3, &["one.obj", "not a journal"]);
    assert_fails(&merge(&[of_any], "hits.png", &[]), 2, &["-o", "no picture"]);
    assert_fails(&merge(&[of_any], "hits.npz", &["--bit-depth", "16"]), 2, &["--bit-depth", "for pictures"]);
    std::fs::copy(at.join(of_any), at.join("b.png.partial")).unwrap();
    let render = raybrook(at, &words("render one.obj --size 8x8 --samples 1 --device reference -o b.png"));
    assert_fails(&render, 3, &["b.png.partial", "is of a batch of rays, not of a picture"]);
    std::fs::copy(at.join(picture), at.join("b.npz.partial")).unwrap();
    assert_fails(&trace(at, "-o b.npz"), 3, &["b.npz.partial", "is of a picture, not of a batch of rays"]);
    assert_fails(&trace(at, "--part 1/2"), 2, &["--output"]);
    assert_fails(&trace(at, "--part 1/2 -o a.npz --counters"), 2, &["--counters"]);

    // A record that is damaged is missing, and traced again.
    let mut journal = bytes(at, "2.npz.part-1-of-2");
    let last = journal.len() - 100;
    journal[last] ^= 1;
    std::fs::write(at.join("2.npz.part-1-of-2"), &journal).unwrap();
    let both = ["2.npz.part-1-of-2", "2.npz.part-2-of-2"];
    assert_fails(&merge(&both, "hits.npz", &[]), 3, &["1 of 4 runs are missing", "--part 1/2"]);
    let told = assert_succeeds(&trace(at, "--count -o 2.npz --part 1/2"));
    assert!(told.contains("goes on with '2.npz.part-1-of-2': 1 of 2 runs are finished"), "{told}");
    assert_succeeds(&merge(&both, "hits.npz", &[]));
    assert!(bytes(at, "hits.npz") == bytes(at, "whole.npz"));
}

#[cfg(unix)]
#[test]
fn a_full_disk_leaves_the_runs_before() {
    let folder = with_rays();
    let at = folder.path();
    // Room for one run or two: dash counts in blocks of 512 bytes, others of 1024.
    let arguments = "trace one.obj rays.npz --device reference --keep always -o hits.npz";
    let limited = format!("ulimit -f {}; exec \"$0\" {arguments}", 20 * RUN_RAYS / 512);
    let output = Command::new("sh").args(["-c", &limited, env!("CARGO_BIN_EXE_raybrook")]).current_dir(at).output();
    let said = ["cannot write 'hits.npz.partial'", "too large", "the runs before are kept", "the same command goes on"];
    assert_fails(&output.unwrap(), 5, &said);
    assert!(!at.join("hits.npz").exists());
    let told = assert_succeeds(&trace(at, "-o hits.npz"));
    assert!(told.contains(" of 4 runs are finished") && !told.contains(": 0 of 4"), "{told}");
    assert_succeeds(&trace(at, "--keep never -o whole.npz"));
    assert!(bytes(at, "hits.npz") == bytes(at, "whole.npz"));
}

#[test]
fn several_devices_trace_the_same_batch() {
    if crate::common::device().is_none() {
        return;
    }
    let folder = with_rays();
    let at = folder.path();
    // The smallest kernels, which compile in a moment.
    let small = "--structure brute --intersector moller-trumbore --packet-size 1";
    let run = |device: &str, more: &str| {
        let command = format!("trace one.obj rays.npz {small} --device {device} {more}");
        raybrook_with(at, &words(&command), &TWO_DEVICES)
    };
    for asked in ["", " --count"] {
        assert_succeeds(&run("reference", &format!("-o one.npz{asked}")));
        for devices in ["all", "0,reference"] {
            let told = assert_succeeds(&run(devices, &format!("-o several.npz --stats several.json{asked}")));
            assert!(told.contains(&format!("{} rays", 3 * RUN_RAYS + 1000)) && told.contains(" + "), "{told}");
            assert!(bytes(at, "several.npz") == bytes(at, "one.npz"), "{devices}{asked}");
            let stats: serde_json::Value = serde_json::from_slice(&bytes(at, "several.json")).unwrap();
            let shares = stats["shares"].as_array().unwrap();
            let runs: u64 = shares.iter().map(|share| share["pieces"].as_u64().unwrap()).sum();
            assert!(shares.len() == 2 && runs == 4, "{shares:?}");
        }
    }
    // A part by several devices, one that one device has begun, and no output at all.
    assert_succeeds(&run("0,reference", "--count -o a.npz --part 1/2"));
    assert_fails(&run("reference", "--count -o a.npz --part 2/2 --time-limit 1us"), 124, &["0 of 2 runs are kept"]);
    let limited = run("all", "--count -o a.npz --part 2/2 --time-limit 1us");
    assert_fails(&limited, 124, &["runs are kept", "the same command goes on", "stopped by --time-limit"]);
    let told = assert_succeeds(&run("all", "--count -o a.npz --part 2/2"));
    assert!(told.contains("goes on with 'a.npz.part-2-of-2'"), "{told}");
    assert_succeeds(&raybrook(at, &words("merge a.npz.part-1-of-2 a.npz.part-2-of-2 -o a.npz")));
    assert!(bytes(at, "a.npz") == bytes(at, "one.npz"));
    assert!(assert_succeeds(&run("all", "--count")).contains(" rays, "));
    assert_fails(&run("all", "-o a.npz --counters"), 2, &["--device", "name one"]);
    assert_fails(&run("all", "-o a.npz --repeat 2"), 2, &["--device", "name one"]);
}
