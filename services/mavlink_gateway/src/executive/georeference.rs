//! Where the local frame lies on the globe, learned from the autopilot's two positions, local and global.
//!
//! | in | out |
//! |---|---|
//! | LOCAL_POSITION_NED, GLOBAL_POSITION_INT | origin of the local frame, height of home and of the sea in it |
//! | a mission item | its place in the local frame, with what the autopilot puts in for zeros |
//!
//! Both messages come from one estimate, so one pair would do but for its rounding (1 cm) and for the time between the two. The
//! median over a few pairs is taken, and kept until it has really moved. HOME_POSITION is not used: ArduPilot leaves its local
//! part zero wherever home is.

use super::client::Item;
use crate::vehicle::MAX_COORDINATE_M;
use jink_mavlink_link::autopilot_type::AutopilotType;
use jink_shared_types::geo::{GlobalPoint, Projection};
use mavlink::dialect::{GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, MavCmd, MavFrame};
use nalgebra::{Vector2, Vector3};

/// Pairs in the median.
const PAIRS: usize = 9;
/// Pairs needed before anything is said.
const NEEDED: usize = 3;
/// Time between the two messages of a pair (s): the velocity carries over this much.
const APART_S: f64 = 0.2;
/// A place that has moved by less is the same (m), so that goals do not tremble.
const MOVED_M: f64 = 0.1;

/// What one pair says, or the median of several.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Fix {
    /// The local origin, north and east of the anchor (m).
    origin: Vector2<f64>,
    /// Home in the local frame, as down coordinate (m).
    home_down_m: f64,
    /// Mean sea level, likewise (m).
    sea_down_m: f64,
}

impl Fix {
    fn is_near(&self, other: &Self) -> bool {
        (self.origin - other.origin).norm() <= MOVED_M
            && (self.home_down_m - other.home_down_m).abs() <= MOVED_M
            && (self.sea_down_m - other.sea_down_m).abs() <= MOVED_M
    }
}

#[derive(Clone, Copy, Debug)]
struct Local {
    boot_ms: u32,
    position: Vector3<f64>,
    velocity: Vector3<f64>,
}

/// Knows the place of the local frame.
#[derive(Clone, Debug, Default)]
pub struct Georeference {
    local: Option<Local>,
    anchor: Option<Projection>,
    pairs: [Option<Fix>; PAIRS],
    next: usize,
    reported: Option<(Fix, Projection)>,
}

impl Georeference {
    /// Takes a local position.
    pub fn take_local(&mut self, message: &LOCAL_POSITION_NED_DATA) {
        let position = Vector3::new(message.x, message.y, message.z).map(f64::from);
        let velocity = Vector3::new(message.vx, message.vy, message.vz).map(f64::from);
        let sane = position
            .iter()
            .chain(&velocity)
            .all(|c| c.abs() <= MAX_COORDINATE_M);
        self.local = sane.then_some(Local {
            boot_ms: message.time_boot_ms,
            position,
            velocity,
        });
    }

    /// Takes a global position and pairs it with the last local one.
    pub fn take_global(&mut self, message: &GLOBAL_POSITION_INT_DATA) {
        let Some(local) = self.local else { return };
        let apart_s = f64::from(message.time_boot_ms.wrapping_sub(local.boot_ms) as i32) * 1e-3;
        if apart_s.abs() > APART_S || (message.lat, message.lon) == (0, 0) {
            return;
        }
        let here = local.position + local.velocity * apart_s;
        let global = GlobalPoint::from_e7(message.lat, message.lon);
        let anchor = *self.anchor.get_or_insert_with(|| Projection::new(global));
        self.pairs[self.next] = Some(Fix {
            origin: anchor.to_local(global) - here.xy(),
            home_down_m: here.z + f64::from(message.relative_alt) * 1e-3,
            sea_down_m: here.z + f64::from(message.alt) * 1e-3,
        });
        self.next = (self.next + 1) % PAIRS;
        if let Some(fix) = self.median()
            && self.reported.is_none_or(|(reported, _)| !reported.is_near(&fix))
        {
            self.reported = Some((fix, Projection::new(anchor.to_global(fix.origin))));
        }
    }

    fn median(&self) -> Option<Fix> {
        let mut values = [0.0; PAIRS];
        let mut of = |pick: fn(&Fix) -> f64| {
            let mut count = 0;
            for (value, fix) in values.iter_mut().zip(self.pairs.iter().flatten()) {
                *value = pick(fix);
                count += 1;
            }
            let known = &mut values[..count];
            known.sort_unstable_by(f64::total_cmp);
            (count >= NEEDED).then(|| known[count / 2])
        };
        Some(Fix {
            origin: Vector2::new(of(|fix| fix.origin.x)?, of(|fix| fix.origin.y)?),
            home_down_m: of(|fix| fix.home_down_m)?,
            sea_down_m: of(|fix| fix.sea_down_m)?,
        })
    }

    /// Home in the local frame, as down coordinate (m).
    pub fn home_down_m(&self) -> Option<f64> {
        self.reported.map(|(fix, _)| fix.home_down_m)
    }

    /// Whether places on the globe can be converted to the local frame.
    pub fn is_known(&self) -> bool {
        self.reported.is_some()
    }

    /// Where `item` leads in the local frame (m) from `from`; `None` while the frame's place is not known, for a frame that needs
    /// the terrain, and for an item that names no place.
    ///
    /// ArduPilot takes a latitude and a longitude of zero for those, and a height of zero for that, from where the item is begun
    /// (`ModeAuto::loc_from_cmd`), except the height of LOITER_TO_ALT (`do_loiter_to_alt`). It keeps heights in centimetres.
    pub fn place(&self, make: AutopilotType, item: &Item, from: Vector3<f64>) -> Option<Vector3<f64>> {
        if make == AutopilotType::Px4 || item.frame == MavFrame::MAV_FRAME_LOCAL_NED {
            return self.locate(item.frame, (item.x, item.y), item.z_m);
        }
        let is_here = (item.x, item.y) == (0, 0);
        let keeps_height =
            (item.z_m * 100.0).trunc() == 0.0 && item.command != MavCmd::MAV_CMD_NAV_LOITER_TO_ALT;
        let place = self.place_on_globe(item.frame, (item.x, item.y), item.z_m)?;
        let level = if is_here { from.xy() } else { place.xy() };
        let down_m = if keeps_height { from.z } else { place.z };
        within_reach(Vector3::new(level.x, level.y, down_m))
    }

    /// The same for a place in the numbers of a mission item, where zeros are numbers like others.
    pub fn locate(&self, frame: MavFrame, (x, y): (i32, i32), z_m: f32) -> Option<Vector3<f64>> {
        const METRES_PER_UNIT: f64 = 1e-4;
        if frame == MavFrame::MAV_FRAME_LOCAL_NED {
            let level = Vector2::new(x, y).map(f64::from) * METRES_PER_UNIT;
            return within_reach(Vector3::new(level.x, level.y, f64::from(z_m)));
        }
        // Nobody means that place in the sea.
        let place = self.place_on_globe(frame, (x, y), z_m)?;
        ((x, y) != (0, 0)).then_some(place).and_then(within_reach)
    }

    #[allow(deprecated)] // Frames whose names say how a number is sent mean the same as those without.
    fn place_on_globe(&self, frame: MavFrame, (x, y): (i32, i32), z_m: f32) -> Option<Vector3<f64>> {
        let (fix, projection) = self.reported?;
        let level = projection.to_local(GlobalPoint::from_e7(x, y));
        let zero_down_m = match frame {
            MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT | MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT_INT => {
                fix.home_down_m
            }
            MavFrame::MAV_FRAME_GLOBAL | MavFrame::MAV_FRAME_GLOBAL_INT => fix.sea_down_m,
            _ => return None,
        };
        Some(Vector3::new(level.x, level.y, zero_down_m - f64::from(z_m)))
    }
}

/// A place that a vehicle can fly to.
fn within_reach(place: Vector3<f64>) -> Option<Vector3<f64>> {
    place.iter().all(|c| c.abs() <= MAX_COORDINATE_M).then_some(place)
}

#[cfg(test)]
mod tests {
    use super::{AutopilotType, Georeference, Item};
    use jink_shared_types::geo::{GlobalPoint, Projection};
    use mavlink::dialect::{GLOBAL_POSITION_INT_DATA, LOCAL_POSITION_NED_DATA, MavCmd, MavFrame};
    use nalgebra::{Vector2, Vector3};
    use proptest::prelude::*;

    fn item(frame: MavFrame, (x, y): (i32, i32), z_m: f32) -> Item {
        Item {
            sequence: 1,
            command: MavCmd::MAV_CMD_NAV_WAYPOINT,
            frame,
            params: [0.0; 4],
            x,
            y,
            z_m,
            autocontinue: true,
        }
    }

    /// Flies along a line and reports both positions, the global one 33 ms after the local one.
    fn flown(origin: GlobalPoint, home_down_m: f64, velocity: Vector3<f64>, pairs: u32) -> Georeference {
        let projection = Projection::new(origin);
        let mut georeference = Georeference::default();
        for i in 0..pairs {
            let boot_ms = 5_000 + i * 200;
            let at = |ms: u32| Vector3::new(3.0, -8.0, -4.0) + velocity * (f64::from(ms - 5_000) * 1e-3);
            let local = at(boot_ms);
            georeference.take_local(&LOCAL_POSITION_NED_DATA {
                time_boot_ms: boot_ms,
                x: local.x as f32,
                y: local.y as f32,
                z: local.z as f32,
                vx: velocity.x as f32,
                vy: velocity.y as f32,
                vz: velocity.z as f32,
            });
            let later = at(boot_ms + 33);
            let (lat, lon) = projection.to_global(later.xy()).to_e7();
            georeference.take_global(&GLOBAL_POSITION_INT_DATA {
                time_boot_ms: boot_ms + 33,
                lat,
                lon,
                alt: ((488.0 - later.z) * 1e3) as i32,
                relative_alt: ((home_down_m - later.z) * 1e3) as i32,
                ..GLOBAL_POSITION_INT_DATA::default()
            });
        }
        georeference
    }

    proptest! {
        #[test]
        fn an_item_lies_where_the_autopilot_would_fly_it(
            latitude in -60.0..60.0f64, longitude in -179.0..179.0f64,
            (north, east, height_m) in (-800.0..800.0f64, -800.0..800.0f64, 1.0..100.0f32),
            (vx, vy) in (-8.0..8.0f64, -8.0..8.0f64),
            home_down_m in -20.0..20.0f64,
        ) {
            let origin = GlobalPoint { latitude_deg: latitude, longitude_deg: longitude };
            let georeference = flown(origin, home_down_m, Vector3::new(vx, vy, 0.1), 30);
            let at = Projection::new(origin).to_global(Vector2::new(north, east)).to_e7();
            let relative = georeference.place(AutopilotType::Px4, &item(MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT, at, height_m), Vector3::zeros()).unwrap();
            let wanted = Vector3::new(north, east, home_down_m - f64::from(height_m));
            prop_assert!((relative - wanted).norm() < 0.1, "{relative} instead of {wanted}");
            let above_sea = georeference.place(AutopilotType::Px4, &item(MavFrame::MAV_FRAME_GLOBAL, at, 488.0 + height_m), Vector3::zeros()).unwrap();
            prop_assert!((above_sea - Vector3::new(north, east, -f64::from(height_m))).norm() < 0.1);
        }

        #[test]
        fn whatever_the_message_a_place_is_finite(
            boot_ms: u32, lat: i32, lon: i32, alt: i32, numbers in prop::array::uniform6(any::<f32>()), x: i32, y: i32, z_m: f32,
        ) {
            let mut georeference = flown(GlobalPoint { latitude_deg: 47.0, longitude_deg: 8.0 }, 0.0, Vector3::zeros(), 4);
            let [px, py, pz, vx, vy, vz] = numbers;
            for time_boot_ms in [boot_ms, 5_300] {
                georeference.take_local(&LOCAL_POSITION_NED_DATA { time_boot_ms, x: px, y: py, z: pz, vx, vy, vz });
                for _ in 0..5 {
                    georeference.take_global(&GLOBAL_POSITION_INT_DATA { time_boot_ms, lat, lon, alt, relative_alt: alt, ..Default::default() });
                }
            }
            for frame in [MavFrame::MAV_FRAME_GLOBAL, MavFrame::MAV_FRAME_LOCAL_NED, MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT] {
                let place = georeference.place(AutopilotType::Px4, &item(frame, (x, y), z_m), Vector3::zeros());
                prop_assert!(place.is_none_or(|place| place.iter().all(|c| c.is_finite())));
            }
        }
    }

    #[test]
    fn nothing_is_reported_before_a_few_pairs_and_small_changes_do_not_move_a_place() {
        let origin = GlobalPoint {
            latitude_deg: 47.4,
            longitude_deg: 8.5,
        };
        let at = origin.to_e7();
        let frame = MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT;
        let mut few = flown(origin, 0.0, Vector3::zeros(), 2);
        assert_eq!(
            few.place(AutopilotType::Px4, &item(frame, at, 5.0), Vector3::zeros()),
            None
        );
        few = flown(origin, 0.0, Vector3::zeros(), 3);
        let before = few
            .place(AutopilotType::Px4, &item(frame, at, 5.0), Vector3::zeros())
            .unwrap();
        for i in 0..50u32 {
            few.take_global(&GLOBAL_POSITION_INT_DATA {
                time_boot_ms: 5_400 + i,
                lat: at.0 + 270 + (i % 3) as i32,
                lon: at.1 - 1_063,
                alt: 492_000,
                relative_alt: 4_000,
                ..GLOBAL_POSITION_INT_DATA::default()
            });
        }
        assert_eq!(
            few.place(AutopilotType::Px4, &item(frame, at, 5.0), Vector3::zeros()),
            Some(before)
        );
    }

    #[test]
    fn what_names_no_place_has_none() {
        let origin = GlobalPoint {
            latitude_deg: 47.4,
            longitude_deg: 8.5,
        };
        let known = flown(origin, 0.0, Vector3::zeros(), 9);
        let terrain = MavFrame::MAV_FRAME_GLOBAL_TERRAIN_ALT;
        assert_eq!(
            known.place(
                AutopilotType::Px4,
                &item(terrain, origin.to_e7(), 5.0),
                Vector3::zeros()
            ),
            None
        );
        let relative = MavFrame::MAV_FRAME_GLOBAL_RELATIVE_ALT;
        assert_eq!(
            known.place(AutopilotType::Px4, &item(relative, (0, 0), 5.0), Vector3::zeros()),
            None
        );
        assert_eq!(
            known.place(
                AutopilotType::Px4,
                &item(relative, origin.to_e7(), f32::NAN),
                Vector3::zeros()
            ),
            None
        );
        let local = known.place(
            AutopilotType::Px4,
            &item(MavFrame::MAV_FRAME_LOCAL_NED, (120_000, -5_000), -3.0),
            Vector3::zeros(),
        );
        assert_eq!(local, Some(Vector3::new(12.0, -0.5, -3.0)));
    }
}
