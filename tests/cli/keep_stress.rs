//! Stress tests that are kept on their way: `stress --json` with `FILE.partial`.

use super::{assert_fails, raybrook, stderr};
use std::path::Path;
use std::process::Output;

const RUN: &str = "stress --rays 100 --intersector thesis --device reference --write wrong";

fn stress(at: &Path, more: &str) -> Output {
    let command = format!("{RUN} {more}");
    raybrook(at, &command.split(' ').collect::<Vec<_>>())
}

/// Starts a run that is kept, and stops it by a signal as soon as something is; or it was faster than that.
fn stopped(at: &Path, signal: &str, kept: u64) -> Output {
    super::keep::stopped(at, &format!("{RUN} --json a.json --keep always"), "a.json.partial", (signal, kept))
}

#[cfg(unix)]
#[test]
fn a_stress_test_that_was_stopped_goes_on() {
    let folder = tempfile::tempdir().unwrap();
    let (at, journal) = (folder.path(), folder.path().join("a.json.partial"));
    let whole = stress(at, "--json whole.json --keep never");
    assert_eq!(whole.status.code(), Some(1), "{}", stderr(&whole));
    let written = |name: &str| std::fs::read(at.join(name)).unwrap();
    let output = stopped(at, "-INT", 4000);
    if output.status.code() == Some(1) {
        return crate::common::skip("the run was at its end before the signal came");
    }
    assert_fails(&output, 130, &["scenes are kept in 'a.json.partial'", "the same command goes on", "SIGINT"]);
    let length = journal.metadata().unwrap().len();
    let output = stopped(at, "-KILL", length + 2000);
    assert!(stderr(&output).contains("goes on with 'a.json.partial'"), "{}", stderr(&output));
    // Whoever asks for something else is told, and loses nothing.
    let kept = std::fs::read(&journal);
    if let Ok(kept) = &kept {
        for (more, says) in [("--seed 2", "its seed is 1, not 2"), ("--strict", "its methods, or how they are judged")]
        {
            let other = stress(at, &format!("--json a.json {more}"));
            assert_fails(&other, 3, &["a.json.partial", "another run", says, "--restart"]);
        }
        assert_fails(&raybrook(at, &["merge", "a.json.partial", "-o", "a.png"]), 3, &["is of a stress test"]);
        assert_fails(&stress(at, "--json a.json.partial"), 2, &["--json", "is a journal, which would be lost"]);
        // A scene whose record is damaged is judged again.
        let mut damaged = kept.clone();
        let place = damaged.len() * 3 / 4;
        damaged[place] ^= 1;
        std::fs::write(&journal, &damaged).unwrap();
    }
    let output = stress(at, "--json a.json");
    assert_eq!(output.status.code(), Some(1), "{}", stderr(&output));
    assert_eq!(
        stderr(&output).contains("are damaged; their scenes are done again"),
        kept.is_ok(),
        "{}",
        stderr(&output)
    );
    assert!(output.stdout == whole.stdout, "{}", String::from_utf8_lossy(&output.stdout));
    assert!(written("a.json") == written("whole.json") && !journal.exists());

    let limited = stress(at, "--json b.json --time-limit 1us");
    assert_fails(&limited, 124, &["0 of ", "scenes are kept in 'b.json.partial'", "stopped by --time-limit"]);
    assert!(!at.join("b.json").exists());
    for more in ["--keep always", "--restart", "--time-limit 2h", "--json a.json --keep always --closed one.obj"] {
        let refused = stress(at, more);
        assert_fails(&refused, 2, &["is kept beside the file of --json"]);
    }
}
