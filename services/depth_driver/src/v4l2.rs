//! Video for Linux, version 2: as much of it as a depth stream needs. The only place of this crate with unsafe code.
//!
//! Structures and numbers are those of `linux/videodev2.h` for machines of 64 bits; a test has the C compiler compare
//! them with the header of the machine. The order of calls is that of the manual's chapter "Streaming I/O (Memory
//! Mapping)": QUERYCAP, S_FMT, S_PARM, REQBUFS, QUERYBUF and mmap, QBUF, STREAMON; then DQBUF and QBUF for each image.
#![allow(
    unsafe_code,
    reason = "ioctl and mmap cannot be called without; each call says why it may be"
)]

use jink_shared_types::Timestamp;
use rustix::io::Errno;
use rustix::ioctl::{Getter, Opcode, Setter, Updater, opcode};
use rustix::mm::{MapFlags, ProtFlags};
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::ptr::NonNull;

#[cfg(not(target_pointer_width = "64"))]
compile_error!("v4l2_buffer has another layout on machines of 32 bits: this driver is for 64 bits");

/// FourCC of depths of 16 bits, the low byte first: V4L2_PIX_FMT_Z16.
pub const Z16: u32 = u32::from_le_bytes(*b"Z16 ");
/// V4L2_BUF_TYPE_VIDEO_CAPTURE.
const CAPTURE: u32 = 1;
/// V4L2_MEMORY_MMAP.
const MMAP: u32 = 1;
/// V4L2_FIELD_NONE.
const PROGRESSIVE: u32 = 1;
/// V4L2_CAP_VIDEO_CAPTURE, V4L2_CAP_STREAMING, V4L2_CAP_DEVICE_CAPS.
const CAP_CAPTURE: u32 = 0x0000_0001;
const CAP_STREAMING: u32 = 0x0400_0000;
const CAP_DEVICE_CAPS: u32 = 0x8000_0000;
/// V4L2_BUF_FLAG_ERROR, V4L2_BUF_FLAG_TIMESTAMP_MASK, V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC.
const FLAG_ERROR: u32 = 0x0000_0040;
const TIMESTAMP_MASK: u32 = 0x0000_e000;
const TIMESTAMP_MONOTONIC: u32 = 0x0000_2000;
/// Buffers that are requested: one is being filled, one is read, two wait while this process gets no CPU for two
/// periods.
const BUFFERS: u32 = 4;

/// `struct v4l2_capability`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct Capability {
    driver: [u8; 16],
    card: [u8; 32],
    bus_info: [u8; 32],
    version: u32,
    capabilities: u32,
    device_caps: u32,
    reserved: [u32; 3],
}

/// `struct v4l2_format` with a `v4l2_pix_format` in it; the union is aligned like a pointer.
#[repr(C, align(8))]
#[derive(Clone, Copy, Debug)]
pub struct Format {
    kind: u32,
    padding: u32,
    width: u32,
    height: u32,
    pixelformat: u32,
    field: u32,
    bytesperline: u32,
    sizeimage: u32,
    rest: [u32; 44],
}

/// `struct v4l2_streamparm` with a `v4l2_captureparm` in it.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct StreamParm {
    kind: u32,
    capability: u32,
    capturemode: u32,
    numerator: u32,
    denominator: u32,
    rest: [u32; 46],
}

/// `struct v4l2_requestbuffers`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct RequestBuffers {
    count: u32,
    kind: u32,
    memory: u32,
    capabilities: u32,
    flags: u32,
}

/// `struct v4l2_buffer`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct Buffer {
    index: u32,
    kind: u32,
    bytesused: u32,
    flags: u32,
    field: u32,
    padding: u32,
    seconds: i64,
    microseconds: i64,
    timecode: [u32; 4],
    sequence: u32,
    memory: u32,
    offset: u64,
    length: u32,
    reserved2: u32,
    request_fd: u32,
    padding2: u32,
}

const QUERYCAP: Opcode = opcode::read::<Capability>(b'V', 0);
const S_FMT: Opcode = opcode::read_write::<Format>(b'V', 5);
const REQBUFS: Opcode = opcode::read_write::<RequestBuffers>(b'V', 8);
const QUERYBUF: Opcode = opcode::read_write::<Buffer>(b'V', 9);
const QBUF: Opcode = opcode::read_write::<Buffer>(b'V', 15);
const DQBUF: Opcode = opcode::read_write::<Buffer>(b'V', 17);
const STREAMON: Opcode = opcode::write::<i32>(b'V', 18);
const STREAMOFF: Opcode = opcode::write::<i32>(b'V', 19);
const S_PARM: Opcode = opcode::read_write::<StreamParm>(b'V', 22);

/// Request numbers and sizes of structures by their names in `linux/videodev2.h`, for the comparison with it.
pub const ABI: &[(&str, &str, u64, usize)] = &[
    row::<Capability>("VIDIOC_QUERYCAP", "struct v4l2_capability", QUERYCAP),
    row::<Format>("VIDIOC_S_FMT", "struct v4l2_format", S_FMT),
    row::<RequestBuffers>("VIDIOC_REQBUFS", "struct v4l2_requestbuffers", REQBUFS),
    row::<Buffer>("VIDIOC_QUERYBUF", "struct v4l2_buffer", QUERYBUF),
    row::<Buffer>("VIDIOC_QBUF", "struct v4l2_buffer", QBUF),
    row::<Buffer>("VIDIOC_DQBUF", "struct v4l2_buffer", DQBUF),
    row::<i32>("VIDIOC_STREAMON", "int", STREAMON),
    row::<i32>("VIDIOC_STREAMOFF", "int", STREAMOFF),
    row::<StreamParm>("VIDIOC_S_PARM", "struct v4l2_streamparm", S_PARM),
];

/// Fields by their names there with their offsets.
pub const FIELDS: &[(&str, &str, usize)] = &[
    (
        "struct v4l2_capability",
        "device_caps",
        std::mem::offset_of!(Capability, device_caps),
    ),
    (
        "struct v4l2_capability",
        "card",
        std::mem::offset_of!(Capability, card),
    ),
    (
        "struct v4l2_format",
        "fmt.pix.width",
        std::mem::offset_of!(Format, width),
    ),
    (
        "struct v4l2_format",
        "fmt.pix.sizeimage",
        std::mem::offset_of!(Format, sizeimage),
    ),
    (
        "struct v4l2_streamparm",
        "parm.capture.timeperframe.denominator",
        std::mem::offset_of!(StreamParm, denominator),
    ),
    (
        "struct v4l2_requestbuffers",
        "memory",
        std::mem::offset_of!(RequestBuffers, memory),
    ),
    (
        "struct v4l2_buffer",
        "bytesused",
        std::mem::offset_of!(Buffer, bytesused),
    ),
    (
        "struct v4l2_buffer",
        "timestamp",
        std::mem::offset_of!(Buffer, seconds),
    ),
    (
        "struct v4l2_buffer",
        "sequence",
        std::mem::offset_of!(Buffer, sequence),
    ),
    (
        "struct v4l2_buffer",
        "m.offset",
        std::mem::offset_of!(Buffer, offset),
    ),
    (
        "struct v4l2_buffer",
        "length",
        std::mem::offset_of!(Buffer, length),
    ),
];

const fn row<T>(
    request: &'static str,
    structure: &'static str,
    opcode: Opcode,
) -> (&'static str, &'static str, u64, usize) {
    (request, structure, opcode as u64, size_of::<T>())
}

/// What is requested of a device.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wanted {
    /// Width and height (px).
    pub size_px: [u16; 2],
    /// Images per second (Hz).
    pub rate_hz: f64,
}

/// Why a device does not stream.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamError {
    /// It is no capture device, or cannot stream.
    NoCapture,
    /// It grants another format.
    OtherFormat {
        /// Its FourCC.
        fourcc: [u8; 4],
    },
    /// It grants another size.
    OtherSize {
        /// Width and height (px).
        size_px: [u32; 2],
    },
    /// Its buffers are too few, or too small for an image.
    Buffers {
        /// Buffers granted.
        count: u32,
        /// Bytes of the smallest.
        bytes: u32,
    },
    /// A call was refused.
    Call {
        /// Its name.
        name: &'static str,
        /// The system's error.
        source: Errno,
    },
}

/// A buffer that was dequeued.
#[derive(Clone, Copy, Debug)]
pub struct Dequeued<'a> {
    /// Its bytes.
    pub bytes: &'a [u8],
    /// When it was captured, if it is dated in CLOCK_MONOTONIC.
    pub stamp: Option<Timestamp>,
    /// The driver's count.
    pub sequence: u32,
    /// V4L2_BUF_FLAG_ERROR.
    pub is_damaged: bool,
}

/// A stream that runs.
#[derive(Debug)]
pub struct CaptureStream {
    // Dropped in this order: the driver lets go of the memory when it is unmapped and the file closed.
    maps: Vec<Mapping>,
    fd: OwnedFd,
    row_bytes: usize,
    rate_hz: Option<f64>,
}

impl CaptureStream {
    /// Starts the stream of the device open at `fd` (O_RDWR, O_NONBLOCK).
    ///
    /// # Errors
    /// See [`StreamError`]. The device is as free as before.
    pub fn start(fd: OwnedFd, wanted: &Wanted) -> Result<Self, StreamError> {
        check_capability(&fd)?;
        let row_bytes = set_format(&fd, wanted.size_px)?;
        let rate_hz = set_rate(&fd, wanted.rate_hz);
        let image_bytes = row_bytes * usize::from(wanted.size_px[1]);
        let mut stream = Self {
            maps: Vec::new(),
            fd,
            row_bytes,
            rate_hz,
        };
        stream.map_buffers(image_bytes)?;
        for index in 0..stream.maps.len() {
            stream.queue(index as u32).map_err(called("VIDIOC_QBUF"))?;
        }
        // SAFETY: STREAMON reads an int, which is what `Setter` passes.
        let on = unsafe { Setter::<STREAMON, i32>::new(CAPTURE as i32) };
        // SAFETY: see above; the number is that of the header, a test compares them.
        unsafe { rustix::ioctl::ioctl(&stream.fd, on) }.map_err(called("VIDIOC_STREAMON"))?;
        Ok(stream)
    }

    /// What is to be watched for images.
    pub fn watched(&self) -> BorrowedFd<'_> {
        self.fd.as_fd()
    }

    /// Bytes from one row to the next.
    pub fn row_bytes(&self) -> usize {
        self.row_bytes
    }

    /// Images per second that the driver granted (Hz), if it reports them.
    pub fn rate_hz(&self) -> Option<f64> {
        self.rate_hz
    }

    /// Takes the oldest image, shows it to `visit` and gives its buffer back. `false`: there is none now.
    ///
    /// # Errors
    /// What the system says: the device is gone, or does not stream any more.
    pub fn take(&mut self, visit: impl FnOnce(&Dequeued<'_>)) -> Result<bool, Errno> {
        let mut buffer = Buffer {
            kind: CAPTURE,
            memory: MMAP,
            ..Buffer::default()
        };
        match update::<DQBUF, _>(&self.fd, &mut buffer) {
            Ok(()) => {}
            Err(Errno::AGAIN | Errno::INTR) => return Ok(false),
            Err(error) => return Err(error),
        }
        // An index beyond what was granted: nothing that such a driver reports can be used.
        let map = self.maps.get(buffer.index as usize).ok_or(Errno::IO)?;
        let is_dated = buffer.flags & TIMESTAMP_MASK == TIMESTAMP_MONOTONIC;
        visit(&Dequeued {
            bytes: map.bytes(buffer.bytesused as usize),
            stamp: stamp(buffer.seconds, buffer.microseconds).filter(|_| is_dated),
            sequence: buffer.sequence,
            is_damaged: buffer.flags & FLAG_ERROR != 0,
        });
        self.queue(buffer.index)?;
        Ok(true)
    }

    fn queue(&self, index: u32) -> Result<(), Errno> {
        let mut buffer = Buffer {
            index,
            kind: CAPTURE,
            memory: MMAP,
            ..Buffer::default()
        };
        update::<QBUF, _>(&self.fd, &mut buffer)
    }

    fn map_buffers(&mut self, image_bytes: usize) -> Result<(), StreamError> {
        let mut request = RequestBuffers {
            count: BUFFERS,
            kind: CAPTURE,
            memory: MMAP,
            capabilities: 0,
            flags: 0,
        };
        update::<REQBUFS, _>(&self.fd, &mut request).map_err(called("VIDIOC_REQBUFS"))?;
        let mut least = u32::MAX;
        // A driver may grant more, but 32 are the most there can be (VIDEO_MAX_FRAME).
        for index in 0..request.count.min(32) {
            let mut buffer = Buffer {
                index,
                kind: CAPTURE,
                memory: MMAP,
                ..Buffer::default()
            };
            update::<QUERYBUF, _>(&self.fd, &mut buffer).map_err(called("VIDIOC_QUERYBUF"))?;
            least = least.min(buffer.length);
            if (buffer.length as usize) < image_bytes {
                break;
            }
            // Only the low half of the union is the offset.
            let offset = buffer.offset & u64::from(u32::MAX);
            let map = Mapping::new(&self.fd, offset, buffer.length as usize);
            self.maps.push(map.map_err(called("mmap"))?);
        }
        if self.maps.len() < 2 || self.maps.len() < request.count.min(32) as usize {
            return Err(StreamError::Buffers {
                count: request.count,
                bytes: least,
            });
        }
        Ok(())
    }
}

impl Drop for CaptureStream {
    fn drop(&mut self) {
        // SAFETY: STREAMOFF reads an int, which is what `Setter` passes.
        let off = unsafe { Setter::<STREAMOFF, i32>::new(CAPTURE as i32) };
        // SAFETY: as above. A device that is gone refuses it, and has stopped anyway.
        let _ = unsafe { rustix::ioctl::ioctl(&self.fd, off) };
    }
}

fn check_capability(fd: &OwnedFd) -> Result<(), StreamError> {
    // SAFETY: QUERYCAP writes a `v4l2_capability`, of which every bit pattern is valid.
    let get = unsafe { Getter::<QUERYCAP, Capability>::new() };
    // SAFETY: see above; the number is that of the header, a test compares them.
    let capability = unsafe { rustix::ioctl::ioctl(fd, get) }.map_err(|source| match source {
        Errno::NOTTY | Errno::INVAL => StreamError::NoCapture,
        source => StreamError::Call {
            name: "VIDIOC_QUERYCAP",
            source,
        },
    })?;
    let of_node = match capability.capabilities & CAP_DEVICE_CAPS {
        0 => capability.capabilities,
        _ => capability.device_caps,
    };
    let needed = CAP_CAPTURE | CAP_STREAMING;
    if of_node & needed == needed {
        Ok(())
    } else {
        Err(StreamError::NoCapture)
    }
}

/// Sets Z16 at this size. Returns the bytes from one row to the next.
fn set_format(fd: &OwnedFd, size_px: [u16; 2]) -> Result<usize, StreamError> {
    let [width, height] = size_px.map(u32::from);
    let mut format = Format {
        kind: CAPTURE,
        padding: 0,
        width,
        height,
        pixelformat: Z16,
        field: PROGRESSIVE,
        bytesperline: 0,
        sizeimage: 0,
        rest: [0; 44],
    };
    // A driver does not refuse what it does not have: it returns what it has instead.
    update::<S_FMT, _>(fd, &mut format).map_err(called("VIDIOC_S_FMT"))?;
    if format.pixelformat != Z16 {
        let fourcc = format.pixelformat.to_le_bytes();
        return Err(StreamError::OtherFormat { fourcc });
    }
    if [format.width, format.height] != [width, height] {
        let size_px = [format.width, format.height];
        return Err(StreamError::OtherSize { size_px });
    }
    // Some drivers leave it zero; and no sane one pads a row to more than four times its length.
    Ok(format.bytesperline.clamp(2 * width, 8 * width) as usize)
}

/// Requests `rate_hz`. Returns the granted rate, `None` where the driver cannot set it.
fn set_rate(fd: &OwnedFd, rate_hz: f64) -> Option<f64> {
    let mut parm = StreamParm {
        kind: CAPTURE,
        capability: 0,
        capturemode: 0,
        // In thousandths of a hertz.
        numerator: 1_000,
        denominator: (rate_hz * 1_000.0).round() as u32,
        rest: [0; 46],
    };
    update::<S_PARM, _>(fd, &mut parm).ok()?;
    (parm.numerator > 0 && parm.denominator > 0)
        .then(|| f64::from(parm.denominator) / f64::from(parm.numerator))
}

fn called(name: &'static str) -> impl Fn(Errno) -> StreamError {
    move |source| StreamError::Call { name, source }
}

/// A time of CLOCK_MONOTONIC; `None` if it is none.
fn stamp(seconds: i64, microseconds: i64) -> Option<Timestamp> {
    let seconds = u64::try_from(seconds).ok()?;
    let microseconds = u64::try_from(microseconds).ok().filter(|us| *us < 1_000_000)?;
    let ns = seconds
        .checked_mul(1_000_000_000)?
        .checked_add(microseconds * 1_000)?;
    (ns > 0).then(|| Timestamp::from_ns(ns))
}

/// A structure that the kernel reads and writes.
trait Exchanged {}
impl Exchanged for Format {}
impl Exchanged for StreamParm {}
impl Exchanged for RequestBuffers {}
impl Exchanged for Buffer {}

/// An ioctl that reads and writes a structure.
fn update<const REQUEST: Opcode, T: Exchanged>(fd: &OwnedFd, value: &mut T) -> Result<(), Errno> {
    // SAFETY: the number holds the size of the structure that it was made of, every field of which is a number; a test
    // compares numbers, sizes and offsets with the header. With MMAP and a zero offset there is no pointer in it.
    let update = unsafe { Updater::<REQUEST, T>::new(value) };
    // SAFETY: see above.
    unsafe { rustix::ioctl::ioctl(fd, update) }
}

/// Memory of a buffer.
#[derive(Debug)]
struct Mapping {
    begin: NonNull<u8>,
    bytes: usize,
}

// SAFETY: the memory belongs to this value alone, whichever thread has it.
unsafe impl Send for Mapping {}

impl Mapping {
    fn new(fd: &OwnedFd, offset: u64, bytes: usize) -> Result<Self, Errno> {
        // SAFETY: a new mapping at an address of the kernel's choice touches no memory that is in use.
        let begin = unsafe {
            rustix::mm::mmap(
                std::ptr::null_mut(),
                bytes,
                ProtFlags::READ,
                MapFlags::SHARED,
                fd,
                offset,
            )
        }?;
        let begin = NonNull::new(begin.cast()).ok_or(Errno::NOMEM)?;
        Ok(Self { begin, bytes })
    }

    /// The first `used` bytes, or all there are.
    fn bytes(&self, used: usize) -> &[u8] {
        // SAFETY: mapped and readable for `self.bytes` as long as this value lives. Between DQBUF and QBUF, which is
        // when this is called, the buffer belongs to this process and the driver does not write to it.
        unsafe { std::slice::from_raw_parts(self.begin.as_ptr(), used.min(self.bytes)) }
    }
}

impl Drop for Mapping {
    fn drop(&mut self) {
        // SAFETY: it was mapped with this address and length, and no slice of it outlives this value.
        let _ = unsafe { rustix::mm::munmap(self.begin.as_ptr().cast(), self.bytes) };
    }
}
