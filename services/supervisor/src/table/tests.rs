use super::{Mode, OnFailure, ProcessRow, ProcessTable, When};
use jink_runtime::config::{Config, Grants};
use std::path::Path;

fn parse(text: &str) -> ProcessTable {
    ProcessTable::parse(Path::new("services.toml"), text).unwrap()
}

fn error_of(text: &str) -> String {
    ProcessTable::parse(Path::new("services.toml"), text)
        .unwrap_err()
        .to_string()
}

const SHORT: &str = "[[process]]\nname = \"planner\"\nprogram = \"jink-planner\"\n";

#[test]
fn a_short_row_has_sensible_defaults() {
    let row = &parse(SHORT).rows[0];
    assert_eq!(row.rules.heartbeat_timeout_s, 0.1);
    assert!(row.rules.essential && row.when == When::Always && !row.rules.is_output);
    assert_eq!(row.rules.on_failure, OnFailure::Hold);
    assert_eq!(row.core, None);
}

#[test]
fn a_row_wins_over_the_defaults_section_key_by_key() {
    let text = "[defaults]\nheartbeat_timeout_ms = 200\nlog = \"warn\"\nrestart = { intensity = 3, floor_ms = 5 }\n\
                [[process]]\nname = \"a\"\nprogram = \"jink-a\"\nrestart = { floor_ms = 7 }\n\
                [[process]]\nname = \"b\"\nprogram = \"jink-b\"\nheartbeat_timeout_ms = 300\ncore = 1\n";
    let rows = parse(text).rows;
    let timeouts = [
        rows[0].rules.heartbeat_timeout_s,
        rows[1].rules.heartbeat_timeout_s,
    ];
    assert_eq!(timeouts, [0.2, 0.3]);
    assert_eq!(
        (rows[0].rules.restart.intensity, rows[0].rules.restart.floor_s),
        (3, 0.007)
    );
    assert_eq!(
        (rows[1].rules.restart.intensity, rows[1].rules.restart.floor_s),
        (3, 0.005)
    );
    assert_eq!(rows[1].core, Some(1));
    assert_eq!(rows[0].log, Some(tracing::Level::WARN));
}

#[test]
fn the_output_is_the_row_that_says_so_whatever_its_program_is_called() {
    let text = format!("{SHORT}[[process]]\nname = \"link\"\nprogram = \"/opt/my-gateway\"\noutput = true\n");
    let is_output: Vec<bool> = parse(&text).rows.iter().map(|row| row.rules.is_output).collect();
    assert_eq!(is_output, [false, true]);
    let gateway = "[[process]]\nname = \"mavlink_gateway\"\nprogram = \"jink-mavlink-gateway\"\n";
    assert!(!parse(gateway).rows[0].rules.is_output);
    assert_eq!(
        error_of(&format!("[defaults]\noutput = true\n{SHORT}")),
        "services.toml:2: `output` belongs into a [[process]] row, not into [defaults]"
    );
}

#[test]
fn to_stop_the_output_there_must_be_one() {
    let stops = format!("{SHORT}on_failure = \"stop_output\"\n");
    let link = "[[process]]\nname = \"link\"\nprogram = \"jink-mavlink-gateway\"\n";
    let refused = "services.toml:1: on_failure = \"stop_output\" of \"planner\" would stop nothing: no row says `output = true`";
    assert_eq!(error_of(&format!("{stops}{link}")), refused);
    assert_eq!(
        error_of(&format!("[defaults]\non_failure = \"stop_output\"\n{link}")),
        "services.toml:3: on_failure = \"stop_output\" of \"link\" would stop nothing: no row says `output = true`"
    );
    let with_one = parse(&format!("{stops}{link}output = true\nwhen = \"real\"\n"));
    let folder = std::env::temp_dir().join(format!("jink-output-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    for program in ["jink-planner", "jink-mavlink-gateway"] {
        std::os::unix::fs::symlink(std::env::current_exe().unwrap(), folder.join(program)).unwrap();
    }
    let [real, simulated] =
        [Mode::Real, Mode::SimulatedVehicle].map(|mode| with_one.select(mode, &folder, &Config::default()));
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(real.unwrap().len(), 2);
    assert_eq!(
        simulated.unwrap_err().to_string(),
        refused,
        "it does not run there"
    );
}

#[test]
fn unknown_keys_and_words_are_refused_with_line_and_nearest() {
    assert_eq!(
        error_of("[[process]]\nname = \"a\"\nprogram = \"b\"\nesential = true\n"),
        "services.toml:4: unknown key `esential`; did you mean `essential`?"
    );
    assert_eq!(
        error_of("[[proces]]\nname = \"a\"\n"),
        "services.toml:1: unknown key `proces`; did you mean `process`?"
    );
    assert_eq!(
        error_of(&format!("{SHORT}restart = {{ ceilng_ms = 5 }}\n")),
        "services.toml:4: unknown key `ceilng_ms`; did you mean `ceiling_ms`?"
    );
    assert_eq!(
        error_of(&format!("{SHORT}when = \"simulated\"\n")),
        "services.toml:4: unknown when \"simulated\"; use one of always, real, simulated_vehicle, virtual_world, recording, viewer"
    );
    assert_eq!(
        error_of(&format!("{SHORT}on_failure = \"stop\"\n")),
        "services.toml:4: unknown on_failure \"stop\"; use one of hold, stop_output, ignore, shutdown"
    );
    assert_eq!(
        error_of(&format!("{SHORT}log = \"verbose\"\n")),
        "services.toml:4: unknown log level \"verbose\"; use one of error, warn, info, debug, trace"
    );
}

#[test]
fn a_row_without_name_or_program_is_refused_with_its_line() {
    assert_eq!(
        error_of("\n[[process]]\nprogram = \"jink-planner\"\n"),
        "services.toml:2: a process needs a `name`"
    );
    assert_eq!(
        error_of("[[process]]\nname = \"planner\"\n"),
        "services.toml:1: process \"planner\" needs a `program`"
    );
    assert_eq!(
        error_of("# nothing\n"),
        "services.toml:1: there is no [[process]] row"
    );
}

#[test]
fn two_processes_of_one_name_are_refused() {
    let text = format!("{SHORT}\n{SHORT}");
    assert_eq!(
        error_of(&text),
        "services.toml:6: \"planner\" is already the process of line 1"
    );
}

#[test]
fn names_that_do_not_fit_topics_and_status_lines_are_refused() {
    for bad in [
        "",
        "Planner",
        "with space",
        "a/b",
        "x23456789012345678901",
        "supervisor",
    ] {
        let message = error_of(&format!("[[process]]\nname = \"{bad}\"\nprogram = \"b\"\n"));
        assert!(message.starts_with("services.toml:2: process name "), "{message}");
    }
}

#[test]
fn a_program_that_depends_on_the_working_directory_is_refused() {
    for bad in ["./jink-a", "bin/jink-a", "..", ""] {
        let message = error_of(&format!("[[process]]\nname = \"a\"\nprogram = \"{bad}\"\n"));
        assert!(message.starts_with("services.toml:3: program "), "{message}");
    }
}

#[test]
fn nonsense_numbers_are_refused_with_their_line() {
    let cases = [
        (
            "heartbeat_timeout_ms = 60",
            "heartbeat_timeout_ms = 60 is outside 100 to 60000",
        ),
        (
            "start_grace_ms = -1",
            "start_grace_ms = -1 is outside 100 to 120000",
        ),
        (
            "cycle_budget_us = 5000000000",
            "cycle_budget_us = 5000000000 is outside 0 to 1000000",
        ),
        ("priority = 99", "priority = 99 is outside 0 to 98"),
        ("core = -1", "core = -1 is outside 0 to 1023"),
        ("restart = { factor = 0.5 }", "factor = 0.5 is outside 1 to 10"),
        ("restart = { factor = nan }", "factor = NaN is outside 1 to 10"),
        (
            "restart = { period_s = 0 }",
            "period_s = 0 is outside 0.1 to 3600",
        ),
        (
            "restart = { intensity = -2 }",
            "intensity = -2 is outside 0 to 1000",
        ),
        (
            "restart = { floor_ms = 50, ceiling_ms = 20 }",
            "restart: floor_ms = 50 is above ceiling_ms = 20",
        ),
    ];
    for (line, message) in cases {
        assert_eq!(
            error_of(&format!("{SHORT}{line}\n")),
            format!("services.toml:4: {message}")
        );
    }
    assert!(error_of(&format!("{SHORT}cycle_budget_us = \"fast\"\n")).starts_with("services.toml:4: "));
}

#[test]
fn what_belongs_to_one_process_is_no_default() {
    assert_eq!(
        error_of(&format!("[defaults]\nwhen = \"always\"\n{SHORT}")),
        "services.toml:2: `when` belongs into a [[process]] row, not into [defaults]"
    );
}

#[test]
fn more_processes_than_a_status_can_hold_are_refused() {
    let text: String = (0..25)
        .map(|n| format!("[[process]]\nname = \"p{n}\"\nprogram = \"jink-p\"\n"))
        .collect();
    assert!(error_of(&text).contains("25 processes; at most 24"));
}

#[test]
fn a_missing_program_is_named_with_the_path_that_was_tried() {
    let table = parse(&format!("\n{SHORT}"));
    let message = table
        .select(Mode::Real, Path::new("/nowhere/bin"), &Config::default())
        .unwrap_err()
        .to_string();
    assert_eq!(
        message,
        "services.toml:2: the program of \"planner\" is missing: /nowhere/bin/jink is no executable file"
    );
}

#[test]
fn each_mode_has_its_processes_and_arguments() {
    let row = |name: &str, when: &str| {
        format!(
            "[[process]]\nname = \"{name}\"\nprogram = \"/bin/sh\"\nwhen = \"{when}\"\n\
             arguments = [\"{name}\"]\narguments_external = [\"{name}\", \"external\"]\n"
        )
    };
    let rows = [
        row("a", "always"),
        row("v", "simulated_vehicle"),
        row("s", "virtual_world"),
        row("r", "real"),
        row("k", "recording"),
        row("p", "viewer"),
    ];
    let table = parse(&rows.concat());
    let started_with = |mode: Mode, config: &str| -> Vec<String> {
        let config = Config::parse(Path::new("jink.toml"), config).unwrap();
        let rows = table.select(mode, Path::new("/"), &config).unwrap();
        rows.iter().map(|row| row.arguments.join(" ")).collect()
    };
    let started = |mode: Mode| started_with(mode, "");
    assert_eq!(started(Mode::Real), ["a", "r"]);
    assert_eq!(started(Mode::SimulatedVehicle), ["a", "v", "s"]);
    assert_eq!(started(Mode::VirtualWorld), ["a external", "s external"]);
    assert_eq!(
        started_with(Mode::Real, "[recorder]\nfolder = \"/x\"\n"),
        ["a", "r", "k"]
    );
    assert_eq!(
        started_with(Mode::Real, "[viewer]\naddress = \"127.0.0.1:0\"\n"),
        ["a", "r", "p"]
    );
}

#[test]
fn logs_that_nobody_carries_to_the_disk_are_said() {
    let config = Config::parse(Path::new("jink.toml"), "log_dir = \"/var/log/jink\"\n").unwrap();
    let row = "[[process]]\nname = \"recorder\"\nprogram = \"/bin/jink-recorder\"\n";
    let (with, without) = (parse(row).rows, parse(SHORT).rows);
    let why = ProcessTable::nobody_carries(&without, &config).unwrap();
    assert!(why.contains("jink-recorder"), "{why}");
    assert_eq!(ProcessTable::nobody_carries(&with, &config), None);
    assert_eq!(ProcessTable::nobody_carries(&without, &Config::default()), None);
}

/// A configuration with rangefinders that are plugged in, and one that the autopilot has.
fn sensors(names: &[&str]) -> Config {
    let plugged: String = names
        .iter()
        .map(|name| format!("[[sensor]]\nname = \"{name}\"\nkind = \"rangefinder\"\ndevice = \"/dev/x\"\n"))
        .collect();
    let text = format!("{plugged}[[sensor]]\nname = \"ground\"\nkind = \"autopilot_rangefinder\"\n");
    Config::parse(Path::new("jink.toml"), &text).unwrap()
}

const PER_SENSOR: &str = "[[process]]\nname = \"planner\"\nprogram = \"/bin/sh\"\n\
                          [[process]]\nname = \"{sensor}\"\nprogram = \"/bin/sh\"\nper_sensor = \"rangefinder\"\n\
                          when = \"real\"\narguments = [\"--sensor\", \"{sensor}\"]\n";

#[test]
fn a_row_per_sensor_is_there_for_each_that_is_plugged_in() {
    let table = parse(PER_SENSOR);
    let started = |mode: Mode, names: &[&str]| -> Vec<String> {
        let rows = table.select(mode, Path::new("/"), &sensors(names)).unwrap();
        let name_and_arguments = |row: &ProcessRow| format!("{} {}", row.rules.name, row.arguments.join(" "));
        rows.iter().map(name_and_arguments).collect()
    };
    assert_eq!(
        started(Mode::Real, &["front", "left"]),
        ["planner ", "front --sensor front", "left --sensor left"]
    );
    assert_eq!(started(Mode::Real, &[]), ["planner "]);
    assert_eq!(started(Mode::VirtualWorld, &["front"]), ["planner "]);
}

#[test]
fn a_sensor_that_nobody_measures_with_is_refused_where_sensors_are_real() {
    let own =
        "[[process]]\nname = \"user_sonar\"\nprogram = \"/bin/sh\"\npublishes = [\"range/scan/sonar\"]\n";
    let (plain, with_own) = (parse(PER_SENSOR), parse(&format!("{PER_SENSOR}{own}")));
    let select = |table: &ProcessTable, mode: Mode, sensor: &str| {
        let text = format!("[[sensor]]\n{sensor}\n");
        let config = Config::parse(Path::new("jink.toml"), &text).unwrap();
        let rows = table.select(mode, Path::new("/"), &config);
        rows.map(|rows| rows.len()).map_err(|error| error.to_string())
    };
    let lidar = "name = \"lidar\"\nkind = \"lidar_3d\"";
    let unplugged = "name = \"front\"\nkind = \"rangefinder\"";
    let sonar = "name = \"sonar\"\nkind = \"user/sonar\"\noutput = \"scan\"";
    for (sensor, words) in [
        (
            lidar,
            "sensor \"lidar\": no driver reads this lidar_3d: give it the `device`",
        ),
        (unplugged, "sensor \"front\": no driver reads this rangefinder"),
        (
            "name = \"top\"\nkind = \"lidar_2d\"\ndevice = \"/dev/y\"",
            "this lidar_2d",
        ),
        (sonar, "the process table needs a row that publishes its topic"),
    ] {
        let error = select(&plain, Mode::Real, sensor).unwrap_err();
        assert!(
            error.starts_with("jink.toml: ") && error.contains(words),
            "{error}"
        );
        assert_eq!(
            select(&plain, Mode::VirtualWorld, sensor),
            Ok(1),
            "a simulation renders it"
        );
    }
    assert_eq!(select(&with_own, Mode::Real, sonar), Ok(2));
    assert_eq!(
        select(&plain, Mode::Real, &format!("{unplugged}\ndevice = \"/dev/x\"")),
        Ok(2)
    );
    for received in ["autopilot_rangefinder", "obstacle_row"] {
        let received = format!("name = \"below\"\nkind = \"{received}\"");
        assert_eq!(select(&plain, Mode::Real, &received), Ok(1));
    }
}

#[test]
fn rows_for_two_kinds_of_sensors_may_both_be_named_by_the_sensor() {
    let other = "[[process]]\nname = \"{sensor}\"\nprogram = \"/bin/cat\"\nper_sensor = \"depth_camera\"\n";
    let table = parse(&format!("{PER_SENSOR}{other}"));
    let text = "[[sensor]]\nname = \"eye\"\nkind = \"depth_camera\"\ndevice = \"/dev/video0\"\n\
                [[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\ndevice = \"/dev/ttyS4\"\n";
    let config = Config::parse(Path::new("jink.toml"), text).unwrap();
    let rows = table.select(Mode::Real, Path::new("/"), &config).unwrap();
    let started: Vec<(&str, &Path)> = rows
        .iter()
        .map(|row| (row.rules.name.as_str(), row.program.as_path()))
        .collect();
    let program = |name: &'static str| Path::new(name);
    assert_eq!(
        started,
        [
            ("planner", program("/bin/sh")),
            ("front", program("/bin/sh")),
            ("eye", program("/bin/cat"))
        ]
    );
    let twice = format!("{PER_SENSOR}{other}{other}");
    assert_eq!(
        error_of(&twice),
        "services.toml:15: \"{sensor}\" is already the process of line 10"
    );
}

#[test]
fn a_row_per_sensor_needs_a_place_for_its_name_and_a_known_kind() {
    let row = |name: &str, kind: &str| {
        error_of(&format!(
            "[[process]]\nname = \"{name}\"\nprogram = \"p\"\nper_sensor = \"{kind}\"\n"
        ))
    };
    assert_eq!(
        row("range", "rangefinder"),
        "services.toml:2: process name \"range\": of a row for each rangefinder, it needs {sensor} in it, and else lower-case \
         letters, digits and underscores"
    );
    assert_eq!(
        row("{sensor}", "sonar"),
        "services.toml:4: unknown kind of sensor \"sonar\"; use one of lidar_3d, depth_camera, lidar_2d, rangefinder, autopilot_rangefinder, obstacle_row"
    );
    assert!(
        error_of("[[process]]\nname = \"{sensor}\"\nprogram = \"p\"\n").contains("process name \"{sensor}\"")
    );
    assert_eq!(
        error_of(&format!("[defaults]\nper_sensor = \"rangefinder\"\n{SHORT}")),
        "services.toml:2: `per_sensor` belongs into a [[process]] row, not into [defaults]"
    );
}

#[test]
fn a_sensor_whose_name_is_taken_too_long_or_one_too_many_is_refused() {
    let refused = |text: &str, names: &[&str]| {
        let selected = parse(text).select(Mode::Real, Path::new("/"), &sensors(names));
        selected.unwrap_err().to_string()
    };
    assert_eq!(
        refused(PER_SENSOR, &["planner"]),
        "services.toml:4: \"planner\" is already the process of line 1; rename the sensor"
    );
    let long = PER_SENSOR.replace("name = \"{sensor}\"", "name = \"range_{sensor}\"");
    assert_eq!(
        refused(&long, &["front", "a_name_of_fifteen"]),
        "services.toml:4: \"range_a_name_of_fifteen\" cannot be the name of a process; rename the sensor (at most 20 \
         characters in all)"
    );
    // Two processes for each of as many sensors as a vehicle may have.
    let twice = format!(
        "{PER_SENSOR}[[process]]\nname = \"second_{{sensor}}\"\nprogram = \"/bin/sh\"\nper_sensor = \"rangefinder\"\n"
    );
    let names: Vec<String> = (0..14).map(|n| format!("s{n}")).collect();
    let names: Vec<&str> = names.iter().map(String::as_str).collect();
    let text = refused(&twice, &names);
    assert!(text.contains("more than 24 processes"), "{text}");
}

const FOREIGN: &str = "[[topic]]\nname = \"user/wind\"\npayload = \"Wind\"\nsize_bytes = 24\n\
                       [[process]]\nname = \"user_wind\"\nprogram = \"/bin/sh\"\nshadow = false\n\
                       reads = [\"map/local\"]\npublishes = [\"user/wind\"]\n";

#[test]
fn a_process_of_others_is_a_row_with_what_it_may_use() {
    let rows = parse(FOREIGN)
        .select(Mode::Real, Path::new("/"), &Config::default())
        .unwrap();
    assert!(rows[0].grants.may_publish("user/wind") && rows[0].grants.may_read("map/local"));
    assert!(!rows[0].rules.has_shadow);
    assert_eq!(parse(SHORT).rows[0].grants, Grants::default());
    assert_eq!(
        error_of(&format!("{SHORT}publishes = [\"user/wind\"]\n")),
        "services.toml:4: \"planner\" has `publishes`: only processes called user_... are granted topics, the others stand in \
         the topic table"
    );
    assert_eq!(
        error_of(&format!("[defaults]\nreads = []\n{SHORT}")),
        "services.toml:2: `reads` belongs into a [[process]] row, not into [defaults]"
    );
    assert_eq!(
        error_of(&format!("{FOREIGN}hot_shadow = true\n")),
        "services.toml:11: \"user_wind\" has `shadow = false`: it cannot have a hot shadow"
    );
}

#[test]
fn what_others_publish_has_one_producer_and_a_sensor_that_it_belongs_to() {
    let refused = |text: &str| {
        let selected = parse(text).select(Mode::Real, Path::new("/"), &sensors(&["front"]));
        selected.unwrap_err().to_string()
    };
    let second = FOREIGN
        .split_once("[[process]]")
        .unwrap()
        .1
        .replace("user_wind", "user_gust");
    assert_eq!(
        refused(&format!("{FOREIGN}[[process]]{second}")),
        "services.toml:11: \"user_gust\" publishes user/wind, as does \"user_wind\" of line 5: a topic has one producer"
    );
    assert_eq!(
        refused(&FOREIGN.replace("\"user/wind\"]", "\"range/scan/frnt\"]")),
        "services.toml:5: \"user_wind\" publishes range/scan/frnt, and no [[sensor]] of jink.toml has this topic; did you mean \
         `range/scan/front`?"
    );
}
