//! The front desk: what is kept to answer ground stations, besides flying.
//!
//! | kept | for |
//! |---|---|
//! | [`Parameters`] | PARAM_*; the values themselves are the parameter server's |
//! | [`FileServer`] | FILE_TRANSFER_PROTOCOL |
//! | [`BoardReading`] | ONBOARD_COMPUTER_STATUS |
//! | what the autopilot is and whether it is armed | the encoding of parameters, restarts |
//!
//! Nothing here is needed to fly, and nothing here is allowed to take anything from it: answers have a part of the outbox,
//! whatever comes in many pieces has a pace.

use crate::commands::Rhythm;
use crate::computer::{self, BoardReading};
use crate::files::FileServer;
use crate::parameters::Parameters;
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::ticker::Ticker;
use jink_shared_types::Timestamp;
use jink_shared_types::params::ParamSet;
use mavlink::dialects::ardupilotmega::{HEARTBEAT_DATA, MavMessage, MavModeFlag};

/// Rate of ONBOARD_COMPUTER_STATUS (Hz): 250 bytes that an autopilot may pass on to a radio, of figures that change slowly.
const COMPUTER_RATE_HZ: f64 = 0.2;
/// From the acknowledgement of a restart to the restart (s): the answer has left, and a vehicle that is armed right after it
/// is heard of.
const RESTART_AFTER_S: f64 = 0.5;

/// State of all that is asked for.
#[derive(Debug)]
pub struct Desk {
    /// The parameters.
    pub parameters: Parameters,
    /// The files.
    pub files: FileServer,
    /// A number of this board, 0 = unknown.
    pub board_id: u64,
    /// Whether the vehicle is armed, as far as it has said.
    pub armed: Option<bool>,
    board: Option<BoardReading>,
    computer: Option<Ticker>,
    restart_at: Option<Timestamp>,
}

impl Desk {
    /// With these parameters in force.
    pub fn new(params: &ParamSet) -> Self {
        Self {
            parameters: Parameters::new(params),
            files: FileServer::of(params),
            board_id: 0,
            armed: None,
            board: None,
            computer: Some(Ticker::new(COMPUTER_RATE_HZ)),
            restart_at: None,
        }
    }

    /// What our autopilot says of itself.
    pub fn hear_autopilot(&mut self, heartbeat: &HEARTBEAT_DATA) {
        self.parameters.speak(Encoding::of(heartbeat.autopilot));
        let flag = MavModeFlag::MAV_MODE_FLAG_SAFETY_ARMED;
        self.armed = Some(heartbeat.base_mode.contains(flag));
    }

    /// A new reading of the board.
    pub fn notice_board(&mut self, reading: BoardReading) {
        self.board = Some(reading);
    }

    /// Changes the rhythm of ONBOARD_COMPUTER_STATUS.
    pub fn set_computer_rhythm(&mut self, rhythm: Rhythm) {
        self.computer = match rhythm {
            Rhythm::Usual => Some(Ticker::new(COMPUTER_RATE_HZ)),
            Rhythm::Period(period_s) => Some(Ticker::new(1.0 / period_s)),
            Rhythm::Silent => None,
        };
    }

    /// Period of ONBOARD_COMPUTER_STATUS (s); `None` = silent.
    pub fn computer_period_s(&self) -> Option<f64> {
        self.computer.map(|ticker| ticker.period_s())
    }

    /// ONBOARD_COMPUTER_STATUS, as far as the board is known.
    pub fn computer(&self, now: Timestamp) -> Option<MavMessage> {
        self.board.as_ref().map(|board| computer::message(now, board))
    }

    /// The same, if it is due.
    pub fn computer_due(&mut self, now: Timestamp) -> Option<MavMessage> {
        self.board?;
        self.computer.as_mut()?.take(now).then(|| self.computer(now))?
    }

    /// Plans a restart.
    pub fn restart(&mut self, now: Timestamp) {
        self.restart_at = Some(now.plus_seconds(RESTART_AFTER_S));
    }

    /// Whether one is planned.
    pub fn is_restarting(&self) -> bool {
        self.restart_at.is_some()
    }

    /// Whether it is due; a vehicle that was armed meanwhile keeps its gateway.
    pub fn restart_due(&mut self, now: Timestamp) -> bool {
        if self.restart_at.is_none_or(|due| now < due) {
            return false;
        }
        self.restart_at = None;
        self.armed == Some(false)
    }

    /// When something is due next.
    pub fn next_wake(&self) -> Timestamp {
        let mut wake = Timestamp::from_ns(u64::MAX);
        if let (Some(_), Some(computer)) = (&self.board, &self.computer) {
            wake = wake.min(computer.due());
        }
        for due in [
            self.parameters.next_wake(),
            self.files.next_wake(),
            self.restart_at,
        ]
        .into_iter()
        .flatten()
        {
            wake = wake.min(due);
        }
        wake
    }
}
