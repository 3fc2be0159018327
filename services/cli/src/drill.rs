//! Fault drills of a flight: what is done to which process when, as written on the command line or drawn by lot.

use jink_shared_types::suggestion::{DidYouMean, nearest};
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
        let at_s = time.strip_suffix('s').unwrap_or(time).parse().ok();
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

#[cfg(test)]
mod tests {
    use super::Drill;

    #[test]
    fn short_and_full_names_are_understood() {
        for (text, process, at_s) in [
            ("planner@8s", "planner", 8.0),
            ("fusion@2.5s", "obstacle_fusion", 2.5),
            ("mavlink_gateway@0", "mavlink_gateway", 0.0),
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
            "planner@soon",
            "planner@NaNs",
        ] {
            let message = bad.parse::<Drill>().unwrap_err().to_string();
            assert!(message.contains("e.g. "), "{message}");
        }
    }
}
