//! Frames and the quantities that live in them.
//!
//! | frame | axes | origin |
//! |---|---|---|
//! | [`LocalNed`] | x north, y east, z down | the autopilot's local origin |
//! | [`BodyFrd`] | x forward, y right, z down | the vehicle's centre of gravity |
//! | [`SensorFrd`] | x along the line of sight, y right, z down | the sensor |
//!
//! Quantities convert to `nalgebra` vectors for mathematics and back at the border of a sample. Rotations are
//! named so that frames cancel: `local_q_body * v_body = v_local`.

use crate::layout::{Layout, ZeroCopySend};
use crate::shape::{QuantityShape, Shape};
use nalgebra::{Quaternion, UnitQuaternion, Vector3};
use std::fmt;
use std::marker::PhantomData;

/// A coordinate frame; implemented by marker types only.
pub trait Frame: Copy + 'static {
    /// The frame's name, part of the layout hash.
    const NAME: &'static str;
}

/// North, east, down; origin where the autopilot's estimator puts it (MAV_FRAME_LOCAL_NED).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LocalNed;
impl Frame for LocalNed {
    const NAME: &'static str = "LocalNed";
}

/// Forward, right, down; fixed to the vehicle's body (MAV_FRAME_BODY_FRD).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BodyFrd;
impl Frame for BodyFrd {
    const NAME: &'static str = "BodyFrd";
}

/// Along the line of sight, right, down as the sensor itself has them; fixed to the sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SensorFrd;
impl Frame for SensorFrd {
    const NAME: &'static str = "SensorFrd";
}

macro_rules! quantity {
    ($(#[$meta:meta])* $name:ident, $unit:literal, $x:ident, $y:ident, $z:ident) => {
        $(#[$meta])*
        #[repr(C)]
        pub struct $name<F> {
            #[doc = concat!("First axis of the frame (", $unit, ").")]
            pub $x: f64,
            #[doc = concat!("Second axis of the frame (", $unit, ").")]
            pub $y: f64,
            #[doc = concat!("Third axis of the frame (", $unit, ").")]
            pub $z: f64,
            frame: PhantomData<F>,
        }

        impl<F: Frame> $name<F> {
            #[doc = concat!("All components zero (", $unit, ").")]
            pub const ZERO: Self = Self::new(0.0, 0.0, 0.0);
            #[doc = concat!("All components NaN: \"not given\" (", $unit, ").")]
            pub const UNSET: Self = Self::new(f64::NAN, f64::NAN, f64::NAN);

            #[doc = concat!("From the three components (", $unit, ") along the frame's axes.")]
            pub const fn new($x: f64, $y: f64, $z: f64) -> Self {
                Self { $x, $y, $z, frame: PhantomData }
            }

            #[doc = concat!("From a vector whose components are in this frame (", $unit, ").")]
            pub fn from_vector(v: Vector3<f64>) -> Self {
                Self::new(v.x, v.y, v.z)
            }

            #[doc = concat!("As a vector (", $unit, "), frame no longer tracked.")]
            pub fn vector(self) -> Vector3<f64> {
                Vector3::new(self.$x, self.$y, self.$z)
            }

            /// Whether all three components are finite.
            pub fn is_finite(self) -> bool {
                self.$x.is_finite() && self.$y.is_finite() && self.$z.is_finite()
            }
        }

        impl<F> Clone for $name<F> {
            fn clone(&self) -> Self {
                *self
            }
        }
        impl<F> Copy for $name<F> {}
        impl<F: Frame> Default for $name<F> {
            fn default() -> Self {
                Self::ZERO
            }
        }
        impl<F> PartialEq for $name<F> {
            fn eq(&self, other: &Self) -> bool {
                self.$x == other.$x && self.$y == other.$y && self.$z == other.$z
            }
        }
        impl<F: Frame> fmt::Debug for $name<F> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                write!(f, "{}({}, {}, {})", F::NAME, self.$x, self.$y, self.$z)
            }
        }

        #[allow(unsafe_code)]
        // SAFETY: three f64 in repr(C); the marker has no size.
        unsafe impl<F: Frame> ZeroCopySend for $name<F> {}
        #[allow(unsafe_code)]
        // SAFETY: three f64 in repr(C): no padding, every pattern valid.
        unsafe impl<F: Frame> Layout for $name<F> {
            const SHAPE: Shape = Shape::Quantity(QuantityShape {
                name: stringify!($name),
                unit: $unit,
                frame: F::NAME,
                components: [stringify!($x), stringify!($y), stringify!($z)],
            });
        }
        const _: () = assert!(size_of::<$name<LocalNed>>() == 24);
    };
}

quantity!(
    /// A place in frame `F`, metres.
    Point, "m", x_m, y_m, z_m
);
quantity!(
    /// A velocity in frame `F`, metres per second.
    Velocity, "m/s", x_mps, y_mps, z_mps
);
quantity!(
    /// An acceleration in frame `F`, metres per second squared.
    Acceleration, "m/s^2", x_mps2, y_mps2, z_mps2
);
quantity!(
    /// Angular rates about the axes of frame `F`, radians per second.
    AngularRate, "rad/s", x_radps, y_radps, z_radps
);

/// How much longer or shorter than one the four numbers of a rotation may be: floats on a wire cost 1e-7, a
/// quaternion written down with few decimals up to 1e-2. What is further off is damage.
pub const UNIT_TOLERANCE: f64 = 0.01;

/// The rotation with these components, `w` first; `None` if they are not finite or their length is not one within
/// [`UNIT_TOLERANCE`].
pub fn unit_quaternion([w, x, y, z]: [f64; 4]) -> Option<UnitQuaternion<f64>> {
    let raw = Quaternion::new(w, x, y, z);
    // False for NaN, too.
    ((raw.norm() - 1.0).abs() <= UNIT_TOLERANCE).then(|| UnitQuaternion::new_normalize(raw))
}

/// A rotation that takes components in frame `From` to components in frame `To`: a quaternion of unit length, `w`
/// first. What was read from shared memory may be none, so it is used through [`Rotation::rotation`].
#[repr(C)]
pub struct Rotation<From, To> {
    /// Scalar part.
    pub w: f64,
    /// First imaginary part.
    pub x: f64,
    /// Second imaginary part.
    pub y: f64,
    /// Third imaginary part.
    pub z: f64,
    frames: PhantomData<(From, To)>,
}

/// The vehicle's attitude, `local_q_body`.
pub type Attitude = Rotation<BodyFrd, LocalNed>;

/// How a sensor sits on the vehicle, `body_q_sensor`.
pub type Mounting = Rotation<SensorFrd, BodyFrd>;

impl<From: Frame, To: Frame> Rotation<From, To> {
    /// From the four components as they are, unit length or not.
    pub const fn new(w: f64, x: f64, y: f64, z: f64) -> Self {
        Self {
            w,
            x,
            y,
            z,
            frames: PhantomData,
        }
    }

    /// From a unit quaternion that takes components in `From` to components in `To`.
    pub fn from_rotation(to_q_from: UnitQuaternion<f64>) -> Self {
        Self::new(to_q_from.w, to_q_from.i, to_q_from.j, to_q_from.k)
    }

    /// As a unit quaternion, normalised; `None` if the numbers are no rotation ([`unit_quaternion`]).
    pub fn rotation(self) -> Option<UnitQuaternion<f64>> {
        unit_quaternion([self.w, self.x, self.y, self.z])
    }

    /// Whether the numbers are a rotation.
    pub fn is_rotation(self) -> bool {
        self.rotation().is_some()
    }
}

impl Attitude {
    /// Heading (rad), -pi..pi, clockwise from north seen from above (3-2-1 Euler yaw); NaN if the numbers are no
    /// rotation.
    pub fn yaw_rad(self) -> f64 {
        if self.is_rotation() {
            (2.0 * (self.w * self.z + self.x * self.y)).atan2(1.0 - 2.0 * (self.y * self.y + self.z * self.z))
        } else {
            f64::NAN
        }
    }
}

impl<From, To> Clone for Rotation<From, To> {
    fn clone(&self) -> Self {
        *self
    }
}
impl<From, To> Copy for Rotation<From, To> {}
impl<From: Frame, To: Frame> Default for Rotation<From, To> {
    /// None at all: the axes of both frames coincide.
    fn default() -> Self {
        Self::new(1.0, 0.0, 0.0, 0.0)
    }
}
impl<From, To> PartialEq for Rotation<From, To> {
    fn eq(&self, other: &Self) -> bool {
        [self.w, self.x, self.y, self.z] == [other.w, other.x, other.y, other.z]
    }
}
impl<From: Frame, To: Frame> fmt::Debug for Rotation<From, To> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { w, x, y, z, .. } = self;
        write!(f, "{} from {}({w}, {x}, {y}, {z})", To::NAME, From::NAME)
    }
}

#[allow(unsafe_code)]
// SAFETY: four f64 in repr(C); the marker has no size.
unsafe impl<From: Frame, To: Frame> ZeroCopySend for Rotation<From, To> {}
#[allow(unsafe_code)]
// SAFETY: four f64 in repr(C): no padding, every pattern valid.
unsafe impl<From: Frame, To: Frame> Layout for Rotation<From, To> {
    const SHAPE: Shape = Shape::Rotation {
        from: From::NAME,
        to: To::NAME,
    };
}
const _: () = assert!(size_of::<Attitude>() == 32);

/// The angle `angle_rad` wrapped to [-pi, pi).
pub fn wrap_pi(angle_rad: f64) -> f64 {
    let turns = ((angle_rad + std::f64::consts::PI) / std::f64::consts::TAU).floor();
    let wrapped = angle_rad - turns * std::f64::consts::TAU;
    if wrapped >= std::f64::consts::PI {
        -std::f64::consts::PI
    } else {
        wrapped
    }
}

#[cfg(test)]
mod tests {
    use super::{Attitude, BodyFrd, LocalNed, Mounting, Rotation, wrap_pi};
    use crate::layout::Layout;
    use nalgebra::UnitQuaternion;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    proptest! {
        #[test]
        fn yaw_survives_the_round_trip(roll in -1.0..1.0f64, pitch in -1.0..1.0f64, yaw in -3.1..3.1f64) {
            let attitude = Attitude::from_rotation(UnitQuaternion::from_euler_angles(roll, pitch, yaw));
            prop_assert!((attitude.yaw_rad() - yaw).abs() < 1e-9);
        }

        #[test]
        fn a_rotation_survives_the_round_trip_and_a_length_that_is_nearly_one(
            roll in -3.0..3.0f64, pitch in -1.5..1.5f64, yaw in -3.0..3.0f64, length in 0.991..1.009f64,
        ) {
            let turn = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
            let Mounting { w, x, y, z, .. } = Mounting::from_rotation(turn);
            let read = Mounting::new(w * length, x * length, y * length, z * length).rotation().unwrap();
            prop_assert!(read.angle_to(&turn) < 1e-7);
        }

        #[test]
        fn wrapping_keeps_the_direction(angle in -1e3..1e3f64) {
            let wrapped = wrap_pi(angle);
            prop_assert!((-PI..PI).contains(&wrapped));
            prop_assert!((wrapped.sin() - angle.sin()).abs() < 1e-9);
            prop_assert!((wrapped.cos() - angle.cos()).abs() < 1e-9);
        }
    }

    #[test]
    fn nonsense_is_no_rotation() {
        let bad = [
            Attitude::new(f64::NAN, 0.0, 0.0, 0.0),
            Attitude::new(f64::INFINITY, 0.0, 0.0, 0.0),
            Attitude::new(0.0, 0.0, 0.0, 0.0),
            Attitude::new(1.02, 0.0, 0.0, 0.0),
            Attitude::new(0.98, 0.0, 0.0, 0.0),
        ];
        for attitude in bad {
            assert_eq!(attitude.rotation(), None, "{attitude:?}");
            assert!(attitude.yaw_rad().is_nan(), "{attitude:?}");
        }
    }

    #[test]
    fn frames_are_part_of_the_layout() {
        assert_ne!(Attitude::LAYOUT_HASH, Mounting::LAYOUT_HASH);
        assert_ne!(
            Rotation::<LocalNed, BodyFrd>::LAYOUT_HASH,
            Rotation::<BodyFrd, LocalNed>::LAYOUT_HASH
        );
    }
}
