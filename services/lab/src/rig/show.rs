//! Progress: one line that is rewritten on a terminal, a plain line every few seconds elsewhere.

use jink_control::{say, sayln};
use std::io::{IsTerminal, Write};
use std::time::{Duration, Instant};

const PLAIN_PERIOD: Duration = Duration::from_secs(3);
const LIVE_PERIOD: Duration = Duration::from_millis(100);
const ERASE_LINE: &str = "\r\x1b[2K";

/// Where progress goes.
#[derive(Debug)]
pub struct Show {
    live: bool,
    silent: bool,
    shown: Option<Instant>,
}

impl Show {
    /// Rewrites one line if standard output is a terminal and nobody wants it plain.
    pub fn new(plain: bool) -> Self {
        Self {
            live: !plain && std::io::stdout().is_terminal(),
            silent: false,
            shown: None,
        }
    }

    /// Shows nothing.
    pub fn silent() -> Self {
        Self {
            silent: true,
            ..Self::new(true)
        }
    }

    /// Shows how it goes, if it is time to.
    pub fn progress(&mut self, line: impl FnOnce() -> String) {
        let period = if self.live { LIVE_PERIOD } else { PLAIN_PERIOD };
        if self.silent || self.shown.is_some_and(|shown| shown.elapsed() < period) {
            return;
        }
        self.shown = Some(Instant::now());
        if self.live {
            // A longer line would wrap, and only its last row would be rewritten.
            let text: String = line().chars().take(terminal_width() - 1).collect();
            say!("{ERASE_LINE}{text}");
            // A terminal that went away is noticed elsewhere.
            let _gone = std::io::stdout().flush();
        } else {
            sayln!("{}", line());
        }
    }

    /// Shows something that stays.
    pub fn update(&mut self, line: &str) {
        if self.silent {
            return;
        }
        if self.live {
            sayln!("{ERASE_LINE}{line}");
        } else {
            sayln!("{line}");
        }
    }

    /// Ends the line that is rewritten.
    pub fn finish(&mut self) {
        if self.live && self.shown.is_some() {
            sayln!();
        }
    }
}

/// Columns of the terminal; those of a plain one if it does not say.
fn terminal_width() -> usize {
    let size = rustix::termios::tcgetwinsize(std::io::stdout());
    size.map_or(80, |size| usize::from(size.ws_col)).max(2)
}
