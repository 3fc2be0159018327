//! What flies now, why, and what is waited for: in the words of `jink status`, of the samples' own names, and of the event table.

use jink_control::known_space::KnownSpace;
use jink_control::narrate::health_line;
use jink_control::planned_speed::PlannedSpeed;
use jink_control::status::unfit;
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::link::{AssistState, LinkStatus};
use jink_shared_types::motion::{ApprovedTrajectory, GuardReason, Route, RouteMode, TrajectoryMode, Verdict};
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
    /// Time from now to the end of what is approved (s).
    pub ends_in_s: f64,
}

/// A difference of speeds that nobody sees (m/s).
const SPEED_SLACK_MPS: f64 = 0.06;
/// Trajectories whose braking begins within this time are about to stop (s).
const SOON_S: f64 = 1.0;

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
            RouteMode::Keep if self.flies() => {
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

    /// Whether a planned motion is approved that has not ended.
    fn flies(&self) -> bool {
        self.approved.is_some_and(|approved| {
            approved.verdict != Verdict::Hold && approved.trajectory.mode != TrajectoryMode::Mirror
        }) && self.ends_in_s > 0.0
    }

    /// What limits the speed now.
    fn speed(&self) -> Option<Line> {
        let route = self.route?;
        let approved = self.approved.filter(|_| self.flies())?;
        let PlannedSpeed {
            reached_mps,
            allowed_mps,
            ..
        } = PlannedSpeed::of(route)?;
        let limit_mps = approved.trajectory.limits.speed_mps;
        let (text, weight) = match approved.trajectory.mode.get() {
            TrajectoryMode::Stop => ("a certified stop is flown".to_owned(), Weight::Note),
            TrajectoryMode::Brake => ("maximum braking, certificate lost".to_owned(), Weight::Warning),
            _ if self.ends_in_s < SOON_S => (
                format!(
                    "it comes to rest in {:.1} s unless a new plan is certified",
                    self.ends_in_s.max(0.0)
                ),
                Weight::Note,
            ),
            _ if limit_mps < reached_mps - SPEED_SLACK_MPS => (
                format!(
                    "limited to {limit_mps:.1} m/s by the room here; plans reach {reached_mps:.1} of {allowed_mps:.1} m/s"
                ),
                Weight::Note,
            ),
            _ if reached_mps < allowed_mps - SPEED_SLACK_MPS => (
                format!(
                    "limited by the way to rest in known space: plans reach {reached_mps:.1} of {allowed_mps:.1} m/s"
                ),
                Weight::Good,
            ),
            _ => (
                format!("limited by what is allowed: {allowed_mps:.1} m/s"),
                Weight::Good,
            ),
        };
        line("speed", text, weight)
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
    use jink_shared_types::motion::{
        ApprovedTrajectory, GuardReason, Route, RouteMode, TrajectoryMode, Verdict,
    };
    use jink_shared_types::tracking::Tracking;

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
    fn the_tightest_limit_of_the_speed_is_the_one_that_is_said() {
        let route = Route {
            mode: Coded::new(RouteMode::Keep),
            tracking: Tracking::PX4_OFFBOARD,
            reached_mps: 2.5,
            allowed_mps: 3.0,
            ..Route::default()
        };
        let mut approved = ApprovedTrajectory {
            verdict: Coded::new(Verdict::Passed),
            free_way_m: f64::INFINITY,
            ..ApprovedTrajectory::default()
        };
        approved.trajectory.mode = Coded::new(TrajectoryMode::Plan);
        approved.trajectory.limits.speed_mps = 1.0;
        let speed = |approved: &ApprovedTrajectory, ends_in_s: f64| {
            let facts = Facts {
                route: Some(&route),
                approved: Some(approved),
                ends_in_s,
                ..Facts::default()
            };
            text_of(&facts, "speed")
        };
        assert!(
            speed(&approved, 4.0)
                .unwrap()
                .contains("1.0 m/s by the room here")
        );
        assert!(speed(&approved, 0.4).unwrap().contains("comes to rest in 0.4 s"));
        assert_eq!(speed(&approved, -1.0), None, "it rests");
        approved.trajectory.limits.speed_mps = 3.0;
        assert!(
            speed(&approved, 4.0)
                .unwrap()
                .contains("plans reach 2.5 of 3.0 m/s")
        );
        approved.verdict = Coded::new(Verdict::Kept);
        approved.reason = Coded::new(GuardReason::WrongBase);
        let facts = Facts {
            approved: Some(&approved),
            ..Facts::default()
        };
        assert!(text_of(&facts, "guard").unwrap().contains("refused (wrong base)"));
    }
}
