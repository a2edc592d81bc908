//! Other tracers: they get the rays of `pareto`, and what they answer is judged, whatever their files say.

use crate::{assert_fails, folder, raybrook, stderr};
use glam::Vec3;
use raybrook::low_level::options::TraceOptions;
use raybrook::low_level::shared::{Hit, NO_PRIMITIVE};
use raybrook_lab::stress::{Case, Found, Mesh, StressRay};
use raybrook_lab::study::{Lab, Peer, Study};
use serde_json::{Value, json};
use std::path::Path;

const EXPORT: [&str; 7] = ["study", "pareto", "--quick", "--device", "reference", "--export-rays", "rays"];
const REPORT: [&str; 7] = ["study", "pareto", "--quick", "--device", "reference", "-o", "report"];

fn read_json(path: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap()
}

/// The rays of `folder`, exported on the reference, and the manifest.
fn exported(folder: &Path) -> Value {
    let made = raybrook(folder, &EXPORT);
    assert!(made.status.success(), "{}", stderr(&made));
    read_json(&folder.join("rays/manifest.json"))
}

/// A set's mesh and rays as a stranger reads them.
fn case_of(folder: &Path, set: &Value) -> Case {
    let words = |key: &str| -> Vec<[u8; 4]> {
        let bytes = std::fs::read(folder.join("rays").join(set[key].as_str().unwrap())).unwrap();
        bytes.chunks(4).map(|word| word.try_into().unwrap()).collect()
    };
    let vectors = |words: &[[u8; 4]]| -> Vec<Vec3> {
        let numbers: Vec<f32> = words.iter().map(|&word| f32::from_le_bytes(word)).collect();
        numbers.chunks(3).map(|xyz| Vec3::new(xyz[0], xyz[1], xyz[2])).collect()
    };
    let mesh = words("mesh_bin");
    let vertices = u32::from_le_bytes(mesh[0]) as usize;
    let corners: Vec<u32> = mesh[2 + 3 * vertices..].iter().map(|&word| u32::from_le_bytes(word)).collect();
    let triangles = corners.chunks(3).map(|abc| [abc[0], abc[1], abc[2]]).collect();
    let rays = words("rays_bin");
    let count = u32::from_le_bytes(rays[0]) as usize;
    let ray = |words: &[[u8; 4]]| {
        let at = |i: usize| f32::from_le_bytes(words[i]);
        let (origin, direction) = (vectors(&words[..3])[0], vectors(&words[4..7])[0]);
        StressRay::new(origin, direction).within(at(3), at(7))
    };
    assert_eq!(rays.len(), 2 + 8 * count);
    Case {
        mesh: Mesh { positions: vectors(&mesh[2..2 + 3 * vertices]), triangles },
        rays: rays[2..].chunks(8).map(ray).collect(),
        any_hit: set["query"] == "any",
    }
}

fn write_answers(path: &Path, hits: &[Hit]) {
    let words = |hit: &Hit| [hit.t.to_bits(), hit.u.to_bits(), hit.v.to_bits(), hit.primitive];
    let bytes: Vec<u8> = hits.iter().flat_map(words).flat_map(u32::to_le_bytes).collect();
    std::fs::write(path, bytes).unwrap();
}

/// Writes the results `NAME.json` of a tracer whose answers are raybrook's own, but for what `alter` does with those to
/// a set.
fn write_peer(folder: &Path, manifest: &Value, name: &str, alter: impl Fn(&str, &mut [Hit])) -> Value {
    let sets = manifest["sets"].as_array().unwrap().iter().map(|set| {
        let case = case_of(folder, set);
        let mut hits = Found::new(&case, &TraceOptions::DEFAULT, None, None).unwrap().hits;
        alter(set["name"].as_str().unwrap(), &mut hits);
        let answers = format!("{name}-{}.bin", set["name"].as_str().unwrap());
        write_answers(&folder.join(&answers), &hits);
        let seconds = if set.get("scene").is_some() { json!([0.002, 0.001, 0.004]) } else { json!([]) };
        let mut entry = json!({"set": set["name"], "seconds": seconds, "answers": answers});
        ["checksum", "rays"].iter().for_each(|&key| entry[key] = set[key].clone());
        entry
    });
    let sets: Vec<Value> = sets.collect();
    let identity = ["checksum", "version", "seed", "quick", "side"];
    let rays: Value = identity.iter().map(|&key| (key.to_owned(), manifest[key].clone())).collect();
    let results = json!({
        "format": "raybrook peer 1", "rays": rays, "name": name, "version": "1.0", "mode": "made up",
        "machine": "a machine", "threads": 3, "clock": "wall clock", "sets": sets,
    });
    std::fs::write(folder.join(format!("{name}.json")), results.to_string()).unwrap();
    results
}

/// Hits become misses and misses hits, triangles others, and numbers none.
fn break_some(set: &str, hits: &mut [Hit]) {
    let first = |hits: &[Hit], is_hit: bool, n: usize| -> Vec<usize> {
        (0..hits.len()).filter(|&i| (hits[i].primitive != NO_PRIMITIVE) == is_hit).take(n).collect()
    };
    match set {
        "scene-1-boulder-camera" => {
            for i in first(hits, false, 2) {
                hits[i] = Hit { t: 1.0, u: 0.1, v: 0.1, primitive: 0 };
            }
            let some = first(hits, true, 20);
            some[5..8].iter().for_each(|&i| hits[i].primitive = NO_PRIMITIVE);
            some[8..10].iter().for_each(|&i| hits[i].primitive = (hits[i].primitive + 1024) % 2048);
            hits[some[10]].t = f32::NAN;
        }
        "scene-1-boulder-shadow" => {
            for i in first(hits, true, 4) {
                hits[i].primitive = NO_PRIMITIVE;
            }
        }
        // From inside of a closed mesh: every ray hits.
        "stress-edges" => {
            hits[3].primitive = NO_PRIMITIVE;
            hits[4].primitive = (hits[4].primitive + 1024) % 2048;
            hits[5].t *= 1.01;
            hits[6].u = f32::INFINITY;
            hits[7].t = f32::NAN;
        }
        _ => (),
    }
}

/// The rows of a table of the report's data.
fn rows(data: &Value, table: &str) -> Vec<Value> {
    let tables = data["tables"].as_array().unwrap();
    let table = tables.iter().find(|found| found["name"] == table).unwrap_or_else(|| panic!("no table {table}"));
    table["rows"].as_array().unwrap().clone()
}

/// A method's wrong answers: of the sets in a column of a table, those that are not 0.
fn wrong(data: &Value, table: &str, column: &str, method: &str) -> Vec<(String, u64)> {
    let own = rows(data, table).into_iter().filter(|row| row["method"] == method);
    let counted: Vec<_> =
        own.map(|row| (row[column].as_str().unwrap().to_owned(), row["wrong"].as_u64().unwrap())).collect();
    assert!(counted.len() >= 3, "{method} is in {table}: {counted:?}");
    counted.into_iter().filter(|(_, wrong)| *wrong > 0).collect()
}

#[test]
fn the_same_rays_are_written_for_the_same_seed() {
    let (one, two) = (folder(), folder());
    let manifest = exported(one.path());
    assert_eq!(exported(two.path()), manifest);
    let names = |at: &Path| -> Vec<_> {
        let mut names: Vec<_> =
            std::fs::read_dir(at.join("rays")).unwrap().map(|file| file.unwrap().file_name()).collect();
        names.sort();
        names
    };
    let files = names(one.path());
    assert_eq!(files, names(two.path()));
    for file in &files {
        let read = |at: &Path| std::fs::read(at.join("rays").join(file)).unwrap();
        assert!(read(one.path()) == read(two.path()), "{file:?} differs");
    }
    // What is there is replaced; another seed has other rays.
    let other = raybrook(one.path(), &[&EXPORT[..], &["--seed", "2"]].concat());
    assert!(other.status.success(), "{}", stderr(&other));
    let other = read_json(&one.path().join("rays/manifest.json"));
    assert!(other["seed"] == 2 && other["checksum"] != manifest["checksum"]);
    // The program reads its own files: the same hits as of the flat ones.
    let set = &manifest["sets"][0];
    let [mesh, rays] = ["mesh_obj", "rays_npz"].map(|key| format!("rays/{}", set[key].as_str().unwrap()));
    let traced = raybrook(two.path(), &["trace", &mesh, &rays, "--device", "reference", "-o", "hits.npz"]);
    assert!(traced.status.success(), "{}", stderr(&traced));
    let hits = Found::new(&case_of(two.path(), set), &TraceOptions::DEFAULT, None, None).unwrap().hits;
    let mut archive = zip::ZipArchive::new(std::fs::File::open(two.path().join("hits.npz")).unwrap()).unwrap();
    let mut bytes = Vec::new();
    std::io::Read::read_to_end(&mut archive.by_name("primitive.npy").unwrap(), &mut bytes).unwrap();
    let numbers: Vec<u8> = hits.iter().flat_map(|hit| hit.primitive.to_le_bytes()).collect();
    assert!(hits.len() == 1024 && bytes.ends_with(&numbers), "other hits than of the flat files");
}

#[test]
fn the_answers_of_other_tracers_are_judged() {
    let folder = folder();
    let at = folder.path();
    let manifest = exported(at);
    write_peer(at, &manifest, "right", |_, _| ());
    write_peer(at, &manifest, "wrong", break_some);
    let made = raybrook(at, &[&REPORT[..], &["--peer", "right.json", "wrong.json"]].concat());
    assert!(made.status.success(), "{}", stderr(&made));
    let data = read_json(&at.join("report/data/pareto.json"));
    let [right, bad] = ["right", "wrong"].map(|name| format!("{name} 1.0 made up, 3 threads"));
    for (table, column) in [("rays", "rays_of"), ("modes", "mode")] {
        assert_eq!(wrong(&data, table, column, &right), [], "{table}");
    }
    assert_eq!(wrong(&data, "rays", "rays_of", &bad), [("camera".to_owned(), 8), ("shadow".to_owned(), 4)]);
    assert_eq!(wrong(&data, "modes", "mode", &bad), [("edges".to_owned(), 5)]);
    let stress = rows(&data, "stress");
    let of = |method: &str| stress.iter().find(|row| row["method"] == method).unwrap();
    assert_eq!((&of(&right)["wrong"], &of(&bad)["wrong"], &of(&bad)["tested"]), (&json!(0), &json!(5), &json!(240)));
    assert!(of(&right)["wrong_bound"].as_f64() < of(&bad)["wrong_bound"].as_f64());
    assert_eq!(of(&right)["tracer"], "other tracers (wall clock)");
    assert_eq!(of("bvh2, exact")["tracer"], "raybrook (wall clock)", "the reference has no other clock");
    // The median pass, the slowest and the fastest.
    let camera = rows(&data, "rays").into_iter().find(|row| row["method"] == json!(right)).unwrap();
    let rates = ["mrays_per_s", "mrays_low", "mrays_high"].map(|key| camera[key].as_f64().unwrap());
    assert_eq!(rates, [0.512, 0.256, 1.024]);
    let html = std::fs::read_to_string(at.join("report/index.html")).unwrap();
    assert!(html.contains("by wall clock on a machine") && html.contains(&bad), "the page says who measured");

    // Others take their places, and nothing is measured again.
    let again = raybrook(at, &[&REPORT[..], &["--peer", "right.json"]].concat());
    assert!(stderr(&again).contains("other tracers were put beside it"), "{}", stderr(&again));
    let found = read_json(&at.join("report/data/pareto.json"));
    let without =
        |data: &Value| rows(data, "rays").into_iter().filter(|row| row["method"] != json!(bad)).collect::<Vec<_>>();
    assert_eq!(without(&data), rows(&found, "rays"));
    assert_eq!(rows(&found, "peers").len(), 1);
    let judged = raybrook(at, &["study", "--judge", "-o", "report"]);
    assert!(judged.status.success(), "{}", stderr(&judged));
    assert_eq!(read_json(&at.join("report/data/pareto.json")), found);
}

/// What is wrong with results, and a word that the message has.
type Damage = (fn(&mut Value), &'static str);

#[test]
fn results_that_are_not_for_these_rays_are_refused() {
    let folder = folder();
    let at = folder.path();
    let manifest = exported(at);
    let whole = write_peer(at, &manifest, "peer", |_, _| ());
    let refused = |text: &str| -> String {
        std::fs::write(at.join("damaged.json"), text).unwrap();
        let read = Peer::read(&at.join("damaged.json"));
        let found = read.and_then(|peer| {
            let mut lab =
                Lab::new(None, None, &[], true, 1, &|what| assert!(what.starts_with("other tracers"), "{what}"));
            lab.peers.push(peer);
            Study::of_peers().run(&mut lab)
        });
        let error = found.map(|_| ()).expect_err(text);
        assert_eq!(error.exit_code(), 3, "{error}");
        error.to_string()
    };
    let damages: &[Damage] = &[
        (|v| v["format"] = json!("raybrook peer 2"), "format is 'raybrook peer 2'"),
        (|v| v["rays"]["seed"] = json!(2), "seed 2, but the study has 1"),
        (|v| v["rays"]["quick"] = json!(false), "a full study, but this is a quick study"),
        (|v| v["rays"]["side"] = json!(128), "128 x 128 pixels"),
        (|v| v["rays"]["checksum"] = json!("00000000"), "manifest has the checksum '00000000'"),
        (|v| v["sets"][1]["checksum"] = json!("1\n2"), "'scene-1-boulder-shadow': its rays have the checksum '1\\n2'"),
        (|v| v["sets"][0]["rays"] = json!(1000), "'scene-1-boulder-camera': 1000 rays were traced, but there are 1024"),
        (|v| v["sets"][0]["rays"] = json!(-1), "no results of a tracer"),
        (|v| v["sets"][4]["set"] = json!("stress-fans"), "no results for set 'stress-vertices'"),
        (|v| v["sets"].as_array_mut().unwrap().truncate(6), "no results for set 'stress-t-junctions'"),
        (|v| push_set(v, json!("scene-2-house-camera")), "set 'scene-2-house-camera' is not one of the study"),
        (|v| push_set(v, json!("stress-grid")), "set 'stress-grid' is there twice"),
        (|v| v["sets"][2]["seconds"] = json!([]), "'scene-1-boulder-diffuse': it has no seconds"),
        (|v| v["sets"][2]["seconds"] = json!([0.1, 0.0]), "seconds must be above 0"),
        (|v| v["sets"][2]["seconds"] = json!([-1.0]), "seconds must be above 0"),
        (|v| v["sets"][2]["seconds"] = json!("fast"), "no results of a tracer"),
        (|v| _ = v["sets"][3].as_object_mut().unwrap().remove("answers"), "'stress-edges': it has no answers"),
        (|v| v["sets"][3]["answers"] = json!("../peer-stress-edges.bin"), "'answers' must be a file in the folder"),
        (|v| v["sets"][3]["answers"] = json!("/etc/passwd"), "'answers' must be a file in the folder"),
        (|v| v["sets"][3]["answers"] = json!("missing.bin"), "missing.bin"),
        (|v| v["sets"][3]["answers"] = json!("cache"), "cache"),
        (
            |v| v["sets"][3]["answers"] = json!("peer-scene-1-boulder-camera.bin"),
            "60 answers of 16 bytes are 960 bytes",
        ),
        (|v| v["threads"] = json!(0), "'threads' must be at least 1"),
        (|v| v["threads"] = json!(1e300), "no results of a tracer"),
        (|v| v["name"] = json!(""), "'name' must have 1 to 40 characters"),
        (|v| v["mode"] = json!("a\u{1b}[31m"), "'mode' must have 0 to 40 characters, none a control character"),
        (|v| v["machine"] = json!("x".repeat(1000)), "'machine'"),
        (|v| v["clock"] = json!("sundial"), "unknown variant `sundial`"),
    ];
    std::fs::create_dir_all(at.join("cache")).unwrap();
    for (damage, word) in damages {
        let mut damaged = whole.clone();
        damage(&mut damaged);
        let said = refused(&damaged.to_string());
        assert!(said.contains(word), "'{word}' is missing in: {said}");
    }
    let text = whole.to_string();
    for broken in ["", "{}", &text[..text.len() / 2], &text.replace("0.001", "1e999"), &"[".repeat(100_000)] {
        assert!(refused(broken).contains("no results of a tracer"), "{broken:.40}");
    }
    // Files of answers: cut short, too long, and with a triangle that is not there.
    let path = at.join("peer-stress-grid.bin");
    let answers = std::fs::read(&path).unwrap();
    for (bytes, word) in [
        (answers[..959].to_vec(), "are 960 bytes, but it has 959"),
        ([&answers[..], &[0]].concat(), "are 960 bytes, but it has 961"),
        (Vec::new(), "but it has 0"),
        ([&answers[..956], &512u32.to_le_bytes()].concat(), "answer 59 is triangle 512, but the mesh has 512"),
        ([&answers[..12], &0xffff_fffeu32.to_le_bytes(), &answers[16..]].concat(), "answer 0 is triangle 4294967294"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let said = refused(&text);
        assert!(said.contains(word) && said.contains("peer-stress-grid.bin"), "'{word}' is missing in: {said}");
    }
}

fn push_set(results: &mut Value, name: Value) {
    let sets = results["sets"].as_array_mut().unwrap();
    let mut set = sets[0].clone();
    set["set"] = name;
    sets.push(set);
}

#[test]
fn misplaced_options_of_other_tracers_are_told() {
    let folder = folder();
    let at = folder.path();
    let manifest = exported(at);
    write_peer(at, &manifest, "peer", |_, _| ());
    std::fs::create_dir(at.join("other")).unwrap();
    std::fs::write(at.join("other/thesis.txt"), "mine").unwrap();
    for (arguments, code, words) in [
        (&["study", "layout", "--peer", "peer.json"][..], 2, &["--peer", "only the study pareto"][..]),
        (&["study", "--export-rays", "new"], 2, &["--export-rays", "name it alone: raybrook study pareto"]),
        (&["study", "pareto", "--export-rays", "new", "--peer", "peer.json"], 2, &["cannot be used with"]),
        (&["study", "pareto", "--device", "reference", "--export-rays", "other"], 2, &["--export-rays", "'other'"]),
        (&["study", "pareto", "--peer", "nowhere.json"], 3, &["nowhere.json"]),
        (&["study", "pareto", "--peer", "one.obj"], 3, &["one.obj", "no results of a tracer"]),
        (
            &["study", "pareto", "--quick", "--device", "reference", "--seed", "2", "--peer", "peer.json"],
            3,
            &["seed 1"],
        ),
        (
            &["study", "pareto", "--quick", "--device", "reference", "--peer", "peer.json", "peer.json"],
            3,
            &["'peer 1.0 made up, 3 threads' is in 'peer.json', too"],
        ),
    ] {
        assert_fails(&raybrook(at, arguments), code, words);
        assert!(!at.join("new").exists() && !at.join("raybrook-study/data/pareto.json").exists(), "{arguments:?}");
    }
    assert_eq!(std::fs::read_dir(at.join("other")).unwrap().count(), 1);
}
