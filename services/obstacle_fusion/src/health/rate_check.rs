//! Frames per second against the sensor's table.

use jink_shared_types::Timestamp;

/// Frames are counted for so long (s).
const WINDOW_S: f64 = 3.0;
/// A rate beyond these shares of that of the table is a fault, as in `jink check sensors`.
const SHARES: [f64; 2] = [0.5, 1.5];
/// Windows in a row that must be wrong.
const WINDOWS: u32 = 2;
/// A gap longer than this (s) is silence, which is reported otherwise.
const SILENCE_S: f64 = 1.0;

/// One sensor.
pub(super) struct RateCheck {
    /// That of the table (Hz); zero for none.
    table_hz: f64,
    begin: Timestamp,
    last: Timestamp,
    frames: u32,
    wrong: u32,
    wrong_hz: f64,
}

impl RateCheck {
    pub fn new(table_hz: f64) -> Self {
        Self {
            table_hz,
            begin: Timestamp::NEVER,
            last: Timestamp::NEVER,
            frames: 0,
            wrong: 0,
            wrong_hz: 0.0,
        }
    }

    /// Counts a frame captured at `capture`, later than the last. For a scan in parts (`is_part`) the table's rate is a
    /// lower bound.
    pub fn take(&mut self, capture: Timestamp, is_part: bool) {
        let gap_s = capture.seconds_since(self.last);
        let is_silent = gap_s > f64::max(SILENCE_S, 5.0 / self.table_hz.max(1e-3));
        if !self.last.is_set() || is_silent || capture < self.begin {
            self.begin = capture;
            self.frames = 0;
        } else {
            self.frames += 1;
        }
        self.last = capture;
        let span_s = capture.seconds_since(self.begin);
        if self.table_hz <= 0.0 || span_s < WINDOW_S {
            return;
        }
        let rate_hz = f64::from(self.frames) / span_s;
        let [least, most] = SHARES.map(|share| share * self.table_hz);
        let most = if is_part { f64::INFINITY } else { most };
        if (least..=most).contains(&rate_hz) {
            self.wrong = 0;
        } else {
            self.wrong += 1;
            self.wrong_hz = rate_hz;
        }
        self.begin = capture;
        self.frames = 0;
    }

    /// Measured and expected frames per second (Hz), if they differ.
    pub fn wrong_hz(&self) -> Option<[f64; 2]> {
        (self.wrong >= WINDOWS).then_some([self.wrong_hz, self.table_hz])
    }
}
