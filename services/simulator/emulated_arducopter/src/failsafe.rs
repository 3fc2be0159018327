//! The lost ground station: FS_GCS_ENABLE.
//!
//! Only heartbeats of the system MAV_GCS_SYSID count; a companion's do not. A station never seen is not missed.
//! When it comes back the mode stays as it is.

/// What a step of the watch found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// As before.
    None,
    /// It is lost now.
    Lost,
    /// It is back.
    Back,
}

/// The watch over the ground station.
#[derive(Clone, Copy, Debug, Default)]
pub struct GroundStationWatch {
    received_us: Option<u64>,
    lost: bool,
}

impl GroundStationWatch {
    /// A heartbeat of system `system` came.
    pub fn receive(&mut self, now_us: u64, system: u32, ground_station: f64) {
        if f64::from(system) == ground_station {
            self.received_us = Some(now_us);
        }
    }

    /// Whether it is lost.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// One step. `enabled`: FS_GCS_ENABLE.
    pub fn step(&mut self, now_us: u64, enabled: bool, timeout_s: f64) -> Change {
        let Some(received_us) = self.received_us.filter(|_| enabled) else {
            self.lost = false;
            return Change::None;
        };
        let lost = (now_us - received_us) as f64 * 1e-6 > timeout_s;
        let change = match (self.lost, lost) {
            (false, true) => Change::Lost,
            (true, false) => Change::Back,
            _ => Change::None,
        };
        self.lost = lost;
        change
    }
}
