//! Each link by itself: what it carries, what was left out, and who was refused.

use crate::figures::round;
use jink_shared_types::link::{CLASSES, LinkStatus, LinkTraffic};
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// One link since the gateway's start.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LinkFigures {
    /// Its name in the configuration; the first one is the autopilot's.
    pub name: String,
    /// Bytes sent.
    pub sent_bytes: u64,
    /// The same per second, on average (B/s); `None` if it is not known how long the gateway has been running.
    pub sent_bytes_per_s: Option<f64>,
    /// Messages of others that left here unchanged.
    pub forwarded: u64,
    /// Messages left out because the link is too slow, per class.
    pub dropped: BTreeMap<&'static str, u64>,
    /// Messages that were not let in.
    pub refused: Refused,
    /// Datagrams and connections of those who are not among the peers.
    pub unknown_peers: u64,
    /// Bytes that belonged to no message.
    pub garbage_bytes: u64,
    /// Times the link was opened again.
    pub reopened: u64,
    /// It is not open: its device is not there.
    pub is_waited_for: bool,
}

/// Messages that were not let in because of their signature, by cause.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Refused {
    /// The signature does not fit the key.
    pub wrong_signature: u64,
    /// Signed, but not newer than what was received.
    pub replayed: u64,
    /// Not signed where that is asked for.
    pub unsigned: u64,
}

impl LinkFigures {
    /// Of all links there are, if the gateway has been running for `uptime_s`.
    pub fn of(status: &LinkStatus, uptime_s: Option<f64>) -> Vec<Self> {
        let links = status.links.iter();
        links
            .filter(|link| !link.name.as_str().is_empty())
            .map(|link| Self::new(link, uptime_s))
            .collect()
    }

    fn new(link: &LinkTraffic, uptime_s: Option<f64>) -> Self {
        let sent_bytes = link.sent_bytes.iter().sum();
        Self {
            name: link.name.as_str().to_owned(),
            sent_bytes,
            sent_bytes_per_s: uptime_s
                .filter(|uptime_s| *uptime_s > 0.0)
                .map(|uptime_s| round(sent_bytes as f64 / uptime_s)),
            forwarded: link.forwarded,
            dropped: CLASSES.into_iter().zip(link.dropped).collect(),
            refused: Refused {
                wrong_signature: link.signature_refused,
                replayed: link.replayed,
                unsigned: link.unsigned_refused,
            },
            unknown_peers: link.unknown_peers,
            garbage_bytes: link.garbage_bytes,
            reopened: link.reopened,
            is_waited_for: link.is_waited_for.is_set(),
        }
    }

    /// Whether something was left out or not let in.
    fn has_trouble(&self) -> bool {
        self.dropped.values().any(|count| *count > 0)
            || self.refused != Refused::NOTHING
            || self.unknown_peers > 0
            || self.is_waited_for
    }

    /// For people: a line per link. Nothing if there is but one and all is well: the line of the autopilot says it all.
    pub fn lines(links: &[Self]) -> String {
        let mut out = String::new();
        if links.len() < 2 && !links.iter().any(Self::has_trouble) {
            return out;
        }
        let width = links.iter().map(|link| link.name.len()).max().unwrap_or(0);
        for link in links {
            // Writing into a string cannot fail.
            let _infallible = writeln!(out, "      {:<width$}  {}", link.name, link.line());
        }
        out
    }

    fn line(&self) -> String {
        let rate = match self.sent_bytes_per_s {
            Some(bytes_per_s) => format!("{bytes_per_s:.0} B/s sent since its start"),
            None => format!("{} bytes sent", self.sent_bytes),
        };
        // In the order of urgency, which the map of the JSON has lost.
        let dropped = CLASSES.map(|class| (self.dropped.get(class).copied().unwrap_or(0), class));
        let refused = [
            (self.refused.wrong_signature, "wrongly signed"),
            (self.refused.replayed, "played back"),
            (self.refused.unsigned, "unsigned"),
            (self.unknown_peers, "of unknown peers"),
        ];
        let parts = [
            counted("passed on", &[(self.forwarded, "")]),
            counted("left out", &dropped),
            counted("refused", &refused),
            counted("opened again", &[(self.reopened, "times")]),
        ];
        let waits = self
            .is_waited_for
            .then(|| "waiting for it: it cannot be opened".to_owned());
        waits
            .into_iter()
            .chain(std::iter::once(rate))
            .chain(parts.into_iter().flatten())
            .collect::<Vec<_>>()
            .join("; ")
    }
}

impl Refused {
    const NOTHING: Self = Self {
        wrong_signature: 0,
        replayed: 0,
        unsigned: 0,
    };
}

/// `refused 3 unsigned, 1 played back`: what has been counted at all; `None` if that is nothing.
fn counted(what: &str, counts: &[(u64, &str)]) -> Option<String> {
    let words: Vec<_> = counts
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, of)| format!("{count} {of}").trim_end().to_owned())
        .collect();
    (!words.is_empty()).then(|| format!("{what} {}", words.join(", ")))
}
