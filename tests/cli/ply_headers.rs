//! PLY files whose headers promise more than there is.
#![cfg(target_os = "linux")]

use crate::common::ply::{CORNERS, FORMATS, XYZ};

/// Memory that a program may take beside what hostile headers ask for, KiB.
const MEMORY_KIB: u32 = 2 << 20;

#[test]
fn hostile_headers_do_not_fill_the_memory() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ply");
    let count = "4000000000";
    let list = "property list uint uint vertex_indices";
    for header in [
        format!("element vertex {count}\n{XYZ}\nelement face {count}\n{CORNERS}"),
        format!("element face {count}\n{list}\nelement vertex {count}\n{XYZ}"),
        format!("element other {count}\n{list}\nelement face 1\n{list}\nelement vertex 1\n{XYZ}"),
        format!("element vertex 1\n{XYZ}\nelement face {count}\n{list}\nproperty list uint float texcoord"),
    ] {
        for format in FORMATS {
            // 0xffffffff or "4294967295" as the first count of a list.
            let data: &[u8] = if format == "ascii" { b"4294967295 4294967295 0 0\n" } else { &[0xff; 64] };
            let file = [format!("ply\nformat {format} 1.0\n{header}\nend_header\n").as_bytes(), data].concat();
            std::fs::write(&path, file).unwrap();
            let run = std::process::Command::new("sh")
                .args(["-c", &format!("ulimit -v {MEMORY_KIB}; exec \"$0\" info \"$1\"")])
                .arg(env!("CARGO_BIN_EXE_raybrook"))
                .arg(&path)
                .output()
                .unwrap();
            let message = String::from_utf8_lossy(&run.stderr).into_owned();
            assert_eq!(run.status.code(), Some(3), "{format} {header}: {message}");
            assert!(message.contains("a.ply"), "{format} {header}: {message}");
        }
    }
}
