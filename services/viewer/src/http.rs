//! Requests of browsers as they come over a socket, and answers to them: what is too long, too slow or no request ends the connection.

use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// A request is whole within this time, or is none.
const PATIENCE: Duration = Duration::from_secs(5);
/// Longest head (bytes): browsers send less than one KiB.
const HEAD_MAX: usize = 8 << 10;
/// Longest body (bytes): a parameter and its value.
const BODY_MAX: usize = 1 << 10;
/// Most header lines.
const HEADERS_MAX: usize = 64;

/// A request.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Request {
    /// `GET`, `POST`, ...
    pub method: String,
    /// Path, as it was sent and without what follows a question mark.
    pub path: String,
    /// Names in lower case.
    headers: Vec<(String, String)>,
    /// What follows the head.
    pub body: Vec<u8>,
}

/// Why there is no request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BadRequest {
    /// The connection has ended, or nothing came for too long.
    Gone,
    /// It is no HTTP.
    Garbage,
    /// It is longer than any request to this page.
    TooLong,
}

impl Request {
    /// The value of a header; `None` as well if it is there twice: then nobody knows which one counts.
    pub fn header(&self, name: &str) -> Option<&str> {
        let mut values = self.headers.iter().filter(|(known, _)| known == name);
        let value = values.next();
        value
            .filter(|_| values.next().is_none())
            .map(|(_, value)| value.as_str())
    }

    /// Whether there is such a header, once or more often.
    pub fn has(&self, name: &str) -> bool {
        self.headers.iter().any(|(known, _)| known == name)
    }

    /// Whether a header that is a list has `word` in it, in any case.
    pub fn lists(&self, name: &str, word: &str) -> bool {
        let words = self.header(name).unwrap_or_default().split(',');
        words
            .map(str::trim)
            .any(|listed| listed.eq_ignore_ascii_case(word))
    }

    /// Reads one from `stream`.
    ///
    /// # Errors
    /// See [`BadRequest`].
    pub fn read(stream: &mut TcpStream) -> Result<Self, BadRequest> {
        let end = Instant::now() + PATIENCE;
        let mut bytes = Vec::with_capacity(1024);
        let (mut request, head_bytes) = loop {
            if let Some(parsed) = Self::parse(&bytes)? {
                break parsed;
            }
            if bytes.len() >= HEAD_MAX {
                return Err(BadRequest::TooLong);
            }
            more(stream, &mut bytes, end)?;
        };
        let length = match request.header("content-length") {
            Some(length) => length.parse().map_err(|_| BadRequest::Garbage)?,
            None if request.has("content-length") || request.has("transfer-encoding") => {
                return Err(BadRequest::Garbage);
            }
            None => 0,
        };
        if length > BODY_MAX {
            return Err(BadRequest::TooLong);
        }
        while bytes.len() < head_bytes + length {
            more(stream, &mut bytes, end)?;
        }
        request.body = bytes[head_bytes..head_bytes + length].to_vec();
        Ok(request)
    }

    /// The request that begins with these bytes and the length of its head; `None` if there must be more of them.
    fn parse(bytes: &[u8]) -> Result<Option<(Self, usize)>, BadRequest> {
        let mut headers = [httparse::EMPTY_HEADER; HEADERS_MAX];
        let mut parsed = httparse::Request::new(&mut headers);
        let head_bytes = match parsed.parse(bytes) {
            Ok(httparse::Status::Complete(length)) => length,
            Ok(httparse::Status::Partial) => return Ok(None),
            Err(httparse::Error::TooManyHeaders) => return Err(BadRequest::TooLong),
            Err(_) => return Err(BadRequest::Garbage),
        };
        let target = parsed.path.unwrap_or_default();
        let path = target.split_once('?').map_or(target, |(path, _)| path);
        let headers = parsed.headers.iter().map(|header| {
            let value = std::str::from_utf8(header.value).map_err(|_| BadRequest::Garbage)?;
            Ok((header.name.to_ascii_lowercase(), value.trim().to_owned()))
        });
        let request = Self {
            method: parsed.method.unwrap_or_default().to_owned(),
            path: path.to_owned(),
            headers: headers.collect::<Result<_, _>>()?,
            body: Vec::new(),
        };
        Ok(Some((request, head_bytes)))
    }
}

/// Appends what comes next, until `end`.
fn more(stream: &mut TcpStream, bytes: &mut Vec<u8>, end: Instant) -> Result<(), BadRequest> {
    let left = end
        .checked_duration_since(Instant::now())
        .filter(|left| !left.is_zero());
    stream
        .set_read_timeout(Some(left.ok_or(BadRequest::Gone)?))
        .map_err(|_| BadRequest::Gone)?;
    let mut chunk = [0; 1024];
    loop {
        match stream.read(&mut chunk) {
            Ok(0) => return Err(BadRequest::Gone),
            Ok(count) => {
                bytes.extend_from_slice(&chunk[..count]);
                return Ok(());
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            Err(_) => return Err(BadRequest::Gone),
        }
    }
}

/// What browsers may do with anything of this page: it is ours, and shown by itself alone. Scripts and pictures come from here only.
const SECURITY: &str = "X-Content-Type-Options: nosniff\r\nReferrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\n\
     X-Frame-Options: DENY\r\nContent-Security-Policy: default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; \
     connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'\r\n";

/// An answer.
#[derive(Clone, Debug)]
pub struct Answer<'a> {
    /// Status with its text, as `200 OK`.
    pub status: &'static str,
    /// Type of the body.
    pub content_type: &'static str,
    /// Further header lines, each with its end.
    pub headers: &'static str,
    /// The body.
    pub body: &'a [u8],
}

impl<'a> Answer<'a> {
    /// A body that is new each time.
    pub fn fresh(content_type: &'static str, body: &'a [u8]) -> Self {
        Self {
            status: "200 OK",
            content_type,
            headers: "Cache-Control: no-store\r\n",
            body,
        }
    }

    /// A sentence why not.
    pub fn refusal(status: &'static str, text: &'a str) -> Self {
        Self {
            status,
            ..Self::fresh("text/plain; charset=utf-8", text.as_bytes())
        }
    }

    /// Sends it; the connection ends with it.
    ///
    /// # Errors
    /// Those of the connection.
    pub fn send(&self, stream: &mut TcpStream, with_body: bool) -> std::io::Result<()> {
        let head = head(
            self.status,
            self.content_type,
            self.body.len() as u64,
            self.headers,
        );
        stream.write_all(head.as_bytes())?;
        if with_body {
            stream.write_all(self.body)?;
        }
        stream.flush()
    }
}

/// The head of an answer with a body of so many bytes.
pub fn head(status: &str, content_type: &str, bytes: u64, headers: &str) -> String {
    format!(
        "HTTP/1.1 {status}\r\nContent-Type: {content_type}\r\nContent-Length: {bytes}\r\nConnection: close\r\n{SECURITY}{headers}\r\n"
    )
}
