//! What flies the vehicle, whichever autopilot it is.
//!
//! | in | out |
//! |---|---|
//! | [`Packet`]s received on two links | [`Packet`]s to send, the truth about the flight |
//!
//! Processes, lock-step flights and the [`Observer`](crate::truth::Observer) speak to this and need not know the make.

use crate::ardupilot::{Abort, ArduCopter};
use crate::autopilot::{Autopilot, MissionProgress, Packet, SetpointStatistics};
use crate::vehicle::VehicleTruth;
use crate::vehicle::estimator::Estimate;
use jink_shared_types::vehicle::NavMode;
use nalgebra::Vector3;

/// An autopilot with the vehicle it flies.
pub trait Flyer {
    /// 4 ms: takes `inbox`, flies, and appends what it has to say to `outbox`.
    fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>);

    /// Time since boot (s).
    fn time_s(&self) -> f64;

    /// Where the vehicle really is.
    fn truth(&self) -> &VehicleTruth;

    /// Where it believes to be.
    fn estimate(&self) -> &Estimate;

    /// Mode in force.
    fn mode(&self) -> NavMode;

    /// Motors armed.
    fn is_armed(&self) -> bool;

    /// On the ground, as the land detector says.
    fn is_landed(&self) -> bool;

    /// How far the mission has come.
    fn mission(&self) -> MissionProgress;

    /// What arrived from the companion.
    fn setpoint_statistics(&self) -> &SetpointStatistics;

    /// Lets the estimated position jump by `by` (m, local NED), as a reset of the estimator does.
    fn jump_estimate(&mut self, by: Vector3<f64>);

    /// How often it fell to Hold because its companion failed it: only PX4 does.
    fn hold_count(&self) -> u32 {
        0
    }

    /// What ended the autopilot's process, if something did.
    fn aborted(&self) -> Option<Abort> {
        None
    }
}

macro_rules! delegate {
    ($of:ty { $($rest:tt)* }) => {
        impl Flyer for $of {
            fn step(&mut self, inbox: &[Packet], outbox: &mut Vec<Packet>) {
                self.step(inbox, outbox);
            }

            fn time_s(&self) -> f64 {
                self.time_s()
            }

            fn truth(&self) -> &VehicleTruth {
                self.truth()
            }

            fn estimate(&self) -> &Estimate {
                self.estimate()
            }

            fn mode(&self) -> NavMode {
                self.mode()
            }

            fn is_armed(&self) -> bool {
                self.is_armed()
            }

            fn is_landed(&self) -> bool {
                self.is_landed()
            }

            fn mission(&self) -> MissionProgress {
                self.mission()
            }

            fn setpoint_statistics(&self) -> &SetpointStatistics {
                self.setpoint_statistics()
            }

            fn jump_estimate(&mut self, by: Vector3<f64>) {
                self.jump_estimate(by);
            }

            $($rest)*
        }
    };
}

delegate!(Autopilot {
    fn hold_count(&self) -> u32 {
        self.hold_count()
    }
});

delegate!(ArduCopter {
    fn aborted(&self) -> Option<Abort> {
        self.aborted()
    }
});
