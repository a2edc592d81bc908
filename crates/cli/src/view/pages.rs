//! What pages ask for: the page itself, moves, pictures.
//!
//! Only programs of this machine reach it (127.0.0.1), and only those that know the random token in the address. A
//! page of another site that guesses the port knows neither the token nor, by DNS rebinding, the right name of the
//! host. Nothing is read from disk, nothing is loaded from elsewhere, and nothing may show the page in a frame.

use super::facts::{AskedMethod, Layer};
use super::http::Handler;
use super::hub::Hub;
use super::message::{Answer, Head, Refusal, refuse};
use super::navigator::Move;
use super::session::News;
use raybrook::low_level::film::{Film, ImageFormat};
use raybrook::low_level::options::{Intersector, MethodOption, StructureKind, Traversal};
use raybrook::{Error, Result};
use serde::{Deserialize, de::DeserializeOwned};
use std::io;
use std::path::Path;
use std::sync::Arc;

/// Random bytes of a token.
const TOKEN_BYTES: usize = 16;

/// The page, and what it loads.
const PAGE: [(&str, &str, &str); 3] = [
    ("", "text/html; charset=utf-8", include_str!("page/view.html")),
    ("view.css", "text/css; charset=utf-8", include_str!("page/view.css")),
    ("view.js", "text/javascript; charset=utf-8", include_str!("page/view.js")),
];

/// A token that nobody guesses.
///
/// # Errors
/// [`Error::Io`] when the system has no random numbers.
pub fn new_token() -> Result<String> {
    let mut random = [0; TOKEN_BYTES];
    let fail = |why: getrandom::Error| {
        Error::io("get random numbers from", Path::new("the system"), io::Error::other(why.to_string()))
    };
    getrandom::fill(&mut random).map_err(fail)?;
    Ok(random.iter().map(|byte| format!("{byte:02x}")).collect())
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

fn parsed<T: DeserializeOwned>(body: &[u8]) -> std::result::Result<T, Refusal> {
    serde_json::from_slice(body).map_err(|why| (400, format!("the body is not what is expected: {why}")))
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

/// What answers pages.
pub struct Pages {
    pub hub: Arc<Hub>,
    pub token: String,
    /// The name of saved pictures, without an ending.
    pub name: String,
}

impl Handler for Pages {
    fn admit(&self, head: &Head) -> std::result::Result<(), Refusal> {
        if !is_own_host(&head.host) {
            return refuse(403, "this is not the name of the host");
        }
        let (token, ..) = parts(&head.target);
        if !is_same(token, &self.token) {
            return refuse(403, "open the address that raybrook has printed: its token is missing, or of another run");
        }
        match (&head.method[..], &head.origin) {
            // A browser says from which site it posts.
            ("POST", Some(origin)) if *origin != format!("http://{}", head.host) => {
                refuse(403, "posted from another site")
            }
            ("GET" | "POST", _) => Ok(()),
            _ => refuse(405, "only GET and POST"),
        }
    }

    fn answer(&self, head: &Head, body: &[u8]) -> std::result::Result<Answer, Refusal> {
        let (_, name, query) = parts(&head.target);
        if head.method == "GET" { self.got(name, query) } else { self.posted(name, body) }
    }
}

/// The token, the name and the query of `/TOKEN/NAME?QUERY`.
fn parts(target: &str) -> (&str, &str, &str) {
    let (path, query) = target.split_once('?').unwrap_or((target, ""));
    let (token, name) = path.trim_start_matches('/').split_once('/').unwrap_or((path, ""));
    (token, name, query)
}

/// Why nothing is done for a page that was closed or forgotten.
fn no_page() -> Refusal {
    (404, "there is no such page any more".to_owned())
}

impl Pages {
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

    fn posted(&self, name: &str, body: &[u8]) -> std::result::Result<Answer, Refusal> {
        match name {
            "begin" => return Ok(Answer::json(format!("{{\"session\":{}}}", self.hub.begin()))),
            "end" => self.hub.end(parsed(body)?),
            "act" => self.act(&parsed(body)?)?,
            "pick" => return self.pick(&parsed(body)?),
            "method" => self.hub.ask_method(parsed::<AskedMethod>(body)?),
            _ => return refuse(404, "there is no such thing"),
        }
        Ok(Answer::nothing())
    }

    /// Does what happens to a page.
    fn act(&self, Act { session, moves, layer, exposure }: &Act) -> std::result::Result<(), Refusal> {
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
        exposure.map_or(done, |stops| self.hub.set_exposure(*session, stops)).ok_or_else(no_page)
    }

    fn pick(&self, &Pick { session, x, y }: &Pick) -> std::result::Result<Answer, Refusal> {
        let camera = self.hub.camera(session).ok_or_else(no_page)?;
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
            None => Err(no_page()),
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
        let Some((film, exposure)) = self.hub.finished(number(query, "session")?).ok_or_else(no_page)? else {
            return refuse(409, "the picture is not finished yet");
        };
        let stops = if format == ImageFormat::Exr { 0.0 } else { exposure };
        let bytes =
            exposed(&film, stops).and_then(|film| film.to_bytes(format)).map_err(|why| (503, why.to_string()))?;
        let kind = if format == ImageFormat::Exr { "image/x-exr" } else { "image/png" };
        Ok(Answer::new(kind, bytes).saved_as(format!("{}.{ending}", self.name)))
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
        let [a, b] = [0; 2].map(|_| new_token().unwrap());
        assert!(a != b && a.len() == 2 * TOKEN_BYTES, "{a} and {b}");
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
