//! Trajectories, and the guard's verdict on them.

use super::{BezierPiece, MotionLimits, MotionState, TRAJECTORY_PIECES};
use crate::clock::Timestamp;
use crate::coded::{Coded, Flag};
use crate::reserved::Reserved;

crate::wire_enum! {
    /// What a trajectory is for.
    pub enum TrajectoryMode {
        /// No trajectory: the gateway sends the autopilot's own setpoint back.
        Mirror = 0 "mirror",
        /// A planned motion that ends at rest.
        Plan = 1 "plan",
        /// A certified stop.
        Stop = 2 "stop",
        /// Maximum braking, certificate lost.
        Brake = 3 "brake",
    }
}

crate::sample! {
    /// Bezier pieces with a start time, ending at rest.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct Trajectory: 4136 {
        /// Identity; unique over restarts: the high half is the maker's generation.
        pub id: u64,
        /// The trajectory it departs from; 0 = from rest.
        pub base_id: u64,
        /// The route it was made for.
        pub route_id: u64,
        /// When piece 0 starts.
        pub start: Timestamp,
        /// When it departs from its base; before, both are the same.
        pub splice: Timestamp,
        /// Limits it keeps, tube included.
        pub limits: MotionLimits,
        /// Purpose.
        pub mode: Coded<TrajectoryMode>,
        /// It ends at the goal.
        pub reaches_goal: Flag,
        /// Declarations of the user that its certificate depends on, bits of [`crate::map::declared_as`].
        pub declarations: u8,
        /// Explicit padding, zero.
        pub reserved: Reserved<1>,
        /// Pieces in use.
        pub len: u32,
        /// Bit `i` is set: piece `i` brakes, and keeps the limits for that.
        pub braking: u32,
        /// Room for later fields, zero.
        pub reserved2: Reserved<4>,
        /// The pieces.
        pub pieces: [BezierPiece; TRAJECTORY_PIECES],
    }
    plausible if Self::is_consistent
}

impl Trajectory {
    /// The pieces in use.
    pub fn pieces(&self) -> &[BezierPiece] {
        &self.pieces[..(self.len as usize).min(TRAJECTORY_PIECES)]
    }

    /// Appends a piece; `false` if there is no room left.
    pub fn push(&mut self, piece: BezierPiece) -> bool {
        match self.pieces.get_mut(self.len as usize) {
            Some(slot) => {
                *slot = piece;
                self.len += 1;
                true
            }
            None => false,
        }
    }

    /// Appends a piece that brakes; `false` if there is no room left.
    pub fn push_braking(&mut self, piece: BezierPiece) -> bool {
        let bit = 1u32.checked_shl(self.len).unwrap_or_default();
        let fits = self.push(piece);
        if fits {
            self.braking |= bit;
        }
        fits
    }

    /// Drops all pieces but the first `len`.
    pub fn truncate(&mut self, len: u32) {
        self.len = self.len.min(len);
        self.braking &= !u32::MAX.checked_shl(len).unwrap_or_default();
    }

    /// Whether the piece of that number brakes.
    pub fn is_braking(&self, piece: usize) -> bool {
        piece < TRAJECTORY_PIECES && self.braking >> piece & 1 == 1
    }

    /// Total duration (s).
    pub fn duration_s(&self) -> f64 {
        self.pieces().iter().map(|piece| piece.duration_s).sum()
    }

    /// When the vehicle comes to rest.
    pub fn end(&self) -> Timestamp {
        self.start.plus_seconds(self.duration_s())
    }

    /// Distance that it takes from `now` to rest (m).
    pub fn way_left_m(&self, now: Timestamp) -> f64 {
        /// Enough for a comparison: chords of a quintic piece are less than one percent shorter than its path.
        const CHORDS: u32 = 16;
        let mut skip_s = now.seconds_since(self.start).max(0.0);
        let mut way_m = 0.0;
        for piece in self.pieces() {
            let begin_s = skip_s.min(piece.duration_s);
            skip_s -= begin_s;
            let mut last = piece.at(begin_s).position.vector();
            for chord in 1..=CHORDS {
                let t_s = begin_s + (piece.duration_s - begin_s) * f64::from(chord) / f64::from(CHORDS);
                let next = piece.at(t_s).position.vector();
                way_m += (next - last).norm();
                last = next;
            }
        }
        way_m
    }

    /// The reference at `time`: the start before it begins, rest at the end after it. `None` without pieces.
    pub fn at(&self, time: Timestamp) -> Option<MotionState> {
        let last = self.pieces().last()?;
        let mut t_s = time.seconds_since(self.start).max(0.0);
        for piece in self.pieces() {
            if t_s <= piece.duration_s {
                return Some(piece.at(t_s));
            }
            t_s -= piece.duration_s;
        }
        let end = last.at(last.duration_s);
        Some(MotionState::at_rest(end.position, end.yaw_rad))
    }

    /// Copies into `self` (whose pieces are dropped) what `base` does from `from` to `until`: whole pieces stay as they
    /// are, the pieces at both ends are cut. Returns `false`, leaving `self` empty, if that does not fit.
    pub fn take_prefix(&mut self, base: &Self, from: Timestamp, until: Timestamp) -> bool {
        /// A cut piece shorter than this is a rounding error: its derivatives would be noise.
        const DUST_S: f64 = 1e-4;
        self.truncate(0);
        self.start = from;
        let first_s = from.seconds_since(base.start);
        let last_s = until.seconds_since(base.start);
        let mut piece_start_s = 0.0;
        let mut started = false;
        for piece in base.pieces() {
            let piece_end_s = piece_start_s + piece.duration_s;
            if piece_end_s > first_s + DUST_S && piece_start_s < last_s - DUST_S {
                let mut part = *piece;
                let mut part_start_s = piece_start_s;
                if !started && first_s > piece_start_s + DUST_S {
                    part = part.split(first_s - piece_start_s).1;
                    part_start_s = first_s;
                }
                if !started {
                    self.start = base.start.plus_seconds(part_start_s);
                    started = true;
                }
                if last_s < piece_end_s - DUST_S {
                    part = part.split(last_s - part_start_s).0;
                }
                if !self.push(part) {
                    self.truncate(0);
                    return false;
                }
            }
            piece_start_s = piece_end_s;
        }
        true
    }

    /// Whether it is what its mode says: nothing to fly, or something that can be flown.
    pub fn is_consistent(&self) -> bool {
        self.len as usize <= TRAJECTORY_PIECES && (self.mode == TrajectoryMode::Mirror || self.is_sound())
    }

    /// Whether it can be flown at all: at least one piece, all numbers finite.
    pub fn is_sound(&self) -> bool {
        self.len as usize <= TRAJECTORY_PIECES
            && self.len > 0
            && self.start.is_set()
            && self.pieces().iter().all(BezierPiece::is_sound)
    }
}

crate::wire_enum! {
    /// What the guard did.
    pub enum Verdict {
        /// Nothing is approved: hold.
        Hold = 0 "hold",
        /// Passed unchanged.
        Passed = 1 "passed",
        /// The new trajectory was refused; the one before continues.
        Kept = 2 "kept",
        /// Replaced by the guard's own brake.
        Braked = 3 "braked",
    }
}

crate::wire_enum! {
    /// Why the guard decided so.
    pub enum GuardReason {
        /// No reason given.
        None = 0 "none",
        /// An obstacle is nearer than the stopping distance.
        Obstacle = 1 "obstacle",
        /// The path leads where no sensor sees.
        Unseen = 2 "unseen",
        /// Range data are too old.
        RangesStale = 3 "ranges_stale",
        /// The vehicle's state is too old or invalid.
        StateStale = 4 "state_stale",
        /// The new trajectory does not join the one being flown.
        Discontinuous = 5 "discontinuous",
        /// The new trajectory came after its own splice time.
        Late = 6 "late",
        /// The new trajectory breaks its limits or is not valid.
        Unsound = 7 "unsound",
        /// The new trajectory departs from another one than is being flown.
        WrongBase = 8 "wrong_base",
    }
}

crate::sample! {
    /// The trajectory that the guard approves.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct ApprovedTrajectory: 4160 {
        /// The trajectory.
        pub trajectory: Trajectory,
        /// Distance left to the first conflict the guard sees (m); infinity if none.
        pub free_way_m: f64,
        /// Distance needed to stop from here (m).
        pub stopping_m: f64,
        /// Decision.
        pub verdict: Coded<Verdict>,
        /// Its reason.
        pub reason: Coded<GuardReason>,
        /// Explicit padding, zero.
        pub reserved: Reserved<6>,
    }
    plausible if Self::is_consistent
}

impl ApprovedTrajectory {
    /// Whether what is approved can be flown, and its numbers are plausible.
    pub fn is_consistent(&self) -> bool {
        let figures_are_numbers = !self.free_way_m.is_nan() && !self.stopping_m.is_nan();
        figures_are_numbers && (self.verdict == Verdict::Hold || self.trajectory.is_consistent())
    }
}
