//! The rooms of the library, the files and folders of `src/`: what they take from each other goes one way, as it does
//! between the files of `src/device/`, none of them knows how options are typed, and few names are public. And how long
//! lines are.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// What stands above all rooms: the crate's page, and what passes rooms on.
const ABOVE: [&str; 2] = ["lib", "low_level"];

fn files(folder: &Path, all: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let is_test = path.file_stem().is_some_and(|name| name == "tests");
        if path.is_dir() && !is_test {
            files(&path, all);
        } else if path.extension().is_some_and(|extension| extension == "rs") && !is_test {
            all.push(path);
        }
    }
}

/// The code of the library, by file: without comments, and without the unit tests, which end each file.
fn code() -> Vec<(PathBuf, String)> {
    let source = crate::common::root().join("src");
    let mut all = Vec::new();
    files(&source, &mut all);
    let read = |path: PathBuf| {
        let text = std::fs::read_to_string(&path).unwrap();
        let text = text.split("#[cfg(test)]\nmod tests").next().unwrap_or_default().to_owned();
        let code = text.lines().map(|line| line.split("//").next().unwrap_or_default());
        let code = code.collect::<Vec<_>>().join("\n");
        (path.strip_prefix(&source).unwrap().to_owned(), code)
    };
    all.into_iter().map(read).collect()
}

fn room_of(path: &Path) -> String {
    path.components().next().unwrap().as_os_str().to_str().unwrap().trim_end_matches(".rs").to_owned()
}

/// The names that follow `crate::` in `code`.
fn taken_from(code: &str) -> impl Iterator<Item = String> + '_ {
    let is_name = |c: &char| c.is_ascii_lowercase() || *c == '_';
    code.split("crate::").skip(1).map(move |rest| rest.chars().take_while(is_name).collect())
}

#[test]
fn arrows_between_rooms_go_one_way() {
    let code = code();
    let rooms: BTreeSet<String> =
        code.iter().map(|(path, _)| room_of(path)).filter(|room| !ABOVE.contains(&room.as_str())).collect();
    assert!(rooms.len() > 15, "{rooms:?}");
    let mut arrows = Arrows::new();
    for (path, code) in &code {
        let room = room_of(path);
        if rooms.contains(&room) {
            let others = taken_from(code).filter(|other| *other != room && rooms.contains(other)).collect::<Vec<_>>();
            arrows.entry(room).or_default().extend(others);
        }
    }
    assert_no_circle(arrows);
}

/// What takes from what.
type Arrows = BTreeMap<String, BTreeSet<String>>;

/// Those that take from none that is left are taken away, until there are none, or all take from each other.
fn assert_no_circle(mut arrows: Arrows) {
    while !arrows.is_empty() {
        let left: BTreeSet<String> = arrows.keys().cloned().collect();
        let before = arrows.len();
        arrows.retain(|_, others| others.iter().any(|other| left.contains(other)));
        assert!(arrows.len() < before, "these take from each other in a circle: {arrows:#?}");
    }
}

/// The words of a path, and of a list in braces that it begins with.
fn words_of(path: &str) -> impl Iterator<Item = &str> {
    let mut depth = 0;
    let end = path.find(|c: char| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        depth == 0 && !c.is_alphanumeric() && c != '_' && c != '}'
    });
    path[..end.unwrap_or(path.len())].split(|c: char| !c.is_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

/// A name that `mod.rs` passes on is of the file that has it.
#[test]
fn arrows_between_files_of_the_device_go_one_way() {
    let code = code();
    let inside = |path: &Path| path.strip_prefix("device").ok().map(room_of);
    let files: BTreeSet<String> = code.iter().filter_map(|(path, _)| inside(path)).collect();
    let (_, door) = code.iter().find(|(path, _)| path == Path::new("device/mod.rs")).unwrap();
    let mut passed_on = BTreeMap::new();
    for line in door.split("use ").skip(1) {
        let (file, names) = line.split_once("::").unwrap();
        passed_on.extend(words_of(names).map(|name| (name, file)));
    }
    assert!(files.len() > 30 && passed_on.get("Buffer") == Some(&"buffer"), "{files:?} {passed_on:?}");
    let mut arrows = Arrows::new();
    for (path, code) in &code {
        let Some(file) = inside(path).filter(|file| file != "mod") else { continue };
        let paths = ["super::", "crate::device::"].into_iter().flat_map(|start| code.split(start).skip(1));
        let words = paths.flat_map(words_of).map(|word| passed_on.get(word).copied().unwrap_or(word));
        let others = words.filter(|other| *other != file && files.contains(*other)).map(str::to_owned);
        arrows.entry(file.clone()).or_default().extend(others);
    }
    assert!(arrows["program"].contains("context") && arrows["wavefront"].contains("launch"), "{arrows:#?}");
    assert_no_circle(arrows);
}

#[test]
fn builders_take_nothing_from_the_twin_that_checks_them() {
    for (path, code) in code() {
        let (room, others) = (room_of(&path), taken_from(&code).collect::<BTreeSet<_>>());
        if ["accel", "pack", "scene", "options", "bounds"].contains(&room.as_str()) {
            assert!(!others.contains("reference") && !others.contains("device"), "{}: {others:?}", path.display());
        }
    }
}

/// They are compiled anew for each loop, and took a quarter of the time of a build.
#[test]
fn only_one_room_has_rayons_iterators() {
    let has_them = |code: &str| ["rayon::prelude", "rayon::iter", "par_iter"].iter().any(|name| code.contains(name));
    let rooms: BTreeSet<String> =
        code().iter().filter(|(_, code)| has_them(code)).map(|(path, _)| room_of(path)).collect();
    assert_eq!(rooms, BTreeSet::from(["parallel".to_owned()]));
}

/// The flags of the command line that have one letter.
const SHORT_FLAGS: [&str; 4] = ["-o", "-q", "-v", "-h"];

/// Errors and notes name fields; only the command line knows flags.
#[test]
fn no_flag_is_spelled_in_the_library() {
    for (path, code) in code() {
        let strings = code.split('"').skip(1).step_by(2);
        // The words of .mtl files begin with one `-`.
        let has_short_flags = path != Path::new("scene/mtl.rs");
        let has_flag = |text: &str| {
            let mut rest = text.match_indices("--").map(|(at, _)| text[at + 2..].chars().next());
            let mut words = text.split(|c: char| !c.is_ascii_alphanumeric() && c != '-');
            rest.any(|c| c.is_some_and(|c| c.is_ascii_lowercase()))
                || has_short_flags && words.any(|word| SHORT_FLAGS.contains(&word))
        };
        // What is written into generated files tells developers what to run.
        let found: Vec<_> = strings.filter(|text| has_flag(text) && !text.contains("cargo test")).collect();
        assert!(found.is_empty(), "{}: {found:?}", path.display());
    }
}

/// The names that a file makes public: its own items, and those that it passes on.
fn public_names(code: &str) -> Vec<String> {
    const ITEMS: [&str; 8] = ["const", "enum", "fn", "mod", "static", "struct", "trait", "type"];
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut names = Vec::new();
    for declaration in format!("\n{code}").split("\npub ").skip(1) {
        let (kind, rest) = declaration.split_once(' ').unwrap();
        if kind == "use" {
            let (path, _) = rest.split_once(';').unwrap();
            assert!(!path.contains('*'), "names that are passed on are named: {path}");
            let list = path.split_once('{').map_or(path.rsplit("::").next().unwrap(), |(_, list)| list);
            names.extend(list.split(|c| !is_name(c)).filter(|name| !name.is_empty()).map(str::to_owned));
        } else if ITEMS.contains(&kind) {
            names.push(rest.chars().take_while(|c| is_name(*c)).collect());
        }
    }
    names
}

/// Who embeds the library reads no more than this; what stands in `low_level` is for those who take it apart.
const MOST_PUBLIC_NAMES: usize = 80;

#[test]
fn the_front_door_has_few_names() {
    let code = code();
    let names_in = |file: &str| {
        let (_, code) = code.iter().find(|(path, _)| path.as_path() == Path::new(file)).unwrap();
        public_names(code)
    };
    let front = names_in("lib.rs");
    let rooms = ["low_level", "scene"];
    let modules: Vec<_> = front.iter().filter(|name| code.iter().any(|(path, _)| room_of(path) == **name)).collect();
    assert_eq!(modules, rooms, "another room is public: its names count, too");
    let names: BTreeSet<_> = front.iter().chain(&names_in("scene/mod.rs")).cloned().collect();
    assert!(names.contains("Tracer") && names.contains("Transform") && names.len() > 50, "{names:?}");
    assert!(names.len() <= MOST_PUBLIC_NAMES, "{}: {names:?}", names.len());
}

/// Columns of a line of text.
const COLUMNS: usize = 120;

/// Everything that people wrote, and what is generated for them to read. Rows of tables in doc comments cannot be
/// broken, nor can addresses.
#[test]
fn lines_fit_the_page() {
    fn long_lines(folder: &Path, found: &mut Vec<String>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            let is_text = path.extension().is_some_and(|end| ["rs", "cl", "py", "sh"].iter().any(|text| end == *text));
            if path.is_dir() {
                long_lines(&path, found);
            } else if is_text {
                for (number, line) in std::fs::read_to_string(&path).unwrap().lines().enumerate() {
                    let is_row = ["//! |", "/// |"].iter().any(|row| line.trim_start().starts_with(row));
                    if line.chars().count() > COLUMNS && !is_row && !line.contains("://") {
                        found.push(format!("{}:{}", path.display(), number + 1));
                    }
                }
            }
        }
    }
    let (root, mut found) = (crate::common::root(), Vec::new());
    for folder in ["src", "cl", "crates", "tests", "benches", "examples"] {
        long_lines(&root.join(folder), &mut found);
    }
    assert!(found.is_empty(), "more than {COLUMNS} columns: {found:#?}");
}
