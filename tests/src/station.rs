//! What a ground station does in flight, as a column of a campaign.

use jink_emulated_ground_station::{Action, FlightPlan, InFlight, When};
use jink_shared_types::Point;
use jink_shared_types::frames::LocalNed;
use jink_shared_types::vehicle::NavMode;
use serde::{Deserialize, Serialize};

/// North of the start where the station acts (m): at full speed, and before most of what stands in the way.
const ACTS_AT_M: f64 = 8.0;
/// Pause before it wants the mission again (s): longer than a stop takes.
const PAUSE_S: f64 = 8.0;
/// How far aside it sends the vehicle (m).
const ASIDE_M: f64 = 8.0;

/// What it does.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum StationColumn {
    /// Nothing.
    #[default]
    Watches,
    /// Uploads another mission of the same length: through a place aside.
    UploadsSameLength,
    /// Uploads another mission with one more waypoint, aside.
    UploadsLonger,
    /// Clears the mission, and uploads and starts it again.
    Clears,
    /// Chooses the first item again.
    ChoosesItem,
    /// Sends the vehicle aside, and lets the mission go on.
    SendsAside,
    /// Holds, and lets the mission go on.
    Holds,
}

impl StationColumn {
    /// Puts it into `plan`.
    pub fn plan(self, plan: &mut FlightPlan) {
        let Some(goal) = plan.waypoints.last().copied() else {
            return;
        };
        let aside = Point::<LocalNed>::new(goal.x_m / 2.0, goal.y_m + ASIDE_M, goal.z_m);
        let upload = |waypoints: Vec<Point<LocalNed>>| Action::Upload {
            waypoints,
            tail: plan.tail.clone(),
        };
        let mut same_length = plan.waypoints.clone();
        same_length[0] = aside;
        let longer = [aside]
            .into_iter()
            .chain(plan.waypoints.iter().copied())
            .collect();
        let begin = When::North(ACTS_AT_M);
        let again = (When::After(PAUSE_S), Action::Mode(NavMode::Mission));
        let actions = match self {
            Self::Watches => vec![],
            Self::UploadsSameLength => vec![(begin, upload(same_length))],
            Self::UploadsLonger => vec![(begin, upload(longer))],
            Self::Clears => vec![
                (begin, Action::ClearMission),
                (When::After(PAUSE_S), upload(plan.waypoints.clone())),
                (When::After(1.0), Action::Mode(NavMode::Mission)),
            ],
            Self::ChoosesItem => vec![(begin, Action::SetCurrent { item: 0 })],
            Self::SendsAside => vec![(begin, Action::GoTo(aside)), again],
            Self::Holds => vec![(begin, Action::Mode(NavMode::Hold)), again],
        };
        plan.in_flight = actions
            .into_iter()
            .map(|(when, action)| InFlight { when, action })
            .collect();
    }
}
