//! The parameter table. What a user may tune stands here and nowhere else; everything else is a constant beside the
//! code it belongs to. Names have at most 16 characters, as MAVLink parameters do.
//!
//! A configuration may declare further rows for programs of others, behind those of the table: [`ParamSet::declaring`].

use crate::suggestion::{DidYouMean, nearest};
use std::fmt;

/// Type of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParamType {
    /// A 32-bit float on the wire.
    Float,
    /// A 32-bit integer on the wire.
    Integer,
    /// 0 or 1.
    Boolean,
}

/// When a changed value takes effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Apply {
    /// At once.
    Live,
    /// At the next start of jink as a whole: a service that is started again works on with the value that the others have.
    Restart,
}

/// In which direction a change leaves less safety.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Loosens {
    /// In none.
    Never,
    /// Downwards.
    Lower,
    /// Upwards.
    Higher,
}

/// One row of the table.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Param {
    /// Name.
    pub name: &'static str,
    /// Type.
    pub kind: ParamType,
    /// Value if nothing else is given.
    pub default: f64,
    /// Smallest value accepted.
    pub min: f64,
    /// Largest value accepted.
    pub max: f64,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// One line of help.
    pub help: &'static str,
    /// When a change takes effect.
    pub apply: Apply,
    /// Which changes leave less safety: a ground station makes them only while the vehicle is disarmed.
    pub loosens: Loosens,
}

impl Param {
    /// Whether `to` in place of `from` leaves less safety.
    pub fn is_loosened(&self, from: f64, to: f64) -> bool {
        // Values come over links in single precision: the one in force, sent back, is no change.
        let [from, to] = [from, to].map(|value| value as f32);
        match self.loosens {
            Loosens::Never => false,
            Loosens::Lower => to < from,
            Loosens::Higher => to > from,
        }
    }
}

macro_rules! params {
    ($( $name:ident = $kind:ident, $default:literal, $min:literal .. $max:literal, $unit:literal, $apply:ident, $loosens:ident, $help:literal; )*) => {
        $(
            #[doc = $help]
            pub const $name: Param = Param {
                name: stringify!($name),
                kind: ParamType::$kind,
                default: $default,
                min: $min,
                max: $max,
                unit: $unit,
                help: $help,
                apply: Apply::$apply,
                loosens: Loosens::$loosens,
            };
        )*
        /// Every parameter, in a fixed order.
        pub const TABLE: &[Param] = &[$($name),*];
    };
}

params! {
    OA_VEH_RADIUS = Float, 0.30, 0.05 .. 3.0, "m", Restart, Lower, "Radius of the sphere around the centre of gravity that holds the whole vehicle, propellers included";
    OA_MAP_ERR = Float, 0.10, 0.0 .. 1.0, "m", Restart, Lower, "Error of the map that motion must allow for besides the cell size: sensor noise and pose error";
    OA_SPD_MAX = Float, 3.0, 0.3 .. 20.0, "m/s", Live, Higher, "Highest speed of a planned motion";
    OA_SPD_CLIMB = Float, 1.5, 0.2 .. 5.0, "m/s", Live, Higher, "Highest speed upwards";
    OA_SPD_DESC = Float, 1.0, 0.2 .. 5.0, "m/s", Live, Higher, "Highest speed downwards";
    OA_TRK_CUT = Float, 0.0, 0.0 .. 2.0, "s2", Live, Lower, "Corners that the vehicle cuts, in metres per m/s2 of acceleration: learned in flight where it is more than what is known of the profile; 0 forgets it";
    OA_TRK_OVER = Float, 0.0, 0.0 .. 2.0, "s2", Live, Lower, "Overshoot of stops, in metres per m/s2 of deceleration: learned in flight where it is more than what is known of the profile; 0 forgets it";
    OA_ALT_MIN = Float, 1.0, 0.0 .. 100.0, "m", Live, Lower, "Lowest height above home that a planned motion may use";
    OA_ALT_MAX = Float, 120.0, 1.0 .. 1000.0, "m", Live, Higher, "Greatest height above home that a planned motion may use";
    OA_GOAL_RAD = Float, 0.3, 0.05 .. 5.0, "m", Live, Never, "Distance at which a goal counts as reached";
    OA_YAW_MODE = Integer, 1.0, 0.0 .. 1.0, "", Live, Never, "Heading of planned motion: 0 as the mission asks, 1 along the path";
    OA_BLOCKED = Integer, 0.0, 0.0 .. 2.0, "", Restart, Never, "Mission item that cannot be reached: 0 wait and notify, 1 skip it, 2 stop the mission";
    OA_BLOCKED_T = Float, 30.0, 2.0 .. 600.0, "s", Restart, Never, "Time without a shorter way left than any before, after which a goal or mission item counts as out of reach; flying known detours adds to it";
    OA_UNGUARDED = Integer, 0.0, 0.0 .. 1.0, "", Live, Higher, "Motion of the autopilot that jink cannot guard (orbit, unknown item): 0 hold and notify, 1 let it fly and notify";
    OA_CARVE_RNG = Float, 18.0, 3.0 .. 18.0, "m", Restart, Higher, "Range up to which rays clear the map";
    OA_DCL_START = Float, 0.0, 0.0 .. 5.0, "m", Restart, Higher, "Declaration: so near to the vehicle when it is armed, and around it while it takes off, everything is free; 0 none";
    OA_DCL_HANG_LO = Float, 0.0, 0.0 .. 500.0, "m", Restart, Lower, "Declaration: nothing hangs from above from this height above home ...";
    OA_DCL_HANG_HI = Float, 0.0, 0.0 .. 500.0, "m", Restart, Higher, "... to this one; equal to the other: not declared";
    GD_MARGIN = Float, 0.10, 0.0 .. 2.0, "m", Live, Lower, "Distance the guard keeps besides the vehicle radius";
    GD_BAND = Float, 0.50, 0.1 .. 5.0, "m", Restart, Lower, "Half height of the band around the vehicle in which the guard counts obstacles";
    GD_ACC_BRAKE = Float, 2.0, 0.5 .. 15.0, "m/s2", Live, Higher, "Deceleration the guard counts on and brakes with at least; harder where the autopilot is known to follow that";
    GD_DELAY = Float, 0.35, 0.0 .. 2.0, "s", Live, Lower, "Reaction time the guard counts on: sensor, link and autopilot";
    CP_DIST = Float, -1.0, -1.0 .. 15.0, "m", Live, Lower, "Distance that collision prevention keeps from everything; zero and below switch it off";
    CP_DELAY = Float, 0.4, 0.0 .. 1.0, "s", Live, Lower, "Delay of sensors, link and tracking that collision prevention allows for";
    CP_GUIDE_ANG = Float, 30.0, 0.0 .. 90.0, "deg", Live, Never, "How far to either side collision prevention looks for a better direction";
    CP_GO_NO_DATA = Integer, 0.0, 0.0 .. 1.0, "", Live, Higher, "Motion where no sensor has ever looked: 0 no, 1 yes";
    MPC_XY_P = Float, 0.95, 0.0 .. 2.0, "1/s", Live, Higher, "Position gain of the autopilot, for collision prevention, OFFBOARD and external avoidance: as set there";
    MPC_VEL_MANUAL = Float, 10.0, 3.0 .. 20.0, "m/s", Live, Higher, "Speed of a full stick, for collision prevention: as set on the autopilot";
    MPC_JERK_MAX = Float, 8.0, 0.5 .. 500.0, "m/s3", Live, Higher, "Jerk with which the vehicle begins to brake, for collision prevention";
    MPC_ACC_HOR = Float, 3.0, 2.0 .. 15.0, "m/s2", Live, Higher, "Acceleration with which the vehicle brakes, for collision prevention";
    MPC_XY_VEL_P_ACC = Float, 1.8, 1.2 .. 5.0, "1/s", Live, Higher, "Acceleration for each m/s of wrong speed, for collision prevention";
    OA_ASSIST_CH = Integer, 0.0, 0.0 .. 18.0, "", Live, Never, "Channel of the remote control whose upper end switches assisted flight on; 0 none, by command only";
    OA_ASSIST_YAW = Float, 60.0, 10.0 .. 200.0, "deg/s", Live, Never, "Heading rate of a full stick in assisted flight";
    GW_RATE = Float, 20.0, 5.0 .. 50.0, "Hz", Restart, Never, "Rate of the setpoint stream to the autopilot";
    GW_OBST_RATE = Float, 0.0, 0.0 .. 30.0, "Hz", Live, Never, "Rate of the obstacle maps to the autopilot, which may pass them on to ground stations; 0 as it needs them";
    GW_HORIZON = Float, 0.8, 0.3 .. 2.0, "s", Restart, Never, "Duration of each Bezier curve sent to the autopilot";
}

/// The lower and the upper end of one span: values in force never have the first above the second.
pub const SPANS: [[&Param; 2]; 2] = [[&OA_ALT_MIN, &OA_ALT_MAX], [&OA_DCL_HANG_LO, &OA_DCL_HANG_HI]];

/// Begins the names of parameters that a configuration declares.
pub const USER_PARAMETERS: &str = "USR_";

/// Why a parameter was refused.
#[derive(Clone, Debug, PartialEq)]
pub enum ParamError {
    /// No such parameter.
    Unknown {
        /// What was asked for.
        name: String,
        /// The one that was probably meant.
        nearest: Option<&'static str>,
    },
    /// The value lies outside the row's range, or is no number, or no integer where one is needed.
    OutOfRange {
        /// Parameter.
        name: &'static str,
        /// Refused value.
        value: f64,
        /// Smallest value accepted.
        min: f64,
        /// Largest value accepted.
        max: f64,
    },
    /// The two ends of one of [`SPANS`] are the wrong way round.
    Reversed {
        /// Name and value of the lower end.
        low: (&'static str, f64),
        /// Name and value of the upper end.
        high: (&'static str, f64),
    },
}

impl fmt::Display for ParamError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            ParamError::Unknown { name, nearest } => {
                write!(f, "unknown parameter {name}{}", DidYouMean(*nearest))
            }
            ParamError::OutOfRange {
                name,
                value,
                min,
                max,
            } => {
                write!(f, "{name} = {value} is outside {min} to {max}")
            }
            ParamError::Reversed { low, high } => {
                write!(f, "{} = {} is above {} = {}", low.0, low.1, high.0, high.1)
            }
        }
    }
}
impl std::error::Error for ParamError {}

/// The values in force, one per row of the table and one per row that the configuration declares behind it.
#[derive(Clone, Debug, PartialEq)]
pub struct ParamSet {
    values: Vec<f64>,
    declared: &'static [Param],
}

impl Default for ParamSet {
    fn default() -> Self {
        Self::declaring(&[])
    }
}

impl ParamSet {
    /// The defaults, with rows behind those of the table.
    pub fn declaring(declared: &'static [Param]) -> Self {
        let values = TABLE.iter().chain(declared).map(|param| param.default);
        Self {
            values: values.collect(),
            declared,
        }
    }

    /// The rows behind those of the table.
    pub fn declared(&self) -> &'static [Param] {
        self.declared
    }

    /// How many rows there are.
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// Whether there is none: never.
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// A row by its number.
    pub fn row(&self, number: usize) -> Option<&'static Param> {
        match number.checked_sub(TABLE.len()) {
            None => TABLE.get(number),
            Some(behind) => self.declared.get(behind),
        }
    }

    /// The number of the row with this name.
    pub fn number_of(&self, name: &str) -> Option<usize> {
        TABLE.iter().chain(self.declared).position(|row| row.name == name)
    }

    /// The value of `param`.
    pub fn get(&self, param: &Param) -> f64 {
        self.named(param.name).unwrap_or(param.default)
    }

    /// The value of the parameter called `name`; `None` if there is none.
    pub fn named(&self, name: &str) -> Option<f64> {
        self.values.get(self.number_of(name)?).copied()
    }

    /// Each row with its value.
    pub fn rows(&self) -> impl Iterator<Item = (&'static Param, f64)> + '_ {
        TABLE.iter().chain(self.declared).zip(self.values.iter().copied())
    }

    /// The spans whose ends are the wrong way round, each as [`ParamError::Reversed`].
    pub fn reversed(&self) -> impl Iterator<Item = ParamError> + '_ {
        SPANS.iter().filter_map(|span| {
            let [low, high] = span.map(|row| (row.name, self.get(row)));
            (low.1 > high.1).then_some(ParamError::Reversed { low, high })
        })
    }

    /// Changes the parameter called `name` among values that are in force: as [`Self::set`], and the values fit together afterwards.
    /// What is refused changes nothing.
    ///
    /// # Errors
    /// Those of [`Self::set`]; [`ParamError::Reversed`], if the parameter is the end of a span.
    pub fn change(&mut self, name: &str, value: f64) -> Result<(), ParamError> {
        let before = self.named(name);
        self.set(name, value)?;
        let is_end_of = |error: &ParamError| matches!(error, ParamError::Reversed { low, high } if low.0 == name || high.0 == name);
        let Some(error) = self.reversed().find(is_end_of) else {
            return Ok(());
        };
        if let Some(before) = before {
            self.set(name, before)?;
        }
        Err(error)
    }

    /// Sets the parameter called `name`, whatever the others are: a file or a message sets one after the other, and is judged whole
    /// ([`Self::reversed`]).
    ///
    /// # Errors
    /// [`ParamError::Unknown`] with the nearest name; [`ParamError::OutOfRange`] with the range.
    pub fn set(&mut self, name: &str, value: f64) -> Result<(), ParamError> {
        let number = self.number_of(name);
        let Some((index, row)) = number.and_then(|index| Some((index, self.row(index)?))) else {
            let names = TABLE.iter().chain(self.declared).map(|row| row.name);
            return Err(ParamError::Unknown {
                name: name.to_owned(),
                nearest: nearest(name, names),
            });
        };
        let whole = row.kind == ParamType::Float || value.fract() == 0.0;
        if !(row.min..=row.max).contains(&value) || !whole {
            return Err(ParamError::OutOfRange {
                name: row.name,
                value,
                min: row.min,
                max: row.max,
            });
        }
        self.values[index] = value;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::{OA_SPD_MAX, ParamError, ParamSet, SPANS, TABLE};

    #[test]
    fn every_row_fits_mavlink_and_its_own_range() {
        for row in TABLE {
            assert!(row.name.len() <= 16, "{}", row.name);
            assert!((row.min..=row.max).contains(&row.default), "{}", row.name);
            assert!(!row.help.is_empty());
        }
    }

    /// PX4's own table, `main` of August 2026: name, type, default, least and largest value.
    #[test]
    fn collision_prevention_has_px4s_names_types_ranges_and_defaults() {
        use super::ParamType::{Float, Integer};
        for (name, kind, default, min, max) in [
            ("CP_DIST", Float, -1.0, -1.0, 15.0),
            ("CP_DELAY", Float, 0.4, 0.0, 1.0),
            ("CP_GUIDE_ANG", Float, 30.0, 0.0, 90.0),
            ("CP_GO_NO_DATA", Integer, 0.0, 0.0, 1.0),
            ("MPC_XY_P", Float, 0.95, 0.0, 2.0),
            ("MPC_VEL_MANUAL", Float, 10.0, 3.0, 20.0),
            ("MPC_JERK_MAX", Float, 8.0, 0.5, 500.0),
            ("MPC_ACC_HOR", Float, 3.0, 2.0, 15.0),
            ("MPC_XY_VEL_P_ACC", Float, 1.8, 1.2, 5.0),
        ] {
            let row = TABLE.iter().find(|row| row.name == name).unwrap();
            assert_eq!(
                (row.kind, row.default, row.min, row.max),
                (kind, default, min, max),
                "{name}"
            );
        }
    }

    #[test]
    fn a_value_outside_its_range_changes_nothing() {
        let mut set = ParamSet::default();
        let before = set.get(&OA_SPD_MAX);
        for bad in [1e3, -1.0, f64::NAN] {
            assert!(matches!(
                set.set("OA_SPD_MAX", bad),
                Err(ParamError::OutOfRange { .. })
            ));
            assert_eq!(set.get(&OA_SPD_MAX), before);
        }
        assert!(set.set("OA_SPD_MAX", 5.0).is_ok());
        assert_eq!(set.get(&OA_SPD_MAX), 5.0);
    }

    #[test]
    fn a_typing_error_is_met_with_the_nearest_name() {
        let mut set = ParamSet::default();
        let error = set.set("OA_SPEED_MAX", 3.0).unwrap_err();
        assert_eq!(
            error.to_string(),
            "unknown parameter OA_SPEED_MAX; did you mean `OA_SPD_MAX`?"
        );
    }

    #[test]
    fn the_ends_of_a_span_are_never_changed_to_the_wrong_way_round() {
        for [low, high] in SPANS {
            let mut set = ParamSet::default();
            set.change(high.name, 20.0).unwrap();
            set.change(low.name, 20.0).unwrap();
            let before = set.clone();
            let error = set.change(low.name, 21.0).unwrap_err();
            assert_eq!(
                error.to_string(),
                format!("{} = 21 is above {} = 20", low.name, high.name)
            );
            assert!(set.change(high.name, 19.0).is_err());
            assert_eq!(set, before);
            assert_eq!(set.reversed().count(), 0);
            // What is wrong already keeps nothing else from being changed.
            set.set(low.name, 30.0).unwrap();
            assert_eq!(set.reversed().count(), 1);
            set.change("OA_SPD_MAX", 2.0).unwrap();
            set.change(low.name, 10.0).unwrap();
        }
    }

    #[test]
    fn an_integer_stays_one() {
        assert!(ParamSet::default().set("OA_YAW_MODE", 0.5).is_err());
    }
}
