//! The mission is given back to the autopilot, and whether it has taken it at the right item.
//!
//! | seen | done |
//! |---|---|
//! | at rest where the rest is the autopilot's | the mission is read anew first: it may have been changed by somebody |
//! | it is the same | the item is made current, then the mode of missions is asked for. PX4 shows the current item in that mode only, so a request that does not show is not waited for |
//! | the autopilot flies its mission, from an earlier item (ArduPilot's MIS_RESTART, or a request that was lost) | the item is made current again |
//! | that has no effect | hold, and the pilot is notified |
//! | a landing that ends the mission | the landing mode is asked for instead, as for a return: it needs no item, and PX4 lands better in it |
//! | the autopilot lands, or stays at the end of its mission, and moves away from the place or climbs | hold, and the pilot is notified: nobody looks for obstacles there |

use super::client::Item;
use super::items::navigates;
use super::{Executive, FlightGoal, Intent, Scene};
use crate::demand::Demand;
use crate::note::Note;
use jink_shared_types::Timestamp;
use jink_shared_types::events::{ARRIVED, NO_GOAL, NOT_GIVEN_BACK, STRAYED};
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;

/// Slower than this counts as at rest (m/s): below the 0.3 m/s at which a vehicle counts as standing before an item, so that none
/// is taken for blocked while it waits to be given back; much lower, gusts at the end of the way would keep the mission from
/// ever being given back.
const REST_MPS: f64 = 0.2;
/// Requests for the item before it is taken for granted; an autopilot that shows it does so after the first.
const UNSEEN: u32 = 2;
/// An autopilot that restarts its mission does so at once, and shows that within this time (s): MISSION_CURRENT comes every second.
const VERIFIED_S: f64 = 3.0;
/// Requests for the item while the autopilot flies another one.
const CORRECTIONS: u32 = 4;
/// The end of a mission is where its last item is, within this (m).
const END_M: f64 = 3.0;

/// What was given back is flown near its place: farther than this beside or above it (m) it strays. A vehicle that lands drifts
/// some decimetres in wind.
const STRAY_M: f64 = 1.5;
/// The same for a vehicle that moves faster than this (m/s) ...
const STRAY_MPS: f64 = 1.0;
/// ... for so long (s), and so far away meanwhile (m): one wrong velocity is none, and on the way to its place it may.
const STRAY_S: f64 = 0.2;
const AWAY_M: f64 = 0.1;

/// Where the autopilot flies on its own what was given back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FlownAlone {
    place: Vector3<f64>,
    /// Where it began; `None` not yet.
    began: Option<Vector3<f64>>,
    /// It has moved fast since then, from this distance to the place (m).
    fast_since: Option<(Timestamp, f64)>,
}

impl FlownAlone {
    fn at(place: Vector3<f64>) -> Self {
        Self {
            place,
            began: None,
            fast_since: None,
        }
    }

    /// How far beside its place it is (m), if it strays.
    fn strays_m(&mut self, now: Timestamp, position: Vector3<f64>, level_mps: f64) -> Option<f64> {
        let began = *self.began.get_or_insert(position);
        let beside_m = (position - self.place).xy().norm();
        let is_fast = level_mps > STRAY_MPS;
        self.fast_since = is_fast.then(|| self.fast_since.unwrap_or((now, beside_m)));
        let is_beside = beside_m > (began - self.place).xy().norm() + STRAY_M;
        let is_above = position.z < began.z.min(self.place.z) - STRAY_M;
        let runs = self
            .fast_since
            .is_some_and(|(since, from_m)| now.seconds_since(since) >= STRAY_S && beside_m > from_m + AWAY_M);
        (is_beside || is_above || runs).then_some(beside_m)
    }
}

/// A mission that was given back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GivenBack {
    /// At this item.
    pub sequence: u16,
    /// When the autopilot began to fly it; `None` not yet.
    since: Option<Timestamp>,
}

impl GivenBack {
    /// At an item.
    pub fn at(sequence: u16) -> Self {
        Self {
            sequence,
            since: None,
        }
    }

    /// The autopilot has begun to fly it.
    pub fn taken(self, now: Timestamp) -> Self {
        Self {
            since: Some(now),
            ..self
        }
    }
}

impl Executive {
    pub(super) fn was_given_back(&self, sequence: u16) -> bool {
        self.given_back.is_some_and(|given| given.sequence == sequence)
    }

    /// All is flown: the autopilot finishes the mission at its last place, if the vehicle is there.
    pub(super) fn finish(
        &mut self,
        scene: &Scene<'_>,
        items: &[Item],
        place: &impl Fn(&Item, Vector3<f64>) -> Option<Vector3<f64>>,
    ) -> Intent {
        let Some(last) = items.iter().rev().find(|item| navigates(item)) else {
            return self.clear();
        };
        let end = scene
            .position
            .and_then(|position| place(last, position).or(Some(position)));
        let is_there = end
            .zip(scene.position)
            .is_none_or(|(end, position)| (end - position).norm() <= END_M);
        if !is_there {
            self.flight_goal = FlightGoal::None;
            self.report(&NO_GOAL, "", 0.0);
            return Intent::default();
        }
        self.leave(scene, last.sequence, Demand::Mission, end)
    }

    /// Comes to rest first: without a wish the committed trajectory ends, and then its end is held. What is left is flown near
    /// `place`; `None`: anywhere.
    pub(super) fn leave(
        &mut self,
        scene: &Scene<'_>,
        sequence: u16,
        demand: Demand,
        place: Option<Vector3<f64>>,
    ) -> Intent {
        if scene.speed_mps > REST_MPS {
            return Intent::default();
        }
        let since = *self.leaving.get_or_insert(scene.now);
        if !scene.read_at.is_set() || scene.read_at < since {
            return Intent {
                read_again: true,
                ..Intent::default()
            };
        }
        if demand == Demand::Mission {
            let current = Demand::Current(sequence);
            let is_asking = !self.asked.is_some_and(|(asked, ..)| asked == Demand::Mission);
            if is_asking && scene.current != Some(sequence) && self.times_asked(current) < UNSEEN {
                return Intent::asking(self.ask(scene.now, current));
            }
            let is_late = self
                .asked
                .is_some_and(|(_, last, _)| scene.now.seconds_since(last) < super::REPEAT_S);
            if is_asking && scene.current != Some(sequence) && is_late {
                return Intent::default();
            }
            self.given_back = Some(GivenBack::at(sequence));
        }
        self.flown_alone = place.map(FlownAlone::at);
        if self.times_asked(demand) == 0 && place.is_some() {
            self.report(&ARRIVED, "", f64::from(sequence));
        }
        if self.times_asked(demand) >= super::TRIES {
            self.report(&NOT_GIVEN_BACK, "", f64::from(sequence));
        }
        Intent::asking(self.ask(scene.now, demand))
    }

    /// While the autopilot flies what was given back: it stays near its place, or is asked to hold.
    pub(super) fn watch_given_back(&mut self, scene: &Scene<'_>) -> Option<Intent> {
        let is_elsewhere = scene.mode == NavMode::Mission
            && self
                .given_back
                .zip(scene.current)
                .is_some_and(|(given, current)| given.sequence != current);
        if is_elsewhere || !scene.armed || !scene.in_air {
            return None;
        }
        let (flown_alone, position) = self.flown_alone.as_mut().zip(scene.position)?;
        if !self.is_refused {
            let strays_m = flown_alone.strays_m(scene.now, position, scene.level_mps)?;
            self.report(&STRAYED, "", (strays_m * 10.0).round() / 10.0);
            self.is_refused = true;
        }
        Some(Intent::asking(self.ask(scene.now, Demand::Hold)))
    }

    /// While the autopilot has just begun to fly the mission that was given back: an earlier item than the one that it was given
    /// back at is put right.
    pub(super) fn verify_given_back(&mut self, scene: &Scene<'_>) -> Option<Intent> {
        let given = self.given_back?;
        let since = given.since.filter(|_| scene.mode == NavMode::Mission)?;
        if self.is_refused {
            return Some(Intent::asking(self.ask(scene.now, Demand::Hold)));
        }
        let is_new = scene.now.seconds_since(since) <= VERIFIED_S;
        let is_asked = self.times_asked(Demand::Current(given.sequence)) > 0;
        let other = scene.current.filter(|current| *current < given.sequence)?;
        if !is_new && !is_asked {
            return None;
        }
        if self.times_asked(Demand::Current(given.sequence)) < CORRECTIONS {
            let demand = self.ask(scene.now, Demand::Current(given.sequence));
            let note = demand.map(|_| Note::TakenElsewhere {
                taken: other,
                given: given.sequence,
            });
            return Some(Intent {
                note,
                ..Intent::asking(demand)
            });
        }
        let waits = self
            .asked
            .is_some_and(|(_, last, _)| scene.now.seconds_since(last) < super::REPEAT_S);
        if waits {
            return Some(Intent::default());
        }
        self.report(&NOT_GIVEN_BACK, "", f64::from(given.sequence));
        self.is_refused = true;
        Some(Intent::asking(self.ask(scene.now, Demand::Hold)))
    }
}
