//! What the links carry.

#![allow(deprecated)]

use crate::support::copter::CopterFlight;
use jink_emulated_autopilot::Link;
use mavlink::Message;
use mavlink::dialect::*;

const ACCEPTED: MavResult = MavResult::MAV_RESULT_ACCEPTED;
const DENIED: MavResult = MavResult::MAV_RESULT_DENIED;
const FAILED: MavResult = MavResult::MAV_RESULT_FAILED;

/// Ids received on a link in `seconds`.
fn ids(flight: &mut CopterFlight, link: Link, seconds: f64) -> Vec<u32> {
    flight.collect(seconds, |packet| {
        (packet.link == link && packet.header.component_id == 1).then(|| packet.message.message_id())
    })
}

fn count(ids: &[u32], id: u32) -> usize {
    ids.iter().filter(|received| **received == id).count()
}

#[test]
fn nobody_asking_a_link_carries_a_heartbeat_a_second_and_a_timesync_request_every_ten() {
    for link in Link::ALL {
        let mut flight = CopterFlight::with(&[]);
        let received = ids(&mut flight, link, 60.0);
        assert_eq!((count(&received, 0), count(&received, 111)), (60, 6));
        assert_eq!(received.len(), 66);
    }
}

#[test]
fn an_interval_asked_for_is_kept_on_that_link_only() {
    let rows = [
        (32, 50.0),
        (32, 200.0),
        (31, 50.0),
        (30, 100.0),
        (33, 10.0),
        (105, 50.0),
        (245, 5.0),
        (1, 2.0),
        (2, 1.0),
        (0, 5.0),
    ];
    for (id, rate_hz) in rows {
        let mut flight = CopterFlight::with(&[]);
        flight.run(6.0);
        assert_eq!(flight.want(Link::Companion, id, rate_hz), ACCEPTED);
        let mut other = 0;
        let received = flight.collect(10.0, |packet| {
            let own = packet.message.message_id() == id;
            other += usize::from(own && packet.link == Link::GroundStation);
            (own && packet.link == Link::Companion).then_some(())
        });
        assert!(
            (received.len() as f64 - 10.0 * rate_hz).abs() <= 2.0,
            "{id}: {}",
            received.len()
        );
        let leaked = if id == 0 { 10 } else { 0 };
        assert_eq!(other, leaked, "{id}");
    }
}

#[test]
fn a_target_is_streamed_in_guided_only() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.want(Link::Companion, 85, 20.0);
    assert!(count(&ids(&mut flight, Link::Companion, 2.0), 85) >= 39);
    flight.set_mode(jink_emulated_autopilot::modes::arducopter::Mode::Brake);
    assert_eq!(count(&ids(&mut flight, Link::Companion, 2.0), 85), 0);
}

#[test]
fn messages_it_has_not_are_denied_with_a_text() {
    for id in [331, 330, 111] {
        let mut flight = CopterFlight::with(&[]);
        flight.run(6.0);
        assert_eq!(flight.want(Link::Companion, id, 10.0), DENIED);
        let text = format!("No ap_message for mavlink id ({id})");
        assert!(flight.texts.contains(&text), "{:?}", flight.texts);
    }
}

#[test]
fn a_message_can_be_asked_for_once() {
    let mut flight = CopterFlight::airborne(&[]);
    let mut ask = |id: u32| {
        let asked = [id as f32, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        let result = flight.ask(MavCmd::MAV_CMD_REQUEST_MESSAGE, asked);
        let sent = flight
            .received
            .iter()
            .any(|packet| packet.message.message_id() == id);
        (result, sent)
    };
    for id in [
        24, 30, 31, 32, 33, 36, 42, 46, 62, 65, 74, 83, 85, 87, 105, 116, 147, 148, 242, 245,
    ] {
        assert_eq!(ask(id), (ACCEPTED, true), "{id}");
    }
    // Accepted although there is no sector to report.
    assert_eq!(ask(132), (ACCEPTED, false));
    for id in [230, 253, 331, 332, 333, 340, 410, 436] {
        assert_eq!(ask(id), (FAILED, false), "{id}");
    }
}

#[test]
fn a_data_stream_is_everything_at_its_rate() {
    let mut flight = CopterFlight::airborne(&[]);
    flight.companion(MavMessage::REQUEST_DATA_STREAM(REQUEST_DATA_STREAM_DATA {
        req_message_rate: 4,
        target_system: 1,
        target_component: 1,
        start_stop: 1,
        ..REQUEST_DATA_STREAM_DATA::default()
    }));
    let received = ids(&mut flight, Link::Companion, 10.0);
    for id in [1, 24, 30, 32, 33, 42, 65, 74, 85] {
        assert!(
            (39..=41).contains(&count(&received, id)),
            "{id}: {}",
            count(&received, id)
        );
    }
    assert_eq!(count(&received, 0), 10);
}

#[test]
fn a_timesync_request_is_answered_with_the_boot_time_of_the_telemetry() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(7.0);
    flight.companion(MavMessage::TIMESYNC(TIMESYNC_DATA {
        tc1: 0,
        ts1: 42,
        ..TIMESYNC_DATA::default()
    }));
    let now_ns = (flight.now_s() * 1e9).round() as i64;
    flight.step();
    let answer = flight.received.iter().find_map(|packet| match &packet.message {
        MavMessage::TIMESYNC(answer) if answer.tc1 != 0 => Some((answer.tc1, answer.ts1)),
        _ => None,
    });
    assert_eq!(answer, Some((now_ns, 42)));
    assert!(!flight.copter.timesync_converged(Link::Companion));
}

#[test]
fn parameters_travel_as_the_numbers_they_are() {
    let mut flight = CopterFlight::with(&[]);
    flight.set("WPNAV_ACCEL", 300.0);
    flight.set("FS_GCS_ENABLE", 1.0);
    let reported: Vec<(String, f32, MavParamType)> = flight.collect(0.1, |packet| match &packet.message {
        MavMessage::PARAM_VALUE(v) if packet.link == Link::Companion => Some((
            v.param_id.to_str().unwrap().to_owned(),
            v.param_value,
            v.param_type,
        )),
        _ => None,
    });
    let real = MavParamType::MAV_PARAM_TYPE_REAL32;
    let byte = MavParamType::MAV_PARAM_TYPE_INT8;
    assert_eq!(
        reported,
        [
            ("WPNAV_ACCEL".to_owned(), 300.0, real),
            ("FS_GCS_ENABLE".to_owned(), 1.0, byte)
        ]
    );
    assert_eq!(flight.copter.parameter("FS_GCS_ENABLE"), Some(1.0));
    flight.set("ATC_ANGLE_MAX", 45.0);
    flight.companion(MavMessage::PARAM_REQUEST_LIST(PARAM_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
    }));
    let list = flight.collect(2.0, |packet| match &packet.message {
        MavMessage::PARAM_VALUE(v) if packet.link == Link::Companion => Some((
            v.param_index,
            v.param_count,
            v.param_id.to_str().unwrap().to_owned(),
        )),
        _ => None,
    });
    assert_eq!(list.len(), usize::from(list[0].1));
    assert!(list.iter().enumerate().all(|(i, row)| usize::from(row.0) == i));
    assert!(list.iter().all(|row| row.2 != "ATC_ANGLE_MAX"));
}

#[test]
fn a_mission_comes_back_with_home_in_front_and_relative_heights_in_frame_3() {
    let mut flight = CopterFlight::with(&[]);
    flight.run(6.0);
    let item = |seq: u16| MISSION_ITEM_INT_DATA {
        command: MavCmd::MAV_CMD_NAV_WAYPOINT,
        frame: MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT,
        seq,
        x: 473_977_420 + i32::from(seq),
        y: 85_455_940,
        z: 5.0,
        target_system: 1,
        target_component: 1,
        ..MISSION_ITEM_INT_DATA::default()
    };
    assert_eq!(
        flight.upload(&[0, 1, 2, 3].map(item)),
        MavMissionResult::MAV_MISSION_ACCEPTED
    );

    // The companion downloads what the ground station uploaded.
    flight.companion(MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
        ..MISSION_REQUEST_LIST_DATA::default()
    }));
    for seq in 0..4 {
        flight.companion(MavMessage::MISSION_REQUEST_INT(MISSION_REQUEST_INT_DATA {
            seq,
            target_system: 1,
            target_component: 1,
            ..MISSION_REQUEST_INT_DATA::default()
        }));
    }
    flight.companion(MavMessage::MISSION_REQUEST_LIST(MISSION_REQUEST_LIST_DATA {
        target_system: 1,
        target_component: 1,
        mission_type: MavMissionType::MAV_MISSION_TYPE_FENCE,
    }));
    flight.step();
    let counts: Vec<u16> = flight
        .received
        .iter()
        .filter_map(|packet| match &packet.message {
            MavMessage::MISSION_COUNT(count) if packet.header.component_id == 1 => Some(count.count),
            _ => None,
        })
        .collect();
    assert_eq!(counts, [4, 0]);
    let items: Vec<(u16, MavFrame, f32)> = flight
        .received
        .iter()
        .filter_map(|packet| match &packet.message {
            MavMessage::MISSION_ITEM_INT(item) => Some((item.seq, item.frame, item.z)),
            _ => None,
        })
        .collect();
    let relative = MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT;
    assert_eq!(items[0].1, MavFrame::MAV_FRAME_GLOBAL);
    assert!((items[0].2 - 488.1).abs() < 0.05);
    assert_eq!(
        items[1..],
        [(1, relative, 5.0), (2, relative, 5.0), (3, relative, 5.0)]
    );
}

#[test]
fn each_link_receives_the_heartbeats_of_the_other() {
    let mut flight = CopterFlight::with(&[]);
    flight.companion(MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
    flight.station(MavMessage::HEARTBEAT(HEARTBEAT_DATA::default()));
    flight.step();
    let forwarded: Vec<(Link, u32)> = flight
        .received
        .iter()
        .filter(|packet| packet.header.component_id != 1)
        .map(|packet| (packet.link, packet.header.system_id))
        .collect();
    assert_eq!(forwarded, [(Link::GroundStation, 1), (Link::Companion, 255)]);
}
