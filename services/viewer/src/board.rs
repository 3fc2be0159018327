//! What the service and its readers share: the newest of every part of the page, once for all of them.
//!
//! The service replaces a part and goes on; a reader takes what it has not sent yet, in its own thread. Nobody waits for a reader: one that
//! is slow misses what was replaced meanwhile.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};
use tungstenite::Message;

/// Changes of parameters that wait for the service: more than people ask for in a cycle.
const CHANGES_MAX: usize = 8;

/// A part of the page, sent as a message of its own. The first byte of a binary one is its code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(usize)]
pub enum Part {
    /// Vehicle, plan, words: ten times a second.
    Scene = 0,
    /// What `jink status --json` prints.
    Status = 1,
    /// What was reported, the newest first.
    Events = 2,
    /// Every parameter.
    Parameters = 3,
    /// Where it has flown.
    Trail = 4,
    /// Occupied cells of the local map.
    Map = 5,
    /// Where what is known to be free borders on what is unknown.
    Border = 6,
    /// Points of the newest clouds.
    Cloud = 7,
    /// Occupied cells of the far map.
    Far = 8,
}

/// Number of [`Part`]s.
pub const PARTS: usize = 9;

impl Part {
    /// Those that a reader asks for, by their names in its message; the others are sent to everybody.
    pub const ON_REQUEST: [(&'static str, Self); 4] = [
        ("map", Self::Map),
        ("border", Self::Border),
        ("cloud", Self::Cloud),
        ("far", Self::Far),
    ];
}

/// A change of a parameter that somebody asks for.
#[derive(Debug)]
pub struct Change {
    /// The parameter.
    pub name: String,
    /// The value that is asked for.
    pub value: f64,
    /// Where the answer goes: the value in force, or why not.
    pub answer: SyncSender<Result<f64, String>>,
}

/// The newest of every part.
#[derive(Debug, Default)]
struct Posted {
    /// With the number of the post that it came with.
    parts: [Option<(u64, Message)>; PARTS],
    posts: u64,
    /// What `jink status --json` would print, with the number of its post.
    report: Option<(u64, Arc<Result<String, String>>)>,
    changes: VecDeque<Change>,
}

/// See the module.
#[derive(Debug, Default)]
pub struct Board {
    posted: Mutex<Posted>,
    posted_anew: Condvar,
    readers: AtomicUsize,
    wanted: [AtomicUsize; PARTS],
    report_asked: AtomicBool,
}

impl Board {
    fn lock(&self) -> MutexGuard<'_, Posted> {
        // What is in it is whole after any panic: messages are only replaced.
        self.posted.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Replaces a part.
    pub fn post(&self, part: Part, message: Message) {
        let mut posted = self.lock();
        posted.posts += 1;
        posted.parts[part as usize] = Some((posted.posts, message));
        drop(posted);
        self.posted_anew.notify_all();
    }

    /// Takes all parts away: they would be old for whoever comes next.
    pub fn clear(&self) {
        self.lock().parts = Default::default();
    }

    /// How many read now.
    pub fn readers(&self) -> usize {
        self.readers.load(Ordering::Relaxed)
    }

    /// Whether anybody wants a part.
    pub fn is_wanted(&self, part: Part) -> bool {
        self.wanted[part as usize].load(Ordering::Relaxed) > 0
    }

    /// Whether somebody waits for the report; asked once.
    pub fn report_is_asked(&self) -> bool {
        self.report_asked.load(Ordering::Relaxed)
    }

    /// Answers those who wait for the report.
    pub fn post_report(&self, report: Result<String, String>) {
        self.report_asked.store(false, Ordering::Relaxed);
        let mut posted = self.lock();
        posted.posts += 1;
        posted.report = Some((posted.posts, Arc::new(report)));
        drop(posted);
        self.posted_anew.notify_all();
    }

    /// The report as it is after now; `None` if the service does not answer within `patience`.
    pub fn report(&self, patience: Duration) -> Option<Arc<Result<String, String>>> {
        let end = Instant::now() + patience;
        let mut posted = self.lock();
        let before = posted.posts;
        self.report_asked.store(true, Ordering::Relaxed);
        loop {
            if let Some((_, report)) = posted.report.as_ref().filter(|(number, _)| *number > before) {
                return Some(Arc::clone(report));
            }
            let left = end.checked_duration_since(Instant::now())?;
            let woken = self.posted_anew.wait_timeout(posted, left);
            posted = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    /// Asks for a change; `None` if too many wait.
    pub fn ask(&self, name: String, value: f64) -> Option<Receiver<Result<f64, String>>> {
        let (answer, answered) = sync_channel(1);
        let mut posted = self.lock();
        if posted.changes.len() == CHANGES_MAX {
            return None;
        }
        posted.changes.push_back(Change { name, value, answer });
        Some(answered)
    }

    /// The next change that is asked for.
    pub fn next_change(&self) -> Option<Change> {
        self.lock().changes.pop_front()
    }

    /// A reader comes; `None` if there are `most` already.
    pub fn reader(self: &Arc<Self>, most: usize) -> Option<Reader> {
        let taken = self
            .readers
            .fetch_update(Ordering::Relaxed, Ordering::Relaxed, |readers| {
                (readers < most).then_some(readers + 1)
            });
        taken.ok().map(|_| Reader {
            board: Arc::clone(self),
            sent: [0; PARTS],
            wants: [false; PARTS],
        })
    }
}

/// One reader's side: what it has been sent, and what it wants.
#[derive(Debug)]
pub struct Reader {
    board: Arc<Board>,
    sent: [u64; PARTS],
    wants: [bool; PARTS],
}

impl Reader {
    /// Wants exactly these of the parts that are sent on request.
    pub fn want(&mut self, names: &[&str]) {
        for (name, part) in Part::ON_REQUEST {
            let (index, wants) = (part as usize, names.contains(&name));
            if std::mem::replace(&mut self.wants[index], wants) != wants {
                match wants {
                    true => self.board.wanted[index].fetch_add(1, Ordering::Relaxed),
                    false => self.board.wanted[index].fetch_sub(1, Ordering::Relaxed),
                };
            }
        }
    }

    /// What it has not been sent yet; waits so long for something.
    pub fn next(&mut self, patience: Duration) -> Vec<Message> {
        let board = Arc::clone(&self.board);
        let end = Instant::now() + patience;
        let mut posted = board.lock();
        loop {
            let mut fresh = Vec::new();
            for (index, part) in posted.parts.iter().enumerate() {
                let is_sent =
                    Part::ON_REQUEST.iter().all(|(_, part)| *part as usize != index) || self.wants[index];
                if let Some((number, message)) = part
                    .as_ref()
                    .filter(|(number, _)| is_sent && *number > self.sent[index])
                {
                    self.sent[index] = *number;
                    fresh.push(message.clone());
                }
            }
            let left = end.checked_duration_since(Instant::now());
            let Some(left) = left.filter(|_| fresh.is_empty()) else {
                return fresh;
            };
            let woken = board.posted_anew.wait_timeout(posted, left);
            posted = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
    }
}

impl Drop for Reader {
    fn drop(&mut self) {
        self.want(&[]);
        self.board.readers.fetch_sub(1, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::{Board, Part};
    use std::sync::Arc;
    use std::time::Duration;
    use tungstenite::Message;

    #[test]
    fn a_reader_gets_the_newest_of_each_part_once_and_what_it_asked_for() {
        let board = Arc::new(Board::default());
        let mut reader = board.reader(1).unwrap();
        assert!(board.reader(1).is_none(), "there is room for one");
        for text in ["old", "new"] {
            board.post(Part::Scene, Message::text(text));
            board.post(Part::Map, Message::text("map"));
        }
        let soon = Duration::from_millis(1);
        assert_eq!(reader.next(soon), [Message::text("new")]);
        assert!(reader.next(soon).is_empty());
        reader.want(&["map", "nonsense"]);
        assert!(board.is_wanted(Part::Map) && !board.is_wanted(Part::Far));
        assert_eq!(reader.next(soon), [Message::text("map")]);
        drop(reader);
        assert!(!board.is_wanted(Part::Map) && board.readers() == 0);
        assert!(board.reader(1).is_some());
    }
}
