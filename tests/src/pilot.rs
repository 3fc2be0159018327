//! A pilot who flies by hand, in PX4's Position mode: in lock-step ([`by_hand`]), or beside running programs ([`Tablet`]).
// A harness for tests: without its thread and port there is nothing to test.
#![allow(clippy::expect_used)]

use crate::lockstep::LockStep;
use crate::pairing::PX4_DEVIATION;
use jink_emulated_ground_station::{FlightPlan, GroundStation, Make, Phase};
use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::message::{Body, Content};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MANUAL_CONTROL_DATA, MavMessage, MavParamType, PARAM_SET_DATA};
use std::net::{SocketAddr, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Between two messages of the sticks (s).
const STICKS_PERIOD_S: f64 = 0.05;
/// Between two requests of the pilot that have not been met (s).
const REPEAT_S: f64 = 0.5;

/// Sticks at `[forward, right]`, of 1000 each.
pub fn sticks([x, y]: [i16; 2]) -> MavMessage {
    MavMessage::MANUAL_CONTROL(MANUAL_CONTROL_DATA {
        x,
        y,
        z: 500,
        target: 1,
        ..MANUAL_CONTROL_DATA::default()
    })
}

/// Flies the mission until it is under way, then by hand for so long: `stick` says where to, of 1000, at a time since then (s). The
/// smallest clearance on the way (m).
///
/// # Panics
/// If the mission ends before it is under way.
pub fn by_hand(
    flight: &mut LockStep,
    seconds: f64,
    mut stick: impl FnMut(&mut LockStep, f64) -> [i16; 2],
) -> f64 {
    let (mut from_s, mut next_s, mut nearest_m) = (None, 0.0, f64::INFINITY);
    loop {
        flight.step();
        let truth = *flight.truth();
        let was_under_way = from_s.is_some() || truth.mode == NavMode::Mission;
        if flight.station().progress().phase != Phase::Mission || !was_under_way {
            assert_eq!(flight.outcome(), None, "it never was under way");
            continue;
        }
        let time_s = truth.time_s - *from_s.get_or_insert(truth.time_s);
        if time_s >= seconds {
            return nearest_m;
        }
        if truth.time_s >= next_s {
            next_s = truth.time_s + STICKS_PERIOD_S;
            // What jink has asked for stays.
            if !matches!(truth.mode.get(), NavMode::Position | NavMode::Hold) {
                PX4_DEVIATION.command_mode(flight, NavMode::Position);
            }
            let place = stick(flight, time_s);
            flight.send(sticks(place));
        }
        nearest_m = nearest_m.min(truth.clearance_m);
    }
}

/// A ground station with sticks, in real time: it flies a plan until the pilot takes over. It ends with this.
#[derive(Debug)]
pub struct Tablet {
    end: Arc<AtomicBool>,
    sticks: Arc<Mutex<Option<[i16; 2]>>>,
    thread: Option<JoinHandle<()>>,
}

impl Tablet {
    /// Listens on `socket`, to which the autopilot sends, sets its integer `parameter` and flies `plan`.
    ///
    /// # Panics
    /// If the socket cannot be read without waiting.
    pub fn begin(socket: UdpSocket, parameter: (&'static str, i32), plan: FlightPlan) -> Self {
        socket
            .set_read_timeout(Some(Duration::from_millis(5)))
            .expect("a socket with a time limit");
        let (end, sticks) = (Arc::new(AtomicBool::new(false)), Arc::new(Mutex::new(None)));
        let mut hand = Hand {
            socket,
            autopilot: None,
            encoder: Encoder::new(),
            splitter: Splitter::new(),
            station: GroundStation::new(plan),
            parameter,
            sticks: Arc::clone(&sticks),
            parameter_due_s: 0.0,
            mode_due_s: 0.0,
            sticks_due_s: 0.0,
        };
        let theirs = Arc::clone(&end);
        let thread = std::thread::spawn(move || {
            let begin = Instant::now();
            while !theirs.load(Ordering::Relaxed) {
                hand.step(begin.elapsed().as_secs_f64());
            }
        });
        Self {
            end,
            sticks,
            thread: Some(thread),
        }
    }

    /// The pilot flies in Position mode from now on, with the sticks at `[forward, right]`, of 1000 each.
    pub fn steer(&self, place: [i16; 2]) {
        *self.sticks.lock().unwrap_or_else(PoisonError::into_inner) = Some(place);
    }
}

impl Drop for Tablet {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            // A panic in there has been printed.
            let _reported = thread.join();
        }
    }
}

struct Hand {
    socket: UdpSocket,
    autopilot: Option<SocketAddr>,
    encoder: Encoder,
    splitter: Splitter,
    station: GroundStation,
    parameter: (&'static str, i32),
    sticks: Arc<Mutex<Option<[i16; 2]>>>,
    parameter_due_s: f64,
    mode_due_s: f64,
    sticks_due_s: f64,
}

impl Hand {
    fn step(&mut self, now_s: f64) {
        let (mut inbox, mut outbox) = (Vec::new(), Vec::new());
        let mut datagram = [0; 2048];
        // One at a time: they come often enough.
        if let Ok((length, from)) = self.socket.recv_from(&mut datagram) {
            self.autopilot = Some(from);
            self.splitter.load_datagram(&datagram[..length]);
            while let Some(frame) = self.splitter.next_frame() {
                if let Some(Content::Message(message)) = Content::of(&frame) {
                    inbox.push((frame.header, message));
                }
            }
        }
        self.station.step(now_s, &inbox, &mut outbox);
        let mut messages: Vec<MavMessage> = outbox.into_iter().map(|(_, message)| message).collect();
        if now_s >= self.parameter_due_s && self.station.progress().phase != Phase::Mission {
            self.parameter_due_s = now_s + REPEAT_S;
            messages.push(set(self.parameter));
        }
        let sticks_at = *self.sticks.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(place) = sticks_at.filter(|_| now_s >= self.sticks_due_s) {
            self.sticks_due_s = now_s + STICKS_PERIOD_S;
            messages.push(sticks(place));
            if now_s >= self.mode_due_s && self.station.progress().mode == NavMode::Mission {
                self.mode_due_s = now_s + REPEAT_S;
                messages.extend(Make::Px4.mode_command(NavMode::Position, 1));
            }
        }
        for message in messages {
            let frame = self.encoder.encode(255, 190, &Body::Message(message));
            if let Some(autopilot) = self.autopilot {
                let _lost = self.socket.send_to(frame, autopilot);
            }
        }
    }
}

fn set((name, value): (&str, i32)) -> MavMessage {
    MavMessage::PARAM_SET(PARAM_SET_DATA {
        param_id: name.into(),
        param_value: f32::from_bits(value.cast_unsigned()),
        param_type: MavParamType::MAV_PARAM_TYPE_INT32,
        target_system: 1,
        target_component: 1,
    })
}
