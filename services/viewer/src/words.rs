//! What flies now, why, and what is waited for: in the words of `jink status`, of the samples' own names, and of the event table.

use jink_control::known_space::KnownSpace;
use jink_control::narrate::health_line;
use jink_control::speed_limit::{Cause, SpeedLimit, flies};
use jink_control::status::unfit;
use jink_shared_types::Timestamp;
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::link::{AssistState, LinkStatus};
use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Route, RouteMode, Verdict};
use jink_shared_types::vehicle::VehicleState;
use serde::Serialize;

/// How grave a line is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Weight {
    /// As it should be.
    Good,
    /// Worth to know.
    Note,
    /// Something is missing.
    Warning,
}

/// A line: what it is about, and what there is to say.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct Line {
    /// A word.
    pub about: &'static str,
    /// A sentence.
    pub text: String,
    /// How grave it is.
    pub weight: Weight,
}

/// What there is to speak of. What is stale or was never there is `None`.
#[derive(Clone, Copy, Debug, Default)]
pub struct Facts<'a> {
    /// Every process.
    pub status: Option<&'a SystemStatus>,
    /// The link.
    pub link: Option<&'a LinkStatus>,
    /// The vehicle.
    pub vehicle: Option<&'a VehicleState>,
    /// What is planned.
    pub route: Option<&'a Route>,
    /// What the planner has wanted in the last second or so, where that says more than that nothing is new.
    pub wanted: Option<RouteMode>,
    /// What is approved.
    pub approved: Option<&'a ApprovedTrajectory>,
    /// What it flies through.
    pub space: Option<&'a KnownSpace>,
    /// When it is said.
    pub now: Timestamp,
}

impl Facts<'_> {
    /// The lines, the most important first.
    pub fn lines(&self) -> Vec<Line> {
        let lines = [
            self.system(),
            self.link(),
            self.space(),
            self.mode(),
            self.plan(),
            self.speed(),
            self.guard(),
        ];
        lines.into_iter().flatten().collect()
    }

    fn system(&self) -> Option<Line> {
        let Some(status) = self.status else {
            return warning("system", "the supervisor gives no status".to_owned());
        };
        line(
            "system",
            health_line(status),
            match status.health.get() {
                Health::Healthy => Weight::Good,
                _ => Weight::Warning,
            },
        )
    }

    fn link(&self) -> Option<Line> {
        let Some(link) = self.link else {
            return warning("link", "the gateway has said nothing yet".to_owned());
        };
        let waited = link.links.iter().find(|one| one.is_waited_for.is_set());
        if let Some(one) = waited {
            return warning("link", format!("waiting for {}", one.name.as_str()));
        }
        if !link.autopilot_alive.is_set() {
            return warning("link", "the autopilot is not connected".to_owned());
        }
        if let Some([is, remedy]) = unfit(link) {
            return warning("link", format!("NOT READY: {is}; {remedy}"));
        }
        None
    }

    fn space(&self) -> Option<Line> {
        let refusal = self.space?.refusal()?;
        warning("space", refusal)
    }

    fn mode(&self) -> Option<Line> {
        let Some(vehicle) = self.vehicle else {
            return warning("mode", "the vehicle's state is missing".to_owned());
        };
        let mut text = if vehicle.mode_pending.is_set() {
            "not reported yet".to_owned()
        } else {
            vehicle.mode.get().to_string()
        };
        text += match (vehicle.armed.is_set(), vehicle.landed.is_set()) {
            (true, true) => ", armed, on the ground",
            (true, false) => ", armed, in the air",
            (false, true) => ", disarmed, on the ground",
            (false, false) => ", disarmed",
        };
        if let Some(link) = self.link.filter(|link| link.assist != AssistState::Off) {
            text += &format!(", assisted flight {}", link.assist.get());
        }
        line("mode", text, Weight::Good)
    }

    fn plan(&self) -> Option<Line> {
        let Some(route) = self.route else {
            return warning(
                "plan",
                "the planner is silent: what is approved is flown to its end, at rest".to_owned(),
            );
        };
        let mode = self.wanted.unwrap_or(route.mode.get());
        let (text, weight) = match mode {
            RouteMode::Keep if self.approved.is_some_and(|approved| flies(approved, self.now)) => {
                ("nothing new, the committed trajectory is flown", Weight::Good)
            }
            RouteMode::Keep => ("nothing new is wanted", Weight::Good),
            RouteMode::Plan if route.target_is_goal.is_set() => {
                ("a new motion through the corridor, to the goal", Weight::Good)
            }
            RouteMode::Plan => (
                "a new motion through the corridor, a step toward the goal",
                Weight::Good,
            ),
            RouteMode::Stop => (
                "a stop: the committed trajectory has lost its certificate or its purpose",
                Weight::Note,
            ),
            RouteMode::Mirror => ("the autopilot's own setpoint is sent back", Weight::Note),
            RouteMode::Turn => ("it turns where it rests, to see in that direction", Weight::Note),
        };
        line("plan", format!("{mode}: {text}"), weight)
    }

    /// What limits the speed now.
    fn speed(&self) -> Option<Line> {
        let limit = SpeedLimit::of(self.route?, self.approved?, self.now)?;
        let weight = match limit.cause {
            Cause::Allowed | Cause::KnownSpace | Cause::Goal => Weight::Good,
            Cause::Room | Cause::Ends | Cause::Stop => Weight::Note,
            Cause::Brake => Weight::Warning,
        };
        line("speed", limit.text(), weight)
    }

    fn guard(&self) -> Option<Line> {
        let Some(approved) = self.approved else {
            return warning("guard", "the guard is silent".to_owned());
        };
        let because = match approved.reason.get() {
            GuardReason::None => String::new(),
            reason => format!(" ({})", reason.to_string().replace('_', " ")),
        };
        let way = match approved.free_way_m {
            way_m if way_m.is_finite() => {
                format!("{way_m:.1} m of free way, {:.1} m to stop", approved.stopping_m)
            }
            _ => "nothing in the way".to_owned(),
        };
        let (text, weight) = match approved.verdict.get() {
            Verdict::Hold => (format!("hold: nothing is approved{because}"), Weight::Note),
            Verdict::Passed => (format!("passed; {way}"), Weight::Good),
            Verdict::Kept => (
                format!("kept: the new trajectory was refused{because}, the one before continues; {way}"),
                Weight::Note,
            ),
            Verdict::Braked => (format!("braked{because}; {way}"), Weight::Warning),
        };
        line("guard", text, weight)
    }
}

fn line(about: &'static str, text: String, weight: Weight) -> Option<Line> {
    Some(Line { about, text, weight })
}

fn warning(about: &'static str, text: String) -> Option<Line> {
    line(about, text, Weight::Warning)
}

#[cfg(test)]
mod tests {
    use super::{Facts, Weight};
    use jink_shared_types::coded::Coded;
    use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Verdict};

    fn text_of(facts: &Facts<'_>, about: &str) -> Option<String> {
        let lines = facts.lines();
        lines
            .into_iter()
            .find(|line| line.about == about)
            .map(|line| line.text)
    }

    #[test]
    fn what_is_missing_is_named() {
        let lines = Facts::default().lines();
        assert!(lines.iter().all(|line| line.weight == Weight::Warning));
        let about: Vec<&str> = lines.iter().map(|line| line.about).collect();
        assert_eq!(about, ["system", "link", "mode", "plan", "guard"]);
    }

    #[test]
    fn a_refusal_comes_with_its_reason() {
        let mut approved = ApprovedTrajectory {
            free_way_m: f64::INFINITY,
            ..ApprovedTrajectory::default()
        };
        approved.verdict = Coded::new(Verdict::Kept);
        approved.reason = Coded::new(GuardReason::WrongBase);
        let facts = Facts {
            approved: Some(&approved),
            ..Facts::default()
        };
        assert!(text_of(&facts, "guard").unwrap().contains("refused (wrong base)"));
    }
}
