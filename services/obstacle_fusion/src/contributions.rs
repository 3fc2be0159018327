//! Which sensors contribute to the map.
//!
//! | in | out |
//! |---|---|
//! | capture times of frames, and of those with information | how many sensors send and how many are live, whether ranges are fresh |
//!
//! A sensor sends while its newest frame was captured within the sensor's own deadline, or that of its topic: in the open a
//! frame may be without information. A sensor is live while its newest contributing frame was. A frame contributes if at
//! least one ray had a result and a pose: a blind, covered or unplaceable sensor counts as none.
//!
//! Ranges are fresh if a live sensor has more than one beam, or if all configured sensors have a single beam and all of
//! them are live. Beside a lidar, an altimeter does not replace the directions of a silent lidar; on a vehicle equipped
//! with single beams only, each of them covers a direction of its own.

use jink_shared_types::Timestamp;
use jink_shared_types::clock::Order;

/// A frame may be captured this much after the `now` of the cycle that takes it (ms): a cycle reads the clock first and
/// its inputs later, and must not count a sensor as silent because its frame is newer.
const CYCLE_MS: f64 = 10.0;

#[derive(Clone, Copy)]
struct Contribution {
    /// Capture of the newest frame taken, whether it contributed or not.
    newest: Timestamp,
    /// Capture of the newest frame that contributed.
    contributed: Timestamp,
    deadline_ms: f64,
    single_beam: bool,
}

const SILENT: Contribution = Contribution {
    newest: Timestamp::NEVER,
    contributed: Timestamp::NEVER,
    deadline_ms: 0.0,
    single_beam: false,
};

impl Contribution {
    fn is_live(&self, now: Timestamp) -> bool {
        self.is_fresh(self.contributed, now)
    }

    fn sends(&self, now: Timestamp) -> bool {
        self.is_fresh(self.newest, now)
    }

    /// A capture later than `now` is not fresh but wrong, beyond [`CYCLE_MS`].
    fn is_fresh(&self, capture: Timestamp, now: Timestamp) -> bool {
        let age_ms = now.seconds_since(capture) * 1e3;
        capture.is_set() && (-CYCLE_MS..=self.deadline_ms).contains(&age_ms)
    }
}

/// All configured sensors.
pub(crate) struct Contributions {
    sensors: Vec<Contribution>,
}

impl Contributions {
    pub fn new(count: usize) -> Self {
        Self {
            sensors: vec![SILENT; count],
        }
    }

    /// No sensor has contributed to the map as it is now.
    pub fn forget_contributions(&mut self) {
        for sensor in &mut self.sensors {
            sensor.contributed = Timestamp::NEVER;
        }
    }

    /// Capture of the newest frame taken of `sensor`.
    pub fn newest(&self, sensor: usize) -> Timestamp {
        self.sensors
            .get(sensor)
            .map_or(Timestamp::NEVER, |sensor| sensor.newest)
    }

    /// Takes a frame of `sensor` captured at `capture`, the next of which is due after `deadline_ms`: `false` for a sensor that
    /// is not configured and for a frame that is not newer than the sensor's last, which would count its evidence twice.
    pub fn accept(&mut self, sensor: usize, capture: Timestamp, deadline_ms: f64) -> bool {
        let Some(sensor) = self.sensors.get_mut(sensor) else {
            return false;
        };
        if Order::judge(capture, sensor.newest) == Order::Late {
            return false;
        }
        (sensor.newest, sensor.deadline_ms) = (capture, deadline_ms);
        true
    }

    /// The accepted frame of `sensor` had information.
    pub fn contributed(&mut self, sensor: usize, single_beam: bool) {
        if let Some(sensor) = self.sensors.get_mut(sensor) {
            sensor.contributed = sensor.newest;
            sensor.single_beam = single_beam;
        }
    }

    /// How many sensors are live at `now`.
    pub fn live(&self, now: Timestamp) -> u16 {
        let live = self.sensors.iter().filter(|sensor| sensor.is_live(now)).count();
        u16::try_from(live).unwrap_or(u16::MAX)
    }

    /// How many sensors send at `now`, with or without information.
    pub fn sending(&self, now: Timestamp) -> u8 {
        let sending = self.sensors.iter().filter(|sensor| sensor.sends(now)).count();
        u8::try_from(sending).unwrap_or(u8::MAX)
    }

    /// Whether ranges are fresh at `now`; see the module's text for the rule.
    pub fn fresh(&self, now: Timestamp) -> bool {
        let mut live = self.sensors.iter().filter(|sensor| sensor.is_live(now));
        let all_single_and_live =
            !self.sensors.is_empty() && self.sensors.iter().all(|s| s.single_beam && s.is_live(now));
        live.any(|sensor| !sensor.single_beam) || all_single_and_live
    }
}

#[cfg(test)]
mod tests {
    use super::Contributions;
    use jink_shared_types::Timestamp;

    const DEADLINE_MS: f64 = 250.0;

    fn at(t_s: f64) -> Timestamp {
        Timestamp::from_seconds(10.0 + t_s)
    }

    fn contribute(sensors: &mut Contributions, sensor: usize, t_s: f64, single_beam: bool) {
        assert!(sensors.accept(sensor, at(t_s), DEADLINE_MS));
        sensors.contributed(sensor, single_beam);
    }

    #[test]
    fn a_sensor_expires_after_its_deadline() {
        let mut sensors = Contributions::new(2);
        assert!(!sensors.fresh(at(0.0)) && sensors.live(at(0.0)) == 0);
        contribute(&mut sensors, 1, 0.0, false);
        assert!(sensors.fresh(at(0.25)) && sensors.live(at(0.25)) == 1);
        assert!(!sensors.fresh(at(0.2501)) && sensors.live(at(0.2501)) == 0);
    }

    #[test]
    fn frames_without_information_are_sent_but_nothing_is_live() {
        let mut sensors = Contributions::new(2);
        contribute(&mut sensors, 0, 0.0, false);
        assert!(sensors.accept(0, at(0.2), DEADLINE_MS));
        let state = |t_s: f64| {
            (
                sensors.sending(at(t_s)),
                sensors.live(at(t_s)),
                sensors.fresh(at(t_s)),
            )
        };
        assert_eq!(state(0.25), (1, 1, true));
        assert_eq!(state(0.3), (1, 0, false));
        assert_eq!(state(0.46), (0, 0, false), "it is silent");
    }

    #[test]
    fn a_single_beam_does_not_vouch_for_a_silent_lidar() {
        let mut sensors = Contributions::new(2);
        contribute(&mut sensors, 0, 0.0, true);
        assert_eq!(sensors.live(at(0.1)), 1);
        assert!(!sensors.fresh(at(0.1)), "the other one has never published");
        contribute(&mut sensors, 1, 0.0, false);
        assert!(sensors.fresh(at(0.1)));
        contribute(&mut sensors, 0, 0.3, true);
        assert!(!sensors.fresh(at(0.3)), "the lidar has expired");
    }

    #[test]
    fn single_beams_alone_are_fresh_if_all_of_them_are() {
        let mut sensors = Contributions::new(2);
        contribute(&mut sensors, 0, 0.0, true);
        contribute(&mut sensors, 1, 0.1, true);
        assert!(sensors.fresh(at(0.2)));
        assert!(!sensors.fresh(at(0.3)), "the first has expired");
        assert!(!Contributions::new(0).fresh(at(0.0)));
    }

    #[test]
    fn a_frame_is_taken_once_and_in_order() {
        let mut sensors = Contributions::new(1);
        assert!(sensors.accept(0, at(0.1), DEADLINE_MS));
        assert!(!sensors.accept(0, at(0.1), DEADLINE_MS) && !sensors.accept(0, at(0.05), DEADLINE_MS));
        assert!(!sensors.accept(1, at(0.2), DEADLINE_MS), "not configured");
        assert!(!sensors.accept(0, Timestamp::NEVER, DEADLINE_MS));
    }

    #[test]
    fn a_frame_that_arrives_while_the_cycle_runs_is_fresh() {
        let mut sensors = Contributions::new(1);
        contribute(&mut sensors, 0, 0.005, false);
        assert!(sensors.fresh(at(0.0)));
        assert!(!sensors.fresh(at(-0.01)));
    }

    #[test]
    fn one_frame_from_the_future_does_not_silence_a_sensor() {
        let mut sensors = Contributions::new(1);
        contribute(&mut sensors, 0, 1e6, false);
        assert!(!sensors.fresh(at(0.0)), "the future is not fresh");
        contribute(&mut sensors, 0, 0.0, false);
        assert!(sensors.fresh(at(0.0)));
    }
}
