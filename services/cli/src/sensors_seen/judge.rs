//! What follows from what was seen: one sentence per fault, with what to do about it.

use super::Seen;
use super::circle::Sectors;
use super::frame::SensorType;
use super::ring::RingSeen;
use super::sensor::{Rate, SensorSeen};
use jink_control::findings::{Finding, Grade, of_events};
use jink_shared_types::events::{
    DEPTH_CAMERA_LOST, LIDAR_LOST, PREVENTION_BLIND, PREVENTION_HOLDS, RANGEFINDER_LOST, RANGES_LOST,
    SENSOR_LOST, SENSOR_MIRRORED, SENSOR_MOUNTING, SENSOR_RATE, SENSOR_SCALE, SENSOR_STUCK,
};
use jink_shared_types::faults::SensorFault;
use jink_shared_types::params::{self, ParamSet};
use jink_shared_types::ring::SECTORS;
use jink_shared_types::topics;

/// Below this share of what is expected, a rate is too slow.
const SLOW: f64 = 0.5;
/// Above this share of what is expected, it is none that the device can have.
const FAST: f64 = 1.5;
/// The guard's ring goes out at its rate to the beat: what lacks a tenth lacks more than chance.
const RING_SLOW: f64 = 0.9;
/// The guard believes a range for so long (s): a direction that is looked into less often is unknown in between.
const KEPT_S: f64 = 0.5;
/// Equal readings, one after the other, up to which chance and coarse steps may explain them.
const EQUAL_MAX: u64 = 20;
/// Equal scans or clouds of many readings up to which their publication twice may explain them.
const EQUAL_FRAMES_MAX: u64 = 4;
/// Looks into one direction after which "every time" means something.
const LOOKS_MIN: u64 = 10;
/// Two distances in one direction contradict each other if one is more than twice the other ...
const CONTRADICTION_RATIO: f64 = 2.0;
/// ... and more than this farther (m): a sector is as wide at 12 m.
const CONTRADICTION_M: f64 = 1.0;
/// The vehicle flies nose first: this far to either side of it is ahead (deg).
const AHEAD_DEG: f64 = 5.0;

/// Everything that follows, in the order of causes.
pub fn judge(seen: &Seen) -> Vec<Finding> {
    let mut findings = Vec::new();
    if seen.sensors.is_empty() {
        findings.push(finding(
            Grade::Blocker,
            "sensors",
            "no sensor is configured".to_owned(),
            "add a [[sensor]] table to jink.toml (docs/rangefinders.md, docs/lidars.md)",
        ));
    }
    for sensor in &seen.sensors {
        of_sensor(sensor, seen, &mut findings);
    }
    contradictions(&seen.sensors, &mut findings);
    faults(seen, &mut findings);
    of_ring(seen, &mut findings);
    of_space(seen, &mut findings);
    let about = [
        RANGES_LOST.id,
        SENSOR_LOST.id,
        RANGEFINDER_LOST.id,
        DEPTH_CAMERA_LOST.id,
        LIDAR_LOST.id,
        PREVENTION_BLIND.id,
        PREVENTION_HOLDS.id,
        SENSOR_STUCK.id,
        SENSOR_SCALE.id,
        SENSOR_MIRRORED.id,
        SENSOR_MOUNTING.id,
        SENSOR_RATE.id,
    ];
    findings.extend(of_events(&seen.events, &about));
    findings
}

/// What the planner makes of all of them.
fn of_space(seen: &Seen, findings: &mut Vec<Finding>) {
    let Some(space) = &seen.space else {
        let is =
            "map and planner say nothing: whether motion can be certified with these sensors is not known";
        let remedy = "`jink status` shows whether fusion and planner run, and what they wait for";
        findings.push(finding(Grade::Warning, "space", is.to_owned(), remedy));
        return;
    };
    match &space.cannot_plan {
        Some(reason) => findings.push(finding(Grade::Blocker, "space", reason.clone(), space.remedy)),
        None => {
            let is = "motion can be certified with what the sensors see".to_owned();
            findings.push(finding(Grade::Good, "space", is, ""));
        }
    }
    let (grade, remedy) = match space.declarations.is_empty() {
        true => (Grade::Good, ""),
        false => (
            Grade::Warning,
            "make sure that it holds where the vehicle flies (docs/known_space.md)",
        ),
    };
    findings.push(finding(grade, "space", space.declared(), remedy));
}

/// What the process that makes the map has found out about the sensors.
fn faults(seen: &Seen, findings: &mut Vec<Finding>) {
    for (sensor, fault) in seen.sensors.iter().zip(seen.faults) {
        let (is, remedy) = match fault {
            SensorFault::Unknown => continue,
            SensorFault::Stuck => (
                "stuck: repeats its data, or its time stands still; the map does not use it",
                "cut its power for a moment, or replace it",
            ),
            SensorFault::WrongScale => (
                "wrong scale: under motion its ranges agree only when they are multiplied; event 93 said by what",
                "look at its model, its units and its driver",
            ),
            SensorFault::Mirrored => (
                "mirrored: under motion its data agree only with left and right exchanged",
                "look at its orientation (upside down?) and its driver",
            ),
            SensorFault::WrongMounting => (
                "wrong mounting: under motion what stands still does not agree with itself",
                "jink check sensors --calibrate says where it is mounted",
            ),
            SensorFault::WrongRate => (
                "wrong rate: more or fewer frames than rate_hz of its table says",
                "look at its settings, its rate_hz, and at who else publishes for it",
            ),
        };
        findings.push(finding(Grade::Blocker, &sensor.table.name, is.to_owned(), remedy));
    }
}

/// Whom it is about, in a few words.
pub fn subject(seen: &Seen) -> String {
    let sensors = match seen.sensors.len() {
        1 => "1 sensor".to_owned(),
        many => format!("{many} sensors"),
    };
    let known_deg = 360.0 - seen.ring.blind().width_deg();
    format!("{sensors}, {known_deg} of 360 deg known to the guard")
}

fn finding(grade: Grade, about: &str, is: String, remedy: &str) -> Finding {
    Finding {
        grade,
        about: about.to_owned(),
        is,
        remedy: remedy.to_owned(),
    }
}

fn of_sensor(sensor: &SensorSeen, seen: &Seen, findings: &mut Vec<Finding>) {
    if sensor.timing.samples() == 0 {
        findings.push(silent(sensor, seen.seconds));
        return;
    }
    let before = findings.len();
    times(sensor, &seen.params, findings);
    pace(sensor, seen.seconds, findings);
    if findings.len() == before {
        findings.push(in_time(sensor));
    }
    let before = findings.len();
    credibility(sensor, findings);
    own(sensor, seen.own_m(), findings);
    let is_blocked = findings[before..].iter().any(|one| one.grade == Grade::Blocker);
    if !is_blocked {
        findings.push(sight(sensor));
    }
}

fn silent(sensor: &SensorSeen, seconds: f64) -> Finding {
    let remedy = match sensor.table.kind.as_str() {
        "rangefinder" => {
            "look at its plug, its power, its `device` and `baud`; its log says more (docs/rangefinders.md, docs/lidars.md, faults)"
        }
        "autopilot_rangefinder" => {
            "the autopilot sends no DISTANCE_SENSOR of this `id`: set the sensor up there, or correct `id`"
        }
        "obstacle_row" => {
            "nobody sends OBSTACLE_DISTANCE as this `component`: start who does, or correct `component`"
        }
        _ => "`jink status` shows whether its driver runs; look at its plug and its power",
    };
    finding(
        Grade::Blocker,
        &sensor.table.name,
        format!("silent: nothing has come from it in {seconds:.0} s"),
        remedy,
    )
}

/// Whether its times can be true, and are not too old.
fn times(sensor: &SensorSeen, params: &ParamSet, findings: &mut Vec<Finding>) {
    let (timing, what) = (&sensor.timing, samples(sensor));
    let mut blocker = |is: String, remedy: &str| {
        findings.push(finding(Grade::Blocker, &sensor.table.name, is, remedy));
    };
    let stamps = "its driver stamps wrongly, and ranges are placed where the vehicle was at that time: restart it, or replace it";
    let count = timing.samples();
    let (Some(p50_s), Some(p99_s)) = (timing.age_s(0.5), timing.age_s(0.99)) else {
        blocker(format!("its {what} do not say when they were captured"), stamps);
        return;
    };
    if timing.future() > 0 {
        let future = timing.future();
        blocker(
            format!("{future} of {count} {what} were captured after they were published"),
            stamps,
        );
    }
    if timing.backwards() > 0 {
        let backwards = timing.backwards();
        blocker(
            format!("{backwards} of {count} {what} were captured no later than the one before"),
            stamps,
        );
    }
    let allowed_s = params.get(&params::GD_DELAY);
    let allowed_ms = allowed_s * 1e3;
    let old = |share: &str, age_s: f64| {
        format!(
            "{share} of its {what} are {:.0} ms old or older when published; the guard counts on {allowed_ms:.0} ms (GD_DELAY)",
            age_s * 1e3
        )
    };
    let faster = "a faster line, a higher rate of the device, or less load on the board";
    if p50_s > allowed_s {
        blocker(old("half", p50_s), faster);
    } else if p99_s > allowed_s {
        let warning = finding(Grade::Warning, &sensor.table.name, old("1 %", p99_s), faster);
        findings.push(warning);
    }
}

/// Whether it sends samples as often as it is to.
fn pace(sensor: &SensorSeen, seconds: f64, findings: &mut Vec<Finding>) {
    let what = samples(sensor);
    let mut say = |grade: Grade, is: String, remedy: &str| {
        findings.push(finding(grade, &sensor.table.name, is, remedy));
    };
    let (least_hz, most_hz) = match sensor.table.rate() {
        Rate::Exact(rate_hz) => (rate_hz, FAST * rate_hz),
        Rate::AtLeast(rate_hz) => (rate_hz, f64::INFINITY),
    };
    let slower = "look at its log, at the load of the board (`jink top`), and at the device's own settings";
    let Some(rate_hz) = sensor.timing.rate_hz() else {
        say(
            Grade::Blocker,
            format!("one of its {what} in {seconds:.0} s, where {least_hz:.0} a second are expected"),
            slower,
        );
        return;
    };
    let row = match sensor.sort {
        SensorType::Cloud => topics::RANGE_CLOUD.row,
        SensorType::Beam | SensorType::Scan | SensorType::Row => topics::RANGE_SCAN.row,
    };
    if rate_hz < SLOW * least_hz {
        // Between two of them it counts as lost.
        let is_stale = rate_hz * row.deadline_ms < 1e3;
        say(
            if is_stale { Grade::Blocker } else { Grade::Warning },
            format!("{rate_hz:.1} {what} a second, where {least_hz:.0} are expected"),
            slower,
        );
    } else if rate_hz > most_hz {
        say(
            Grade::Warning,
            format!(
                "{rate_hz:.1} {what} a second, where {least_hz:.0} are expected: more than it can measure"
            ),
            "either two programs publish for it, or `rate_hz` is not what the device is set to",
        );
    }
    let unseen_s = sensor.unseen_s();
    if sensor.is_in_parts() && unseen_s > KEPT_S {
        say(
            Grade::Warning,
            format!(
                "looks away from some of its directions for {:.0} ms; ranges count for {:.0} ms and are unknown then",
                unseen_s * 1e3,
                KEPT_S * 1e3
            ),
            "let it turn less far (scan_low_deg, scan_high_deg) or faster",
        );
    }
}

fn in_time(sensor: &SensorSeen) -> Finding {
    let timing = &sensor.timing;
    let ms = |seconds: Option<f64>| seconds.unwrap_or(0.0) * 1e3;
    let (expected, expected_hz) = match sensor.table.rate() {
        Rate::Exact(rate_hz) => ("expected", rate_hz),
        Rate::AtLeast(rate_hz) => ("at least", rate_hz),
    };
    let sweeps = match sensor.sweeps_hz() {
        Some(sweeps_hz) if sensor.is_in_parts() => {
            let unseen_ms = sensor.unseen_s() * 1e3;
            format!(", {sweeps_hz:.1} whole sweeps, each direction again after {unseen_ms:.0} ms at most")
        }
        _ => String::new(),
    };
    finding(
        Grade::Good,
        &sensor.table.name,
        format!(
            "{:.1} {} a second ({expected} {expected_hz:.0}){sweeps}; {:.1} / {:.1} ms old when published (p50 / p99), jitter {:.1} ms",
            timing.rate_hz().unwrap_or(0.0),
            samples(sensor),
            ms(timing.age_s(0.5)),
            ms(timing.age_s(0.99)),
            ms(timing.jitter_s())
        ),
        "",
    )
}

/// What its samples are called.
fn samples(sensor: &SensorSeen) -> &'static str {
    match sensor.sort {
        SensorType::Beam => "readings",
        SensorType::Scan if sensor.is_in_parts() => "parts of its sweep",
        SensorType::Scan => "scans",
        SensorType::Row => "rows",
        SensorType::Cloud => "clouds",
    }
}

/// Whether what it says can be true.
fn credibility(sensor: &SensorSeen, findings: &mut Vec<Finding>) {
    let looks_around = !sensor.covered().is_empty();
    let mut say = |grade: Grade, is: String, remedy: &str| {
        findings.push(finding(grade, &sensor.table.name, is, remedy));
    };
    let (rays, unknown, hits) = (sensor.rays, sensor.unknown, sensor.hits);
    if unknown == rays {
        // A single beam into the open sky may well get no answer; of many some do.
        let grade = match sensor.sort {
            SensorType::Beam => Grade::Warning,
            SensorType::Scan | SensorType::Row | SensorType::Cloud => Grade::Blocker,
        };
        say(
            grade,
            "says \"unknown\" all the time: it sees nothing, near or far".to_owned(),
            "hold something 1 m in front of it; if it stays so: dirt, direct sun, a wrong model, a broken device",
        );
        return;
    }
    if 2 * unknown > rays {
        let percent = 100.0 * unknown as f64 / rays as f64;
        say(
            Grade::Warning,
            format!("{percent:.0} % of its readings are \"unknown\""),
            match sensor.sort {
                SensorType::Cloud => {
                    "rays into the ground under a vehicle that stands say so; otherwise dirt, direct sun, dark surfaces"
                }
                SensorType::Beam | SensorType::Scan | SensorType::Row => {
                    "what is not known is not flown into: look for dirt, direct sun, dark or mirroring surfaces"
                }
            },
        );
    }
    if 2 * sensor.too_near > rays && sensor.too_near == hits {
        let shortest_m = sensor.reach_m[0];
        let (grade, remedy) = if looks_around {
            (
                Grade::Blocker,
                "take off its protective cap, and whatever else is right in front of it",
            )
        } else {
            (
                Grade::Warning,
                "as it should be while the vehicle stands on the ground; otherwise take off its protective cap",
            )
        };
        say(
            grade,
            format!("everything that it says is at its shortest range of {shortest_m:.2} m, or below"),
            remedy,
        );
        return;
    }
    // Down at the ground under a vehicle that stands, or computed by somebody, it may be true.
    let stuck = if looks_around && sensor.sort != SensorType::Row {
        Grade::Blocker
    } else {
        Grade::Warning
    };
    let move_it =
        "move something in front of it: if that changes nothing, cut its power for a moment, or replace it";
    if let Some(one_m) = sensor.one_range_m.filter(|_| hits > EQUAL_MAX) {
        say(
            stuck,
            format!(
                "stuck: says {one_m:.3} m in all of {hits} readings, to the last bit; real ranges have noise"
            ),
            move_it,
        );
    } else if let Some(reported) = sensor
        .frozen()
        .filter(|reported| *reported > EQUAL_FRAMES_MAX && hits > EQUAL_MAX)
    {
        let what = samples(sensor);
        say(
            stuck,
            format!("stuck: {reported} {what} say the same, to the last bit; real ranges have noise"),
            move_it,
        );
    }
}

/// Whether it looks at the vehicle.
fn own(sensor: &SensorSeen, own_m: f64, findings: &mut Vec<Finding>) {
    let own = sensor.own(LOOKS_MIN);
    let is_covered_up = sensor.too_near == sensor.hits;
    if own.is_empty() || is_covered_up {
        return;
    }
    findings.push(finding(
        Grade::Warning,
        &sensor.table.name,
        format!(
            "looks at the vehicle itself: something within {own_m:.2} m of its centre, every time, in {}",
            own.text()
        ),
        "mount it where it does not: what is nearer than OA_VEH_RADIUS hides what is behind it, the rest counts as an obstacle",
    ));
}

fn sight(sensor: &SensorSeen) -> Finding {
    let [low_m, high_m] = sensor.reach_m;
    let covered = sensor.covered();
    let width_deg = covered.width_deg();
    let horizon = match width_deg {
        0.0 => "nothing of the horizon".to_owned(),
        360.0 => "360 deg of the horizon".to_owned(),
        _ => format!("{width_deg} deg of the horizon: {}", covered.text()),
    };
    let height = match sensor.elevation_deg {
        Some([low_deg, high_deg]) => format!(", {low_deg:.0} to {high_deg:.0} deg in height"),
        None if width_deg == 0.0 => " (up or down)".to_owned(),
        None => String::new(),
    };
    let percent = 100.0 * sensor.unknown as f64 / sensor.rays.max(1) as f64;
    finding(
        Grade::Good,
        &sensor.table.name,
        format!(
            "sees {horizon}{height}; {low_m:.2} to {high_m:.1} m; {percent:.0} % of its readings unknown"
        ),
        "",
    )
}

/// Sensors that look into the same directions and see another world there.
fn contradictions(sensors: &[SensorSeen], findings: &mut Vec<Finding>) {
    // What is covered up is reported as that.
    let open = |sensor: &&SensorSeen| sensor.too_near < sensor.hits || sensor.hits == 0;
    let open: Vec<&SensorSeen> = sensors.iter().filter(open).collect();
    for (number, one) in open.iter().enumerate() {
        for other in &open[number + 1..] {
            findings.extend(contradiction(one, other));
        }
    }
}

fn contradiction(one: &SensorSeen, other: &SensorSeen) -> Option<Finding> {
    let common: Vec<(usize, f64, f64)> = (0..SECTORS)
        .filter_map(|sector| Some((sector, one.usual_m(sector)?, other.usual_m(sector)?)))
        .collect();
    let nearest =
        |distance: fn(&(usize, f64, f64)) -> f64| common.iter().map(distance).fold(f64::INFINITY, f64::min);
    // A beam reports the nearest obstacle in all its width: only the nearest of the other can be compared with it.
    let is_beam = one.sort == SensorType::Beam || other.sort == SensorType::Beam;
    let differ =
        |one_m: f64, other_m: f64| are_far_apart((one_m, one.reach_m[1]), (other_m, other.reach_m[1]));
    let apart: Vec<&(usize, f64, f64)> = if is_beam {
        let differs = differ(nearest(|both| both.1), nearest(|both| both.2));
        common.iter().filter(|_| differs).collect()
    } else {
        common.iter().filter(|both| differ(both.1, both.2)).collect()
    };
    // A sensor sees over or under what another one sees: that alone is no contradiction.
    if apart.is_empty() || 2 * apart.len() <= common.len() {
        return None;
    }
    let nearest_apart = |distance: fn(&(usize, f64, f64)) -> f64| {
        apart
            .iter()
            .map(|both| distance(both))
            .fold(f64::INFINITY, f64::min)
    };
    let reported = |distance_m: f64, reach_m: f32| match distance_m.is_finite() {
        true => format!("{distance_m:.1} m"),
        false => format!("nothing up to {reach_m:.1} m"),
    };
    let sectors: Vec<usize> = apart.iter().map(|both| both.0).collect();
    Some(finding(
        Grade::Warning,
        &format!("{}, {}", one.table.name, other.table.name),
        format!(
            "contradict each other: {} and {} in the same direction, {}",
            reported(nearest_apart(|both| both.1), one.reach_m[1]),
            reported(nearest_apart(|both| both.2), other.reach_m[1]),
            Sectors::of(|sector| sectors.contains(&sector)).text()
        ),
        "one of them is mounted otherwise than configured (orientation, yaw_deg), or measures wrongly",
    ))
}

/// Whether two answers, each a distance (infinity: nothing) and the reach of who gives it, contradict each other.
fn are_far_apart(one: (f64, f32), other: (f64, f32)) -> bool {
    let (near, far) = if one.0 <= other.0 {
        (one, other)
    } else {
        (other, one)
    };
    let far_m = far.0.min(f64::from(far.1));
    near.0.is_finite() && far_m > CONTRADICTION_RATIO * near.0 && far_m - near.0 > CONTRADICTION_M
}

/// What the guard makes of them all.
fn of_ring(seen: &Seen, findings: &mut Vec<Finding>) {
    let ring = &seen.ring;
    let Some(rate_hz) = ring.timing.rate_hz() else {
        findings.push(finding(
            Grade::Blocker,
            "ring",
            format!(
                "the guard reports nothing of what it sees in {:.0} s",
                seen.seconds
            ),
            "`jink status` shows what collision_guard does; its log stands beside the others",
        ));
        return;
    };
    findings.push(ring_pace(ring, rate_hz));
    if seen.states == 0 {
        findings.push(finding(
            Grade::Blocker,
            "vehicle/state",
            "the vehicle's position is not known, so no range has a place".to_owned(),
            "wait for the autopilot's position; `jink check link` shows what is missing",
        ));
        return;
    }
    blind(seen, findings);
}

fn ring_pace(ring: &RingSeen, rate_hz: f64) -> Finding {
    let expected_hz = topics::RING.row.rate_hz;
    let ms = |share: f64| {
        ring.age_s(share)
            .map_or("-".to_owned(), |s| format!("{:.0}", s * 1e3))
    };
    let is = format!(
        "{rate_hz:.1} rings a second (expected {expected_hz:.0}); the oldest direction in them is {} / {} ms old (p50 / p99)",
        ms(0.5),
        ms(0.99)
    );
    let grade = if rate_hz < SLOW * expected_hz {
        Grade::Blocker
    } else if rate_hz < RING_SLOW * expected_hz {
        Grade::Warning
    } else {
        Grade::Good
    };
    let remedy = match grade {
        Grade::Good => "",
        Grade::Warning | Grade::Blocker => "the board is too busy: `jink top` shows who takes the time",
    };
    finding(grade, "ring", is, remedy)
}

/// Directions that nobody sees.
///
/// Ahead it is more than a restriction. Where collision prevention is on and motion without data is not allowed, a pilot's forward
/// stick does nothing; where it is off, what is planned is flown nose first (OA_YAW_MODE = 1), and a guard that sees nothing
/// there passes nothing. A sensor that looks there and gets no answer is no such fault: nothing may stand within its range, and in
/// the air the ground answers.
fn blind(seen: &Seen, findings: &mut Vec<Finding>) {
    let (ring, params) = (&seen.ring, &seen.params);
    let blind = ring.blind();
    let speaks = |sensor: &&SensorSeen| sensor.timing.samples() > 0;
    let looks_ahead = seen
        .sensors
        .iter()
        .filter(speaks)
        .any(|sensor| sensor.table.looks_ahead());
    let prevents = params.get(&params::CP_DIST) > 0.0;
    let goes_unseen = params.get(&params::CP_GO_NO_DATA) > 0.5;
    let consequence = match (prevents, goes_unseen) {
        (true, false) => "collision prevention refuses motion there (CP_GO_NO_DATA = 0)",
        (true, true) => "collision prevention lets the pilot fly there unseen (CP_GO_NO_DATA = 1)",
        (false, _) => "nothing that is planned goes there",
    };
    if blind.is_empty() {
        let is = "360 deg known: no direction is blind".to_owned();
        findings.push(finding(Grade::Good, "blind", is, ""));
    } else {
        let is_ahead = blind.holds_ahead(AHEAD_DEG);
        let flies_nose_first = params.get(&params::OA_YAW_MODE) > 0.5;
        let nothing_flies = is_ahead && if prevents { !goes_unseen } else { flies_nose_first };
        let grade = if nothing_flies && !looks_ahead {
            Grade::Blocker
        } else {
            Grade::Warning
        };
        let remedy = match (is_ahead, looks_ahead) {
            (true, false) => {
                "let a sensor look ahead: mend the one that does, or correct where it is mounted (orientation, yaw_deg)"
            }
            (true, true) => {
                "a sensor looks ahead, and nothing answers: as it is where nothing stands within its range; hold something in front of \
                 it and look again"
            }
            (false, _) => "none if it is meant so; otherwise another sensor, or another mounting",
        };
        let known_deg = 360.0 - blind.width_deg();
        findings.push(finding(
            grade,
            "blind",
            format!("blind: {}; {known_deg} deg known; {consequence}", blind.text()),
            remedy,
        ));
    }
    let flickering = ring.flickering();
    if !flickering.is_empty() {
        findings.push(finding(
            Grade::Warning,
            "blind",
            format!("known only at times: {}", flickering.text()),
            "look at the sensor that sees there: its rate, its unknown readings",
        ));
    }
}
