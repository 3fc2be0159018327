//! The event table: what is reported to pilots and logs, once per change of state.

use crate::coded::{Coded, Wire};
use crate::health::Name;
use crate::reserved::Reserved;

crate::wire_enum! {
    /// Severity, as in RFC 5424 and MAV_SEVERITY (the number is the code).
    pub enum Severity {
        /// Normal but worth a record.
        Debug = 7 "debug",
        /// The aircraft cannot be kept safe by jink any more.
        Emergency = 0 "emergency",
        /// Act now.
        Alert = 1 "alert",
        /// A primary function is lost.
        Critical = 2 "critical",
        /// A function is lost or an intervention took place.
        Error = 3 "error",
        /// Something is wrong and may get worse.
        Warning = 4 "warning",
        /// Unusual, not wrong.
        Notice = 5 "notice",
        /// Normal operation.
        Info = 6 "info",
    }
}

/// When an event becomes a text for the pilot.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Told {
    /// Never: it is for logs, `jink top` and `jink status`.
    Logged,
    /// When it happens.
    News,
    /// Whenever it happens: it answers what a person has just done, and without it nobody knows whether that came through; or whoever
    /// reports it keeps the pause himself.
    Answer,
    /// As long as its state lasts, which the event with this id ends.
    Until(u16),
    /// Once, when the state that it ends is over.
    End,
}

crate::wire_enum! {
    /// Why a candidate is refused, in words that fit into the text: its name is the process's, and its number this code.
    pub enum SwapReason {
        /// A reason of a later build.
        Unknown = 0 "see jink swap",
        /// The candidate has ended without an error: it may be no program of jink's.
        WrongProgram = 1 "wrong program",
        /// It cannot start: another program of jink's says that it is one.
        CannotStart = 2 "cannot start",
        /// It was killed, or has crashed.
        Died = 3 "died",
        /// It has not begun in time, or fell silent.
        Silent = 4 "silent",
        /// Too many cycles over budget.
        TooSlow = 5 "too slow",
        /// Nobody can use its outputs.
        Implausible = 6 "bad outputs",
        /// Too few or too many outputs.
        Outputs = 7 "other outputs",
        /// It had too little to do.
        Idle = 8 "little to do",
        /// The owner has died meanwhile.
        OwnerDied = 9 "owner died",
        /// The system stops.
        Stopping = 10 "jink ends",
    }
}

/// One row of the event table.
///
/// In the text, `{name}` and `{n}` say what it is about: of another sensor or another mission item it is another text. `{why}`, `{0}`
/// and `{1}` say more of the same; `{reason}` is the number as a [`SwapReason`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Event {
    /// Identity, never reused.
    pub id: u16,
    /// Severity.
    pub severity: Severity,
    /// When the pilot is told.
    pub told: Told,
    /// Text for the pilot, at most 50 bytes after `{name}` or `{why}` (the name), `{n}` or `{0}` and `{1}` (the numbers) have been
    /// filled in.
    pub text: &'static str,
    /// Why it happens.
    cause: &'static str,
    /// What the pilot should do.
    pub action: &'static str,
}

impl Event {
    /// Why it happens, in a sentence.
    pub const fn cause(&self) -> &'static str {
        self.cause.trim_ascii()
    }

    /// Whether the text is about the thing that the event names, and about its number.
    pub fn is_about(&self) -> (bool, bool) {
        (self.text.contains("{name}"), self.text.contains("{n}"))
    }
}

/// The comment of a row is its cause. A row that does not say when the pilot is told is [`Told::News`].
macro_rules! events {
    ($( $(#[doc = $cause:literal])+ $name:ident = $id:literal, $severity:ident, $($told:ident $(($end:ident))?,)? $text:literal, $action:literal; )*) => {
        $( $(#[doc = $cause])+ pub const $name: Event = Event {
            id: $id, severity: Severity::$severity, told: told!($($told $(($end))?)?), text: $text,
            cause: concat!($($cause),+), action: $action,
        }; )*
        /// Every event, in order of id.
        pub const TABLE: &[Event] = &[$($name),*];
    };
}

macro_rules! told {
    () => {
        Told::News
    };
    ($told:ident) => {
        Told::$told
    };
    (Until($end:ident)) => {
        Told::Until($end.id)
    };
}

events! {
    /// The whole chain has become healthy.
    AVOIDANCE_READY = 1, Info, End, "jink: avoidance ready", "None.";
    /// A part of the chain is missing.
    AVOIDANCE_DEGRADED = 2, Critical, Until(AVOIDANCE_READY), "jink: avoidance degraded, {why}", "Expect a stop; take over or wait.";
    /// A process died and was started again.
    PROCESS_RESTARTED = 3, Warning, "jink: {name} restarted", "None if it happens once.";
    /// A process hung and was killed.
    PROCESS_HUNG = 4, Error, "jink: {name} hung, replaced", "None if it happens once.";
    /// A process was given up.
    PROCESS_FAILED = 5, Alert, Until(AVOIDANCE_READY), "jink: {name} failed for good", "Land; look at its log.";
    /// No fresh range data.
    RANGES_LOST = 6, Critical, Until(RANGES_BACK), "jink: range data lost, stopping", "Take over or wait.";
    /// Range data are back.
    RANGES_BACK = 7, Notice, End, "jink: range data back", "None.";
    /// The planner finds no way.
    NO_PATH = 8, Warning, Until(PATH_FOUND), "jink: no path to the goal, holding", "Wait, or choose another goal.";
    /// The planner has found a way again.
    PATH_FOUND = 9, Info, End, "jink: path found, flying on", "None.";
    /// Something new stands on the committed path and there was a certified way out.
    COMMITMENT_CHANGED = 10, Notice, "jink: path blocked, evading", "None.";
    /// The committed trajectory lost its certificate and no certified stop was found.
    CERTIFICATE_LOST = 11, Alert, "jink: certificate lost, braking", "Be ready to take over.";
    /// The guard replaced a trajectory by a brake.
    GUARD_BRAKED = 12, Error, Until(GUARD_RELEASED), "jink: guard brakes, {why} {0} m ahead", "Be ready to take over.";
    /// The guard lets trajectories pass again.
    GUARD_RELEASED = 13, Notice, End, "jink: guard released", "None.";
    /// The estimator's position jumped.
    ESTIMATOR_RESET = 14, Warning, "jink: position reset, map dropped", "Watch the estimator.";
    /// The autopilot is not seen any more.
    AUTOPILOT_LOST = 15, Critical, Until(AUTOPILOT_FOUND), "jink: autopilot lost", "Check the link.";
    /// The autopilot is seen.
    AUTOPILOT_FOUND = 16, Info, End, "jink: autopilot connected, system {0}", "None.";
    /// Cycles of a process are over budget.
    PROCESS_SLOW = 17, Warning, Logged, "jink: {name} slow, {0} late in {1} s", "Reduce the load; look at its log.";
    /// A process was replaced because it was too slow for too long.
    PROCESS_TOO_SLOW = 18, Error, "jink: {name} too slow, replaced", "None if it happens once.";
    /// Outputs are older than their end-to-end budget; the name is that of the stage that took most.
    OUTPUT_LATE = 19, Warning, Logged, "jink: late, {name} {0} of {1} ms", "Reduce the load.";
    /// A second instance took over from a dead one.
    PROCESS_TAKEN_OVER = 20, Warning, "jink: {name} taken over", "None if it happens once.";
    /// Another binary has taken over in flight.
    PROCESS_SWAPPED = 21, Notice, Answer, "jink: {name} swapped", "None.";
    /// A swap was refused; the old one never stopped.
    SWAP_REFUSED = 22, Warning, Answer, "jink: {name} swap refused, {reason}", "Look at the new binary.";
    /// A swap was undone.
    SWAP_ROLLED_BACK = 23, Error, Answer, "jink: {name} swap rolled back", "Look at the new binary.";
    /// The supervisor was replaced while the others went on.
    SUPERVISOR_BACK = 24, Warning, "jink: supervisor back", "None if it happens once.";
    /// Some of the range sensors are silent, others still see.
    SENSOR_LOST = 25, Warning, Until(SENSOR_BACK), "jink: {0} of {1} range sensors, slower", "Land soon; look at the sensor.";
    /// All range sensors see again.
    SENSOR_BACK = 26, Notice, End, "jink: all range sensors back", "None.";
    /// The autopilot refuses the mode in which it follows setpoints, or the mission that is given back; the number is the MAV_RESULT.
    MODE_REFUSED = 27, Warning, Answer, "jink: autopilot refused the mode, {0}", "Read the autopilot's own text; fly by hand or try again.";
    /// A mission item cannot be reached; the name says what is done about it.
    ITEM_BLOCKED = 28, Warning, "jink: item {n} blocked, {why}", "Choose another way or another item.";
    /// The autopilot is in the mode that follows setpoints and does not follow them.
    SETPOINTS_IGNORED = 29, Error, Until(SETPOINTS_FOLLOWED), "jink: autopilot ignores setpoints", "Take over; check the autopilot's log and version.";
    /// The autopilot follows the setpoints again that it has ignored.
    SETPOINTS_FOLLOWED = 30, Notice, End, "jink: autopilot follows setpoints again", "None.";
    /// The autopilot flies its mission itself, in a profile in which jink should.
    UNGUARDED = 31, Warning, "jink: mission flown without avoidance", "Hold, or fly by hand; see what jink is waiting for.";
    /// Collision prevention turns or slows what the pilot wants; the name says why, the number how near it is.
    PREVENTION_ACTS = 32, Warning, Until(PREVENTION_RESTS), "jink: prevention: {why}, {0} m", "Steer elsewhere.";
    /// Collision prevention does nothing any more.
    PREVENTION_RESTS = 33, Info, End, "jink: prevention released", "None.";
    /// There are no range data, and collision prevention lets nothing move.
    PREVENTION_BLIND = 34, Critical, Until(PREVENTION_RESTS), "jink: no range data, not moving", "Change the mode.";
    /// There have been no range data for so long that collision prevention holds the vehicle.
    PREVENTION_HOLDS = 35, Critical, Until(PREVENTION_RESTS), "jink: no range data, asking for Hold", "Look at the sensors; land.";
    /// A pilot's sticks pass through the guard from now on, or again.
    ASSIST_ON = 36, Info, Answer, "jink: assisted flight on", "None.";
    /// A pilot's sticks do not pass through the guard any more; the name says why. The autopilot is in its own mode, or asked for it.
    ASSIST_OFF = 37, Notice, Answer, "jink: assisted flight off: {name}", "Fly by hand; without sticks look at the remote control.";
    /// Assisted flight was chosen, and something prevents it; the name says what.
    ASSIST_REFUSED = 38, Warning, Answer, "jink: no assisted flight: {name}", "Mend that, and choose it again.";
    /// The vehicle holds its place while something is missing; the name says what.
    ASSIST_HOLDS = 39, Critical, "jink: assisted flight holds: {why}", "Change the mode, or wait for Hold.";
    /// Somebody wanted the gateway restarted in flight.
    RESTART_REFUSED = 40, Warning, Answer, "jink: restart refused, vehicle is armed", "Land and disarm first.";
    /// A changed parameter could not be kept.
    PARAMETERS_NOT_KEPT = 41, Warning, "jink: parameters not stored on disk", "Look at the disk; they hold until a restart.";
    /// A link is too slow for setpoints and five obstacle maps a second; the numbers are what it carries and what they need.
    LINK_SLOW = 42, Warning, Until(LINK_FAST_AGAIN), "jink: link {name} slow, {0} of {1} B/s", "Raise the baud rate; expect fewer obstacle maps.";
    /// A link that was too slow carries everything again.
    LINK_FAST_AGAIN = 43, Notice, End, "jink: link {name} fast enough", "None.";
    /// A rangefinder is unplugged, or says nothing.
    RANGEFINDER_LOST = 44, Warning, Until(RANGEFINDER_BACK), "jink: rangefinder {name} lost", "Land soon; look at its plug and its power.";
    /// A rangefinder that was lost measures again.
    RANGEFINDER_BACK = 45, Notice, End, "jink: rangefinder {name} back", "None.";
    /// The vehicle has come no nearer to its goal for OA_BLOCKED_T; the name says why, the number how far away it is.
    GOAL_BLOCKED = 46, Warning, "jink: goal {0} m off: {why}", "Choose another goal, or fly by hand.";
    /// A lidar is unplugged, or sends nothing.
    LIDAR_LOST = 47, Warning, Until(LIDAR_BACK), "jink: lidar {name} lost", "Land soon; look at its cable and its power.";
    /// A lidar that was lost measures again.
    LIDAR_BACK = 48, Notice, End, "jink: lidar {name} back", "None.";
    /// The telemetry log cannot be begun, or ends: its disk is full or gone.
    TELEMETRY_LOG_LOST = 49, Warning, "jink: no telemetry log", "Make room on its disk, or name another folder in link.tlog.";
    /// The current mission item is a motion that cannot be guarded, and is not begun; the name says which.
    ITEM_HELD = 50, Warning, "jink: item {n} {why}: unguarded, held", "Choose another item, or fly it by hand; OA_UNGUARDED, set before the flight, lets it be flown.";
    /// The current mission item is a motion that cannot be guarded, and OA_UNGUARDED lets the autopilot fly it.
    ITEM_UNGUARDED = 51, Warning, "jink: item {n} {why} flown unguarded", "Watch it; hold if something is in the way.";
    /// A spline item is flown along straight legs.
    ITEM_STRAIGHT = 52, Notice, "jink: spline item {n} flown straight", "None.";
    /// The mission that was flown is gone.
    MISSION_CLEARED = 53, Warning, Answer, "jink: mission cleared, holding", "Upload a mission, send a go-to, or choose a mode.";
    /// Another mission was uploaded while one was flown.
    MISSION_CHANGED = 54, Notice, Answer, "jink: mission changed, on at item {n}", "None.";
    /// Somebody has chosen another item than the one that was flown to.
    ITEM_CHOSEN = 55, Info, Answer, "jink: item {n} chosen", "None.";
    /// The mode that follows setpoints was chosen, and there is nothing to fly to.
    NO_GOAL = 56, Notice, Answer, "jink: holds, waits for mission or go-to", "Start the mission, send a go-to, or choose a mode.";
    /// A place that a ground station asked for is flown to.
    GO_TO = 57, Info, Answer, "jink: go-to, {n} m away", "None.";
    /// The mission cannot be given back: the autopilot begins it anew, or does not take the item.
    NOT_GIVEN_BACK = 58, Error, "jink: item {n} not taken back, holding", "Land by hand, or choose the item and the mission mode.";
    /// The autopilot flies on its own what somebody has asked for a second time.
    LEFT_ALONE = 59, Warning, Answer, "jink: chosen again, flown without avoidance", "Hold, or fly by hand.";
    /// Somebody chose the mission mode from the mode that follows setpoints; it is taken over again.
    TAKEN_AGAIN = 60, Notice, Answer, "jink: takes over again; repeat to fly alone", "Choose the mission mode once more to fly without jink.";
    /// No setpoint is sent, because the autopilot does not say whether the vehicle stands on the ground.
    LANDED_UNKNOWN = 61, Warning, "jink: landed state not known, no setpoints", "Let the autopilot send EXTENDED_SYS_STATE.";
    /// Somebody chose a mode of the autopilot's whose motion cannot be guarded, in flight; the name says which.
    MODE_HELD = 62, Warning, Answer, "jink: {name}: unguarded, held", "Fly it by hand, or choose it once more to mean it.";
    /// Somebody chose a mode of the autopilot's whose motion cannot be guarded, and it is let fly; the name says which.
    MODE_UNGUARDED = 63, Warning, Answer, "jink: {name} flown unguarded", "Watch it; hold if something is in the way.";
    /// Plans do not reach the highest speed that is allowed (m/s): they end at rest in known space, braking no harder than the autopilot follows.
    SPEED_CUT = 64, Info, "jink: {0} m/s at most, not {1}", "None; a profile that is followed more closely allows more.";
    /// The vehicle strays farther from what it is sent than was known (cm per m/s2): plans accelerate and brake less from now on.
    TRACKING_LEARNED = 65, Warning, "jink: strays {0}, overruns {1} cm per m/s2", "Look at gains, weight and wind; OA_TRK_CUT and OA_TRK_OVER keep it.";
    /// The vehicle flies, and no path has led nearer to the goal for so long (s): at most every half minute, until OA_BLOCKED_T and the
    /// time for the detours that are known are over.
    WAY_SEARCHED = 66, Notice, Answer, "jink: looking for a way round, {0} s", "None; hold, or choose another goal, if it takes too long.";
    /// A sensor that was right so far sees the vehicle move otherwise than its estimated position: nothing is where the map says. Or
    /// the estimate (this is its name then) contradicts itself: for a second its position has moved by more than 1 m/s otherwise than
    /// its velocity says.
    POSITION_ADRIFT = 68, Critical, Until(POSITION_CREDIBLE), "jink: {name}: position adrift, stopping", "Take over without position (Altitude, Stabilize), or land; look at the GPS.";
    /// It moves as it is estimated again.
    POSITION_CREDIBLE = 69, Notice, End, "jink: position is credible again", "None.";
    /// Routes are made of what another program proposes, from now on or again.
    PROPOSAL_FLOWN = 70, Info, "jink: flies a proposed way", "None.";
    /// What another program proposes is not flown; the name says why. The planner's own way is.
    PROPOSAL_REFUSED = 71, Notice, "jink: proposed way refused: {why}", "Look at plan/proposal_answer: where and why.";
    /// Nobody proposes anything any more, or the way is at its end: the planner's own way is flown.
    PROPOSAL_ENDED = 72, Info, "jink: proposed way ended, own way", "None.";
    /// Somebody sends with the autopilot's id from another address than the autopilot; the name is the link's.
    SECOND_SENDER = 73, Warning, "jink: {name}: second sender of our id", "Look for a program or vehicle with the same system id: it is not listened to.";
    /// Two autopilots are heard, and the configuration does not say which one is ours; the numbers are their systems.
    TWO_AUTOPILOTS = 74, Error, "jink: two autopilots, systems {0} and {1}", "Set link.system_id. While both are heard jink is not ready to arm; in flight the first is kept.";
    /// The autopilot's clock and coordinates have begun anew.
    AUTOPILOT_RESTARTED = 75, Warning, "jink: autopilot restarted", "In flight take over, or choose the mode again; on the ground none.";
    /// A ground station wanted a parameter less safe than it is, and the vehicle is armed; the name is the parameter's.
    LOOSENING_REFUSED = 76, Warning, Answer, "jink: {name} only while disarmed", "Change it on the ground, or with jink param set on the board.";
    /// The profile was chosen by what the autopilot is.
    PROFILE_CHOSEN = 80, Info, End, "jink: profile {why} chosen", "None.";
    /// The autopilot does not take what the profile sends; the name is that of the right one.
    PROFILE_UNFIT = 81, Error, Until(PROFILE_CHOSEN), "jink: not ready, profile must be {why}", "Set link.profile, or leave it at auto; start jink again.";
    /// The interface that the profile needs is switched off; the name is that of the autopilot's parameter.
    INTERFACE_OFF = 82, Error, Until(PROFILE_CHOSEN), "jink: not ready, set {why} to 1", "Set the parameter on the autopilot.";
    /// No profile is for this autopilot.
    AUTOPILOT_UNFIT = 83, Error, Until(PROFILE_CHOSEN), "jink: not ready, autopilot not supported", "Look at the versions in README.md; update the firmware.";
    /// The autopilot does not answer what decides about the profile; the name is the first question that is open.
    PROFILE_UNPROVEN = 84, Error, Until(PROFILE_CHOSEN), "jink: not ready, no answer to {why}", "Check the wire to the autopilot, and signing.";
    /// Somebody ends jink in flight: the vehicle comes to rest, and is left to the autopilot's own hold.
    STOPPING_TO_END = 85, Warning, "jink: ending, stopping the vehicle", "Be ready to take over: nobody looks for obstacles soon.";
    /// Samples of a process, or on a topic, have stamps in the future or numbers that make no sense; nobody reads them.
    SAMPLE_REFUSED = 86, Warning, "jink: samples of {name} refused", "Look at its log; swap or restart it.";
    /// With what the sensors see no motion can be certified; the name says what is missing.
    SENSORS_UNFIT = 87, Warning, "jink: cannot plan: nobody sees {why}", "jink check sensors says what would help.";
    /// The vehicle is armed, and part of the free space rests on a declaration of the user; the name says on which.
    DECLARED = 88, Notice, "jink: declared: {name}", "Make sure that it holds where the vehicle flies.";
    /// The clock of a sensor or of the autopilot was set: what it dates is dated anew from now on.
    CLOCK_STEPPED = 89, Notice, "jink: clock of {name} stepped by {0} s", "None if it happens once; look at what sets it: PTP, GPS.";
    /// A depth camera is unplugged, sends nothing, or sends the same image again and again.
    DEPTH_CAMERA_LOST = 90, Warning, Until(DEPTH_CAMERA_BACK), "jink: depth camera {name} lost", "Land soon; look at its plug and its power.";
    /// A depth camera that was lost measures again.
    DEPTH_CAMERA_BACK = 91, Notice, End, "jink: depth camera {name} back", "None.";
    /// A sensor repeats its data although the vehicle moves or time goes on, or its time stands still; nothing of it is used.
    SENSOR_STUCK = 92, Critical, Until(SENSOR_CREDIBLE), "jink: {name} repeats itself, not used", "Land; cut its power for a moment, or replace it.";
    /// What a sensor says agrees with itself under motion only if ranges are multiplied; so many metres of it are so many in truth.
    SENSOR_SCALE = 93, Critical, Until(SENSOR_CREDIBLE), "jink: {name} says {0} for {1} m", "Land by hand; look at its model, its units and its driver.";
    /// What a sensor says agrees with itself under motion only if left and right are exchanged.
    SENSOR_MIRRORED = 94, Critical, Until(SENSOR_CREDIBLE), "jink: {name} is mirrored", "Land by hand; look at its orientation and its driver.";
    /// What a sensor says of things at rest does not agree with itself under motion; turned by the angle it would, 0: unknown.
    SENSOR_MOUNTING = 95, Critical, Until(SENSOR_CREDIBLE), "jink: {name} is turned by {0} deg", "Land by hand; jink check sensors --calibrate.";
    /// A sensor sends more or fewer frames than its table says.
    SENSOR_RATE = 96, Warning, Until(SENSOR_CREDIBLE), "jink: {name} {0} Hz instead of {1}", "Look at its settings, its rate_hz, and at who else publishes for it.";
    /// A sensor of which a fault was reported is as it should be.
    SENSOR_CREDIBLE = 97, Notice, End, "jink: {name} is credible again", "None.";
    /// Something hangs from above where it is declared that nothing does; the declaration has ended.
    OVERHANG_SEEN = 98, Warning, "jink: overhang seen, undeclared from now on", "Set OA_DCL_HANG_HI to 0 where something hangs from above.";
    /// A vehicle at rest moves out of the way of something that comes to it.
    GIVES_WAY = 99, Notice, "jink: something comes, giving way", "None.";
    /// The mission of an autopilot on the ground was read, or another one; the number counts its items.
    MISSION_READ = 110, Info, Answer, "jink: mission read, {n} items", "None.";
    /// Nobody can guard the motion of an item of a mission that was read, or its jump leads nowhere: the vehicle will hold before it.
    ITEM_WILL_HOLD = 111, Warning, "jink: item {n} {why}: will be held", "Change the item, or be ready to fly it by hand.";
    /// The mission is flown by jink from this item on.
    MISSION_TAKEN = 112, Info, Answer, "jink: flies the mission, item {n}", "None.";
    /// Jink flies the mission again after it was interrupted.
    MISSION_RESUMED = 113, Info, Answer, "jink: goes on with the mission, item {n}", "None.";
    /// The autopilot is asked to hold its mission, since nobody looks for obstacles yet.
    MISSION_WAITS = 114, Warning, "jink: mission held until avoidance is ready", "Wait, or fly by hand.";
    /// What is left of the mission is the autopilot's: a landing, or staying at its end.
    ARRIVED = 115, Info, Answer, "jink: arrived at item {n}, given back", "Watch the landing.";
    /// A go-to is at its end.
    GO_TO_REACHED = 116, Info, Answer, "jink: go-to reached, holding", "None.";
    /// The autopilot does not stay near the place at which a landing, or the end of the mission, was given back to it; the number
    /// says how far beside it is (m).
    STRAYED = 117, Error, "jink: strays {0} m, asking for Hold", "Land by hand, or choose the landing mode again.";
    /// A jump of the mission leads to no item, or in a circle.
    JUMP_NOWHERE = 118, Warning, "jink: item {n} jumps nowhere, holding", "Choose another item; correct the mission.";
    /// A station has changed the speed by command (m/s).
    SPEED_COMMANDED = 119, Info, Answer, "jink: {0} m/s by command", "None.";
    /// A link cannot be opened: its device is not plugged in, or its other end not there. It is tried again and again.
    LINK_WAITED = 120, Warning, Until(LINK_OPEN), "jink: waiting for {name}", "Plug it in, or switch it on; `jink status` names the link.";
    /// A link that was waited for is open.
    LINK_OPEN = 121, Notice, End, "jink: {name} is there", "None.";
    /// The folder of the logs cannot be written, or its disk is full or hangs: what happens from now on stays in memory, each log's last megabyte.
    LOGS_LOST = 122, Warning, Until(LOGS_KEPT), "jink: no room for logs", "Make room on its disk, or name another folder in log_dir.";
    /// Logs are written again.
    LOGS_KEPT = 123, Notice, End, "jink: logs are kept again", "None.";
    /// The straight way to the goal is not free: the vehicle flies round what stands there.
    GOING_ROUND = 124, Info, "jink: obstacle ahead, going round", "None.";
    /// The vehicle has come to its goal, and goes nowhere from there for now.
    GOAL_REACHED = 125, Info, Answer, "jink: arrived", "None.";
    /// The autopilot has left the mode in which jink flew, because somebody chose another one or by itself; the name says for which.
    HELD = 126, Info, Answer, "jink: mode {name}, jink waits", "Choose the mission, or send a go-to, to have jink fly on.";
    /// The autopilot is in a mode again in which jink flies.
    RESUMED = 127, Info, Answer, "jink: flying on", "None.";
    /// The autopilot lands, and below the vehicle is no level ground: a box, a bush, a post, the edge of a roof. Only what is seen counts.
    PLACE_NOT_FREE = 128, Warning, Answer, "jink: place to land is not free", "Hold, and land elsewhere.";
    /// The disk of the recordings is full, gone or cannot be written; it is tried again and again.
    RECORDING_STOPPED = 129, Warning, Until(RECORDING_AGAIN), "jink: nothing is recorded", "Look at the disk of the recordings; the flight goes on.";
    /// Recordings are written again.
    RECORDING_AGAIN = 130, Notice, End, "jink: recording again", "None.";
}

/// The event with identity `id`.
pub fn find(id: u16) -> Option<&'static Event> {
    TABLE.iter().find(|event| event.id == id)
}

crate::sample! {
    /// An event on its way to the pilot.
    #[derive(Clone, Copy, Debug, Default, PartialEq)]
    pub struct EventSample: 72 {
        /// The process that says it.
        pub process: Name,
        /// Fills `{name}` or `{why}`.
        pub name: Name,
        /// Fill `{n}` or `{0}`, and `{1}`.
        pub numbers: [f64; 2],
        /// Row of the table.
        pub id: u16,
        /// Explicit padding, zero.
        pub reserved: Reserved<5>,
        /// Severity, repeated so that an unknown id still has one.
        pub severity: Coded<Severity>,
    }
    plausible if Self::is_consistent
}

impl EventSample {
    /// Whether its names are texts. An event that this build does not know is still one.
    pub fn is_consistent(&self) -> bool {
        self.process.is_text() && self.name.is_text()
    }

    /// `event` about `name` with `numbers`; whoever publishes it adds the process.
    pub fn new(event: &Event, name: &str, numbers: [f64; 2]) -> Self {
        Self {
            process: Name::default(),
            name: Name::new(name),
            numbers,
            id: event.id,
            reserved: Reserved::ZERO,
            severity: Coded::new(event.severity),
        }
    }

    /// Its numbers, where the text leaves them out: they are for logs.
    pub fn unsaid_numbers(&self) -> Option<[f64; 2]> {
        let says = find(self.id).is_some_and(|row| {
            ["{n}", "{0}", "{1}", "{reason}"]
                .iter()
                .any(|blank| row.text.contains(blank))
        });
        (!says && self.numbers != [0.0; 2]).then_some(self.numbers)
    }

    /// The text with everything filled in; numbers keep at most one decimal.
    pub fn text(&self) -> String {
        let Some(event) = find(self.id) else {
            return format!("jink: event {}", self.id);
        };
        let number = |value: f64| {
            if value.fract().abs() < 0.05 {
                format!("{value:.0}")
            } else {
                format!("{value:.1}")
            }
        };
        let reason = SwapReason::from_code(self.numbers[0] as u8).unwrap_or(SwapReason::UNKNOWN);
        event
            .text
            .replace("{reason}", reason.name())
            .replace("{name}", self.name.as_str())
            .replace("{why}", self.name.as_str())
            .replace("{n}", &format!("{:.0}", self.numbers[0]))
            .replace("{0}", &number(self.numbers[0]))
            .replace("{1}", &number(self.numbers[1]))
    }
}

#[cfg(test)]
mod tests {
    use super::{EventSample, GUARD_BRAKED, SWAP_REFUSED, SwapReason, TABLE, Told, find};
    use crate::coded::Wire;

    #[test]
    fn ids_are_unique_and_ascending() {
        assert!(TABLE.windows(2).all(|pair| pair[0].id < pair[1].id));
    }

    #[test]
    fn every_text_fits_a_status_line() {
        for event in TABLE {
            let sample = EventSample::new(event, "obstacle_fusion", [1234.5, 9.9]);
            assert!(sample.text().len() <= 50, "{} is too long", sample.text());
        }
    }

    #[test]
    fn every_reason_fits_behind_the_longest_name() {
        for reason in SwapReason::SHAPE.variants {
            let sample = EventSample::new(&SWAP_REFUSED, "bezier_generator", [f64::from(reason.code), 0.0]);
            assert!(sample.text().ends_with(reason.text), "{}", sample.text());
            assert!(sample.text().len() <= 50, "{} is too long", sample.text());
        }
    }

    #[test]
    fn numbers_and_names_are_filled_in() {
        let sample = EventSample::new(&GUARD_BRAKED, "obstacle", [2.5, 0.0]);
        assert_eq!(sample.text(), "jink: guard brakes, obstacle 2.5 m ahead");
    }

    /// A text that only names what a person must act upon would be repeated for ever, or never be over.
    #[test]
    fn a_state_is_ended_by_an_event_that_ends_states_and_is_about_as_many_things() {
        for event in TABLE {
            let Told::Until(end) = event.told else { continue };
            let end = find(end).unwrap();
            assert_eq!(end.told, Told::End, "{}", event.text);
            assert!(end.severity as u8 > event.severity as u8, "{}", event.text);
            assert!(
                event.is_about() == end.is_about() || end.is_about() == (false, false),
                "{}",
                event.text
            );
        }
    }
}
