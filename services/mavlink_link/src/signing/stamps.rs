//! The stamps in our signatures: they never repeat and never go back, whatever the clock does and whichever process
//! restarts.
//!
//! | in | out |
//! |---|---|
//! | wall clock | the next stamp ([`Stamps::take`]) |
//! | a bound that is stored | that many stamps are free to be used ([`Stamps::reserved`]) |
//!
//! Only stamps below a bound in a file are used; the next process starts at that bound. The bound is a minute ahead, so
//! the file is written about once a minute. No more than that: a sender that is more than a minute behind the newest
//! stamp of its peers is refused by them when it is new, and after a crash we are ahead of everybody by what was
//! reserved.

use jink_runtime::realtime::{Scheduling, schedule};
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{SyncSender, sync_channel};
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// Stamps in a second: one each 10 us.
pub const PER_SECOND: u64 = 100_000;

/// Behind the last stamp: a signature has 48 bits for it, which last until 2104.
const END: u64 = 1 << 48;
/// 2015-01-01 in seconds since 1970, where stamps begin.
const BEGIN_S: u64 = 1_420_070_400;
/// How far ahead of the clock a bound is set.
const AHEAD: u64 = 60 * PER_SECOND;
/// How many stamps are reserved at least, where ours are ahead of the clock already: then each message takes one, and
/// this is a minute of more messages than any link carries.
const AT_LEAST: u64 = PER_SECOND;
/// The next bound is asked for when so much is left: what a disk takes, and the second that is kept for a slower one.
const LEFT: u64 = 2 * PER_SECOND;
/// The same where each message takes one: a second of more messages than any link carries.
const LEFT_AT_LEAST: u64 = PER_SECOND / 20;

/// The wall clock as a stamp; 0 before 2015.
pub fn wall() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH + Duration::from_secs(BEGIN_S));
    since.map_or(0, |time| u64::try_from(time.as_micros() / 10).unwrap_or(u64::MAX))
}

/// Which stamps are used up, and which may be used.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Stamps {
    next: u64,
    bound: u64,
}

impl Stamps {
    /// Begins at `stored`, the bound of the process that signed before; nothing is reserved yet.
    pub fn begin(stored: u64) -> Self {
        Self {
            next: stored,
            bound: stored,
        }
    }

    /// The smallest stamp that was not used yet.
    pub fn next(&self) -> u64 {
        self.next
    }

    /// A stamp that no process has used or will use; `None` = nothing is reserved. It follows the clock up to a second
    /// before the bound. That second is kept: if the disk takes long, or the clock has jumped, each message takes one
    /// stamp of it, and signing never stops.
    pub fn take(&mut self, wall: u64) -> Option<u64> {
        let bound = self.bound.min(END);
        let stamp = self.next.max(wall.min(bound.saturating_sub(AT_LEAST)));
        (stamp < bound).then(|| {
            self.next = stamp + 1;
            stamp
        })
    }

    /// The bound that should be stored now; `None` while enough is reserved, and when there are no more.
    pub fn wants(&self, wall: u64) -> Option<u64> {
        let (wall, next) = (wall.min(END), self.next.min(END));
        let is_short = self.bound < wall + LEFT || self.bound < next + LEFT_AT_LEAST;
        let wanted = (wall + AHEAD).max(next + AT_LEAST).min(END);
        (is_short && wanted > self.bound).then_some(wanted)
    }

    /// `bound` is stored.
    pub fn reserved(&mut self, bound: u64) {
        self.bound = self.bound.max(bound);
    }

    /// As bytes, for the next process that signs.
    pub fn to_bytes(self) -> [u8; 16] {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&self.next.to_le_bytes());
        bytes[8..].copy_from_slice(&self.bound.to_le_bytes());
        bytes
    }

    /// From those bytes.
    pub fn of_bytes(bytes: &[u8; 16]) -> Self {
        let (next, bound) = bytes.split_at(8);
        let number = |part: &[u8]| part.iter().rev().fold(0, |sum, byte| sum << 8 | u64::from(*byte));
        Self {
            next: number(next),
            bound: number(bound),
        }
    }
}

/// Stamps with the file that keeps their bound.
#[derive(Debug)]
pub struct StampKeeper {
    path: PathBuf,
    stamps: Stamps,
    /// The bound asked of the writer last, and the one it has stored last.
    asked: u64,
    stored: Arc<AtomicU64>,
    writer: SyncSender<u64>,
}

impl StampKeeper {
    /// Keeps the bound in the file at `path`. Nothing is reserved, so that a process that only receives changes
    /// nothing.
    ///
    /// # Errors
    /// The system's error about the file or the thread.
    pub fn open(path: &Path) -> io::Result<Self> {
        let stored = Arc::new(AtomicU64::new(0));
        let (writer, wanted) = sync_channel(1);
        let (done, file) = (Arc::clone(&stored), path.to_owned());
        std::thread::Builder::new()
            .name("stamps".to_owned())
            .spawn(move || {
                // Writing to a disk is not urgent, whatever priority the gateway itself has. On failure it keeps that
                // priority.
                let _ = schedule(0, Scheduling::Ordinary);
                for bound in wanted {
                    if let Err(error) = store(&file, bound, Durable::Yes) {
                        // To stop sending in flight would be worse than a stamp that a later start may use again.
                        tracing::error!("{}: the bound of stamps is not stored: {error}", file.display());
                    }
                    done.store(bound, Ordering::Release);
                }
            })?;
        Ok(Self {
            stamps: Stamps::begin(load(path)?),
            path: path.to_owned(),
            asked: 0,
            stored,
            writer,
        })
    }

    /// Signs from now on, as the first process or after one that died: begins behind everything that may have been
    /// used.
    ///
    /// # Errors
    /// The system's error about the file.
    pub fn begin(&mut self, wall: u64) -> io::Result<()> {
        self.stamps = Stamps::begin(load(&self.path)?.max(self.stamps.next));
        if let Some(bound) = self.stamps.wants(wall) {
            // A crash does not lose what the system has; the disk follows with the next bound.
            store(&self.path, bound, Durable::No)?;
            self.stamps.reserved(bound);
        }
        Ok(())
    }

    /// Signs from now on, from the stamps of the process that stopped.
    pub fn resume_from(&mut self, stamps: Stamps) {
        self.stamps = Stamps {
            next: stamps.next.max(self.stamps.next),
            ..stamps
        };
    }

    /// Where it has stopped.
    pub fn stamps(&self) -> Stamps {
        self.stamps
    }

    /// The next stamp; `None` before [`Self::begin`], until a first bound is stored. Never waits.
    pub fn take(&mut self, wall: u64) -> Option<u64> {
        self.stamps.reserved(self.stored.load(Ordering::Acquire));
        if let Some(bound) = self.stamps.wants(wall)
            && self.asked < bound
            && self.asked <= self.stored.load(Ordering::Acquire)
            && self.writer.try_send(bound).is_ok()
        {
            self.asked = bound;
        }
        self.stamps.take(wall)
    }
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Durable {
    Yes,
    No,
}

/// The stored bound; 0 where there is no file.
fn load(path: &Path) -> io::Result<u64> {
    match std::fs::read_to_string(path) {
        Ok(text) => {
            let bound = text.trim().parse().ok().filter(|bound| *bound <= END);
            bound.ok_or_else(|| io::Error::new(io::ErrorKind::InvalidData, "it holds no stamp"))
        }
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
        Err(error) => Err(error),
    }
}

/// Either the old bound or the new one is in the file, whenever the power fails.
fn store(path: &Path, bound: u64, durable: Durable) -> io::Result<()> {
    let new = path.with_extension("new");
    let mut file = File::create(&new)?;
    writeln!(file, "{bound}")?;
    if durable == Durable::Yes {
        file.sync_all()?;
    }
    std::fs::rename(&new, path)
}

#[cfg(test)]
mod tests {
    use super::{AHEAD, AT_LEAST, END, PER_SECOND, StampKeeper, Stamps, load, wall};
    use proptest::prelude::*;
    use std::time::{Duration, Instant};

    /// What happens to a signer.
    #[derive(Clone, Copy, Debug)]
    enum SignerEvent {
        /// It signs after so many stamps of time.
        Signs(u64),
        /// Its clock goes back.
        ClockBack(u64),
        /// It dies and starts again.
        Restarts,
    }

    fn event() -> impl Strategy<Value = SignerEvent> {
        prop_oneof![
            8 => (0..3 * PER_SECOND).prop_map(SignerEvent::Signs),
            1 => (0..1000 * PER_SECOND).prop_map(SignerEvent::ClockBack),
            1 => Just(SignerEvent::Restarts),
        ]
    }

    #[test]
    fn a_slow_disk_or_a_clock_that_jumps_never_stops_the_stamps() {
        let wall = 1_000 * PER_SECOND;
        let mut stamps = Stamps::begin(0);
        let bound = stamps.wants(wall).unwrap();
        stamps.reserved(bound);
        // A minute of five hundred messages a second, all of them after the bound has passed.
        let mut last = None;
        for _ in 0..30_000 {
            let stamp = stamps.take(wall + 100 * AHEAD);
            assert!(stamp > last && stamp < Some(bound), "{stamp:?} after {last:?}");
            last = stamp;
        }
    }

    #[test]
    fn behind_the_last_stamp_nothing_is_signed_and_nothing_breaks() {
        for (next, bound) in [(END, END), (u64::MAX, u64::MAX), (0, u64::MAX), (u64::MAX, 0)] {
            let mut stamps = Stamps { next, bound };
            for wall in [0, END - 1, u64::MAX] {
                if let Some(wanted) = stamps.wants(wall) {
                    assert!(wanted <= END);
                    stamps.reserved(wanted);
                }
                assert!(stamps.take(wall).is_none_or(|stamp| stamp < END));
            }
        }
    }

    proptest! {
        #[test]
        fn stamps_only_grow_whatever_the_clock_does_and_whenever_it_restarts(
            events in proptest::collection::vec(event(), 1..400),
        ) {
            let mut wall = 5_000 * PER_SECOND;
            let (mut stored, mut last) = (0, None);
            let mut stamps = Stamps::begin(stored);
            for event in events {
                match event {
                    SignerEvent::Signs(pause) => {
                        wall += pause;
                        if let Some(bound) = stamps.wants(wall) {
                            stored = bound;
                            stamps.reserved(bound);
                        }
                        let stamp = stamps.take(wall);
                        prop_assert!(stamp.is_some() && stamp > last, "{:?} after {:?}", stamp, last);
                        last = stamp;
                    }
                    SignerEvent::ClockBack(by) => wall = wall.saturating_sub(by),
                    SignerEvent::Restarts => stamps = Stamps::begin(stored),
                }
            }
        }

        #[test]
        fn stamps_survive_their_bytes(next in any::<u64>(), bound in any::<u64>()) {
            let stamps = Stamps { next, bound };
            prop_assert_eq!(Stamps::of_bytes(&stamps.to_bytes()), stamps);
        }
    }

    #[test]
    fn the_bound_is_written_about_once_a_minute() {
        let mut stamps = Stamps::begin(0);
        let mut written = 0;
        // Ten minutes of a hundred messages a second.
        for tick in 0..60_000 {
            let wall = 1_000 * PER_SECOND + tick * (PER_SECOND / 100);
            if let Some(bound) = stamps.wants(wall) {
                written += 1;
                stamps.reserved(bound);
            }
            assert!(stamps.take(wall).is_some());
        }
        assert!((10..=11).contains(&written), "{written}");
    }

    #[test]
    fn crashes_in_a_row_get_ahead_of_the_clock_by_little_more_than_a_minute() {
        let wall = 1_000 * PER_SECOND;
        let mut stored = 0;
        for _ in 0..10 {
            let mut stamps = Stamps::begin(stored);
            stored = stamps.wants(wall).unwrap();
            stamps.reserved(stored);
            assert!(stamps.take(wall).is_some());
        }
        assert!(stored <= wall + AHEAD + 10 * AT_LEAST, "{}", stored - wall);
    }

    #[test]
    fn the_next_one_begins_behind_everything_that_the_last_may_have_used() {
        let path = std::env::temp_dir().join(format!("jink_stamps_{}", std::process::id()));
        let _ = std::fs::remove_file(&path);
        let now = wall();
        // 2020 or later: unit and epoch are right.
        assert!(now > 5 * 365 * 86_400 * PER_SECOND);
        let mut first = StampKeeper::open(&path).unwrap();
        assert_eq!(
            first.take(now),
            None,
            "nothing is reserved by one who only listens"
        );
        first.begin(now).unwrap();
        let used = first.take(now).unwrap();
        let bound = load(&path).unwrap();
        assert!(bound > used);
        // Long after: the writer is asked, and until it has stored the bound nothing is given out beyond the old one.
        let later = now + 10 * AHEAD;
        let begin = Instant::now();
        let mut last = used;
        let stamp = loop {
            let stamp = first.take(later).unwrap();
            assert!(stamp > last && (stamp >= later || stamp < bound));
            if stamp >= later {
                break stamp;
            }
            last = stamp;
            assert!(begin.elapsed() < Duration::from_secs(20));
            std::thread::sleep(Duration::from_millis(1));
        };
        assert!(load(&path).unwrap() > stamp);
        let mut second = StampKeeper::open(&path).unwrap();
        second.begin(now).unwrap();
        assert!(second.take(now).unwrap() > stamp);
        for damaged in ["nonsense", "", "281474976710657", "18446744073709551615"] {
            std::fs::write(&path, damaged).unwrap();
            assert!(StampKeeper::open(&path).is_err(), "{damaged}");
        }
        std::fs::remove_file(&path).unwrap();
    }
}
