//! What must hold of the messages and samples of every step, and of the system id that the gateway uses.

use super::setpoint_checks::judge_setpoint;
use super::{SYSTEM, Story};
use jink_mavlink_gateway::{Body, Receipt};
use jink_shared_types::layout::Layout;
use jink_shared_types::params;
use mavlink::dialect::MavMessage;

/// For so long (s) a second autopilot may put the first in doubt.
const DEBOUNCE_S: f64 = 3.0;

impl Story {
    /// Looks at every message as its receiver does; answers how many are setpoints.
    pub(super) fn judge_messages(&mut self) -> usize {
        let us = self.gateway.us(self.now);
        let mut setpoints = 0;
        for sent in self.outputs.messages() {
            assert!(us.components.contains(&sent.component_id) && sent.component_id != 0);
            let bytes = self.ours.encode(sent.system_id, sent.component_id, &sent.body);
            self.splitter.load_datagram(bytes);
            let frame = self.splitter.next_frame().expect("a frame of ours is intact");
            assert_eq!(frame.header.system_id, u32::from(us.system_id.unwrap_or(SYSTEM)));
            let is_setpoint = matches!(sent.receipt, Receipt::Setpoint { .. });
            setpoints += usize::from(is_setpoint);
            match (&sent.body, frame.decode()) {
                (_, Ok(message)) => {
                    judge_setpoint(&self.config, is_setpoint, &message);
                    if matches!(
                        message,
                        MavMessage::MISSION_REQUEST_LIST(_) | MavMessage::MISSION_REQUEST_INT(_)
                    ) {
                        self.asked = Some(message);
                    }
                }
                // The answer to a command that the dialect does not know.
                (body, Err(error)) => assert!(matches!(body, Body::CommandAck(_)), "{error}"),
            }
            self.gateway.wire(self.now, sent.receipt);
        }
        setpoints
    }

    pub(super) fn judge_samples(&self) {
        if let Some((state, _)) = &self.outputs.vehicle_state {
            assert!(state.is_plausible() && state.position.is_finite(), "{state:?}");
            assert!(state.attitude.is_rotation() && !state.ground_distance_m.is_infinite());
        }
        if let Some((path, _)) = &self.outputs.desired_path {
            assert!(path.is_plausible(), "{path:?}");
        }
        if let Some((demand, _)) = &self.outputs.pilot_demand {
            assert!(demand.is_plausible(), "{demand:?}");
        }
        if let Some(status) = &self.outputs.link_status {
            assert!(status.is_plausible(), "{status:?}");
        }
        for request in self.outputs.requests() {
            assert!(request.is_plausible(), "{request:?}");
        }
        for arrived in self.outputs.scans() {
            assert!(arrived.scan.is_plausible(), "{:?}", arrived.scan);
        }
        for answer in self.ground.outputs.answers() {
            assert!(answer.is_plausible(), "{answer:?}");
        }
        for row in params::TABLE {
            let value = self.gateway.params().get(row);
            assert!((row.min..=row.max).contains(&value), "{} = {value}", row.name);
        }
    }

    pub(super) fn judge_identity(&mut self) {
        match self.gateway.us(self.now).system_id {
            Some(system_id) => {
                assert_ne!(system_id, 0, "nobody is system 0");
                self.known_since.get_or_insert(self.now);
            }
            None => {
                let known_s = self
                    .known_since
                    .take()
                    .map_or(0.0, |since| self.now.seconds_since(since));
                assert!(
                    known_s <= DEBOUNCE_S + 1e-6,
                    "the autopilot is nobody's after {known_s} s"
                );
            }
        }
    }
}
