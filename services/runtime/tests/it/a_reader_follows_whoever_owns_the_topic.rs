//! What a reader hands out when producers are restarted, replaced, silent, or faster than it reads.

use jink_runtime::lockstep::LocalBus;
use jink_runtime::{Input, Output, Session};
use jink_shared_types::motion::Route;
use jink_shared_types::{SampleHeader, Timestamp, topics};
use proptest::prelude::*;

const PRODUCERS: u32 = 3;

fn at(ms: u64) -> Timestamp {
    Timestamp::from_ns(1_000_000_000_000 + ms * 1_000_000)
}

fn planner(bus: &LocalBus, generation: u32) -> Output<Route> {
    let session = Session::local(bus, "planner");
    session.output(topics::ROUTE, "", generation).unwrap()
}

fn reader(bus: &LocalBus) -> Input<Route> {
    let session = Session::local(bus, "bezier_generator");
    session.input(topics::ROUTE, "").unwrap()
}

fn send(output: &mut Output<Route>, bus: &LocalBus, id: u64) {
    output.write(SampleHeader::at(bus.now()), |route| {
        *route = Route {
            id,
            ..Route::default()
        };
    });
}

proptest! {
    /// Of one producer each sample is handed out or counted as lost, whatever the pace of both.
    #[test]
    fn what_is_not_handed_out_is_counted(bursts in prop::collection::vec(0..12_u64, 1..40)) {
        let bus = LocalBus::new(at(0));
        let (mut output, mut input) = (planner(&bus, 1), reader(&bus));
        let (mut sent, mut first, mut handed_out) = (0_u64, None, 0_u64);
        for (step, burst) in bursts.into_iter().enumerate() {
            bus.set_clock(at(step as u64));
            for _ in 0..burst {
                sent += 1;
                send(&mut output, &bus, sent);
            }
            let mut last = 0;
            let mut in_order = true;
            input.each(|route| {
                in_order &= route.id > last;
                last = route.id;
                first.get_or_insert(route.id);
                handed_out += 1;
            });
            prop_assert!(in_order);
            prop_assert!(burst == 0 || last == sent, "the newest is never the one that is lost");
        }
        // Nobody knows what was there before the first.
        let before = first.map_or(sent, |first| first - 1);
        prop_assert_eq!(handed_out + input.lost(), sent - before);
    }

    /// Whoever has the highest sequence number is followed while he is fresh; when he falls silent it is whoever
    /// publishes. Nothing old is handed out after something new, unless the new one was stale.
    #[test]
    fn the_newest_producer_is_followed_while_it_is_fresh(
        steps in prop::collection::vec((0..PRODUCERS, 0..30_u64), 1..80)
    ) {
        let bus = LocalBus::new(at(0));
        let mut outputs: Vec<_> = (1..=PRODUCERS).map(|generation| planner(&bus, generation)).collect();
        let mut input = reader(&bus);
        let deadline_ms = topics::ROUTE.row.deadline_ms as u64;
        prop_assert_ne!(deadline_ms % 4, 0);
        let mut now_ms = 0;
        // Of what was handed out last: sequence and time.
        let mut followed: Option<(u64, u64)> = None;
        let mut counts = [0_u64; PRODUCERS as usize];
        for (producer, pause) in steps {
            // By four: never the deadline itself, to a rounding error.
            now_ms += 4 * pause;
            bus.set_clock(at(now_ms));
            let index = producer as usize;
            counts[index] += 1;
            let sequence = u64::from(producer + 1) << 32 | counts[index];
            send(&mut outputs[index], &bus, sequence);
            let taken = match followed {
                None => true,
                Some((last, ms)) => sequence > last || now_ms - ms > deadline_ms,
            };
            let mut handed_out = Vec::new();
            input.each(|route| handed_out.push((route.id, route.header.sequence)));
            let expected: Vec<(u64, u64)> = taken.then_some((sequence, sequence)).into_iter().collect();
            prop_assert_eq!(handed_out, expected, "at {} ms, followed {:?}", now_ms, followed);
            if taken {
                followed = Some((sequence, now_ms));
            }
        }
    }

    /// Who asks for all producers gets each sample of each, in the order in which they were sent.
    #[test]
    fn all_producers_are_received_where_that_is_asked_for(
        steps in prop::collection::vec((0..PRODUCERS, 0..400_u64), 1..60)
    ) {
        let bus = LocalBus::new(at(0));
        let mut outputs: Vec<_> = (1..=PRODUCERS).map(|generation| planner(&bus, generation)).collect();
        let mut input = reader(&bus).of_all_producers();
        let (mut now_ms, mut received) = (0, Vec::new());
        for (id, (producer, pause_ms)) in steps.iter().enumerate() {
            now_ms += pause_ms;
            bus.set_clock(at(now_ms));
            send(&mut outputs[*producer as usize], &bus, id as u64);
            input.each(|route| received.push(route.id));
        }
        prop_assert_eq!(received, (0..steps.len() as u64).collect::<Vec<_>>());
        prop_assert_eq!(input.lost(), 0);
    }
}

/// A service that keeps something beyond its producer's death keeps the numbers, and knows how old they are.
#[test]
fn the_newest_outlives_its_producer_and_its_freshness() {
    let bus = LocalBus::new(at(0));
    let (mut output, mut input) = (planner(&bus, 1), reader(&bus));
    send(&mut output, &bus, 7);
    assert!(input.latest(bus.now()).is_fresh());
    drop(output);
    bus.set_clock(at(60_000));
    assert!(!input.latest(bus.now()).is_fresh());
    assert_eq!(input.newest().map(|route| route.id), Some(7));
    // Its successor counts from the beginning, and is read at once.
    let mut successor = planner(&bus, 1);
    send(&mut successor, &bus, 8);
    assert_eq!(input.latest(bus.now()).fresh().map(|route| route.id), Some(8));
}
