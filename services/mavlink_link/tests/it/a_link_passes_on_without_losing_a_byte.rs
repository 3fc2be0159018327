//! Two processes share one link; whenever it passes from one to the other, every message of the autopilot is handled by
//! exactly one of them, and every message to the autopilot arrives once and in order.

use crate::common::{WATCHDOG, frame, free_udp_port, own_path};
use jink_mavlink_link::link::{Link, Progress, Sent};
use jink_mavlink_link::message::{Content, Received};
use jink_shared_types::Timestamp;
use jink_testkit::pseudo_terminal::pseudo_terminal;
use mavlink::dialect::MavMessage;
use proptest::prelude::*;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::fd::OwnedFd;
use std::time::{Duration, Instant};

fn number(received: &Received) -> u32 {
    match &received.content {
        Content::Message(MavMessage::ATTITUDE_QUATERNION(data)) => data.time_boot_ms,
        other => panic!("{other:?}"),
    }
}

/// The autopilot's end of a link.
enum AutopilotEnd {
    Udp(UdpSocket, u16),
    Serial(OwnedFd),
    Tcp(TcpStream),
}

impl AutopilotEnd {
    /// An end of each kind, and the link to it.
    fn open(kind: usize) -> (Self, Link) {
        match kind {
            0 => {
                let port = free_udp_port();
                let link = Link::open(format!("udpin:127.0.0.1:{port}").parse().unwrap()).unwrap();
                let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
                socket.set_nonblocking(true).unwrap();
                (Self::Udp(socket, port), link)
            }
            1 => {
                let (control, path) = pseudo_terminal();
                rustix::io::ioctl_fionbio(&control, true).unwrap();
                let link = Link::open(format!("serial:{path}:921600").parse().unwrap()).unwrap();
                (Self::Serial(control), link)
            }
            _ => {
                let listener = TcpListener::bind("127.0.0.1:0").unwrap();
                let port = listener.local_addr().unwrap().port();
                let link = Link::open(format!("tcpout:127.0.0.1:{port}").parse().unwrap()).unwrap();
                let (stream, _) = listener.accept().unwrap();
                stream.set_nonblocking(true).unwrap();
                (Self::Tcp(stream), link)
            }
        }
    }

    /// Whether bytes may be cut anywhere.
    fn is_stream(&self) -> bool {
        !matches!(self, Self::Udp(..))
    }

    fn write(&mut self, bytes: &[u8]) {
        match self {
            Self::Udp(socket, port) => {
                socket.send_to(bytes, ("127.0.0.1", *port)).unwrap();
            }
            Self::Serial(fd) => assert_eq!(rustix::io::write(&*fd, bytes).unwrap(), bytes.len()),
            Self::Tcp(stream) => stream.write_all(bytes).unwrap(),
        }
    }

    fn read(&mut self, into: &mut Vec<u8>) {
        let mut bytes = [0; 4096];
        loop {
            let length = match self {
                Self::Udp(socket, _) => socket.recv(&mut bytes).ok(),
                Self::Serial(fd) => rustix::io::read(&*fd, &mut bytes).ok(),
                Self::Tcp(stream) => stream.read(&mut bytes).ok(),
            };
            match length {
                Some(length) if length > 0 => into.extend_from_slice(&bytes[..length]),
                _ => return,
            }
        }
    }
}

/// One process with its end of the shared link.
struct LinkProcess {
    link: Link,
    messages: Vec<Received>,
    /// Received while holding the link, and in all.
    handled: Vec<u32>,
    received: Vec<u32>,
}

impl LinkProcess {
    fn new(link: Link) -> Self {
        Self {
            link,
            messages: Vec::with_capacity(8),
            handled: Vec::new(),
            received: Vec::new(),
        }
    }

    fn poll(&mut self) {
        loop {
            let is_owner = self.link.is_owner();
            self.messages.clear();
            let progress = self.link.receive(clock, &mut self.messages).unwrap();
            self.received.extend(self.messages.iter().map(number));
            if is_owner {
                self.handled.extend(self.messages.iter().map(number));
            }
            let _ = self.link.take_handover_state();
            if progress == Progress::Drained {
                return;
            }
        }
    }
}

fn clock() -> Timestamp {
    jink_runtime::now()
}

/// What happens next.
#[derive(Clone, Copy, Debug)]
enum LinkEvent {
    /// The autopilot sends a message; of a stream only this many bytes of it are written now.
    Arrives(usize),
    /// One of the two processes looks.
    Looks(bool),
    /// The owner sends a message.
    Sends,
    /// The link passes on.
    Passes,
}

fn event() -> impl Strategy<Value = LinkEvent> {
    prop_oneof![
        4 => (0..60usize).prop_map(LinkEvent::Arrives),
        3 => any::<bool>().prop_map(LinkEvent::Looks),
        2 => Just(LinkEvent::Sends),
        1 => Just(LinkEvent::Passes),
    ]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn whenever_it_passes_on_each_message_is_handled_once(
        kind in 0..3usize,
        events in proptest::collection::vec(event(), 1..80),
    ) {
        let handover_socket = own_path("handover");
        let (mut autopilot, mut link) = AutopilotEnd::open(kind);
        link.share(&handover_socket).unwrap();
        let standby = Link::join("udpin:1".parse().unwrap(), &handover_socket).unwrap();
        let mut processes = [LinkProcess::new(link), LinkProcess::new(standby)];
        // The autopilot is known before anything else happens: it has sent a frame.
        autopilot.write(&frame(1, 0));
        let started = Instant::now();
        while processes[0].received.is_empty() {
            processes[0].poll();
            prop_assert!(started.elapsed() < WATCHDOG);
        }
        let (mut sent, mut answered, mut received) = (1u32, 0u32, Vec::new());
        let mut waiting = Vec::new();
        for event in events {
            let owner = usize::from(!processes[0].link.is_owner());
            match event {
                LinkEvent::Arrives(cut) => {
                    waiting.extend(frame(1, sent));
                    sent += 1;
                    let now = if autopilot.is_stream() { waiting.len().min(cut) } else { waiting.len() };
                    autopilot.write(&waiting.drain(..now).collect::<Vec<_>>());
                }
                LinkEvent::Looks(which) => processes[usize::from(which)].poll(),
                LinkEvent::Sends => {
                    let bytes = frame(196, answered);
                    prop_assert_eq!(processes[owner].link.send(clock(), &bytes).unwrap(), Sent::Yes);
                    let mute = processes[1 - owner].link.send(clock(), &bytes).unwrap();
                    prop_assert_eq!(mute, Sent::NoPeer);
                    answered += 1;
                }
                LinkEvent::Passes => {
                    // The owner lets a standby in when it looks.
                    processes[owner].poll();
                    prop_assert!(processes[owner].link.release(&[7]));
                    processes[1 - owner].poll();
                    prop_assert!(processes[1 - owner].link.is_owner() && !processes[owner].link.is_owner());
                }
            }
            autopilot.read(&mut received);
        }
        if !waiting.is_empty() {
            autopilot.write(&waiting);
        }
        let all = (0..sent).collect::<Vec<_>>();
        let answers = (0..answered).flat_map(|n| frame(196, n)).collect::<Vec<_>>();
        while processes.iter().any(|one| one.received.len() < all.len()) || received.len() < answers.len() {
            processes.iter_mut().for_each(LinkProcess::poll);
            autopilot.read(&mut received);
            prop_assert!(started.elapsed() < WATCHDOG, "{:?} of {}", processes.each_ref().map(|one| &one.received), sent);
        }
        for process in &processes {
            prop_assert_eq!(&process.received, &all);
        }
        let mut handled = processes.iter().flat_map(|one| one.handled.clone()).collect::<Vec<_>>();
        handled.sort_unstable();
        prop_assert_eq!(handled, all);
        prop_assert_eq!(received, answers);
    }
}

#[test]
fn a_standby_takes_over_when_the_owner_dies_and_the_next_one_can_join_it() {
    let handover_socket = own_path("handover");
    let (mut autopilot, mut link) = AutopilotEnd::open(0);
    link.share(&handover_socket).unwrap();
    let mut standby = LinkProcess::new(Link::join("udpin:1".parse().unwrap(), &handover_socket).unwrap());
    autopilot.write(&frame(1, 0));
    let mut owner = LinkProcess::new(link);
    until("both receive", || {
        owner.poll();
        standby.poll();
        standby.received == [0]
    });
    drop(owner);
    autopilot.write(&frame(1, 1));
    until("the standby is alone", || {
        standby.poll();
        standby.link.has_lost_owner()
    });
    assert_eq!(standby.received, [0]);
    standby.link.take_over();
    until("what came meanwhile", || {
        standby.poll();
        standby.handled == [1]
    });
    assert_eq!(standby.link.send(clock(), &frame(196, 5)).unwrap(), Sent::Yes);
    let mut answer = Vec::new();
    until("the answer", || {
        autopilot.read(&mut answer);
        !answer.is_empty()
    });
    assert_eq!(answer, frame(196, 5));
    let mut next = LinkProcess::new(Link::join("udpin:1".parse().unwrap(), &handover_socket).unwrap());
    autopilot.write(&frame(1, 2));
    until("the next one receives", || {
        standby.poll();
        next.poll();
        next.received == [2]
    });
}

#[test]
fn nobody_can_join_where_no_link_is_shared() {
    let error = Link::join("udpin:1".parse().unwrap(), &own_path("handover")).unwrap_err();
    assert!(error.to_string().contains("no handover of the link"), "{error}");
}

fn until(what: &str, mut done: impl FnMut() -> bool) {
    let started = Instant::now();
    while !done() {
        assert!(started.elapsed() < WATCHDOG, "{what} never happened");
        std::thread::sleep(Duration::from_millis(1));
    }
}
