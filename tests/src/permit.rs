//! What tests of real processes may use of the machine: several run at once, and those that judge time alone.
//!
//! A system that flies waits most of its time, so some of them side by side do not disturb each other, and fewer do where other programs
//! leave them no processor.
// A harness for tests: the locks hold counters that no panic leaves half written.

use std::cell::RefCell;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};
use std::time::{Duration, Instant};

/// Leave to run real processes, until the last copy of it is dropped.
#[derive(Clone, Debug)]
pub struct Permit {
    _held: Arc<Held>,
}

/// What one test holds.
#[derive(Debug)]
struct Held {
    judges_time: bool,
}

/// How many run at the moment.
#[derive(Debug)]
struct Running {
    sharing: usize,
    judging_time: usize,
}

static RUNNING: Mutex<Running> = Mutex::new(Running {
    sharing: 0,
    judging_time: 0,
});
static CHANGED: Condvar = Condvar::new();

/// How long the machine is watched for what it leaves: some cycles of the slowest service.
const WATCHED: Duration = Duration::from_millis(500);
/// Less than this share of one processor unused is a machine whose processors are all asked for.
const UNUSED_MIN: f64 = 0.1;

/// Processor time that no program used, watched over [`WATCHED`] and longer.
struct Unused {
    /// When the watch began, and the idle time of all processors then (1/100 s).
    since: Option<(Instant, u64)>,
    is_none_left: bool,
}

static UNUSED: Mutex<Unused> = Mutex::new(Unused {
    since: None,
    // Until it was watched.
    is_none_left: true,
});

thread_local! {
    /// What the test of this thread holds, so that its second system needs no second permit: two tests that hold one each and want
    /// another would wait for ever.
    static MINE: RefCell<Weak<Held>> = const { RefCell::new(Weak::new()) };
}

/// Waits until there is room for one more test with real processes; returns at once if the calling thread holds a permit.
pub fn share() -> Permit {
    let mine = MINE.with_borrow(Weak::upgrade);
    let held = mine.unwrap_or_else(|| {
        let may_run = |running: &Running| running.judging_time == 0 && running.sharing < sharing_at_most();
        wait_until(may_run).sharing += 1;
        hold(false)
    });
    Permit { _held: held }
}

/// Waits until no other test runs real processes; none begins before this is dropped: beside a campaign of faults a line of 57600 bit/s
/// once had a gap of 0.8 s. Nobody is kept waiting for it: who shares goes first, so the machine is not idle while the last of several ends.
///
/// # Panics
/// If the calling thread shares already: it would wait for itself.
pub fn for_judging_time() -> Permit {
    let mine = MINE.with_borrow(Weak::upgrade);
    let held = mine.unwrap_or_else(|| {
        let may_run = |running: &Running| running.sharing == 0 && running.judging_time == 0;
        wait_until(may_run).judging_time += 1;
        hold(true)
    });
    assert!(held.judges_time, "a test that shares the machine judges no time");
    Permit { _held: held }
}

/// Three systems that fly compute for half of one core's time.
const PER_CORE: usize = 3;

/// As many as these cores fly; where other programs ask for all of their time, one per core has its share.
fn sharing_at_most() -> usize {
    match is_none_left() {
        true => cores(),
        false => PER_CORE * cores(),
    }
}

fn cores() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// Whether the processors had nothing left when they were watched last.
fn is_none_left() -> bool {
    let mut unused = UNUSED.lock().unwrap_or_else(PoisonError::into_inner);
    let Some(idle) = idle_ticks() else {
        return false;
    };
    let now = Instant::now();
    let (begin, before) = *unused.since.get_or_insert((now, idle));
    let watched_s = now.duration_since(begin).as_secs_f64();
    if watched_s >= WATCHED.as_secs_f64() {
        // `sysconf(_SC_CLK_TCK)` is 100 on Linux, whatever the kernel's own rate.
        let unused_s = idle.saturating_sub(before) as f64 / 100.0;
        *unused = Unused {
            since: Some((now, idle)),
            is_none_left: unused_s < UNUSED_MIN * watched_s,
        };
    }
    unused.is_none_left
}

/// The idle time of all processors since boot (1/100 s): fourth number of the first row of `/proc/stat` (proc(5)).
fn idle_ticks() -> Option<u64> {
    let stat = std::fs::read_to_string("/proc/stat").ok()?;
    stat.lines().next()?.split_whitespace().nth(4)?.parse().ok()
}

fn running() -> MutexGuard<'static, Running> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The condition is tried again after a while, too: what other programs leave changes without a notification.
fn wait_until(may_run: impl Fn(&Running) -> bool) -> MutexGuard<'static, Running> {
    let mut now = running();
    while !may_run(&now) {
        now = CHANGED
            .wait_timeout(now, WATCHED)
            .unwrap_or_else(PoisonError::into_inner)
            .0;
    }
    now
}

fn hold(judges_time: bool) -> Arc<Held> {
    let held = Arc::new(Held { judges_time });
    MINE.set(Arc::downgrade(&held));
    held
}

impl Drop for Held {
    fn drop(&mut self) {
        let mut running = running();
        match self.judges_time {
            true => running.judging_time -= 1,
            false => running.sharing -= 1,
        }
        CHANGED.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::{PER_CORE, cores, for_judging_time, running, share};
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// In one test, since all permits of a process are of one machine.
    #[test]
    fn many_share_or_one_judges_time() {
        let (sharing, judging) = (AtomicUsize::new(0), AtomicUsize::new(0));
        std::thread::scope(|scope| {
            for thread in 0..12 {
                let (sharing, judging) = (&sharing, &judging);
                scope.spawn(move || {
                    for turn in 0..50 {
                        if (thread + turn) % 6 == 0 {
                            let _permit = for_judging_time();
                            let _second = share();
                            assert_eq!(judging.fetch_add(1, Ordering::SeqCst), 0);
                            assert_eq!(sharing.load(Ordering::SeqCst), 0);
                            std::thread::yield_now();
                            judging.fetch_sub(1, Ordering::SeqCst);
                        } else {
                            let permit = share();
                            let second = share();
                            drop(permit);
                            assert!(sharing.fetch_add(1, Ordering::SeqCst) < PER_CORE * cores());
                            assert_eq!(judging.load(Ordering::SeqCst), 0);
                            std::thread::yield_now();
                            sharing.fetch_sub(1, Ordering::SeqCst);
                            drop(second);
                        }
                    }
                });
            }
        });
        let last = running();
        assert_eq!((last.sharing, last.judging_time), (0, 0));
    }
}
