//! A path that another program proposes, and the planner's answer.
//!
//! A [`Proposal`] is never flown as it comes. The planner takes it as the guide of its next plan, and certifies that
//! plan by the same rules as one of its own; what cannot be certified is not flown, and [`ProposalAnswer`] says why and
//! where.

use crate::clock::Timestamp;
use crate::coded::Coded;
use crate::frames::{LocalNed, Point};
use crate::reserved::Reserved;

/// Most waypoints of a proposal.
pub const PROPOSAL_WAYPOINTS: usize = 32;
/// A coordinate is not larger than this (m): farther from the local origin a position in single precision, as
/// autopilots send it, is coarser than 0.1 m.
const COORDINATE_MAX_M: f64 = 1e6;
/// A requested speed is not larger than this (m/s): faster multicopters are not planned for.
const SPEED_MAX_MPS: f64 = 100.0;

crate::sample! {
    /// A path to the goal that another program proposes to the planner. It is published periodically while it is valid.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Proposal: 848 {
        /// The producer's own count of its proposals, from 1: one that is repeated keeps its id, another path has
        /// another id.
        pub id: u64,
        /// The goal that the path is for: the position of the desired path's waypoint (`points[1]`).
        pub goal: Point<LocalNed>,
        /// Requested speed along the path (m/s); 0 = the planner's own. It never raises a limit.
        pub speed_mps: f64,
        /// Waypoints in use, at least one.
        pub len: u32,
        /// Explicit padding, zero.
        pub reserved: Reserved<4>,
        /// The waypoints in the order in which they are flown, joined by straight legs. The planner joins the path at
        /// its point nearest to the vehicle.
        pub waypoints: [Point<LocalNed>; PROPOSAL_WAYPOINTS],
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<32>,
    }
    plausible if Self::is_consistent
}

impl Proposal {
    /// The waypoints in use.
    pub fn waypoints(&self) -> &[Point<LocalNed>] {
        &self.waypoints[..(self.len as usize).min(PROPOSAL_WAYPOINTS)]
    }

    /// Whether its count of waypoints is valid, one at least, and all its numbers are plausible.
    pub fn is_consistent(&self) -> bool {
        let is_place = |point: &Point<LocalNed>| {
            let within = |x: f64| (-COORDINATE_MAX_M..=COORDINATE_MAX_M).contains(&x);
            within(point.x_m) && within(point.y_m) && within(point.z_m)
        };
        (1..=PROPOSAL_WAYPOINTS).contains(&(self.len as usize))
            && (0.0..=SPEED_MAX_MPS).contains(&self.speed_mps)
            && is_place(&self.goal)
            && self.waypoints().iter().all(is_place)
    }
}

crate::wire_enum! {
    /// The planner's verdict on a proposal.
    pub enum ProposalVerdict {
        /// It is not flown, for a reason that this build does not know.
        Refused = 0 "refused",
        /// It is flown: all of it that lies within one route is certified.
        Accepted = 1 "accepted",
        /// It is flown up to `place`; what lies behind that is not known to be free yet.
        Shortened = 2 "shortened",
        /// Nothing is planned at the moment: another mode, no ranges, no valid position, or the goal is reached.
        NotPlanning = 3 "not_planning",
        /// It is for another goal than the one flown to.
        OtherGoal = 4 "other_goal",
        /// It has no waypoints, more than fit into the sample, or implausible numbers.
        Implausible = 5 "implausible",
        /// The vehicle is too far from its nearest point.
        TooFar = 6 "too_far",
        /// It leads through an obstacle.
        Occupied = 7 "occupied",
        /// It passes an obstacle closer than the slowest motion needs.
        TooNarrow = 8 "too_narrow",
        /// It leads into space that is not known to be free.
        Unknown = 9 "unknown",
        /// It leaves the heights allowed (OA_ALT_MIN, OA_ALT_MAX).
        HeightNotAllowed = 10 "height_not_allowed",
        /// It is certified, but no curve along it keeps the limits, or the guard let none pass.
        Infeasible = 11 "infeasible",
        /// Flying along proposals has not brought the goal nearer; the planner uses its own path.
        NoProgress = 12 "no_progress",
        /// The vehicle is at its end, and that is not the goal.
        Ended = 13 "ended",
        /// There is an obstacle on the committed trajectory, or the vehicle is in a narrow place: the planner leaves it
        /// by its own path first.
        Evading = 14 "evading",
    }
}

crate::sample! {
    /// The planner's answer to a proposal, published when it changes.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct ProposalAnswer: 104 {
        /// The proposal.
        pub proposal_id: u64,
        /// When the proposal was published, by its header: distinguishes producers that count alike.
        pub proposed: Timestamp,
        /// The first route that was made of it; 0 = none.
        pub route_id: u64,
        /// Where it fails; NaN if at no place.
        pub place: Point<LocalNed>,
        /// Length of the certified path, from where the route departs (m).
        pub certified_m: f64,
        /// Highest speed of the route (m/s).
        pub speed_mps: f64,
        /// Index of the waypoint that ends the leg on which it fails; the number of waypoints for the leg to the goal,
        /// or if it fails on no leg.
        pub waypoint: u32,
        /// The verdict.
        pub verdict: Coded<ProposalVerdict>,
        /// Explicit padding, zero.
        pub reserved: Reserved<3>,
        /// Room for later fields, zero.
        pub reserved_tail: Reserved<32>,
    }
    plausible if Self::is_consistent
}

impl Default for ProposalAnswer {
    fn default() -> Self {
        Self {
            proposal_id: 0,
            proposed: Timestamp::NEVER,
            route_id: 0,
            place: Point::UNSET,
            certified_m: 0.0,
            speed_mps: 0.0,
            waypoint: 0,
            verdict: Coded::new(ProposalVerdict::Refused),
            reserved: Reserved::ZERO,
            reserved_tail: Reserved::ZERO,
        }
    }
}

impl ProposalAnswer {
    /// Whether its numbers are finite; the place may be missing.
    pub fn is_consistent(&self) -> bool {
        let place_is_one = self.place.vector().iter().all(|x| !x.is_infinite());
        place_is_one
            && (0.0..f64::INFINITY).contains(&self.certified_m)
            && (0.0..f64::INFINITY).contains(&self.speed_mps)
    }
}

impl ProposalVerdict {
    /// Whether a route is made of the proposal.
    pub fn is_flown(self) -> bool {
        matches!(self, Self::Accepted | Self::Shortened)
    }
}

#[cfg(test)]
mod tests {
    use super::{PROPOSAL_WAYPOINTS, Proposal, ProposalAnswer};
    use crate::frames::Point;
    use crate::layout::Layout;

    #[test]
    fn a_proposal_of_numbers_that_make_no_sense_is_implausible() {
        let good = Proposal {
            len: 2,
            ..Proposal::default()
        };
        assert!(good.is_plausible());
        assert!(!Proposal { len: 0, ..good }.is_plausible(), "no way");
        let too_many = PROPOSAL_WAYPOINTS as u32 + 1;
        assert!(
            !Proposal {
                len: too_many,
                ..good
            }
            .is_plausible()
        );
        for speed_mps in [-1.0, f64::NAN, f64::INFINITY, 1e9] {
            assert!(!Proposal { speed_mps, ..good }.is_plausible(), "{speed_mps}");
        }
        for x in [f64::NAN, f64::NEG_INFINITY, 1e300] {
            let mut bad = good;
            bad.waypoints[1].x_m = x;
            assert!(!bad.is_plausible(), "{x}");
            bad.len = 1;
            assert!(
                bad.is_plausible(),
                "a waypoint that is not in use may be anything"
            );
            bad.goal = Point::new(0.0, x, 0.0);
            assert!(!bad.is_plausible(), "{x}");
        }
        assert!(ProposalAnswer::default().is_plausible());
    }
}
