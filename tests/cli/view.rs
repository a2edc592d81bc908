//! `raybrook view`: what its pages are told, what they may not do, and what a browser makes of them.

mod browser;

use super::{assert_fails, folder, raybrook, read_npz, stderr, write_npz};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

/// More than any answer takes.
const PATIENCE: Duration = Duration::from_secs(60);

/// A `raybrook view` that runs.
struct Viewer {
    process: Child,
    port: u16,
    /// `/TOKEN/`
    root: String,
}

impl Drop for Viewer {
    fn drop(&mut self) {
        _ = self.process.kill();
        _ = self.process.wait();
    }
}

/// An answer of the server.
struct Answer {
    code: u16,
    head: String,
    body: Vec<u8>,
}

/// The one triangle of `one.obj`, small enough for a moment.
const SMALL: [&str; 5] = ["--device", "reference", "--size=64x48", "--error=1", "--no-open"];

impl Viewer {
    fn start(at: &Path, scene: &str, arguments: &[&str]) -> Viewer {
        Viewer::start_by(&mut Command::new(env!("CARGO_BIN_EXE_raybrook")), at, scene, arguments)
    }

    /// The same by a command that starts the program with the arguments that are added.
    fn start_by(command: &mut Command, at: &Path, scene: &str, arguments: &[&str]) -> Viewer {
        let mut process = command
            .args(["view", scene])
            .args(arguments)
            .current_dir(at)
            .env("RAYBROOK_CACHE_DIR", at.join("cache"))
            .env_remove("RAYBROOK_DEVICE")
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let mut address = String::new();
        BufReader::new(process.stdout.take().unwrap()).read_line(&mut address).unwrap();
        let (port, root) = address.trim().strip_prefix("http://127.0.0.1:").unwrap().split_once('/').unwrap();
        Viewer { process, port: port.parse().unwrap(), root: format!("/{root}") }
    }

    fn connect(&self) -> TcpStream {
        let stream = TcpStream::connect(("127.0.0.1", self.port)).unwrap();
        stream.set_read_timeout(Some(PATIENCE)).unwrap();
        stream
    }

    /// Sends a request as it stands, and returns what is answered.
    fn raw(&self, request: &str) -> Answer {
        let mut stream = self.connect();
        stream.write_all(request.as_bytes()).unwrap();
        let mut bytes = Vec::new();
        stream.read_to_end(&mut bytes).unwrap();
        let end = bytes.windows(4).position(|four| four == b"\r\n\r\n").unwrap();
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        Answer { code: head[9..12].parse().unwrap(), head, body: bytes[end + 4..].to_vec() }
    }

    fn request(&self, method: &str, path: &str, headers: &str, body: &str) -> Answer {
        let length = body.len();
        self.raw(&format!(
            "{method} {path} HTTP/1.1\r\nConnection: close\r\nContent-Length: {length}\r\n{headers}\r\n{body}"
        ))
    }

    fn own_host(&self) -> String {
        format!("Host: 127.0.0.1:{}\r\n", self.port)
    }

    fn get(&self, name: &str) -> Answer {
        self.request("GET", &format!("{}{name}", self.root), &self.own_host(), "")
    }

    fn post(&self, name: &str, body: &Value) -> Answer {
        self.request("POST", &format!("{}{name}", self.root), &self.own_host(), &body.to_string())
    }

    fn begin(&self) -> Page<'_> {
        let answer: Value = serde_json::from_slice(&self.post("begin", &Value::Null).body).unwrap();
        Page { viewer: self, session: answer["session"].as_u64().unwrap(), version: 0, frame: 0, png: Vec::new() }
    }
}

/// A page as a program.
struct Page<'v> {
    viewer: &'v Viewer,
    session: u64,
    version: u64,
    frame: u64,
    png: Vec<u8>,
}

impl Page<'_> {
    /// The next news, if there are any for a while.
    fn next(&mut self) -> Option<Value> {
        let Page { session, version, frame, .. } = *self;
        let answer = self.viewer.get(&format!("next?session={session}&version={version}&frame={frame}"));
        if answer.code == 204 {
            return None;
        }
        assert_eq!(answer.code, 200, "{}", answer.head);
        let length = u32::from_be_bytes(answer.body[..4].try_into().unwrap()) as usize;
        let told: Value = serde_json::from_slice(&answer.body[4..4 + length]).unwrap();
        (self.version, self.frame) = (told["version"].as_u64().unwrap(), told["frame"].as_u64().unwrap());
        if answer.body.len() > 4 + length {
            self.png = answer.body[4 + length..].to_vec();
        }
        Some(told)
    }

    /// What is told once it is as `is_enough` wants it, and all that was told before.
    fn until(&mut self, is_enough: impl Fn(&Value) -> bool) -> Vec<Value> {
        let start = Instant::now();
        let mut all = Vec::new();
        while start.elapsed() < PATIENCE {
            let Some(told) = self.next() else { continue };
            all.push(told);
            if is_enough(all.last().unwrap()) {
                return all;
            }
        }
        panic!("it was told: {all:#?}");
    }

    fn until_done(&mut self) -> Vec<Value> {
        self.until(is_done)
    }

    fn act(&self, mut what: Value) -> Answer {
        what["session"] = self.session.into();
        self.viewer.post("act", &what)
    }

    fn pick(&self, x: f64, y: f64) -> Value {
        let answer = self.viewer.post("pick", &json!({"session": self.session, "x": x, "y": y}));
        assert_eq!(answer.code, 200, "{}", answer.head);
        serde_json::from_slice(&answer.body).unwrap()
    }

    fn saved(&self, ending: &str) -> Vec<u8> {
        let answer = self.viewer.get(&format!("picture.{ending}?session={}", self.session));
        assert_eq!(answer.code, 200, "{}", answer.head);
        assert!(answer.head.contains(&format!("filename=\"one.{ending}\"")), "{}", answer.head);
        answer.body
    }
}

/// Whether the page tells of the finished picture of what it is to show.
fn is_done(told: &Value) -> bool {
    told["is_finished"] == true
}

fn pixels(png: &[u8]) -> image::RgbImage {
    image::load_from_memory(png).unwrap().to_rgb8()
}

/// What `raybrook render` writes by the command that the page tells.
fn rendered(at: &Path, told: &Value, name: &str) -> Vec<u8> {
    let line = format!("{} {}", told["command"].as_str().unwrap(), told["camera"]["options"].as_str().unwrap());
    let words: Vec<_> = line.split(' ').skip(1).chain(["--device", "reference", "-o", name]).collect();
    let output = raybrook(at, &words);
    assert!(output.status.success(), "{line}: {}", stderr(&output));
    std::fs::read(at.join(name)).unwrap()
}

#[test]
fn the_finished_picture_is_the_one_that_render_writes() {
    let folder = folder();
    let at = folder.path();
    // On a busy machine a page may come too late for its first picture, but not page after page: others take longer.
    let large = SMALL.map(|argument| if argument.starts_with("--size") { "--size=320x240" } else { argument });
    let viewer = Viewer::start(at, "one.obj", &large);
    let begun = || {
        let mut page = viewer.begin();
        let told = page.until_done();
        let labels: Vec<_> = told.iter().filter_map(|told| told["picture"]["label"].as_str()).collect();
        assert_eq!(labels.last(), Some(&"error 1"), "{labels:?}");
        labels[0].starts_with("1 ray for").then_some((page, told))
    };
    let (mut page, told) = (0..200).find_map(|_| begun()).expect("a page has its first picture");
    let first = rendered(at, told.last().unwrap(), "first.png");
    assert_eq!(page.saved("png"), first);
    assert_eq!(pixels(&page.png), pixels(&first), "what is shown is what is saved");
    // The camera moves, and with it the light of a scene that has none.
    assert_eq!(page.act(json!({"moves": [{"orbit": [0.1, 0.05]}, {"zoom": 0.2}, {"pan": [0.1, 0]}]})).code, 204);
    let told = page.until_done();
    let picture = &told.last().unwrap()["picture"];
    assert!(picture["rays"].as_u64().unwrap() > 3000 && picture["error"].as_f64().unwrap() <= 1.0, "{picture}");
    let moved = rendered(at, told.last().unwrap(), "moved.png");
    assert_ne!(moved, first);
    assert_eq!(page.saved("png"), moved);
    assert_eq!(page.saved("exr"), rendered(at, told.last().unwrap(), "moved.exr"));
    // Lighter pixels on the page and in the file, and no other light in the .exr.
    page.act(json!({"exposure": 1.5}));
    page.until(|told| told["exposure"] == 1.5);
    assert_ne!(pixels(&page.png), pixels(&moved));
    assert_eq!(pixels(&page.saved("png")), pixels(&page.png));
    assert_eq!(page.saved("exr"), rendered(at, told.last().unwrap(), "moved.exr"));
}

#[test]
fn what_is_under_the_pointer_is_what_trace_finds() {
    let folder = folder();
    let at = folder.path();
    let viewer = Viewer::start(at, "one.obj", &SMALL);
    let mut page = viewer.begin();
    page.until_done();
    page.act(json!({"moves": [{"orbit": [0.07, -0.03]}]}));
    page.until_done();
    let picked = page.pick(28.7, 28.2);
    assert!(page.pick(0.0, 0.0)["hit"].is_null());
    let numbers =
        |of: &str| -> Vec<f64> { picked[of].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect() };
    let as_f32 = |numbers: Vec<f64>| numbers.into_iter().map(|x| x as f32).collect::<Vec<_>>();
    let (origin, direction) = (as_f32(numbers("origin")), as_f32(numbers("direction")));
    write_npz(&at.join("rays.npz"), &[("origin", 3, &origin), ("direction", 3, &direction)]);
    let traced = raybrook(at, &["trace", "one.obj", "rays.npz", "--device", "reference", "-o", "hits.npz"]);
    assert!(traced.status.success(), "{}", stderr(&traced));
    let hit = &picked["hit"];
    assert_eq!((&hit["triangle"], read_npz(&at.join("hits.npz"), "primitive")), (&0.into(), vec![0]));
    for name in ["t", "u", "v"] {
        let bits = (hit[name].as_f64().unwrap() as f32).to_bits();
        assert_eq!(read_npz(&at.join("hits.npz"), name), [bits], "{name} of {hit}");
    }
    // That point becomes the target, and is in the middle of the picture then.
    page.act(json!({"moves": [{"target": hit["position"]}]}));
    let told = page.until_done();
    let target = told.last().unwrap()["camera"]["toml"].as_str().unwrap().to_owned();
    assert!(target.contains("target = ["), "{target}");
    let again = page.pick(32.0, 24.0);
    let distance: f64 = (0..3)
        .map(|i| again["hit"]["position"][i].as_f64().unwrap() - hit["position"][i].as_f64().unwrap())
        .map(|d| d * d)
        .sum();
    assert!(distance.sqrt() < 0.05, "{again} and {picked}");
}

/// The rays of a picture through corners begin at its border, half a pixel beside the middles of its first pixels.
#[test]
fn of_a_picture_through_corners_these_are_under_the_pointer() {
    let folder = folder();
    let arguments = ["--device", "reference", "--size=64x48", "--samples=corners", "--fov=90", "--no-open"];
    let viewer = Viewer::start(folder.path(), "one.obj", &arguments);
    let mut page = viewer.begin();
    page.until_done();
    let [top, bottom] = [0.2, 47.9].map(|y| page.pick(20.5, y)["direction"].clone());
    let square = |i: usize| (top[i].as_f64().unwrap() - bottom[i].as_f64().unwrap()).powi(2);
    let height = (square(0) + square(1) + square(2)).sqrt();
    assert!((height - 2.0).abs() < 1e-6, "{height}, not twice the tangent of half of 90 degrees");
}

#[test]
fn methods_are_switched_and_wrong_ones_are_told() {
    let folder = folder();
    let at = folder.path();
    let viewer = Viewer::start(at, "one.obj", &SMALL);
    let methods: Value = serde_json::from_slice(&viewer.get("methods").body).unwrap();
    assert!(methods["structure"].as_array().unwrap().contains(&"kd".into()), "{methods}");
    let mut page = viewer.begin();
    page.until_done();
    let exact = pixels(&page.png);
    let ask = |structure: &str, traversal: &str, intersector: &str| {
        let asked = json!({"structure": structure, "traversal": traversal, "intersector": intersector});
        assert_eq!(viewer.post("method", &asked).code, 204);
    };
    ask("kd", "ropes", "auto");
    let told = page.until(|told| told["asked"]["traversal"] == "ropes" && is_done(told));
    assert!(told.last().unwrap()["method"].as_str().unwrap().contains("--traversal ropes"), "{told:?}");
    assert_eq!(pixels(&page.png), exact, "exact hits are the same by any method");
    for layer in ["steps", "tests", "leaves", "wrong"] {
        assert_eq!(page.act(json!({"layer": layer})).code, 204);
        let told = page.until(|told| told["layer"] == layer && is_done(told));
        let picture = &told.last().unwrap()["picture"];
        match layer {
            "wrong" => assert_eq!((&picture["wrong"], &picture["pixels"]), (&0.into(), &(64 * 48).into())),
            // A tree of one triangle takes no steps.
            _ => assert_eq!(picture["brightest"].as_u64().unwrap() > 0, layer != "steps", "{picture}"),
        }
        assert_ne!(pixels(&page.png), exact, "{layer}");
    }
    ask("bvh8", "ropes", "auto");
    let told = page.until(|told| told["notice"].is_string());
    let notice = told.last().unwrap()["notice"].as_str().unwrap();
    assert!(notice.contains("--traversal") && notice.contains("stays as it was"), "{notice}");
    ask("auto", "auto", "moller-trumbore");
    let told = page.until(|told| told["asked"]["intersector"] == "moller-trumbore" && is_done(told));
    assert!(told.last().unwrap()["notice"].is_null());
    assert!(told.last().unwrap()["command"].as_str().unwrap().contains("moller-trumbore"), "{told:?}");
}

/// The thesis's triangle test has holes along edges.
#[test]
fn wrong_pixels_are_counted() {
    let folder = folder();
    let vase = crate::common::root().join("scenes/vase.obj");
    let arguments = ["--device", "reference", "--size=400x300", "--no-open", "--method", "bvh2+thesis"];
    let viewer = Viewer::start(folder.path(), vase.to_str().unwrap(), &arguments);
    let mut page = viewer.begin();
    page.act(json!({"layer": "wrong"}));
    let told = page.until(|told| told["layer"] == "wrong" && is_done(told));
    let wrong = told.last().unwrap()["picture"]["wrong"].as_u64().unwrap();
    let red = pixels(&page.png).pixels().filter(|pixel| pixel.0 == [255, 0, 0]).count() as u64;
    assert!(wrong > 0 && red == wrong, "{wrong} wrong pixels, {red} red ones");
    assert!(told.last().unwrap()["command"].as_str().unwrap().contains("--intersector thesis"));
}

#[test]
fn strangers_are_refused() {
    let folder = folder();
    let viewer = Viewer::start(folder.path(), "one.obj", &SMALL);
    let page = viewer.get("");
    assert_eq!(page.code, 200);
    for line in ["default-src 'none'", "frame-ancestors 'none'", "Cache-Control: no-store", "nosniff", "no-referrer"] {
        assert!(page.head.contains(line), "'{line}' is missing in {}", page.head);
    }
    for name in ["view.css", "view.js"] {
        assert_eq!(viewer.get(name).code, 200, "{name}");
    }
    let own = viewer.own_host();
    let wrong = format!("/{}/", "0".repeat(viewer.root.len() - 2));
    for path in
        ["/", "/favicon.ico", "/view.js", &wrong, &format!("{wrong}view.js"), "//", "/%2e%2e/", &viewer.root[..9]]
    {
        assert_eq!(viewer.request("GET", path, &own, "").code, 403, "{path}");
    }
    for host in ["", "Host: evil.example\r\n", "Host: 127.0.0.1.evil.example\r\n", "Host: 10.0.0.1:80\r\n"] {
        assert_eq!(viewer.request("GET", &viewer.root, host, "").code, 403, "{host}");
    }
    // Through a tunnel the port is another one.
    assert_eq!(viewer.request("GET", &viewer.root, "Host: localhost:9999\r\n", "").code, 200);
    let begin = format!("{}begin", viewer.root);
    assert_eq!(viewer.request("POST", &begin, &format!("{own}Origin: http://evil.example\r\n"), "null").code, 403);
    assert_eq!(viewer.request("POST", &begin, &format!("{own}Origin: null\r\n"), "null").code, 403);
    let origin = format!("{own}Origin: http://127.0.0.1:{}\r\n", viewer.port);
    assert_eq!(viewer.request("POST", &begin, &origin, "null").code, 200);
    for path in ["../../../etc/passwd", "page/view.js", "view.js/", "/etc/passwd"] {
        assert_eq!(viewer.get(path).code, 404, "{path}");
    }
}

#[test]
fn what_no_page_sends_is_refused() {
    let folder = folder();
    let viewer = Viewer::start(folder.path(), "one.obj", &SMALL);
    let mut page = viewer.begin();
    page.until_done();
    let own = viewer.own_host();
    let session = page.session;
    for (body, code) in [
        ("", 400),
        ("[", 400),
        ("{}", 400),
        (&json!({"session": session, "moves": [{"jump": 1}]}).to_string(), 400),
        (&json!({"session": session, "moves": [{"zoom": 1e9}]}).to_string(), 400),
        (&json!({"session": session, "moves": [{"orbit": [1]}]}).to_string(), 400),
        (&json!({"session": session, "layer": "secrets"}).to_string(), 400),
        (&json!({"session": session, "exposure": 1e9}).to_string(), 400),
        (&json!({"session": session, "other": 1}).to_string(), 400),
        (&json!({"session": 999}).to_string(), 404),
        (&" ".repeat(1 << 17), 413),
    ] {
        let answer = viewer.request("POST", &format!("{}act", viewer.root), &own, body);
        assert_eq!(answer.code, code, "{body:.80}");
    }
    for (x, y) in [(-1.0, 0.0), (64.0, 0.0), (0.0, 48.0), (1e300, 0.0)] {
        assert_eq!(viewer.post("pick", &json!({"session": session, "x": x, "y": y})).code, 400, "{x}, {y}");
    }
    assert_eq!(viewer.get("next?session=1").code, 400);
    assert_eq!(viewer.get("next?session=999&version=0&frame=0").code, 404);
    assert_eq!(viewer.request("DELETE", &viewer.root, &own, "").code, 405);
    assert_eq!(viewer.raw("nonsense\r\n\r\n").code, 400);
    // Nothing of all that has changed the picture.
    assert!(page.next().is_none());
}

/// A length of which nothing is reserved, more connections than the system has files for, and none of them says a word:
/// pages go on.
#[cfg(target_os = "linux")]
#[test]
fn whatever_connects_keeps_no_page_waiting() {
    let folder = folder();
    let mut limited = Command::new("sh");
    limited.args(["-c", "ulimit -n 48 && exec \"$@\"", "sh", env!("CARGO_BIN_EXE_raybrook")]);
    let viewer = Viewer::start_by(&mut limited, folder.path(), "one.obj", &SMALL);
    let mut page = viewer.begin();
    page.until_done();
    for (path, code) in [("/".to_owned(), 403), (format!("{}act", viewer.root), 413)] {
        for length in [u64::from(u32::MAX), u64::MAX] {
            let head = format!("POST {path} HTTP/1.1\r\nContent-Length: {length}\r\n{}\r\n", viewer.own_host());
            assert_eq!(viewer.raw(&head).code, code, "{head}");
        }
    }
    let idle: Vec<_> = (0..100).map(|_| viewer.connect()).collect();
    page.act(json!({"moves": [{"orbit": [0.1, 0]}]}));
    let start = Instant::now();
    page.until_done();
    assert!(start.elapsed() < Duration::from_secs(9), "no page waits until the others are given up");
    drop(idle);
    assert_eq!(viewer.get("").code, 200);
}

/// Whoever lists the machine's processes does not see the token.
#[cfg(target_os = "linux")]
#[test]
fn browsers_are_given_a_file_that_is_gone_when_the_page_is_there() {
    use std::os::unix::fs::PermissionsExt;
    let folder = folder();
    let at = folder.path();
    let opener = at.join("xdg-open");
    let script = "#!/bin/sh\ncp -p \"$1\" seen && echo \"$@\" > part && mv part arguments\n";
    std::fs::write(&opener, script).unwrap();
    std::fs::set_permissions(&opener, std::fs::Permissions::from_mode(0o755)).unwrap();
    let path = format!("{}:{}", at.display(), std::env::var("PATH").unwrap());
    let home = at.join("home");
    let open = || {
        std::fs::create_dir_all(&home).unwrap();
        let mut command = Command::new(env!("CARGO_BIN_EXE_raybrook"));
        command.env("PATH", &path).env("HOME", &home).env("DISPLAY", ":0");
        Viewer::start_by(&mut command, at, "one.obj", &SMALL[..SMALL.len() - 1])
    };
    let is_there = || std::fs::read_dir(&home).unwrap().count() > 0;
    let wait_for = |what: &dyn Fn() -> bool| {
        let start = Instant::now();
        while !what() {
            assert!(start.elapsed() < PATIENCE);
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    let viewer = open();
    wait_for(&|| at.join("arguments").exists());
    let token = viewer.root.trim_matches('/');
    assert!(!std::fs::read_to_string(at.join("arguments")).unwrap().contains(token));
    let seen = std::fs::read_to_string(at.join("seen")).unwrap();
    assert!(seen.contains(&format!("url=http://127.0.0.1:{}{}\"", viewer.port, viewer.root)), "{seen}");
    assert_eq!(at.join("seen").metadata().unwrap().permissions().mode() & 0o777, 0o600);
    assert!(is_there());
    viewer.begin();
    wait_for(&|| !is_there());
    drop(viewer);
    // Nor is it left behind where no page begins.
    let viewer = open();
    wait_for(&|| is_there());
    let stopped = Command::new("kill").args(["-INT", &viewer.process.id().to_string()]).status().unwrap();
    assert!(stopped.success());
    wait_for(&|| !is_there());
}

#[test]
fn pages_have_cameras_of_their_own_and_slow_ones_keep_nobody_waiting() {
    let folder = folder();
    let at = folder.path();
    let viewer = Viewer::start(at, "one.obj", &SMALL);
    let (mut a, mut b) = (viewer.begin(), viewer.begin());
    // It asks, and never takes the answer; another one never ends its question.
    let mut slow = viewer.connect();
    let request = format!("GET {}view.js HTTP/1.1\r\n{}\r\n", viewer.root, viewer.own_host());
    slow.write_all(request.repeat(50).as_bytes()).unwrap();
    let mut half = viewer.connect();
    half.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
    a.until_done();
    b.until_done();
    let still = pixels(&b.png);
    assert_eq!(pixels(&a.png), still);
    a.act(json!({"moves": [{"orbit": [0.2, 0]}]}));
    a.until_done();
    assert_ne!(pixels(&a.png), still);
    b.act(json!({"exposure": 0}));
    b.until_done();
    assert_eq!(pixels(&b.png), still);
}

/// Seconds of processor time that a process has taken.
#[cfg(target_os = "linux")]
fn processor_s(process: u32) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{process}/stat")).unwrap();
    let numbers: Vec<&str> = stat.rsplit_once(')').unwrap().1.split_whitespace().collect();
    const TICKS_A_SECOND: f64 = 100.0;
    (numbers[11].parse::<f64>().unwrap() + numbers[12].parse::<f64>().unwrap()) / TICKS_A_SECOND
}

#[cfg(target_os = "linux")]
#[test]
fn work_for_a_page_that_was_closed_stops() {
    let folder = folder();
    let at = folder.path();
    // It would take minutes.
    let long = ["--device", "reference", "--size=2000x2000", "--samples=65536", "--no-open"];
    let viewer = Viewer::start(at, "one.obj", &long);
    let mut page = viewer.begin();
    page.until(|told| told["picture"]["label"].as_str().is_some_and(|label| !label.starts_with("1 ray")));
    assert_eq!(viewer.post("end", &page.session.into()).code, 204);
    std::thread::sleep(Duration::from_millis(300));
    let before = processor_s(viewer.process.id());
    std::thread::sleep(Duration::from_millis(700));
    let taken = processor_s(viewer.process.id()) - before;
    assert!(taken < 0.2, "{taken} s of 0.7");
    assert_eq!(viewer.get(&format!("next?session={}&version=0&frame=0", page.session)).code, 404);
}

#[test]
fn watched_scenes_are_read_again_and_broken_ones_told() {
    let folder = folder();
    let at = folder.path();
    let viewer = Viewer::start(at, "one.obj", &[&SMALL[..], &["--watch"]].concat());
    let mut page = viewer.begin();
    page.until_done();
    let first = pixels(&page.png);
    let save = |text: &str| {
        // As editors save: another file takes the name.
        std::fs::write(at.join("new.obj"), text).unwrap();
        std::fs::rename(at.join("new.obj"), at.join("one.obj")).unwrap();
    };
    save("v 0 0 0\nv 1 0 0\nf 1 2 9\n");
    let told = page.until(|told| told["notice"].is_string());
    let notice = told.last().unwrap()["notice"].as_str().unwrap();
    assert!(notice.contains("one.obj:3") && notice.contains("as it was"), "{notice}");
    assert_eq!(pixels(&page.png), first, "the last picture remains");
    assert!(!page.pick(28.0, 28.0)["hit"].is_null());
    save("v 0 0 0\nv 2 0 0\nv 0 1 0\nv 2 1 0\nf 1 2 3\nf 2 4 3\n");
    page.until(|told| told["notice"].is_null() && told["triangles"] == 2 && is_done(told));
    assert_ne!(pixels(&page.png), first);
}

#[test]
fn what_cannot_be_shown_ends_with_the_documented_code() {
    let folder = folder();
    let at = folder.path();
    let taken = std::net::TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let port = taken.local_addr().unwrap().port().to_string();
    for (arguments, code, words) in [
        (&["view", "missing.obj", "--no-open", "--device", "reference"][..], 3, &["missing.obj"][..]),
        (&["view", "one.obj", "--no-open", "--port", &port], 2, &["--port", &port]),
        (&["view", "one.obj", "--no-open", "--port", "70000"], 2, &["--port"]),
        (&["view", "one.obj", "--no-open", "--structure", "grid", "--leaf-size", "3"], 2, &["--leaf-size"]),
        (&["view", "one.obj", "--no-open", "--device", "no such device"], 4, &["no such device"]),
    ] {
        assert_fails(&raybrook(at, arguments), code, words);
    }
}
