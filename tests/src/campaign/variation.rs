//! What is varied from flight to flight while everything else stays: an ablation.

use super::Cell;
use crate::lockstep::{FlightSetup, FrameDelay};
use jink_shared_types::params::{OA_TRK_CUT, OA_TRK_OVER};
use serde::{Deserialize, Serialize};
use std::fmt;

/// A quantity that can be varied.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantity {
    /// Highest speed (m/s).
    Speed,
    /// Range of every sensor (m).
    Range,
    /// From the capture of a frame to its publication (ms).
    Latency,
    /// Tracking error that plans assume, over that of the profile (1): not below 1, since nobody follows more closely than was
    /// measured.
    Tube,
}

impl Quantity {
    const ALL: [Self; 4] = [Self::Speed, Self::Range, Self::Latency, Self::Tube];

    /// Its name in arguments.
    pub fn name(self) -> &'static str {
        match self {
            Self::Speed => "speed",
            Self::Range => "range",
            Self::Latency => "latency",
            Self::Tube => "tube",
        }
    }

    /// Its unit; empty if it has none.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Speed => "m/s",
            Self::Range => "m",
            Self::Latency => "ms",
            Self::Tube => "",
        }
    }

    /// What is varied, in words.
    pub fn words(self) -> &'static str {
        match self {
            Self::Speed => "highest speed",
            Self::Range => "range of the sensors",
            Self::Latency => "latency of the sensors",
            Self::Tube => "tracking error over that of the profile",
        }
    }

    /// The values that can be flown.
    fn range(self) -> std::ops::RangeInclusive<f64> {
        match self {
            Self::Speed => 0.3..=20.0,
            Self::Range => 0.5..=100.0,
            Self::Latency => 0.0..=1_000.0,
            Self::Tube => 1.0..=5.0,
        }
    }
}

/// A quantity with its value.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Variation {
    /// What is varied.
    pub quantity: Quantity,
    /// Its value, in its unit.
    pub value: f64,
}

impl fmt::Display for Variation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (name, unit) = (self.quantity.name(), self.quantity.unit());
        let space = if unit.is_empty() { "" } else { " " };
        write!(f, "{name} {}{space}{unit}", self.value)
    }
}

/// The values of one quantity that are flown one after the other, as in `range=2,4,8`.
#[derive(Clone, Debug, PartialEq)]
pub struct Variations {
    /// What is varied.
    pub quantity: Quantity,
    /// Its values, in its unit.
    pub values: Vec<f64>,
}

impl std::str::FromStr for Variations {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let (name, values) = text
            .split_once('=')
            .ok_or_else(|| format!("{text:?}: expected NAME=VALUE,VALUE,..."))?;
        let mut all = Quantity::ALL.into_iter();
        let quantity = all.find(|quantity| quantity.name() == name).ok_or_else(|| {
            let known = Quantity::ALL.map(Quantity::name).join(", ");
            format!("{name:?} cannot be varied: {known}")
        })?;
        let range = quantity.range();
        let value = |text: &str| {
            let value = text.parse::<f64>().ok().filter(|value| range.contains(value));
            value.ok_or_else(|| format!("{name} {text:?}: not from {} to {}", range.start(), range.end()))
        };
        let values = values.split(',').map(value).collect::<Result<Vec<_>, _>>()?;
        Ok(Self { quantity, values })
    }
}

impl Variations {
    /// `cells` once with every value.
    pub fn of(&self, cells: &[Cell]) -> Vec<Cell> {
        let with = |cell: &Cell, value: f64| {
            let mut cell = cell.clone();
            if self.quantity == Quantity::Speed {
                cell.speed_mps = value;
            }
            cell.variation = Some(Variation {
                quantity: self.quantity,
                value,
            });
            cell
        };
        cells
            .iter()
            .flat_map(|cell| self.values.iter().map(|value| with(cell, *value)))
            .collect()
    }
}

impl Variation {
    /// What of it is part of the set-up.
    ///
    /// # Errors
    /// A text naming the parameter that has no such value.
    pub fn prepare(self, setup: &mut FlightSetup) -> Result<(), String> {
        match self.quantity {
            Quantity::Speed | Quantity::Latency => {}
            Quantity::Range => setup
                .sensors
                .iter_mut()
                .for_each(|sensor| sensor.range_max_m = Some(self.value)),
            Quantity::Tube => {
                let followed = setup.profile.tracking();
                let figures = [
                    (OA_TRK_CUT.name, followed.cut_s2),
                    (OA_TRK_OVER.name, followed.overshoot_s2),
                ];
                for (name, figure) in figures {
                    let set = setup.params.set(name, self.value * figure);
                    set.map_err(|error| error.to_string())?;
                }
            }
        }
        Ok(())
    }

    /// How long frames are under way, if that is what is varied.
    pub fn frame_delay(self) -> Option<FrameDelay> {
        (self.quantity == Quantity::Latency).then_some(FrameDelay {
            delay_s: 1e-3 * self.value,
            is_stamped_on_arrival: false,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::{Quantity, Variations};
    use crate::campaign::{Cell, setup};
    use crate::pairing::PX4_CURRENT;
    use jink_shared_types::params::{OA_SPD_MAX, OA_TRK_CUT};
    use jink_shared_types::tracking::Tracking;

    #[test]
    fn values_are_read_and_wrong_ones_are_named() {
        let range: Variations = "range=2,4.5".parse().unwrap();
        assert_eq!(
            (range.quantity, &range.values[..]),
            (Quantity::Range, &[2.0, 4.5][..])
        );
        for (text, error) in [
            ("range", "\"range\": expected NAME=VALUE,VALUE,..."),
            ("mass=2", "\"mass\" cannot be varied: speed, range, latency, tube"),
            ("tube=1,0.5", "tube \"0.5\": not from 1 to 5"),
            ("speed=", "speed \"\": not from 0.3 to 20"),
            ("latency=1,NaN", "latency \"NaN\": not from 0 to 1000"),
        ] {
            assert_eq!(text.parse::<Variations>().unwrap_err(), error);
        }
    }

    #[test]
    fn what_is_varied_is_what_is_flown() {
        let flown = |text: &str| {
            let variations: Variations = text.parse().unwrap();
            let cells = variations.of(&[Cell::forest().unwrap()]);
            assert_eq!(cells.len(), 1);
            let mut setup = PX4_CURRENT.fly(setup(&cells[0], 1).unwrap()).unwrap();
            let variation = cells[0].variation.unwrap();
            variation.prepare(&mut setup).unwrap();
            (setup, variation)
        };
        let (fast, _) = flown("speed=7");
        assert_eq!(fast.params.get(&OA_SPD_MAX), 7.0);
        let (near, _) = flown("range=2.5");
        assert!(near.sensors.iter().all(|sensor| sensor.range_max_m == Some(2.5)));
        let (wide, _) = flown("tube=2");
        let cut_s2 = 2.0 * Tracking::PX4_OFFBOARD.cut_s2;
        assert_eq!(wide.params.get(&OA_TRK_CUT), cut_s2);
        let (_, late) = flown("latency=150");
        assert_eq!(late.frame_delay().unwrap().delay_s, 0.15);
    }
}
