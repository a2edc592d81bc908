//! The generated headers are fresh, and no constant is typed twice. That host and device agree on every offset is
//! tested in `kernels.rs`.

use raybrook::low_level::shared::{constants_cl, types_cl};
use std::collections::HashSet;
use std::path::{Path, PathBuf};

#[test]
fn generated_files_are_fresh() {
    for (path, text) in [("cl/shared/types.cl", types_cl()), ("cl/shared/constants.cl", constants_cl())] {
        let path = crate::common::root().join(path);
        if std::env::var_os("UPDATE").is_some() {
            std::fs::write(&path, &text).unwrap();
        }
        let checked_in = std::fs::read_to_string(&path).unwrap_or_default();
        assert_eq!(checked_in, text, "stale: run `UPDATE=1 cargo test --test device layout`");
    }
}

/// Numbers of `cl/` whose names Rust has for something else.
const OTHER_NUMBERS: [(&str, &str); 2] = [
    ("MAX_LIMBS", "the twin's integers are longer: it also traces rays that no kernel gets"),
    ("STACK_SIZE", "a default for a file that is compiled alone; the oracle's stack is another one"),
];

/// The files below `folder` that end in `.extension`.
fn files_in(folder: &Path, extension: &str) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(files_in(&path, extension));
        } else if path.extension().is_some_and(|end| end == extension) {
            found.push(path);
        }
    }
    found
}

/// The name in `#define NAME value`, where the value is a number, or what is computed from other names, and `NAME` is
/// no function.
fn defined_number(line: &str) -> Option<&str> {
    let (name, value) = line.trim().strip_prefix("#define ")?.trim_start().split_once(' ')?;
    let value = value.split("//").next()?.trim();
    (!value.is_empty() && !value.starts_with('{') && !name.contains('(')).then_some(name)
}

/// The name in `const NAME: f32 = …`, or another number's type.
fn declared_number(line: &str) -> Option<&str> {
    const NUMBERS: [&str; 10] = ["f32", "f64", "u8", "u16", "u32", "u64", "usize", "i32", "i64", "Vec3"];
    let (_, declaration) = line.split_once("const ")?;
    let (name, rest) = declaration.split_once(": ")?;
    NUMBERS.contains(&rest.split_once(" =")?.0).then_some(name)
}

/// Shared constants are declared by `device_const!`, which writes their definitions.
#[test]
fn no_number_is_typed_in_rust_and_again_in_kernels() {
    let root = crate::common::root();
    let read = |path: &PathBuf| std::fs::read_to_string(path).unwrap();
    let texts: Vec<String> = files_in(&root.join("src"), "rs").iter().map(read).collect();
    let of_rust: HashSet<&str> = texts.iter().flat_map(|text| text.lines().filter_map(declared_number)).collect();
    assert!(of_rust.contains("EPSILON") && of_rust.contains("NO_PRIMITIVE"));
    let mut excused = HashSet::new();
    for path in files_in(&root.join("cl"), "cl") {
        if path.ends_with("cl/shared/constants.cl") {
            continue;
        }
        for (number, line) in read(&path).lines().enumerate() {
            let Some(name) = defined_number(line).filter(|name| of_rust.contains(name)) else { continue };
            let is_other = OTHER_NUMBERS.iter().any(|(other, _)| *other == name);
            assert!(is_other, "{}:{}: {name} is a constant of Rust: device_const! it", path.display(), number + 1);
            excused.insert(name.to_owned());
        }
    }
    assert_eq!(excused.len(), OTHER_NUMBERS.len(), "an exception is no longer one: {excused:?}");
}
