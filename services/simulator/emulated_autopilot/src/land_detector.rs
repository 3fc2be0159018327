//! Whether the vehicle stands on the ground.

/// Contact without the wish to climb for this long is ground contact (s).
const CONTACT_S: f64 = 0.35;
/// Ground contact for this long is a landing (s).
const LANDED_S: f64 = 0.6;
/// A climb demand below this is no wish to climb (m/s).
const CLIMB_DEMAND_MPS: f64 = 0.1;
/// Share of the hover thrust from which a vehicle that wants to climb no longer counts as landed: without this the
/// take-off ramp would end before the wheels leave the ground, and start over.
const LEAVING_SHARE: f64 = 0.6;

/// The detector.
#[derive(Clone, Debug)]
pub struct LandDetector {
    contact_s: f64,
    landed: bool,
}

impl Default for LandDetector {
    fn default() -> Self {
        Self {
            contact_s: CONTACT_S + LANDED_S,
            landed: true,
        }
    }
}

impl LandDetector {
    /// Landed.
    pub fn is_landed(&self) -> bool {
        self.landed
    }

    /// Touching the ground and not about to leave it: the motors may idle.
    pub fn has_contact(&self) -> bool {
        self.contact_s >= CONTACT_S
    }

    /// One cycle. `climb_demand_mps`: the controller's upward speed setpoint, NaN without one; `thrust_share`: thrust over
    /// hover thrust.
    pub fn step(&mut self, touching: bool, climb_demand_mps: f64, thrust_share: f64, dt_s: f64) {
        let wants_up = climb_demand_mps > CLIMB_DEMAND_MPS;
        if !touching || (wants_up && thrust_share > LEAVING_SHARE) {
            self.contact_s = 0.0;
            self.landed = false;
            return;
        }
        self.contact_s = if wants_up { 0.0 } else { self.contact_s + dt_s };
        if self.contact_s >= CONTACT_S + LANDED_S {
            self.landed = true;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::LandDetector;

    #[test]
    fn landed_about_a_second_after_touch_down_and_never_while_climbing() {
        let mut detector = LandDetector::default();
        assert!(detector.is_landed());
        detector.step(true, 1.5, 0.3, 0.008);
        assert!(detector.is_landed(), "standing with the wish to climb");
        detector.step(true, 1.5, 0.8, 0.008);
        assert!(!detector.is_landed());
        let mut steps = 0;
        while !detector.is_landed() {
            detector.step(true, -0.7, 0.8, 0.008);
            steps += 1;
            assert_eq!(detector.has_contact(), f64::from(steps) * 0.008 >= 0.35 - 1e-9);
        }
        assert!((f64::from(steps) * 0.008 - 0.95).abs() < 0.02);
    }
}
