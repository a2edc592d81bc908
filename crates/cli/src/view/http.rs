//! A server of HTTP/1.1 (RFC 9112) for browsers of this machine.
//!
//! Whoever can connect can send anything, or nothing. So all that comes is bounded in bytes and in time, a body is read
//! only where the head has shown the right token, and nothing is reserved because a head says that it will come. Where
//! all places are taken, a connection that has not shown the token yet gives way to a new one.
//!
//! Bad at: bodies of unknown length (`chunked`), which browsers do not send; they are refused.

use super::message::{Answer, Head, Refusal, refuse};
use raybrook::{Error, Result};
use std::collections::BTreeMap;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{Ipv4Addr, Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The longest body of a request, bytes.
pub const MOST_BODY: usize = 64 << 10;
/// After a refusal so much of what is still on its way is taken, for so long: a connection that is closed on it would
/// take the refusal back.
const MOST_LEFT: usize = 1 << 20;
const LEFT_TIME: Duration = Duration::from_secs(1);
/// How long to wait where the system gives no connection, as when there are too many open files.
const PAUSE: Duration = Duration::from_millis(10);

/// What connections may take.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// How many are open at a time. Each has a thread.
    pub connections: usize,
    /// Time from a request's first byte to its last; and from a connection's begin to the first byte.
    pub request: Duration,
    /// Time from an answer to the next request.
    pub idle: Duration,
    /// Time in which at least some of an answer must be taken.
    pub write: Duration,
}

impl Limits {
    /// For browsers, through slow tunnels, too. Each opens six connections to a server and not more.
    pub const USUAL: Limits = Limits {
        connections: 128,
        request: Duration::from_secs(10),
        idle: Duration::from_secs(60),
        write: Duration::from_secs(20),
    };
}

/// What answers requests.
pub trait Handler: Send + Sync + 'static {
    /// Whether whoever sends this may ask for something. Only then the body is read.
    fn admit(&self, head: &Head) -> std::result::Result<(), Refusal>;

    /// The answer to a request that was admitted.
    fn answer(&self, head: &Head, body: &[u8]) -> std::result::Result<Answer, Refusal>;
}

/// Listens on `port` of 127.0.0.1; 0 takes one that is free. Returns the port, too.
///
/// # Errors
/// [`Error::Option`] when the port is taken.
pub fn listen(port: u16) -> Result<(TcpListener, u16)> {
    let fail = |why: io::Error| {
        let why = match why.kind() {
            ErrorKind::AddrInUse => "another program does; give another port, or 0 for a free one".to_owned(),
            _ => why.to_string(),
        };
        Error::option("--port", format!("127.0.0.1:{port} cannot be listened on: {why}"))
    };
    let listener = TcpListener::bind(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(fail)?;
    let port = listener.local_addr().map_err(fail)?.port();
    Ok((listener, port))
}

/// Answers requests for ever.
pub fn serve(listener: &TcpListener, handler: &Arc<impl Handler>, limits: Limits) {
    let open = Arc::default();
    loop {
        match listener.accept() {
            Ok((stream, _)) => take(stream, &open, handler, limits),
            // Whoever it was is gone.
            Err(why) if why.kind() == ErrorKind::ConnectionAborted => {}
            Err(_) => {
                lock(&open).drop_stranger();
                std::thread::sleep(PAUSE);
            }
        }
    }
}

/// Answers a connection in a thread of its own, where there is a place for it.
fn take(stream: TcpStream, open: &Arc<Mutex<Open>>, handler: &Arc<impl Handler>, limits: Limits) {
    let stream = Arc::new(stream);
    let Some(place) = Place::of(open, &stream, limits.connections) else {
        let refusal = Answer::refusal(&(503, "there are too many connections".to_owned()));
        _ = Connection::new(&stream, limits).send(&refusal, true);
        return;
    };
    let handler = handler.clone();
    let answer = move || Connection::new(&stream, limits).answer(&*handler, &place);
    // Without a thread the connection is closed, which is an answer, too.
    _ = std::thread::Builder::new().name("connection".to_owned()).spawn(answer);
}

/// The connections that are open, the oldest first.
#[derive(Default)]
struct Open {
    last: u64,
    streams: BTreeMap<u64, Stream>,
}

struct Stream {
    stream: Arc<TcpStream>,
    /// Whether it has not shown the token yet.
    is_stranger: bool,
}

fn lock(open: &Mutex<Open>) -> MutexGuard<'_, Open> {
    open.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Open {
    /// Ends the oldest connection that may be anybody's; returns whether there was one.
    fn drop_stranger(&mut self) -> bool {
        let stranger = self.streams.iter().find(|(_, stream)| stream.is_stranger).map(|(&id, _)| id);
        let dropped = stranger.and_then(|id| self.streams.remove(&id));
        dropped.map(|Stream { stream, .. }| stream.shutdown(Shutdown::Both)).is_some()
    }
}

/// A place among the connections that are open.
struct Place {
    id: u64,
    open: Arc<Mutex<Open>>,
}

impl Place {
    /// A place for `stream`, unless `most` others have theirs and none gives way.
    fn of(open: &Arc<Mutex<Open>>, stream: &Arc<TcpStream>, most: usize) -> Option<Place> {
        let mut all = lock(open);
        if all.streams.len() >= most && !all.drop_stranger() {
            return None;
        }
        all.last += 1;
        let id = all.last;
        all.streams.insert(id, Stream { stream: stream.clone(), is_stranger: true });
        Some(Place { id, open: open.clone() })
    }

    /// It has shown the token.
    fn make_known(&self) {
        lock(&self.open).streams.get_mut(&self.id).into_iter().for_each(|stream| stream.is_stranger = false);
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        lock(&self.open).streams.remove(&self.id);
    }
}

/// A connection, and what was read of it and not taken yet.
struct Connection<'s> {
    stream: &'s TcpStream,
    limits: Limits,
    unread: Vec<u8>,
}

impl<'s> Connection<'s> {
    fn new(stream: &'s TcpStream, limits: Limits) -> Connection<'s> {
        Connection { stream, limits, unread: Vec::new() }
    }

    /// Answers requests one after the other until there are no more.
    fn answer(&mut self, handler: &impl Handler, place: &Place) {
        _ = self.stream.set_nodelay(true);
        let mut patience = self.limits.request;
        while self.has_begun(patience) {
            let request = self.request(handler, place);
            let answer = request.and_then(|(head, body)| Ok((handler.answer(&head, &body)?, head.is_last)));
            let (answer, is_last) = match answer {
                Ok(answer) => answer,
                Err(refusal) => return self.refuse(&refusal),
            };
            if self.send(&answer, is_last).is_err() || is_last {
                return;
            }
            patience = self.limits.idle;
        }
    }

    /// Whether a request begins within that time.
    fn has_begun(&mut self, patience: Duration) -> bool {
        !self.unread.is_empty() || self.read_until(Instant::now() + patience).is_ok()
    }

    /// The next request.
    fn request(&mut self, handler: &impl Handler, place: &Place) -> std::result::Result<(Head, Vec<u8>), Refusal> {
        let deadline = Instant::now() + self.limits.request;
        let (head, length) = loop {
            match Head::parse(&self.unread)? {
                Some(found) => break found,
                None => self.read_until(deadline)?,
            }
        };
        self.unread.drain(..length);
        handler.admit(&head)?;
        place.make_known();
        let body = self.body(&head, deadline)?;
        Ok((head, body))
    }

    fn body(&mut self, head: &Head, deadline: Instant) -> std::result::Result<Vec<u8>, Refusal> {
        if head.length > MOST_BODY as u64 {
            return refuse(413, "the body is too long");
        }
        let length = head.length as usize;
        if head.waits_to_send && self.unread.len() < length {
            _ = self.stream.write_all(b"HTTP/1.1 100 Continue\r\n\r\n");
        }
        while self.unread.len() < length {
            self.read_until(deadline)?;
        }
        let rest = self.unread.split_off(length);
        Ok(std::mem::replace(&mut self.unread, rest))
    }

    /// Reads something of what has come by then.
    fn read_until(&mut self, deadline: Instant) -> std::result::Result<(), Refusal> {
        let mut part = [0; 4096];
        loop {
            let left = deadline.saturating_duration_since(Instant::now());
            // No time at all would mean any time.
            let read = if left.is_zero() { Err(ErrorKind::TimedOut.into()) } else { self.read(&mut part, left) };
            match read {
                Ok(0) => return refuse(400, "the request is not whole"),
                Ok(count) => {
                    self.unread.extend_from_slice(&part[..count]);
                    return Ok(());
                }
                Err(why) if why.kind() == ErrorKind::Interrupted => {}
                Err(_) => return refuse(408, "the request did not come in time"),
            }
        }
    }

    fn read(&mut self, part: &mut [u8], most: Duration) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(most))?;
        self.stream.read(part)
    }

    fn send(&mut self, answer: &Answer, is_last: bool) -> io::Result<()> {
        self.stream.set_write_timeout(Some(self.limits.write))?;
        self.stream.write_all(&answer.bytes(is_last))
    }

    /// Refuses a request, which ends the connection: its body may still be on its way.
    fn refuse(&mut self, refusal: &Refusal) {
        if self.send(&Answer::refusal(refusal), true).is_err() || self.stream.shutdown(Shutdown::Write).is_err() {
            return;
        }
        let deadline = Instant::now() + LEFT_TIME;
        let mut taken = 0;
        while taken < MOST_LEFT && self.read_until(deadline).is_ok() {
            taken += self.unread.len();
            self.unread.clear();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::message::{MOST_HEAD, MOST_HEADERS};
    use super::*;

    /// Admits whoever asks for `/known`, and tells the length of the body.
    struct Counting;

    impl Handler for Counting {
        fn admit(&self, head: &Head) -> std::result::Result<(), Refusal> {
            if head.target == "/known" { Ok(()) } else { refuse(403, "a stranger") }
        }

        fn answer(&self, head: &Head, body: &[u8]) -> std::result::Result<Answer, Refusal> {
            match &head.method[..] {
                "DELETE" => refuse(405, "no"),
                "HALT" => Ok(Answer::nothing()),
                _ => Ok(Answer::json(body.len().to_string())),
            }
        }
    }

    const SHORT: Limits = Limits {
        connections: 8,
        request: Duration::from_millis(300),
        idle: Duration::from_millis(300),
        write: Duration::from_secs(5),
    };

    fn start(limits: Limits) -> u16 {
        let (listener, port) = listen(0).unwrap();
        std::thread::spawn(move || serve(&listener, &Arc::new(Counting), limits));
        port
    }

    fn connect(port: u16) -> TcpStream {
        let stream = TcpStream::connect((Ipv4Addr::LOCALHOST, port)).unwrap();
        stream.set_read_timeout(Some(Duration::from_secs(30))).unwrap();
        stream
    }

    /// What comes until the connection ends.
    fn rest(stream: &mut TcpStream) -> String {
        let mut text = String::new();
        stream.read_to_string(&mut text).unwrap();
        text
    }

    /// Sends `request`, and returns all that is answered.
    fn ask(port: u16, request: &str) -> String {
        let mut stream = connect(port);
        stream.write_all(request.as_bytes()).unwrap();
        rest(&mut stream)
    }

    const GET: &str = "GET /known HTTP/1.1\r\n\r\n";
    const LAST: &str = "GET /known HTTP/1.1\r\nConnection: close\r\n\r\n";

    fn codes(text: &str) -> Vec<&str> {
        text.split("HTTP/1.1 ").skip(1).map(|answer| &answer[..3]).collect()
    }

    #[test]
    fn several_requests_come_on_one_connection_in_any_pieces() {
        let port = start(Limits { request: Duration::from_secs(20), ..SHORT });
        let post = "POST /known HTTP/1.1\r\nhost: x\r\ncontent-LENGTH: 5\r\n\r\nabcde";
        let text = ask(port, &format!("{GET}{post}HALT /known HTTP/1.1\r\n\r\n{LAST}{GET}"));
        assert_eq!(codes(&text), ["200", "200", "204", "200"], "{text}");
        assert!(text.contains("\r\n\r\n5HTTP/1.1 204 No Content\r\nCache-Control"), "{text}");
        assert!(text.ends_with("Connection: close\r\n\r\n0"), "{text}");
        let mut stream = connect(port);
        for byte in [post, LAST].concat().bytes() {
            stream.write_all(&[byte]).unwrap();
        }
        assert_eq!(codes(&rest(&mut stream)), ["200", "200"]);
    }

    #[test]
    fn what_is_no_request_is_refused_and_ends_the_connection() {
        let port = start(SHORT);
        let head = |headers: &str| format!("POST /known HTTP/1.1\r\n{headers}\r\n\r\n{GET}");
        for (request, code) in [
            ("nonsense\r\n\r\n", "400"),
            ("GET /known HTTP/2.0\r\n\r\n", "400"),
            ("GET / HTTP/1.1\r\n\r\n", "403"),
            ("DELETE /known HTTP/1.1\r\n\r\n", "405"),
            (&head("Host: a\r\nHost: b"), "400"),
            (&head("Content-Length: 1\r\nContent-Length: 2"), "400"),
            (&head("Content-Length: -1"), "400"),
            (&head("Content-Length: +1"), "400"),
            (&head("Content-Length:"), "400"),
            (&head("Host: \u{1}"), "400"),
            (&head("Transfer-Encoding: chunked"), "411"),
            (&head("Content-Length: 65537"), "413"),
            (&head(&format!("Content-Length: {}", u64::MAX)), "413"),
            (&head("Content-Length: 999999999999999999999999999"), "413"),
            (&head(&"A: b\r\n".repeat(MOST_HEADERS + 1)), "431"),
            (&head(&format!("A: {}", "b".repeat(MOST_HEAD))), "431"),
        ] {
            let text = ask(port, request);
            assert_eq!(codes(&text), [code], "{request:.80}: {text}");
            assert!(text.contains("Connection: close\r\n"), "{text}");
        }
        // Without the token nobody looks how long the body is, or at it.
        let stranger = format!("POST / HTTP/1.1\r\nContent-Length: {}\r\n\r\n{}", u64::MAX, "a".repeat(200_000));
        assert_eq!(codes(&ask(port, &stranger)), ["403"]);
        assert_eq!(codes(&ask(port, &head("Content-Length: 65536").replace(GET, &"a".repeat(MOST_BODY + 1)))).len(), 2);
        assert_eq!(codes(&ask(port, "GET /known HTTP/1.0\r\n\r\n")), ["200"]);
        let waits = "POST /known HTTP/1.1\r\nExpect: 100-continue\r\nContent-Length: 2\r\nConnection: close\r\n\r\n";
        let mut stream = connect(port);
        stream.write_all(waits.as_bytes()).unwrap();
        let mut line = [0; 25];
        stream.read_exact(&mut line).unwrap();
        assert_eq!(&line, b"HTTP/1.1 100 Continue\r\n\r\n");
        stream.write_all(b"ab").unwrap();
        assert!(rest(&mut stream).ends_with("\r\n\r\n2"));
    }

    #[test]
    fn whoever_is_slow_is_left_alone() {
        let port = start(SHORT);
        let [mut silent, mut head, mut body, mut idle, mut dripping] = [0; 5].map(|_| connect(port));
        head.write_all(b"GET /known HTT").unwrap();
        body.write_all(b"POST /known HTTP/1.1\r\nContent-Length: 9\r\n\r\nabc").unwrap();
        idle.write_all(GET.as_bytes()).unwrap();
        // A byte now and then does not make the time longer.
        let start = Instant::now();
        while dripping.write_all(b"G").is_ok() && start.elapsed() < Duration::from_secs(20) {
            std::thread::sleep(Duration::from_millis(50));
        }
        assert!(start.elapsed() < Duration::from_secs(20));
        assert_eq!(rest(&mut silent), "");
        assert_eq!(codes(&rest(&mut head)), ["408"]);
        assert_eq!(codes(&rest(&mut body)), ["408"]);
        assert_eq!(codes(&rest(&mut idle)), ["200"]);
    }

    #[test]
    fn strangers_give_way_and_nobody_else() {
        let limits = Limits { request: Duration::from_secs(60), idle: Duration::from_secs(60), ..SHORT };
        let port = start(limits);
        let mut strangers: Vec<_> = (0..3 * limits.connections).map(|_| connect(port)).collect();
        assert_eq!(codes(&ask(port, LAST)), ["200"]);
        assert_eq!(rest(&mut strangers[0]), "", "the oldest ones have given way");
        let known = || {
            let mut stream = connect(port);
            stream.write_all(GET.as_bytes()).unwrap();
            assert!(stream.read(&mut [0; 4096]).unwrap() > 0);
            stream
        };
        let mut all: Vec<_> = (0..limits.connections).map(|_| known()).collect();
        let mut late = connect(port);
        assert_eq!(codes(&rest(&mut late)), ["503"]);
        for stream in &mut all {
            stream.write_all(LAST.as_bytes()).unwrap();
            assert_eq!(codes(&rest(stream)), ["200"]);
        }
    }
}
