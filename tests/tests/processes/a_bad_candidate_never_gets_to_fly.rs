//! Swaps for binaries that must not fly: each is refused with its own reason, or taken back at once, and a flight does not feel it.

use jink_tests::ports::free_udp_port;
use jink_tests::processes::{Flight, System, TempFolder, programs};

#[test]
fn in_flight() {
    let folder = TempFolder::new("candidates");
    let flight = Flight::begin(&["--seed", "6"]);
    flight.until_it_flies();
    let owner = flight.service("planner")["pid"].clone();
    assert!(owner.is_u64(), "{:?}", flight.service("planner"));
    for (name, why) in [
        ("crashes", "the candidate ended with"),
        ("other_layout", "the candidate ended with"),
        ("garbled", "cannot be used"),
        ("mute", "differ in number"),
        ("too_slow", "too slow"),
        ("fails_as_owner", "rolled back"),
        ("hangs_as_owner", "rolled back"),
        ("mute_as_owner", "has not had what it needs"),
    ] {
        let candidate = folder.path().join(name);
        std::fs::copy(programs().join("jink-bad-candidate"), &candidate).unwrap();
        let swap = flight.jink(&["swap", "planner", candidate.to_str().unwrap()]);
        let text = format!("{}{}", swap.stdout, swap.stderr);
        assert!(text.contains(why), "{name}: {text}");
        assert_eq!(swap.code, Some(1), "{name}: {text}");
        let now = flight.service("planner");
        assert_eq!(now["pid"], owner, "{name}: {now}");
    }
    let figures = flight.end();
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
    assert_eq!(figures["fcu_hold_count"], 0, "{figures}");
    // Of the three that were taken back, the one that hung and the one that was mute had to be ended.
    assert!(figures["restarts"].as_u64().unwrap() <= 3, "{figures}");
}

#[test]
fn a_candidate_that_never_comes_up_is_given_up() {
    let folder = TempFolder::new("never_up");
    let candidate = folder.path().join("never_up");
    std::fs::copy(programs().join("jink-bad-candidate"), &candidate).unwrap();
    let [link, station] = [free_udp_port(), free_udp_port()];
    let jink = System::up(
        "never_up",
        &[
            "--world",
            "forest",
            "--set",
            &format!("link.address=udpin:127.0.0.1:{link}"),
            "--set",
            &format!("simulation.ground_station_port={station}"),
        ],
    );
    let owner = jink.service("planner")["pid"].clone();
    let swap = jink.jink(&["swap", "planner", candidate.to_str().unwrap()]);
    let text = format!("{}{}", swap.stdout, swap.stderr);
    assert!(text.contains("start grace"), "{text}");
    assert_eq!(swap.code, Some(1), "{text}");
    let now = jink.service("planner");
    assert!(now["shadow_pid"].is_null(), "{now}");
    assert_eq!((&now["pid"], &now["state"]), (&owner, &"active".into()), "{now}");
}
