//! Links: no input closes them, lost links reopen by themselves, and every error names the remedy.

use crate::common::{WATCHDOG, frame, free_udp_port};
use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::link::{Endpoint, Link, LinkError, Progress, Sent};
use jink_mavlink_link::message::{Body, Content, Received};
use jink_runtime::serial::SerialError;
use jink_shared_types::Timestamp;
use jink_testkit::pseudo_terminal::{plug_in, pseudo_terminal};
use jink_testkit::temp_folder::TempFolder;
use mavlink::dialect::{HEARTBEAT_DATA, MavMessage};
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::time::{Duration, Instant};

fn number(received: &Received) -> Option<u32> {
    match &received.content {
        Content::Message(MavMessage::ATTITUDE_QUATERNION(data)) => Some(data.time_boot_ms),
        _ => None,
    }
}

/// A link with a clock that runs as fast as the test asks.
struct LinkBench {
    link: Link,
    now: Timestamp,
    messages: Vec<Received>,
    errors: Vec<LinkError>,
}

impl LinkBench {
    fn open(endpoint: &str) -> Self {
        Self {
            link: Link::open(endpoint.parse().unwrap()).unwrap(),
            now: Timestamp::from_seconds(1.0),
            messages: Vec::with_capacity(64),
            errors: Vec::new(),
        }
    }

    /// Receives once; the clock advances by 20 ms.
    fn poll(&mut self) -> Vec<u32> {
        self.now = self.now.plus_seconds(0.02);
        let mut numbers = Vec::new();
        loop {
            self.messages.clear();
            let progress = self.link.receive(|| self.now, &mut self.messages);
            numbers.extend(self.messages.iter().filter_map(number));
            match progress {
                Ok(Progress::More) => {}
                Ok(Progress::Drained) => return numbers,
                Err(error) => {
                    self.errors.push(error);
                    return numbers;
                }
            }
        }
    }

    fn until(&mut self, what: &str, mut done: impl FnMut(&mut Self, &[u32]) -> bool) {
        let started = Instant::now();
        loop {
            let numbers = self.poll();
            if done(self, &numbers) {
                return;
            }
            assert!(started.elapsed() < WATCHDOG, "{what} never happened");
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

#[test]
fn a_listening_udp_link_answers_the_last_sender_that_spoke_as_an_autopilot() {
    let port = free_udp_port();
    let mut bench = LinkBench::open(&format!("udpin:127.0.0.1:{port}"));
    assert_eq!(bench.link.send(bench.now, &frame(196, 1)).unwrap(), Sent::NoPeer);
    let autopilot = UdpSocket::bind("127.0.0.1:0").unwrap();
    let station = UdpSocket::bind("127.0.0.1:0").unwrap();
    autopilot.send_to(&frame(1, 10), ("127.0.0.1", port)).unwrap();
    bench.until("the autopilot's message", |_, numbers| numbers == [10]);
    station.send_to(&frame(190, 11), ("127.0.0.1", port)).unwrap();
    bench.until("the station's message", |_, numbers| numbers == [11]);
    assert_eq!(bench.link.send(bench.now, &frame(196, 12)).unwrap(), Sent::Yes);
    autopilot.set_read_timeout(Some(WATCHDOG)).unwrap();
    let mut answer = [0; 300];
    let len = autopilot.recv(&mut answer).unwrap();
    assert_eq!(answer[..len], frame(196, 12));
}

#[test]
fn malformed_datagrams_never_close_a_link() {
    let port = free_udp_port();
    let mut bench = LinkBench::open(&format!("udpin:{port}"));
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let whole = frame(1, 5);
    for datagram in [
        &b""[..],
        b"hello",
        &[0xfd; 1000],
        &whole[..whole.len() - 1],
        &[0xfe, 0xff],
    ] {
        sender.send_to(datagram, ("127.0.0.1", port)).unwrap();
    }
    sender.send_to(&whole, ("127.0.0.1", port)).unwrap();
    bench.until("the sound message", |_, numbers| numbers == [5]);
    assert!(bench.errors.is_empty());
    let garbage = 5 + 1000 + whole.len() as u64 - 1 + 2;
    assert_eq!(bench.link.counters().garbage_bytes, garbage);
}

#[test]
fn a_peer_that_is_not_up_yet_is_not_fatal() {
    let port = free_udp_port();
    let mut bench = LinkBench::open(&format!("udpout:127.0.0.1:{port}"));
    for n in 0..20 {
        bench.link.send(bench.now, &frame(196, n)).unwrap();
        assert!(bench.poll().is_empty());
    }
    assert!(bench.errors.is_empty());
    // This one is refused, too; the refusal is only reported on the next.
    bench.link.send(bench.now, &frame(196, 76)).unwrap();
    let peer = UdpSocket::bind(("127.0.0.1", port)).unwrap();
    peer.set_read_timeout(Some(WATCHDOG)).unwrap();
    assert_eq!(bench.link.send(bench.now, &frame(196, 77)).unwrap(), Sent::Yes);
    let mut bytes = [0; 300];
    let (len, from) = peer.recv_from(&mut bytes).unwrap();
    assert_eq!(bytes[..len], frame(196, 77));
    peer.send_to(&frame(1, 78), from).unwrap();
    bench.until("the answer", |_, numbers| numbers == [78]);
}

#[test]
fn a_taken_port_is_named_with_a_hint() {
    let owner = UdpSocket::bind("127.0.0.1:0").unwrap();
    let port = owner.local_addr().unwrap().port();
    let error = Link::open(format!("udpin:{port}").parse().unwrap()).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, LinkError::AddressInUse { .. }));
    assert!(
        text.contains(&port.to_string()) && text.contains("another program"),
        "{text}"
    );
}

#[test]
fn a_missing_device_is_named() {
    let endpoint: Endpoint = "serial:/dev/tty-not-here:57600".parse().unwrap();
    let error = Link::open(endpoint).unwrap_err();
    assert!(matches!(error, LinkError::Serial(SerialError::NoDevice { .. })));
    assert!(error.to_string().contains("/dev/tty-not-here"));
    let error = Link::open("serial:/dev/null:57600".parse().unwrap()).unwrap_err();
    assert!(
        matches!(error, LinkError::Serial(SerialError::NotSerial { .. })),
        "{error}"
    );
    let error = Link::open("udpout:no-such-host.invalid:14580".parse().unwrap()).unwrap_err();
    assert!(matches!(error, LinkError::Resolve { .. }), "{error}");
}

#[test]
fn a_tcp_server_that_comes_late_and_restarts_is_found_again() {
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let mut bench = LinkBench::open(&format!("tcpout:127.0.0.1:{port}"));
    bench.until("a refused connection", |bench, _| !bench.errors.is_empty());
    for round in 0..2u32 {
        let server = TcpListener::bind(("127.0.0.1", port)).unwrap();
        server.set_nonblocking(true).unwrap();
        let mut stream = None;
        bench.until("a connection", |_, _| {
            stream = server.accept().ok().map(|(stream, _)| stream);
            stream.is_some()
        });
        let mut stream: TcpStream = stream.unwrap();
        let bytes = frame(1, round);
        stream.write_all(&bytes[..7]).unwrap();
        bench.poll();
        stream.write_all(&bytes[7..]).unwrap();
        bench.until("the message in two pieces", |_, numbers| numbers == [round]);
        assert_eq!(bench.link.send(bench.now, &frame(196, 9)).unwrap(), Sent::Yes);
        stream.set_nonblocking(false).unwrap();
        stream.set_read_timeout(Some(WATCHDOG)).unwrap();
        let mut answer = vec![0; frame(196, 9).len()];
        stream.read_exact(&mut answer).unwrap();
        assert_eq!(answer, frame(196, 9));
        drop((stream, server));
        bench.until("the loss", |bench, _| bench.link.fd().is_none());
    }
    assert!(bench.link.counters().reopened >= 2);
}

#[test]
fn a_tcp_listener_serves_one_client_after_the_other() {
    let port = TcpListener::bind("127.0.0.1:0")
        .unwrap()
        .local_addr()
        .unwrap()
        .port();
    let mut bench = LinkBench::open(&format!("tcpin:{port}"));
    for n in 0..3 {
        let mut client = TcpStream::connect(("127.0.0.1", port)).unwrap();
        client.write_all(&frame(1, n)).unwrap();
        bench.until("the client's message", |_, numbers| numbers == [n]);
        assert_eq!(bench.link.send(bench.now, &frame(196, n)).unwrap(), Sent::Yes);
        client.set_read_timeout(Some(WATCHDOG)).unwrap();
        let mut answer = vec![0; frame(196, n).len()];
        client.read_exact(&mut answer).unwrap();
        assert_eq!(answer, frame(196, n));
    }
    assert!(bench.errors.is_empty());
}

#[test]
fn every_byte_passes_a_serial_port_unchanged() {
    let (control, path) = pseudo_terminal();
    let mut bench = LinkBench::open(&format!("serial:{path}:921600"));
    assert!(bench.poll().is_empty(), "an idle port is not a lost one");
    // 0x0a0d1104: line ends, XON and end-of-file, which a port in text mode would eat.
    let numbers = [0x0a0d_1104, 0x1113_1a03, 0x7f00_ff0d];
    for n in numbers {
        rustix::io::write(&control, &frame(1, n)).unwrap();
        bench.until("the message", |_, got| got == [n]);
        assert_eq!(bench.link.send(bench.now, &frame(196, n)).unwrap(), Sent::Yes);
        let mut answer = vec![0; 300];
        let len = rustix::io::read(&control, &mut answer).unwrap();
        assert_eq!(answer[..len], frame(196, n));
    }
}

#[test]
fn a_serial_port_that_is_unplugged_and_plugged_in_again_goes_on() {
    let folder = TempFolder::new("serial");
    let device = folder.join("autopilot");
    let control = plug_in(&device);
    let mut bench = LinkBench::open(&format!("serial:{}:57600", device.display()));
    rustix::io::write(&control, &frame(1, 1)).unwrap();
    bench.until("the first message", |_, numbers| numbers == [1]);
    drop(control);
    std::fs::remove_file(&device).unwrap();
    bench.until("the loss", |bench, _| bench.link.fd().is_none());
    assert!(matches!(bench.errors[0], LinkError::Lost { .. }));
    assert_eq!(bench.link.send(bench.now, &frame(196, 1)).unwrap(), Sent::NoPeer);
    assert!(bench.link.next_wake().is_some());
    bench.until("an attempt", |bench, _| bench.errors.len() > 1);
    assert!(matches!(
        bench.errors[1],
        LinkError::Serial(SerialError::NoDevice { .. })
    ));
    let control = plug_in(&device);
    bench.until("the port again", |bench, _| bench.link.fd().is_some());
    rustix::io::write(&control, &frame(1, 2)).unwrap();
    bench.until("a message after it", |_, numbers| numbers == [2]);
}

#[test]
fn a_heartbeat_with_an_unknown_value_is_counted_not_fatal() {
    let port = free_udp_port();
    let mut bench = LinkBench::open(&format!("udpin:{port}"));
    let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
    let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA::default());
    let mut bytes = Encoder::new().encode(1, 1, &Body::Message(heartbeat)).to_vec();
    bytes[10 + 4] = 250;
    let end = bytes.len() - 2;
    let crc = mavlink::calculate_crc(&bytes[1..end], 50);
    bytes[end..].copy_from_slice(&crc.to_le_bytes());
    sender.send_to(&bytes, ("127.0.0.1", port)).unwrap();
    bench.until("the count", |bench, _| bench.link.counters().undecodable == 1);
    assert!(bench.errors.is_empty());
}

#[test]
fn a_socket_of_this_machine_carries_both_ways_and_is_found_again() {
    let folder = TempFolder::new("link_unix");
    let path = folder.join("autopilot");
    let endpoint = format!("unix:{}", path.display());
    let refused = Link::open(endpoint.parse().unwrap()).unwrap_err();
    assert!(matches!(refused, LinkError::Open { .. }), "{refused}");

    let autopilot = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    let mut bench = LinkBench::open(&endpoint);
    let ours = folder.join("autopilot.jink");
    for n in 0..3 {
        autopilot.send_to(&frame(1, n), &ours).unwrap();
    }
    assert_eq!(bench.poll(), [0, 1, 2]);
    let answer = frame(196, 7);
    assert_eq!(bench.link.send(bench.now, &answer).unwrap(), Sent::Yes);
    let mut bytes = [0; 512];
    let (length, _) = autopilot.recv_from(&mut bytes).unwrap();
    assert_eq!(&bytes[..length], answer);

    // The autopilot is started again: another socket at the same place.
    drop(autopilot);
    assert!(bench.link.send(bench.now, &answer).is_err());
    std::fs::remove_file(&path).unwrap();
    let autopilot = std::os::unix::net::UnixDatagram::bind(&path).unwrap();
    bench.until("the autopilot is found again", |bench, _| {
        matches!(bench.link.send(bench.now, &answer), Ok(Sent::Yes))
    });
    autopilot.send_to(&frame(1, 9), &ours).unwrap();
    assert_eq!(bench.poll(), [9]);
}
