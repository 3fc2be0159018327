//! Fault drills of a flight: what is done to which process when, as written on the command line or drawn by lot.

use jink_shared_types::suggestion::{DidYouMean, nearest};
use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use serde::Serialize;
use std::fmt;
use std::str::FromStr;

/// Short names for processes of the table.
const SHORT_NAMES: [(&str, &str); 5] = [
    ("fusion", "obstacle_fusion"),
    ("bezier", "bezier_generator"),
    ("guard", "collision_guard"),
    ("gateway", "mavlink_gateway"),
    ("sensor", "sensors"),
];

/// The supervisor as a victim.
pub const SUPERVISOR: &str = "supervisor";

/// What is done to a process.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Fault {
    /// SIGKILL.
    Kill,
    /// SIGSTOP: it hangs.
    Stop,
    /// It is stopped for most of every tenth of a second, for two seconds: late, but never silent.
    Slow,
    /// It is swapped for a fresh instance of its own program.
    Swap,
    /// Bytes that are no MAVLink on the link, thousands of them.
    Garbage,
}

impl Fault {
    /// All of them with their names.
    pub const NAMES: [(&'static str, Self); 5] = [
        ("kill", Self::Kill),
        ("stop", Self::Stop),
        ("slow", Self::Slow),
        ("swap", Self::Swap),
        ("garbage", Self::Garbage),
    ];
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = Self::NAMES.iter().find(|(_, fault)| fault == self);
        f.write_str(name.map_or("", |(name, _)| name))
    }
}

impl FromStr for Fault {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let known = Self::NAMES.iter().find(|(name, _)| *name == text);
        known.map(|(_, fault)| *fault).ok_or_else(|| {
            let names = Self::NAMES.map(|(name, _)| name);
            format!("no fault is called {text:?}; choose of {}", names.join(", "))
        })
    }
}

/// From when a drill's time counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Since {
    /// From the start of the mission.
    Mission,
    /// From the moment the motors are armed: take-off included.
    Armed,
}

/// One fault to be.
#[derive(Clone, Debug, PartialEq)]
pub struct Drill {
    /// What is done.
    pub fault: Fault,
    /// To whom: a name of the process table.
    pub process: String,
    /// When (s).
    pub at_s: f64,
    /// From when that counts.
    pub since: Since,
}

/// Why a drill cannot be understood.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum KillError {
    /// It is not `NAME@TIMEs`.
    Form {
        /// What was written.
        text: String,
    },
    /// The time is no number of seconds after the start.
    Time {
        /// What was written after the `@`.
        text: String,
    },
}

impl fmt::Display for KillError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Form { text } => write!(f, "{text:?}: write NAME@TIMEs, e.g. planner@8s"),
            Self::Time { text } => write!(
                f,
                "{text:?} is no time after the start of the mission, e.g. 8s or 2.5s"
            ),
        }
    }
}
impl std::error::Error for KillError {}

impl Drill {
    /// Whether each of `kills` is that of a process in `names`.
    ///
    /// # Errors
    /// The sentence to say about the first that is not.
    pub fn check(kills: &[Self], names: &[String]) -> Result<(), String> {
        let Some(kill) = kills.iter().find(|kill| !names.contains(&kill.process)) else {
            return Ok(());
        };
        let near = nearest(&kill.process, names.iter().map(String::as_str));
        Err(format!(
            "--kill: there is no process {:?}{}; there are {}",
            kill.process,
            DidYouMean(near),
            names.join(", ")
        ))
    }
}

impl FromStr for Drill {
    type Err = KillError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let form = || KillError::Form {
            text: text.to_owned(),
        };
        let (name, time) = text.split_once('@').ok_or_else(form)?;
        if name.is_empty() {
            return Err(form());
        }
        let at_s = time.strip_suffix('s').and_then(|number| number.parse().ok());
        let at_s = at_s.filter(|at_s: &f64| at_s.is_finite() && *at_s >= 0.0);
        let short = SHORT_NAMES.iter().find(|(short, _)| *short == name);
        Ok(Self {
            fault: Fault::Kill,
            since: Since::Mission,
            process: short.map_or(name, |(_, full)| full).to_owned(),
            at_s: at_s.ok_or_else(|| KillError::Time {
                text: time.to_owned(),
            })?,
        })
    }
}

/// Faults are made between these times after arming (s): take-off, mission and landing of a demonstration.
const WINDOW_S: [f64; 2] = [1.0, 36.0];
/// Two faults are at least so far apart (s) unless set otherwise: each is to be seen alone.
pub const APART_S: f64 = 3.5;
/// A process is left alone for this long after a fault (s), where there are others: a swap takes some seconds.
const SPARED_S: f64 = 10.0;

/// Numbers by lot, the same for the same seed (splitmix64: Steele, Lea, Flood 2014).
#[derive(Clone, Debug)]
pub struct Lot {
    generator: SplitMix64,
}

impl Lot {
    /// The lot of flight `flight` in the campaign `seed`.
    pub fn new(seed: u64, flight: u64) -> Self {
        let seed = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) ^ flight.wrapping_mul(0xd1b5_4a32_d192_ed03);
        Self {
            generator: SplitMix64::seed_from_u64(seed),
        }
    }

    fn bits(&mut self) -> u64 {
        self.generator.next_u64()
    }

    /// One of `items`.
    pub fn choose<'a, T>(&mut self, items: &'a [T]) -> Option<&'a T> {
        items.get((self.bits() % items.len().max(1) as u64) as usize)
    }

    fn share(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// The faults of one flight: kinds of `faults` to processes of `processes`, `apart_s` to twice that from each other, as
/// many as fit.
pub fn drawn(seed: u64, flight: u64, faults: &[Fault], processes: &[String], apart_s: f64) -> Vec<Drill> {
    let mut lot = Lot::new(seed, flight);
    let mut drills: Vec<Drill> = Vec::new();
    let mut at_s = WINDOW_S[0] + apart_s * lot.share();
    while at_s < WINDOW_S[1] {
        let spared = |process: &&String| {
            let mut recent = drills.iter().filter(|drill| at_s - drill.at_s < SPARED_S);
            recent.any(|drill| drill.process == **process)
        };
        let rested: Vec<String> = processes.iter().filter(|one| !spared(one)).cloned().collect();
        let from = if rested.is_empty() { processes } else { &rested };
        if let (Some(fault), Some(process)) = (lot.choose(faults), lot.choose(from)) {
            drills.push(Drill {
                fault: *fault,
                process: process.clone(),
                at_s,
                since: Since::Armed,
            });
        }
        at_s += apart_s * (1.0 + lot.share());
    }
    drills
}

#[cfg(test)]
mod tests {
    use super::{APART_S, Drill, Fault, WINDOW_S, drawn};

    #[test]
    fn a_seed_draws_the_same_faults_and_another_one_others() {
        let names = ["planner", "sensors"].map(str::to_owned);
        let draw = |seed: u64| drawn(seed, 3, &[Fault::Kill, Fault::Stop], &names, APART_S);
        assert_eq!(draw(7), draw(7));
        assert_ne!(draw(7), draw(8));
        let times: Vec<f64> = draw(7).iter().map(|drill| drill.at_s).collect();
        assert!(times.len() >= 4, "{times:?}");
        assert!(times.windows(2).all(|pair| pair[1] - pair[0] >= APART_S));
        assert!(times.iter().all(|at_s| (WINDOW_S[0]..WINDOW_S[1]).contains(at_s)));
    }

    #[test]
    fn short_and_full_names_are_understood() {
        for (text, process, at_s) in [
            ("planner@8s", "planner", 8.0),
            ("fusion@2.5s", "obstacle_fusion", 2.5),
            ("mavlink_gateway@0s", "mavlink_gateway", 0.0),
            ("sensor@1s", "sensors", 1.0),
        ] {
            let kill: Drill = text.parse().unwrap();
            assert_eq!((kill.process.as_str(), kill.at_s), (process, at_s));
        }
    }

    #[test]
    fn only_processes_of_the_table_can_be_killed() {
        let names = ["planner", "sensors"].map(str::to_owned);
        let check = |text: &str| Drill::check(&[text.parse().unwrap()], &names);
        assert_eq!(check("sensor@1s"), Ok(()));
        let error = check("planer@1s").unwrap_err();
        let said = "there is no process \"planer\"; did you mean `planner`?; there are planner, sensors";
        assert!(error.ends_with(said), "{error}");
    }

    #[test]
    fn nonsense_is_refused_with_an_example() {
        for bad in [
            "planner",
            "@8s",
            "planner@",
            "planner@-1s",
            "planner@8",
            "planner@soon",
            "planner@NaNs",
        ] {
            let message = bad.parse::<Drill>().unwrap_err().to_string();
            assert!(message.contains("e.g. "), "{message}");
        }
    }
}
