//! A recording with known motions, and what its page says.

use jink_recorder::reading::ReadError;
use jink_recorder::{About, Channel, Kept, Recording};
use jink_report::{AutopilotLog, Flight, ReportError};
use jink_shared_types::coded::{Coded, Flag};
use jink_shared_types::events::{EventSample, PROCESS_RESTARTED};
use jink_shared_types::layout::{Layout, bytes_of, type_name};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::motion::{
    ApprovedTrajectory, BezierPiece, MotionLimits, Route, TrajectoryMode, Verdict,
};
use jink_shared_types::ring::{SECTORS, SectorRing};
use jink_shared_types::topics::{APPROVED, EVENT, LINK_STATUS, RING, ROUTE, Topic, VEHICLE_STATE};
use jink_shared_types::tracking::Tracking;
use jink_shared_types::vehicle::{NavMode, VehicleState};
use jink_shared_types::{Point, SampleHeader, Timestamp, Velocity};
use jink_testkit::temp_folder::TempFolder;
use nalgebra::Vector3;
use serde_json::Value;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

/// The board's clock when the motors begin to run.
const BEGIN: Timestamp = Timestamp { ns: 100_000_000_000 };
/// The day's then.
const UNIX_NS: u64 = 1_795_000_000_000_000_000;
/// What the autopilot's clock is ahead of the board's (ns).
const AHEAD_NS: i64 = -90_000_000_000;
const SPEED_MPS: f64 = 3.0;
const FLIGHT_S: f64 = 4.0;

struct Writer<'a> {
    recording: Recording<Cursor<&'a mut Vec<u8>>>,
    channels: Vec<String>,
}

impl Writer<'_> {
    fn add<T: Layout>(&mut self, topic: Topic<T>, type_name: &str, time_s: f64, sample: &T) {
        let topic = topic.row.name;
        if !self.channels.iter().any(|name| name == topic) {
            self.channels.push(topic.to_owned());
            let channel = Channel {
                topic: topic.to_owned(),
                type_name: type_name.to_owned(),
                payload_bytes: size_of::<T>(),
                schema: String::new(),
            };
            self.recording.add(&channel).unwrap();
        }
        let time = BEGIN.plus_seconds(time_s);
        let header = &SampleHeader {
            publish: time,
            capture: time,
            ..SampleHeader::default()
        };
        let channel = self.channels.iter().position(|name| name == topic).unwrap();
        let payload = bytes_of(sample);
        self.recording
            .write(&Kept {
                channel,
                header,
                payload,
            })
            .unwrap();
    }

    fn put<T: Layout>(&mut self, topic: Topic<T>, time_s: f64, sample: &T) {
        self.add(topic, type_name::<T>(), time_s, sample);
    }
}

fn recording(fill: impl FnOnce(&mut Writer<'_>)) -> Vec<u8> {
    let mut bytes = Vec::new();
    let about = About {
        facts: BTreeMap::from([("instance".to_owned(), "test".to_owned())]),
        files: BTreeMap::from([(
            "jink.toml".to_owned(),
            "# </script><script>alert(1)</script>".to_owned(),
        )]),
    };
    {
        let mut writer = Writer {
            recording: Recording::begin(Cursor::new(&mut bytes), BEGIN, UNIX_NS, &about).unwrap(),
            channels: Vec::new(),
        };
        fill(&mut writer);
        writer.recording.finish().unwrap();
    }
    bytes
}

/// North with 3 m/s, along a trajectory 0.1 m to the east of it; something stands 2 m to the left.
fn fly(writer: &mut Writer<'_>) {
    let mut approved = ApprovedTrajectory {
        verdict: Coded::new(Verdict::Passed),
        ..ApprovedTrajectory::default()
    };
    let trajectory = &mut approved.trajectory;
    trajectory.start = BEGIN;
    trajectory.mode = Coded::new(TrajectoryMode::Plan);
    trajectory.limits = MotionLimits {
        speed_mps: SPEED_MPS,
        tube_m: 0.5,
        ..MotionLimits::default()
    };
    let points =
        std::array::from_fn(|i| Vector3::new(SPEED_MPS * 2.0 * FLIGHT_S * i as f64 / 5.0, 0.1, -2.0));
    assert!(trajectory.push(BezierPiece::new(&points, [0.0; 6], 2.0 * FLIGHT_S)));
    let route = Route {
        tracking: Tracking::PX4_OFFBOARD,
        reached_mps: 4.0,
        allowed_mps: 4.0,
        ..Route::default()
    };
    let mut ring = SectorRing {
        distance_m: [f32::INFINITY; SECTORS],
        ..SectorRing::default()
    };
    ring.distance_m[SECTORS * 3 / 4] = 2.0;
    let link = LinkStatus {
        timesync_converged: Flag::YES,
        clock_offset_ns: AHEAD_NS,
        ..LinkStatus::default()
    };
    for step in -20..=(FLIGHT_S * 50.0) as i32 {
        let time_s = f64::from(step) / 50.0;
        let vehicle = VehicleState {
            position: Point::new(SPEED_MPS * time_s.max(0.0), 0.0, -2.0),
            velocity: Velocity::new(SPEED_MPS, 0.0, 0.0),
            mode: Coded::new(NavMode::Offboard),
            armed: Flag::from(step >= 0),
            position_valid: Flag::YES,
            home_down_m: 0.0,
            ..VehicleState::default()
        };
        // Blocks of a topic, as a recorder hands them over: those of the vehicle come first.
        writer.put(VEHICLE_STATE, time_s, &vehicle);
        if step % 5 == 0 {
            writer.recording.flush().unwrap();
            writer.put(APPROVED, time_s - 0.01, &approved);
            writer.put(ROUTE, time_s - 0.01, &route);
            writer.put(RING, time_s - 0.01, &ring);
            writer.put(LINK_STATUS, time_s - 0.01, &link);
        }
    }
    writer.put(
        EVENT,
        1.0,
        &EventSample::new(&PROCESS_RESTARTED, "planner", [0.0; 2]),
    );
}

fn written(folder: &TempFolder, name: &str, bytes: &[u8]) -> PathBuf {
    let file = folder.join(name);
    std::fs::write(&file, bytes).unwrap();
    file
}

fn read(file: &Path) -> Result<Flight, ReportError> {
    Flight::read(&[file.to_owned()], &mut |_, _| {})
}

fn data_of(page: &str) -> Value {
    let (_, after) = page.split_once(r#"id="data">"#).unwrap();
    serde_json::from_str(after.split_once("</script>").unwrap().0).unwrap()
}

fn column(data: &Value, name: &str) -> Vec<f64> {
    let values = data["rows"][name].as_array();
    let values = values.unwrap_or_else(|| panic!("no column {name}"));
    values
        .iter()
        .map(|value| value.as_f64().unwrap_or(f64::NAN))
        .collect()
}

#[test]
fn its_figures_are_those_of_the_flight() {
    let folder = TempFolder::new("page");
    let page = read(&written(&folder, "flight.mcap", &recording(fly)))
        .unwrap()
        .page();
    let data = data_of(&page);
    let times = column(&data, "t");
    assert_eq!(times[0], 0.0, "what was before the motors ran is left out");
    assert!((times.last().unwrap() - FLIGHT_S).abs() < 0.11, "{times:?}");
    let [figures, rows] = [&data["figures"], &data["rows"]];
    assert!((figures["way_m"].as_f64().unwrap() - SPEED_MPS * times.last().unwrap()).abs() < 0.01);
    assert_eq!(figures["top_mps"], 3.0);
    assert_eq!(figures["nearest_m"], 2.0);
    assert_eq!(figures["off_m"], 0.1);
    assert!(
        column(&data, "bearing").iter().all(|bearing| *bearing == -90.0),
        "to the left"
    );
    assert!(column(&data, "tube").iter().all(|tube_m| *tube_m == 0.5));
    assert!(
        rows["clearance"].is_null(),
        "nobody knows the truth outside of a simulation"
    );
    assert!(
        column(&data, "limit")
            .iter()
            .all(|limit_mps| *limit_mps == SPEED_MPS)
    );
    assert_eq!(data["causes"][10], "the room here");
    let event = &data["timeline"]["events"][0];
    assert_eq!(
        (&event["t"], &event["text"]),
        (&1.0.into(), &"jink: planner restarted".into())
    );
    let modes = &data["timeline"]["modes"];
    assert_eq!([&modes[0][1], &modes[1][1]], ["offboard, disarmed", "offboard"]);
}

#[test]
fn nothing_in_it_ends_the_place_where_it_stands_and_nothing_is_asked_of_others() {
    let folder = TempFolder::new("closed");
    let page = read(&written(&folder, "<b>.mcap", &recording(fly)))
        .unwrap()
        .page();
    let data = data_of(&page);
    assert_eq!(
        data["configuration"]["jink.toml"],
        "# </script><script>alert(1)</script>"
    );
    assert!(!page.contains("alert(1)</script>"));
    assert!(page.contains("<title>jink: &lt;b&gt;.mcap</title>"));
    assert!(page.contains("default-src 'none'"));
    for source in ["src=\"", "href=", "fetch(", "import "] {
        assert!(!page.contains(source), "{source}");
    }
}

#[test]
fn an_autopilots_log_of_this_flight_is_laid_over_and_another_is_refused() {
    let folder = TempFolder::new("over");
    let file = written(&folder, "flight.mcap", &recording(fly));
    let log_at = |east_m: f64, later_us: u64| {
        let mut log = AutopilotLog::default();
        for step in 0..=(FLIGHT_S * 20.0) as u64 {
            let north_m = SPEED_MPS * step as f64 / 20.0;
            let boot_us = 10_000_000 + later_us + step * 50_000;
            log.was.push(boot_us, Vector3::new(north_m, east_m, -2.0));
            log.wanted.push(boot_us, Vector3::new(north_m, 0.1, -2.0));
        }
        log
    };
    let laid_over = |log: AutopilotLog| {
        let mut flight = read(&file).unwrap();
        flight
            .lay_over(Path::new("autopilot.ulg"), log)
            .map(|()| data_of(&flight.page()))
    };
    let data = laid_over(log_at(0.0, 0)).unwrap();
    assert!(
        data["log"]["apart_m"].as_f64().unwrap() < 0.001,
        "{}",
        data["log"]
    );
    let known = |name: &str| -> Vec<f64> {
        column(&data, name)
            .into_iter()
            .filter(|v| v.is_finite())
            .collect()
    };
    assert!(known("log_wanted_off").len() > 30);
    assert!(
        known("log_wanted_off").iter().all(|m| *m < 0.01),
        "what was sent is what it wanted"
    );
    assert!(known("log_was_off").iter().all(|m| (m - 0.1).abs() < 0.01));
    let elsewhere = laid_over(log_at(30.0, 0)).unwrap_err();
    assert!(
        elsewhere
            .to_string()
            .contains("another flight: its positions are 30.0 m"),
        "{elsewhere}"
    );
    let at_another_time = laid_over(log_at(0.0, 600_000_000)).unwrap_err();
    assert!(
        at_another_time.to_string().contains("another time"),
        "{at_another_time}"
    );
}

#[test]
fn what_cannot_be_shown_is_refused_by_name() {
    let folder = TempFolder::new("refused");
    let refused = |bytes: &[u8]| read(&written(&folder, "it.mcap", bytes)).unwrap_err();
    assert!(matches!(
        refused(b""),
        ReportError::Recording(ReadError::Empty(_))
    ));
    assert!(matches!(
        refused(b"# a page"),
        ReportError::Recording(ReadError::Foreign(_))
    ));
    assert!(matches!(refused(&recording(|_| {})), ReportError::NoVehicle(_)));
    let other = recording(|writer| {
        writer.add(
            VEHICLE_STATE,
            "jink.VehicleState#1",
            0.0,
            &VehicleState::default(),
        );
    });
    let text = refused(&other).to_string();
    assert!(
        text.contains("vehicle/state was recorded with another layout (jink.VehicleState#1"),
        "{text}"
    );
    let whole = recording(fly);
    let half = read(&written(&folder, "half.mcap", &whole[..whole.len() / 2])).unwrap();
    assert!(
        data_of(&half.page())["damage"][0]
            .as_str()
            .unwrap()
            .ends_with("cut off")
    );
}
