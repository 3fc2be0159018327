//! Ranges that come over MAVLink: an autopilot's rangefinders, and what another component sees around the vehicle.
//!
//! | message | sensor of the configuration | becomes |
//! |---|---|---|
//! | DISTANCE_SENSOR of the autopilot | `kind = "autopilot_rangefinder"`, by its `id` | a single beam |
//! | OBSTACLE_DISTANCE of anybody on the vehicle | `kind = "obstacle_distance"`, by its `component` | a row of level distances |
//!
//! What is made of each reading is in [`jink_shared_types::beams`]. Ranges are dated to their arrival: DISTANCE_SENSOR has the autopilot's
//! boot time, but the measurement is as old as the sensor behind it, which nobody reports; CP_DELAY and GD_DELAY allow
//! for it.

use jink_mavlink_link::message::COMPONENT_AVOIDANCE;
use jink_runtime::config::sensor_table::Told;
use jink_shared_types::beams::{BeamReading, BeamRefused, ObstacleDistance};
use jink_shared_types::ranges::{RangeScan, ScanFrame};
use jink_shared_types::suggestion::{DidYouMean, nearest};
use jink_shared_types::{BodyFrd, Point, Timestamp};
use mavlink::dialect::{DISTANCE_SENSOR_DATA, MavFrame, OBSTACLE_DISTANCE_DATA};
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::collections::BTreeMap;
use std::fmt;

/// The kinds of sensors that come this way.
pub const RANGEFINDER: &str = "autopilot_rangefinder";
/// As [`RANGEFINDER`].
pub const ROW: &str = "obstacle_row";
/// Scans that one step may bring: as many as sensors may be configured.
pub const SCANS: usize = 16;
/// DISTANCE_SENSOR is asked for this often (Hz).
const RATE_HZ: f64 = 20.0;

/// The keys of such sensors.
const KEYS: [&str; 7] = [
    "name",
    "kind",
    "id",
    "component",
    "forward_m",
    "right_m",
    "down_m",
];

/// A `[[sensor]]` table as written, of any kind.
#[derive(Debug, Default, Deserialize)]
pub struct SensorTable {
    /// Its name: the last part of its topic.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// The `id` in DISTANCE_SENSOR.
    pub id: Option<u8>,
    /// The component that sends the OBSTACLE_DISTANCE.
    pub component: Option<u8>,
    /// Where it sits in the body, forward (m).
    #[serde(default)]
    pub forward_m: f64,
    /// Right (m).
    #[serde(default)]
    pub right_m: f64,
    /// Down (m).
    #[serde(default)]
    pub down_m: f64,
    /// Keys of other kinds.
    #[serde(flatten)]
    pub others: BTreeMap<String, IgnoredAny>,
}

/// Why such a sensor is refused.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Mistake {
    /// A key that it must have.
    Missing {
        /// Name of the sensor.
        sensor: String,
        /// Its kind.
        kind: &'static str,
        /// The key, and what it is.
        key: &'static str,
    },
    /// A key that it does not have.
    Unknown {
        /// Name of the sensor.
        sensor: String,
        /// Its kind.
        kind: &'static str,
        /// The key.
        key: String,
    },
    /// The rows are those that jink sends itself.
    Ours {
        /// Name of the sensor.
        sensor: String,
    },
    /// More than there may be.
    TooMany,
}

impl Mistake {
    /// The key that it is about, and the sentence.
    pub fn told(&self) -> Told {
        let key = match self {
            Self::Missing { key, .. } => key.split(',').next().map(str::to_owned),
            Self::Unknown { key, .. } => Some(key.clone()),
            Self::Ours { .. } => Some("component".to_owned()),
            Self::TooMany => None,
        };
        (key, self.to_string())
    }
}

impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Missing { sensor, kind, key } => write!(f, "sensor \"{sensor}\": an {kind} needs {key}"),
            Self::Unknown { sensor, kind, key } => {
                let near = DidYouMean(nearest(key, KEYS.into_iter()).filter(|near| near != key));
                write!(f, "sensor \"{sensor}\": an {kind} has no {key}{near}")
            }
            Self::Ours { sensor } => write!(
                f,
                "sensor \"{sensor}\": component = {COMPONENT_AVOIDANCE} is jink itself: it would see what it says"
            ),
            Self::TooMany => write!(f, "more than {SCANS} sensors come over MAVLink"),
        }
    }
}
impl std::error::Error for Mistake {}

/// Whose messages are taken.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum From {
    /// The autopilot's rangefinder of this `id`.
    Rangefinder(u8),
    /// This component.
    Component(u8),
}

#[derive(Clone, Debug)]
struct Source {
    name: String,
    from: From,
    position: Point<BodyFrd>,
}

impl SensorTable {
    /// What it says; `None` if its data come another way.
    fn source(&self) -> Option<Result<Source, Mistake>> {
        let (kind, of_the_other) = match self.kind.as_str() {
            RANGEFINDER => (RANGEFINDER, ("component", self.component)),
            ROW => (ROW, ("id", self.id)),
            _ => return None,
        };
        Some(self.check(kind, of_the_other))
    }

    fn check(&self, kind: &'static str, of_the_other: (&str, Option<u8>)) -> Result<Source, Mistake> {
        let sensor = self.name.clone();
        let of_the_other = of_the_other.1.map(|_| of_the_other.0.to_owned());
        if let Some(key) = of_the_other.or_else(|| self.others.keys().next().cloned()) {
            return Err(Mistake::Unknown { sensor, kind, key });
        }
        let missing = |key| Mistake::Missing {
            sensor: sensor.clone(),
            kind,
            key,
        };
        let from = if kind == RANGEFINDER {
            From::Rangefinder(
                self.id
                    .ok_or_else(|| missing("id, that of its DISTANCE_SENSOR"))?,
            )
        } else {
            let component = self.component.filter(|component| *component > 0);
            From::Component(component.ok_or_else(|| missing("component, who sends its OBSTACLE_DISTANCE"))?)
        };
        if from == From::Component(COMPONENT_AVOIDANCE) {
            return Err(Mistake::Ours { sensor });
        }
        Ok(Source {
            name: sensor,
            from,
            position: Point::new(self.forward_m, self.right_m, self.down_m),
        })
    }
}

/// A scan that has come.
#[derive(Clone, Debug)]
pub struct Arrived {
    /// Number of its sensor, in the order of the configuration.
    pub source: usize,
    /// When.
    pub at: Timestamp,
    /// It.
    pub scan: RangeScan,
}

/// The sensors that come over MAVLink.
#[derive(Clone, Debug, Default)]
pub struct RangeSources {
    sources: Vec<Source>,
}

impl RangeSources {
    /// Those among `tables` that do.
    ///
    /// # Errors
    /// The first [`Mistake`] found.
    pub fn new(tables: &[SensorTable]) -> Result<Self, Mistake> {
        let sources: Vec<Source> = tables
            .iter()
            .filter_map(SensorTable::source)
            .collect::<Result<_, _>>()?;
        if sources.len() > SCANS {
            return Err(Mistake::TooMany);
        }
        Ok(Self { sources })
    }

    /// Their names, in the order of their numbers.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.sources.iter().map(|source| source.name.as_str())
    }

    /// How often the autopilot is to report its rangefinders (Hz), if one of them is ours.
    pub fn rate_hz(&self) -> Option<f64> {
        let is_beam = |source: &Source| matches!(source.from, From::Rangefinder(_));
        self.sources.iter().any(is_beam).then_some(RATE_HZ)
    }

    fn find(&self, from: From) -> Option<(usize, &Source)> {
        let mut sources = self.sources.iter().enumerate();
        sources.find(|(_, source)| source.from == from)
    }

    /// Takes a reading of one of the autopilot's rangefinders; `None` if it is not configured.
    ///
    /// # Errors
    /// [`BeamRefused`] if it is not known where it looks, or how far.
    pub fn take_beam(
        &self,
        message: &DISTANCE_SENSOR_DATA,
        at: Timestamp,
    ) -> Option<Result<Arrived, BeamRefused>> {
        let (number, source) = self.find(From::Rangefinder(message.id))?;
        let metres = |cm: u16| f32::from(cm) * 0.01;
        let reading = BeamReading {
            range_min_m: metres(message.min_distance),
            range_max_m: metres(message.max_distance),
            range_m: metres(message.current_distance),
            // 0 = not known, 1 = none: as PX4's receiver has it.
            quality: match message.signal_quality {
                0 => -1,
                1 => 0,
                percent => i8::try_from(percent).unwrap_or(100),
            },
            orientation: message.orientation as u8,
            opening_rad: message.horizontal_fov,
            quaternion: message.quaternion,
        };
        let mut scan = RangeScan::default();
        let written = reading.write(&mut scan);
        scan.origin = source.position;
        Some(written.map(|()| Arrived {
            source: number,
            at,
            scan,
        }))
    }

    /// Takes a row of distances from `component`; `None` if that is not configured, or its frame is none that is known.
    ///
    /// # Errors
    /// [`BeamRefused`] if its angles are none.
    pub fn take_row(
        &self,
        component: u8,
        message: &OBSTACLE_DISTANCE_DATA,
        at: Timestamp,
    ) -> Option<Result<Arrived, BeamRefused>> {
        let (source, _) = self.find(From::Component(component))?;
        let frame = match message.frame {
            MavFrame::MAV_FRAME_BODY_FRD => ScanFrame::Level,
            MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_LOCAL_NED => ScanFrame::North,
            _ => return None,
        };
        let row = ObstacleDistance {
            frame,
            // The finer one counts, if it is given.
            increment_deg: if message.increment_f > 0.0 {
                message.increment_f
            } else {
                f32::from(message.increment)
            },
            offset_deg: message.angle_offset,
            min_cm: message.min_distance,
            max_cm: message.max_distance,
            distances_cm: message.distances,
        };
        let mut scan = RangeScan::default();
        Some(row.write(&mut scan).map(|()| Arrived { source, at, scan }))
    }
}

#[cfg(test)]
mod tests {
    use super::{RANGEFINDER, ROW, RangeSources, SensorTable};
    use jink_shared_types::Timestamp;
    use jink_shared_types::ranges::ScanFrame;
    use mavlink::dialect::{DISTANCE_SENSOR_DATA, MavFrame, MavSensorOrientation, OBSTACLE_DISTANCE_DATA};

    fn table(name: &str, kind: &str) -> SensorTable {
        SensorTable {
            name: name.to_owned(),
            kind: kind.to_owned(),
            ..SensorTable::default()
        }
    }

    fn front() -> SensorTable {
        SensorTable {
            id: Some(3),
            forward_m: 0.2,
            ..table("front", RANGEFINDER)
        }
    }

    fn other(component: u8) -> SensorTable {
        SensorTable {
            component: Some(component),
            ..table("other", ROW)
        }
    }

    fn sources() -> RangeSources {
        RangeSources::new(&[table("lidar", "lidar_3d"), front(), other(195)]).unwrap()
    }

    #[test]
    fn a_mistake_is_named() {
        let said = |table: SensorTable| RangeSources::new(&[table]).unwrap_err().to_string();
        assert_eq!(
            said(table("front", RANGEFINDER)),
            "sensor \"front\": an autopilot_rangefinder needs id, that of its DISTANCE_SENSOR"
        );
        assert_eq!(
            said(SensorTable {
                component: Some(1),
                ..front()
            }),
            "sensor \"front\": an autopilot_rangefinder has no component"
        );
        assert_eq!(
            said(other(0)),
            "sensor \"other\": an obstacle_row needs component, who sends its OBSTACLE_DISTANCE"
        );
        assert!(said(other(196)).contains("is jink itself"));
        assert_eq!(sources().rate_hz(), Some(20.0));
        assert_eq!(RangeSources::new(&[other(195)]).unwrap().rate_hz(), None);
    }

    fn beam(id: u8, current_cm: u16, signal_quality: u8) -> DISTANCE_SENSOR_DATA {
        DISTANCE_SENSOR_DATA {
            id,
            min_distance: 20,
            max_distance: 800,
            current_distance: current_cm,
            orientation: MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_90,
            horizontal_fov: 0.1,
            signal_quality,
            ..DISTANCE_SENSOR_DATA::default()
        }
    }

    #[test]
    fn a_configured_rangefinder_becomes_a_beam_and_others_are_passed_over() {
        let now = Timestamp::from_seconds(5.0);
        let sources = sources();
        assert_eq!(sources.names().collect::<Vec<_>>(), ["front", "other"]);
        assert!(sources.take_beam(&beam(4, 300, 0), now).is_none());
        let arrived = sources.take_beam(&beam(3, 300, 0), now).unwrap().unwrap();
        assert_eq!((arrived.source, arrived.at, arrived.scan.beams), (0, now, 1));
        assert_eq!((arrived.scan.range_m[0], arrived.scan.origin.x_m), (3.0, 0.2));
        let far = sources.take_beam(&beam(3, 800, 0), now).unwrap().unwrap();
        assert_eq!(far.scan.range_m[0], f32::INFINITY);
        let mut down = beam(3, 300, 0);
        down.orientation = MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270;
        assert!(sources.take_beam(&down, now).unwrap().is_err());
    }

    #[test]
    fn a_row_is_level_and_the_finer_increment_counts() {
        let now = Timestamp::from_seconds(5.0);
        let row = OBSTACLE_DISTANCE_DATA {
            min_distance: 20,
            max_distance: 1000,
            increment: 5,
            increment_f: 10.0,
            distances: [400; 72],
            frame: MavFrame::MAV_FRAME_BODY_FRD,
            ..OBSTACLE_DISTANCE_DATA::default()
        };
        let sources = sources();
        assert!(sources.take_row(196, &row, now).is_none());
        let arrived = sources.take_row(195, &row, now).unwrap().unwrap();
        assert_eq!((arrived.source, arrived.scan.beams), (1, 36));
        assert_eq!(arrived.scan.frame.get(), ScanFrame::Level);
        let odd = OBSTACLE_DISTANCE_DATA {
            frame: MavFrame::MAV_FRAME_MISSION,
            ..row
        };
        assert!(sources.take_row(195, &odd, now).is_none());
    }
}
