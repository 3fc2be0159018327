//! A pilot who is assisted: pushed into trees, and every way out.

use crate::flight::{Flight, Trouble};
use crate::record::Record;
use jink_emulated_ground_station::Make;
use jink_shared_types::vehicle::NavMode;

type Done = Result<(), Trouble>;

/// The sticks are sent this often (s).
const PERIOD_S: f64 = 0.05;
/// CP_DIST of these flights (m).
const DISTANCE_M: f64 = 1.5;
/// What of it may be lost (m): as in the lock-step flights.
const LOST_M: f64 = 0.3;
/// Where the stick points, from the nose (rad), for five seconds each.
const TURNS_RAD: [f64; 8] = [0.0, 0.0, 0.8, -0.8, 0.0, 1.2, -1.2, 0.3];
/// Let go of.
const CENTRED: [f64; 4] = [0.0; 4];

/// Flies by hand for so long (s).
fn steer(flight: &Flight, seconds: f64, sticks: impl Fn(f64) -> [f64; 4]) -> Done {
    let steps = (seconds / PERIOD_S).round() as u32;
    for step in 0..steps {
        flight.station.steer(Some(sticks(PERIOD_S * f64::from(step))));
        flight.watch(PERIOD_S)?;
    }
    Ok(())
}

/// The same until something has happened, at most for so long (s).
fn steer_until(
    flight: &Flight,
    what: &str,
    limit_s: f64,
    sticks: [f64; 4],
    condition: impl Fn(&Record) -> bool,
) -> Done {
    for _ in 0..(limit_s / PERIOD_S) as u32 {
        flight.station.steer(Some(sticks));
        flight.watch(PERIOD_S)?;
        if condition(&flight.record.lock()) {
            return Ok(());
        }
    }
    Err(Trouble::Never {
        what: what.to_owned(),
        limit_s,
    })
}

fn has_reported(words: &'static str, since_s: f64) -> impl Fn(&Record) -> bool {
    move |record| {
        let mut texts = record.texts.iter();
        texts.any(|text| text.is_jinks && text.at_s >= since_s && text.text.contains(words))
    }
}

fn now_s(flight: &Flight) -> f64 {
    flight.record.lock().now_s()
}

/// Takes off and flies by hand in Position mode.
fn by_hand(flight: &mut Flight) -> Done {
    flight.take_off()?;
    steer(flight, 1.0, |_| CENTRED)?;
    flight.mode(NavMode::Position)?;
    flight.mark();
    steer(flight, 3.0, |_| CENTRED)
}

fn choose(flight: &Flight, on: bool) -> Done {
    let since_s = now_s(flight);
    flight.station.choose_assist(on);
    let (words, mode) = match on {
        true => ("assisted flight on", NavMode::Offboard),
        false => ("assisted flight off", NavMode::Position),
    };
    steer_until(flight, words, 5.0, CENTRED, has_reported(words, since_s))?;
    steer_until(flight, name(mode), 3.0, CENTRED, |record| {
        record.mode().mode == mode
    })
}

/// For the text of a failure.
fn name(mode: NavMode) -> &'static str {
    match mode {
        NavMode::Offboard => "mode that follows setpoints",
        NavMode::Position => "pilot's mode",
        _ => "mode that holds",
    }
}

/// The vehicle has kept its distance since then.
fn kept(flight: &Flight, since_s: f64) -> Done {
    let record = flight.record.lock();
    let nearest_m = record
        .truth
        .iter()
        .filter(|truth| truth.at_s >= since_s)
        .map(|truth| truth.clearance_m)
        .fold(f64::INFINITY, f64::min);
    let way_m = record
        .last()
        .map_or(0.0, |truth| truth.place.x_m.hypot(truth.place.y_m));
    println!("assisted: nearest {nearest_m:.2} m, {way_m:.1} m away");
    if nearest_m > DISTANCE_M - LOST_M {
        return Ok(());
    }
    Err(Trouble::Refused {
        what: "distance".to_owned(),
        answer: format!("{nearest_m:.2} m"),
    })
}

fn in_mode(flight: &Flight, mode: NavMode) -> Done {
    steer_until(flight, name(mode), 4.0, CENTRED, |record| {
        record.mode().mode == mode
    })
}

/// Full stick for 40 s, to all sides; released, the place is held; switched off, the pilot flies on by himself.
pub fn into_trees(flight: &mut Flight) -> Done {
    by_hand(flight)?;
    choose(flight, true)?;
    let since_s = now_s(flight);
    steer(flight, 40.0, |t| {
        // Into the forest, and to its trees on both sides.
        let turn: f64 = TURNS_RAD[(t / 5.0) as usize % TURNS_RAD.len()];
        [turn.cos(), turn.sin(), 0.0, 0.0]
    })?;
    kept(flight, since_s)?;
    steer_until(flight, "rest", 10.0, CENTRED, |record| record.rests(3.0, 0.3))?;
    choose(flight, false)?;
    steer(flight, 3.0, |_| CENTRED)?;
    in_mode(flight, NavMode::Position)
}

/// The pilot changes the mode himself: it is never asked for back.
pub fn mode_changed(flight: &mut Flight) -> Done {
    by_hand(flight)?;
    for mode in [NavMode::Hold, NavMode::Position] {
        choose(flight, true)?;
        steer(flight, 2.0, |_| [-0.4, 0.0, 0.0, 0.0])?;
        let since_s = now_s(flight);
        flight.mode(mode)?;
        steer_until(
            flight,
            "off: mode changed",
            3.0,
            CENTRED,
            has_reported("off: mode changed", since_s),
        )?;
        steer(flight, 5.0, |_| CENTRED)?;
        in_mode(flight, mode)?;
        flight.mode(NavMode::Position)?;
        flight.station.choose_assist(false);
        steer(flight, 2.0, |_| CENTRED)?;
    }
    Ok(())
}

/// The gateway is killed while the sticks are pushed at trees: it goes on assisting.
pub fn gateway_killed(flight: &mut Flight) -> Done {
    by_hand(flight)?;
    choose(flight, true)?;
    let since_s = now_s(flight);
    for _ in 0..2 {
        steer(flight, 4.0, |_| [1.0, 0.0, 0.0, 0.0])?;
        flight.jink.kill("mavlink_gateway");
        steer(flight, 4.0, |_| [0.7, 0.7, 0.0, 0.0])?;
        in_mode(flight, NavMode::Offboard)?;
        steer(flight, 4.0, |_| [-0.5, 0.0, 0.0, 0.0])?;
    }
    flight.jink.kill("collision_guard");
    steer(flight, 4.0, |_| [1.0, 0.0, 0.0, 0.0])?;
    in_mode(flight, NavMode::Offboard)?;
    kept(flight, since_s)?;
    choose(flight, false)
}

/// The remote control falls silent in motion: PX4 holds by itself, ArduCopter returns (FS_THR_ENABLE), and neither is asked for
/// anything else.
pub fn sticks_lost(flight: &mut Flight) -> Done {
    by_hand(flight)?;
    choose(flight, true)?;
    steer(flight, 3.0, |_| [-0.5, 0.0, 0.0, 0.0])?;
    if flight.make() == Make::ArduCopter {
        // The simulated receiver loses its signal, too; overrides count for three more seconds.
        flight.station.set_parameter("SIM_RC_FAIL", 1.0);
    }
    let since_s = now_s(flight);
    flight.station.steer(None);
    let mode = match flight.make() {
        Make::Px4 => NavMode::Hold,
        Make::ArduCopter => NavMode::Return,
    };
    flight.wait_mode(mode, 10.0)?;
    flight.wait("text", 3.0, has_reported("assisted flight off", since_s))?;
    flight.watch(4.0)?;
    flight.wait_mode(mode, 0.5)
}
