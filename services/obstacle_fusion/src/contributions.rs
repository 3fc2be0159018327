//! Which sensors contribute to the map.
//!
//! | in | out |
//! |---|---|
//! | capture times of frames with information | how many sensors are live, whether ranges are fresh |
//!
//! A sensor is live while its newest contributing frame was captured within the sensor's own deadline, or that of its
//! topic. A frame contributes if at least one ray had a result and a pose: a blind, covered or unplaceable sensor
//! counts as none.
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
    /// A capture later than `now` is not fresh but wrong, beyond [`CYCLE_MS`].
    fn is_live(&self, now: Timestamp) -> bool {
        let age_ms = now.seconds_since(self.contributed) * 1e3;
        self.contributed.is_set() && (-CYCLE_MS..=self.deadline_ms).contains(&age_ms)
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

    /// Takes a frame of `sensor` captured at `capture`: `false` for a sensor that is not configured and for a frame
    /// that is not newer than the sensor's last, which would count its evidence twice.
    pub fn accept(&mut self, sensor: usize, capture: Timestamp) -> bool {
        let Some(sensor) = self.sensors.get_mut(sensor) else {
            return false;
        };
        if Order::judge(capture, sensor.newest) == Order::Late {
            return false;
        }
        sensor.newest = capture;
        true
    }

    /// The accepted frame of `sensor` had information.
    pub fn contributed(&mut self, sensor: usize, single_beam: bool, deadline_ms: f64) {
        if let Some(sensor) = self.sensors.get_mut(sensor) {
            sensor.contributed = sensor.newest;
            sensor.single_beam = single_beam;
            sensor.deadline_ms = deadline_ms;
        }
    }

    /// How many sensors are live at `now`.
    pub fn live(&self, now: Timestamp) -> u16 {
        let live = self.sensors.iter().filter(|sensor| sensor.is_live(now)).count();
        u16::try_from(live).unwrap_or(u16::MAX)
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
        assert!(sensors.accept(sensor, at(t_s)));
        sensors.contributed(sensor, single_beam, DEADLINE_MS);
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
        assert!(sensors.accept(0, at(0.1)));
        assert!(!sensors.accept(0, at(0.1)) && !sensors.accept(0, at(0.05)));
        assert!(!sensors.accept(1, at(0.2)), "not configured");
        assert!(!sensors.accept(0, Timestamp::NEVER));
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
