//! The server over real sockets: who is refused, and who cannot disturb whom.

use crate::access::Access;
use crate::board::{Board, Part};
use crate::server::{READERS_MAX, Server, page_bytes};
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};
use tungstenite::Message;
use tungstenite::protocol::{Role, WebSocket};

const TOKEN: &str = "0123456789abcdef0123456789abcdef";
/// Longest that anything here may take.
const WATCHDOG: Duration = Duration::from_secs(60);

/// A server on a free port of this host; where `is_closed`, readers need the token.
fn served(is_closed: bool, recordings: Option<PathBuf>) -> (SocketAddr, Arc<Board>) {
    let board = Arc::new(Board::default());
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let server = Server::new(Arc::clone(&board), Access::new(TOKEN, is_closed), recordings);
    server.serve(listener).unwrap();
    (address, board)
}

fn connect(address: SocketAddr) -> TcpStream {
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(WATCHDOG)).unwrap();
    stream
}

/// What comes back for these bytes until the connection ends.
fn exchange(address: SocketAddr, sent: &[u8]) -> String {
    let mut stream = connect(address);
    // The other end may have had enough before all is sent.
    let _refused = stream.write_all(sent);
    let mut answer = Vec::new();
    let _reset = stream.read_to_end(&mut answer);
    String::from_utf8_lossy(&answer).into_owned()
}

/// The status of the answer to a request with these header lines besides `Host`.
fn status(address: SocketAddr, line: &str, host: &str, headers: &[&str]) -> u16 {
    let headers: String = headers.iter().map(|header| format!("{header}\r\n")).collect();
    let answer = exchange(
        address,
        format!("{line} HTTP/1.1\r\nHost: {host}\r\n{headers}\r\n").as_bytes(),
    );
    answer
        .split(' ')
        .nth(1)
        .and_then(|code| code.parse().ok())
        .unwrap_or(0)
}

const UPGRADE: [&str; 4] = [
    "Upgrade: websocket",
    "Connection: keep-alive, Upgrade",
    "Sec-WebSocket-Version: 13",
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==",
];

/// A live connection.
fn live(address: SocketAddr) -> WebSocket<TcpStream> {
    let mut stream = connect(address);
    let request = format!(
        "GET /live HTTP/1.1\r\nHost: {address}\r\n{}\r\n\r\n",
        UPGRADE.join("\r\n")
    );
    stream.write_all(request.as_bytes()).unwrap();
    let mut head = Vec::new();
    while !head.ends_with(b"\r\n\r\n") {
        let mut byte = [0];
        stream.read_exact(&mut byte).unwrap();
        head.push(byte[0]);
    }
    let head = String::from_utf8(head).unwrap();
    assert!(head.starts_with("HTTP/1.1 101 "), "{head}");
    // The example of RFC 6455.
    assert!(head.contains("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), "{head}");
    WebSocket::from_raw_socket(stream, Role::Client, None)
}

#[test]
fn the_page_is_whole_small_and_has_nothing_from_elsewhere() {
    let (address, _board) = served(false, None);
    let page = exchange(
        address,
        format!("GET / HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes(),
    );
    assert!(
        page.starts_with("HTTP/1.1 200 OK") && page.contains("Content-Security-Policy: default-src 'none'")
    );
    for file in [
        "/viewer.js",
        "/viewer.css",
        "/three.module.min.js",
        "/three.LICENSE",
    ] {
        assert_eq!(
            status(address, &format!("GET {file}"), &address.to_string(), &[]),
            200,
            "{file}"
        );
    }
    assert!(page_bytes() < 1_000_000, "{} bytes", page_bytes());
    for text in [
        include_str!("../page/index.html"),
        include_str!("../page/viewer.js"),
        include_str!("../page/viewer.css"),
    ] {
        assert!(
            !text.contains("https:") && !text.contains("innerHTML"),
            "something foreign"
        );
    }
}

#[test]
fn names_and_pages_of_others_are_refused_on_every_path() {
    let (address, _board) = served(false, None);
    let own = address.to_string();
    let localhost = format!("localhost:{}", address.port());
    let foreign = format!("evil.example:{}", address.port());
    let origin_of = |host: &str| format!("Origin: http://{host}");
    let other_name = origin_of(&localhost);
    for path in [
        "GET /",
        "GET /viewer.js",
        "GET /recordings.json",
        "GET /live",
        "POST /parameter",
    ] {
        assert_eq!(status(address, path, &foreign, &[]), 403, "{path}");
        assert_eq!(status(address, path, "", &[]), 403, "{path}");
        for origin in [
            "Origin: http://evil.example",
            "Origin: null",
            "Origin: https://127.0.0.1",
            other_name.as_str(),
        ] {
            assert_eq!(status(address, path, &own, &[origin]), 403, "{path} {origin}");
        }
    }
    let host = format!("Host: {foreign}");
    assert_eq!(status(address, "GET /", &own, &[&host]), 403, "two hosts");
    assert_eq!(status(address, "GET /", &localhost, &[]), 200);
    let foreign_origin = origin_of(&foreign);
    let mut upgrade = UPGRADE.to_vec();
    upgrade.push(&foreign_origin);
    assert_eq!(status(address, "GET /live", &own, &upgrade), 403);
    assert_eq!(status(address, "GET /live", &own, &[]), 426, "no web socket");
}

#[test]
fn a_token_is_needed_to_change_anything_and_beyond_this_host_to_read() {
    let bearer = format!("Authorization: Bearer {TOKEN}");
    let cookie = format!("Cookie: other=1; jink_token={TOKEN}");
    let wrong = "Authorization: Bearer 0123456789abcdef0123456789abcdeg";
    let (open, _board) = served(false, None);
    let (closed, _other) = served(true, None);
    let host = |address: SocketAddr| address.to_string();
    assert_eq!(status(open, "GET /recordings.json", &host(open), &[]), 200);
    for (headers, expected) in [
        (vec![], 401),
        (vec![wrong], 401),
        (vec![bearer.as_str()], 200),
        (vec![cookie.as_str()], 200),
    ] {
        assert_eq!(
            status(closed, "GET /recordings.json", &host(closed), &headers),
            expected,
            "{headers:?}"
        );
    }
    let mut upgrade = UPGRADE.to_vec();
    assert_eq!(status(closed, "GET /live", &host(closed), &upgrade), 401);
    upgrade.push("Cookie: jink_token=");
    assert_eq!(status(closed, "GET /live", &host(closed), &upgrade), 401);
    // A browser sends cookies by itself, so they change nothing.
    for headers in [vec![], vec![wrong], vec![cookie.as_str()]] {
        assert_eq!(
            status(open, "POST /parameter", &host(open), &headers),
            401,
            "{headers:?}"
        );
    }
    assert_eq!(
        status(open, "POST /parameter", &host(open), &[&bearer]),
        400,
        "nothing is asked for"
    );
    assert_eq!(status(open, "DELETE /parameter", &host(open), &[&bearer]), 405);
}

#[test]
fn a_change_is_passed_on_and_its_answer_comes_back() {
    let (address, board) = served(false, None);
    let service = std::thread::spawn(move || {
        let begin = Instant::now();
        let refusal = "OA_SPD_MAX = 99 is outside 0.3 to 20".to_owned();
        for value in [Ok(4.5), Err(refusal)] {
            let change = loop {
                if let Some(change) = board.next_change() {
                    break change;
                }
                assert!(begin.elapsed() < WATCHDOG);
                std::thread::sleep(Duration::from_millis(5));
            };
            assert_eq!(change.name, "OA_SPD_MAX");
            change.answer.send(value).unwrap();
        }
    });
    let ask = |value: f64| {
        let body = format!("{{\"name\":\"OA_SPD_MAX\",\"value\":{value}}}");
        let request = format!(
            "POST /parameter HTTP/1.1\r\nHost: {address}\r\nAuthorization: Bearer {TOKEN}\r\nContent-Length: {}\r\n\r\n{body}",
            body.len()
        );
        exchange(address, request.as_bytes())
    };
    assert!(ask(4.5).ends_with("{\"value\":4.5}"));
    let refused = ask(99.0);
    assert!(
        refused.starts_with("HTTP/1.1 409 ") && refused.contains("outside 0.3 to 20"),
        "{refused}"
    );
    service.join().unwrap();
}

#[test]
fn no_path_leads_out_of_the_folder_of_recordings() {
    let folder = std::env::temp_dir().join(format!("jink_viewer_served_{}", std::process::id()));
    std::fs::create_dir_all(folder.join("recordings")).unwrap();
    std::fs::write(folder.join("secret.mcap"), "secret").unwrap();
    std::fs::write(folder.join("recordings/jink-1-1.mcap"), "flight").unwrap();
    let (address, _board) = served(false, Some(folder.join("recordings")));
    let get = |path: &str| {
        exchange(
            address,
            format!("GET {path} HTTP/1.1\r\nHost: {address}\r\n\r\n").as_bytes(),
        )
    };
    assert!(get("/recordings.json").contains("jink-1-1.mcap"));
    assert!(get("/recordings/jink-1-1.mcap").ends_with("flight"));
    for path in [
        "/recordings/../secret.mcap",
        "/recordings/..%2fsecret.mcap",
        "/recordings/%2e%2e/secret.mcap",
        "/recordings//etc/passwd",
        "/recordings/",
        "/../secret.mcap",
        "/recordings/jink-1-1.mcap/../../secret.mcap",
        "/recordings/..\\secret.mcap",
    ] {
        let answer = get(path);
        assert!(
            answer.starts_with("HTTP/1.1 404 ") && !answer.contains("secret"),
            "{path}: {answer}"
        );
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn garbage_and_requests_that_never_end_disturb_nobody() {
    let (address, board) = served(false, None);
    let long = format!("GET /{} HTTP/1.1\r\n", "x".repeat(20_000));
    let huge = format!("POST /parameter HTTP/1.1\r\nHost: {address}\r\nContent-Length: 999999999\r\n\r\n");
    for (sent, expected) in [
        (&b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03"[..], "400"),
        (b"GET / HTTP/1.1\r\nHost\r\n\r\n", "400"),
        (long.as_bytes(), "431"),
        (huge.as_bytes(), "431"),
    ] {
        let answer = exchange(address, sent);
        assert!(
            answer.starts_with(&format!("HTTP/1.1 {expected} ")) || answer.is_empty(),
            "{answer}"
        );
    }
    let halves: Vec<TcpStream> = (0..20)
        .map(|_| {
            let mut stream = connect(address);
            stream.write_all(b"GET / HTTP/1.1\r\nHost: ").unwrap();
            stream
        })
        .collect();
    assert_eq!(status(address, "GET /", &address.to_string(), &[]), 200);
    // Who asks for nothing is let go of.
    for mut half in halves {
        let mut rest = Vec::new();
        let _reset = half.read_to_end(&mut rest);
        assert!(rest.is_empty());
    }
    let mut reader = live(address);
    board.post(Part::Scene, Message::text("still here"));
    assert_eq!(reader.read().unwrap(), Message::text("still here"));
}

#[test]
fn twenty_read_one_of_them_never_and_frames_go_on() {
    let (address, board) = served(false, None);
    let mut readers: Vec<_> = (0..20).map(|_| live(address)).collect();
    let wait_for = |readers: usize| {
        let begin = Instant::now();
        while board.readers() != readers {
            assert!(begin.elapsed() < WATCHDOG, "{} read", board.readers());
            std::thread::sleep(Duration::from_millis(10));
        }
    };
    wait_for(20);
    // The first one never reads. What it is sent fills the buffers of its connection soon.
    let stuck = readers.remove(0);
    rustix::net::sockopt::set_socket_recv_buffer_size(stuck.get_ref(), 4096).unwrap();
    let frame = "x".repeat(1 << 18);
    let mut slowest_post = Duration::ZERO;
    for number in 0..60 {
        let begin = Instant::now();
        board.post(Part::Scene, Message::text(format!("{number} {frame}")));
        slowest_post = slowest_post.max(begin.elapsed());
        for reader in &mut readers {
            let read = reader.read().unwrap().into_text().unwrap();
            assert!(read.starts_with(&format!("{number} ")), "{}", &read[..8]);
        }
    }
    // It is closed, and the others stay.
    let begin = Instant::now();
    while board.readers() > 19 {
        assert!(begin.elapsed() < WATCHDOG, "the stuck one is still there");
        board.post(Part::Scene, Message::text(frame.clone()));
        readers.iter_mut().for_each(|reader| drop(reader.read().unwrap()));
        std::thread::sleep(Duration::from_millis(50));
    }
    assert_eq!(board.readers(), 19);
    println!("slowest post: {slowest_post:?}");
    drop(stuck);
    let more: Vec<_> = (19..READERS_MAX).map(|_| live(address)).collect();
    assert_eq!(
        status(address, "GET /live", &address.to_string(), &UPGRADE),
        503,
        "one too many"
    );
    drop((more, readers));
    wait_for(0);
}

#[test]
fn the_report_is_made_when_it_is_asked_for() {
    let (address, board) = served(false, None);
    let service = std::thread::spawn({
        let board = Arc::clone(&board);
        move || {
            let begin = Instant::now();
            while !board.report_is_asked() {
                assert!(begin.elapsed() < WATCHDOG);
                std::thread::sleep(Duration::from_millis(5));
            }
            board.post_report(Ok("{\"instance\":\"default\"}".to_owned()));
        }
    });
    let request = format!("GET /status.json HTTP/1.1\r\nHost: {address}\r\n\r\n");
    assert!(exchange(address, request.as_bytes()).ends_with("{\"instance\":\"default\"}"));
    service.join().unwrap();
    assert!(!board.report_is_asked());
    // Nobody answers any more.
    assert!(exchange(address, request.as_bytes()).starts_with("HTTP/1.1 503 "));
}
