//! Flies a real autopilot in simulation without jink: take-off, a square, landing. Shows how well vehicle and instruments suit its
//! gains: where it really was, how it held its height, how fast the simulation ran.
//!
//!     cargo run --release -p jink-simulator --example sitl_flight -- DIR [hil|sih|json] [NORTH,EAST wind in m/s]

use jink_emulated_ground_station::{Ending, FlightPlan, GroundStation, Outcome};
use jink_shared_types::Point;
use jink_simulator::sitl::{Interface, Sitl, SitlBuild, SitlOptions};
use mavlink::dialect::MavMessage;
use mavlink::{MavHeader, MavlinkReader};
use std::error::Error;
use std::net::{SocketAddr, UdpSocket};
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Height of the flight (m).
const HEIGHT_M: f64 = 5.0;
/// Side of the square (m).
const SIDE_M: f64 = 15.0;

fn main() -> Result<(), Box<dyn Error>> {
    let mut arguments = std::env::args().skip(1);
    let folder = PathBuf::from(arguments.next().ok_or("give the folder of a build")?);
    let build = SitlBuild::find(&folder)?;
    println!("{} {}", build.program.display(), build.version);
    let companion = UdpSocket::bind("127.0.0.1:0")?;
    let station = UdpSocket::bind("127.0.0.1:0")?;
    station.set_nonblocking(true)?;
    let work = std::env::temp_dir().join(format!("sitl_flight_{}", std::process::id()));
    let mut options = SitlOptions::new(build, companion.local_addr()?, work.clone());
    options.ground_station = Some(station.local_addr()?);
    options.interface = arguments.next().and_then(|name| Interface::named(&name));
    if let Some(wind) = arguments.next() {
        let (north, east) = wind.split_once(',').ok_or("wind: NORTH,EAST")?;
        options.wind.mean_mps = [north.parse()?, east.parse()?, 0.0];
    }
    let mut sitl = Sitl::start(options)?;
    println!(
        "interface {}, instance {}, log {}",
        sitl.interface().name(),
        sitl.ports().instance,
        sitl.log().display()
    );
    let outcome = fly(&mut sitl, &station);
    let log = sitl.log().to_owned();
    sitl.stop();
    match outcome {
        Ok(outcome) => {
            println!("{outcome:?}");
            std::fs::remove_dir_all(&work)?;
            Ok(())
        }
        Err(reason) => Err(format!("{reason}; {}", log.display()).into()),
    }
}

fn fly(sitl: &mut Sitl, socket: &UdpSocket) -> Result<Outcome, Box<dyn Error>> {
    let corner = |north: f64, east: f64| Point::new(north * SIDE_M, east * SIDE_M, -HEIGHT_M);
    let mut station = GroundStation::new(FlightPlan {
        takeoff_height_m: HEIGHT_M,
        waypoints: vec![
            corner(1.0, 0.0),
            corner(1.0, 1.0),
            corner(0.0, 1.0),
            corner(0.0, 0.0),
        ],
        tail: Vec::new(),
        in_flight: Vec::new(),
        cruise_speed_mps: None,
        ending: Ending::Land,
        resume: true,
        mission_limit_s: 120.0,
    });
    let (begin, mut peer) = (Instant::now(), None);
    let mut buffer = vec![0; 65_536];
    let (mut inbox, mut outbox) = (Vec::new(), Vec::new());
    let (mut reported, mut said) = (0.0, String::new());
    loop {
        if let Some(reason) = sitl.ended() {
            return Err(reason.into());
        }
        let samples = sitl.wait(Duration::from_millis(20));
        if let Some(newest) = samples.back()
            && newest.time_s >= reported + 1.0
        {
            reported = newest.time_s;
            let (p, v) = (newest.truth.position, newest.truth.velocity.vector());
            println!(
                "{:6.1} s ({:6.1} s real, {:3.0} ms late) {:8} north {:6.2} east {:6.2} up {:5.2} m, {:4.1} m/s, {} {}/{}",
                newest.time_s,
                begin.elapsed().as_secs_f64(),
                newest.late_s * 1e3,
                newest.autopilot.mode.to_string(),
                p.x_m,
                p.y_m,
                -p.z_m,
                v.norm(),
                if newest.autopilot.armed {
                    "armed"
                } else {
                    "disarmed"
                },
                newest.autopilot.mission.current,
                newest.autopilot.mission.total,
            );
        }
        inbox.clear();
        outbox.clear();
        while let Ok((length, from)) = socket.recv_from(&mut buffer) {
            peer = Some(from);
            let mut reader = MavlinkReader::new(buffer.get(..length).unwrap_or_default());
            while let Ok(message) = reader.read_any_message::<MavMessage>() {
                inbox.push(message);
            }
        }
        station.step(begin.elapsed().as_secs_f64(), &inbox, &mut outbox);
        send(socket, peer, &outbox)?;
        let progress = station.progress();
        let update = format!("{:?} {} ({})", progress.phase, progress.mode, progress.said);
        if update != said {
            println!("{:13.1} s station: {update}", begin.elapsed().as_secs_f64());
            said = update;
        }
        if let Some(outcome) = &progress.outcome {
            return Ok(outcome.clone());
        }
    }
}

fn send(
    socket: &UdpSocket,
    peer: Option<SocketAddr>,
    outbox: &[(MavHeader, MavMessage)],
) -> Result<(), Box<dyn Error>> {
    let Some(peer) = peer else { return Ok(()) };
    for (header, message) in outbox {
        let mut bytes = Vec::new();
        mavlink::write_v2_msg(&mut bytes, *header, message)?;
        socket.send_to(&bytes, peer)?;
    }
    Ok(())
}
