//! What an approach came to, from its moments.

use super::{Approach, CP_DIST_M, Cell, Ending, Moment};

/// Between two moments (s).
const MOMENT_S: f64 = 0.02;
/// It rests when it has closed on and gone away from what stands there more slowly than this (m/s), and moved aside more slowly as
/// well, for this long (s).
const REST_MPS: f64 = 0.05;
const REST_S: f64 = 2.0;
/// The stick is held for this long after it has come to rest (s).
const HELD_AT_REST_S: f64 = 10.0;
/// Whose distance changes by more in the last seconds (m) only stood for a while: it slips past what it was pushed at.
const DRIFT_M: f64 = 0.5;
/// So fast it must have been (m/s), or it has not even begun.
const BEGUN_MPS: f64 = 0.3;
/// Who has passed is this far behind (m).
const PASSED_M: f64 = 6.0;
/// The time to rest begins this far before CP_DIST (m).
const GATE_M: f64 = 15.0;
/// Moments over which a speed of closing is taken: 0.2 s, longer than a turn of the lidar.
const SPAN: usize = 10;
/// The last part of an approach (s).
const LAST_S: f64 = 5.0;
/// What comes before is the pilot's own start (s).
const START_S: f64 = 1.0;
/// After the first contact it is watched for this long (s).
const AFTER_CONTACT_S: f64 = 0.5;

/// Follows one approach and knows when it is over.
pub struct Measure<'a> {
    cell: &'a Cell,
    has_begun: bool,
    still_s: f64,
    /// When it came to rest first.
    rest_s: Option<f64>,
    contact: Option<(f64, f64)>,
    passed_s: Option<f64>,
    now_s: f64,
}

impl<'a> Measure<'a> {
    pub fn new(cell: &'a Cell) -> Self {
        Self {
            cell,
            has_begun: false,
            still_s: 0.0,
            rest_s: None,
            contact: None,
            passed_s: None,
            now_s: 0.0,
        }
    }

    pub fn take(&mut self, moment: &Moment, collisions: u32) {
        self.now_s = moment.time_s;
        let speed_mps = moment.speed_mps();
        self.has_begun |= speed_mps > BEGUN_MPS;
        // A person has passed when the vehicle goes on behind them.
        self.still_s = if self.has_begun && speed_mps < REST_MPS {
            self.still_s + MOMENT_S
        } else {
            0.0
        };
        if self.still_s >= REST_S && self.rest_s.is_none() {
            self.rest_s = Some(moment.time_s - REST_S);
        }
        if collisions > 0 && self.contact.is_none() {
            self.contact = Some((moment.time_s, speed_mps));
        }
        if moment.ahead_m > self.cell.ahead_m() + PASSED_M && self.passed_s.is_none() {
            self.passed_s = Some(moment.time_s);
        }
    }

    pub fn is_over(&self) -> bool {
        let since =
            |then_s: Option<f64>, long_s: f64| then_s.is_some_and(|then_s| self.now_s - then_s > long_s);
        let rests = since(self.rest_s, HELD_AT_REST_S) && !self.cell.scene.moves();
        rests || since(self.passed_s, 1.0) || since(self.contact.map(|contact| contact.0), AFTER_CONTACT_S)
    }

    pub fn finish(&self, moments: &[Moment]) -> Approach {
        let last = last(moments, LAST_S);
        let distances = || last.iter().map(|m| m.distance_m);
        let swing_m =
            distances().fold(f64::NEG_INFINITY, f64::max) - distances().fold(f64::INFINITY, f64::min);
        let stood = self.rest_s.is_some() && self.passed_s.is_none() && self.contact.is_none();
        let rests = stood && swing_m < DRIFT_M;
        let rest_m = rests.then(|| mean(self::last(moments, 1.0), |m| m.distance_m) - CP_DIST_M);
        let reached_mps = moments.iter().map(Moment::speed_mps).fold(0.0, f64::max);
        let gate_s = moments
            .iter()
            .find(|m| m.distance_m <= CP_DIST_M + GATE_M)
            .map_or(0.0, |m| m.time_s);
        let end = moments.last();
        Approach {
            cell: *self.cell,
            ending: match () {
                () if self.contact.is_some() => Ending::Collision,
                () if self.passed_s.is_some() => Ending::Passed,
                () if rests => Ending::Rest,
                () => Ending::Moving,
            },
            reached_mps,
            nearest_m: moments.iter().map(|m| m.distance_m).fold(f64::INFINITY, f64::min) - CP_DIST_M,
            rest_m,
            rest_after_s: self.rest_s.filter(|_| rests).map(|rest_s| rest_s - gate_s),
            passed_after_s: self.passed_s,
            impact_mps: self.contact.map(|contact| contact.1),
            slows_at_m: slows_at_m(moments, reached_mps),
            reversals: self
                .rest_s
                .filter(|_| rests)
                .map_or(0, |rest_s| reversals(moments, rest_s)),
            swing_m: rests.then_some(swing_m),
            aside_mps: mean(last, |m| m.velocity_mps[1]).abs(),
            ahead_mps: end.map_or(0.0, |m| m.ahead_m / m.time_s),
            acceleration_mps2: moments
                .iter()
                .map(|m| m.acceleration_mps2[0].hypot(m.acceleration_mps2[1]))
                .fold(0.0, f64::max),
            weaving_hz: turns(moments, |m| m.velocity_mps[1]) as f64 / self.now_s.max(1.0),
            setpoint_jump_mps: setpoint_jump_mps(moments),
            setpoint_weaving_hz: turns(moments, |m| m.setpoint_mps[1]) as f64 / self.now_s.max(1.0),
        }
    }
}

fn last(moments: &[Moment], seconds: f64) -> &[Moment] {
    let count = ((seconds / MOMENT_S) as usize).min(moments.len());
    &moments[moments.len() - count..]
}

fn mean(moments: &[Moment], value: impl Fn(&Moment) -> f64) -> f64 {
    moments.iter().map(value).sum::<f64>() / moments.len().max(1) as f64
}

fn slows_at_m(moments: &[Moment], reached_mps: f64) -> f64 {
    moments
        .iter()
        .rev()
        .find(|m| m.speed_mps() >= 0.9 * reached_mps)
        .map_or(0.0, |m| m.distance_m - CP_DIST_M)
}

/// Changes of sign of the speed of closing after `from_s`: it counts as turned when it is beyond the threshold on the other side.
fn reversals(moments: &[Moment], from_s: f64) -> u32 {
    let after: Vec<f64> = moments
        .windows(SPAN)
        .filter(|span| span[0].time_s >= from_s)
        .map(|span| (span[SPAN - 1].distance_m - span[0].distance_m) / ((SPAN - 1) as f64 * MOMENT_S))
        .collect();
    count_turns(after.into_iter())
}

fn turns(moments: &[Moment], value: impl Fn(&Moment) -> f64) -> u32 {
    count_turns(moments.iter().filter(|m| m.time_s > START_S).map(value))
}

fn count_turns(values: impl Iterator<Item = f64>) -> u32 {
    let (mut side, mut count) = (0.0, 0);
    for value in values.filter(|value| value.abs() > REST_MPS) {
        count += u32::from(side * value < 0.0);
        side = value;
    }
    count
}

fn setpoint_jump_mps(moments: &[Moment]) -> f64 {
    moments
        .windows(2)
        .filter(|pair| pair[0].time_s > START_S)
        .map(|pair| {
            let change = |axis: usize| pair[1].setpoint_mps[axis] - pair[0].setpoint_mps[axis];
            change(0).hypot(change(1))
        })
        .fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::count_turns;

    #[test]
    fn noise_is_no_turn() {
        assert_eq!(count_turns([0.2, 0.04, -0.04, 0.03, 0.3].into_iter()), 0);
        assert_eq!(count_turns([0.2, -0.06, 0.04, 0.06].into_iter()), 2);
    }
}
