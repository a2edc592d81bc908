//! Studies: what the report shows is what was measured, it goes on where it was stopped, and scenes of every size end
//! sensibly.

use raybrook::low_level::device::DeviceHandle;
use raybrook::low_level::scene::Scene;
use raybrook_lab::study::{Findings, Header, Lab, Report, State, Study};
use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};
use std::sync::Mutex;

fn lab<'a>(device: Option<&'a DeviceHandle>, scenes: &'a [(String, Scene)]) -> Lab<'a> {
    Lab::new(device, None, scenes, true, crate::common::SEED, &|_| ())
}

fn run(folder: &Path, arguments: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_raybrook"))
        .args(arguments)
        .current_dir(folder)
        .env("RAYBROOK_CACHE_DIR", folder.join("cache"))
        .env_remove("RAYBROOK_DEVICE")
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Every chart shows columns that its table has, and every table has rows of measurements with their errors.
fn assert_whole(study: &Study, findings: &Findings) {
    let name = study.name;
    assert!(!findings.verdict.is_empty() && !findings.tables.is_empty(), "{name}");
    for chart in &findings.charts {
        let table = findings.table(&chart.table).unwrap_or_else(|| panic!("{name}: no table {}", chart.table));
        let columns = table.columns();
        let used = [&chart.x, &chart.y].into_iter().chain(&chart.series).chain(chart.spread.iter().flatten());
        for column in used {
            assert!(columns.contains(&column.as_str()), "{name}: chart {} shows {column}, of {columns:?}", chart.name);
        }
        assert!(!chart.rows(table).is_empty(), "{name}: chart {} is empty", chart.name);
        let has_speed = ["mrays_per_s", "relative", "tests_per_s"].contains(&chart.y.as_str());
        assert!(!has_speed || columns.contains(&"wrong"), "{name}: a speed without its errors");
    }
}

#[test]
fn every_study_is_made_on_the_reference() {
    let mut lab = lab(None, &[]);
    for study in Study::all() {
        let findings = study.run(&mut lab).unwrap();
        assert_whole(study, &findings);
        let is_measured = findings.tables.iter().any(|table| !table.rows.is_empty());
        assert!(!findings.charts.is_empty() || !is_measured, "{}", study.name);
        for row in findings.tables.iter().flat_map(|table| &table.rows) {
            let method = row.get("method").and_then(Value::as_str).unwrap_or_default();
            let is_exact = method.ends_with("exact") || row.get("leaf_size").is_some();
            assert!(!is_exact || row["wrong"] == 0, "{}: {row:?}", study.name);
        }
    }
}

#[test]
fn studies_are_made_on_a_device() {
    let Some(device) = crate::common::device() else { return };
    let mut lab = lab(Some(&device), &[]);
    for name in ["leaf-size", "transfer", "intersection"] {
        let study = Study::find(name).unwrap();
        let findings = study.run(&mut lab).unwrap();
        assert_whole(study, &findings);
        assert!(findings.tables[0].rows.iter().all(|row| row["wrong"] == 0), "{findings:?}");
        let limits = findings.table("limits").map_or(&[][..], |table| &table.rows);
        assert_eq!(limits.len(), if name == "intersection" { 3 } else { 0 });
        // Within what the limits' own kernels miss of them.
        assert!(limits.iter().all(|row| (0.0..1.2).contains(&row["limit_share"].as_f64().unwrap())), "{limits:?}");
    }
}

#[test]
fn scenes_without_anything_to_see_end_sensibly() {
    let one = crate::common::scene_of(&[[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]].map(glam::Vec3::from)]);
    for (name, scene) in [("nothing", Scene::default()), ("one triangle", one)] {
        let scenes = [(name.to_owned(), scene)];
        let mut lab = lab(None, &scenes);
        for study in Study::all() {
            let findings = study.run(&mut lab).unwrap_or_else(|error| panic!("{name}: {}: {error}", study.name));
            assert!(!findings.verdict.is_empty(), "{name}: {}", study.name);
            assert!(!findings.verdict.contains("NaN") && !findings.verdict.contains("inf"), "{}", findings.verdict);
        }
    }
}

#[test]
fn the_report_has_the_numbers_of_the_data() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made = run(at, &["study", "leaf-size", "stability", "--quick", "--device", "reference", "-o", "report"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let html = std::fs::read_to_string(at.join("report/index.html")).unwrap();
    for study in ["leaf-size", "stability"] {
        let data: Value =
            serde_json::from_slice(&std::fs::read(at.join(format!("report/data/{study}.json"))).unwrap()).unwrap();
        let verdict = data["verdict"].as_str().unwrap();
        assert!(text(&made.stdout).contains(verdict) && html.contains(verdict), "{verdict}");
        for table in data["tables"].as_array().unwrap() {
            let csv = std::fs::read(at.join(format!("report/data/{study}-{}.csv", table["name"].as_str().unwrap())));
            let csv = csv.unwrap();
            let mut reader = csv::Reader::from_reader(&csv[..]);
            let columns = reader.headers().unwrap().clone();
            let lines: Vec<_> = reader.records().map(Result::unwrap).collect();
            let rows = table["rows"].as_array().unwrap();
            assert_eq!(lines.len(), rows.len());
            for (line, row) in lines.iter().zip(rows) {
                for (column, value) in columns.iter().zip(line) {
                    let Some(number) = row[column].as_f64() else { continue };
                    assert_eq!(value.parse::<f64>().unwrap(), number, "{study}: {column}");
                    let shown = format!("<td>{number}</td>");
                    let is_whole = row[column].is_u64();
                    assert!(!is_whole || html.contains(&shown), "{study}: {column} is not shown as {shown}");
                }
            }
        }
        for chart in data["charts"].as_array().unwrap() {
            let file = at.join(format!("report/charts/{study}-{}", chart["name"].as_str().unwrap()));
            let svg = std::fs::read_to_string(file.with_extension("svg")).unwrap();
            assert!(
                svg.starts_with("<svg") && svg.contains(chart["title"].as_str().unwrap().split(' ').next().unwrap())
            );
            let png = image::open(file.with_extension("png")).unwrap().to_rgb8();
            assert!(png.pixels().any(|p| p.0 != [255; 3]), "{}: nothing is drawn", file.display());
        }
    }
}

#[test]
fn a_report_goes_on_where_it_was_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let scenes = [];
    let study = Study::find("intersection").unwrap();
    let steps = Mutex::new(Vec::new());
    let progress = |what: &str| steps.lock().unwrap().push(what.to_owned());
    let mut lab = Lab::new(None, None, &scenes, true, 1, &progress);
    let open = |lab: &Lab, again| Report::open(folder.path(), Header::new(lab), "a test", again).unwrap();
    assert_eq!(open(&lab, false).make(study, &mut lab).unwrap(), State::Made);
    let measured = steps.lock().unwrap().len();
    assert!(measured >= 3);
    let mut second = open(&lab, false);
    assert_eq!((second.entries().len(), second.make(study, &mut lab).unwrap()), (1, State::Found));
    assert_eq!(steps.lock().unwrap().len(), measured, "it was measured again");
    let mut third = open(&lab, true);
    assert_eq!((third.make(study, &mut lab).unwrap(), third.entries().len()), (State::Made, 1));
    // Half a file, as after a full disk, and another seed are other reports.
    let data = folder.path().join("data/intersection.json");
    let whole = std::fs::read(&data).unwrap();
    std::fs::write(&data, &whole[..whole.len() / 2]).unwrap();
    assert!(open(&lab, false).entries().is_empty());
    std::fs::write(&data, &whole).unwrap();
    let other = Lab::new(None, None, &scenes, true, 2, &progress);
    assert!(open(&other, false).entries().is_empty() && open(&lab, false).entries().len() == 1);
}

/// What an earlier version of the program judged wrongly is judged anew from its rows, without a device, and says so.
#[test]
fn a_report_is_judged_anew_from_its_rows() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made = run(at, &["study", "layout", "--quick", "--device", "reference", "-o", "report"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let path = at.join("report/data/layout.json");
    let read = || -> Value { serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap() };
    let right = read();
    let mut wrong = right.clone();
    wrong["outcome"] = "holds".into();
    wrong["verdict"] = "Whole triangles are <b>always</b> slower.".into();
    wrong["tables"][0]["rows"][0]["wrong_bound"] = 3.0.into();
    std::fs::write(&path, serde_json::to_vec(&wrong).unwrap()).unwrap();
    let judged = run(at, &["study", "--judge", "-o", "report", "--markdown", "report.md"]);
    assert!(judged.status.success(), "{}", text(&judged.stderr));
    let found = read();
    assert_eq!((&found["verdict"], &found["outcome"]), (&right["verdict"], &right["outcome"]));
    assert_eq!((&found["tables"], &found["seconds"]), (&right["tables"], &right["seconds"]));
    assert_eq!(found["earlier"], "It holds here: Whole triangles are <b>always</b> slower.");
    let html = std::fs::read_to_string(at.join("report/index.html")).unwrap();
    assert_eq!(html.matches("&lt;b&gt;always&lt;/b&gt;").count(), 1);
    assert!(html.contains("these verdicts changed: <a href=\"#layout\">"), "the page says what changed");
    let markdown = std::fs::read_to_string(at.join("report.md")).unwrap();
    assert!(markdown.contains("which an earlier version of raybrook judged: It holds here"), "{markdown}");
    // A row that is there twice would be counted twice.
    let mut doubled = right.clone();
    let again = doubled["tables"][0]["rows"][0].clone();
    doubled["tables"][0]["rows"].as_array_mut().unwrap().push(again);
    std::fs::write(&path, serde_json::to_vec(&doubled).unwrap()).unwrap();
    let refused = run(at, &["study", "--judge", "-o", "report"]);
    assert_eq!(refused.status.code(), Some(3), "{}", text(&refused.stderr));
    assert!(text(&refused.stderr).contains("study layout: table 'rays' has"), "{}", text(&refused.stderr));
    let nothing = run(at, &["study", "--judge", "-o", "nowhere"]);
    assert_eq!(nothing.status.code(), Some(3), "{}", text(&nothing.stderr));
    assert!(text(&nothing.stderr).contains("there is no report") && !at.join("nowhere").exists());
}

/// The user's mesh goes through the sweeps that any mesh can; for the others the program says that they are of its
/// own shapes.
#[test]
fn stability_is_of_the_users_mesh_or_says_that_it_is_not() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("tetra.obj"), raybrook_lab::stress::Mesh::sphere(0).to_obj()).unwrap();
    let arguments = ["study", "stability", "--quick", "--device", "reference", "-o", "report", "--scene", "tetra.obj"];
    let made = run(at, &[&arguments[..], &["--scene", "tetra.obj"]].concat());
    let said = text(&made.stderr);
    assert!(made.status.success() && said.contains("note: not of the scenes that were named"), "{said}");
    let data: Value = serde_json::from_slice(&std::fs::read(at.join("report/data/stability.json")).unwrap()).unwrap();
    for table in data["tables"].as_array().unwrap() {
        let is_of_mesh = ["scale", "offset"].contains(&table["name"].as_str().unwrap());
        for row in table["rows"].as_array().unwrap() {
            assert_eq!(row.get("scene").and_then(Value::as_str), is_of_mesh.then_some("tetra.obj"), "{row}");
        }
    }
    let html = std::fs::read_to_string(at.join("report/index.html")).unwrap();
    assert!(html.contains("but of shapes of the program's own: the sweeps by valence"), "the page says it, too");
    assert!(html.contains("tetra.obj: answers that differ, by"), "a chart of the mesh");
}

#[test]
fn wrong_names_and_places_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    std::fs::write(at.join("file"), "").unwrap();
    for (arguments, code, word) in [
        (&["study", "leaf-sise"][..], 2, "nearest: leaf-size"),
        (&["study", "all", "nothing"], 2, "no study 'nothing'"),
        (&["study", "--scene", "missing.obj", "--device", "reference"], 3, "missing.obj"),
        (&["study", "layout", "--quick", "--device", "reference", "-o", "file"], 5, "file"),
        (&["study", "layout", "--device", "reference", "--markdown", "nowhere/a.md"], 5, "no folder 'nowhere'"),
    ] {
        let output = run(at, arguments);
        let said = text(&output.stderr);
        assert!(said.contains(word) && !said.contains("panicked"), "{arguments:?}: {said}");
        assert_eq!(output.status.code(), Some(code), "{arguments:?}: {said}");
        assert!(!at.join("raybrook-study").exists(), "{arguments:?}: a study was begun");
    }
    let list = run(at, &["study", "--list"]);
    assert_eq!(text(&list.stdout).lines().count(), Study::all().count());
}

/// What a headless browser makes of the page: how wide it is, and what it complains of.
#[test]
fn the_page_fits_a_desk_and_a_phone() {
    let Some(browser) = crate::browser() else { return };
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let made =
        run(at, &["study", "leaf-size", "pareto", "kernels", "--quick", "--device", "reference", "-o", "report"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    // A window may not be as narrow as a phone, but a frame in it may.
    let script = "<script>addEventListener('load', () => { \
        document.querySelectorAll('details').forEach(d => d.open = true); \
        const shown = [...document.querySelectorAll('svg')].filter(s => s.getBoundingClientRect().width > 100); \
        const root = document.documentElement; \
        parent.postMessage(['found', innerWidth, root.scrollWidth, shown.length].join(' '), '*'); });</script></body>";
    let page = std::fs::read_to_string(at.join("report/index.html")).unwrap();
    let charts = page.matches("<figure>").count();
    std::fs::write(at.join("report/measured.html"), page.replace("</body>", script)).unwrap();
    for width in [1280, 400] {
        let frame = format!(
            "<title></title><script>addEventListener('message', e => document.title = e.data)</script>\
             <iframe src='measured.html' style='width: {width}px; height: 900px; border: 0'></iframe>"
        );
        std::fs::write(at.join("report/frame.html"), frame).unwrap();
        let output = Command::new(browser)
            .args(["--headless=new", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"])
            .args(["--window-size=1600,1000", "--virtual-time-budget=5000"])
            .arg(format!("--user-data-dir={}", at.join("profile").display()))
            .arg(format!("file://{}", at.join("report/frame.html").display()))
            .output()
            .unwrap();
        let (dom, log) = (text(&output.stdout), text(&output.stderr));
        let found = dom.split("<title>found ").nth(1).unwrap_or_else(|| panic!("no title in: {dom:.300}\n{log}"));
        let numbers: Vec<usize> =
            found.split('<').next().unwrap().split(' ').map(|number| number.parse().unwrap()).collect();
        let [inner, scrolled, shown] = numbers[..] else { panic!("{numbers:?}") };
        assert!(inner == width && scrolled <= inner, "{width}: {scrolled} pixels wide in a window of {inner}");
        assert_eq!(shown, charts, "{width}: charts that are shown");
        assert!(!log.contains("CONSOLE"), "{log}");
    }
}

/// Whether a report is too old: it was made by other code, and more than one release ago. `versions` are those of the
/// changelog, the newest first.
fn is_stale(made_by: &str, now: &str, version: &str, versions: &[String]) -> bool {
    made_by != now && versions.iter().position(|released| released == version).is_none_or(|age| age > 1)
}

#[test]
fn reports_grow_stale_with_the_second_release_after_a_change() {
    let versions = ["0.3.0", "0.2.0", "0.1.0"].map(str::to_owned);
    for (made_by, version, expected) in [
        ("a", "0.1.0", false),
        ("b", "0.3.0", false),
        ("b", "0.2.0", false),
        ("b", "0.1.0", true),
        ("", "0.1.0", true),
        ("b", "unknown", true),
    ] {
        assert_eq!(is_stale(made_by, "a", version, &versions), expected, "{made_by} {version}");
    }
}

#[test]
fn published_reports_are_not_stale() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().find(|at| at.join("CHANGELOG.md").exists()).unwrap();
    let changelog = std::fs::read_to_string(root.join("CHANGELOG.md")).unwrap();
    let headings = changelog.lines().filter_map(|line| line.strip_prefix("## [")?.split(']').next());
    let versions: Vec<_> = headings.filter(|version| *version != "Unreleased").map(str::to_owned).collect();
    assert_eq!(versions[0], env!("CARGO_PKG_VERSION"), "the changelog's newest release is this one");
    for report in std::fs::read_dir(root.join("docs/study")).unwrap().map(|entry| entry.unwrap().path()) {
        for study in Study::all().filter(|_| report.is_dir()) {
            let file = report.join("data").join(format!("{}.json", study.name));
            // A study that is newer than the report.
            let Ok(text) = std::fs::read(&file) else { continue };
            let found: Value = serde_json::from_slice(&text).unwrap();
            let (made_by, version) = (found["sources"].as_str(), found["header"]["version"].as_str());
            let is_stale = is_stale(made_by.unwrap_or(""), &study.sources(), version.unwrap(), &versions);
            assert!(!is_stale, "{} is of {version:?}, and kernels or study have changed: make it anew", file.display());
        }
    }
}

/// Every link of the page leads somewhere, in it or beside it.
#[test]
fn the_page_has_no_dead_link() {
    let folder = tempfile::tempdir().unwrap();
    let made = run(folder.path(), &["study", "leaf-size", "--quick", "--device", "reference", "-o", "report"]);
    assert!(made.status.success(), "{}", text(&made.stderr));
    let report = folder.path().join("report");
    let page = std::fs::read_to_string(report.join("index.html")).unwrap();
    let links: Vec<&str> = page.split("href=\"").skip(1).map(|rest| rest.split('"').next().unwrap()).collect();
    assert!(links.len() > 3, "{links:?}");
    for link in links {
        match link.strip_prefix('#') {
            Some(id) => assert!(page.contains(&format!("id=\"{id}\"")), "{link}"),
            None => assert!(report.join(link).is_file(), "{link}"),
        }
    }
    // Whoever points at a mark reads its numbers.
    assert!(page.contains("<title>") && page.contains("median, 8, boulder\nmost triangles in a leaf"), "no tooltips");
    // A scene is shown, and when and of what the report was made is told.
    assert!(page.contains("data:image/png;base64,") && page.contains("commit "), "{page:.3000}");
}
