//! `jink bench latency` as a user runs it: a load is flown, taken apart stage by stage, kept, compared and shown.

use jink_tests::processes::{TempFolder, answer, program};

#[test]
fn a_load_is_flown_and_its_time_is_taken_apart() {
    let folder = TempFolder::new("latency");
    let [json, page] = ["now.json", "now.html"].map(|name| folder.path().join(name).display().to_string());
    let one_load = [
        "bench",
        "latency",
        "--points",
        "2000",
        "--rates",
        "10",
        "--beside",
        "hog",
        "--realtime",
        "off",
        "--seconds",
        "2",
    ];
    let measured = answer(&mut program(
        "jink",
        &[&one_load[..], &["--json", &json, "--report", &page]].concat(),
    ));
    assert_eq!(measured.code, Some(0), "{measured:?}");
    for part in [
        "2000 points, 10 Hz, hog: ",
        "capture..wire",
        "  first plan",
        "obstacle_fusion",
        "of the chain",
    ] {
        assert!(measured.stdout.contains(part), "{part}: {measured:?}");
    }
    let text = std::fs::read_to_string(&json).unwrap();
    let bench: serde_json::Value = serde_json::from_str(&text).unwrap();
    let load = &bench["loads"][0];
    let number = |value: &serde_json::Value| value.as_f64().unwrap();
    assert!(number(&load["total"]["n"]) >= 5.0, "{load:#}");
    let stages: Vec<&str> = load["stages"]
        .as_array()
        .unwrap()
        .iter()
        .map(|stage| stage["stage"].as_str().unwrap())
        .collect();
    assert_eq!(
        stages,
        ["sensor", "fusion", "planner", "generator", "guard", "gateway"]
    );
    // The parts are the whole: the shortest way is no shorter than what every stage computes at the least.
    let sorted = load["sorted_total_ms"].as_array().unwrap();
    let fusion = load["stages"][1]["compute"]["p50_ms"].as_f64().unwrap();
    assert!(
        fusion > 0.0 && number(sorted.last().unwrap()) > fusion,
        "{load:#}"
    );
    assert_eq!(number(sorted.last().unwrap()), number(&load["total"]["max_ms"]));
    assert!(std::fs::read_to_string(&page).unwrap().ends_with("</html>\n"));

    let compared = answer(&mut program(
        "jink",
        &[&one_load[..], &["--compare", &json]].concat(),
    ));
    assert_eq!(compared.code, Some(0), "{compared:?}");
    assert!(compared.stdout.contains("\nratio"), "{compared:?}");
}

#[test]
fn what_cannot_be_measured_or_compared_is_said_before_anything_is_started() {
    let folder = TempFolder::new("latency_wrong");
    let file = folder.write("before.json", "{}");
    let bench =
        |arguments: &[&str]| answer(&mut program("jink", &[&["bench", "latency"], arguments].concat()));
    let wrong = bench(&["--compare", &file.display().to_string()]);
    assert_eq!(wrong.code, Some(1), "{wrong:?}");
    assert!(
        wrong
            .stderr
            .contains("before.json: no figures of jink bench latency"),
        "{wrong:?}"
    );
    assert!(wrong.stdout.is_empty(), "something was started: {wrong:?}");
    for arguments in [
        ["--points", "7"],
        ["--rates", "0"],
        ["--seconds", "0"],
        ["--beside", "perhaps"],
    ] {
        let wrong = bench(&arguments);
        assert_eq!(wrong.code, Some(2), "{wrong:?}");
        assert!(wrong.stderr.contains(arguments[0]), "{wrong:?}");
    }
}
