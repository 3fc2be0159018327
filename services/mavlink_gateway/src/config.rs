//! What the gateway is given at its start.

use crate::blockage::Remedy;
use crate::profile::{self, Profile};
use jink_mavlink_link::message::{COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER};
use jink_mavlink_link::profile_name::{ProfileName, Representation};
use jink_mavlink_link::router::LinkSet;
use jink_shared_types::params::{GW_HORIZON, GW_RATE, ParamSet};

/// A curve lasts at least this many periods of the stream: one lost setpoint and one late one must not let it expire.
const PERIODS_PER_CURVE: f64 = 3.0;
/// And at least this long (s): below, a curve no longer covers a short hiccup of the link.
const SHORTEST_CURVE_S: f64 = crate::profile::curve::SHORTEST_S;

/// Identity, profile and rates.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GatewayConfig {
    /// Our component id; PX4 counts only 196 as obstacle avoidance.
    pub component_id: u8,
    /// A second component that sends the on-board computer's own heartbeat. PX4 1.9 to 1.15 checks the loss of the
    /// avoidance only while some on-board controller is not lost: with 196 as the only one, its silence goes
    /// unnoticed.
    pub computer_component_id: Option<u8>,
    /// The vehicle's system id; `None` = the only autopilot seen.
    pub system_id: Option<u8>,
    /// Links on which no autopilot is looked for, whoever says there that it is one.
    pub ground_station_links: LinkSet,
    /// How setpoints are sent; until one is chosen it means nothing where the gateway chooses it.
    pub profile: ProfileName,
    /// The profile is chosen by what the autopilot is.
    pub chooses_profile: bool,
    /// An earlier gateway of this run has found that `profile` fits the autopilot.
    pub is_proven: bool,
    /// Missions that the autopilot flies are taken over from it, where it only follows setpoints.
    pub takes_missions: bool,
    /// What is done about a mission item that cannot be reached.
    pub blocked_remedy: Remedy,
    /// The autopilot's link carries more than a telemetry radio's.
    pub has_fast_link: bool,
    /// In which message, where the profile leaves the choice.
    pub representation: Representation,
    /// Rate of the setpoint stream (Hz). A new trajectory does not wait for the beat, so up to twice as many may go out.
    pub setpoint_rate_hz: f64,
    /// Duration of each curve (s).
    pub horizon_s: f64,
}

impl Default for GatewayConfig {
    fn default() -> Self {
        Self::from_params(&ParamSet::default(), ProfileName::Px4Trajectory)
    }
}

impl GatewayConfig {
    /// Rates from the parameters, customary identities.
    pub fn from_params(params: &ParamSet, profile: ProfileName) -> Self {
        Self {
            component_id: COMPONENT_AVOIDANCE,
            computer_component_id: Some(COMPONENT_ONBOARD_COMPUTER),
            system_id: None,
            ground_station_links: LinkSet::default(),
            profile,
            chooses_profile: false,
            is_proven: false,
            takes_missions: true,
            blocked_remedy: Remedy::from_params(params),
            has_fast_link: false,
            representation: Representation::default(),
            setpoint_rate_hz: profile.rate_hz(params.get(&GW_RATE)),
            horizon_s: params.get(&GW_HORIZON),
        }
    }

    /// Whether setpoints are messages without an addressee.
    pub(crate) fn sends_curves(&self) -> bool {
        self.profile == ProfileName::Px4Trajectory && self.representation == Representation::Bezier
    }

    /// The profile itself.
    pub(crate) fn build_profile(&self) -> Box<dyn Profile> {
        profile::build(
            self.profile,
            self.representation,
            self.longest_curve_s(),
            self.shortest_curve_s(),
        )
    }

    /// The shortest a curve may be made (s).
    pub fn shortest_curve_s(&self) -> f64 {
        (PERIODS_PER_CURVE / self.setpoint_rate_hz).max(SHORTEST_CURVE_S)
    }

    /// How long curves last (s): the horizon, but never shorter than [`Self::shortest_curve_s`].
    pub fn longest_curve_s(&self) -> f64 {
        self.horizon_s.max(self.shortest_curve_s())
    }
}
