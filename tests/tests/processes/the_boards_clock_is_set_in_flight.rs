//! The clock of the board is set while it flies, by hours and in both directions, as GPS, NTP and an operator do: nothing is restarted, the
//! flight reaches its goal, and the board knows the new time.

use crate::preload;
use jink_runtime::Instance;
use jink_testkit::not_tested;
use jink_tests::processes::{Flight, TempFolder, until};
use std::time::{SystemTime, UNIX_EPOCH};

/// What the clock is set by, each from the true time (s).
const STEPS_S: [i64; 5] = [3600, -3600, 1, -40 * 365 * 86_400, 0];
/// Way from one step to the next (m).
const BETWEEN_M: f64 = 4.0;
/// The clock of this test and that of the log differ by less (s).
const NEAR_S: f64 = 60.0;

fn now_s() -> f64 {
    SystemTime::now()
        .duration_since(UNIX_EPOCH)
        .unwrap()
        .as_secs_f64()
}

#[test]
fn by_hours_and_in_both_directions() {
    let folder = TempFolder::new("clock");
    let set = folder.path().join("ahead_s");
    let set_by = |ahead_s: i64| std::fs::write(&set, ahead_s.to_ne_bytes()).unwrap();
    set_by(0);
    let library = match preload::library(folder.path(), "set_clock") {
        Ok(library) => library,
        Err(why) => return not_tested(&why),
    };
    let flight = Flight::begin_in(
        &["--seed", "1", "--sensor", "sphere"],
        &[("LD_PRELOAD", library.as_path()), ("JINK_CLOCK_SET", &set)],
    );
    flight.until_it_flies();
    for (index, ahead_s) in STEPS_S.into_iter().enumerate() {
        set_by(ahead_s);
        let way_m = flight.flown_m() + BETWEEN_M;
        until("the next part of the way", || flight.flown_m() > way_m);
        // A service that is killed now dies at the time that the clock shows.
        if index == 0 {
            flight.kill("ground_services");
            until("its restart", || {
                flight.service("ground_services")["restarts"] == 1
            });
            let instance: Instance = flight.instance().parse().unwrap();
            let ended = instance.log_folder().join("ground_services.end.json");
            let ended = std::fs::read_to_string(ended).unwrap();
            let ended: serde_json::Value = serde_json::from_str(&ended).unwrap();
            let shown_s = ended["unix_s"].as_f64().unwrap() - now_s();
            assert!((shown_s - ahead_s as f64).abs() < NEAR_S, "{shown_s}");
        }
    }
    let figures = flight.end();
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
}
