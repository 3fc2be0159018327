//! A depth camera's device file, made of FUSE: open, ioctl, mmap and poll of the driver go through the kernel, and what
//! a camera would do is done here, with its faults. It keeps to the manual of V4L2 (Streaming I/O) as far as a driver
//! can see.

pub use fuser::Errno;
use fuser::{
    BackgroundSession, Config, FileAttr, FileHandle, FileType, Filesystem, FopenFlags, Generation, INodeNo,
    IoctlFlags, LockOwner, Notifier, OpenFlags, PollEvents, PollFlags, PollNotifier, ReplyAttr, ReplyData,
    ReplyEmpty, ReplyEntry, ReplyIoctl, ReplyOpen, ReplyPoll, Request,
};
use std::collections::VecDeque;
use std::ffi::OsStr;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::{Duration, Instant, UNIX_EPOCH};

/// Name of the file in the folder.
const NAME: &str = "video0";
const FILE: INodeNo = INodeNo(2);
const PAGE: usize = 4096;
/// What it grants at most.
const BUFFERS: u32 = 4;
/// As in `linux/videodev2.h`.
const FLAG_ERROR: u32 = 0x40;
const MONOTONIC: u32 = 0x2000;

/// What is wrong with an image.
#[derive(Clone, Copy, Debug, Default)]
pub struct Fault {
    /// V4L2_BUF_FLAG_ERROR.
    pub damaged: bool,
    /// Only so many bytes.
    pub bytes: Option<u32>,
    /// Images that are lost before it.
    pub missed: u32,
    /// No V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC.
    pub undated: bool,
    /// The time stamp (us) instead of the present.
    pub stamp_us: Option<i64>,
    /// The index of a buffer that was never granted.
    pub wrong_index: bool,
}

/// What the device grants, and what has become of it.
#[derive(Debug)]
pub struct State {
    /// Whether it is there.
    pub plugged: bool,
    /// Whether it captures video.
    pub captures: bool,
    /// The only size it has.
    pub size_px: [u32; 2],
    /// The only format.
    pub fourcc: [u8; 4],
    /// Bytes between the end of a row and the beginning of the next.
    pub padding: u32,
    /// The only rate it has (Hz); `None`: it cannot set one.
    pub rate_hz: Option<u32>,
    /// Buffers that it grants.
    pub grants: u32,
    /// Whether they are too small.
    pub small_buffers: bool,
    /// Errors for ioctls by their number.
    pub refuses: Vec<(u32, Errno)>,
    /// Whether it streams.
    pub streams: bool,
    /// How often it was started.
    pub starts: u32,
    owner: Option<u64>,
    opened: u64,
    free: VecDeque<u32>,
    done: VecDeque<Vec<u8>>,
    images: Vec<Vec<u8>>,
    sequence: u32,
    waiting: Vec<PollNotifier>,
}

impl State {
    fn row_bytes(&self) -> u32 {
        2 * self.size_px[0] + self.padding
    }

    fn image_bytes(&self) -> u32 {
        self.row_bytes() * self.size_px[1]
    }

    /// Bytes from one buffer to the next in the file.
    fn pitch(&self) -> usize {
        (self.image_bytes() as usize).next_multiple_of(PAGE)
    }

    fn stop(&mut self) {
        self.streams = false;
        self.free.clear();
        self.done.clear();
    }
}

type Shared = Arc<Mutex<State>>;

fn lock(state: &Shared) -> MutexGuard<'_, State> {
    state.lock().unwrap()
}

/// The device.
pub struct VideoDevice {
    state: Shared,
    folder: PathBuf,
    notifier: Notifier,
    session: Option<BackgroundSession>,
}

impl VideoDevice {
    /// A device with Z16 at `size_px` and 15 Hz. `None`, and reported on standard error, where this machine has no FUSE
    /// for this user.
    pub fn plug_in(role: &str, size_px: [u32; 2]) -> Option<Self> {
        let folder = std::env::temp_dir().join(format!("jink_v4l2_{role}_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let state = Arc::new(Mutex::new(State {
            plugged: true,
            captures: true,
            size_px,
            fourcc: *b"Z16 ",
            padding: 0,
            rate_hz: Some(15),
            grants: BUFFERS,
            small_buffers: false,
            refuses: Vec::new(),
            streams: false,
            starts: 0,
            owner: None,
            opened: 0,
            free: VecDeque::new(),
            done: VecDeque::new(),
            images: vec![Vec::new(); BUFFERS as usize],
            sequence: 0,
            waiting: Vec::new(),
        }));
        let files = Files {
            state: Arc::clone(&state),
        };
        match fuser::spawn_mount(files, &folder, &Config::default()) {
            Ok(session) => Some(Self {
                state,
                folder,
                notifier: session.notifier(),
                session: Some(session),
            }),
            Err(error) => {
                crate::not_tested(&format!(
                    "no device file can be made of FUSE (/dev/fuse, and root or fusermount3): {error}"
                ));
                let _ = std::fs::remove_dir(&folder);
                None
            }
        }
    }

    /// Its path.
    pub fn path(&self) -> String {
        self.folder.join(NAME).to_str().unwrap().to_owned()
    }

    /// Looks at it, or changes it.
    pub fn with<T>(&self, change: impl FnOnce(&mut State) -> T) -> T {
        change(&mut lock(&self.state))
    }

    /// Waits until nobody streams from it: the kernel reports that a file was closed to FUSE without waiting for it.
    pub fn wait_until_released(&self) {
        let begin = Instant::now();
        while self.with(|state| state.owner.is_some()) {
            assert!(begin.elapsed().as_secs() < 60, "somebody still streams");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    /// It captures an image. Returns whether there was a buffer for it.
    pub fn capture(&self, depths: &[u16]) -> bool {
        self.capture_with(depths, Fault::default())
    }

    /// The same with a fault.
    pub fn capture_with(&self, depths: &[u16], fault: Fault) -> bool {
        let (index, pitch, bytes) = {
            let mut state = lock(&self.state);
            state.sequence += 1 + fault.missed;
            let Some(index) = state.free.pop_front().filter(|_| state.streams) else {
                return false;
            };
            let row = 2 * state.size_px[0] as usize;
            let padding = vec![0xAA; state.padding as usize];
            let bytes: Vec<u8> = depths
                .chunks(row / 2)
                .flat_map(|row| {
                    let row = row.iter().flat_map(|depth| depth.to_le_bytes());
                    row.chain(padding.iter().copied()).collect::<Vec<u8>>()
                })
                .collect();
            state.images[index as usize].clone_from(&bytes);
            (index, state.pitch(), bytes)
        };
        // Without the lock: the kernel may have to read a page first.
        let begin = (index as usize * pitch) as u64;
        self.notifier.store(FILE, begin, &bytes).unwrap();
        let mut state = lock(&self.state);
        let buffer = filled(index, bytes.len() as u32, state.sequence, fault);
        state.done.push_back(buffer);
        wake(&mut state);
        true
    }

    /// It is unplugged: the file goes, and open descriptors fail.
    pub fn unplug(&self) {
        let mut state = lock(&self.state);
        state.plugged = false;
        state.stop();
        wake(&mut state);
    }

    /// It is there again, as new.
    pub fn replug(&self) {
        let mut state = lock(&self.state);
        state.plugged = true;
        state.owner = None;
        state.sequence = 0;
    }
}

impl Drop for VideoDevice {
    fn drop(&mut self) {
        self.unplug();
        let unmounted = self.session.take().map(BackgroundSession::umount_and_join);
        if unmounted.is_none_or(|result| result.is_err()) {
            // Somebody still has the file open: the mount goes with them.
            let _ = std::process::Command::new("umount")
                .arg("-l")
                .arg(&self.folder)
                .status();
        }
        let _ = std::fs::remove_dir(&self.folder);
    }
}

fn wake(state: &mut State) {
    for waiting in state.waiting.drain(..) {
        let _ = waiting.notify();
    }
}

/// `struct v4l2_buffer` as DQBUF hands it over.
fn filled(index: u32, bytes: u32, sequence: u32, fault: Fault) -> Vec<u8> {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
    let us = fault
        .stamp_us
        .unwrap_or(now.tv_sec * 1_000_000 + now.tv_nsec / 1_000);
    let mut flags = 0;
    flags |= if fault.damaged { FLAG_ERROR } else { 0 };
    flags |= if fault.undated { 0 } else { MONOTONIC };
    let mut buffer = vec![0; 88];
    put(&mut buffer, 0, if fault.wrong_index { 77 } else { index });
    put(&mut buffer, 4, 1);
    put(&mut buffer, 8, fault.bytes.unwrap_or(bytes));
    put(&mut buffer, 12, flags);
    buffer[24..32].copy_from_slice(&us.div_euclid(1_000_000).to_ne_bytes());
    buffer[32..40].copy_from_slice(&us.rem_euclid(1_000_000).to_ne_bytes());
    put(&mut buffer, 56, sequence);
    put(&mut buffer, 60, 1);
    buffer
}

fn put(bytes: &mut [u8], offset: usize, value: u32) {
    bytes[offset..offset + 4].copy_from_slice(&value.to_ne_bytes());
}

fn get(bytes: &[u8], offset: usize) -> u32 {
    u32::from_ne_bytes(bytes[offset..offset + 4].try_into().unwrap())
}

/// The folder with the one file.
struct Files {
    state: Shared,
}

impl Files {
    fn attributes(&self, ino: INodeNo) -> FileAttr {
        let is_file = ino == FILE;
        FileAttr {
            ino,
            size: (lock(&self.state).pitch() * BUFFERS as usize) as u64,
            blocks: 0,
            atime: UNIX_EPOCH,
            mtime: UNIX_EPOCH,
            ctime: UNIX_EPOCH,
            crtime: UNIX_EPOCH,
            kind: if is_file {
                FileType::RegularFile
            } else {
                FileType::Directory
            },
            perm: if is_file { 0o660 } else { 0o755 },
            nlink: 1,
            uid: rustix::process::getuid().as_raw(),
            gid: rustix::process::getgid().as_raw(),
            rdev: 0,
            flags: 0,
            blksize: PAGE as u32,
        }
    }

    /// The result of an ioctl: the structure as it is after it.
    fn call(&self, number: u32, file: u64, mut data: Vec<u8>) -> Result<Vec<u8>, Errno> {
        let mut state = lock(&self.state);
        if !state.plugged {
            return Err(Errno::ENODEV);
        }
        if let Some((_, errno)) = state.refuses.iter().find(|(refused, _)| *refused == number) {
            return Err(*errno);
        }
        let is_mine = state.owner.is_none_or(|owner| owner == file);
        match number {
            0 => {
                data = vec![0; 104];
                let caps = if state.captures { 0x0400_0001 } else { 0x0400_0002 };
                put(&mut data, 84, 0x8400_0001);
                put(&mut data, 88, caps);
            }
            5 if !is_mine => return Err(Errno::EBUSY),
            5 => {
                let [width, height] = state.size_px;
                put(&mut data, 8, width);
                put(&mut data, 12, height);
                put(&mut data, 16, u32::from_le_bytes(state.fourcc));
                put(&mut data, 24, state.row_bytes());
                put(&mut data, 28, state.image_bytes());
            }
            22 => {
                let rate_hz = state.rate_hz.ok_or(Errno::ENOTTY)?;
                put(&mut data, 12, 1);
                put(&mut data, 16, rate_hz);
            }
            8 if !is_mine => return Err(Errno::EBUSY),
            8 => {
                let count = get(&data, 0).min(state.grants);
                put(&mut data, 0, count);
                state.owner = Some(file);
                state.stop();
            }
            9 => {
                let length = if state.small_buffers {
                    100
                } else {
                    state.image_bytes()
                };
                let offset = get(&data, 0) as usize * state.pitch();
                put(&mut data, 64, offset as u32);
                put(&mut data, 72, length);
            }
            15 if get(&data, 0) >= state.grants => return Err(Errno::EINVAL),
            15 => state.free.push_back(get(&data, 0)),
            17 if !state.streams => return Err(Errno::EINVAL),
            17 => data = state.done.pop_front().ok_or(Errno::EAGAIN)?,
            18 => {
                state.streams = true;
                state.starts += 1;
            }
            19 => state.stop(),
            _ => return Err(Errno::ENOTTY),
        }
        Ok(data)
    }
}

impl Filesystem for Files {
    fn lookup(&self, _: &Request, parent: INodeNo, name: &OsStr, reply: ReplyEntry) {
        if parent == INodeNo::ROOT && name == NAME && lock(&self.state).plugged {
            reply.entry(&Duration::ZERO, &self.attributes(FILE), Generation(0));
        } else {
            reply.error(Errno::ENOENT);
        }
    }

    fn getattr(&self, _: &Request, ino: INodeNo, _: Option<FileHandle>, reply: ReplyAttr) {
        reply.attr(&Duration::ZERO, &self.attributes(ino));
    }

    fn open(&self, _: &Request, _: INodeNo, _: OpenFlags, reply: ReplyOpen) {
        let mut state = lock(&self.state);
        state.opened += 1;
        // What another one has mapped must stay.
        reply.opened(FileHandle(state.opened), FopenFlags::FOPEN_KEEP_CACHE);
    }

    fn release(
        &self,
        _: &Request,
        _: INodeNo,
        file: FileHandle,
        _: OpenFlags,
        _: Option<LockOwner>,
        _: bool,
        reply: ReplyEmpty,
    ) {
        let mut state = lock(&self.state);
        if state.owner == Some(file.0) {
            state.owner = None;
            state.stop();
        }
        reply.ok();
    }

    fn read(
        &self,
        _: &Request,
        _: INodeNo,
        _: FileHandle,
        offset: u64,
        size: u32,
        _: OpenFlags,
        _: Option<LockOwner>,
        reply: ReplyData,
    ) {
        let state = lock(&self.state);
        let pitch = state.pitch();
        let file: Vec<u8> = state
            .images
            .iter()
            .flat_map(|image| {
                let mut image = image.clone();
                image.resize(pitch, 0);
                image
            })
            .collect();
        let begin = (offset as usize).min(file.len());
        let end = (begin + size as usize).min(file.len());
        reply.data(&file[begin..end]);
    }

    fn ioctl(
        &self,
        _: &Request,
        _: INodeNo,
        file: FileHandle,
        _: IoctlFlags,
        cmd: u32,
        in_data: &[u8],
        out_size: u32,
        reply: ReplyIoctl,
    ) {
        match self.call(cmd & 0xff, file.0, in_data.to_vec()) {
            Ok(mut data) => {
                data.resize(out_size as usize, 0);
                reply.ioctl(0, &data);
            }
            Err(error) => reply.error(error),
        }
    }

    fn poll(
        &self,
        _: &Request,
        _: INodeNo,
        _: FileHandle,
        notifier: PollNotifier,
        _: PollEvents,
        flags: PollFlags,
        reply: ReplyPoll,
    ) {
        let mut state = lock(&self.state);
        if flags.contains(PollFlags::FUSE_POLL_SCHEDULE_NOTIFY) {
            state.waiting.push(notifier);
        }
        reply.poll(if !state.plugged || !state.streams {
            PollEvents::POLLERR
        } else if state.done.is_empty() {
            PollEvents::empty()
        } else {
            PollEvents::POLLIN | PollEvents::POLLRDNORM
        });
    }
}
