//! What pages ask for over HTTP: the page itself, moves, pictures.
//!
//! Only programs of this machine reach it (127.0.0.1), and only those that know the random token in the address. A
//! page of another site that guesses the port knows neither the token nor, by DNS rebinding, the right name of the
//! host. Nothing is read from disk, nothing is loaded from elsewhere, and nothing may show the page in a frame.

use super::facts::{AskedMethod, Layer, Shown};
use super::hub::{Hub, News};
use super::navigator::Move;
use raybrook::low_level::film::{Film, ImageFormat};
use raybrook::low_level::options::{Intersector, MethodOption, StructureKind, Traversal};
use raybrook::{Error, Result};
use serde::{Deserialize, de::DeserializeOwned};
use std::io::{self, Read, Write};
use std::net::{Ipv4Addr, SocketAddr, TcpListener};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tiny_http::{Method, Request, Server as TinyServer};

/// Random bytes of a token.
const TOKEN_BYTES: usize = 16;
/// The longest body of a request, bytes.
const MOST_BODY: u64 = 1 << 16;
/// Requests that are answered at a time: each has a thread.
const MOST_REQUESTS: usize = 128;
/// How often pages that are asleep are looked for.
const LOOK_EVERY: Duration = Duration::from_secs(1);

/// The page, and what it loads.
const PAGE: [(&str, &str, &str); 3] = [
    ("", "text/html; charset=utf-8", include_str!("page/view.html")),
    ("view.css", "text/css; charset=utf-8", include_str!("page/view.css")),
    ("view.js", "text/javascript; charset=utf-8", include_str!("page/view.js")),
];

/// What every answer forbids browsers.
const SAFETY: &str = "Cache-Control: no-store\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Referrer-Policy: no-referrer\r\n\
    X-Content-Type-Options: nosniff\r\n";

/// A server that listens, but does not answer yet.
pub struct Server {
    server: TinyServer,
    port: u16,
    token: String,
}

/// An answer.
struct Answer {
    code: u16,
    kind: &'static str,
    body: Vec<u8>,
    /// The name under which it is saved.
    name: Option<String>,
}

impl Answer {
    fn new(kind: &'static str, body: Vec<u8>) -> Answer {
        Answer { code: 200, kind, body, name: None }
    }

    fn json(text: String) -> Answer {
        Answer::new("application/json", text.into_bytes())
    }

    fn refusal(code: u16, why: &str) -> Answer {
        Answer { code, kind: "text/plain; charset=utf-8", body: format!("{why}\n").into_bytes(), name: None }
    }

    fn nothing() -> Answer {
        Answer { code: 204, ..Answer::new("text/plain", Vec::new()) }
    }

    /// All bytes of it. They are sent in one go: of several parts the last would wait for the receipt of the others.
    fn bytes(&self) -> Vec<u8> {
        let reason = match self.code {
            200 => "OK",
            204 => "No Content",
            400 => "Bad Request",
            403 => "Forbidden",
            404 => "Not Found",
            405 => "Method Not Allowed",
            409 => "Conflict",
            413 => "Content Too Large",
            _ => "Service Unavailable",
        };
        let name = self.name.as_ref().map(|name| format!("Content-Disposition: attachment; filename=\"{name}\"\r\n"));
        let head = format!(
            "HTTP/1.1 {} {reason}\r\nContent-Type: {}\r\nContent-Length: {}\r\n{SAFETY}{}\r\n",
            self.code,
            self.kind,
            self.body.len(),
            name.unwrap_or_default()
        );
        [head.as_bytes(), &self.body].concat()
    }
}

/// Why a request is refused.
type Refusal = (u16, String);

fn refuse<T>(code: u16, why: impl Into<String>) -> std::result::Result<T, Refusal> {
    Err((code, why.into()))
}

/// What happens to a page.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Act {
    session: u64,
    #[serde(default)]
    moves: Vec<Move>,
    layer: Option<String>,
    exposure: Option<f32>,
}

/// A pixel of which a page asks what is there.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Pick {
    session: u64,
    x: f64,
    y: f64,
}

impl Server {
    /// Listens on `port` of 127.0.0.1; 0 takes one that is free.
    ///
    /// # Errors
    /// [`Error::Option`] when the port is taken, or the system has no random numbers.
    pub fn listen(port: u16) -> Result<Server> {
        let fail = |why: String| Error::option("--port", format!("127.0.0.1:{port} cannot be listened on: {why}"));
        let listener =
            TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(|why| match why.kind() {
                io::ErrorKind::AddrInUse => fail("another program does; give another port, or 0 for a free one".into()),
                _ => fail(why.to_string()),
            })?;
        let port = listener.local_addr().map_err(|why| fail(why.to_string()))?.port();
        let server = TinyServer::from_listener(listener, None).map_err(|why| fail(why.to_string()))?;
        let mut random = [0; TOKEN_BYTES];
        getrandom::fill(&mut random).map_err(|why| fail(format!("there are no random numbers: {why}")))?;
        let token = random.iter().map(|byte| format!("{byte:02x}")).collect();
        Ok(Server { server, port, token })
    }

    /// Where the page is.
    pub fn address(&self) -> String {
        format!("http://127.0.0.1:{}/{}/", self.port, self.token)
    }

    /// Answers requests until the system gives no more of them, which ends the worker, too.
    pub fn serve(&self, hub: &Arc<Hub>, name: &str) {
        let open = Arc::new(AtomicUsize::new(0));
        let shared = Arc::new(Pages { hub: hub.clone(), token: self.token.clone(), name: name.to_owned() });
        loop {
            let request = match self.server.recv_timeout(LOOK_EVERY) {
                Ok(request) => request,
                Err(why) => return hub.end_all(why.to_string()),
            };
            hub.rest();
            let Some(request) = request else { continue };
            let (pages, place) = (shared.clone(), Place::of(&open));
            if open.load(Ordering::Relaxed) > MOST_REQUESTS {
                send(request, &Answer::refusal(503, "too many requests at a time"));
                continue;
            }
            // Without a thread the request is dropped, which is an answer, too.
            let answer = move || {
                pages.answer(request);
                drop(place);
            };
            _ = std::thread::Builder::new().name("request".to_owned()).spawn(answer);
        }
    }
}

/// A place among the requests that are answered at a time.
struct Place(Arc<AtomicUsize>);

impl Place {
    fn of(open: &Arc<AtomicUsize>) -> Place {
        open.fetch_add(1, Ordering::Relaxed);
        Place(open.clone())
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        self.0.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Sends an answer; that nobody takes it changes nothing.
fn send(request: Request, answer: &Answer) {
    let mut writer = request.into_writer();
    _ = writer.write_all(&answer.bytes()).and_then(|()| writer.flush());
}

fn header<'r>(request: &'r Request, name: &'static str) -> Option<&'r str> {
    let found = request.headers().iter().find(|header| header.field.equiv(name));
    found.map(|header| header.value.as_str())
}

/// Whether this is how a browser of this machine names the server, by itself or through a tunnel from another port.
fn is_own_host(host: &str) -> bool {
    let (name, port) = host.rsplit_once(':').unwrap_or((host, "80"));
    ["127.0.0.1", "localhost"].contains(&name) && port.parse::<u16>().is_ok()
}

/// Whether the token is right; takes as long for a wrong one whatever is wrong of it.
fn is_same(given: &str, token: &str) -> bool {
    let differences = given.bytes().zip(token.bytes()).fold(0, |found, (a, b)| found | (a ^ b));
    given.len() == token.len() && differences == 0
}

/// The number of a name in a query.
fn number(query: &str, name: &str) -> std::result::Result<u64, Refusal> {
    let of_name = |part: &str| part.split_once('=').filter(|(key, _)| *key == name)?.1.parse().ok();
    query.split('&').find_map(of_name).ok_or_else(|| (400, format!("the number '{name}' is missing")))
}

fn body<T: DeserializeOwned>(request: &mut Request) -> std::result::Result<T, Refusal> {
    if request.body_length().is_some_and(|length| length as u64 > MOST_BODY) {
        return refuse(413, "the body is too long");
    }
    let mut bytes = Vec::new();
    let read = request.as_reader().take(MOST_BODY + 1).read_to_end(&mut bytes);
    if read.is_err() || bytes.len() as u64 > MOST_BODY {
        return refuse(413, "the body is too long, or not whole");
    }
    serde_json::from_slice(&bytes).map_err(|why| (400, format!("the body is not what is expected: {why}")))
}

/// The names of methods that the page offers.
fn methods() -> String {
    let names = |name: &'static str| {
        let option = MethodOption::find(name).into_iter();
        option.flat_map(|option| option.choices().filter_map(|choice| choice.name())).collect::<Vec<_>>()
    };
    let parts = [StructureKind::OPTION, Traversal::OPTION, Intersector::OPTION];
    let all: serde_json::Map<_, _> = parts.map(|part| (part.to_owned(), names(part).into())).into_iter().collect();
    serde_json::Value::Object(all).to_string()
}

/// What answers requests.
struct Pages {
    hub: Arc<Hub>,
    token: String,
    /// The name of saved pictures, without an ending.
    name: String,
}

impl Pages {
    fn answer(&self, mut request: Request) {
        let answer = match self.answer_to(&mut request) {
            Ok(answer) => answer,
            Err((code, why)) => Answer::refusal(code, &why),
        };
        send(request, &answer);
    }

    fn answer_to(&self, request: &mut Request) -> std::result::Result<Answer, Refusal> {
        let host = header(request, "Host").unwrap_or_default().to_owned();
        if !is_own_host(&host) {
            return refuse(403, "this is not the name of the host");
        }
        let address = request.url().to_owned();
        let (path, query) = address.split_once('?').unwrap_or((&address, ""));
        let (token, name) = path.trim_start_matches('/').split_once('/').unwrap_or((path, ""));
        if !is_same(token, &self.token) {
            return refuse(403, "open the address that raybrook has printed: its token is missing, or of another run");
        }
        match *request.method() {
            Method::Get => self.got(name, query),
            Method::Post => {
                // A browser says from which site it posts.
                if header(request, "Origin").is_some_and(|origin| origin != format!("http://{host}")) {
                    return refuse(403, "posted from another site");
                }
                self.posted(name, request)
            }
            _ => refuse(405, "only GET and POST"),
        }
    }

    fn got(&self, name: &str, query: &str) -> std::result::Result<Answer, Refusal> {
        if let Some(&(_, kind, text)) = PAGE.iter().find(|(known, ..)| *known == name) {
            return Ok(Answer::new(kind, text.into()));
        }
        match name {
            "methods" => Ok(Answer::json(methods())),
            "next" => self.next(query),
            "picture.png" => self.saved(query, ImageFormat::Png8, "png"),
            "picture.exr" => self.saved(query, ImageFormat::Exr, "exr"),
            _ => refuse(404, "there is no such thing"),
        }
    }

    fn posted(&self, name: &str, request: &mut Request) -> std::result::Result<Answer, Refusal> {
        let gone = || (404, "there is no such page any more".to_owned());
        match name {
            "begin" => Ok(Answer::json(format!("{{\"session\":{}}}", self.hub.begin()))),
            "end" => {
                self.hub.end(body::<u64>(request)?);
                Ok(Answer::nothing())
            }
            "act" => self.act(&body(request)?).and_then(|done| done.ok_or_else(gone)).map(|()| Answer::nothing()),
            "pick" => self.pick(&body(request)?),
            "method" => {
                self.hub.ask_method(body::<AskedMethod>(request)?);
                Ok(Answer::nothing())
            }
            _ => refuse(404, "there is no such thing"),
        }
    }

    /// Does what happens to a page; `None` where there is no such page.
    fn act(&self, Act { session, moves, layer, exposure }: &Act) -> std::result::Result<Option<()>, Refusal> {
        if !moves.iter().all(Move::is_usual) {
            return refuse(400, "no hand moves so far");
        }
        let layer = match layer.as_deref().map(|name| Layer::find(name).ok_or(name)) {
            Some(Err(name)) => return refuse(400, format!("there is nothing called '{name}' to show")),
            found => found.and_then(std::result::Result::ok),
        };
        if let Some(Err(why)) = exposure.map(Film::check_exposure) {
            return refuse(400, why.to_string());
        }
        let done = self.hub.apply(*session, moves);
        let done = layer.map_or(done, |layer| self.hub.set_layer(*session, layer));
        Ok(exposure.map_or(done, |stops| self.hub.set_exposure(*session, stops)))
    }

    fn pick(&self, &Pick { session, x, y }: &Pick) -> std::result::Result<Answer, Refusal> {
        let Some(camera) = self.hub.camera(session) else { return refuse(404, "there is no such page any more") };
        let Some(pickable) = self.hub.pickable() else { return refuse(409, "the scene is not built yet") };
        if !pickable.has_pixel((x, y)) {
            return refuse(400, "the picture has no such pixel");
        }
        let picked = pickable.pick(camera, (x, y)).map_err(|why| (503, why.to_string()))?;
        Ok(Answer::json(serde_json::to_string(&picked).expect("numbers and names serialise")))
    }

    /// The next news of a page: the length of a text, big-endian in four bytes, the text, and a picture if there is
    /// another one.
    fn next(&self, query: &str) -> std::result::Result<Answer, Refusal> {
        let [session, version, frame] = [number(query, "session")?, number(query, "version")?, number(query, "frame")?];
        match self.hub.news(session, version, frame) {
            None => refuse(404, "there is no such page any more"),
            Some(None) => Ok(Answer::nothing()),
            Some(Some(News { text, picture })) => {
                let png = picture.map(|(film, stops)| quick_png(&film, stops)).transpose();
                let png = png.map_err(|why| (503, why.to_string()))?.unwrap_or_default();
                let length = (text.len() as u32).to_be_bytes();
                Ok(Answer::new("application/octet-stream", [&length, text.as_bytes(), &png].concat()))
            }
        }
    }

    /// The finished picture as a file, with the bytes of the one that `raybrook render` writes.
    fn saved(&self, query: &str, format: ImageFormat, ending: &str) -> std::result::Result<Answer, Refusal> {
        let shown = self.hub.shown(number(query, "session")?);
        let Some((shown, exposure)) = shown else { return refuse(404, "there is no such page any more") };
        let Some(Shown { film, .. }) = shown.filter(|shown| shown.facts.is_done) else {
            return refuse(409, "the picture is not finished yet");
        };
        let stops = if format == ImageFormat::Exr { 0.0 } else { exposure };
        let bytes =
            exposed(&film, stops).and_then(|film| film.to_bytes(format)).map_err(|why| (503, why.to_string()))?;
        let kind = if format == ImageFormat::Exr { "image/x-exr" } else { "image/png" };
        Ok(Answer { name: Some(format!("{}.{ending}", self.name)), ..Answer::new(kind, bytes) })
    }
}

/// A film made lighter by so many stops.
fn exposed(film: &Arc<Film>, stops: f32) -> io::Result<Arc<Film>> {
    if stops == 0.0 {
        return Ok(film.clone());
    }
    let mut film = Film::clone(film);
    film.expose(stops).map_err(io::Error::other)?;
    Ok(Arc::new(film))
}

/// A picture for the page: a .png that takes little time rather than few bytes.
fn quick_png(film: &Arc<Film>, stops: f32) -> io::Result<Vec<u8>> {
    let film = exposed(film, stops)?;
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, film.width, film.height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_compression(png::Compression::Fastest);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(film.to_srgb8().as_flattened())?;
    writer.finish()?;
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_names_of_this_machine_are_its_own() {
        for host in ["127.0.0.1:8080", "localhost:1", "localhost", "127.0.0.1"] {
            assert!(is_own_host(host), "{host}");
        }
        for host in [
            "",
            "evil.example",
            "evil.example:80",
            "127.0.0.1.evil.example:80",
            "localhost:x",
            "0.0.0.0:80",
            "[::1]:80",
        ] {
            assert!(!is_own_host(host), "{host}");
        }
    }

    #[test]
    fn only_the_whole_token_is_right() {
        assert!(is_same("0123abcd", "0123abcd"));
        for wrong in ["", "0123abc", "0123abcd0", "0123abce", "1123abcd", "0123ABCD"] {
            assert!(!is_same(wrong, "0123abcd"), "{wrong}");
        }
    }

    #[test]
    fn tokens_are_random_and_long() {
        let [a, b] = [0, 0].map(|port| Server::listen(port).unwrap());
        assert_ne!(a.token, b.token);
        assert_eq!(a.token.len(), 2 * TOKEN_BYTES);
        assert!(a.address().starts_with("http://127.0.0.1:") && a.address().ends_with(&format!("/{}/", a.token)));
        let error = Server::listen(a.port).err().unwrap();
        assert!(error.to_string().contains("--port") && error.exit_code() == 2, "{error}");
    }

    #[test]
    fn numbers_are_found_in_queries() {
        assert_eq!(number("session=7&frame=12", "frame").unwrap(), 12);
        for query in ["", "frame", "frame=", "frame=-1", "frame=1x", "xframe=1"] {
            assert_eq!(number(query, "frame").unwrap_err().0, 400, "{query}");
        }
    }

    #[test]
    fn quick_pictures_have_the_same_pixels() {
        let pixels = (0..12).map(|i| [i as f32 / 12.0, 0.5, 2.0]).collect();
        let film = Arc::new(Film { width: 4, height: 3, pixels });
        let read = |bytes: &[u8]| image::load_from_memory(bytes).unwrap().to_rgb8();
        assert_eq!(read(&quick_png(&film, 0.0).unwrap()), read(&film.to_png().unwrap()));
        let darker = read(&quick_png(&film, -1.0).unwrap());
        assert_eq!(darker.get_pixel(0, 0).0[2], 255);
        assert!(darker.get_pixel(0, 0).0[1] < read(&film.to_png().unwrap()).get_pixel(0, 0).0[1]);
    }
}
