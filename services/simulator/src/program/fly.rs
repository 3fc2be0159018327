//! `jink-simulator fly`: a ground station that uploads a mission, arms, takes off, flies it and lands.

use crate::service::settings;
use crate::service::udp::MavUdp;
use clap::{Parser, ValueEnum};
use jink_emulated_ground_station::{Ending, FlightPlan, GroundStation, Outcome, Progress};
use jink_shared_types::frames::Point;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use serde_json::json;
use std::net::{Ipv4Addr, SocketAddr};
use std::process::ExitCode;
use std::str::FromStr;
use std::time::Instant;

/// Flies a mission over MAVLink, as a person at a ground station would; one JSON object per change on standard output
///
/// Exit codes: 0 flown and ended as planned; 1 not; 2 wrong arguments; 78 the port is taken.
#[derive(Parser)]
#[command(name = "jink-simulator fly", bin_name = "jink-simulator fly", version)]
struct Arguments {
    /// UDP port on loopback where the autopilot's ground station link arrives
    #[arg(long, default_value_t = 14550)]
    port: u16,
    /// World whose goals are flown to
    #[arg(long, default_value = "forest")]
    world: String,
    /// Seed of the world
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Trees per square metre (forest only)
    #[arg(long)]
    density: Option<f64>,
    /// Waypoints NORTH,EAST[,HEIGHT] in metres instead of the world's goals (repeatable)
    #[arg(long = "waypoint", value_name = "N,E[,H]")]
    waypoints: Vec<Waypoint>,
    /// Fly the way so often: there, back, there
    #[arg(long, default_value_t = 1, value_name = "N", value_parser = clap::value_parser!(u32).range(1..=1000))]
    legs: u32,
    /// Take-off height (m) (default: the world's)
    #[arg(long)]
    height: Option<f64>,
    /// Cruise speed asked for (m/s)
    #[arg(long)]
    speed: Option<f64>,
    /// What to do after the last waypoint
    #[arg(long, value_enum, default_value_t = EndingName::Land)]
    ending: EndingName,
    /// Do not set the mission again when the autopilot leaves it unasked
    #[arg(long)]
    no_resume: bool,
    /// Longest mission (s)
    #[arg(long, default_value_t = 300.0)]
    timeout: f64,
}

#[derive(Clone, Copy, ValueEnum)]
enum EndingName {
    Land,
    Return,
    Hold,
}

#[derive(Clone, Copy)]
struct Waypoint {
    north_m: f64,
    east_m: f64,
    height_m: Option<f64>,
}

impl FromStr for Waypoint {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let numbers: Result<Vec<f64>, _> = text.split(',').map(str::parse).collect();
        match numbers.as_deref() {
            Ok([north_m, east_m]) => Ok(Self {
                north_m: *north_m,
                east_m: *east_m,
                height_m: None,
            }),
            Ok([north_m, east_m, height_m]) => Ok(Self {
                north_m: *north_m,
                east_m: *east_m,
                height_m: Some(*height_m),
            }),
            _ => Err("expected NORTH,EAST or NORTH,EAST,HEIGHT in metres".to_owned()),
        }
    }
}

pub fn run() -> ExitCode {
    let arguments = Arguments::parse_from(std::env::args().skip(1));
    let plan = match plan(&arguments) {
        Ok(plan) => plan,
        Err(error) => {
            eprintln!("jink-simulator fly: {error}");
            return ExitCode::from(2);
        }
    };
    let local = SocketAddr::from((Ipv4Addr::LOCALHOST, arguments.port));
    let mut link = match MavUdp::open(local, None) {
        Ok(link) => link,
        Err(error) => {
            eprintln!("jink-simulator fly: UDP port {}: {error}", arguments.port);
            return ExitCode::from(jink_runtime::service::EXIT_CANNOT_START);
        }
    };
    match fly(plan, &mut link) {
        Outcome::Done => ExitCode::SUCCESS,
        _ => ExitCode::FAILURE,
    }
}

fn plan(arguments: &Arguments) -> Result<FlightPlan, String> {
    let world = settings::build(&arguments.world, arguments.seed, arguments.density)
        .map_err(|error| error.to_string())?;
    let height_m = arguments.height.unwrap_or(world.flight_height_m());
    let there: Vec<_> = if arguments.waypoints.is_empty() {
        world
            .goals()
            .iter()
            .map(|goal| Point::new(goal.x_m, goal.y_m, -height_m))
            .collect()
    } else {
        let place = |w: &Waypoint| Point::new(w.north_m, w.east_m, -w.height_m.unwrap_or(height_m));
        arguments.waypoints.iter().map(place).collect()
    };
    let start = Point::new(0.0, 0.0, -height_m);
    let back = there.iter().rev().skip(1).copied().chain([start]);
    let back: Vec<_> = back.collect();
    let legs = (0..arguments.legs).map(|leg| if leg % 2 == 0 { &there } else { &back });
    Ok(FlightPlan {
        takeoff_height_m: height_m,
        waypoints: legs.flatten().copied().collect(),
        tail: Vec::new(),
        in_flight: Vec::new(),
        cruise_speed_mps: arguments.speed,
        ending: match arguments.ending {
            EndingName::Land => Ending::Land,
            EndingName::Return => Ending::Return,
            EndingName::Hold => Ending::Hold,
        },
        resume: !arguments.no_resume,
        mission_limit_s: arguments.timeout,
    })
}

fn fly(plan: FlightPlan, link: &mut MavUdp) -> Outcome {
    let mut station = GroundStation::new(plan);
    let begin = Instant::now();
    let (mut arrivals, mut inbox, mut outbox) = (Vec::new(), Vec::new(), Vec::new());
    let mut reported = String::new();
    loop {
        inbox.clear();
        outbox.clear();
        link.receive(&mut arrivals);
        inbox.extend(
            arrivals
                .drain(..)
                .map(|arrival| (arrival.header, arrival.message)),
        );
        station.step(begin.elapsed().as_secs_f64(), &inbox, &mut outbox);
        for (header, message) in &outbox {
            link.send(header, message);
        }
        let text = words(station.progress());
        if text != reported {
            println!("{}", line(station.progress(), &text));
            reported = text;
        }
        if let Some(outcome) = station.progress().outcome.clone() {
            return outcome;
        }
        let wait = Timespec {
            tv_sec: 0,
            tv_nsec: 50_000_000,
        };
        let mut fds = [PollFd::from_borrowed_fd(link.fd(), PollFlags::IN)];
        let _interrupted = poll(&mut fds, Some(&wait));
    }
}

/// What a person wants to read; changes only when something has happened.
fn words(progress: &Progress) -> String {
    let mut text = match &progress.outcome {
        None => format!("{}, mode {}", progress.phase.name(), progress.mode),
        Some(Outcome::Done) => "done".to_owned(),
        Some(Outcome::TimedOut {
            phase,
            limit_s,
            reason,
        }) => {
            format!("gave up after {limit_s} s of {}: {reason}", phase.name())
        }
        Some(Outcome::MissionRefused { result }) => {
            format!("the autopilot refused the mission (MAV_MISSION_RESULT {result})")
        }
    };
    if progress.reached > 0 {
        text += &format!(", {} of {} waypoints", progress.reached, progress.waypoints);
    }
    if !progress.said.is_empty() && progress.outcome.is_none() {
        text += &format!(" (autopilot: {})", progress.said);
    }
    text
}

fn line(progress: &Progress, text: &str) -> serde_json::Value {
    json!({
        "text": text,
        "phase": progress.phase.name(),
        "mode": progress.mode.to_string(),
        "waypoints_reached": progress.reached,
        "waypoints": progress.waypoints,
        "to_goal_m": if progress.to_goal_m.is_finite() { json!(progress.to_goal_m) } else { json!(null) },
        "left_mission": progress.fell_out,
        "done": progress.outcome == Some(Outcome::Done),
    })
}

#[cfg(test)]
mod tests {
    use super::{Arguments, plan};
    use clap::Parser;

    #[test]
    fn the_second_leg_leads_back_and_the_third_there_again() {
        let line = [
            "fly",
            "--height",
            "2",
            "--waypoint",
            "10,1",
            "--waypoint",
            "20,2",
            "--legs",
        ];
        let places = |legs: &str| {
            let arguments = Arguments::try_parse_from(line.into_iter().chain([legs]))
                .ok()
                .unwrap();
            let plan = plan(&arguments).unwrap();
            plan.waypoints
                .iter()
                .map(|place| (place.x_m, place.y_m, place.z_m))
                .collect::<Vec<_>>()
        };
        let there = [(10.0, 1.0, -2.0), (20.0, 2.0, -2.0)];
        let back = [(10.0, 1.0, -2.0), (0.0, 0.0, -2.0)];
        assert_eq!(places("1"), there);
        assert_eq!(places("3"), [there, back, there].concat());
    }
}
