//! A sample comes from another process, which may write anything: judging it never panics, and what the makers of
//! samples in this crate write is plausible.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_shared_types::beams::{BeamReading, ObstacleDistance, ROW};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::health::{Heartbeat, SystemStatus};
use jink_shared_types::layout::Layout;
use jink_shared_types::map::{CELL_M, LocalMap};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{PointCloud, RangeScan, ScanFrame};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::sample::zeroed_box;
use jink_shared_types::shape::Shape;
use jink_shared_types::topics::{self, TABLE, Topic, Visitor};
use jink_shared_types::vehicle::{DesiredPath, VehicleState};
use jink_shared_types::{Flag, Point};
use proptest::prelude::*;
use std::fmt::Debug;

/// Words that are interesting as a part of something: NaN and infinities of both sizes, large counts, negative numbers.
fn word() -> impl Strategy<Value = u64> {
    prop_oneof![
        any::<u64>(),
        prop::sample::select(vec![
            0,
            1,
            u64::MAX,
            f64::NAN.to_bits(),
            f64::INFINITY.to_bits(),
            f64::NEG_INFINITY.to_bits(),
            (-1.0f64).to_bits(),
            1e300f64.to_bits(),
            0x7fc0_0000_7fc0_0000,
            0xff80_0000_7f80_0000,
            0xffff_ffff_0000_0000,
        ]),
    ]
}

/// Judges a sample whose bytes are `words` again and again; its lists, which are used like those of a good one, must
/// hold, too.
struct Garbage<'a>(&'a [u64]);

impl Visitor for Garbage<'_> {
    type Output = bool;
    fn visit<T: Layout + Debug + 'static>(self, _: Topic<T>) -> bool {
        let mut sample = zeroed_box::<T>();
        let bytes = self.0.iter().flat_map(|word| word.to_ne_bytes()).cycle();
        #[allow(unsafe_code)]
        // SAFETY: `Layout` promises that every bit pattern is a valid value, and that there is no padding.
        let memory = unsafe {
            std::slice::from_raw_parts_mut(std::ptr::from_mut(&mut *sample).cast::<u8>(), size_of::<T>())
        };
        memory.iter_mut().zip(bytes).for_each(|(to, from)| *to = from);
        sample.is_plausible()
    }
}

/// Whether samples of nothing but zeros, of ones (which are NaN), and of infinities are plausible.
fn judge(row: &topics::TopicRow) -> [bool; 3] {
    [0, u64::MAX, f64::INFINITY.to_bits()].map(|word| topics::visit(row, Garbage(&[word])).unwrap())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn no_bytes_make_it_panic(words in prop::collection::vec(word(), 1..40)) {
        for row in TABLE {
            prop_assert!(topics::visit(row, Garbage(&words)).is_some());
        }
    }

    #[test]
    fn a_beam_that_is_taken_is_plausible(
        range_min_m in any::<f32>(), range_max_m in any::<f32>(), range_m in any::<f32>(), quality in any::<i8>(),
        orientation in 0..=101u8, opening_rad in any::<f32>(), quaternion in any::<[f32; 4]>(),
    ) {
        let reading =
            BeamReading { range_min_m, range_max_m, range_m, quality, orientation, opening_rad, quaternion };
        let mut scan = RangeScan::default();
        if reading.write(&mut scan).is_ok() {
            prop_assert!(scan.is_plausible(), "{reading:?}");
        }
    }

    #[test]
    fn a_row_that_is_taken_is_plausible(
        increment_deg in prop_oneof![any::<f32>(), 0.0..360.0f32], offset_deg in any::<f32>(), min_cm in any::<u16>(),
        max_cm in any::<u16>(), distance_cm in any::<u16>(), is_north in any::<bool>(),
    ) {
        let row = ObstacleDistance {
            frame: if is_north { ScanFrame::North } else { ScanFrame::Level },
            increment_deg, offset_deg, min_cm, max_cm,
            distances_cm: [distance_cm; ROW],
        };
        let mut scan = RangeScan::default();
        if row.write(&mut scan).is_ok() {
            prop_assert!(scan.is_plausible(), "{row:?}");
        }
    }
}

#[test]
fn every_payload_is_a_sample_that_can_be_distinguished_from_garbage() {
    struct IsSample;
    impl Visitor for IsSample {
        type Output = bool;
        fn visit<T: Layout + Debug + 'static>(self, _: Topic<T>) -> bool {
            matches!(T::SHAPE, Shape::Struct(_))
        }
    }
    for row in TABLE {
        assert_eq!(topics::visit(row, IsSample), Some(true), "{}", row.name);
        // A state whose position is not valid may hold anything, a desired path NaN.
        assert_ne!(judge(row), [true; 3], "{}: no number is looked at", row.name);
    }
}

#[test]
fn what_is_written_by_default_is_plausible() {
    assert!(DesiredPath::default().is_plausible(), "nothing is given");
    assert!(SectorRing::default().is_plausible(), "nothing is known");
    assert!(SystemStatus::default().is_plausible());
    assert!(Heartbeat::default().is_plausible());
    assert!(VehicleState::default().is_plausible());
    assert!(ParameterValues::of(&ParamSet::default()).is_plausible());
    assert!(LocalMap::boxed().is_plausible());
    for event in events::TABLE {
        assert!(EventSample::new(event, "planner", [f64::NAN, 1.0]).is_plausible());
    }
}

#[test]
fn a_map_of_other_cells_is_not() {
    let mut map = LocalMap::boxed();
    map.cell_m = 0.5 * CELL_M;
    assert!(!map.is_plausible());
}

#[test]
fn a_position_without_an_attitude_is_not() {
    let mut state = VehicleState {
        position_valid: Flag::YES,
        ..VehicleState::default()
    };
    assert!(state.is_plausible());
    state.attitude.w = f64::NAN;
    assert!(!state.is_plausible());
    state.position_valid = Flag::NO;
    assert!(state.is_plausible(), "nobody may use it");
}

#[test]
fn a_description_that_is_no_sensors_is_not() {
    let good = RangeScan {
        beams: 360,
        angle_step_rad: 0.01745,
        beam_width_rad: 0.01745,
        range_max_m: 12.0,
        ..RangeScan::default()
    };
    assert!(good.is_plausible());
    let broken: [fn(&mut RangeScan); 12] = [
        |scan| scan.beams = 1_025,
        |scan| scan.angle_first_rad = 1e30,
        |scan| scan.angle_step_rad = f32::NAN,
        |scan| scan.beam_interval_s = -1e-3,
        |scan| scan.beam_interval_s = 0.1,
        |scan| scan.beam_width_rad = 7.0,
        |scan| scan.mounting.w = f64::INFINITY,
        |scan| scan.origin = Point::UNSET,
        |scan| scan.origin.y_m = 40.0,
        |scan| scan.range_min_m = -0.1,
        |scan| scan.range_max_m = 0.0,
        |scan| scan.range_sigma_m = f32::NAN,
    ];
    for (i, break_it) in broken.iter().enumerate() {
        let mut scan = good;
        break_it(&mut scan);
        assert!(!scan.is_plausible(), "{i}");
    }
    let mut cloud = PointCloud::boxed();
    cloud.range_max_m = 40.0;
    assert!(cloud.is_plausible());
    cloud.len = u32::MAX;
    assert!(!cloud.is_plausible());
}
