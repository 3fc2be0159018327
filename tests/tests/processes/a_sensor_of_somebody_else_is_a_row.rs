//! A sensor that is no part of jink, with a topic and a parameter of its own, needs rows in the configuration and nothing
//! else: the commands know all three, and the value reaches its program.

use jink_runtime::Instance;
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, answer, program, until};
use serde_json::Value;

const PARAMETER: &str = "[[parameter]]\nname = \"USR_SONAR_MAX\"\ndefault = 6\nmin = 1\nmax = 20\nunit = \"m\"\n\
                         text = \"Longest range of the sonar\"\n";
const SENSOR: &str = "[[sensor]]\nname = \"sonar\"\nkind = \"user/sonar\"\noutput = \"scan\"\nbus = 3\n";
const ROWS: &str = "\n[[topic]]\nname = \"user/echo\"\npayload = \"Echo\"\nsize_bytes = 16\nrate_hz = 20\n\
                    \n[[process]]\nname = \"user_sonar\"\nprogram = \"jink-own-sonar\"\n\
                    publishes = [\"range/scan/sonar\", \"user/echo\"]\n";

fn config(role: &str, rows: &str) -> TempFolder {
    let folder = TempFolder::with_config(role);
    for (file, more) in [
        ("jink.toml", format!("\n{SENSOR}\n{PARAMETER}")),
        ("services.toml", rows.to_owned()),
    ] {
        let text = std::fs::read_to_string(folder.path().join(file)).unwrap();
        folder.write(file, &(text + &more));
    }
    folder
}

fn arguments<'a>(folder: &'a TempFolder, link: &'a str) -> Vec<&'a str> {
    let sets = [link, "simulation.ground_station_port=0", "params.USR_SONAR_MAX=7"];
    let mut all = vec!["--world", "empty", "--config", folder.text()];
    all.extend(sets.iter().flat_map(|set| ["--set", *set]));
    all
}

#[test]
fn its_topic_its_sensor_and_its_parameter_are_known_to_all() {
    let folder = config("sonar", ROWS);
    let link = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let system = System::up("sonar", &arguments(&folder, &link));

    let listed = system.jink(&["topic", "list"]).stdout;
    let line = listed.lines().find(|line| line.starts_with("user/echo")).unwrap();
    assert!(line.contains("Echo") && line.contains("user_sonar"), "{listed}");
    let measured = system.jink(&["topic", "hz", "user/echo", "--for", "2", "--json"]);
    let measured: Value = serde_json::from_str(&measured.stdout).unwrap();
    assert!(
        (18.0..22.0).contains(&measured["rate_hz"].as_f64().unwrap()),
        "{measured}"
    );
    let echo = system
        .jink(&["topic", "echo", "user/echo", "--count", "1", "--timeout", "5"])
        .stdout;
    assert!(
        echo.contains("16 bytes of jink.Echo#") && echo.contains("     0  "),
        "{echo}"
    );
    let unknown = system.jink(&["topic", "hz", "user/ech"]);
    assert!(unknown.stderr.contains("(perhaps user/echo)"), "{unknown:?}");

    let seen: Value = serde_json::from_str(
        &system
            .jink(&["check", "sensors", "--seconds", "2", "--json"])
            .stdout,
    )
    .unwrap();
    let sensors = seen["sensors"].as_array().unwrap();
    let sonar = sensors.iter().find(|sensor| sensor["name"] == "sonar").unwrap();
    assert!(sonar["samples"].as_u64().unwrap() > 20, "{sonar}");
    assert_eq!(sonar["kind"], "user/sonar");

    assert_eq!(system.jink(&["param", "get", "USR_SONAR_MAX"]).stdout.trim(), "7");
    let set = system.jink(&["param", "set", "USR_SONAR_MAX", "9"]);
    assert_eq!(set.stdout.trim(), "USR_SONAR_MAX = 9 m", "{set:?}");
    let refused = system.jink(&["param", "set", "USR_SONAR_MAX", "21"]);
    assert!(
        refused.stderr.contains("USR_SONAR_MAX = 21 is outside 1 to 20"),
        "{refused:?}"
    );
    until("the value in the sonar", || {
        let scan = system.jink(&[
            "topic",
            "echo",
            "range/scan/sonar",
            "--count",
            "1",
            "--timeout",
            "5",
        ]);
        scan.stdout.contains("range_max_m: 9.0")
    });
    // It outlives the gateway, and reaches the next start of the sonar.
    for process in ["mavlink_gateway", "user_sonar"] {
        assert_eq!(system.jink(&["restart", "--hard", process]).code, Some(0));
        until("its restart", || system.service(process)["restarts"] == 1);
    }
    until("the kept value", || {
        system.jink(&["param", "get", "USR_SONAR_MAX"]).stdout.trim() == "9"
    });
}

#[test]
fn what_its_row_does_not_grant_it_does_not_get() {
    let folder = config("sonar_denied", &ROWS.replace("\"range/scan/sonar\", ", ""));
    let link = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let denied = Own::new("denied");
    let up = answer(program("jink", &["--instance", &denied.0, "up"]).args(arguments(&folder, &link)));
    assert_eq!(up.code, Some(78), "{up:?}");
    assert!(
        up.stderr
            .contains("user_sonar may not publish range/scan/*: neither the topic's row nor"),
        "{up:?}"
    );
    // What is wrong with the table itself is reported with file and line.
    let folder = config("sonar_refused", &ROWS.replace("user/echo\"]", "plan/route\"]"));
    let table = std::fs::read_to_string(folder.path().join("services.toml")).unwrap();
    let line = 1 + table
        .lines()
        .position(|line| line.contains("plan/route"))
        .unwrap();
    let refused = Own::new("refused");
    let up = answer(program("jink", &["--instance", &refused.0, "up"]).args(arguments(&folder, &link)));
    let wanted = format!("services.toml:{line}: \"user_sonar\": plan/route may not be published by others");
    assert!(
        up.code == Some(78) && up.stderr.contains(&wanted),
        "{wanted} {up:?}"
    );
}

/// An instance of its own that leaves nothing behind.
struct Own(String);

impl Own {
    fn new(role: &str) -> Self {
        Self(format!("t_{role}_{}", std::process::id()))
    }
}

impl Drop for Own {
    fn drop(&mut self) {
        let instance: Instance = self.0.parse().unwrap();
        // There is no folder if it was refused before it had one.
        let _none = std::fs::remove_dir_all(instance.folder());
    }
}
