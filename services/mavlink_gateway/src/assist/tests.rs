use super::{Assist, AssistIntent, AssistScene, ModeRequest};
use jink_shared_types::Timestamp;
use jink_shared_types::link::AssistState;
use jink_shared_types::prevention::PreventionState;
use jink_shared_types::vehicle::NavMode;
use proptest::prelude::*;

/// PX4's numbers.
const POSITION: u32 = 3 << 16;
const OFFBOARD: u32 = 6 << 16;
const HOLD: u32 = 4 << 16 | 3 << 24;

/// A pilot flies in Position, and nothing prevents assisting him.
fn scene(time_s: f64) -> AssistScene {
    AssistScene {
        now: Timestamp::from_seconds(time_s),
        mode: NavMode::Position,
        custom_mode: POSITION,
        is_pilots_mode: true,
        is_armed: true,
        in_air: true,
        has_landed: false,
        fits: true,
        keeps_distance: true,
        hindrance: None,
        sticks_age_s: Some(0.05),
        is_level: true,
        sees: true,
        guard: Some(PreventionState::Free),
        is_ending: false,
        is_on_mission: false,
    }
}

fn in_mode(scene: AssistScene, mode: NavMode) -> AssistScene {
    AssistScene {
        mode,
        custom_mode: match mode {
            NavMode::Position => POSITION,
            NavMode::Offboard => OFFBOARD,
            _ => HOLD,
        },
        is_pilots_mode: mode == NavMode::Position,
        ..scene
    }
}

/// An autopilot that does what it is asked for, and all that was asked and reported, with the times (s).
struct Flight {
    assist: Assist,
    mode: NavMode,
    obeys: bool,
    time_s: f64,
    requests: Vec<(f64, ModeRequest)>,
    texts: Vec<(f64, &'static str, &'static str)>,
}

impl Flight {
    fn new() -> Self {
        Self {
            assist: Assist::default(),
            mode: NavMode::Position,
            obeys: true,
            time_s: 100.0,
            requests: Vec::new(),
            texts: Vec::new(),
        }
    }

    /// Goes on for `seconds` at 50 Hz; `change` makes each scene of an undisturbed one.
    fn run(&mut self, seconds: f64, change: impl Fn(AssistScene) -> AssistScene) {
        for _ in 0..(seconds * 50.0) as u32 {
            self.time_s += 0.02;
            let AssistIntent { request, text } =
                self.assist.step(&change(in_mode(scene(self.time_s), self.mode)));
            if let Some(request) = request {
                self.requests.push((self.time_s, request));
                self.mode = match request {
                    _ if !self.obeys => self.mode,
                    ModeRequest::Follow => NavMode::Offboard,
                    ModeRequest::Pilots(POSITION) => NavMode::Position,
                    ModeRequest::Pilots(_) => panic!("nobody's mode"),
                    ModeRequest::Hold => NavMode::Hold,
                };
            }
            if let Some(text) = text {
                self.texts.push((self.time_s, text.event.text, text.name));
            }
        }
    }

    fn engaged() -> Self {
        let mut flight = Self::new();
        flight.run(0.1, |scene| scene);
        assert_eq!(flight.assist.choose(true), Ok(()));
        flight.run(1.0, |scene| scene);
        assert_eq!(flight.assist.state(), AssistState::On);
        flight.requests.clear();
        flight.texts.clear();
        flight
    }

    fn said(&self) -> Vec<&'static str> {
        self.texts.iter().map(|(_, _, name)| *name).collect()
    }
}

#[test]
fn nothing_is_asked_for_that_nobody_has_chosen() {
    let mut flight = Flight::new();
    flight.run(20.0, |scene| scene);
    assert!(flight.requests.is_empty() && flight.texts.is_empty() && !flight.assist.streams());
}

#[test]
fn the_stream_is_there_before_the_mode_is_asked_for() {
    let mut flight = Flight::new();
    flight.run(0.1, |scene| scene);
    assert_eq!(flight.assist.choose(true), Ok(()));
    let chosen_s = flight.time_s;
    flight.run(0.2, |scene| scene);
    assert!(flight.assist.streams() && flight.requests.is_empty());
    flight.run(1.0, |scene| scene);
    let [(asked_s, ModeRequest::Follow)] = flight.requests[..] else {
        panic!("{:?}", flight.requests)
    };
    assert!((0.3..0.4).contains(&(asked_s - chosen_s)));
    assert_eq!(flight.texts.len(), 1, "{:?}", flight.texts);
    assert_eq!(flight.assist.state(), AssistState::On);
}

#[test]
fn what_speaks_against_it_is_reported_once_and_nothing_is_asked_for() {
    type Change = fn(AssistScene) -> AssistScene;
    let cases: [(&str, Change); 10] = [
        ("profile", |scene| AssistScene { fits: false, ..scene }),
        ("set CP_DIST", |scene| AssistScene {
            keeps_distance: false,
            ..scene
        }),
        ("jink is ending", |scene| AssistScene {
            is_ending: true,
            ..scene
        }),
        ("not in the air", |scene| AssistScene {
            in_air: false,
            ..scene
        }),
        ("not in the air", |scene| AssistScene {
            is_armed: false,
            ..scene
        }),
        ("choose Position first", |scene| in_mode(scene, NavMode::Hold)),
        ("no sticks", |scene| AssistScene {
            sticks_age_s: Some(0.6),
            ..scene
        }),
        ("centre the throttle", |scene| AssistScene {
            is_level: false,
            ..scene
        }),
        ("no range data", |scene| AssistScene { sees: false, ..scene }),
        ("set MAN_OVERRIDE_SPD -1", |scene| AssistScene {
            hindrance: Some("set MAN_OVERRIDE_SPD -1"),
            ..scene
        }),
    ];
    for (word, change) in cases {
        let mut flight = Flight::new();
        assert!(flight.assist.choose(true).is_err(), "nothing is known yet");
        flight.run(1.0, change);
        assert_eq!(flight.assist.choose(true), Err(word));
        flight.run(1.0, change);
        assert_eq!(flight.said(), [word, word]);
        assert!(flight.requests.is_empty() && !flight.assist.streams(), "{word}");
        // Once it is mended it still has to be chosen.
        flight.run(2.0, |scene| scene);
        assert!(flight.requests.is_empty(), "{word}");
    }
}

#[test]
fn an_autopilot_that_does_not_change_is_left_alone() {
    for refuses in [false, true] {
        let mut flight = Flight::new();
        flight.obeys = false;
        flight.run(0.1, |scene| scene);
        assert_eq!(flight.assist.choose(true), Ok(()));
        flight.run(0.5, |scene| scene);
        if refuses {
            flight.assist.note_refusal();
        }
        flight.run(10.0, |scene| scene);
        assert_eq!(
            flight.said(),
            [if refuses { "autopilot refuses" } else { "no answer" }]
        );
        assert_eq!(flight.requests.len(), if refuses { 1 } else { 6 });
        assert!(!flight.assist.streams());
    }
}

#[test]
fn a_guard_that_does_not_answer_is_never_flown_with() {
    for guard in [None, Some(PreventionState::Off), Some(PreventionState::Blind)] {
        let mut flight = Flight::new();
        flight.run(0.1, |scene| scene);
        assert_eq!(flight.assist.choose(true), Ok(()));
        flight.run(10.0, |scene| AssistScene { guard, ..scene });
        assert!(flight.requests.is_empty() && flight.said() == ["no answer"]);
    }
}

#[test]
fn every_exit_leads_to_the_pilots_mode_or_to_hold() {
    type Change = fn(AssistScene) -> AssistScene;
    let pilots = ModeRequest::Pilots(POSITION);
    // What happens, how long it lasts until something is asked for (s), what is asked for, what is reported.
    let cases: [(Change, f64, ModeRequest, &[&str]); 6] = [
        (
            |scene| AssistScene {
                keeps_distance: false,
                ..scene
            },
            0.02,
            pilots,
            &["CP_DIST is off"],
        ),
        (
            |scene| AssistScene {
                has_landed: true,
                in_air: false,
                ..scene
            },
            0.02,
            pilots,
            &["landed"],
        ),
        (
            |scene| AssistScene {
                sticks_age_s: Some(2.1),
                ..scene
            },
            0.02,
            ModeRequest::Hold,
            &["no sticks"],
        ),
        (
            |scene| AssistScene {
                sticks_age_s: None,
                ..scene
            },
            0.02,
            ModeRequest::Hold,
            &["no sticks"],
        ),
        (
            |scene| AssistScene {
                guard: Some(PreventionState::Blind),
                ..scene
            },
            5.0,
            ModeRequest::Hold,
            &["no range data"; 2],
        ),
        (
            |scene| AssistScene { guard: None, ..scene },
            5.0,
            ModeRequest::Hold,
            &["no range data"; 2],
        ),
    ];
    for (change, after_s, request, words) in cases {
        let mut flight = Flight::engaged();
        let since_s = flight.time_s;
        flight.run(8.0, |scene| match scene.mode {
            NavMode::Offboard => change(scene),
            _ => scene,
        });
        let [(asked_s, asked)] = flight.requests[..] else {
            panic!("{words:?}: {:?}", flight.requests)
        };
        assert_eq!((asked, flight.said().as_slice()), (request, words));
        assert!(
            (asked_s - since_s - after_s).abs() < 0.05,
            "{words:?} after {} s",
            asked_s - since_s
        );
        assert!(!flight.assist.streams());
    }
}

#[test]
fn switched_off_the_pilot_has_his_mode_and_what_he_changes_is_his() {
    let mut flight = Flight::engaged();
    assert_eq!(flight.assist.choose(false), Ok(()));
    flight.run(5.0, |scene| scene);
    assert_eq!(flight.requests.len(), 1);
    assert_eq!(
        (flight.mode, flight.said().as_slice()),
        (NavMode::Position, &["switched off"][..])
    );

    for mode in [NavMode::Position, NavMode::Hold] {
        let mut flight = Flight::engaged();
        flight.mode = mode;
        flight.run(10.0, |scene| scene);
        assert!(flight.requests.is_empty(), "it is never asked for back");
        assert_eq!(flight.said(), ["mode changed"]);
        assert!(!flight.assist.streams());
    }
}

#[test]
fn sticks_that_come_back_soon_are_flown_again() {
    let mut flight = Flight::engaged();
    flight.run(1.0, |scene| AssistScene {
        sticks_age_s: Some(0.9),
        ..scene
    });
    assert_eq!(flight.assist.state(), AssistState::Holds);
    flight.run(1.0, |scene| scene);
    assert_eq!(
        (flight.assist.state(), flight.said().as_slice()),
        (AssistState::On, &["no sticks", ""][..])
    );
    assert!(flight.requests.is_empty());
}

#[test]
fn a_mode_that_px4_takes_up_again_by_itself_is_given_back() {
    let mut flight = Flight::engaged();
    // The stream was lost: PX4 leaves OFFBOARD, and enters it again with the next setpoint.
    flight.mode = NavMode::Position;
    flight.run(0.5, |scene| scene);
    flight.mode = NavMode::Offboard;
    flight.run(1.0, |scene| scene);
    assert_eq!((flight.mode, flight.requests.len()), (NavMode::Position, 1));
    // A mission that is taken over is no such thing.
    let mut flight = Flight::engaged();
    flight.mode = NavMode::Hold;
    flight.run(0.5, |scene| scene);
    flight.mode = NavMode::Offboard;
    flight.run(1.0, |scene| AssistScene {
        is_on_mission: true,
        ..scene
    });
    assert_eq!((flight.mode, flight.requests.len()), (NavMode::Offboard, 0));
}

#[test]
fn a_pilots_mode_that_is_refused_becomes_hold() {
    let mut flight = Flight::engaged();
    flight.obeys = false;
    assert_eq!(flight.assist.choose(false), Ok(()));
    flight.run(0.1, |scene| scene);
    flight.assist.note_refusal();
    flight.run(30.0, |scene| scene);
    assert_eq!(flight.requests[0].1, ModeRequest::Pilots(POSITION));
    assert!(
        flight.requests[1..]
            .iter()
            .all(|(_, request)| *request == ModeRequest::Hold)
    );
    assert!(
        flight.requests.len() > 30 && flight.assist.streams(),
        "it goes on until the autopilot does"
    );
    flight.obeys = true;
    flight.run(1.0, |scene| scene);
    assert_eq!((flight.mode, flight.assist.streams()), (NavMode::Hold, false));
}

#[test]
fn a_gateway_that_is_started_again_goes_on_and_gives_the_mode_back() {
    let mut flight = Flight::new();
    flight
        .assist
        .resume(Timestamp::from_seconds(flight.time_s), POSITION);
    flight.mode = NavMode::Offboard;
    // For a moment it has received neither sticks nor samples of the guard.
    flight.run(0.3, |scene| AssistScene {
        sticks_age_s: None,
        guard: None,
        ..scene
    });
    flight.run(1.0, |scene| scene);
    assert_eq!((flight.assist.state(), flight.texts.len()), (AssistState::On, 0));
    assert_eq!(flight.assist.pilots_mode(), Some(POSITION));
    assert_eq!(flight.assist.choose(false), Ok(()));
    flight.run(1.0, |scene| scene);
    assert_eq!(flight.mode, NavMode::Position);
}

proptest! {
    /// Whatever happens: only modes that lead out are asked for once it was engaged, setpoints go on while the autopilot follows it,
    /// and nothing is asked of an autopilot that a pilot has taken.
    #[test]
    fn whatever_happens_there_is_a_way_out(
        steps in proptest::collection::vec((0..12u8, any::<bool>(), any::<bool>(), any::<bool>(), any::<bool>(), 0..4u8), 1..300),
    ) {
        let mut flight = Flight::engaged();
        for (what, sees, receives, keeps, refuses, mode) in steps {
            match what {
                0 => prop_assert_eq!(flight.assist.choose(false), Ok(())),
                1 => flight.mode = [NavMode::Position, NavMode::Hold, NavMode::Return, NavMode::Offboard][usize::from(mode)],
                2 => flight.obeys = !flight.obeys,
                3 if refuses => flight.assist.note_refusal(),
                _ => {}
            }
            let was_out = flight.mode != NavMode::Offboard;
            let (asked, streamed) = (flight.requests.len(), flight.assist.streams());
            flight.run(0.5, |scene| AssistScene {
                guard: sees.then_some(PreventionState::Acting),
                sticks_age_s: receives.then_some(0.1),
                keeps_distance: keeps,
                ..scene
            });
            if was_out {
                prop_assert_eq!(asked, flight.requests.len(), "he has it");
                prop_assert!(!flight.assist.streams());
            } else if streamed {
                prop_assert!(flight.assist.streams() || flight.mode != NavMode::Offboard, "it fell silent");
            }
            prop_assert!(flight.requests[asked..].iter().all(|(_, request)| *request != ModeRequest::Follow));
        }
    }
}
