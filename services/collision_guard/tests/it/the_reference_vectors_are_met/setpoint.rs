//! The constrained setpoint against PX4's.
//!
//! * Never a number that is none.
//! * Where PX4's own answer is one from which the vehicle stops in time, in every direction, ours is the same (see [`Law::binds`] for
//!   the exceptions).
//! * Elsewhere ours closes on nothing known faster than PX4's, unless by no more than PX4 grants toward the nearest obstacle, here for any:
//!   `P (v_max - v . u) + S (setpoint . u)`, evaluated here once more. What was seen a while ago is nearer by what the vehicle has flown
//!   since, as PX4 counts it, too; and the setpoint is the one that guidance makes of it on the map at hand, which is PX4's own
//!   where both maps are the same.

use super::VectorReport;
use super::map::said;
use super::oracle::SectorReading;
use super::replay::ReplayedStep;
use jink_collision_guard::prevention::PreventionConfig;
use jink_testkit::vectors::{BINS, flag, numbers, unrolled};
use nalgebra::Vector2;
use serde_json::Value;

/// The tolerance: relative, and absolute for small ones.
const SAME: f64 = 1e-3;
/// A setpoint shorter than this is a centred stick (m/s2).
const CENTRED: f64 = 1e-3;
/// Cosine between the setpoint and the nearest obstacle at which PX4's rule jumps.
const PERPENDICULAR: f64 = 0.0;

/// Compares the setpoint of `replayed` with what is expected of its step.
pub fn judge(
    expect: &Value,
    replayed: &ReplayedStep,
    config: &PreventionConfig,
    has_turned: bool,
    report: &mut VectorReport,
) {
    let px4 = Vector2::from(numbers::<2>(&expect["setpoint_out"]));
    let ours = replayed.outcome.setpoint;
    let is_same = (ours - px4).norm() <= SAME * (1.0 + px4.norm());
    if !flag(&expect["active"]) {
        let both_passed = ours == px4 || !replayed.asked.iter().all(|x| x.is_finite()) || is_same;
        if !both_passed || config.is_active() {
            report.wrong(&format!("switched off: {ours:?} of {px4:?}"));
        }
        return;
    }
    if !ours.iter().all(|x| x.is_finite()) {
        return report.wrong(&format!("{ours:?} is no number"));
    }
    if is_same {
        return;
    }
    let law = Law::new(replayed, config, expect);
    if let Some(reason) = law.out_of_the_ordinary(expect, &px4) {
        return report.differs(reason);
    }
    match law.closes_too_fast(&ours, &px4) {
        Some(TooFast { only_px4, .. }) if only_px4 && has_turned => {
            report.differs("what PX4 carries along with the nose does not stand there");
        }
        Some(TooFast { what, .. }) => report.wrong(&what),
        None => match law.binds(&px4) {
            Some(reason) => report.differs(reason),
            None => report.wrong(&format!("{ours:?}, and PX4's {px4:?} is safe")),
        },
    }
}

/// Something is closed on too fast.
struct TooFast {
    what: String,
    /// It is in PX4's map alone; the ring knows nothing of that direction.
    only_px4: bool,
}

/// What may be, for one step.
struct Law<'a> {
    replayed: &'a ReplayedStep,
    config: &'a PreventionConfig,
    keep_m: f64,
    /// What guidance made of the setpoint: PX4's, or ours where it had another map.
    demand: Vector2<f64>,
    /// What PX4 knows of each bin (cm), and as far as its sensor reaches.
    px4_cm: [i64; BINS],
    px4_reach_cm: [i64; BINS],
    nearest: Option<Vector2<f64>>,
}

impl<'a> Law<'a> {
    fn new(replayed: &'a ReplayedStep, config: &'a PreventionConfig, expect: &Value) -> Self {
        let direction = |name| expect.get(name).map(|value| Vector2::from(numbers::<2>(value)));
        let size = replayed.asked.norm();
        let mut law = Self {
            replayed,
            config,
            keep_m: config.distance_m.max(f64::from(replayed.ring.range_min_m)),
            demand: direction("guided_dir").unwrap_or_default() * size,
            px4_cm: unrolled(&expect["map_cm"]),
            px4_reach_cm: unrolled(&expect["bin_max_range_cm"]),
            nearest: direction("closest_dir"),
        };
        if law.is_other_map() {
            law.demand = match replayed.outcome.guided {
                Some(sector) if !law.asks_for(sector) => law.toward(sector) * size,
                _ => replayed.asked,
            };
        }
        law
    }

    /// Whether the setpoint as it came points into `sector`, so that guidance left it as it is; the sector of a stick
    /// is the one that begins at its centre, as PX4 counts it.
    fn asks_for(&self, sector: usize) -> bool {
        let bearing = self.replayed.asked.y.atan2(self.replayed.asked.x) - self.replayed.yaw_rad;
        (bearing.to_degrees().rem_euclid(360.0) / 5.0) as usize % BINS == sector
    }

    /// Whether the ring differs from PX4's map.
    fn is_other_map(&self) -> bool {
        (0..BINS).any(|bin| {
            let ours = self.reach_m(bin).map(|m| 100.0 * m);
            let px4 = (self.px4_cm[bin] != 65535).then_some(self.px4_cm[bin] as f64);
            match (ours, px4) {
                (Some(ours), Some(px4)) => (ours - px4).abs() > 1.01,
                (None, None) => false,
                _ => true,
            }
        })
    }

    fn toward(&self, bin: usize) -> Vector2<f64> {
        let bearing_rad = self.replayed.yaw_rad + (5.0 * bin as f64).to_radians();
        Vector2::new(bearing_rad.cos(), bearing_rad.sin())
    }

    /// How far the ring knows a bin (m).
    fn reach_m(&self, bin: usize) -> Option<f64> {
        match said(&self.replayed.ring, bin) {
            SectorReading::Silent => None,
            SectorReading::Clear(cm) | SectorReading::Hit(cm) => Some(cm / 100.0),
        }
    }

    /// Time since the ring has seen something in a bin (s); none for what is free.
    fn age_s(&self, bin: usize) -> f64 {
        match said(&self.replayed.ring, bin) {
            SectorReading::Hit(_) => self
                .replayed
                .now
                .seconds_since(self.replayed.ring.seen[bin])
                .max(0.0),
            SectorReading::Clear(_) | SectorReading::Silent => 0.0,
        }
    }

    /// The acceleration toward something `distance_m` away in a bin that the vehicle can take back in time.
    fn can_be_taken_back(&self, bin: usize, distance_m: f64) -> f64 {
        let closing = self.replayed.velocity.dot(&self.toward(bin));
        let flown = closing.max(0.0) * (self.config.delay_s + self.age_s(bin));
        let way = distance_m - self.keep_m - flown;
        // Rest after v^2 / 2a + v 2a / j: the positive root.
        let a = self.config.acceleration_mps2;
        let lag = 2.0 * a * a / self.config.jerk_mps3;
        let limit = if way > 0.0 {
            (lag * lag + 2.0 * a * way).sqrt() - lag
        } else {
            0.0
        };
        self.config.velocity_gain_per_s * (limit - closing)
    }

    /// Where what we do is not comparable.
    fn out_of_the_ordinary(&self, expect: &Value, px4: &Vector2<f64>) -> Option<&'static str> {
        let finite = |v: &Vector2<f64>| v.iter().all(|x| x.is_finite());
        if !finite(&self.replayed.asked) || !finite(&self.replayed.velocity) {
            Some("an input that is no number is no motion")
        } else if !finite(px4) {
            Some("PX4's answer is no number")
        } else if !flag(&expect["data_present"]) {
            Some("without data it is stopped, and does not coast")
        } else {
            None
        }
    }

    fn closes_too_fast(&self, ours: &Vector2<f64>, px4: &Vector2<f64>) -> Option<TooFast> {
        let too_fast = (0..BINS).filter_map(|bin| {
            let toward = self.toward(bin);
            let is_hit = self.px4_cm[bin] < self.px4_reach_cm[bin];
            let px4_m = is_hit.then_some(self.px4_cm[bin] as f64 / 100.0);
            let ours_m = match said(&self.replayed.ring, bin) {
                SectorReading::Hit(cm) => Some(cm / 100.0),
                SectorReading::Clear(_) | SectorReading::Silent => None,
            };
            // The ring's reading counts: its difference from PX4's has its reason.
            let distance_m = ours_m.or(px4_m.filter(|_| self.reach_m(bin).is_none()))?;
            let (closes, px4_closes) = (ours.dot(&toward), px4.dot(&toward).max(0.0));
            let share = self.scale(distance_m) * self.demand.dot(&toward).max(0.0);
            let may = px4_closes.max(self.can_be_taken_back(bin, distance_m) + share);
            let slack = SAME * (1.0 + ours.norm());
            (closes > may + slack).then(|| TooFast {
                what: format!(
                    "closes on bin {bin}, {distance_m:.2} m, with {closes:.3} m/s2 where {may:.3} may be, PX4 {px4_closes:.3}"
                ),
                only_px4: ours_m.is_none(),
            })
        });
        // What the ring knows counts first.
        too_fast.min_by_key(|found| found.only_px4)
    }

    /// Why ours must be another one than PX4's.
    fn binds(&self, px4: &Vector2<f64>) -> Option<&'static str> {
        let size = self.replayed.asked.norm();
        let velocity = &self.replayed.velocity;
        let a = self.config.acceleration_mps2;
        let sector = |v: &Vector2<f64>| {
            let bearing = (v.y.atan2(v.x) - self.replayed.yaw_rad).to_degrees() / 5.0;
            (bearing.round().rem_euclid(BINS as f64) as usize) % BINS
        };
        let is_unknown = |bin: usize| self.reach_m(bin % BINS).is_none();
        let breaks_a_limit = (0..BINS).any(|bin| {
            self.reach_m(bin).is_some_and(|reach_m| {
                let toward = self.toward(bin);
                let share = self.scale(reach_m).max(0.0) * self.demand.dot(&toward).max(0.0);
                let may = (self.can_be_taken_back(bin, reach_m) + share).max(-a);
                px4.dot(&toward) > may + 1e-6
            })
        });
        let near_unknown = |bin: usize| is_unknown(bin) || is_unknown(bin + 1) || is_unknown(bin + BINS - 1);
        let cosine = self.nearest.map_or(1.0, |nearest| {
            self.demand.dot(&nearest) / self.demand.norm().max(CENTRED)
        });
        let least_m = (0..BINS)
            .filter_map(|bin| self.reach_m(bin))
            .fold(f64::INFINITY, f64::min);
        if self.is_other_map() {
            Some("the map is another one")
        } else if velocity.norm() > 0.05 && is_unknown(sector(velocity)) {
            Some("motion into a sector without data is braked")
        } else if size <= CENTRED {
            Some("braked with the stick centred")
        } else if px4.norm() > a.max(size) + 1e-6 {
            Some("not more than MPC_ACC_HOR or what was asked for")
        } else if breaks_a_limit {
            Some("every sector counts, not the nearest alone")
        } else if near_unknown(sector(&self.demand)) || near_unknown(sector(px4)) {
            Some("no jump beside a sector without data")
        } else if least_m - self.keep_m < -1.0 {
            Some("not more than the whole demand turned back")
        } else if cosine <= PERPENDICULAR {
            Some("what stands in the direction of the setpoint counts, too")
        } else {
            None
        }
    }

    fn scale(&self, reach_m: f64) -> f64 {
        let d = self
            .keep_m
            .max(self.config.manual_mps / self.config.position_gain_per_s);
        let share = (reach_m - self.keep_m) / d;
        if share > 0.0 {
            (share * share).min(1.0)
        } else {
            0.0
        }
    }
}
