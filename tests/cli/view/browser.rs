//! The page of `raybrook view` in a headless Chromium, which is driven through its debugging pipe: messages of the
//! DevTools protocol, each with a zero byte behind it, on the file descriptors 3 and 4.

use super::{PATIENCE, SMALL, Viewer};
use crate::browser;
use serde_json::{Value, json};
use std::fs::File;
use std::io::{BufRead, BufReader, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Instant;

/// A browser with one page.
struct Browser {
    process: Child,
    to: File,
    from: BufReader<File>,
    last: u64,
    page: Option<String>,
    /// What the console has said.
    complaints: Vec<String>,
}

impl Drop for Browser {
    fn drop(&mut self) {
        _ = self.process.kill();
        _ = self.process.wait();
    }
}

impl Browser {
    fn start(at: &Path, name: &str) -> Browser {
        let pipes = ["to", "from"].map(|name| at.join(name));
        assert!(Command::new("mkfifo").args(&pipes).status().unwrap().success());
        let process = Command::new("sh")
            .args(["-c", "to=$1 from=$2; shift 2; exec \"$@\" 3<\"$to\" 4>\"$from\"", "sh"])
            .args(&pipes)
            .args([
                name,
                "--headless=new",
                "--remote-debugging-pipe",
                "--no-sandbox",
                "--disable-gpu",
                "--disable-quic",
            ])
            .args(["--no-first-run", "--disable-background-networking", "--disable-component-update", "--disable-sync"])
            .arg(format!("--user-data-dir={}", at.join("profile").display()))
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let to = File::options().write(true).open(&pipes[0]).unwrap();
        let from = BufReader::new(File::open(&pipes[1]).unwrap());
        let mut browser = Browser { process, to, from, last: 0, page: None, complaints: Vec::new() };
        let target = browser.call("Target.createTarget", json!({"url": "about:blank"}))["targetId"].clone();
        let attached = browser.call("Target.attachToTarget", json!({"targetId": target, "flatten": true}));
        browser.page = attached["sessionId"].as_str().map(str::to_owned);
        browser.call("Runtime.enable", json!({}));
        browser.call("Log.enable", json!({}));
        browser
    }

    fn call(&mut self, method: &str, params: Value) -> Value {
        self.last += 1;
        let mut message = json!({"id": self.last, "method": method, "params": params});
        if let Some(page) = &self.page {
            message["sessionId"] = page.clone().into();
        }
        self.to.write_all(format!("{message}\0").as_bytes()).unwrap();
        loop {
            let mut bytes = Vec::new();
            self.from.read_until(0, &mut bytes).unwrap();
            assert_eq!(bytes.pop(), Some(0), "the browser has ended");
            let answer: Value = serde_json::from_slice(&bytes).unwrap();
            match answer["method"].as_str() {
                Some("Runtime.consoleAPICalled" | "Runtime.exceptionThrown" | "Log.entryAdded") => {
                    self.complaints.push(answer["params"].to_string());
                }
                _ if answer["id"] == self.last => {
                    assert!(answer["error"].is_null(), "{method}: {answer}");
                    return answer["result"].clone();
                }
                _ => {}
            }
        }
    }

    /// The value of an expression of JavaScript.
    fn value(&mut self, expression: &str) -> Value {
        let asked = json!({"expression": expression, "returnByValue": true, "awaitPromise": true});
        let found = self.call("Runtime.evaluate", asked);
        assert!(found["exceptionDetails"].is_null(), "{expression}: {found}");
        found["result"]["value"].clone()
    }

    fn wait_for(&mut self, condition: &str) {
        let start = Instant::now();
        while self.value(condition) != true {
            let text = || self.value("document.body.innerText");
            assert!(start.elapsed() < PATIENCE, "never: {condition}; the page says {}", { text }());
        }
    }

    fn open(&mut self, address: &str, (width, height): (u32, u32)) {
        let screen = json!({"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 700});
        self.call("Emulation.setDeviceMetricsOverride", screen);
        self.call("Page.navigate", json!({"url": address}));
        self.wait_for("document.body !== null && document.body.dataset.state === 'done'");
    }

    fn mouse(&mut self, kind: &str, (x, y): (f64, f64), buttons: u32) {
        let button = if buttons == 0 && kind == "mouseMoved" { "none" } else { "left" };
        let event = json!({"type": kind, "x": x, "y": y, "button": button, "buttons": buttons, "clickCount": 1});
        self.call("Input.dispatchMouseEvent", event);
    }

    /// Chooses of a list of the panel.
    fn choose(&mut self, list: &str, value: &str) {
        let list = format!("document.getElementById('{list}')");
        self.value(&format!("{list}.value = '{value}'; {list}.dispatchEvent(new Event('change'))"));
    }

    /// Colours of the canvas, as a text.
    fn pixels(&mut self) -> String {
        let canvas = "document.getElementById('picture').toDataURL()";
        self.value(canvas).as_str().unwrap().to_owned()
    }

    /// A point of the picture, by its parts of width and height, on the screen.
    fn point(&mut self, (x, y): (f64, f64)) -> (f64, f64) {
        let found =
            self.value("(({left, top, width, height}) => [left, top, width, height])(canvas.getBoundingClientRect())");
        let [left, top, width, height] = [0, 1, 2, 3].map(|i| found[i].as_f64().unwrap());
        (left + x * width, top + y * height)
    }
}

#[test]
fn the_page_shows_turns_and_picks_on_a_desk_and_on_a_phone() {
    let Some(name) = browser() else { return };
    let folder = super::folder();
    let at = folder.path();
    let viewer = Viewer::start(at, "one.obj", &[&SMALL[..], &["--watch"]].concat());
    let address = format!("http://127.0.0.1:{}{}", viewer.port, viewer.root);
    let mut browser = Browser::start(at, name);
    for size in [(1280, 800), (400, 800)] {
        browser.open(&address, size);
        let fits = "[innerWidth, document.documentElement.scrollWidth]";
        assert_eq!(browser.value(fits), json!([size.0, size.0]), "nothing is cut off or scrolled");
        let first = browser.pixels();
        assert_eq!(
            browser.value("[document.getElementById('picture').width, document.getElementById('picture').height]"),
            json!([64, 48])
        );
        // What is under the pointer.
        let middle = browser.point((0.43, 0.6));
        browser.mouse("mouseMoved", middle, 0);
        browser.wait_for("(document.body.dataset.picked || '').includes('\"triangle\":0')");
        let aside = browser.point((0.02, 0.02));
        browser.mouse("mouseMoved", aside, 0);
        browser.wait_for("document.body.dataset.picked.includes('\"hit\":null')");
        assert_eq!(browser.value("document.getElementById('triangle').textContent"), "–");
        // A drag turns the scene.
        let before = browser.value("told.camera.options");
        browser.mouse("mousePressed", middle, 1);
        for step in 1..=5 {
            browser.mouse("mouseMoved", (middle.0 + 6.0 * f64::from(step), middle.1), 1);
        }
        browser.mouse("mouseReleased", (middle.0 + 30.0, middle.1), 0);
        browser.wait_for(&format!("document.body.dataset.state === 'done' && told.camera.options !== {before}"));
        let turned = browser.pixels();
        assert_ne!(turned, first, "{size:?}: it has turned");
        // By keys, back to the first camera.
        browser.value("document.getElementById('picture').focus()");
        for kind in ["keyDown", "keyUp"] {
            browser.call("Input.dispatchKeyEvent", json!({"type": kind, "key": "Home", "code": "Home"}));
        }
        let same = serde_json::to_string(&first).unwrap();
        browser.wait_for(&format!(
            "document.body.dataset.state === 'done' && document.getElementById('picture').toDataURL() === {same}"
        ));
        // Another method and another layer, from the panel.
        browser.choose("layer", "wrong");
        browser.wait_for("document.body.dataset.state === 'done' && document.body.dataset.layer === 'wrong'");
        assert_eq!(browser.value("document.getElementById('counted').textContent"), "0 of 3,072");
        browser.choose("structure", "grid");
        browser.wait_for("document.body.dataset.state === 'done' && told.method.includes('--structure grid')");
        browser.choose("structure", "auto");
        browser.wait_for("document.body.dataset.state === 'done' && told.asked.structure === 'auto'");
        // What is wrong with the scene is told, and the picture remains.
        let (whole, before) = (std::fs::read(at.join("one.obj")).unwrap(), browser.pixels());
        std::fs::write(at.join("one.obj"), "f 1 2 9\n").unwrap();
        browser.wait_for("!document.getElementById('notice').hidden && document.body.innerText.includes('one.obj:1')");
        assert_eq!(browser.pixels(), before);
        std::fs::write(at.join("one.obj"), whole).unwrap();
        browser.wait_for("document.getElementById('notice').hidden && document.body.dataset.state === 'done'");
    }
    // A tab that is closed takes its page with it.
    let session = browser.value("session");
    browser.call("Page.navigate", json!({"url": "about:blank"}));
    let start = Instant::now();
    while viewer.get(&format!("next?session={session}&version=0&frame=0")).code != 404 {
        assert!(start.elapsed() < PATIENCE, "the page lives");
    }
    assert!(browser.complaints.is_empty(), "{:#?}", browser.complaints);
}
