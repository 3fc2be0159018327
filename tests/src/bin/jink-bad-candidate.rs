//! Planners that no supervisor should let fly: what they do wrong is the name they are started by. For tests of swaps.

use jink_runtime::{Cycle, ExclusiveOwnership, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::link::LinkStatus;
use jink_shared_types::map::LocalMap;
use jink_shared_types::motion::Route;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::process::ExitCode;
use std::time::Duration;

/// What is wrong with it.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Vice {
    /// Ends in the middle of its probation.
    Crashes,
    /// Needs several times its budget.
    TooSlow,
    /// Puts out what no consumer can use.
    Garbled,
    /// Puts out nothing.
    Mute,
    /// Never reaches its loop.
    NeverUp,
    /// Was built against another layout of its topic.
    OtherLayout,
    /// Is fine until it owns, then it ends.
    FailsAsOwner,
    /// Is fine until it owns, then it hangs.
    HangsAsOwner,
    /// Is fine until it owns, then it puts out nothing.
    MuteAsOwner,
}

const VICES: [(&str, Vice); 9] = [
    ("crashes", Vice::Crashes),
    ("too_slow", Vice::TooSlow),
    ("garbled", Vice::Garbled),
    ("mute", Vice::Mute),
    ("never_up", Vice::NeverUp),
    ("other_layout", Vice::OtherLayout),
    ("fails_as_owner", Vice::FailsAsOwner),
    ("hangs_as_owner", Vice::HangsAsOwner),
    ("mute_as_owner", Vice::MuteAsOwner),
];

/// Cycles before it crashes.
const GOOD_CYCLES: u32 = 20;

struct BadPlanner {
    vice: Vice,
    cycles: u32,
    map: Input<LocalMap>,
    output: Output<Route>,
    exclusive_ownership: ExclusiveOwnership,
}

fn vice() -> Option<Vice> {
    let program = std::env::args_os().next()?;
    let name = std::path::Path::new(&program).file_name()?.to_str()?.to_owned();
    VICES
        .iter()
        .find(|(known, _)| *known == name)
        .map(|(_, vice)| *vice)
}

impl Service for BadPlanner {
    const PROGRAM: &'static str = "planner";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let vice = vice().ok_or_else(|| StartError::Needs {
            what: "the name it is started by".to_owned(),
            cause: format!("one of {}", VICES.map(|(name, _)| name).join(", ")),
        })?;
        if vice == Vice::NeverUp {
            std::thread::sleep(Duration::from_secs(3600));
        }
        if vice == Vice::OtherLayout {
            ports.output(topics::ROUTE.with_payload::<LinkStatus>())?;
        }
        Ok(Self {
            vice,
            cycles: 0,
            map: ports.trigger(topics::LOCAL_MAP)?.needed(),
            output: ports.output(topics::ROUTE)?,
            exclusive_ownership: ports.exclusive_ownership(),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        self.map.latest(cycle.now);
        self.cycles += 1;
        let owns = self.exclusive_ownership.is_due(cycle.now);
        self.exclusive_ownership.declare(owns);
        match self.vice {
            Vice::Crashes if self.cycles > GOOD_CYCLES => std::process::abort(),
            Vice::FailsAsOwner if owns => std::process::abort(),
            Vice::HangsAsOwner if owns => loop {
                std::hint::spin_loop();
            },
            Vice::TooSlow => spin_until(cycle.now.plus_seconds(0.06)),
            _ => {}
        }
        let header = SampleHeader::at(cycle.now).derived(Stage::Planner, cycle.now);
        let mut route = Route::default();
        if self.vice == Vice::Garbled {
            route.guide_len = u32::MAX;
        }
        let is_mute = self.vice == Vice::Mute || self.vice == Vice::MuteAsOwner && owns;
        if !is_mute {
            self.output.send(header, &route);
        }
        Wake::at(cycle.now.plus_seconds(1.0 / 30.0))
    }
}

fn spin_until(end: Timestamp) {
    while jink_runtime::now() < end {
        std::hint::spin_loop();
    }
}

fn main() -> ExitCode {
    jink_runtime::run::<BadPlanner>()
}
