//! PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, with integers as their bits.

use super::parameters::{Kind, Parameter, Parameters, from_wire, to_wire};
use jink_emulated_autopilot::link::{Link, Packet, Wire};
use jink_emulated_autopilot::parameters::ParameterLists;
use mavlink::dialect::{MavMessage, MavParamType, MavSeverity, PARAM_VALUE_DATA};

/// The protocol's state.
#[derive(Clone, Debug, Default)]
pub struct ParameterProtocol {
    lists: ParameterLists,
}

impl ParameterProtocol {
    /// Takes a message of the protocol.
    pub fn receive(
        &mut self,
        packet: &Packet,
        parameters: &mut Parameters,
        wire: &mut Wire,
        outbox: &mut Vec<Packet>,
    ) {
        match &packet.message {
            MavMessage::PARAM_REQUEST_LIST(_) => self.lists.begin(packet.link),
            MavMessage::PARAM_REQUEST_READ(request) => {
                let wanted = match usize::try_from(request.param_index) {
                    Ok(index) => parameters.listed().get(index).copied(),
                    Err(_) => request
                        .param_id
                        .to_str()
                        .ok()
                        .and_then(|name| parameters.find(name)),
                };
                if let Some(parameter) = wanted {
                    wire.send(outbox, packet.link, value_message(parameter, parameters));
                }
            }
            MavMessage::PARAM_SET(set) => {
                let named = set.param_id.to_str().ok();
                let Some(parameter) = named.and_then(|name| parameters.find(name)) else {
                    return;
                };
                let kind = match set.param_type {
                    MavParamType::MAV_PARAM_TYPE_INT32 => Some(Kind::Integer),
                    MavParamType::MAV_PARAM_TYPE_REAL32 => Some(Kind::Real),
                    _ => None,
                };
                if kind != Some(parameter.kind()) {
                    wire.say(
                        outbox,
                        MavSeverity::MAV_SEVERITY_ERROR,
                        "param types mismatch, not set",
                    );
                    return;
                }
                let value = from_wire(parameter.kind(), set.param_value);
                if value.is_finite() {
                    parameters.set(parameter, value);
                }
                wire.broadcast(outbox, &value_message(parameter, parameters));
            }
            _ => {}
        }
    }

    /// Sends the next value of each list that is under way.
    pub fn step(&mut self, parameters: &Parameters, wire: &mut Wire, outbox: &mut Vec<Packet>) {
        for link in Link::ALL {
            let index = self.lists.take(link, parameters.listed().len());
            if let Some(parameter) = index.and_then(|index| parameters.listed().get(index)) {
                wire.send(outbox, link, value_message(*parameter, parameters));
            }
        }
    }
}

fn value_message(parameter: Parameter, parameters: &Parameters) -> MavMessage {
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_value: to_wire(parameter, parameters.get(parameter)),
        param_count: parameters.listed().len() as u16,
        param_index: parameters
            .listed()
            .iter()
            .position(|p| *p == parameter)
            .map_or(0, |index| index as u16),
        param_id: parameter.name().into(),
        param_type: match parameter.kind() {
            Kind::Integer => MavParamType::MAV_PARAM_TYPE_INT32,
            Kind::Real => MavParamType::MAV_PARAM_TYPE_REAL32,
        },
    })
}
