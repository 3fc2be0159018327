use super::{PostMortem, Report, duration, exit_code, exit_text};
use jink_shared_types::Stage;
use jink_shared_types::coded::{Coded, Flag};
use jink_shared_types::health::{Health, Heartbeat, Name, ProcessStatus, ServiceState, SystemStatus};
use jink_shared_types::link::{AssistState, CLASSES, LinkStatus, LinkTraffic, TelemetryLog};
use jink_shared_types::{SampleHeader, Stamped, Timestamp};

fn at(seconds: f64) -> Timestamp {
    Timestamp::from_seconds(seconds)
}

fn status() -> SystemStatus {
    let mut status = SystemStatus {
        started: at(100.0),
        health: Coded::new(Health::Degraded),
        len: 2,
        pid: 77,
        ..SystemStatus::default()
    };
    let planner = ProcessStatus {
        heartbeat: Heartbeat {
            name: Name::new("planner"),
            generation: 3,
            cycle_p50_us: 1_400,
            cycle_p99_us: 5_200,
            cycle_max_us: 9_000,
            budget_misses: 2,
            deadline_misses: 1,
            inputs_needed: 0b11,
            inputs_fresh: 0b101,
            ..Heartbeat::default()
        },
        heartbeat_time: at(129.98),
        started: at(120.0),
        cycle_budget_us: 8_000,
        restarts: 2,
        recovery_us: 57_300,
        last_exit: 256 + 9,
        state: Coded::new(ServiceState::Degraded),
        essential: Flag::YES,
        pid: 1234,
        ..ProcessStatus::default()
    };
    status.processes[0] = planner;
    status.processes[1].heartbeat.name = Name::new("sensors");
    status
}

fn report(link: Option<&LinkStatus>) -> Report {
    let header = SampleHeader::at(at(129.9));
    let link = link.map(|sample| Stamped {
        sample,
        header: &header,
    });
    Report::new("default", at(130.0), &status(), link, Vec::new())
}

#[test]
fn the_screen_shows_every_service_with_its_figures() {
    let text = report(None).text(1_000.0);
    let planner = text.lines().find(|line| line.starts_with("planner")).unwrap();
    for figure in [
        "degraded !",
        "1234",
        "10 s",
        "signal 9",
        "1.4 / 5.2 / 9.0",
        "8.0",
        "1/2",
    ] {
        assert!(planner.contains(figure), "{figure} in {planner}");
    }
    let sensors = text.lines().find(|line| line.starts_with("sensors")).unwrap();
    assert!(
        sensors.contains("unknown") && sensors.contains(" - "),
        "{sensors}"
    );
    assert!(text.starts_with("jink default: degraded, up 30 s, 2 restarts\n"));
    assert!(text.ends_with("link: the gateway has said nothing yet\n"));
}

#[test]
fn a_telemetry_log_that_has_ended_is_a_line_and_one_that_is_written_is_none() {
    let text = |telemetry_log| {
        let link = LinkStatus {
            telemetry_log: Coded::new(telemetry_log),
            ..LinkStatus::default()
        };
        report(Some(&link)).text(1_000.0)
    };
    assert!(text(TelemetryLog::Lost).contains("\ntelemetry log: full\n"));
    for quiet in [TelemetryLog::None, TelemetryLog::Written] {
        assert!(!text(quiet).contains("telemetry log"), "{quiet}");
    }
}

#[test]
fn the_columns_line_up() {
    let text = report(None).text(1_000.0);
    let column = |line: &str, word: &str| line.find(word).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    assert_eq!(column(lines[2], "state"), column(lines[3], "degraded"));
    assert_eq!(column(lines[2], "last exit"), column(lines[3], "signal 9"));
}

#[test]
fn the_json_has_null_where_nothing_is_known() {
    let json = serde_json::to_value(report(None)).unwrap();
    assert_eq!(json["health"], "degraded");
    assert_eq!(json["services"][0]["last_exit"], "signal 9");
    assert_eq!(json["services"][0]["recovery_ms"], 57.3);
    assert_eq!(json["services"][0]["heartbeat_age_ms"], 20.0);
    for key in ["pid", "uptime_s", "last_exit", "recovery_ms", "heartbeat_age_ms"] {
        assert!(json["services"][1][key].is_null(), "{key}");
    }
    assert!(json["link"].is_null());
}

#[test]
fn the_link_says_whether_the_autopilot_is_received_and_how_fast_the_chain_is() {
    let mut link = LinkStatus {
        garbage_bytes: 512,
        ignored: 3,
        ..LinkStatus::default()
    };
    let silent =
        "link: the autopilot is not connected (512 bytes that are no MAVLink, 3 messages of others)\n";
    assert!(report(Some(&link)).text(1_000.0).ends_with(silent));
    link.autopilot_alive = Flag::YES;
    link.system_id = 1;
    link.setpoint_gap_max_us = 61_000;
    link.capture_to_wire.record_us(12_000);
    link.stages[Stage::Fusion as usize].record_us(5_000);
    link.hops[Stage::Fusion as usize].record_us(1_000);
    let text = report(Some(&link)).text(1_000.0);
    assert!(
        text.contains("autopilot 1 connected, clock not mapped yet"),
        "{text}"
    );
    assert!(
        text.contains("largest gap 61 ms; capture to wire 12.0 / 12.0 / 12.0 ms"),
        "{text}"
    );
    assert!(
        text.ends_with("of that p50/p99: fusion 5.0/5.0 (begun after 1.0/1.0)\n"),
        "{text}"
    );
    assert!(!text.contains("assisted flight"), "{text}");
    link.assist = Coded::new(AssistState::Holds);
    let text = report(Some(&link)).text(1_000.0);
    assert!(text.contains("      assisted flight holds\n"), "{text}");
}

fn linked(others: &[LinkTraffic]) -> (String, serde_json::Value) {
    let mut link = LinkStatus {
        autopilot_alive: Flag::YES,
        ..LinkStatus::default()
    };
    link.links[0].name = Name::new("autopilot");
    link.links[0].sent_bytes[1] = 50_000;
    link.links[1..=others.len()].copy_from_slice(others);
    let mut status = status();
    status.processes[1].heartbeat.name = Name::new("mavlink_gateway");
    status.processes[1].started = at(120.0);
    status.processes[1].pid = 99;
    let header = SampleHeader::at(at(129.9));
    let stamped = Stamped {
        sample: &link,
        header: &header,
    };
    let report = Report::new("default", at(130.0), &status, Some(stamped), Vec::new());
    (report.text(1_000.0), serde_json::to_value(report).unwrap())
}

#[test]
fn one_link_without_trouble_needs_no_line_of_its_own() {
    let (text, json) = linked(&[]);
    assert!(!text.contains("B/s"), "{text}");
    assert_eq!(json["link"]["links"].as_array().unwrap().len(), 1);
    assert_eq!(json["link"]["links"][0]["sent_bytes_per_s"], 5_000.0);
}

#[test]
fn every_link_says_what_it_carries_and_what_was_left_out_or_refused() {
    let mut ground = LinkTraffic {
        name: Name::new("ground"),
        forwarded: 7,
        signature_refused: 1,
        replayed: 2,
        unsigned_refused: 3,
        unknown_peers: 4,
        reopened: 5,
        ..LinkTraffic::default()
    };
    ground.dropped[3] = 12;
    ground.dropped[6] = 1;
    let (text, json) = linked(&[ground]);
    let wanted = "      autopilot  5000 B/s sent since its start\n      \
                  ground     0 B/s sent since its start; passed on 7; left out 12 obstacles, 1 forwarded; \
                  refused 1 wrongly signed, 2 played back, 3 unsigned, 4 of unknown peers; opened again 5 times\n";
    assert!(text.ends_with(wanted), "{text}");
    let ground = &json["link"]["links"][1];
    assert_eq!(ground["name"], "ground");
    assert_eq!(ground["dropped"].as_object().unwrap().len(), CLASSES.len());
    assert_eq!(ground["dropped"]["obstacles"], 12);
    assert_eq!(ground["refused"]["replayed"], 2);
    assert_eq!(ground["unknown_peers"], 4);
}

#[test]
fn scripts_can_tell_by_the_exit_code() {
    let codes = [
        Health::Healthy,
        Health::Starting,
        Health::Degraded,
        Health::Failed,
    ]
    .map(exit_code);
    assert_eq!(codes, [0, 1, 1, 2]);
}

#[test]
fn durations_and_exits_read_well() {
    assert_eq!(
        [5.9, 65.0, 7_440.0].map(duration),
        ["5 s", "1 min 5 s", "2 h 4 min"]
    );
    assert_eq!([0, 78, 265].map(exit_text), ["code 0", "code 78", "signal 9"]);
}

#[test]
fn who_ended_is_shown_with_its_last_words() {
    let end = PostMortem {
        process: "planner".to_owned(),
        generation: 2,
        pid: 77,
        exit: "signal 11".to_owned(),
        lived_s: 65.0,
        unix_s: 988.0,
        state: "active".to_owned(),
        cycles: 1_950,
        cycle_last_us: 900,
        cycle_max_us: 9_000,
        last_lines: (1..=5).map(|line| format!("line {line}")).collect(),
        core: Some("kernel.core_pattern is \"core\"".to_owned()),
    };
    let text = Report {
        ends: vec![end],
        ..report(None)
    }
    .text(1_000.0);
    let reported = "planner (start 2, process id 77) ended 12 s ago with signal 11, after 1 min 5 s and 1950 cycles, active then\n";
    assert!(text.contains(reported), "{text}");
    assert!(
        text.ends_with("core_pattern is \"core\"\n      | line 3\n      | line 4\n      | line 5\n"),
        "{text}"
    );
}
