//! One flight as data: everything that was seen of it, in seconds since its begin.

use jink_shared_types::frames::{LocalNed, Point};
use jink_shared_types::geo::{GlobalPoint, Projection};
use jink_shared_types::vehicle::NavMode;
use mavlink::dialect::{MavCmd, MavResult};
use nalgebra::Vector3;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Instant;

/// The true state at one time. Places are in the frame of the world, which is the autopilot's local frame at the start.
#[derive(Clone, Copy, Debug)]
pub struct Truth {
    /// When (s).
    pub at_s: f64,
    /// Where.
    pub place: Point<LocalNed>,
    /// How fast (m/s).
    pub velocity_mps: Vector3<f64>,
    /// Distance from the vehicle's centre to the nearest surface (m).
    pub clearance_m: f64,
}

impl Truth {
    /// Over the ground and vertically (m/s).
    pub fn speed_mps(&self) -> f64 {
        self.velocity_mps.norm()
    }
}

/// What the autopilot said of itself.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mode {
    /// Its number on the wire.
    pub custom: u32,
    /// The mode.
    pub mode: NavMode,
    /// The motors run.
    pub is_armed: bool,
}

/// A text for the pilot.
#[derive(Clone, Debug)]
pub struct Text {
    /// When (s).
    pub at_s: f64,
    /// MAV_SEVERITY.
    pub severity: u8,
    /// Who says it: jink or the autopilot.
    pub is_jinks: bool,
    /// What.
    pub text: String,
}

/// Somebody asked for a mode.
#[derive(Clone, Copy, Debug)]
pub struct ModeRequest {
    /// When (s).
    pub at_s: f64,
    /// Jink, or else the station.
    pub is_jinks: bool,
    /// Which one; `None` = whatever the command leads to (a go-to, a return, the start of a mission).
    pub mode: Option<NavMode>,
}

/// Frames of one type at the station's port.
#[derive(Clone, Copy, Debug, Default)]
pub struct Share {
    /// Frames.
    pub frames: u64,
    /// Bytes.
    pub bytes: u64,
}

/// The whole.
#[derive(Debug)]
pub struct Record {
    begin: Instant,
    /// True states, 25 to 50 in a second.
    pub truth: Vec<Truth>,
    /// Modes of the autopilot, one for each change.
    pub modes: Vec<(f64, Mode)>,
    /// The autopilot's last heartbeat (s).
    pub heartbeat_s: f64,
    /// Modes that were asked for.
    pub requests: Vec<ModeRequest>,
    /// Texts.
    pub texts: Vec<Text>,
    /// When setpoints passed on their way to the autopilot (s).
    pub setpoints_s: Vec<f64>,
    /// Whether component 196 says ACTIVE, one for each change.
    pub active: Vec<(f64, bool)>,
    /// Bytes at the station's port while the motors run, by sender (autopilot or not) and message type.
    pub radio: BTreeMap<(bool, u32), Share>,
    /// Time over which they came (s).
    pub radio_time_s: f64,
    /// Acknowledgements at the station.
    pub acks: Vec<(f64, MavCmd, MavResult)>,
    /// Parameters as the autopilot reports them.
    pub parameters: BTreeMap<String, f32>,
    /// The current mission item, one for each change.
    pub current: Vec<(f64, u16)>,
    /// The autopilot's own position, local and global.
    pub local: Option<Point<LocalNed>>,
    /// The same on the globe, with its height above mean sea level (m).
    pub global: Option<(GlobalPoint, f64)>,
    /// Version of the firmware.
    pub version: Option<String>,
    /// Times between which the link was cut or jink was down on purpose (s).
    pub silences_s: Vec<(f64, f64)>,
    /// Set once the ground is known: puts truth into the frame of the world.
    frame: Option<(Projection, Vector3<f64>)>,
    /// First true place on the globe and its height (m).
    first: Option<(GlobalPoint, f64)>,
    /// The last true state before that.
    raw: Option<(GlobalPoint, f64)>,
}

impl Record {
    fn new() -> Self {
        Self {
            begin: Instant::now(),
            truth: Vec::new(),
            modes: Vec::new(),
            heartbeat_s: f64::NEG_INFINITY,
            requests: Vec::new(),
            texts: Vec::new(),
            setpoints_s: Vec::new(),
            active: Vec::new(),
            radio: BTreeMap::new(),
            radio_time_s: 0.0,
            acks: Vec::new(),
            parameters: BTreeMap::new(),
            current: Vec::new(),
            local: None,
            global: None,
            version: None,
            silences_s: Vec::new(),
            frame: None,
            first: None,
            raw: None,
        }
    }

    /// Time since the begin (s).
    pub fn now_s(&self) -> f64 {
        self.begin.elapsed().as_secs_f64()
    }

    /// A true state on the globe, `up_m` above an arbitrary level.
    pub fn see_truth(
        &mut self,
        global: GlobalPoint,
        up_m: f64,
        velocity_mps: Vector3<f64>,
        clearance: &dyn Fn(Point<LocalNed>) -> f64,
    ) {
        let at_s = self.now_s();
        self.first.get_or_insert((global, up_m));
        self.raw = Some((global, up_m));
        let Some((projection, offset)) = &self.frame else {
            return;
        };
        let Some((_, first_up_m)) = self.first else {
            return;
        };
        let level = projection.to_local(global);
        let place = Point::new(
            level.x + offset.x,
            level.y + offset.y,
            first_up_m - up_m + offset.z,
        );
        self.truth.push(Truth {
            at_s,
            place,
            velocity_mps,
            clearance_m: clearance(place),
        });
    }

    /// From now on truth is in the frame of the world: the vehicle stands where the autopilot believes it to be, on the ground.
    pub fn fix_frame(&mut self) -> bool {
        let (Some((first, first_up_m)), Some((global, up_m)), Some(local)) =
            (self.first, self.raw, self.local)
        else {
            return false;
        };
        let projection = Projection::new(first);
        let level = projection.to_local(global);
        // The world's ground is at zero, and that is where the vehicle stands, whatever the estimated height says.
        let offset = Vector3::new(local.x_m - level.x, local.y_m - level.y, up_m - first_up_m);
        self.frame = Some((projection, offset));
        true
    }

    /// The newest true state.
    pub fn last(&self) -> Option<&Truth> {
        self.truth.last()
    }

    /// The mode now.
    pub fn mode(&self) -> Mode {
        let unknown = Mode {
            custom: 0,
            mode: NavMode::Unknown,
            is_armed: false,
        };
        self.modes.last().map_or(unknown, |(_, mode)| *mode)
    }

    /// The mode at a time.
    pub fn mode_at(&self, at_s: f64) -> Option<Mode> {
        let before = self.modes.partition_point(|(since_s, _)| *since_s <= at_s);
        before.checked_sub(1).map(|index| self.modes[index].1)
    }

    /// A heartbeat of the autopilot.
    pub fn see_mode(&mut self, mode: Mode) {
        let now_s = self.now_s();
        self.heartbeat_s = now_s;
        if self.mode() != mode || self.modes.is_empty() {
            self.modes.push((now_s, mode));
        }
    }

    /// A text; the same one from several links within two seconds is one.
    pub fn see_text(&mut self, severity: u8, is_jinks: bool, text: &str) {
        let at_s = self.now_s();
        let is_known = self
            .texts
            .iter()
            .rev()
            .take_while(|known| at_s - known.at_s < 2.0)
            .any(|known| known.text == text);
        if !is_known && !text.is_empty() {
            self.texts.push(Text {
                at_s,
                severity,
                is_jinks,
                text: text.to_owned(),
            });
        }
    }

    /// Whether component 196 says ACTIVE.
    pub fn is_active(&self) -> bool {
        self.active.last().is_some_and(|(_, active)| *active)
    }

    /// A heartbeat of component 196.
    pub fn see_active(&mut self, active: bool) {
        if self.active.is_empty() || self.is_active() != active {
            self.active.push((self.now_s(), active));
        }
    }

    /// The current item.
    pub fn see_current(&mut self, item: u16) {
        if self.current.last().is_none_or(|(_, last)| *last != item) {
            self.current.push((self.now_s(), item));
        }
    }

    /// Whether it has stood within `radius_m` for the last `for_s`.
    pub fn rests(&self, for_s: f64, radius_m: f64) -> bool {
        let Some(last) = self.last() else { return false };
        let since_s = self.now_s() - for_s;
        let begin = self.truth.partition_point(|truth| truth.at_s < since_s);
        begin > 0
            && self.truth[begin..]
                .iter()
                .all(|truth| (truth.place.vector() - last.place.vector()).norm() < radius_m)
    }
}

/// The record as its writers and readers hold it.
#[derive(Clone, Debug)]
pub struct Shared {
    inner: Arc<Mutex<Record>>,
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            inner: Arc::new(Mutex::new(Record::new())),
        }
    }
}

impl Shared {
    /// For as short as possible.
    pub fn lock(&self) -> MutexGuard<'_, Record> {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
