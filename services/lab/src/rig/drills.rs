//! Carries out the faults that were asked for and sees what becomes of them.

use crate::drill::{Drill, Fault, SUPERVISOR, Since};
use crate::flight_log::FaultRecord;
use crate::handover::{Seam, SeamFigures};
use jink_control::figures::round;
use jink_control::meter::Meter;
use jink_control::request;
use jink_control::watch::PROGRAM;
use jink_runtime::members::Members;
use jink_runtime::request::Request;
use jink_runtime::{Instance, Session};
use jink_shared_types::health::{ProcessStatus, ServiceState, SystemStatus};
use jink_shared_types::topics::TABLE;
use jink_shared_types::truth::SimTruth;
use jink_shared_types::{Coded, Timestamp, params};
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use rustix::process::{Pid, PidfdFlags, Signal, pidfd_open, pidfd_send_signal};
use std::net::UdpSocket;
use std::os::fd::OwnedFd;
use std::sync::mpsc::{Receiver, channel};

/// How long a slowed process stays slow (s).
const SLOW_S: f64 = 2.0;
/// Of every so many looks, a slowed process is stopped for all but the last two: 60 of 100 ms.
const SLOW_LOOKS: u64 = 5;
/// From the end of a fault on, this long is still put down to it (s).
const AFTERMATH_S: f64 = 1.5;
/// A fault whose end nobody sees is given up after this long (s).
const PATIENCE_S: f64 = 20.0;
/// The process that publishes for all simulated sensors.
const SENSORS: &str = "sensors";
/// The process that talks to the autopilot.
const GATEWAY: &str = "mavlink_gateway";
/// Garbage datagrams, and their size (bytes).
const GARBAGE: [usize; 2] = [2_000, 700];

/// What a drill can see of the flight.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// Time since the start of the mission (s).
    pub mission_time_s: Option<f64>,
    /// Time since the motors were armed (s).
    pub armed_time_s: Option<f64>,
    /// Where the vehicle is.
    pub truth: &'a SimTruth,
    /// The processes.
    pub status: &'a SystemStatus,
    /// Largest time without a setpoint since the last look (s).
    pub gap_s: f64,
}

/// The last answer to a request for a swap.
#[derive(Debug)]
struct SwapAnswer {
    good: bool,
    text: String,
}

/// A fault that was made.
#[derive(Debug)]
struct Open {
    record: FaultRecord,
    /// The process before.
    before: ProcessStatus,
    /// When it was done.
    begin: Timestamp,
    /// Simulated time of its begin, and of its end if that was seen (s).
    begin_s: f64,
    end_s: Option<f64>,
    collisions: u32,
    holds: u32,
    setpoints: u64,
    sequence_breaks: u64,
    /// Of a slow process: its handle.
    slowed: Option<OwnedFd>,
    /// Of a swap: its last answer.
    swap: Option<Receiver<SwapAnswer>>,
    /// Of a swap: what is seen on the topics of the process.
    seams: Vec<(Meter, Seam)>,
}

/// Faults still to come, under way and done.
#[derive(Debug)]
pub struct Drills {
    planned: Vec<Drill>,
    open: Vec<Open>,
    done: Vec<FaultRecord>,
    looks: u64,
    instance: Instance,
    link_port: u16,
    /// Opened for the first swap.
    session: Option<Session>,
}

impl Drills {
    /// For the flight of `instance`, whose gateway listens on UDP port `link_port`.
    pub fn new(planned: Vec<Drill>, instance: Instance, link_port: u16) -> Self {
        Self {
            planned,
            open: Vec::new(),
            done: Vec::new(),
            looks: 0,
            instance,
            link_port,
            session: None,
        }
    }

    /// Makes what is due and notices what has ended; answers what to report of it.
    pub fn step(&mut self, view: &View<'_>) -> Vec<String> {
        let mut update = Vec::new();
        let is_due = |drill: &Drill| {
            let time_s = match drill.since {
                Since::Mission => view.mission_time_s,
                Since::Armed => view.armed_time_s,
            };
            time_s.is_some_and(|time_s| drill.at_s <= time_s)
        };
        let (due, planned): (Vec<_>, Vec<_>) =
            std::mem::take(&mut self.planned).into_iter().partition(is_due);
        self.planned = planned;
        for drill in due {
            update.push(self.begin(&drill, view));
        }
        self.looks += 1;
        let open = std::mem::take(&mut self.open);
        for mut one in open {
            one.look(self.looks, view);
            if one.is_over(view) {
                update.push(one.record.line());
                self.done.push(one.record);
            } else {
                self.open.push(one);
            }
        }
        update
    }

    /// Listens to all topics of a process; to none if shared memory cannot be reached.
    fn seams_of(&mut self, process: &str) -> Vec<(Meter, Seam)> {
        if self.session.is_none() {
            self.session = Session::open(&self.instance, PROGRAM).ok();
        }
        let Some(session) = &self.session else {
            return Vec::new();
        };
        let members = Members::of_instance(&self.instance);
        let mut seams = Vec::new();
        for row in TABLE {
            let single = [String::new()];
            let names = match row.is_family() {
                true if process == SENSORS && row.producers.contains(&"simulator") => members.of(row),
                false if row.may_publish(process) && !row.producers.contains(&"*") => &single[..],
                _ => continue,
            };
            for member in names {
                if let Ok(meter) = Meter::open(session, row, member) {
                    let seam = Seam::new(&meter.name, *row);
                    seams.push((meter, seam));
                }
            }
        }
        seams
    }

    /// Everything that was done.
    pub fn into_records(self) -> Vec<FaultRecord> {
        let mut records = self.done;
        // A swap takes seconds: one that the end of the flight has cut short says nothing.
        let judged = |open: &Open| open.record.fault != Fault::Swap || open.end_s.is_some();
        records.extend(self.open.into_iter().filter(judged).map(|open| open.record));
        records.sort_by(|a, b| a.at_s.total_cmp(&b.at_s));
        records
    }

    fn begin(&mut self, drill: &Drill, view: &View<'_>) -> String {
        let Some(process) = find(view.status, &drill.process).filter(|process| process.pid != 0) else {
            return format!("{} does not run: spared", drill.process);
        };
        let process = &process;
        let Some(handle) = handle_of(process.pid) else {
            return format!("{} has just gone: spared", drill.process);
        };
        let (mut slowed, mut swap, mut seams) = (None, None, Vec::new());
        let begin = jink_runtime::now();
        let made = match drill.fault {
            Fault::Kill => pidfd_send_signal(&handle, Signal::KILL).is_ok(),
            Fault::Stop => pidfd_send_signal(&handle, Signal::STOP).is_ok(),
            Fault::Slow => {
                slowed = Some(handle);
                true
            }
            Fault::Swap => {
                seams = self.seams_of(&drill.process);
                swap = Some(begin_swap(&self.instance, &drill.process));
                true
            }
            Fault::Garbage => send_garbage(self.link_port),
        };
        if !made {
            return format!("{} of {} could not be made", drill.fault, drill.process);
        }
        let at_s = view.mission_time_s.unwrap_or(0.0);
        self.open.push(Open {
            record: FaultRecord {
                fault: drill.fault,
                process: drill.process.clone(),
                at_s: round(at_s),
                phase: view.truth.mode.get().to_string(),
                survived: false,
                detection_ms: None,
                recovery_ms: None,
                gap_ms: 0.0,
                collisions: 0,
                holds: 0,
                north_m: round(view.truth.position.x_m),
                east_m: round(view.truth.position.y_m),
                seams: Vec::new(),
                reason: None,
            },
            before: *process,
            begin,
            begin_s: view.truth.time_s,
            end_s: None,
            collisions: view.truth.collisions,
            holds: view.truth.hold_count,
            setpoints: view.truth.setpoints,
            sequence_breaks: view.truth.sequence_breaks,
            slowed,
            swap,
            seams,
        });
        format!(
            "{} of {} (process id {}) at {at_s:.1} s",
            drill.fault, drill.process, process.pid
        )
    }
}

impl Open {
    fn look(&mut self, looks: u64, view: &View<'_>) {
        let time_s = view.truth.time_s;
        self.record.gap_ms = round((view.gap_s * 1e3).max(self.record.gap_ms));
        self.record.collisions = view.truth.collisions - self.collisions;
        self.record.holds = view.truth.hold_count.saturating_sub(self.holds);
        if self.end_s.is_some() {
            return;
        }
        for (meter, seam) in &mut self.seams {
            meter.look(|header| seam.take(header));
        }
        let now = find(view.status, &self.record.process);
        let replaced = now.is_some_and(|now| now.pid != self.before.pid || now.state == ServiceState::Dead);
        let works = now.is_some_and(|now| {
            if self.record.process == SUPERVISOR {
                return now.pid != self.before.pid;
            }
            // Not that it was back after a fault before this one.
            now.restarts > self.before.restarts
                && now.recovery_us > 0
                && now.back >= self.begin
                && matches!(now.state.get(), ServiceState::Active | ServiceState::Standby)
        });
        let over = match self.record.fault {
            Fault::Kill | Fault::Stop => {
                if self.record.fault == Fault::Stop && replaced && self.record.detection_ms.is_none() {
                    self.record.detection_ms = Some(round((time_s - self.begin_s) * 1e3));
                }
                self.record.survived = works;
                let recovery_ms = |now: ProcessStatus| match (now.recovery_us, self.record.fault) {
                    // Nobody measures it: as far as looking fifty times a second can show.
                    (0, _) => round((time_s - self.begin_s) * 1e3),
                    (_, Fault::Kill) => round(now.back.seconds_since(self.begin) * 1e3),
                    (us, _) => f64::from(us) * 1e-3,
                };
                self.record.recovery_ms = now.filter(|_| works).map(recovery_ms);
                works
            }
            Fault::Slow => {
                let over = time_s - self.begin_s >= SLOW_S;
                if let Some(handle) = &self.slowed {
                    let runs = over || looks % SLOW_LOOKS >= SLOW_LOOKS - 2;
                    let signal = if runs { Signal::CONT } else { Signal::STOP };
                    let _replaced_meanwhile = pidfd_send_signal(handle, signal);
                }
                self.record.survived = over;
                over
            }
            Fault::Swap => match self.swap.as_ref().and_then(|answer| answer.try_recv().ok()) {
                Some(SwapAnswer { good, text }) => {
                    self.record.survived = good;
                    self.record.reason = (!good).then_some(text);
                    self.record.seams = self.seams.iter().filter_map(|(_, seam)| seam.figures()).collect();
                    self.seams.clear();
                    if good && self.record.process == GATEWAY {
                        self.record.seams.push(self.wire_seam(view.truth));
                    }
                    true
                }
                None => false,
            },
            Fault::Garbage => {
                self.record.survived = now.is_some_and(|now| now.pid == self.before.pid);
                true
            }
        };
        if over || time_s - self.begin_s > PATIENCE_S {
            self.end_s = Some(time_s);
        }
    }

    /// What the autopilot saw of a swap of the gateway; periods are those of the stream's default rate.
    fn wire_seam(&self, truth: &SimTruth) -> SeamFigures {
        SeamFigures {
            topic: "MAVLink".to_owned(),
            samples: (truth.setpoints - self.setpoints) as usize,
            changes: 1,
            missing: (truth.sequence_breaks - self.sequence_breaks) as usize,
            doubled: 0,
            reordered: 0,
            gap_periods: round(self.record.gap_ms * 1e-3 * params::GW_RATE.default),
        }
    }

    fn is_over(&self, view: &View<'_>) -> bool {
        self.end_s
            .is_some_and(|end_s| view.truth.time_s - end_s >= AFTERMATH_S)
    }
}

/// The process called `name`; the supervisor counts as one.
fn find(status: &SystemStatus, name: &str) -> Option<ProcessStatus> {
    if name == SUPERVISOR {
        return Some(ProcessStatus {
            pid: status.pid,
            state: Coded::new(ServiceState::Active),
            ..ProcessStatus::default()
        });
    }
    let mut processes = status.processes().iter();
    processes
        .find(|process| process.heartbeat.name.as_str() == name)
        .copied()
}

fn handle_of(pid: u32) -> Option<OwnedFd> {
    let pid = i32::try_from(pid).ok().and_then(Pid::from_raw)?;
    pidfd_open(pid, PidfdFlags::empty()).ok()
}

/// A swap of `process` for its own program, in a thread: it takes seconds.
fn begin_swap(instance: &Instance, process: &str) -> Receiver<SwapAnswer> {
    let (sender, receiver) = channel();
    let socket = instance.request_socket();
    let request = Request::Swap {
        process: process.to_owned(),
        program: None,
        cycles: Some(20),
        dry_run: false,
    };
    std::thread::spawn(move || {
        let mut last = SwapAnswer {
            good: false,
            text: "no answer".to_owned(),
        };
        let asked = request::put(&socket, &request, |answer| {
            last = SwapAnswer {
                good: answer.good,
                text: answer.text.clone(),
            };
        });
        if let Err(problem) = asked {
            last = SwapAnswer {
                good: false,
                text: problem.to_string(),
            };
        }
        // The flight may be over.
        let _nobody_waits = sender.send(last);
    });
    receiver
}

fn send_garbage(port: u16) -> bool {
    let Ok(socket) = UdpSocket::bind(("127.0.0.1", 0)) else {
        return false;
    };
    let [datagrams, bytes] = GARBAGE;
    let mut random = Xoshiro256PlusPlus::seed_from_u64(1);
    let mut datagram = vec![0u8; bytes];
    for _ in 0..datagrams {
        random.fill_bytes(&mut datagram);
        // What the kernel drops was garbage, too.
        let _dropped = socket.send_to(&datagram, ("127.0.0.1", port));
    }
    true
}
