//! The server: a thread that accepts, and one for each connection. None of them ever makes the service wait.

use crate::access::{Access, Refused};
use crate::board::{Board, Reader};
use crate::http::{self, Answer, BadRequest, Request};
use crate::recordings;
use rustix::net::sockopt::set_socket_send_buffer_size;
use serde::Deserialize;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;
use tungstenite::handshake::derive_accept_key;
use tungstenite::protocol::{Role, WebSocketConfig};
use tungstenite::{Error, Message, WebSocket};

/// Most readers of the live page: more than look at one flight.
pub const READERS_MAX: usize = 32;
/// Most connections at once: as many requests beside the readers. One more is closed at once.
const CONNECTIONS_MAX: usize = 64;
/// A reader that takes nothing for so long is stuck, and closed.
const STUCK: Duration = Duration::from_secs(5);
/// What comes from a reader is looked for this often at least.
const LOOK: Duration = Duration::from_millis(250);
/// Time that a look may wait in the socket: none would mean for ever.
const GLANCE: Duration = Duration::from_millis(1);
/// Longest message of a reader (bytes): which parts it wants.
const MESSAGE_MAX: usize = 1 << 10;
/// How long the service has for a report: it runs ten times a second, and waits a little for map and planner.
const REPORT_PATIENCE: Duration = Duration::from_secs(2);
/// How long the parameter server has for a change.
const CHANGE_PATIENCE: Duration = Duration::from_secs(6);
/// After a wrong token the answer comes later: so many guesses a second and connection.
const GUESS_PAUSE: Duration = Duration::from_millis(300);
/// Bytes of a file that are sent at once.
const CHUNK: usize = 64 << 10;
/// What waits in the kernel for a reader (bytes): some frames of everything, so that whoever is slow sees what is new and not what was.
const SENDING: usize = 256 << 10;
/// Stack of a thread (bytes): where memory is locked, all of it is in memory.
const STACK_BYTES: usize = 256 << 10;
/// Nice value of all threads: whatever flies comes first.
const LOWEST_PRIORITY: i32 = 19;

/// A file of the page: path, type, how it is compressed, content.
type PageFile = (&'static str, &'static str, &'static str, &'static [u8]);

/// The page. Nothing of it comes from elsewhere.
const PAGE: [PageFile; 5] = [
    (
        "/",
        "text/html; charset=utf-8",
        "Cache-Control: no-cache\r\n",
        include_bytes!("../page/index.html"),
    ),
    (
        "/viewer.css",
        "text/css; charset=utf-8",
        "Cache-Control: no-cache\r\n",
        include_bytes!("../page/viewer.css"),
    ),
    (
        "/viewer.js",
        "text/javascript; charset=utf-8",
        "Cache-Control: no-cache\r\n",
        include_bytes!("../page/viewer.js"),
    ),
    // Compressed once for all: every browser that can show it unpacks it.
    (
        "/three.module.min.js",
        "text/javascript; charset=utf-8",
        "Content-Encoding: gzip\r\nCache-Control: max-age=86400\r\n",
        include_bytes!("../page/three.module.min.js.gz"),
    ),
    (
        "/three.LICENSE",
        "text/plain; charset=utf-8",
        "Cache-Control: max-age=86400\r\n",
        include_bytes!("../page/three.LICENSE"),
    ),
];

/// Bytes of the page, as they are sent.
pub fn page_bytes() -> usize {
    PAGE.iter().map(|(.., content)| content.len()).sum()
}

/// What a connection needs.
#[derive(Debug)]
pub struct Server {
    /// What the service posts.
    pub board: Arc<Board>,
    /// Who may do what.
    pub access: Access,
    /// Where recordings are, if there are any.
    pub recordings: Option<PathBuf>,
    connections: AtomicUsize,
}

/// Counts a connection as long as it is there.
struct Counted(Arc<Server>);

impl Drop for Counted {
    fn drop(&mut self) {
        self.0.connections.fetch_sub(1, Ordering::Relaxed);
    }
}

impl Server {
    /// Nothing is served yet.
    pub fn new(board: Arc<Board>, access: Access, recordings: Option<PathBuf>) -> Self {
        Self {
            board,
            access,
            recordings,
            connections: AtomicUsize::new(0),
        }
    }

    /// Serves what comes in at `listener`, in threads of the lowest priority.
    ///
    /// # Errors
    /// The system's about the thread.
    pub fn serve(self, listener: TcpListener) -> std::io::Result<()> {
        let server = Arc::new(self);
        let accept = move || {
            lower_priority();
            for stream in listener.incoming() {
                match stream {
                    Ok(stream) => server.accept(stream),
                    // No descriptor is left, or the like: later there may be one.
                    Err(_) => std::thread::sleep(LOOK),
                }
            }
        };
        thread("accept").spawn(accept).map(|_detached| ())
    }

    fn accept(self: &Arc<Self>, stream: TcpStream) {
        let counted = Counted(Arc::clone(self));
        let before = self.connections.fetch_add(1, Ordering::Relaxed);
        if before >= CONNECTIONS_MAX {
            return;
        }
        // Without a thread the connection ends.
        let _refused = thread("connection").spawn(move || {
            lower_priority();
            let _gone = counted.0.answer(stream);
        });
    }

    /// Reads a request and answers it.
    fn answer(&self, mut stream: TcpStream) -> std::io::Result<()> {
        stream.set_write_timeout(Some(STUCK))?;
        stream.set_nodelay(true)?;
        set_socket_send_buffer_size(&stream, SENDING)?;
        let local = stream.local_addr()?;
        let local = SocketAddr::new(local.ip().to_canonical(), local.port());
        let request = match Request::read(&mut stream) {
            Ok(request) => request,
            Err(BadRequest::Gone) => return Ok(()),
            Err(BadRequest::Garbage) => {
                return refuse(&mut stream, ("400 Bad Request", "jink: no request\n"));
            }
            Err(BadRequest::TooLong) => {
                return refuse(
                    &mut stream,
                    ("431 Request Header Fields Too Large", "jink: too long\n"),
                );
            }
        };
        if let Err(refused) = self.access.check_source(&request, local) {
            return refuse(&mut stream, refused);
        }
        let path = request.path.as_str();
        let with_body = match (request.method.as_str(), path) {
            ("GET", _) => true,
            ("HEAD", _) => false,
            ("POST", "/parameter") => return self.change(&mut stream, &request),
            _ => {
                return refuse(
                    &mut stream,
                    (
                        "405 Method Not Allowed",
                        "jink: there is nothing to change here\n",
                    ),
                );
            }
        };
        if let Some((_, content_type, headers, body)) = PAGE.into_iter().find(|(known, ..)| *known == path) {
            let answer = Answer {
                status: "200 OK",
                content_type,
                headers,
                body,
            };
            return answer.send(&mut stream, with_body);
        }
        if let Err(refused) = self.access.check_reading(&request) {
            std::thread::sleep(GUESS_PAUSE);
            return refuse(&mut stream, refused);
        }
        const JSON: &str = "application/json";
        match path {
            "/live" => self.live(stream, &request),
            "/status.json" => match self.board.report(REPORT_PATIENCE).as_deref() {
                Some(Ok(json)) => Answer::fresh(JSON, json.as_bytes()).send(&mut stream, with_body),
                Some(Err(why)) => refuse(&mut stream, ("503 Service Unavailable", why.as_str())),
                None => refuse(
                    &mut stream,
                    ("503 Service Unavailable", "jink: the viewer does not answer\n"),
                ),
            },
            "/recordings.json" => {
                let list = recordings::list(self.recordings.as_deref());
                let json = serde_json::to_string(&list).unwrap_or_default();
                Answer::fresh(JSON, json.as_bytes()).send(&mut stream, with_body)
            }
            _ => match path.strip_prefix("/recordings/") {
                Some(name) => self.recording(&mut stream, name, with_body),
                None => refuse(&mut stream, NOT_FOUND),
            },
        }
    }

    /// Sends a recording, as it is now.
    fn recording(&self, stream: &mut TcpStream, name: &str, with_body: bool) -> std::io::Result<()> {
        let found = self
            .recordings
            .as_deref()
            .and_then(|folder| recordings::open(folder, name));
        let Some((file, bytes)) = found else {
            return refuse(stream, NOT_FOUND);
        };
        let headers = "Content-Disposition: attachment\r\nCache-Control: no-store\r\n";
        stream.write_all(http::head("200 OK", "application/octet-stream", bytes, headers).as_bytes())?;
        if !with_body {
            return Ok(());
        }
        // One that is being written grows meanwhile; what was promised is sent.
        let mut left = file.take(bytes);
        let mut chunk = vec![0; CHUNK];
        loop {
            match left.read(&mut chunk)? {
                0 => return stream.flush(),
                count => stream.write_all(&chunk[..count])?,
            }
        }
    }

    /// Has a parameter changed, and waits for the answer.
    fn change(&self, stream: &mut TcpStream, request: &Request) -> std::io::Result<()> {
        #[derive(Deserialize)]
        #[serde(deny_unknown_fields)]
        struct Asked {
            name: String,
            value: f64,
        }
        if let Err(refused) = self.access.check_changing(request) {
            std::thread::sleep(GUESS_PAUSE);
            return refuse(stream, refused);
        }
        let Ok(asked) = serde_json::from_slice::<Asked>(&request.body) else {
            let text = "jink: what is asked for is {\"name\": NAME, \"value\": NUMBER}\n";
            return refuse(stream, ("400 Bad Request", text));
        };
        let answered = self.board.ask(asked.name, asked.value);
        match answered.map(|answered| answered.recv_timeout(CHANGE_PATIENCE)) {
            Some(Ok(Ok(value))) => {
                let json = serde_json::json!({ "value": value }).to_string();
                Answer::fresh("application/json", json.as_bytes()).send(stream, true)
            }
            Some(Ok(Err(why))) => refuse(stream, ("409 Conflict", format!("jink: {why}\n").as_str())),
            Some(Err(_)) | None => refuse(
                stream,
                ("503 Service Unavailable", "jink: the viewer does not answer\n"),
            ),
        }
    }

    /// The live connection: becomes a web socket on which everything is sent that is new.
    fn live(&self, mut stream: TcpStream, request: &Request) -> std::io::Result<()> {
        let key = request.header("sec-websocket-key").filter(|_| {
            request.method == "GET"
                && request.lists("upgrade", "websocket")
                && request.lists("connection", "upgrade")
                && request.header("sec-websocket-version") == Some("13")
        });
        let Some(key) = key else {
            return refuse(
                &mut stream,
                ("426 Upgrade Required", "jink: this is a web socket, version 13\n"),
            );
        };
        let Some(reader) = self.board.reader(READERS_MAX) else {
            return refuse(
                &mut stream,
                (
                    "503 Service Unavailable",
                    "jink: too many look at this flight already\n",
                ),
            );
        };
        let head = format!(
            "HTTP/1.1 101 Switching Protocols\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Accept: {}\r\n\r\n",
            derive_accept_key(key.as_bytes())
        );
        stream.write_all(head.as_bytes())?;
        stream.set_read_timeout(Some(GLANCE))?;
        // It is over, one way or the other.
        let _ended = attend(stream, reader);
        Ok(())
    }
}

/// What is not there, and what must not be known to be.
const NOT_FOUND: Refused = ("404 Not Found", "jink: there is nothing of this name\n");

fn refuse(stream: &mut TcpStream, (status, text): (&'static str, &str)) -> std::io::Result<()> {
    Answer::refusal(status, text).send(stream, true)
}

fn thread(name: &str) -> std::thread::Builder {
    std::thread::Builder::new()
        .name(name.to_owned())
        .stack_size(STACK_BYTES)
}

/// Of the calling thread alone, and of those that it starts.
fn lower_priority() {
    let _refused = rustix::process::setpriority_process(None, LOWEST_PRIORITY);
}

/// Sends what is new until the connection ends, or its other end takes nothing any more: a write then ends with an error.
fn attend(stream: TcpStream, mut reader: Reader) -> Result<(), Error> {
    let config = WebSocketConfig::default()
        .max_message_size(Some(MESSAGE_MAX))
        .max_frame_size(Some(MESSAGE_MAX));
    let mut socket = WebSocket::from_raw_socket(stream, Role::Server, Some(config));
    loop {
        for message in reader.next(LOOK) {
            socket.send(message)?;
        }
        loop {
            match socket.read() {
                Ok(Message::Text(text)) => take(&text, &mut reader),
                Ok(_) => {}
                Err(Error::Io(error)) if is_nothing_yet(&error) => break,
                Err(error) => return Err(error),
            }
        }
    }
}

fn is_nothing_yet(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{Interrupted, TimedOut, WouldBlock};
    matches!(error.kind(), WouldBlock | TimedOut | Interrupted)
}

/// Which parts the reader wants; what is not understood changes nothing.
fn take(text: &str, reader: &mut Reader) {
    #[derive(Deserialize)]
    struct Wanted {
        want: Vec<String>,
    }
    if let Ok(wanted) = serde_json::from_str::<Wanted>(text) {
        let names: Vec<&str> = wanted.want.iter().map(String::as_str).collect();
        reader.want(&names);
    }
}
