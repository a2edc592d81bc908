//! Pictures that are kept on their way: `OUT.partial`, `--part` and `raybrook merge`.

use super::{assert_fails, folder, raybrook, raybrook_with, stderr};
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// Renders the scene of one triangle into a picture of eight bands.
fn render(at: &Path, more: &[&str]) -> std::process::Output {
    let arguments = ["render", "one.obj", "--size", "1024x1024", "--samples", "1", "--device", "reference"];
    raybrook(at, &[&arguments[..], more].concat())
}

fn bytes(at: &Path, name: &str) -> Vec<u8> {
    std::fs::read(at.join(name)).unwrap()
}

fn assert_succeeds(output: &std::process::Output) -> String {
    assert!(output.status.success(), "{}", stderr(output));
    format!("{}{}", stderr(output), String::from_utf8_lossy(&output.stdout))
}

/// A picture with some work: 32 bands of 262,144 rays.
fn start(at: &Path) -> Child {
    Command::new(env!("CARGO_BIN_EXE_raybrook"))
        .args("render one.obj --size 2048x2048 --samples 2 --device reference --keep always -o a.pfm".split(' '))
        .current_dir(at)
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap()
}

/// Waits until the journal is longer than so many bytes, or the run has ended. Whether it still runs.
fn wait_for(run: &mut Child, journal: &Path, bytes: u64) -> bool {
    let start = Instant::now();
    while start.elapsed() < Duration::from_secs(60) {
        if run.try_wait().unwrap().is_some() {
            return false;
        }
        if journal.metadata().is_ok_and(|found| found.len() > bytes) {
            return true;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("nothing was kept in a minute");
}

/// Starts a run, and stops it by a signal as soon as its journal is longer than `kept` bytes; or it was faster than
/// that.
pub fn stopped(at: &Path, words: &str, journal: &str, (signal, kept): (&str, u64)) -> Output {
    let mut run = Command::new(env!("CARGO_BIN_EXE_raybrook"))
        .args(words.split_whitespace())
        .current_dir(at)
        .stderr(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    wait_for(&mut run, &at.join(journal), kept);
    let _ = Command::new("kill").args([signal, &run.id().to_string()]).stderr(Stdio::null()).status();
    run.wait_with_output().unwrap()
}

#[test]
fn a_run_that_is_killed_goes_on_with_the_same_bits() {
    let folder = folder();
    let (at, journal) = (folder.path(), folder.path().join("a.pfm.partial"));
    let (mut kept, mut killed) = (1000, 0);
    loop {
        let mut run = start(at);
        if !wait_for(&mut run, &journal, kept) {
            assert_succeeds(&run.wait_with_output().unwrap());
            break;
        }
        run.kill().unwrap();
        let output = run.wait_with_output().unwrap();
        assert_eq!(stderr(&output).contains("goes on with 'a.pfm.partial'"), killed > 0, "{}", stderr(&output));
        assert!(!at.join("a.pfm").exists(), "no picture before it is complete");
        let length = journal.metadata().unwrap().len();
        assert!(length >= kept, "what was kept stays");
        (kept, killed) = (length, killed + 1);
    }
    assert!(killed > 0 && !journal.exists());
    let whole = "render one.obj --size 2048x2048 --samples 2 --device reference --keep never -o b.pfm";
    assert_succeeds(&raybrook(at, &whole.split(' ').collect::<Vec<_>>()));
    assert!(bytes(at, "a.pfm") == bytes(at, "b.pfm"), "killed {killed} times");
}

#[test]
fn a_journal_without_a_whole_header_is_as_none() {
    let folder = folder();
    let at = folder.path();
    assert_succeeds(&render(at, &["--keep", "never", "-o", "whole.pfm"]));
    assert_succeeds(&render(at, &["--part", "1/1", "-o", "a.pfm"]));
    let journal = bytes(at, "a.pfm.part-1-of-1");
    let modes = [&[][..], &["--keep", "always"], &["--restart"], &["--keep", "always", "--restart"]];
    for (cut, more) in [0, 7, 16, 100].into_iter().zip(modes) {
        std::fs::write(at.join("b.pfm.partial"), &journal[..cut]).unwrap();
        let told = assert_succeeds(&render(at, &[&["-o", "b.pfm"], more].concat()));
        assert!(!told.contains("goes on") && !at.join("b.pfm.partial").exists(), "{cut}: {told}");
        assert!(bytes(at, "b.pfm") == bytes(at, "whole.pfm"));
    }
    std::fs::write(at.join("a.pfm.part-1-of-1"), &journal[..7]).unwrap();
    assert_succeeds(&render(at, &["--part", "1/1", "-o", "a.pfm"]));
    assert_succeeds(&raybrook(at, &["merge", "a.pfm.part-1-of-1", "-o", "c.pfm"]));
    assert!(bytes(at, "c.pfm") == bytes(at, "whole.pfm"));
    // What is left alone: what is no journal, and any where nothing is to be kept.
    for (text, more, code) in [
        ("notes", &[][..], 3),
        ("notes", &["--restart"], 3),
        ("raybrook", &["--keep", "never"], 0),
        ("", &["--keep", "never"], 0),
    ] {
        std::fs::write(at.join("b.pfm.partial"), text).unwrap();
        let output = render(at, &[&["-o", "b.pfm"], more].concat());
        assert_eq!(output.status.code(), Some(code), "{}", stderr(&output));
        assert_eq!(bytes(at, "b.pfm.partial"), text.as_bytes());
    }
}

#[cfg(unix)]
#[test]
fn a_run_that_is_interrupted_says_what_is_kept() {
    let folder = folder();
    let (at, journal) = (folder.path(), folder.path().join("a.pfm.partial"));
    let mut run = start(at);
    assert!(wait_for(&mut run, &journal, 1000));
    let id = run.id().to_string();
    assert!(Command::new("kill").args(["-INT", &id]).status().unwrap().success());
    let output = run.wait_with_output().unwrap();
    assert_fails(&output, 130, &["of 32 blocks are kept in 'a.pfm.partial'", "the same command goes on", "SIGINT"]);
    assert!(journal.exists() && !at.join("a.pfm").exists());
    // Whoever asks for another picture is told, and loses nothing.
    let other = |more: &[&str]| {
        let arguments = "render one.obj --size 2048x2048 --samples 1 --device reference -o a.pfm";
        raybrook(at, &[&arguments.split(' ').collect::<Vec<_>>()[..], more].concat())
    };
    assert_fails(&other(&[]), 3, &["a.pfm.partial", "another picture", "its samples is 2, not 1", "--restart"]);
    assert!(journal.exists() && !at.join("a.pfm").exists());
    assert_succeeds(&other(&["--keep", "never"]));
    assert!(journal.exists());
    assert_succeeds(&other(&["--restart"]));
    assert!(!journal.exists());
}

#[test]
fn damaged_blocks_are_rendered_again() {
    let folder = folder();
    let at = folder.path();
    // A part is a journal that stays.
    assert_succeeds(&render(at, &["-o", "a.pfm", "--part", "1/1"]));
    let mut journal = bytes(at, "a.pfm.part-1-of-1");
    let middle = journal.len() / 2;
    journal[middle] ^= 1;
    std::fs::write(at.join("a.pfm.partial"), &journal).unwrap();
    assert_fails(&render(at, &["-o", "a.pfm"]), 3, &["is of part 1/1, not of the whole picture"]);
    std::fs::write(at.join("a.pfm.part-1-of-1"), &journal).unwrap();
    assert_fails(&raybrook(at, &["merge", "a.pfm.part-1-of-1", "-o", "a.pfm"]), 3, &["8 of 8 blocks are missing"]);
    let told = assert_succeeds(&render(at, &["-o", "a.pfm", "--part", "1/1"]));
    assert!(told.contains("bytes of 'a.pfm.part-1-of-1' are damaged") || told.contains("0 of 8 blocks"), "{told}");
    assert_succeeds(&raybrook(at, &["merge", "a.pfm.part-1-of-1", "-o", "a.pfm"]));
    assert_succeeds(&render(at, &["-o", "b.pfm"]));
    assert!(bytes(at, "a.pfm") == bytes(at, "b.pfm"));
}

#[test]
fn parts_make_the_whole_picture() {
    let folder = folder();
    let at = folder.path();
    assert_succeeds(&render(at, &["-o", "whole.png"]));
    assert!(!at.join("whole.png.partial").exists());
    let names = [1, 2, 3].map(|part| format!("a.png.part-{part}-of-3"));
    let merge = |names: &[&String], more: &[&str]| {
        let names: Vec<&str> = names.iter().map(|name| name.as_str()).collect();
        raybrook(at, &[&["merge"][..], &names, &["-o", "a.png"], more].concat())
    };
    let told = assert_succeeds(&render(at, &["-o", "a.png", "--part", "3/3"]));
    assert!(told.contains("a.png.part-3-of-3: part 3/3, 2 blocks"), "{told}");
    let missing = ["6 of 8 blocks are missing", "--part 1/3, 2/3"];
    assert_fails(&merge(&[&names[2]], &[]), 3, &missing);
    let with = |variables: &[(&str, &str)]| {
        let arguments = "render one.obj --size 1024x1024 --samples 1 --device reference -o a.png --part auto";
        raybrook_with(at, &arguments.split(' ').collect::<Vec<_>>(), variables)
    };
    assert_succeeds(&with(&[("OMPI_COMM_WORLD_RANK", "0"), ("OMPI_COMM_WORLD_SIZE", "3")]));
    assert_succeeds(&with(&[("PMI_RANK", "1"), ("PMI_SIZE", "3")]));
    let told = assert_succeeds(&merge(&[&names[1], &names[2], &names[0]], &[]));
    assert!(told.contains("a.png: 1024x1024 of 3 journals"), "{told}");
    assert!(bytes(at, "a.png") == bytes(at, "whole.png"));
    // A part again, and a part twice: the same picture.
    let told = assert_succeeds(&render(at, &["-o", "a.png", "--part", "3/3"]));
    assert!(told.contains("2 of 2 blocks are finished"), "{told}");
    let told = assert_succeeds(&merge(&[&names[1], &names[2], &names[0], &names[2]], &["--bit-depth", "16"]));
    assert!(told.contains("2 blocks are in more than one journal"), "{told}");
    // Parts of other pictures, other files, an output that is a journal.
    assert_succeeds(&render(at, &["-o", "b.png", "--depth", "1", "--part", "1/3"]));
    let other = "b.png.part-1-of-3".to_owned();
    assert_fails(
        &merge(&[&names[0], &other], &[]),
        3,
        &["b.png.part-1-of-3", "another picture: its depth is 1, not 8"],
    );
    assert_succeeds(&render(at, &["-o", "c.png", "--terminator", "hard", "--part", "2/3"]));
    let other = "c.png.part-2-of-3".to_owned();
    assert_fails(&merge(&[&names[0], &other], &[]), 3, &["c.png.part-2-of-3", "its terminator is hard, not smooth"]);
    assert_fails(&merge(&[&names[0], &"one.obj".to_owned()], &[]), 3, &["one.obj", "not a journal"]);
    assert_fails(&merge(&[&names[0], &"no.part".to_owned()], &[]), 3, &["no.part"]);
    assert_fails(&raybrook(at, &["merge", &names[0], "-o", &names[0]]), 2, &["must end in .png, .exr or .pfm"]);
    assert_fails(&with(&[]), 2, &["--part", "PMI_RANK"]);
}

#[test]
fn a_crop_is_kept_and_merged_too() {
    let folder = folder();
    let at = folder.path();
    let crop = ["--crop", "100,50,700x900"];
    assert_succeeds(&render(at, &[&crop[..], &["-o", "whole.pfm"]].concat()));
    for part in ["1/2", "2/2"] {
        assert_succeeds(&render(at, &[&crop[..], &["-o", "a.pfm", "--part", part]].concat()));
    }
    assert_succeeds(&raybrook(at, &["merge", "a.pfm.part-1-of-2", "a.pfm.part-2-of-2", "-o", "a.pfm"]));
    assert!(bytes(at, "a.pfm") == bytes(at, "whole.pfm"));
}

#[test]
fn pictures_by_their_error_are_merged_from_parts_of_any_device() {
    let folder = folder();
    let at = folder.path();
    let devices = crate::common::device().map(|device| device.info.index.to_string());
    let devices = ["reference".to_owned(), devices.unwrap_or_else(|| "reference".to_owned())];
    let run = |device: &str, error: &str, more: &[&str]| {
        let arguments = ["render", "one.obj", "--size", "700x600", "--error", error, "--device", device];
        assert_succeeds(&raybrook(at, &[&arguments[..], more].concat()));
    };
    for error in ["1", "4"] {
        run("reference", error, &["-o", "whole.pfm"]);
        let names = ["1/2", "2/2"].map(|part| format!("{error}.pfm.part-{}", part.replace('/', "-of-")));
        for (part, device) in ["1/2", "2/2"].into_iter().zip(&devices) {
            run(device, error, &["-o", &format!("{error}.pfm"), "--part", part]);
        }
        assert_succeeds(&raybrook(at, &["merge", &names[0], &names[1], "-o", "a.pfm"]));
        assert!(bytes(at, "a.pfm") == bytes(at, "whole.pfm"), "error {error}");
    }
}

/// PoCL has two kinds of devices for the same processor.
pub const TWO_DEVICES: [(&str, &str); 1] = [("POCL_DEVICES", "pthread basic")];

#[test]
fn several_devices_make_the_same_picture() {
    if crate::common::device().is_none() {
        return;
    }
    let folder = folder();
    let at = folder.path();
    let run = |devices: &str, picture: &str, more: &[&str]| {
        let picture: Vec<&str> = picture.split(' ').collect();
        let arguments = [&["render", "one.obj", "--device", devices][..], &picture, more].concat();
        raybrook_with(at, &arguments, &TWO_DEVICES)
    };
    for picture in ["--size 1024x1024 --samples 1", "--size 1500x900 --error 2"] {
        assert_succeeds(&run("reference", picture, &["-o", "one.pfm"]));
        for devices in ["all", "0,reference"] {
            assert_succeeds(&run(devices, picture, &["-o", "several.pfm", "--stats", "several.json"]));
            assert!(bytes(at, "several.pfm") == bytes(at, "one.pfm"), "{devices} {picture}");
            let stats: serde_json::Value = serde_json::from_slice(&bytes(at, "several.json")).unwrap();
            let shares = stats["shares"].as_array().unwrap();
            let blocks: u64 = shares.iter().map(|share| share["pieces"].as_u64().unwrap()).sum();
            assert!(shares.len() >= 2 && blocks >= 3, "{shares:?}");
        }
    }
    assert_fails(&run("0,0", "--size 8x8", &["-o", "a.png"]), 2, &["--device", "named before"]);
    assert_fails(&run("0,reference", "--size 8x8", &["-o", "a.png", "--counters"]), 2, &["--device", "name one"]);
    assert_fails(&run("0,no such", "--size 8x8", &["-o", "a.png"]), 4, &["no such"]);
}
