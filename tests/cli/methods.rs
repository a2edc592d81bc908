//! `raybrook methods`: complete.

use raybrook::low_level::options::{
    Build, Intersector, Kernels, Layout, Memory, NodeOrder, OPTIONS, SplitAxis, Stop, StructureKind, TexturePass,
    Traversal, TriangleOrder, choices, never_together,
};
use std::process::Command;

fn methods(arguments: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_raybrook")).arg("methods").args(arguments).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

/// `--leaf-size` of `leaf_size`.
fn flag(name: &str) -> String {
    format!("--{}", name.replace('_', "-"))
}

/// Every name of every enum, with its option: from the enums, not from the table that is tested.
fn all_names() -> Vec<(String, &'static str, String)> {
    let mut names = Vec::new();
    macro_rules! add {
        ($($enum:ident),+) => {
            $(names.extend($enum::ALL.iter().map(|value| (flag($enum::OPTION), value.name(), value.about())));)+
        };
    }
    add!(StructureKind, Build, Traversal, Intersector, Memory, Layout, NodeOrder, TriangleOrder, SplitAxis, Stop);
    add!(Kernels, TexturePass);
    names
}

#[test]
fn text_and_json_have_every_name() {
    let text = methods(&[]);
    assert!(text.lines().all(|line| line.chars().count() <= 100), "{text}");
    // Descriptions are broken into lines.
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    let json: serde_json::Value = serde_json::from_str(&methods(&["--json"])).unwrap();
    let find = |list: &serde_json::Value, key: &str, name: &str| {
        let entry = list.as_array().unwrap().iter().find(|entry| entry[key] == name);
        entry.unwrap_or_else(|| panic!("no {name} in {list}")).clone()
    };
    for (option, name, about) in all_names() {
        assert!(!about.is_empty() && !about.contains(['`', '[', '\n']), "{option} {name}: {about}");
        assert!(words.contains(&format!("{name} {about}")), "{option} {name}: {about} is not in {words}");
        let value = find(&find(&json["options"], "option", &option)["values"], "name", name);
        let choice =
            choices().find(|c| c.to_string() == format!("{} = {name}", option[2..].replace('-', "_"))).unwrap();
        assert_eq!(value["about"], about);
        assert_eq!(value["default"], choice.is_default());
        assert_eq!(words.contains(&format!("* {name} {about}")), choice.is_default(), "{option} {name}");
    }
    for option in OPTIONS.iter().filter(|option| option.is_number()) {
        assert!(text.contains(&flag(option.name)), "{}", option.name);
        find(&json["numbers"], "option", &flag(option.name));
    }
    assert_eq!(
        find(&json["numbers"], "option", "--stack-size")["needs"],
        serde_json::json!(["--traversal short-stack"])
    );
    assert_eq!(json["never_together"].as_array().unwrap().len(), never_together().len());
    assert!(!json["never_together"][0]["reason"].as_str().unwrap().is_empty());
}
