//! The camera: opened, lost, and opened again with growing pauses.

use crate::driver::Image;
use crate::v4l2::{CaptureStream, StreamError, Wanted};
use jink_shared_types::Timestamp;
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use std::fmt;
use std::os::fd::BorrowedFd;

/// First pause before the device is tried again (s), and the longest one; each is twice the one before.
const PAUSE_S: [f64; 2] = [0.1, 2.0];
/// A stream without an image for so long (s) is started anew: a USB camera may stall for good without an error. The
/// slowest rate is 2 Hz.
const STALL_S: f64 = 3.0;
/// Images per cycle at most: a device that never ends must not keep the heartbeat waiting.
const IMAGES: usize = 4;
/// A granted rate that differs by more than this share is worth a warning.
const RATE_SHARE: f64 = 0.05;

/// Why a camera does not stream.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraError {
    /// The device file does not exist.
    NoDevice {
        /// Its path.
        path: String,
    },
    /// The device may not be opened.
    Permission {
        /// Its path.
        path: String,
    },
    /// Another program streams from it.
    Busy {
        /// Its path.
        path: String,
    },
    /// It does not stream what is requested.
    CaptureStream {
        /// Its path.
        path: String,
        /// The size requested: width and height (px).
        size_px: [u16; 2],
        /// Why not.
        cause: StreamError,
    },
    /// It cannot be opened for another reason.
    Open {
        /// Its path.
        path: String,
        /// The system's error.
        source: Errno,
    },
    /// It streamed, and broke or was unplugged.
    Lost {
        /// Its path.
        path: String,
        /// The system's error.
        source: Errno,
    },
    /// It streams, and no image comes.
    Stalled {
        /// Its path.
        path: String,
    },
}

impl fmt::Display for CameraError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoDevice { path } => {
                write!(
                    f,
                    "{path}: no such device; is it plugged in, and is the name right?"
                )
            }
            Self::Permission { path } => {
                write!(
                    f,
                    "{path}: permission denied; the user must be in the group video"
                )
            }
            Self::Busy { path } => write!(
                f,
                "{path}: another program streams from it; `fuser {path}` names it"
            ),
            Self::CaptureStream {
                path,
                size_px: [width, height],
                cause,
            } => match cause {
                StreamError::NoCapture => write!(
                    f,
                    "{path}: no V4L2 device that captures; `v4l2-ctl --list-devices` names those there are"
                ),
                StreamError::OtherFormat { fourcc } => write!(
                    f,
                    "{path}: grants the format {} instead of Z16; a camera has several devices, \
                     `v4l2-ctl --list-formats` shows the one with depth",
                    fourcc.escape_ascii()
                ),
                StreamError::OtherSize { size_px } => write!(
                    f,
                    "{path}: grants {} x {} instead of {width} x {height}; `v4l2-ctl --list-formats-ext` lists the sizes there are",
                    size_px[0], size_px[1]
                ),
                StreamError::Buffers { count, bytes } => write!(
                    f,
                    "{path}: its {count} buffers of {bytes} bytes do not hold images of {width} x {height}"
                ),
                StreamError::Call { name, source } => write!(f, "{path}: {name}: {source}"),
            },
            Self::Open { path, source } => write!(f, "{path}: {source}"),
            Self::Lost { path, source } => write!(f, "{path}: lost, opening it again: {source}"),
            Self::Stalled { path } => {
                write!(f, "{path}: no image for {STALL_S} s, starting the stream again")
            }
        }
    }
}
impl std::error::Error for CameraError {}

/// A camera that comes and goes.
#[derive(Debug)]
pub struct Camera {
    path: String,
    wanted: Wanted,
    stream: Option<CaptureStream>,
    /// When the last image came, or the stream was started.
    newest: Timestamp,
    retry_at: Timestamp,
    pause_s: f64,
    /// What was reported last: each cause once.
    reported: Option<CameraError>,
}

impl Camera {
    /// The device at `path`, not open.
    pub fn new(path: &str, wanted: Wanted) -> Self {
        Self {
            path: path.to_owned(),
            wanted,
            stream: None,
            newest: Timestamp::NEVER,
            retry_at: Timestamp::NEVER,
            pause_s: PAUSE_S[0],
            reported: None,
        }
    }

    /// Whether it streams.
    pub fn is_open(&self) -> bool {
        self.stream.is_some()
    }

    /// Why it does not stream, or did not before.
    pub fn error(&self) -> Option<&CameraError> {
        self.reported.as_ref()
    }

    /// What is to be watched for images.
    pub fn watched(&self) -> Option<BorrowedFd<'_>> {
        self.stream.as_ref().map(CaptureStream::watched)
    }

    /// When it is tried again, or taken for stalled.
    pub fn due(&self) -> Timestamp {
        match self.stream {
            Some(_) => self.newest.plus_seconds(STALL_S),
            None => self.retry_at,
        }
    }

    /// Opens it if it is closed and due. Whether its stream has just been started.
    pub fn open_if_due(&mut self, now: Timestamp) -> bool {
        if self.stream.is_some() || now < self.retry_at {
            return false;
        }
        match open(&self.path, &self.wanted) {
            Ok(stream) => {
                self.report_start(&stream);
                self.stream = Some(stream);
                self.newest = now;
                true
            }
            Err(error) => {
                self.wait(now, error);
                false
            }
        }
    }

    /// Shows `visit` the images that have come, each with the time that `clock` has then. A stream that is broken or
    /// stalled is closed.
    pub fn read(&mut self, now: Timestamp, clock: impl Fn() -> Timestamp, mut visit: impl FnMut(&Image<'_>)) {
        for _ in 0..IMAGES {
            let Some(stream) = &mut self.stream else {
                return;
            };
            let row_bytes = stream.row_bytes();
            let taken = stream.take(|buffer| {
                visit(&Image {
                    arrived: clock(),
                    stamp: buffer.stamp,
                    sequence: buffer.sequence,
                    is_damaged: buffer.is_damaged,
                    row_bytes,
                    bytes: buffer.bytes,
                });
            });
            match taken {
                Ok(true) => {
                    self.newest = now;
                    self.pause_s = PAUSE_S[0];
                    self.reported = None;
                }
                Ok(false) => break,
                Err(source) => {
                    let path = self.path.clone();
                    return self.lose(now, CameraError::Lost { path, source });
                }
            }
        }
        if self.stream.is_some() && now >= self.newest.plus_seconds(STALL_S) {
            let path = self.path.clone();
            self.lose(now, CameraError::Stalled { path });
        }
    }

    /// Closes it: another instance has it now.
    pub fn close(&mut self) {
        self.stream = None;
        self.retry_at = Timestamp::NEVER;
        self.pause_s = PAUSE_S[0];
    }

    fn report_start(&self, stream: &CaptureStream) {
        let [width, height] = self.wanted.size_px;
        let wanted_hz = self.wanted.rate_hz;
        let path = &self.path;
        match stream.rate_hz() {
            Some(rate_hz) if (rate_hz / wanted_hz - 1.0).abs() > RATE_SHARE => tracing::warn!(
                "{path} streams {width} x {height} at {rate_hz:.1} Hz, not at {wanted_hz} Hz; rate_hz should say so"
            ),
            Some(rate_hz) => tracing::info!("{path} streams {width} x {height} at {rate_hz:.1} Hz"),
            None => tracing::info!("{path} streams {width} x {height} at a rate of its own"),
        }
    }

    fn lose(&mut self, now: Timestamp, error: CameraError) {
        self.stream = None;
        self.wait(now, error);
    }

    fn wait(&mut self, now: Timestamp, error: CameraError) {
        self.retry_at = now.plus_seconds(self.pause_s);
        self.pause_s = (2.0 * self.pause_s).min(PAUSE_S[1]);
        if self.reported.as_ref() != Some(&error) {
            tracing::warn!("{error}");
            self.reported = Some(error);
        }
    }
}

fn open(path: &str, wanted: &Wanted) -> Result<CaptureStream, CameraError> {
    let owned = || path.to_owned();
    let flags = OFlags::RDWR | OFlags::NONBLOCK | OFlags::CLOEXEC;
    let fd = rustix::fs::open(path, flags, Mode::empty()).map_err(|source| match source {
        Errno::NOENT | Errno::NXIO | Errno::NODEV => CameraError::NoDevice { path: owned() },
        Errno::ACCESS | Errno::PERM => CameraError::Permission { path: owned() },
        Errno::BUSY => CameraError::Busy { path: owned() },
        source => CameraError::Open {
            path: owned(),
            source,
        },
    })?;
    CaptureStream::start(fd, wanted).map_err(|cause| match cause {
        StreamError::Call {
            source: Errno::BUSY, ..
        } => CameraError::Busy { path: owned() },
        StreamError::Call {
            source: Errno::NODEV, ..
        } => CameraError::NoDevice { path: owned() },
        cause => CameraError::CaptureStream {
            path: owned(),
            size_px: wanted.size_px,
            cause,
        },
    })
}
