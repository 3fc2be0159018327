//! A pseudo-terminal in the port's place: read, unplugged, plugged in again under the same name.

use crate::encoder::device::Device;
use crate::encoder::{benewake, spec};
use jink_rangefinder_driver::RangefinderDriver;
use jink_runtime::serial::{Port, Read};
use jink_shared_types::Timestamp;
use jink_testkit::pseudo_terminal::plug_in;
use jink_testkit::temp_folder::TempFolder;
use rand::{RngExt, SeedableRng};
use rand_xoshiro::SplitMix64;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::fs::{Mode, OFlags};
use rustix::termios::OptionalActions;
use std::path::Path;

/// The device's end of a line.
struct PseudoTerminal {
    control: OwnedFd,
}

impl PseudoTerminal {
    /// A new line, reachable under `link`.
    fn plug_in(link: &Path) -> Self {
        Self {
            control: plug_in(link),
        }
    }

    /// The next `count` bytes that the driver has written.
    fn read_written(&self, count: usize) -> Vec<u8> {
        let mut all = Vec::new();
        while all.len() < count {
            wait_for(self.control.as_fd());
            let mut bytes = [0; 64];
            let most = (count - all.len()).min(64);
            let read = rustix::io::read(&self.control, &mut bytes[..most]).unwrap();
            all.extend(&bytes[..read]);
        }
        all
    }

    fn send(&self, bytes: &[u8]) {
        let mut rest = bytes;
        while !rest.is_empty() {
            let count = rustix::io::write(&self.control, rest).unwrap();
            rest = &rest[count..];
        }
    }
}

/// The clock of a test: as fast as the test asks for it.
struct TestClock(u64);

impl TestClock {
    fn step(&mut self) -> Timestamp {
        self.step_ms(10)
    }

    fn step_ms(&mut self, ms: u64) -> Timestamp {
        self.0 += ms * 1_000_000;
        Timestamp::from_ns(self.0)
    }
}

/// Waits until there is something to be read: what is written to a terminal is there a little later.
fn wait_for(fd: BorrowedFd<'_>) {
    let patience = Timespec {
        tv_sec: 60,
        tv_nsec: 0,
    };
    let mut fds = [PollFd::from_borrowed_fd(fd, PollFlags::IN)];
    let ready = poll(&mut fds, Some(&patience)).unwrap();
    assert_eq!(ready, 1, "nothing came");
}

/// Reads `count` bytes.
fn read(port: &mut Port, now: Timestamp, count: usize) -> Vec<u8> {
    let mut all = Vec::new();
    while all.len() < count {
        wait_for(port.watched().unwrap());
        let mut bytes = [0; 64];
        let most = (count - all.len()).min(64);
        match port.read(now, &mut bytes[..most]) {
            Read::Bytes(count) => all.extend(&bytes[..count]),
            Read::Nothing => {}
            Read::Lost => panic!("lost"),
        }
    }
    all
}

/// Reads until the port is lost.
fn until_lost(port: &mut Port, now: Timestamp) {
    let mut bytes = [0; 64];
    while port.is_open() {
        wait_for(port.watched().unwrap());
        port.read(now, &mut bytes);
    }
}

#[test]
fn unplugged_and_plugged_in_again_it_is_read_on() {
    let folder = TempFolder::new("range_replug");
    let link = folder.join("port");
    let mut clock = TestClock(1_000_000_000);
    let mut port = Port::new(link.to_str().unwrap(), 115_200);
    assert!(!port.open_if_due(clock.step()), "nothing is plugged in yet");
    for round in 0..3u8 {
        let line = PseudoTerminal::plug_in(&link);
        let mut tries = 0;
        while !port.open_if_due(clock.step()) {
            tries += 1;
            assert!(tries < 300, "round {round}: longer than the longest pause");
        }
        line.send(&[round; 100]);
        assert_eq!(read(&mut port, clock.step(), 100), [round; 100]);
        drop(line);
        until_lost(&mut port, clock.step());
        assert!(port.watched().is_none());
        assert!(
            port.due() < Timestamp::from_ns(u64::MAX),
            "it will be tried again"
        );
    }
}

#[test]
fn a_scanning_device_is_set_up_again_each_time_it_is_plugged_in() {
    let folder = TempFolder::new("range_scanner");
    let link = folder.join("port");
    let mut clock = TestClock(1_000_000_000);
    let mut driver = RangefinderDriver::new(spec(
        "sf45b",
        link.to_str().unwrap(),
        "scan_low_deg = -90\nscan_high_deg = 90\n",
    ));
    let mut port = Port::new(&driver.spec().device.clone(), driver.spec().baud);
    for round in 0..3 {
        let line = PseudoTerminal::plug_in(&link);
        let mut device = Device::default();
        let (mut parts, mut said) = (0, 0);
        for _ in 0..2_000 {
            let now = clock.step_ms(1);
            if port.open_if_due(now) {
                driver.connected(now);
            }
            let bytes = read(&mut port, now, said);
            driver.bytes(now, &bytes, &mut |_| parts += 1);
            while let Some(bytes) = driver.next_write(now).filter(|_| port.is_open()) {
                port.write(now, bytes);
                device.take(&line.read_written(bytes.len()));
            }
            let answer = device.step();
            line.send(&answer);
            said = answer.len();
        }
        assert_eq!(device.commands, [30, 27, 66, 85, 98, 99, 96, 30], "round {round}");
        assert!(parts > 20, "round {round}: {parts}");
        drop(line);
        until_lost(&mut port, clock.step());
    }
}

#[test]
fn the_pauses_grow_to_two_seconds_and_not_further() {
    let folder = TempFolder::new("range_pauses");
    let link = folder.join("port");
    let mut port = Port::new(link.to_str().unwrap(), 115_200);
    let mut now = Timestamp::from_seconds(1.0);
    let mut pauses = Vec::new();
    for _ in 0..8 {
        assert!(!port.open_if_due(now));
        pauses.push((port.due().seconds_since(now) * 10.0).round());
        now = port.due();
    }
    assert_eq!(pauses, [1.0, 2.0, 4.0, 8.0, 16.0, 20.0, 20.0, 20.0]);
}

#[test]
fn what_waited_in_the_port_before_it_was_opened_is_old_and_dropped() {
    let folder = TempFolder::new("range_old");
    let link = folder.join("port");
    let line = PseudoTerminal::plug_in(&link);
    line.send(b"old");
    // Somebody else sees that it has come.
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let witness = rustix::fs::open(&link, flags, Mode::empty()).unwrap();
    let mut settings = rustix::termios::tcgetattr(&witness).unwrap();
    settings.make_raw();
    rustix::termios::tcsetattr(&witness, OptionalActions::Now, &settings).unwrap();
    wait_for(witness.as_fd());
    let mut clock = TestClock(1_000_000_000);
    let mut port = Port::new(link.to_str().unwrap(), 115_200);
    assert!(port.open_if_due(clock.step()));
    line.send(b"new");
    assert_eq!(read(&mut port, clock.step(), 3), b"new");
}

#[test]
fn a_file_that_is_no_serial_port_is_refused_and_tried_again() {
    let mut port = Port::new("/dev/null", 115_200);
    assert!(!port.open_if_due(Timestamp::from_seconds(1.0)));
    assert!(!port.is_open());
}

#[test]
fn frames_damaged_cut_and_mixed_up_on_a_line_come_out_as_what_was_sent_or_not_at_all() {
    let folder = TempFolder::new("range_frames");
    let link = folder.join("port");
    let line = PseudoTerminal::plug_in(&link);
    let mut clock = TestClock(1_000_000_000);
    let mut driver = RangefinderDriver::new(spec("tf_luna", link.to_str().unwrap(), ""));
    let mut port = Port::new(&driver.spec().device.clone(), driver.spec().baud);
    assert!(port.open_if_due(clock.step()));
    driver.connected(clock.step());
    let mut random = SplitMix64::seed_from_u64(3);
    let (mut scans, mut unknown) = (0, 0);
    for index in 0..2_000 {
        let mut frame = benewake(300, 500, 20.0);
        match random.random_range(0..10) {
            0 => frame[random.random_range(0..9)] ^= random.random_range(1..=255),
            1 => frame.truncate(random.random_range(0..9)),
            2 => {
                // The beginning of another program's frame between the bytes of this one.
                let at = random.random_range(0..9);
                frame.splice(at..at, [0x59, 0x59, random.random()]);
            }
            _ => {}
        }
        line.send(&frame);
        let now = clock.step();
        let bytes = read(&mut port, now, frame.len());
        driver.bytes(now, &bytes, &mut |view| {
            scans += 1;
            if view.range_m[0].is_nan() {
                unknown += 1;
            } else {
                assert_eq!(view.range_m[0], 3.0, "frame {index}");
            }
        });
    }
    let counters = driver.counters(clock.step());
    println!("{scans} scans, {unknown} unknown, {counters:?}");
    assert!(scans > 350 && unknown * 50 < scans);
    assert!(counters.good > 1_400 && counters.damaged > 100);
}
