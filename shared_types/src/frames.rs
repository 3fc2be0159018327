//! Frames and the quantities that live in them.
//!
//! | frame | axes | origin |
//! |---|---|---|
//! | [`LocalNed`] | x north, y east, z down | the autopilot's local origin |
//! | [`BodyFrd`] | x forward, y right, z down | the vehicle's centre of gravity |
//!
//! Quantities convert to `nalgebra` vectors for mathematics and back at the border of a sample. Rotations are
//! named so that frames cancel: `local_q_body * v_body = v_local`.

use crate::layout::{Layout, ZeroCopySend, hash_number, hash_start};
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
            const LAYOUT_HASH: u64 = hash_number(
                hash_start(stringify!($name), 24, 8),
                hash_start(F::NAME, 0, 0),
            );
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

crate::sample! {
    /// An attitude: the rotation that takes body components to local components (`local_q_body`), w first, unit length.
    #[derive(Clone, Copy, Debug, PartialEq)]
    pub struct Attitude: 32 {
        /// Scalar part.
        pub w: f64,
        /// First imaginary part.
        pub x: f64,
        /// Second imaginary part.
        pub y: f64,
        /// Third imaginary part.
        pub z: f64,
    }
}

impl Default for Attitude {
    fn default() -> Self {
        Self {
            w: 1.0,
            x: 0.0,
            y: 0.0,
            z: 0.0,
        }
    }
}

impl Attitude {
    /// From a unit quaternion that takes body components to local ones.
    pub fn from_rotation(local_q_body: UnitQuaternion<f64>) -> Self {
        Self {
            w: local_q_body.w,
            x: local_q_body.i,
            y: local_q_body.j,
            z: local_q_body.k,
        }
    }

    /// As a unit quaternion (normalised; identity if the stored numbers are no rotation).
    pub fn rotation(self) -> UnitQuaternion<f64> {
        let raw = Quaternion::new(self.w, self.x, self.y, self.z);
        let norm = raw.norm();
        if norm.is_finite() && norm > 1e-6 {
            UnitQuaternion::new_normalize(raw)
        } else {
            UnitQuaternion::identity()
        }
    }

    /// Heading (rad), -pi..pi, clockwise from north seen from above (3-2-1 Euler yaw).
    pub fn yaw_rad(self) -> f64 {
        (2.0 * (self.w * self.z + self.x * self.y)).atan2(1.0 - 2.0 * (self.y * self.y + self.z * self.z))
    }
}

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
    use super::{Attitude, wrap_pi};
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
        fn wrapping_keeps_the_direction(angle in -1e3..1e3f64) {
            let wrapped = wrap_pi(angle);
            prop_assert!((-PI..PI).contains(&wrapped));
            prop_assert!((wrapped.sin() - angle.sin()).abs() < 1e-9);
            prop_assert!((wrapped.cos() - angle.cos()).abs() < 1e-9);
        }
    }

    #[test]
    fn nonsense_is_no_rotation() {
        let bad = Attitude {
            w: f64::NAN,
            x: 0.0,
            y: 0.0,
            z: 0.0,
        };
        assert_eq!(bad.rotation(), UnitQuaternion::identity());
    }
}
