//! What of the autopilot's parameters assisted flight depends on, asked for by name until it is answered.
//!
//! | autopilot | parameter | for |
//! |---|---|---|
//! | PX4 | `MAN_OVERRIDE_SPD`, in older versions `COM_RC_OVERRIDE` | sticks that move must not end OFFBOARD |
//! | ArduPilot | `RCMAP_*`; `RCn_MIN`, `_TRIM`, `_MAX`, `_REVERSED` of the four channels | what RC_CHANNELS means |

use super::sticks::{CHANNELS, RcAxis, RcCalibration};
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_mavlink_link::encoding::Encoding;
use jink_mavlink_link::fit::{OVERRIDE_BITS, OVERRIDE_IN_OFFBOARD, OVERRIDE_SPEED};
use jink_shared_types::Timestamp;
use mavlink::dialect::{MavAutopilot, MavMessage, PARAM_REQUEST_READ_DATA, PARAM_VALUE_DATA};

/// What PX4 is asked.
const PX4: [&str; 2] = [OVERRIDE_SPEED, OVERRIDE_BITS];
/// The channels of the sticks, in the order of [`RcCalibration`].
const MAPS: [&str; 4] = ["RCMAP_ROLL", "RCMAP_PITCH", "RCMAP_THROTTLE", "RCMAP_YAW"];
/// What ArduPilot keeps of each channel.
const ENDS: [&str; 4] = ["MIN", "TRIM", "MAX", "REVERSED"];
/// Pause between two questions (s).
const PAUSE_S: f64 = 0.05;
/// Pause between two rounds (s): longer than the way there and back on a slow line.
const ROUND_S: f64 = 1.0;
/// Rounds after which what PX4 has not answered does not exist in its version.
const ROUNDS: u32 = 5;

/// What is known so far.
#[derive(Clone, Debug, Default)]
pub struct AutopilotFacts {
    px4: [Option<f64>; PX4.len()],
    maps: [Option<f64>; MAPS.len()],
    /// By stick and end.
    ends: [[Option<f64>; ENDS.len()]; MAPS.len()],
    calibration: Option<RcCalibration>,
    next: usize,
    rounds: u32,
    due: Timestamp,
}

impl AutopilotFacts {
    /// Takes what the autopilot reports of a parameter.
    pub fn take(&mut self, autopilot: MavAutopilot, reported: &PARAM_VALUE_DATA) {
        let (Ok(name), Ok(value)) = (
            reported.param_id.to_str(),
            Encoding::of(autopilot).take(reported.param_type, reported.param_value),
        ) else {
            return;
        };
        if let Some(index) = PX4.iter().position(|known| *known == name) {
            self.px4[index] = Some(value);
        } else if let Some(stick) = MAPS.iter().position(|known| *known == name) {
            if self.maps[stick] != Some(value) {
                self.maps[stick] = Some(value);
                self.ends[stick] = [None; ENDS.len()];
            }
        } else if let Some((channel, end)) = name.strip_prefix("RC").and_then(|rest| rest.split_once('_')) {
            let end = ENDS.iter().position(|known| *known == end);
            let (Ok(channel), Some(end)) = (channel.parse::<usize>(), end) else {
                return;
            };
            for stick in 0..MAPS.len() {
                if self.channel(stick) == Some(channel) {
                    self.ends[stick][end] = Some(value);
                }
            }
        } else {
            return;
        }
        self.calibration = self.calibrate().or(self.calibration);
    }

    /// With the channels that the gateway before has read.
    pub fn with_calibration(calibration: Option<RcCalibration>) -> Self {
        Self {
            calibration,
            ..Self::default()
        }
    }

    /// The autopilot's channels, once all of them are known.
    pub fn calibration(&self) -> Option<&RcCalibration> {
        self.calibration.as_ref()
    }

    /// What keeps a pilot from being assisted by an autopilot of this make, in words for the text that says so.
    pub fn hindrance(&self, make: AutopilotType) -> Option<&'static str> {
        match make {
            AutopilotType::Px4 if self.px4[0].is_some_and(|speed| speed >= 0.0) => {
                Some("set MAN_OVERRIDE_SPD -1")
            }
            AutopilotType::Px4 if self.px4[1].is_some_and(|bits| bits as i64 & OVERRIDE_IN_OFFBOARD != 0) => {
                Some("COM_RC_OVERRIDE bit 1")
            }
            AutopilotType::ArduPilot if self.calibration.is_none() => Some("RC parameters not read"),
            AutopilotType::Px4 | AutopilotType::ArduPilot => None,
        }
    }

    /// The next question to the autopilot `target`, if one is due.
    pub fn question(&mut self, now: Timestamp, make: AutopilotType, target: (u8, u8)) -> Option<MavMessage> {
        if now < self.due || self.is_settled(make) {
            return None;
        }
        let (asked, name) = (self.next..Self::questions(make))
            .find_map(|question| Some((question, self.open_question(make, question)?)))
            .unzip();
        let Some(name) = name else {
            self.next = 0;
            self.rounds = self.rounds.saturating_add(1);
            self.due = now.plus_seconds(ROUND_S);
            return None;
        };
        self.next = asked.unwrap_or(0) + 1;
        self.due = now.plus_seconds(PAUSE_S);
        Some(MavMessage::PARAM_REQUEST_READ(PARAM_REQUEST_READ_DATA {
            param_index: -1,
            target_system: target.0,
            target_component: target.1,
            param_id: name.as_str().into(),
        }))
    }

    /// When [`Self::question`] has something to say next; `None`: nothing is open.
    pub fn next_wake(&self, make: AutopilotType) -> Option<Timestamp> {
        (!self.is_settled(make)).then_some(self.due)
    }

    /// What has kept a pilot from being assisted is asked for again: it may have been mended.
    pub fn ask_again(&mut self, now: Timestamp) {
        self.rounds = 0;
        self.due = now.plus_seconds(PAUSE_S);
        self.px4 = [None; PX4.len()];
    }

    fn is_settled(&self, make: AutopilotType) -> bool {
        match make {
            AutopilotType::Px4 => self.px4.iter().any(Option::is_some) || self.rounds >= ROUNDS,
            AutopilotType::ArduPilot => self.calibration.is_some(),
        }
    }

    fn questions(make: AutopilotType) -> usize {
        match make {
            AutopilotType::Px4 => PX4.len(),
            AutopilotType::ArduPilot => MAPS.len() * (1 + ENDS.len()),
        }
    }

    /// The name of the parameter behind `question`, if it is open and can be asked for by now.
    fn open_question(&self, make: AutopilotType, question: usize) -> Option<String> {
        if make == AutopilotType::Px4 {
            let is_open = self.px4.get(question)?.is_none();
            return is_open.then(|| PX4[question].to_owned());
        }
        let (stick, of_stick) = (question % MAPS.len(), question / MAPS.len());
        let Some(end) = of_stick.checked_sub(1) else {
            return self.maps[stick].is_none().then(|| MAPS[stick].to_owned());
        };
        let channel = self.channel(stick)?;
        self.ends[stick][end]
            .is_none()
            .then(|| format!("RC{channel}_{}", ENDS[end]))
    }

    fn channel(&self, stick: usize) -> Option<usize> {
        let channel = self.maps[stick]? as usize;
        (1..=CHANNELS).contains(&channel).then_some(channel)
    }

    fn calibrate(&self) -> Option<RcCalibration> {
        let axis = |stick: usize| {
            let [min_us, trim_us, max_us, reversed] = self.ends[stick];
            Some(RcAxis {
                channel: self.channel(stick)?,
                min_us: min_us?,
                trim_us: trim_us?,
                max_us: max_us?,
                is_reversed: reversed? != 0.0,
            })
        };
        Some(RcCalibration {
            axes: [axis(0)?, axis(1)?, axis(2)?, axis(3)?],
        })
    }
}

#[cfg(test)]
mod tests {
    use super::AutopilotFacts;
    use jink_mavlink_link::autopilot_type::AutopilotType;
    use jink_shared_types::Timestamp;
    use mavlink::dialect::{MavAutopilot, MavMessage, MavParamType, PARAM_VALUE_DATA};

    const COPTER: MavAutopilot = MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA;

    fn reported(name: &str, value: f32) -> PARAM_VALUE_DATA {
        PARAM_VALUE_DATA {
            param_id: name.into(),
            param_value: value,
            param_type: MavParamType::MAV_PARAM_TYPE_REAL32,
            ..PARAM_VALUE_DATA::default()
        }
    }

    /// Asks for 10 s of an autopilot that answers with `value` where it knows one.
    fn converse(
        facts: &mut AutopilotFacts,
        make: AutopilotType,
        value: impl Fn(&str) -> Option<f32>,
    ) -> Vec<String> {
        let mut asked = Vec::new();
        for i in 0..1000 {
            let now = Timestamp::from_seconds(10.0 + f64::from(i) * 0.01);
            if let Some(MavMessage::PARAM_REQUEST_READ(question)) = facts.question(now, make, (1, 1)) {
                let name = question.param_id.to_str().unwrap().to_owned();
                if let Some(value) = value(&name) {
                    facts.take(COPTER, &reported(&name, value));
                }
                asked.push(name);
            }
        }
        asked
    }

    #[test]
    fn the_channels_are_read_whichever_they_are_mapped_to() {
        let mut facts = AutopilotFacts::default();
        assert_eq!(
            facts.hindrance(AutopilotType::ArduPilot),
            Some("RC parameters not read")
        );
        let asked = converse(&mut facts, AutopilotType::ArduPilot, |name| {
            Some(match name {
                "RCMAP_ROLL" => 1.0,
                "RCMAP_PITCH" => 2.0,
                "RCMAP_THROTTLE" => 8.0,
                "RCMAP_YAW" => 4.0,
                "RC8_REVERSED" => 1.0,
                _ if name.ends_with("REVERSED") => 0.0,
                _ if name.ends_with("MIN") => 1000.0,
                _ if name.ends_with("MAX") => 2000.0,
                _ => 1500.0,
            })
        });
        assert_eq!(asked.len(), 20, "each once: {asked:?}");
        assert_eq!(facts.hindrance(AutopilotType::ArduPilot), None);
        let throttle = facts.calibration().unwrap().axes[2];
        assert_eq!((throttle.channel, throttle.is_reversed), (8, true));
    }

    #[test]
    fn a_px4_that_lets_sticks_end_offboard_hinders_and_one_that_says_nothing_does_not() {
        let mut facts = AutopilotFacts::default();
        let asked = converse(&mut facts, AutopilotType::Px4, |_| None);
        assert!(asked.len() <= 10, "it is given up: {asked:?}");
        assert_eq!(facts.hindrance(AutopilotType::Px4), None);
        for (name, value, hinders) in [
            ("MAN_OVERRIDE_SPD", 1.0, true),
            ("MAN_OVERRIDE_SPD", 0.0, true),
            ("MAN_OVERRIDE_SPD", -1.0, false),
            ("COM_RC_OVERRIDE", 1.0, false),
            ("COM_RC_OVERRIDE", 3.0, true),
        ] {
            let mut facts = AutopilotFacts::default();
            facts.take(COPTER, &reported(name, value));
            assert_eq!(
                facts.hindrance(AutopilotType::Px4).is_some(),
                hinders,
                "{name} = {value}"
            );
        }
    }
}
