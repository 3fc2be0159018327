//! Topics over real shared memory: what a reader gets, when, and from whom.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::topics;
use jink_shared_types::{Reading, SampleHeader};

/// An instance of its own that leaves nothing behind.
struct Isolated(Instance);

impl Isolated {
    fn new(test: &str) -> Self {
        let instance: Instance = format!("rt_{test}_{}", std::process::id()).parse().unwrap();
        std::fs::create_dir_all(instance.folder()).unwrap();
        Self(instance)
    }
}

impl Drop for Isolated {
    fn drop(&mut self) {
        self.0.wipe().unwrap();
        std::fs::remove_dir_all(self.0.folder()).unwrap();
    }
}

fn status(setpoints: u64) -> LinkStatus {
    LinkStatus {
        setpoints,
        ..LinkStatus::default()
    }
}

#[test]
fn a_reader_gets_the_newest_and_the_sequence_grows_over_restarts() {
    let isolated = Isolated::new("newest");
    let gateway = Session::open(&isolated.0, "mavlink_gateway").unwrap();
    let reader = Session::open(&isolated.0, "supervisor").unwrap();
    let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
    assert!(matches!(input.latest(now()), Reading::Never));

    let mut first = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
    for setpoints in 1..=3 {
        assert!(first.send(SampleHeader::at(now()), &status(setpoints)));
    }
    let Reading::Fresh(newest) = input.latest(now()) else {
        panic!("nothing arrived");
    };
    assert_eq!((newest.setpoints, newest.header.generation), (3, 1));

    let mut second = gateway.output(topics::LINK_STATUS, "", 2).unwrap();
    assert!(second.send(SampleHeader::at(now()), &status(10)));
    assert!(
        first.send(SampleHeader::at(now()), &status(4)),
        "the replaced producer still sends"
    );
    let Reading::Fresh(newest) = input.latest(now()) else {
        panic!("nothing arrived");
    };
    assert_eq!(
        (newest.setpoints, newest.header.generation),
        (10, 2),
        "the older generation is ignored"
    );
}

#[test]
fn a_late_reader_finds_the_last_sample_of_a_live_producer() {
    let isolated = Isolated::new("late");
    let gateway = Session::open(&isolated.0, "mavlink_gateway").unwrap();
    let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
    output.send(SampleHeader::at(now()), &status(7));
    let reader = Session::open(&isolated.0, "supervisor").unwrap();
    let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
    output.greet();
    let value = input.latest(now()).fresh().map(|sample| sample.setpoints);
    assert_eq!(value, Some(7));
}

#[test]
fn a_sample_goes_stale_after_its_deadline() {
    let isolated = Isolated::new("stale");
    let gateway = Session::open(&isolated.0, "mavlink_gateway").unwrap();
    let reader = Session::open(&isolated.0, "supervisor").unwrap();
    let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
    let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
    output.send(SampleHeader::at(now()), &status(7));
    let later = now().plus_seconds(topics::LINK_STATUS.row.deadline_ms * 1e-3 + 1.0);
    assert!(matches!(input.latest(later), Reading::Stale { age_s } if age_s > 1.0));
}

#[test]
fn a_program_outside_the_row_is_refused() {
    let isolated = Isolated::new("row");
    let planner = Session::open(&isolated.0, "planner").unwrap();
    let publish = planner.output(topics::VEHICLE_STATE, "", 1);
    assert!(matches!(publish, Err(OpenError::NotInTable { .. })));
    let read = planner.input(topics::RANGE_CLOUD, "lidar");
    assert!(matches!(read, Err(OpenError::NotInTable { .. })));
}

#[test]
fn two_layouts_of_one_topic_refuse_to_meet() {
    let isolated = Isolated::new("layout");
    let gateway = Session::open(&isolated.0, "mavlink_gateway").unwrap();
    let _held = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
    // The same name with another payload stands for a build with another layout.
    let mut row = topics::SIM_TRUTH;
    row.row.name = topics::LINK_STATUS.row.name;
    let simulator = Session::open(&isolated.0, "simulator").unwrap();
    let refused = simulator.output(row, "", 1);
    assert!(
        matches!(refused, Err(OpenError::Layout { .. })),
        "{:?}",
        refused.err()
    );
}
