use super::{OrientationKey, Seen, SensorTable, judge, subject};
use jink_control::findings::{Finding, Grade};
use jink_control::known_space::KnownSpace;
use jink_shared_types::events::{AVOIDANCE_READY, EventSample, RANGEFINDER_LOST};
use jink_shared_types::frames::Mounting;
use jink_shared_types::map::declared_as;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{CloudPoint, PointCloud, RangeScan, RayKind, ScanFrame};
use jink_shared_types::ring::{SECTORS, SectorRing};
use jink_shared_types::view::Missing;
use jink_shared_types::{Coded, Point, SampleHeader, Timestamp};
use nalgebra::UnitQuaternion;
use proptest::prelude::*;

const SECONDS: f64 = 5.0;
const BEGIN_S: f64 = 100.0;

/// A vehicle that is listened to for five seconds.
struct Rig(Seen);

/// When and how samples come.
#[derive(Clone, Copy)]
struct Pace {
    rate_hz: f64,
    age_s: f64,
    /// The capture of every tenth is this much later than it should be (s).
    odd_s: f64,
}

impl Pace {
    fn of(rate_hz: f64) -> Self {
        Self {
            rate_hz,
            age_s: 0.004,
            odd_s: 0.0,
        }
    }

    fn headers(self) -> impl Iterator<Item = SampleHeader> {
        (0..(SECONDS * self.rate_hz) as u32).map(move |i| {
            let publish_s = BEGIN_S + f64::from(i) / self.rate_hz;
            let odd_s = if i % 10 == 5 { self.odd_s } else { 0.0 };
            SampleHeader {
                sequence: 1 << 32 | u64::from(i),
                capture: Timestamp::from_seconds(publish_s - self.age_s + odd_s),
                publish: Timestamp::from_seconds(publish_s),
                ..SampleHeader::default()
            }
        })
    }
}

impl Rig {
    /// With `sensors`, each a name and a kind, and a guard that knows all but the sectors in `unknown`.
    fn new(sensors: &[(&str, &str)], unknown: impl Fn(usize) -> bool) -> Self {
        let tables = sensors.iter().map(|(name, kind)| SensorTable {
            name: (*name).to_owned(),
            kind: (*kind).to_owned(),
            ..SensorTable::default()
        });
        let mut seen = Seen::new(tables, ParamSet::default());
        seen.seconds = SECONDS;
        seen.states = 250;
        seen.space = Some(KnownSpace::new(0, Missing::Nothing));
        for header in Pace::of(15.0).headers() {
            let known = |sector: usize| if unknown(sector) { f32::NAN } else { 4.0 };
            let ring = SectorRing {
                distance_m: std::array::from_fn(known),
                seen: [Timestamp::from_seconds(header.publish.seconds() - 0.05); SECTORS],
                ..SectorRing::default()
            };
            seen.ring.take(&ring, &header);
        }
        Self(seen)
    }

    /// One sensor, with a guard that knows everything.
    fn one(kind: &str) -> Self {
        Self::new(&[("it", kind)], |_| false)
    }

    fn scans(mut self, sensor: usize, pace: Pace, scan: impl Fn(usize) -> RangeScan) -> Self {
        for (i, header) in pace.headers().enumerate() {
            self.0.sensors[sensor].scan(&scan(i), &header, 0.0, 0.5);
        }
        self
    }

    fn clouds(mut self, sensor: usize, pace: Pace, mut fill: impl FnMut(usize, &mut PointCloud)) -> Self {
        let mut cloud = PointCloud::boxed();
        for (i, header) in pace.headers().enumerate() {
            cloud.len = 0;
            cloud.range_max_m = 12.0;
            fill(i, &mut cloud);
            self.0.sensors[sensor].cloud(&cloud, &header, 0.5);
        }
        self
    }

    fn set(mut self, params: &[(&str, f64)]) -> Self {
        for (name, value) in params {
            self.0.params.set(name, *value).unwrap();
        }
        self
    }

    fn found(&self) -> Vec<Finding> {
        let findings = judge(&self.0);
        for one in &findings {
            assert_eq!(one.remedy.is_empty(), one.grade == Grade::Good, "{one:?}");
        }
        findings
    }

    /// What is wrong, without what is good.
    fn faults(&self) -> Vec<(Grade, String)> {
        let all = self.found().into_iter();
        all.filter(|one| one.grade != Grade::Good)
            .map(|one| (one.grade, one.is))
            .collect()
    }
}

/// Which sectors are unknown, parameters, and what is reported of it.
type Blind = (
    fn(usize) -> bool,
    &'static [(&'static str, f64)],
    Grade,
    &'static str,
);

/// A single beam, ahead.
fn beam(range_m: f32) -> RangeScan {
    beams(0.0, &[range_m])
}

/// Beams of one degree, from `first_deg` on clockwise.
fn beams(first_deg: f32, range_m: &[f32]) -> RangeScan {
    let mut scan = RangeScan {
        angle_first_rad: first_deg.to_radians(),
        angle_step_rad: 1.0_f32.to_radians(),
        beam_width_rad: 1.0_f32.to_radians(),
        range_min_m: 0.2,
        range_max_m: 8.0,
        beams: range_m.len() as u32,
        ..RangeScan::default()
    };
    scan.range_m[..range_m.len()].copy_from_slice(range_m);
    scan
}

/// A range with noise that never repeats.
fn noisy(range_m: f32, i: usize) -> f32 {
    range_m + 0.001 * (i % 97) as f32 + 1e-5 * i as f32
}

fn down(mut scan: RangeScan) -> RangeScan {
    let turned = UnitQuaternion::from_euler_angles(0.0, -std::f64::consts::FRAC_PI_2, 0.0);
    scan.mounting = Mounting::from_rotation(turned);
    scan
}

fn assert_only(rig: &Rig, grade: Grade, words: &str) {
    let faults = rig.faults();
    assert!(
        faults.len() == 1 && faults[0].0 == grade && faults[0].1.contains(words),
        "not only {grade:?} {words:?}: {faults:#?}"
    );
}

#[test]
fn a_good_rig_has_nothing_to_mend_and_is_reported_with_its_figures() {
    let rig = Rig::new(&[("front", "rangefinder"), ("lidar", "lidar_2d")], |_| false)
        .scans(0, Pace::of(20.0), |i| beam(noisy(3.0, i)))
        .scans(1, Pace::of(10.0), |i| beams(0.0, &[noisy(3.0, i); 360]));
    let found = rig.found();
    assert!(found.iter().all(|one| one.grade == Grade::Good), "{found:#?}");
    let said = |words: &str| found.iter().any(|one| one.is.contains(words));
    assert!(
        said(
            "20.0 readings a second (expected 20); 4.0 / 4.0 ms old when published (p50 / p99), jitter 0.0 ms"
        ),
        "{found:#?}"
    );
    assert!(said(
        "sees 5 deg of the horizon: 357.5 to 2.5 deg (forward); 0.20 to 8.0 m; 0 % of its readings unknown"
    ));
    assert!(said("sees 360 deg of the horizon; 0.20 to 8.0 m"));
    assert!(said("360 deg known: no direction is blind"));
    assert!(said(
        "15.0 rings a second (expected 15); the oldest direction in them is 50 / 50 ms old"
    ));
    assert_eq!(subject(&rig.0), "2 sensors, 360 of 360 deg known to the guard");
}

#[test]
fn each_fault_of_one_sensor_is_reported_by_its_own_sentence() {
    let of = |pace: Pace, scan: &dyn Fn(usize) -> RangeScan| Rig::one("rangefinder").scans(0, pace, scan);
    let usual = Pace::of(20.0);
    let seen = |i: usize| beam(noisy(3.0, i));
    let old = |age_s: f64| Pace { age_s, ..usual };
    let odd = |odd_s: f64| Pace { odd_s, ..usual };
    let cases: [(Rig, Grade, &str); 11] = [
        (
            Rig::one("rangefinder"),
            Grade::Blocker,
            "silent: nothing has come from it in 5 s",
        ),
        (
            of(Pace::of(9.0), &seen),
            Grade::Warning,
            "9.0 readings a second, where 20 are expected",
        ),
        (
            of(Pace::of(3.0), &seen),
            Grade::Blocker,
            "3.0 readings a second, where 20 are expected",
        ),
        (
            of(Pace::of(0.2), &seen),
            Grade::Blocker,
            "one of its readings in 5 s, where 20 a second",
        ),
        (
            of(Pace::of(40.0), &seen),
            Grade::Warning,
            "40.0 readings a second, where 20 are expected: more than",
        ),
        (
            of(old(0.4), &seen),
            Grade::Blocker,
            "half of its readings are 400 ms old or older when published",
        ),
        (
            of(odd(-0.1), &seen),
            Grade::Blocker,
            "10 of 100 readings were captured no later than the one before",
        ),
        (
            of(odd(0.03), &seen),
            Grade::Blocker,
            "10 of 100 readings were captured after they were published",
        ),
        (
            of(usual, &|_| beam(f32::NAN)),
            Grade::Warning,
            "says \"unknown\" all the time",
        ),
        (
            of(usual, &|i| {
                beam(if i % 3 == 0 { noisy(3.0, i) } else { f32::NAN })
            }),
            Grade::Warning,
            "66 % of its readings are \"unknown\"",
        ),
        (
            of(usual, &|i| beam(if i % 2 == 0 { 0.0 } else { 0.21 })),
            Grade::Blocker,
            "everything that it says is at its shortest range of 0.20 m, or below",
        ),
    ];
    for (rig, grade, words) in &cases {
        assert_only(rig, *grade, words);
    }
}

#[test]
fn a_capture_that_is_never_reported_is_a_fault_of_its_own() {
    let mut rig = Rig::one("rangefinder");
    for mut header in Pace::of(20.0).headers() {
        header.capture = Timestamp::NEVER;
        rig.0.sensors[0].scan(
            &beam(noisy(3.0, header.sequence as usize % 100)),
            &header,
            0.0,
            0.5,
        );
    }
    assert_only(&rig, Grade::Blocker, "do not say when they were captured");
}

#[test]
fn many_beams_that_all_say_unknown_are_broken_and_rates_of_who_decides_himself_are_not_judged() {
    let blind = Rig::one("lidar_2d").scans(0, Pace::of(10.0), |_| beams(0.0, &[f32::NAN; 90]));
    assert_only(&blind, Grade::Blocker, "says \"unknown\" all the time");
    for rate_hz in [5.0, 50.0] {
        let row = Rig::one("obstacle_row").scans(0, Pace::of(rate_hz), |i| RangeScan {
            frame: Coded::new(ScanFrame::Level),
            ..beams(0.0, &[noisy(3.0, i); 72])
        });
        assert_eq!(row.faults(), []);
    }
}

#[test]
fn looking_down_from_the_ground_all_near_and_all_equal_are_no_blockers() {
    let near = Rig::one("rangefinder").scans(0, Pace::of(20.0), |_| down(beam(0.1)));
    assert_only(&near, Grade::Warning, "at its shortest range of 0.20 m");
    let equal = Rig::one("rangefinder").scans(0, Pace::of(20.0), |_| down(beam(0.3)));
    assert_only(
        &equal,
        Grade::Warning,
        "stuck: says 0.300 m in all of 100 readings",
    );
    let good = equal.found();
    assert!(
        good.iter()
            .any(|one| one.is.starts_with("sees nothing of the horizon (up or down)"))
    );
}

proptest! {
    #[test]
    fn one_value_in_all_readings_is_stuck_and_another_one_among_them_is_not(
        range_m in 0.8..7.9f32, odd in 0..100usize, beams_each in 1..4usize,
    ) {
        let stuck = Rig::one("rangefinder").scans(0, Pace::of(20.0), |_| beams(0.0, &[range_m; 3][..beams_each]));
        assert_only(&stuck, Grade::Blocker, "stuck: says ");
        let moved = Rig::one("rangefinder").scans(0, Pace::of(20.0), |i| {
            let here_m = if i == odd { f32::from_bits(range_m.to_bits() + 1) } else { range_m };
            beams(0.0, &[here_m; 3][..beams_each])
        });
        prop_assert_eq!(moved.faults(), []);
    }

    #[test]
    fn nothing_and_unknown_may_be_said_for_ever(parts in proptest::collection::vec(any::<bool>(), 1..40)) {
        let range_m: Vec<f32> = parts.iter().map(|part| if *part { f32::INFINITY } else { f32::NAN }).collect();
        let rig = Rig::one("lidar_2d").scans(0, Pace::of(10.0), |_| beams(0.0, &range_m));
        prop_assert!(rig.faults().iter().all(|(_, is)| !is.contains("stuck")));
    }

    #[test]
    fn scans_that_repeat_are_stuck_however_they_look(range_m in proptest::collection::vec(0.8..7.9f32, 2..40)) {
        let stuck = Rig::one("lidar_2d").scans(0, Pace::of(10.0), |_| beams(0.0, &range_m));
        assert_only(&stuck, Grade::Blocker, "stuck: ");
        let lives = Rig::one("lidar_2d").scans(0, Pace::of(10.0), |i| {
            let mut range_m = range_m.clone();
            range_m[0] = noisy(range_m[0], i);
            beams(0.0, &range_m)
        });
        prop_assert_eq!(lives.faults(), []);
    }

    #[test]
    fn whatever_comes_is_judged_without_a_slip(
        readings in proptest::collection::vec(
            (any::<f32>(), any::<f32>(), any::<f32>(), any::<f32>(), any::<u32>(), any::<u64>(), any::<u64>()), 0..30),
        unknown in proptest::collection::vec(any::<bool>(), SECTORS), kind in 0..6usize,
    ) {
        let (kind, _) = jink_runtime::config::SENSOR_KINDS[kind];
        let mut rig = Rig::new(&[("a", kind), ("b", "lidar_2d")], |sector| unknown[sector]);
        for (range_m, angle_rad, width_rad, reach_m, beams, capture_ns, publish_ns) in readings {
            let scan = RangeScan {
                angle_first_rad: angle_rad,
                angle_step_rad: width_rad,
                beam_width_rad: width_rad,
                range_max_m: reach_m,
                beams,
                range_m: [range_m; jink_shared_types::ranges::SCAN_BEAMS],
                ..RangeScan::default()
            };
            let header = SampleHeader {
                capture: Timestamp::from_ns(capture_ns),
                publish: Timestamp::from_ns(publish_ns),
                ..SampleHeader::default()
            };
            rig.0.sensors[0].scan(&scan, &header, f64::from(angle_rad), 0.5);
            rig.0.sensors[1].scan(&scan, &header, 0.0, 0.5);
        }
        let found = rig.found();
        prop_assert!(found.iter().all(|one| !one.is.is_empty()));
        prop_assert!(rig.0.figures()["sensors"][0]["name"] == "a");
    }
}

#[test]
fn a_cloud_that_stands_still_is_stuck_and_one_that_lives_is_reported_with_its_height() {
    let fill = |i: usize, cloud: &mut PointCloud| {
        for step in 0..360_u16 {
            let (sin, cos) = f32::from(step).to_radians().sin_cos();
            let height_m = f32::from(step % 9) - 4.0;
            let range_m = noisy(4.0, i);
            cloud.push(CloudPoint {
                forward_m: range_m * cos,
                right_m: range_m * sin,
                down_m: height_m,
                kind: Coded::new(RayKind::Hit),
                ..CloudPoint::default()
            });
        }
    };
    let lives = Rig::one("lidar_3d").clouds(0, Pace::of(10.0), fill);
    assert_eq!(lives.faults(), []);
    let found = lives.found();
    let said = "-45 to 45 deg in height; 0.00 to 12.0 m";
    assert!(found.iter().any(|one| one.is.contains(said)), "{found:#?}");
    let stuck = Rig::one("lidar_3d").clouds(0, Pace::of(10.0), |_, cloud| fill(0, cloud));
    assert_only(
        &stuck,
        Grade::Blocker,
        "stuck: 50 clouds say the same, to the last bit",
    );
}

#[test]
fn what_is_always_as_near_as_the_vehicle_is_the_vehicle() {
    let leg = |i: usize, every: usize| {
        let mut range_m = [noisy(4.0, i); 90];
        if i.is_multiple_of(every) {
            range_m[29..32].fill(noisy(0.32, i));
        }
        beams(45.0, &range_m)
    };
    let always = Rig::one("lidar_2d").scans(0, Pace::of(10.0), |i| leg(i, 1));
    assert_only(
        &always,
        Grade::Warning,
        "looks at the vehicle itself: something within 0.50 m of its centre, every time, in 72.5 to 77.5 deg (right)",
    );
    let at_times = Rig::one("lidar_2d").scans(0, Pace::of(10.0), |i| leg(i, 2));
    assert_eq!(at_times.faults(), [], "somebody walks past");
}

#[test]
fn a_sweep_in_parts_is_counted_in_sweeps_and_what_it_comes_back_to_too_late_is_reported() {
    // Eight parts of 20 degrees, there and back.
    let part = |i: usize| {
        let place = i % 16;
        let place = if place < 8 { place } else { 15 - place };
        beams(-80.0 + 20.0 * place as f32 + 1.0, &[noisy(4.0, i); 19])
    };
    let swept = |rate_hz: f64| {
        let mut rig = Rig::one("rangefinder");
        rig.0.sensors[0].table.model = Some("sf45b".to_owned());
        rig.scans(0, Pace::of(rate_hz), part)
    };
    let fast = swept(40.0);
    assert_eq!(fast.faults(), []);
    let found = fast.found();
    let said = "40.0 parts of its sweep a second (at least 20), 4.8 whole sweeps, each direction again after 375 ms at most";
    assert!(found.iter().any(|one| one.is.contains(said)), "{found:#?}");
    let slow = swept(20.0);
    assert_only(
        &slow,
        Grade::Warning,
        "looks away from some of its directions for 750 ms",
    );
}

#[test]
fn two_that_see_different_worlds_in_one_direction_contradict_each_other() {
    let pair = |front_m: f32, lidar_m: f32| {
        Rig::new(&[("front", "rangefinder"), ("lidar", "lidar_2d")], |_| false)
            .scans(0, Pace::of(20.0), |i| beam(noisy(front_m, i)))
            .scans(1, Pace::of(10.0), |i| beams(-60.0, &[noisy(lidar_m, i); 120]))
    };
    assert_only(
        &pair(1.5, 6.0),
        Grade::Warning,
        "contradict each other: 1.5 m and 6.0 m in the same direction, 357.5 to 2.5 deg (forward)",
    );
    assert_only(
        &pair(f32::INFINITY, 2.0),
        Grade::Warning,
        "nothing up to 8.0 m and 2.0 m",
    );
    assert_eq!(pair(3.0, 5.0).faults(), [], "a tree in one half of a sector");
    assert_eq!(
        pair(7.0, f32::INFINITY).faults(),
        [],
        "beyond what the other sees"
    );
    assert_only(&pair(0.1, 4.0), Grade::Blocker, "at its shortest range");
    let aside = Rig::new(&[("front", "rangefinder"), ("lidar", "lidar_2d")], |_| false)
        .scans(0, Pace::of(20.0), |i| beam(noisy(1.5, i)))
        .scans(1, Pace::of(10.0), |i| beams(90.0, &[noisy(6.0, i); 120]));
    assert_eq!(aside.faults(), [], "they look elsewhere");
}

#[test]
fn what_nobody_sees_is_reported_and_weighs_as_much_as_it_hinders() {
    const ON: (&str, f64) = ("CP_DIST", 5.0);
    let behind = |sector: usize| (20..30).contains(&sector);
    let ahead = |sector: usize| !(5..67).contains(&sector);
    let seen = |unknown: fn(usize) -> bool, params: &[(&str, f64)]| {
        Rig::new(&[("it", "rangefinder")], unknown)
            .scans(0, Pace::of(20.0), |i| beam(noisy(3.0, i)))
            .set(params)
    };
    let cases: [Blind; 6] = [
        (
            behind,
            &[],
            Grade::Warning,
            "blind: 97.5 to 147.5 deg (right, behind); 310 deg known; nothing that is planned",
        ),
        (
            behind,
            &[ON],
            Grade::Warning,
            "collision prevention refuses motion there",
        ),
        (ahead, &[], Grade::Blocker, "blind: 332.5 to 22.5 deg (forward)"),
        (
            ahead,
            &[("OA_YAW_MODE", 0.0)],
            Grade::Warning,
            "blind: 332.5 to 22.5 deg (forward)",
        ),
        (
            ahead,
            &[ON],
            Grade::Blocker,
            "collision prevention refuses motion there (CP_GO_NO_DATA = 0)",
        ),
        (
            ahead,
            &[ON, ("CP_GO_NO_DATA", 1.0)],
            Grade::Warning,
            "lets the pilot fly there unseen",
        ),
    ];
    for (unknown, params, grade, words) in cases {
        assert_only(&seen(unknown, params), grade, words);
    }
    // In the open nothing answers a camera that stands on the ground.
    let mut open = seen(ahead, &[]);
    open.0.sensors[0].table.kind = "depth_camera".to_owned();
    assert!(open.0.sensors[0].table.looks_ahead());
    let found = open.found();
    let blind = found.iter().find(|finding| finding.about == "blind").unwrap();
    assert!(
        blind.grade == Grade::Warning && blind.remedy.contains("nothing stands within its range"),
        "{blind:?}"
    );
    // One that looks elsewhere, or nowhere, does not help.
    for (yaw_deg, orientation) in [(90.0, None), (0.0, Some("back")), (0.0, Some("up"))] {
        let table = &mut open.0.sensors[0].table;
        table.yaw_deg = Some(yaw_deg);
        table.orientation = orientation.map(|name| OrientationKey::Named(name.to_owned()));
        assert!(!table.looks_ahead(), "{yaw_deg} {orientation:?}");
    }
    let everything = seen(|_| true, &[]);
    assert_only(&everything, Grade::Blocker, "blind: all around; 0 deg known");
}

#[test]
fn a_direction_that_comes_and_goes_is_reported_as_that() {
    let mut rig = Rig::one("rangefinder").scans(0, Pace::of(20.0), |i| beam(noisy(3.0, i)));
    for (i, header) in Pace::of(15.0).headers().enumerate() {
        let mut ring = SectorRing {
            distance_m: [4.0; SECTORS],
            seen: [header.publish; SECTORS],
            ..SectorRing::default()
        };
        if i % 4 == 0 {
            ring.distance_m[18] = f32::NAN;
        }
        let header = SampleHeader {
            sequence: header.sequence + 1_000,
            publish: header.publish.plus_seconds(SECONDS),
            capture: header.capture.plus_seconds(SECONDS),
            ..header
        };
        // As if it had gone on without a gap.
        rig.0.ring.take(
            &ring,
            &SampleHeader {
                sequence: 1 << 32 | (75 + i as u64),
                ..header
            },
        );
    }
    assert_only(
        &rig,
        Grade::Warning,
        "known only at times: 87.5 to 92.5 deg (right)",
    );
}

#[test]
fn a_guard_that_is_silent_or_has_no_position_is_reported_before_what_follows_from_it() {
    let feed = |rig: Rig| rig.scans(0, Pace::of(20.0), |i| beam(noisy(3.0, i)));
    let mut silent = feed(Rig::one("rangefinder"));
    silent.0.ring = super::RingSeen::default();
    assert_only(
        &silent,
        Grade::Blocker,
        "the guard reports nothing of what it sees in 5 s",
    );
    let mut lost = feed(Rig::new(&[("it", "rangefinder")], |_| true));
    lost.0.states = 0;
    assert_only(&lost, Grade::Blocker, "the vehicle's position is not known");
    let none = Rig::new(&[], |_| false);
    assert_only(&none, Grade::Blocker, "no sensor is configured");
}

#[test]
fn sensors_with_which_nothing_can_be_planned_keep_it_on_the_ground_and_declarations_are_warned_of() {
    let space = |rig: &Rig| -> Vec<(Grade, String)> {
        let found = rig.found().into_iter().filter(|finding| finding.about == "space");
        found
            .map(|finding| (finding.grade, format!("{} -> {}", finding.is, finding.remedy)))
            .collect()
    };
    let mut rig = Rig::one("lidar_2d");
    rig.0.space = None;
    assert_eq!(space(&rig)[0].0, Grade::Warning, "map and planner say nothing");
    rig.0.space = Some(KnownSpace::new(0, Missing::Above));
    let found = space(&rig);
    assert_eq!((found[0].0, found[1].0), (Grade::Blocker, Grade::Good));
    assert!(
        found[0]
            .1
            .starts_with("cannot plan: nobody sees above -> add a sensor that looks up"),
        "{found:?}"
    );
    rig.0.space = Some(KnownSpace::new(declared_as::BAND, Missing::Nothing));
    let found = space(&rig);
    assert_eq!((found[0].0, found[1].0), (Grade::Good, Grade::Warning));
    assert!(
        found[1].1.contains("planar band -> make sure that it holds"),
        "{found:?}"
    );
}

#[test]
fn what_the_pilot_has_read_of_sensors_is_reported_again_with_what_to_do() {
    let mut rig = Rig::one("rangefinder").scans(0, Pace::of(20.0), |i| beam(noisy(3.0, i)));
    rig.0
        .events
        .push(EventSample::new(&AVOIDANCE_READY, "", [0.0; 2]));
    rig.0
        .events
        .push(EventSample::new(&RANGEFINDER_LOST, "front", [0.0; 2]));
    assert_only(&rig, Grade::Warning, "jink: rangefinder front lost");
}

#[test]
fn a_sensor_away_from_the_centre_is_measured_from_the_centre() {
    // 0.4 m ahead of a sensor that sits 0.3 m ahead itself.
    let ahead = Rig::one("rangefinder").scans(0, Pace::of(20.0), |i| RangeScan {
        origin: Point::new(0.3, 0.0, 0.0),
        ..beam(noisy(0.4, i))
    });
    assert_eq!(ahead.faults(), []);
}
