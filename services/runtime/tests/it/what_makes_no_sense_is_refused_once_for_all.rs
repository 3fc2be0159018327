//! What comes over a topic is looked at before a service gets it: stamps in the future, numbers that make no sense, sequence numbers
//! from nowhere. The service goes on with what it has, counts as degraded, and the pilot is informed whose they are.

use clap::Parser;
use jink_runtime::config::Config;
use jink_runtime::lockstep::{LocalBus, Member};
use jink_runtime::ports::{INPUTS, WAKEUPS};
use jink_runtime::{
    Checks, Cycle, Input, OpenError, Output, Ports, Service, Session, Setup, StartError, Wake,
};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::ServiceState;
use jink_shared_types::motion::Route;
use jink_shared_types::ranges::deadline_us;
use jink_shared_types::{Reading, SampleHeader, Timestamp, topics};
use proptest::prelude::*;

const START_S: f64 = 1000.0;

fn at(time_s: f64) -> Timestamp {
    Timestamp::from_seconds(START_S + time_s)
}

fn bus() -> LocalBus {
    LocalBus::new(at(0.0))
}

fn planner(bus: &LocalBus, generation: u32) -> Output<Route> {
    let session = Session::local(bus, "planner");
    session.output(topics::ROUTE, "", generation).unwrap()
}

fn reader(bus: &LocalBus) -> Input<Route> {
    let session = Session::local(bus, "bezier_generator");
    session.input(topics::ROUTE, "").unwrap()
}

/// A route that says `id`; one that makes no sense says a number of points that there is no room for.
fn send(output: &mut Output<Route>, bus: &LocalBus, id: u64, makes_sense: bool) {
    output.write(SampleHeader::at(bus.now()), |route| {
        *route = Route {
            id,
            ..Route::default()
        };
        if !makes_sense {
            route.guide_len = u32::MAX;
        }
    });
}

fn newest(input: &mut Input<Route>, bus: &LocalBus) -> Option<u64> {
    input.latest(bus.now()).fresh().map(|route| route.id)
}

#[test]
fn numbers_that_make_no_sense_never_reach_a_reader() {
    let bus = bus();
    let (mut output, mut input) = (planner(&bus, 1), reader(&bus));
    send(&mut output, &bus, 1, true);
    send(&mut output, &bus, 2, false);
    assert_eq!(newest(&mut input, &bus), Some(1), "what was there before stays");
    assert_eq!(input.refused(), 1);
    send(&mut output, &bus, 3, true);
    assert_eq!(newest(&mut input, &bus), Some(3));
    let mut handed_out = Vec::new();
    send(&mut output, &bus, 4, false);
    input.each(|route| handed_out.push(route.id));
    assert!(handed_out.is_empty(), "{handed_out:?}");
}

#[test]
fn whoever_asks_for_everything_gets_it() {
    let bus = bus();
    let mut output = planner(&bus, 1);
    let mut all = reader(&bus).with_checks(Checks::None);
    let mut stamps = reader(&bus).with_checks(Checks::Stamps);
    send(&mut output, &bus, 1, false);
    output.write(
        SampleHeader {
            capture: at(60.0),
            ..SampleHeader::default()
        },
        |route| route.id = 2,
    );
    assert_eq!(newest(&mut all, &bus), Some(2));
    assert_eq!(newest(&mut stamps, &bus), Some(1));
    assert_eq!((all.refused(), stamps.refused()), (0, 1));
}

#[test]
fn a_stamp_in_the_future_is_refused_and_one_that_the_clocks_reading_explains_is_not() {
    let bus = bus();
    let (mut output, mut input) = (planner(&bus, 1), reader(&bus));
    let captured = |ahead_s: f64| SampleHeader {
        capture: at(ahead_s),
        ..SampleHeader::default()
    };
    output.write(captured(0.04), |route| {
        *route = Route {
            id: 1,
            ..Route::default()
        }
    });
    output.write(captured(0.06), |route| {
        *route = Route {
            id: 2,
            ..Route::default()
        }
    });
    output.write(captured(1e9), |route| {
        *route = Route {
            id: 3,
            ..Route::default()
        }
    });
    assert_eq!(newest(&mut input, &bus), Some(1));
    assert_eq!(input.refused(), 2);
}

#[test]
fn a_sequence_number_from_nowhere_silences_nobody_for_longer_than_the_deadline() {
    let bus = bus();
    let (mut rogue, mut output, mut input) = (planner(&bus, u32::MAX), planner(&bus, 1), reader(&bus));
    send(&mut output, &bus, 1, true);
    assert_eq!(newest(&mut input, &bus), Some(1));
    send(&mut rogue, &bus, 99, true);
    send(&mut output, &bus, 2, true);
    assert_eq!(
        newest(&mut input, &bus),
        Some(99),
        "the highest number is the newest"
    );
    bus.set_clock(at(topics::ROUTE.row.deadline_ms * 1e-3 + 0.001));
    send(&mut output, &bus, 3, true);
    assert_eq!(newest(&mut input, &bus), Some(3), "until it is stale");
    assert_eq!(input.lost(), 0);
}

/// Needs routes, and does nothing with them.
struct Consumer(Input<Route>);

impl Service for Consumer {
    const PROGRAM: &'static str = "bezier_generator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self(ports.trigger(topics::ROUTE)?.needed()))
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        self.0.latest(cycle.now);
        Wake::at(cycle.now.plus_seconds(0.02))
    }
}

fn setup() -> Setup {
    Setup::parse_from(["jink", "--process", "bezier_generator", "--instance", "refused"])
}

#[test]
fn a_service_is_degraded_for_a_second_and_the_pilot_reads_by_whom() {
    let bus = bus();
    let mut output = planner(&bus, 1);
    let mut service = Member::<Consumer>::start(&bus, setup(), Config::default()).unwrap();
    let watching = Session::local(&bus, "supervisor");
    let mut health = watching.input(topics::HEALTH, "bezier_generator").unwrap();
    let gateway = Session::local(&bus, "mavlink_gateway");
    let mut reported = gateway.input(topics::EVENT, "").unwrap();
    let mut texts = Vec::new();
    let mut states = Vec::new();
    for step in 0..250_u32 {
        let time_s = f64::from(step) * 0.02;
        bus.set_clock(at(time_s));
        // For a second every other route makes no sense.
        send(&mut output, &bus, 1, !(50..100).contains(&step) || step % 2 == 0);
        service.run_if_due();
        if let Reading::Fresh(heartbeat) = health.latest(bus.now()) {
            states.push((time_s, heartbeat.state.get()));
        }
        reported.each(|event| {
            if event.id == events::SAMPLE_REFUSED.id {
                texts.push(EventSample::text(event.sample));
            }
        });
    }
    assert_eq!(service.service().0.refused(), 25);
    assert_eq!(texts, ["jink: samples of planner refused"], "once, not 25 times");
    for (time_s, state) in states.into_iter().filter(|(time_s, _)| *time_s > 0.2) {
        let expected = match time_s {
            // Heartbeats report it within their period.
            t if (1.1..2.9).contains(&t) => ServiceState::Degraded,
            t if !(1.0..3.1).contains(&t) => ServiceState::Active,
            _ => continue,
        };
        assert_eq!(state, expected, "at {time_s}");
    }
}

/// Opens a topic once more than there is room for.
struct Greedy;

impl Service for Greedy {
    const PROGRAM: &'static str = "collision_guard";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        for sensor in 0..INPUTS {
            ports.input_of(topics::RANGE_SCAN, &sensor.to_string())?;
        }
        let refused = ports.input_of(topics::RANGE_SCAN, "last").unwrap_err();
        assert!(
            matches!(&refused, OpenError::TooMany { topic, most: INPUTS, .. } if topic == "range/scan/last"),
            "{refused}"
        );
        Err(refused.into())
    }

    fn cycle(&mut self, _: &mut Cycle<'_>) -> Wake {
        Wake::on_data()
    }
}

#[test]
fn one_topic_too_many_is_refused_in_words() {
    let setup = Setup::parse_from(["jink", "--process", "collision_guard", "--instance", "refused"]);
    let refused = Member::<Greedy>::start(&bus(), setup, Config::default()).unwrap_err();
    let text = refused.to_string();
    assert!(
        text.contains("range/scan/last") && text.contains("32 topics to read"),
        "{text}"
    );
    // As many as may be read may wake.
    assert_eq!(INPUTS, WAKEUPS);
}

proptest! {
    /// Whatever a producer sends, a reader is given what makes sense, in order, and never what lies in the future.
    #[test]
    fn only_what_makes_sense_is_handed_out(
        samples in prop::collection::vec((any::<bool>(), -1.0..1.0_f64, 0.0..0.05_f64), 1..60)
    ) {
        let bus = bus();
        let (mut output, mut input) = (planner(&bus, 1), reader(&bus));
        let mut now_s = 0.0;
        for (id, (makes_sense, capture_s, step_s)) in samples.iter().enumerate() {
            now_s += step_s;
            bus.set_clock(at(now_s));
            let header = SampleHeader { capture: at(now_s + capture_s), ..SampleHeader::default() };
            output.write(header, |route| {
                *route = Route { id: id as u64, ..Route::default() };
                if !makes_sense {
                    route.guide_len = u32::MAX;
                }
            });
            let mut handed_out = Vec::new();
            input.each(|route| handed_out.push((route.id, route.header.capture)));
            let expected = *makes_sense && *capture_s < 0.05;
            prop_assert_eq!(handed_out.len(), usize::from(expected), "{} {}", makes_sense, capture_s);
        }
    }

    /// The deadline of a sensor never lies below that of its topic, and leaves it two periods and its delay.
    #[test]
    fn a_sensors_deadline_leaves_it_two_periods(rate_hz in 0.5..200.0_f64, delay_s in 0.0..1.0_f64) {
        let deadline_s = f64::from(deadline_us(250.0, rate_hz, delay_s)) * 1e-6;
        prop_assert!(deadline_s >= 0.25 && deadline_s >= 2.0 / rate_hz + delay_s, "{deadline_s}");
        prop_assert!(deadline_us(250.0, 0.0, delay_s) <= deadline_us(250.0, rate_hz, delay_s));
    }
}
