//! Topics over real shared memory and within one process: what a reader gets, when, and from whom. Both are to be the same.

use jink_runtime::lockstep::LocalBus;
use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::topics;
use jink_shared_types::{Reading, SampleHeader};

/// Where the topics are.
enum Place {
    /// An instance of its own that leaves nothing behind.
    Shared(Instance),
    Local(LocalBus),
}

impl Place {
    fn open(&self, program: &str) -> Session {
        match self {
            Self::Shared(instance) => Session::open(instance, program).unwrap(),
            Self::Local(bus) => {
                bus.set_clock(now());
                Session::local(bus, program)
            }
        }
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        if let Self::Shared(instance) = self {
            instance.wipe().unwrap();
            std::fs::remove_dir_all(instance.folder()).unwrap();
        }
    }
}

/// Keeps a promise in both.
fn in_both(test: &str, promise: impl Fn(&Place)) {
    let instance: Instance = format!("rt_{test}_{}", std::process::id()).parse().unwrap();
    instance.make_folder().unwrap();
    promise(&Place::Shared(instance));
    promise(&Place::Local(LocalBus::new(now())));
}

fn status(setpoints: u64) -> LinkStatus {
    LinkStatus {
        setpoints,
        ..LinkStatus::default()
    }
}

#[test]
fn a_producer_without_end_keeps_no_reader_busy() {
    in_both("flood", |place| {
        let gateway = place.open("mavlink_gateway");
        let mut input = place.open("supervisor").input(topics::LINK_STATUS, "").unwrap();
        let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
        let mut sent = 1;
        assert!(output.send(SampleHeader::at(now()), &status(sent)));
        for _ in 0..2 {
            let before = sent;
            // Whoever reads one finds the next one.
            input.each(|_| {
                sent += 1;
                output.send(SampleHeader::at(now()), &status(sent));
            });
            let row = topics::LINK_STATUS.row;
            assert!(sent > before && sent <= before + (row.buffer * row.max_publishers()) as u64);
        }
        input.latest(now());
        let Reading::Fresh(newest) = input.latest(now()) else {
            panic!("nothing arrived");
        };
        assert_eq!(newest.setpoints, sent);
    });
}

#[test]
fn a_reader_gets_the_newest_and_the_sequence_grows_over_restarts() {
    in_both("newest", |place| {
        let gateway = place.open("mavlink_gateway");
        let reader = place.open("supervisor");
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
    });
}

#[test]
fn a_late_reader_finds_the_last_sample_of_a_live_producer() {
    in_both("late", |place| {
        let gateway = place.open("mavlink_gateway");
        let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
        output.send(SampleHeader::at(now()), &status(7));
        let reader = place.open("supervisor");
        let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
        output.announce();
        let value = input.latest(now()).fresh().map(|sample| sample.setpoints);
        assert_eq!(value, Some(7));
    });
}

#[test]
fn what_was_received_outlives_its_producer_and_what_was_not_does_not() {
    in_both("gone", |place| {
        let gateway = place.open("mavlink_gateway");
        let reader = place.open("supervisor");
        let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
        let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
        output.send(SampleHeader::at(now()), &status(7));
        assert!(input.latest(now()).is_fresh());
        drop(output);
        assert_eq!(input.newest().map(|sample| sample.setpoints), Some(7));
        let mut late = reader.input(topics::LINK_STATUS, "").unwrap();
        assert!(matches!(late.latest(now()), Reading::Never));
    });
}

#[test]
fn a_reader_that_falls_behind_loses_the_oldest_and_counts_them() {
    in_both("behind", |place| {
        let gateway = place.open("mavlink_gateway");
        let reader = place.open("supervisor");
        let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
        let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
        output.send(SampleHeader::at(now()), &status(0));
        assert!(input.latest(now()).is_fresh());
        let kept = topics::LINK_STATUS.row.buffer as u64;
        for setpoints in 1..=10 {
            output.send(SampleHeader::at(now()), &status(setpoints));
        }
        let mut seen = Vec::new();
        input.each(|sample| seen.push(sample.setpoints));
        assert_eq!(seen, (11 - kept..=10).collect::<Vec<_>>());
        assert_eq!(input.lost(), 10 - kept);
    });
}

#[test]
fn a_sample_goes_stale_after_its_deadline() {
    in_both("stale", |place| {
        let gateway = place.open("mavlink_gateway");
        let reader = place.open("supervisor");
        let mut input = reader.input(topics::LINK_STATUS, "").unwrap();
        let mut output = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
        output.send(SampleHeader::at(now()), &status(7));
        let later = now().plus_seconds(topics::LINK_STATUS.row.deadline_ms * 1e-3 + 1.0);
        assert!(matches!(input.latest(later), Reading::Stale { age_s } if age_s > 1.0));
    });
}

#[test]
fn a_program_outside_the_row_is_refused() {
    in_both("row", |place| {
        let planner = place.open("planner");
        let publish = planner.output(topics::VEHICLE_STATE, "", 1);
        assert!(matches!(publish, Err(OpenError::NotInTable { .. })));
        let read = planner.input(topics::RANGE_CLOUD, "lidar");
        assert!(matches!(read, Err(OpenError::NotInTable { .. })));
    });
}

#[test]
fn two_layouts_of_one_topic_refuse_to_meet() {
    in_both("layout", |place| {
        let gateway = place.open("mavlink_gateway");
        let _held = gateway.output(topics::LINK_STATUS, "", 1).unwrap();
        // The same name with another payload stands for a build with another layout.
        let mut row = topics::SIM_TRUTH;
        row.row.name = topics::LINK_STATUS.row.name;
        let simulator = place.open("simulator");
        let refused = simulator.output(row, "", 1);
        assert!(
            matches!(refused, Err(OpenError::Layout { .. })),
            "{:?}",
            refused.err()
        );
    });
}
