//! What a newcomer may type wrongly is refused with the cause, by its own exit code, and leaves nothing behind.

use jink_runtime::Instance;
use jink_testkit::temp_folder::TempFolder;
use std::path::Path;
use std::process::{Command, Output};

/// The command line cannot be understood.
const USAGE: i32 = 2;
/// It is understood, and refused.
const REFUSED: i32 = 1;
/// Nothing is running.
const NOT_RUNNING: i32 = 3;
/// The system cannot start.
const CANNOT_START: i32 = 78;

/// With the configuration that is shipped, of which no sensor is plugged in: nothing of it can start.
fn jink(arguments: &str) -> Output {
    let config = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config");
    let arguments = arguments.replace("CONFIG", config.to_str().unwrap());
    Command::new(env!("CARGO_BIN_EXE_jink"))
        .args(arguments.split_whitespace())
        .output()
        .unwrap()
}

#[test]
fn every_wrong_command_is_refused_with_its_cause() {
    let instance: Instance = format!("wrong_{}", std::process::id()).parse().unwrap();
    let of_nobody = format!("--instance {instance}");
    let up = "up --detach --config CONFIG";
    let table: &[(&str, i32, &str)] = &[
        // No such thing.
        ("", USAGE, "Usage: jink"),
        ("fly", USAGE, "unrecognized subcommand 'fly'"),
        ("upp", USAGE, "'up'"),
        ("statsu", USAGE, "'status'"),
        ("topic", USAGE, "Usage: jink topic"),
        ("topic lst", USAGE, "'list'"),
        ("param", USAGE, "Usage: jink param"),
        ("param gett OA_SPD_MAX", USAGE, "'get'"),
        ("check wind", USAGE, "unrecognized subcommand 'wind'"),
        ("lidar", USAGE, "Usage: jink lidar"),
        ("status --jsn", USAGE, "'--json'"),
        ("down --noww", USAGE, "'--now'"),
        ("top --onec", USAGE, "'--once'"),
        ("instances --remov", USAGE, "'--remove'"),
        ("up --wrld forest", USAGE, "'--world'"),
        ("up extra", USAGE, "unexpected argument 'extra'"),
        ("schema NoSuchType", REFUSED, "NoSuchType"),
        // Something is missing, twice there, or contradicts.
        ("param set OA_SPD_MAX", USAGE, "<VALUE>"),
        ("swap planner", USAGE, "<BINARY>"),
        ("restart", USAGE, "<SERVICE>"),
        ("stop", USAGE, "<SERVICE>"),
        ("topic hz", USAGE, "<TOPIC>"),
        ("lidar dump --pcap a.pcap", USAGE, "--csv <FILE>"),
        ("up --detach --detach", USAGE, "cannot be used multiple times"),
        ("up --seed 3", USAGE, "--world"),
        ("up --sitl-instance 3", USAGE, "--sitl"),
        ("check sensors --against top", USAGE, "--calibrate"),
        ("topic echo x --json --full", USAGE, "cannot be used with"),
        ("schema --c --python", USAGE, "cannot be used with"),
        ("ring --json --watch", USAGE, "cannot be used with"),
        ("ring --watch --plotjuggler x:1", USAGE, "cannot be used with"),
        ("up --autopilot px4", REFUSED, "belong to a simulated vehicle"),
        ("up --wind 1,1", REFUSED, "belong to a simulated vehicle"),
        // No such value.
        ("--instance A/b status", USAGE, "use 1 to 22 lower-case letters"),
        (
            "--instance a_name_that_is_far_too_long status",
            USAGE,
            "use 1 to 22 lower-case letters",
        ),
        (
            "up --world forest --seed -1",
            USAGE,
            "possible are whole numbers from 0",
        ),
        (
            "up --world forest --seed many",
            USAGE,
            "possible are whole numbers from 0",
        ),
        (
            "up --world forest --density thick",
            USAGE,
            "invalid value 'thick'",
        ),
        ("up --world forest --autopilot px5", USAGE, "px4_current"),
        ("up --world forest --wind 1", USAGE, "expected NORTH,EAST"),
        ("up --world forest --wind 1,99", USAGE, "at most 30 m/s"),
        (
            "up --world forest --sitl /x --sitl-interface hill",
            USAGE,
            "possible values: hil, sih, json",
        ),
        (
            "up --world forest --sitl /x --sitl-instance 10",
            USAGE,
            "10 is not in 0..=9",
        ),
        ("world --seed -1", USAGE, "possible are whole numbers from 0"),
        ("topic hz x --for 0", USAGE, "possible are 0.001 to 86400"),
        ("topic hz x --for -1", USAGE, "possible are 0.001 to 86400"),
        ("topic echo x --timeout nan", USAGE, "possible are 0.001 to 86400"),
        ("topic echo x --count 0", USAGE, "0 is not in 1.."),
        ("topic echo x --count -1", USAGE, "-1"),
        ("swap planner x --cycles 0", USAGE, "0 is not in 1..=1000000"),
        ("check link --seconds 0", USAGE, "0 is not in 1..=600"),
        ("check sensors --seconds 601", USAGE, "601 is not in 1..=600"),
        ("check host --seconds -1", USAGE, "-1 is not in 1..=3600"),
        (
            "check sensors --calibrate --height-m 9",
            USAGE,
            "a number from 0 to 5",
        ),
        ("param set OA_SPD_MAX fast", USAGE, "invalid value 'fast'"),
        ("param set OA_SPEED_MAX 3", REFUSED, "did you mean `OA_SPD_MAX`?"),
        (
            "param set OA_SPD_MAX 99",
            REFUSED,
            "OA_SPD_MAX = 99 is outside 0.3 to 20",
        ),
        (
            "param set OA_SPD_MAX -3",
            REFUSED,
            "OA_SPD_MAX = -3 is outside 0.3 to 20",
        ),
        (
            "param set OA_SPD_MAX nan",
            REFUSED,
            "OA_SPD_MAX = NaN is outside 0.3 to 20",
        ),
        (
            "param set OA_YAW_MODE 0.5",
            REFUSED,
            "OA_YAW_MODE = 0.5 is outside 0 to 1",
        ),
        (
            "lidar dump --pcap /no.pcap --csv /tmp/x.csv",
            REFUSED,
            "/no.pcap: cannot be opened",
        ),
        (
            "lidar dump --pcap a --csv b --model vlp17",
            USAGE,
            "--model vlp17 is not possible; possible: ",
        ),
        // Nobody is there.
        ("status", NOT_RUNNING, "not running"),
        ("down", NOT_RUNNING, "nothing is running"),
        ("top", NOT_RUNNING, "not running"),
        ("ring", NOT_RUNNING, "not running"),
        ("topic hz vehicle/state", NOT_RUNNING, "not running"),
        ("topic echo vehicle/state", NOT_RUNNING, "not running"),
        ("param get OA_SPD_MAX", NOT_RUNNING, "not running"),
        ("swap planner /bin/true", NOT_RUNNING, "not running"),
        ("restart planner", NOT_RUNNING, "not running"),
        ("stop planner", NOT_RUNNING, "not running"),
        ("check sensors", NOT_RUNNING, "not running"),
        // The configuration, or what lies over it.
        (
            "up --detach --config /nowhere",
            CANNOT_START,
            "/nowhere/jink.toml: cannot be read",
        ),
        (
            "check config --config /nowhere",
            REFUSED,
            "/nowhere/jink.toml: cannot be read",
        ),
        ("UP --link NONSENSE", CANNOT_START, "\"NONSENSE\" is no link"),
        ("UP --link udp:14540", CANNOT_START, "\"udp:14540\" is no link"),
        ("UP --link serial:/dev/ttyS9", CANNOT_START, "is no link"),
        ("UP --link udpin:nothost", CANNOT_START, "is no link"),
        (
            "UP --profile px5_trajectory",
            CANNOT_START,
            "did you mean `px4_trajectory`?",
        ),
        ("UP --sensor mid70", CANNOT_START, ".toml; did you mean `mid360`?"),
        (
            "UP --sensor mid360+d453",
            CANNOT_START,
            ".toml; did you mean `d435`?",
        ),
        (
            "UP --sensor /nowhere/own.toml",
            CANNOT_START,
            "/nowhere/own.toml: cannot be read",
        ),
        (
            "UP --sensor mid360",
            CANNOT_START,
            "no driver reads this lidar_3d",
        ),
        ("UP --set OA_SPD_MAX=3", CANNOT_START, "write section.key=value"),
        (
            "UP --set lnk.address=x",
            CANNOT_START,
            "unknown key `lnk`; did you mean `link`?",
        ),
        ("UP --set link.adress=x", CANNOT_START, "did you mean `address`?"),
        ("UP --set link.profile=px5_offboard", CANNOT_START, "px4_offboard"),
        ("UP --set link.output=bezir", CANNOT_START, "bezier"),
        (
            "UP --set link.system_id=300",
            CANNOT_START,
            "--set link.system_id=300: ",
        ),
        (
            "UP --set link.signing=always",
            CANNOT_START,
            "unknown value `always`",
        ),
        (
            "UP --set link.signing=require",
            CANNOT_START,
            "signatures are asked for, and no file holds the key",
        ),
        ("UP --set sensor.name=x", CANNOT_START, "sensors are a list"),
        (
            "UP --set params.OA_SPEED_MAX=3",
            CANNOT_START,
            "did you mean `OA_SPD_MAX`?",
        ),
        (
            "UP --set params.OA_SPD_MAX=99",
            CANNOT_START,
            "OA_SPD_MAX = 99 is outside 0.3 to 20",
        ),
        (
            "UP --set params.OA_SPD_MAX=-3",
            CANNOT_START,
            "OA_SPD_MAX = -3 is outside 0.3 to 20",
        ),
        (
            "UP --set params.OA_SPD_MAX=fast",
            CANNOT_START,
            "--set params.OA_SPD_MAX=fast: ",
        ),
        (
            "UP --set params.OA_ALT_MIN=50 --set params.OA_ALT_MAX=5",
            CANNOT_START,
            "OA_ALT_MIN = 50 is above OA_ALT_MAX = 5",
        ),
        (
            "UP --set params.OA_DCL_HANG_LO=50",
            CANNOT_START,
            "OA_DCL_HANG_LO = 50 is above OA_DCL_HANG_HI = 10",
        ),
    ];
    assert!(table.len() > 90);
    let mut wrong = Vec::new();
    for (line, code, cause) in table {
        let line = line.replace("UP", up);
        let line = if line.starts_with("--instance") {
            line
        } else {
            format!("{of_nobody} {line}")
        };
        let answer = jink(&line);
        let said = format!(
            "{}{}",
            String::from_utf8_lossy(&answer.stderr),
            String::from_utf8_lossy(&answer.stdout)
        );
        // The cause comes first; usage errors and verdicts are longer.
        let first = if *code == CANNOT_START {
            said.lines().next().unwrap_or_default()
        } else {
            &said
        };
        if answer.status.code() != Some(*code) || !first.contains(cause) {
            wrong.push(format!(
                "jink {line}: {:?}, expected {code} and {cause:?}:\n{said}",
                answer.status.code()
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(!instance.folder().exists(), "something was left behind");
}

/// A vehicle with a rangefinder and a lidar, as they should be.
const GOOD: &str = "\
[params]
OA_SPD_MAX = 2.0
[link]
address = \"serial:/dev/ttyACM0:921600\"
[[sensor]]
name = \"down\"
kind = \"rangefinder\"
model = \"tfmini\"
device = \"/dev/ttyS4\"
orientation = \"down\"
[[sensor]]
name = \"top\"
kind = \"lidar_3d\"
model = \"livox_mid360\"
device = \"udp:0.0.0.0:56301\"
sensor_address = \"192.168.1.150\"
[[sensor]]
name = \"front\"
kind = \"depth_camera\"
model = \"realsense_d435\"
device = \"/dev/video0\"
";

/// What `jink check config` finds in this `jink.toml`: exit code, and each finding from the file's name on.
fn checked(folder: &TempFolder, text: &str) -> (Option<i32>, Vec<String>) {
    let services = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config/services.toml");
    folder.write("services.toml", &std::fs::read_to_string(services).unwrap());
    folder.write("jink.toml", text);
    let answer = jink(&format!("check config --json --config {}", folder.display()));
    let json: serde_json::Value = serde_json::from_slice(&answer.stdout).unwrap();
    let place = format!("{}/", folder.display());
    let findings = json["findings"].as_array().unwrap().iter();
    let findings = findings.map(|finding| finding["is"].as_str().unwrap().replace(&place, ""));
    (answer.status.code(), findings.collect())
}

#[test]
fn a_right_configuration_is_ready_also_with_what_editors_of_windows_add() {
    let folder = TempFolder::new("check_right");
    assert_eq!(checked(&folder, GOOD), (Some(0), Vec::new()));
    let of_windows = format!("\u{feff}{}", GOOD.replace('\n', "\r\n"));
    assert_eq!(checked(&folder, &of_windows), (Some(0), Vec::new()));
}

#[test]
fn all_mistakes_of_a_configuration_are_found_at_once_each_with_its_line() {
    let folder = TempFolder::new("check_wrong");
    let text = GOOD
        .replace("OA_SPD_MAX = 2.0", "OA_SPD_MAX = 200")
        .replace("921600", "fast")
        .replace("name = \"down\"", "name = \"planner\"")
        .replace("\"tfmini\"", "\"tfmin\"")
        .replace(
            "orientation = \"down\"",
            "orientation = \"dwon\"\norientaton = \"down\"",
        )
        .replace("192.168.1.150", "192.168.1")
        .replace(
            "model = \"livox_mid360\"",
            "model = \"livox_mid36\"\nforward_m = 90",
        )
        .replace("kind = \"depth_camera\"", "kind = \"depth_camra\"");
    let (code, found) = checked(&folder, &text);
    assert_eq!(code, Some(1));
    let expected = [
        "jink.toml:2: OA_SPD_MAX = 200 is outside",
        "jink.toml:21: unknown kind of sensor \"depth_camra\"; did you mean `depth_camera`?",
        "jink.toml:4: \"serial:/dev/ttyACM0:fast\" is no link",
        "jink.toml:16: sensor \"top\": forward_m = 90 is not possible",
        "jink.toml:18: sensor \"top\": sensor_address = \"192.168.1\" is not possible",
        "jink.toml:15: sensor \"top\": model = \"livox_mid36\" is not possible; possible: ",
        "jink.toml:8: sensor \"planner\": model = \"tfmin\" is not possible; possible: ",
        "jink.toml:10: sensor \"planner\": orientation = \"dwon\" is not possible",
        "jink.toml:11: sensor \"planner\": a rangefinder has no key `orientaton`; did you mean `orientation`?",
        "\"planner\" is already the process of line",
    ];
    for words in expected {
        assert_eq!(
            found.iter().filter(|one| one.contains(words)).count(),
            1,
            "{words:?} in {found:#?}"
        );
    }
    assert_eq!(found.len(), expected.len(), "{found:#?}");
}

#[test]
fn each_mistake_in_the_process_table_is_found_with_its_line() {
    let folder = TempFolder::new("check_table");
    checked(&folder, GOOD);
    let text = std::fs::read_to_string(folder.join("services.toml")).unwrap();
    let text = text
        .replacen("cycle_budget_us = 20000", "cycle_budget = 20000", 1)
        .replacen("program = \"jink-planner\"", "program = \"jink-planer\"", 1)
        .replacen("end_to_end_ms = 100", "end_to_end_ms = -1", 1);
    folder.write("services.toml", &text);
    let answer = jink(&format!("check config --config {}", folder.display()));
    let said = String::from_utf8_lossy(&answer.stdout).into_owned();
    assert_eq!(answer.status.code(), Some(1));
    for words in [
        "3 blockers",
        "unknown key `cycle_budget`; did you mean `cycle_budget_us`?",
        "the program of \"planner\" is missing",
        "end_to_end_ms = -1 is outside 0 to 10000",
    ] {
        assert!(said.contains(words), "{words:?} in {said}");
    }
}
