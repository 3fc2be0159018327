//! In gusts a vehicle follows less closely than is known of its autopilot: this is learned in flight, kept as a
//! parameter by its owner, and known to whoever is started anew.

use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, program, until};
use std::process::Stdio;

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn by_the_owner_of_the_parameters_and_the_next_planner() {
    let [link, station] = [free_udp_port(), free_udp_port()];
    let jink = System::up(
        "learned",
        &[
            "--world",
            "forest",
            "--seed",
            "8",
            "--set",
            "simulation.autopilot=ardupilot",
            "--set",
            "link.profile=ardupilot_guided",
            "--set",
            "simulation.wind_gust_mps=4",
            "--set",
            &format!("link.address=udpin:127.0.0.1:{link}"),
            "--set",
            &format!("simulation.ground_station_port={station}"),
        ],
    );
    let port = station.to_string();
    let mut mission = program(
        "jink-simulator",
        &["fly", "--port", &port, "--world", "forest", "--seed", "8"],
    );
    let mut mission = mission.stdout(Stdio::piped()).spawn().unwrap();
    let kept_s2 = || {
        ["OA_TRK_CUT", "OA_TRK_OVER"].map(|name| {
            let value = jink.jink(&["param", "get", name]).stdout;
            value.trim().parse::<f64>().unwrap_or_default()
        })
    };
    jink.until_it_flies();
    until("something learned", || {
        kept_s2().iter().any(|figure_s2| *figure_s2 > 0.0)
    });
    mission.wait().unwrap();
    let learned_s2 = kept_s2();
    for process in ["parameter_server", "planner"] {
        let killed = jink.kill(process);
        until("another one", || {
            let service = jink.service(process);
            service["pid"] != killed && service["state"] == "active"
        });
    }
    until("the values", || kept_s2() == learned_s2);
    until("a planner that counts on them", || {
        let speed = &jink.status()["speed"];
        let plans_s2 = ["cut_s2", "overshoot_s2"].map(|name| speed[name].as_f64().unwrap_or_default());
        println!("{learned_s2:?}: {speed}");
        plans_s2
            .iter()
            .zip(learned_s2)
            .all(|(plan_s2, kept_s2)| plan_s2 + 0.006 >= kept_s2)
    });
}
