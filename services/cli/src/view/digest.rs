//! Pretty debug text with long lists cut: a sample with thousands of numbers on one screen.

use jink_shared_types::{STAGE_NAMES, SampleHeader};
use std::fmt;

/// Elements of a list that are shown.
const SHOWN: usize = 6;

/// A sample's header on one line: who, when, how old, and what each stage took of that (ms).
pub fn header_line(header: &SampleHeader) -> String {
    let mut line = format!(
        "start {}, sample {}, published {:?}",
        header.sequence >> 32,
        header.sequence & u64::from(u32::MAX),
        header.publish
    );
    if header.capture.is_set() {
        let age_ms = header.publish.seconds_since(header.capture) * 1e3;
        line += &format!(", captured {age_ms:.1} ms before");
    }
    let mut before = header.capture;
    for (name, stage) in STAGE_NAMES.iter().zip(&header.stages) {
        if stage.end.is_set() {
            line += &format!(", {name} {:.1} ms", stage.end.seconds_since(before) * 1e3);
            before = stage.end;
        }
    }
    line
}

/// Takes what `{:#?}` writes and leaves out what is in the middle of long lists.
#[derive(Debug, Default)]
pub struct Digest {
    full: bool,
    out: String,
    line: String,
    /// Open lists, innermost last: their indentation, and elements so far.
    lists: Vec<(usize, usize)>,
}

impl Digest {
    /// `full`: nothing is left out.
    pub fn new(full: bool) -> Self {
        Self {
            full,
            ..Self::default()
        }
    }

    /// The text.
    pub fn finish(mut self) -> String {
        if !self.line.is_empty() {
            self.end_line();
        }
        self.out
    }

    fn end_line(&mut self) {
        let line = std::mem::take(&mut self.line);
        let indent = line.len() - line.trim_start().len();
        // A line at a list's own indentation closes it.
        while let Some((opened_at, elements)) = self.lists.last().copied() {
            if indent > opened_at {
                break;
            }
            self.lists.pop();
            if elements > SHOWN && !self.hidden() {
                self.out.push_str(&format!(
                    "{}... {} more\n",
                    " ".repeat(opened_at + 4),
                    elements - SHOWN
                ));
            }
        }
        if let Some((opened_at, elements)) = self.lists.last_mut()
            && indent == *opened_at + 4
            && !matches!(line.trim_start().chars().next(), Some('}' | ')' | ']'))
        {
            *elements += 1;
        }
        if !self.hidden() {
            self.out.push_str(&line);
            self.out.push('\n');
        }
        if !self.full && line.ends_with('[') {
            self.lists.push((indent, 0));
        }
    }

    fn hidden(&self) -> bool {
        self.lists.iter().any(|(_, elements)| *elements > SHOWN)
    }
}

impl fmt::Write for Digest {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for piece in text.split_inclusive('\n') {
            match piece.strip_suffix('\n') {
                Some(end) => {
                    self.line.push_str(end);
                    self.end_line();
                }
                None => self.line.push_str(piece),
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{Digest, header_line};
    use jink_shared_types::{SampleHeader, StageTime, Timestamp};
    use std::fmt::Write;

    #[derive(Debug)]
    #[allow(dead_code)]
    struct Sample {
        name: &'static str,
        beams: Vec<f64>,
        points: Vec<(u8, u8)>,
        after: u8,
    }

    fn sample(n: usize) -> Sample {
        Sample {
            name: "front",
            beams: vec![1.5; n],
            points: vec![(1, 2); n],
            after: 7,
        }
    }

    fn text(n: usize, full: bool) -> String {
        let mut digest = Digest::new(full);
        writeln!(digest, "{:#?}", sample(n)).unwrap();
        digest.finish()
    }

    #[test]
    fn a_header_is_one_line() {
        let at = |ms: u64| Timestamp::from_ns(5_000_000_000 + ms * 1_000_000);
        let mut header = SampleHeader {
            sequence: 2 << 32 | 7,
            capture: at(0),
            publish: at(9),
            ..SampleHeader::default()
        };
        for (n, (begin, end)) in [(1, 3), (4, 9)].into_iter().enumerate() {
            header.stages[n] = StageTime {
                begin: at(begin),
                end: at(end),
            };
        }
        assert_eq!(
            header_line(&header),
            "start 2, sample 7, published 5.009000000 s, captured 9.0 ms before, sensor 3.0 ms, fusion 6.0 ms"
        );
    }

    #[test]
    fn short_lists_and_full_texts_are_what_debug_writes() {
        assert_eq!(text(6, false), format!("{:#?}\n", sample(6)));
        assert_eq!(text(100, true), format!("{:#?}\n", sample(100)));
    }

    #[test]
    fn of_a_long_list_the_beginning_is_shown_and_the_rest_counted() {
        let text = text(100, false);
        assert_eq!(text.matches("1.5,").count(), 6, "{text}");
        assert_eq!(text.matches("... 94 more\n").count(), 2, "{text}");
        assert!(text.ends_with("    after: 7,\n}\n"), "{text}");
    }
}
