//! Messages of HTTP/1.1: heads of requests as httparse reads them, and answers.

/// The longest head of a request, bytes, and the most headers in it.
pub const MOST_HEAD: usize = 16 << 10;
pub const MOST_HEADERS: usize = 64;

/// What every answer forbids browsers.
const SAFETY: &str = "Cache-Control: no-store\r\n\
    Content-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; \
    connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n\
    Cross-Origin-Opener-Policy: same-origin\r\n\
    Cross-Origin-Resource-Policy: same-origin\r\n\
    Referrer-Policy: no-referrer\r\n\
    X-Content-Type-Options: nosniff\r\n";

/// An answer.
#[derive(Debug)]
pub struct Answer {
    code: u16,
    kind: &'static str,
    body: Vec<u8>,
    /// The name under which it is saved.
    name: Option<String>,
}

impl Answer {
    pub fn new(kind: &'static str, body: Vec<u8>) -> Answer {
        Answer { code: 200, kind, body, name: None }
    }

    pub fn json(text: String) -> Answer {
        Answer::new("application/json", text.into_bytes())
    }

    pub fn nothing() -> Answer {
        Answer { code: 204, ..Answer::new("", Vec::new()) }
    }

    pub fn saved_as(self, name: String) -> Answer {
        Answer { name: Some(name), ..self }
    }

    pub fn refusal((code, why): &Refusal) -> Answer {
        Answer { code: *code, ..Answer::new("text/plain; charset=utf-8", format!("{why}\n").into_bytes()) }
    }

    /// All bytes of it. They are sent in one go: of several parts the last would wait for the receipt of the others.
    pub fn bytes(&self, is_last: bool) -> Vec<u8> {
        let reason = match self.code {
            200 => "OK",
            204 => "No Content",
            400 => "Bad Request",
            403 => "Forbidden",
            404 => "Not Found",
            405 => "Method Not Allowed",
            408 => "Request Timeout",
            409 => "Conflict",
            411 => "Length Required",
            413 => "Content Too Large",
            431 => "Request Header Fields Too Large",
            _ => "Service Unavailable",
        };
        // What has no content has no length either (RFC 9110, 8.6).
        let content = match self.code {
            204 => String::new(),
            _ => format!("Content-Type: {}\r\nContent-Length: {}\r\n", self.kind, self.body.len()),
        };
        let name = self.name.as_ref().map(|name| format!("Content-Disposition: attachment; filename=\"{name}\"\r\n"));
        let name = name.unwrap_or_default();
        let connection = if is_last { "Connection: close\r\n" } else { "" };
        let head = format!("HTTP/1.1 {} {reason}\r\n{content}{SAFETY}{name}{connection}\r\n", self.code);
        [head.as_bytes(), &self.body].concat()
    }
}

/// Why a request is refused: the status, and a sentence.
pub type Refusal = (u16, String);

pub fn refuse<T>(code: u16, why: impl Into<String>) -> std::result::Result<T, Refusal> {
    Err((code, why.into()))
}

/// The head of a request.
#[derive(Debug, PartialEq, Eq)]
pub struct Head {
    pub method: String,
    /// What is asked for.
    pub target: String,
    /// How the server is named; empty where it is not.
    pub host: String,
    /// From which site a page posts.
    pub origin: Option<String>,
    /// Bytes of the body.
    pub length: u64,
    /// Whether the body is sent only once it was asked for.
    pub waits_to_send: bool,
    /// Whether no other request follows on the connection.
    pub is_last: bool,
}

impl Head {
    /// The head that `bytes` begin with, and its length; `None` where it is not whole yet.
    pub fn parse(bytes: &[u8]) -> std::result::Result<Option<(Head, usize)>, Refusal> {
        let mut headers = [httparse::EMPTY_HEADER; MOST_HEADERS];
        let mut request = httparse::Request::new(&mut headers);
        let length = match request.parse(&bytes[..bytes.len().min(MOST_HEAD)]) {
            Ok(httparse::Status::Complete(length)) => length,
            Ok(httparse::Status::Partial) if bytes.len() < MOST_HEAD => return Ok(None),
            Ok(httparse::Status::Partial) => return refuse(431, "the head of the request is too long"),
            Err(httparse::Error::TooManyHeaders) => return refuse(431, "the request has too many headers"),
            Err(why) => return refuse(400, format!("this is no request of HTTP/1.1: {why}")),
        };
        Ok(Some((Head::of(&request)?, length)))
    }

    fn of(request: &httparse::Request) -> std::result::Result<Head, Refusal> {
        if header(request, "Transfer-Encoding")?.is_some() {
            return refuse(411, "a body must have its length in the head");
        }
        let is_close = |value: &str| value.split(',').any(|option| option.trim().eq_ignore_ascii_case("close"));
        Ok(Head {
            method: request.method.unwrap_or_default().to_owned(),
            target: request.path.unwrap_or_default().to_owned(),
            host: header(request, "Host")?.unwrap_or_default().to_owned(),
            origin: header(request, "Origin")?.map(str::to_owned),
            length: header(request, "Content-Length")?.map_or(Ok(0), body_length)?,
            waits_to_send: header(request, "Expect")?.is_some_and(|value| value.eq_ignore_ascii_case("100-continue")),
            is_last: request.version != Some(1) || header(request, "Connection")?.is_some_and(is_close),
        })
    }
}

/// The header of that name. One that is there twice could mean this or that.
fn header<'b>(request: &httparse::Request<'_, 'b>, name: &str) -> std::result::Result<Option<&'b str>, Refusal> {
    let mut found = request.headers.iter().filter(|header| header.name.eq_ignore_ascii_case(name));
    match (found.next().map(|header| std::str::from_utf8(header.value)), found.next()) {
        (None, _) => Ok(None),
        (Some(Ok(value)), None) => Ok(Some(value.trim())),
        _ => refuse(400, format!("the header {name} is there twice, or is no text")),
    }
}

fn body_length(value: &str) -> std::result::Result<u64, Refusal> {
    if value.is_empty() || !value.bytes().all(|byte| byte.is_ascii_digit()) {
        return refuse(400, "the length of the body is no number");
    }
    // More digits than a number has are too many bytes in any case.
    Ok(value.parse().unwrap_or(u64::MAX))
}
