//! A device file of FUSE in the camera's place: streamed from, unplugged, plugged in again, and with every fault that a
//! camera has.

use crate::images::small;
use jink_depth_driver::camera::Camera;
use jink_depth_driver::v4l2::Wanted;
use jink_depth_driver::{DepthCameraCounters, DepthCameraDriver};
use jink_runtime::device::DeviceChange;
use jink_shared_types::Timestamp;
use jink_shared_types::ranges::PointCloud;
use jink_testkit::video_device::{Errno, Fault, State, VideoDevice};
use rustix::event::{PollFd, PollFlags, Timespec, poll};

const SIZE_PX: [u32; 2] = [40, 30];

/// CLOCK_MONOTONIC, by which the device dates its images.
fn now() -> Timestamp {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    Timestamp::from_ns(now.tv_sec as u64 * 1_000_000_000 + now.tv_nsec as u64)
}

/// A driver and its camera at a device.
struct Rig {
    // Dropped before the device: a file that is open keeps its mount busy.
    camera: Camera,
    device: VideoDevice,
    driver: DepthCameraDriver,
    cloud: Box<PointCloud>,
    clouds: u32,
    captures: Vec<Timestamp>,
}

impl Rig {
    /// `None` where there is no FUSE.
    fn new(role: &str) -> Option<Self> {
        let device = VideoDevice::plug_in(role, SIZE_PX)?;
        let spec = small("range_max_m = 5\n");
        let wanted = Wanted {
            size_px: spec.size_px,
            rate_hz: spec.rate_hz,
        };
        Some(Self {
            camera: Camera::new(&device.path(), wanted),
            driver: DepthCameraDriver::new(spec),
            device,
            cloud: PointCloud::boxed(),
            clouds: 0,
            captures: Vec::new(),
        })
    }

    /// Opens the camera, however long the pauses have become.
    fn open(&mut self) {
        for _ in 0..3 {
            self.device.wait_until_released();
            let due = self.camera.due().max(now());
            if self.camera.open_if_due(due) {
                self.driver.connected();
                return;
            }
        }
        panic!("{:?}", self.camera.error());
    }

    /// Why it does not open.
    fn refusal(&mut self) -> String {
        self.device.wait_until_released();
        assert!(!self.camera.open_if_due(now()));
        let error = self.camera.error().unwrap().to_string();
        error.replace(&self.device.path(), "PATH")
    }

    /// Waits until the descriptor is readable, and reads.
    fn read(&mut self) {
        let patience = Timespec {
            tv_sec: 60,
            tv_nsec: 0,
        };
        let mut fds = [PollFd::from_borrowed_fd(
            self.camera.watched().unwrap(),
            PollFlags::IN,
        )];
        assert_eq!(poll(&mut fds, Some(&patience)).unwrap(), 1, "nothing came");
        self.read_at(now());
    }

    fn read_at(&mut self, time: Timestamp) {
        let Self {
            camera,
            driver,
            cloud,
            clouds,
            captures,
            ..
        } = self;
        camera.read(time, now, |image| {
            driver.image(image, &mut |view| {
                view.write(cloud);
                *clouds += 1;
                captures.push(view.capture);
            });
        });
    }

    fn captured(&mut self, depth: u16, fault: Fault) {
        assert!(
            self.device.capture_with(&wall(depth), fault),
            "no buffer was free"
        );
        self.read();
    }

    fn counters(&mut self) -> DepthCameraCounters {
        self.driver.counters(now())
    }

    /// Distance of the wall that was published last (mm).
    fn seen_mm(&self) -> u32 {
        (1e3 * self.cloud.points()[0].forward_m).round() as u32
    }
}

fn wall(depth: u16) -> Vec<u16> {
    vec![depth; 1_200]
}

#[test]
fn every_image_becomes_a_cloud_dated_to_its_capture() {
    let Some(mut rig) = Rig::new("stream") else { return };
    rig.open();
    // Three times around all buffers.
    for index in 0..12u16 {
        let before = now();
        rig.captured(1_000 + index, Fault::default());
        assert_eq!(rig.seen_mm(), 1_000 + u32::from(index));
        let capture = *rig.captures.last().unwrap();
        assert!(capture.plus_seconds(1e-6) >= before && capture <= now());
    }
    let counters = rig.counters();
    let seen = (counters.good, counters.missed, counters.undated, counters.short);
    assert_eq!((rig.clouds, seen), (12, (12, 0, 0, 0)));
}

#[test]
fn rows_with_padding_are_read_as_rows() {
    let Some(mut rig) = Rig::new("padding") else {
        return;
    };
    rig.device.with(|state| state.padding = 48);
    rig.open();
    rig.captured(2_000, Fault::default());
    assert!(rig.cloud.points().iter().all(|point| point.forward_m == 2.0));
}

#[test]
fn unplugged_and_plugged_in_again_it_streams_on() {
    let Some(mut rig) = Rig::new("replug") else { return };
    for round in 0..3 {
        rig.open();
        rig.captured(1_500 + round, Fault::default());
        assert_eq!(rig.seen_mm(), u32::from(1_500 + round));
        rig.device.unplug();
        rig.read();
        assert!(!rig.camera.is_open() && rig.camera.watched().is_none());
        assert!(
            rig.camera
                .error()
                .unwrap()
                .to_string()
                .contains("lost, opening it again")
        );
        let due = rig.camera.due();
        assert!(!rig.camera.open_if_due(due));
        assert!(rig.camera.error().unwrap().to_string().contains("no such device"));
        rig.device.replug();
    }
    let counters = rig.counters();
    assert_eq!(
        (counters.good, counters.missed),
        (3, 0),
        "a new stream counts anew"
    );
    assert_eq!(rig.device.with(|state| state.starts), 3);
}

#[test]
fn what_it_does_not_grant_is_one_sentence_and_tried_again() {
    let Some(mut rig) = Rig::new("refusals") else {
        return;
    };
    type Change = fn(&mut State);
    let refusals: [(Change, Change, &str); 8] = [
        (
            |state| state.fourcc = *b"YUYV",
            |state| state.fourcc = *b"Z16 ",
            "PATH: grants the format YUYV instead of Z16; a camera has several devices, `v4l2-ctl --list-formats` shows the one with \
             depth",
        ),
        (
            |state| state.size_px = [32, 24],
            |state| state.size_px = SIZE_PX,
            "PATH: grants 32 x 24 instead of 40 x 30; `v4l2-ctl --list-formats-ext` lists the sizes there are",
        ),
        (
            |state| state.captures = false,
            |state| state.captures = true,
            "PATH: no V4L2 device that captures; `v4l2-ctl --list-devices` names those there are",
        ),
        (
            |state| state.grants = 1,
            |state| state.grants = 4,
            "PATH: its 1 buffers of 2400 bytes do not hold images of 40 x 30",
        ),
        (
            |state| state.small_buffers = true,
            |state| state.small_buffers = false,
            "PATH: its 4 buffers of 100 bytes do not hold images of 40 x 30",
        ),
        (
            |state| state.refuses = vec![(18, Errno::EBUSY)],
            |state| state.refuses.clear(),
            "PATH: another program streams from it; `fuser PATH` names it",
        ),
        (
            |state| state.refuses = vec![(18, Errno::ENOSPC)],
            |state| state.refuses.clear(),
            "PATH: VIDIOC_STREAMON: No space left on device (os error 28)",
        ),
        (
            |state| state.plugged = false,
            |state| state.plugged = true,
            "PATH: no such device; is it plugged in, and is the name right?",
        ),
    ];
    for (wrong, right, said) in refusals {
        rig.device.with(wrong);
        assert_eq!(rig.refusal(), said);
        rig.device.with(right);
        rig.open();
        rig.captured(1_000, Fault::default());
        rig.camera.close();
    }
}

#[test]
fn a_second_program_is_refused_while_one_streams() {
    let Some(mut rig) = Rig::new("busy") else { return };
    rig.open();
    let wanted = Wanted {
        size_px: [40, 30],
        rate_hz: 15.0,
    };
    let mut second = Camera::new(&rig.device.path(), wanted);
    assert!(!second.open_if_due(now()));
    assert!(
        second
            .error()
            .unwrap()
            .to_string()
            .contains("another program streams from it")
    );
    rig.captured(1_000, Fault::default());
    rig.camera.close();
    assert!(
        second.open_if_due(now().plus_seconds(5.0)),
        "{:?}",
        second.error()
    );
}

#[test]
fn a_rate_that_it_does_not_have_and_no_say_in_it_are_taken_as_they_are() {
    let Some(mut rig) = Rig::new("rates") else { return };
    for rate_hz in [None, Some(6), Some(0)] {
        rig.device.with(|state| state.rate_hz = rate_hz);
        rig.open();
        rig.captured(1_000, Fault::default());
        rig.camera.close();
    }
}

#[test]
fn damaged_short_and_undated_images_are_counted_and_survived() {
    let Some(mut rig) = Rig::new("faults") else { return };
    rig.open();
    rig.captured(1_000, Fault::default());
    rig.captured(
        1_001,
        Fault {
            damaged: true,
            ..Fault::default()
        },
    );
    for bytes in [0, 1, 2_399] {
        rig.captured(
            1_002,
            Fault {
                bytes: Some(bytes),
                ..Fault::default()
            },
        );
    }
    assert_eq!(
        (rig.clouds, rig.seen_mm()),
        (1, 1_000),
        "none of them was published"
    );
    // More than there is memory for is read as what there is.
    rig.captured(
        1_003,
        Fault {
            bytes: Some(u32::MAX),
            ..Fault::default()
        },
    );
    assert_eq!(rig.seen_mm(), 1_003);
    let ahead_us = (now().ns / 1_000) as i64 + 60_000_000;
    let stamps = [
        Fault {
            undated: true,
            ..Fault::default()
        },
        Fault {
            stamp_us: Some(0),
            ..Fault::default()
        },
        Fault {
            stamp_us: Some(-5),
            ..Fault::default()
        },
        Fault {
            stamp_us: Some(i64::MAX),
            ..Fault::default()
        },
        Fault {
            stamp_us: Some(ahead_us),
            ..Fault::default()
        },
    ];
    for (index, fault) in stamps.into_iter().enumerate() {
        let before = now();
        rig.captured(1_010 + index as u16, fault);
        let capture = *rig.captures.last().unwrap();
        assert!(capture >= before && capture <= now(), "dated to its arrival");
    }
    rig.captured(
        1_100,
        Fault {
            missed: 3,
            ..Fault::default()
        },
    );
    let counters = rig.counters();
    assert_eq!(
        (
            counters.good,
            counters.damaged,
            counters.short,
            counters.undated,
            counters.missed
        ),
        (8, 1, 3, 5, 3)
    );
    assert!(rig.captures.windows(2).all(|pair| pair[0] < pair[1]));
}

#[test]
fn a_frozen_image_is_not_published_and_reported_once() {
    let Some(mut rig) = Rig::new("frozen") else { return };
    rig.open();
    assert_eq!(rig.driver.take_change(now()), None);
    rig.captured(1_000, Fault::default());
    for _ in 0..20 {
        rig.captured(1_000, Fault::default());
    }
    assert_eq!((rig.clouds, rig.counters().repeated), (1, 20));
    assert_eq!(rig.driver.take_change(now()), None);
    let later = now().plus_seconds(1.5);
    assert_eq!(rig.driver.take_change(later), Some(DeviceChange::Lost));
    assert_eq!(rig.driver.take_change(later.plus_seconds(9.0)), None);
    rig.captured(1_001, Fault::default());
    assert_eq!(rig.driver.take_change(now()), Some(DeviceChange::Back));
    assert_eq!(rig.clouds, 2);
}

#[test]
fn a_covered_lens_is_published_as_nothing_known_again_and_again() {
    let Some(mut rig) = Rig::new("dark") else { return };
    rig.open();
    for _ in 0..5 {
        rig.captured(0, Fault::default());
    }
    assert_eq!((rig.clouds, rig.counters().repeated), (5, 0));
}

#[test]
fn a_stream_that_stalls_is_started_again() {
    let Some(mut rig) = Rig::new("stalled") else {
        return;
    };
    rig.open();
    rig.captured(1_000, Fault::default());
    let due = rig.camera.due();
    rig.read_at(due.plus_seconds(-0.1));
    assert!(rig.camera.is_open());
    rig.read_at(due);
    assert!(!rig.camera.is_open());
    assert!(
        rig.camera
            .error()
            .unwrap()
            .to_string()
            .ends_with("no image for 3 s, starting the stream again")
    );
    rig.open();
    rig.captured(1_001, Fault::default());
    assert_eq!((rig.clouds, rig.device.with(|state| state.starts)), (2, 2));
}

#[test]
fn a_driver_that_names_a_buffer_it_never_granted_is_left() {
    let Some(mut rig) = Rig::new("index") else { return };
    rig.open();
    rig.captured(
        1_000,
        Fault {
            wrong_index: true,
            ..Fault::default()
        },
    );
    assert!(!rig.camera.is_open() && rig.clouds == 0);
    rig.open();
    rig.captured(1_000, Fault::default());
    assert_eq!(rig.clouds, 1);
}

#[test]
fn the_pauses_grow_to_two_seconds_and_not_further() {
    let wanted = Wanted {
        size_px: [40, 30],
        rate_hz: 15.0,
    };
    let mut camera = Camera::new("/nowhere/video0", wanted);
    let mut time = Timestamp::from_seconds(1.0);
    let mut pauses = Vec::new();
    for _ in 0..8 {
        assert!(!camera.open_if_due(time));
        pauses.push((camera.due().seconds_since(time) * 10.0).round());
        time = camera.due();
    }
    assert_eq!(pauses, [1.0, 2.0, 4.0, 8.0, 16.0, 20.0, 20.0, 20.0]);
}

#[test]
fn a_file_that_is_no_camera_is_refused_and_tried_again() {
    for (path, said) in [
        (
            "/dev/null",
            "/dev/null: no V4L2 device that captures; `v4l2-ctl --list-devices` names those there are",
        ),
        ("/", "/: Is a directory (os error 21)"),
    ] {
        let mut camera = Camera::new(
            path,
            Wanted {
                size_px: [40, 30],
                rate_hz: 15.0,
            },
        );
        assert!(!camera.open_if_due(now()));
        assert_eq!(camera.error().unwrap().to_string(), said);
    }
}
