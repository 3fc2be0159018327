//! Fault drills of a demonstration: which process to kill when, as written on the command line.

use jink_shared_types::params::nearest;
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

/// One process to be killed.
#[derive(Clone, Debug, PartialEq)]
pub struct Kill {
    /// Its name in the process table.
    pub process: String,
    /// When, after the start of the mission (s).
    pub at_s: f64,
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

impl Kill {
    /// Whether each of `kills` is that of a process in `names`.
    ///
    /// # Errors
    /// The sentence to say about the first that is not.
    pub fn check(kills: &[Self], names: &[String]) -> Result<(), String> {
        let Some(kill) = kills.iter().find(|kill| !names.contains(&kill.process)) else {
            return Ok(());
        };
        let near = nearest(&kill.process, names.iter().map(String::as_str)).unwrap_or("");
        Err(format!(
            "--kill: there is no process {:?}; did you mean {near:?}? There are {}",
            kill.process,
            names.join(", ")
        ))
    }
}

impl FromStr for Kill {
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
            process: short.map_or(name, |(_, full)| full).to_owned(),
            at_s: at_s.ok_or_else(|| KillError::Time {
                text: time.to_owned(),
            })?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Kill;

    #[test]
    fn short_and_full_names_are_understood() {
        for (text, process, at_s) in [
            ("planner@8s", "planner", 8.0),
            ("fusion@2.5s", "obstacle_fusion", 2.5),
            ("mavlink_gateway@0", "mavlink_gateway", 0.0),
            ("sensor@1s", "sensors", 1.0),
        ] {
            let kill: Kill = text.parse().unwrap();
            assert_eq!((kill.process.as_str(), kill.at_s), (process, at_s));
        }
    }

    #[test]
    fn only_processes_of_the_table_can_be_killed() {
        let names = ["planner", "sensors"].map(str::to_owned);
        let check = |text: &str| Kill::check(&[text.parse().unwrap()], &names);
        assert_eq!(check("sensor@1s"), Ok(()));
        let error = check("planer@1s").unwrap_err();
        let said = "there is no process \"planer\"; did you mean \"planner\"? There are planner, sensors";
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
            let message = bad.parse::<Kill>().unwrap_err().to_string();
            assert!(message.contains("e.g. "), "{message}");
        }
    }
}
