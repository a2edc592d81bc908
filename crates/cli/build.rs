//! Tells the program which commit it was made of, for reports: of a checkout git's, of a package cargo's.

use std::fs;
use std::process::Command;

fn main() {
    // Where a package was made, cargo wrote it down: {"git": {"sha1": "…"}, …}.
    let packaged = fs::read_to_string(".cargo_vcs_info.json").ok();
    let of_package = packaged.as_deref().and_then(|text| text.split("\"sha1\"").nth(1)?.split('"').nth(1));
    let commit = of_package.map(|sha| sha.chars().take(7).collect()).or_else(described).unwrap_or_default();
    println!("cargo::rustc-env=RAYBROOK_COMMIT={commit}");
    println!("cargo::rerun-if-changed=build.rs");
    for file in ["HEAD", "logs/HEAD"].map(|name| format!("../../.git/{name}")) {
        if fs::exists(&file).unwrap_or(false) {
            println!("cargo::rerun-if-changed={file}");
        }
    }
}

/// The commit of the checkout; `None` where there is none, or no git.
fn described() -> Option<String> {
    fs::exists("../../.git").ok().filter(|is_there| *is_there)?;
    let output = Command::new("git").args(["rev-parse", "--short=7", "HEAD"]).output().ok()?;
    output.status.success().then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}
