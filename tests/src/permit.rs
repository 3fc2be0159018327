//! What tests of real processes may use of the machine: several run at once, and those that judge time alone.
//!
//! A system that flies waits most of its time, so some of them side by side do not disturb each other.
// A harness for tests: the locks hold counters that no panic leaves half written.

use std::cell::RefCell;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError, Weak};

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

thread_local! {
    /// What the test of this thread holds, so that its second system needs no second permit: two tests that hold one each and want
    /// another would wait for ever.
    static MINE: RefCell<Weak<Held>> = const { RefCell::new(Weak::new()) };
}

/// Waits until there is room for one more test with real processes; returns at once if the calling thread holds a permit.
pub fn share() -> Permit {
    let mine = MINE.with_borrow(Weak::upgrade);
    let held = mine.unwrap_or_else(|| {
        let most = sharing_at_most();
        let may_run = |running: &Running| running.judging_time == 0 && running.sharing < most;
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

/// Three times as many as there are cores compute for half of these cores' time.
fn sharing_at_most() -> usize {
    3 * std::thread::available_parallelism().map_or(1, usize::from)
}

fn running() -> MutexGuard<'static, Running> {
    RUNNING.lock().unwrap_or_else(PoisonError::into_inner)
}

fn wait_until(may_run: impl Fn(&Running) -> bool) -> MutexGuard<'static, Running> {
    CHANGED
        .wait_while(running(), |now| !may_run(now))
        .unwrap_or_else(PoisonError::into_inner)
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
    use super::{for_judging_time, running, share, sharing_at_most};
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
                            assert!(sharing.fetch_add(1, Ordering::SeqCst) < sharing_at_most());
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
