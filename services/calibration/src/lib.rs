//! Where a three-dimensional sensor is mounted, estimated from what it measures while the vehicle stands still.
//!
//! | in | out |
//! |---|---|
//! | points of two sensors ([`Points`]), in the body frame as the configuration has it | correction of the one against the other: six numbers ([`against_sensor`]) |
//! | points of one sensor, direction of gravity in the body frame | correction of roll and pitch, height above the ground ([`against_gravity`]) |
//! | the configured [`Mounting`], a correction | the mounting that follows, as the keys of its `[[sensor]]` table |
//!
//! Against another sensor: both clouds become small planes ([`Surfaces`]), fitted to neighbourhoods of points, and the planes of the one
//! are laid on those of the other by point-to-plane registration (Chen, Medioni, "Object modelling by registration of multiple range images",
//! Image and Vision Computing 1992; normal equations as in K.-L. Low, "Linear least-squares optimization for point-to-plane ICP
//! surface registration", UNC TR04-004), from several starts up to [`REACH_DEG`] away.
//!
//! An estimate says how sure it is. The information matrix of the normal equations has a small eigenvalue where a motion of the sensor
//! changes no residual: along a corridor, on bare ground. Such a direction is not observable, and the estimate says in words what the
//! scene lacks. Everywhere else it has a standard deviation per axis.
//!
//! Nothing here reads or writes a file, a topic or a clock.

mod certainty;
mod ground;
mod mounting;
mod points;
mod register;
mod report;
mod surfaces;

pub use certainty::{Axis, Certainty};
pub use ground::{Ground, against_gravity};
pub use mounting::{Mounting, MountingTable};
pub use points::Points;
pub use register::{REACH_DEG, REACH_M};
pub use report::{Calibrated, Collector, Still, calibrate};
pub use surfaces::Surfaces;

use nalgebra::{Isometry3, Point3};
use std::fmt;

/// An axis counts as known up to this standard deviation: half a degree and two centimetres are promised, at two standard deviations.
pub const SURE_DEG: f64 = 0.25;
/// As [`SURE_DEG`], for a position (m).
pub const SURE_M: f64 = 0.01;
/// Of the planes of a sensor, so many must lie on planes of the reference.
pub const OVERLAP_MIN: f64 = 0.15;
/// Fewer planes than this say nothing, whatever their arrangement.
const PLANES_MIN: usize = 40;

/// Why there is no estimate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CalibrateError {
    /// Too few small planes were seen.
    TooFewSurfaces {
        /// So many.
        have: usize,
        /// At least so many are needed.
        need: usize,
    },
    /// The two sensors have too little in common.
    NoOverlap {
        /// Share of the planes of the sensor that lie on planes of the reference.
        share: f64,
    },
    /// What fits best is farther from the configured mounting than a mounting is looked for.
    OutOfReach {
        /// How far it is turned (deg).
        deg: f64,
        /// How far it is moved (m).
        m: f64,
    },
    /// Two mountings fit equally well.
    Ambiguous {
        /// How far apart they are (deg).
        apart_deg: f64,
        /// How far apart they are (m).
        apart_m: f64,
    },
    /// No level surface is in view below the sensor.
    NoGround,
    /// What is seen of the ground is too small to say how it is inclined.
    NarrowGround {
        /// Its extent in its narrower direction (m), one standard deviation.
        extent_m: f64,
    },
}

impl fmt::Display for CalibrateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::TooFewSurfaces { have, need } => {
                write!(
                    f,
                    "{have} small surfaces were seen, {need} are needed: stand where more is within its range"
                )
            }
            Self::NoOverlap { share } => write!(
                f,
                "only {:.0} % of its surfaces are seen by both: turn the vehicle so that both see the same walls, or choose another reference (--against)",
                100.0 * share
            ),
            Self::OutOfReach { deg, m } => write!(
                f,
                "what fits best is {deg:.1} deg and {m:.2} m from the configured mounting, and up to {REACH_DEG:.0} deg and {REACH_M:.1} m are looked for: stand where less repeats itself, or correct the table by hand first"
            ),
            Self::Ambiguous { apart_deg, apart_m } => write!(
                f,
                "two mountings {apart_deg:.1} deg and {apart_m:.2} m apart fit equally well: stand where less repeats itself"
            ),
            Self::NoGround => write!(f, "no level ground is in view below it"),
            Self::NarrowGround { extent_m } => write!(
                f,
                "what it sees of the ground is {extent_m:.2} m wide only: too narrow for an inclination"
            ),
        }
    }
}
impl std::error::Error for CalibrateError {}

/// How a sensor must be moved to agree with the reference.
#[derive(Clone, Debug, PartialEq)]
pub struct Correction {
    /// Takes points as configured (body) to where they belong (body).
    pub body_t_configured: Isometry3<f64>,
    /// How well each axis of the mounting is known.
    pub certainty: Certainty,
    /// Root mean square of the distances between planes laid on each other (m).
    pub residual_m: f64,
    /// Share of the planes of the sensor that lie on planes of the reference.
    pub overlap: f64,
}

/// The correction of the sensor that has measured `points` and sits at `origin` (body, m, as configured) against `reference`.
///
/// # Errors
/// [`CalibrateError`] where nothing can be said.
pub fn against_sensor(
    reference: &Points,
    points: &Points,
    origin: Point3<f64>,
) -> Result<Correction, CalibrateError> {
    let target = Surfaces::of(reference);
    let source = Surfaces::of(points);
    for surfaces in [&target, &source] {
        if surfaces.len() < PLANES_MIN {
            return Err(CalibrateError::TooFewSurfaces {
                have: surfaces.len(),
                need: PLANES_MIN,
            });
        }
    }
    register::register(&target, &source, origin)
}
