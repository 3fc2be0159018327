//! How often the frames of one sensor start a map: a sensor that sends too much must not take the processor from the
//! services that work on every map.

use jink_shared_types::Timestamp;
use jink_shared_types::ranges::SENSORS;

/// Frames of a sensor that come faster than this (s) share a map. Faster than any usable sensor sends whole frames; a
/// scan in many small parts may wait for so long.
const PERIOD_S: f64 = 0.01;

/// The frames of one sensor.
#[derive(Clone, Copy, Debug)]
struct SensorPace {
    /// The shortest time between two maps that it starts (s).
    period_s: f64,
    /// The last map that it started.
    last: Timestamp,
    /// It has sent something since.
    waits: bool,
}

/// The frames of every sensor.
#[derive(Clone, Debug)]
pub struct MapPace {
    sensors: [SensorPace; SENSORS],
}

impl MapPace {
    /// For sensors with these rates (Hz); zero where the table does not say. A sensor that is declared to send more than 50
    /// frames per second may start twice as many maps as it sends frames.
    pub fn new(rates_hz: &[f64; SENSORS]) -> Self {
        Self {
            sensors: rates_hz.map(|rate_hz| SensorPace {
                period_s: if rate_hz > 0.0 {
                    PERIOD_S.min(0.5 / rate_hz)
                } else {
                    PERIOD_S
                },
                last: Timestamp::NEVER,
                waits: false,
            }),
        }
    }

    /// A frame of sensor `number` is in the map; others than those in the table count for nothing.
    pub fn on_frame(&mut self, number: usize) {
        if let Some(sensor) = self.sensors.get_mut(number) {
            sensor.waits = true;
        }
    }

    /// When the next map is due for what has come; `None` if nothing has.
    pub fn due(&self) -> Option<Timestamp> {
        let waiting = self.sensors.iter().filter(|sensor| sensor.waits);
        waiting
            .map(|sensor| match sensor.last.is_set() {
                true => sensor.last.plus_seconds(sensor.period_s),
                false => Timestamp::NEVER,
            })
            .min()
    }

    /// A map with everything that has come is published at `now`.
    pub fn on_map(&mut self, now: Timestamp) {
        for sensor in self.sensors.iter_mut().filter(|sensor| sensor.waits) {
            sensor.waits = false;
            sensor.last = now;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::MapPace;
    use jink_shared_types::Timestamp;
    use jink_shared_types::ranges::SENSORS;

    /// The maps of a second in which sensor `n` sends a frame every `periods_ms[n]`, looked at every 0.1 ms, and the longest
    /// time (ms) that a frame waits for its map.
    fn maps(rates_hz: &[f64], periods_ms: &[f64]) -> (usize, f64) {
        let mut rates = [0.0; SENSORS];
        rates[..rates_hz.len()].copy_from_slice(rates_hz);
        let mut pace = MapPace::new(&rates);
        let (mut maps, mut waiting_since, mut longest_ms) = (0, None, 0.0f64);
        let mut next_ms: Vec<f64> = vec![0.0; periods_ms.len()];
        for tick in 0..10_000 {
            let at_ms = 0.1 * f64::from(tick);
            let now = Timestamp::from_seconds(100.0 + 1e-3 * at_ms);
            for (number, next) in next_ms.iter_mut().enumerate() {
                while *next <= at_ms + 1e-9 {
                    *next += periods_ms[number];
                    pace.on_frame(number);
                    waiting_since.get_or_insert(at_ms);
                }
            }
            if pace.due().is_some_and(|due| due <= now) {
                pace.on_map(now);
                maps += 1;
                longest_ms = longest_ms.max(at_ms - waiting_since.take().unwrap());
            }
        }
        (maps, longest_ms)
    }

    #[test]
    fn every_frame_of_a_usable_sensor_starts_a_map_at_once() {
        assert_eq!(maps(&[10.0], &[100.0]), (10, 0.0));
        assert_eq!(maps(&[0.0, 30.0], &[20.0, 33.0]).1, 0.0);
        let (fast, waits_ms) = maps(&[400.0], &[2.5]);
        assert_eq!((fast, waits_ms), (400, 0.0));
    }

    #[test]
    fn a_flood_starts_a_hundred_maps_per_second_and_holds_up_no_other_sensor() {
        let (alone, waits_ms) = maps(&[0.0], &[0.5]);
        assert!((95..=101).contains(&alone), "{alone}");
        assert!(waits_ms <= 10.1, "{waits_ms}");
        // The other's frames start their own maps, at 30 Hz.
        let (both, _) = maps(&[0.0, 30.0], &[0.5, 33.3]);
        assert!(both > alone && both <= alone + 31, "{both}");
    }

    #[test]
    fn nothing_is_due_without_a_frame_and_unknown_sensors_are_ignored() {
        let mut pace = MapPace::new(&[0.0; SENSORS]);
        pace.on_frame(SENSORS + 3);
        assert_eq!(pace.due(), None);
    }
}
