//! PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET, with every number as a float.

use super::parameters::{Parameter, Parameters, find};
use jink_emulated_autopilot::link::{Link, Packet, Wire};
use jink_emulated_autopilot::parameters::ParameterLists;
use mavlink::dialect::{MavMessage, PARAM_VALUE_DATA};

/// `param_index` of a value that was not asked for by its index.
const BY_NAME: u16 = u16::MAX;

/// The protocol's state.
#[derive(Clone, Debug, Default)]
pub struct ParameterProtocol {
    lists: ParameterLists,
}

impl ParameterProtocol {
    /// Takes a message of the protocol. What is not known is not answered.
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
                    Ok(index) => Parameter::ALL.get(index).copied().map(|p| (p, index as u16)),
                    Err(_) => named(request.param_id.to_str().ok()).map(|p| (p, BY_NAME)),
                };
                if let Some((parameter, index)) = wanted {
                    wire.send(outbox, packet.link, value_message(parameter, index, parameters));
                }
            }
            MavMessage::PARAM_SET(set) => {
                let Some(parameter) = named(set.param_id.to_str().ok()) else {
                    return;
                };
                if set.param_value.is_finite() {
                    parameters.set(parameter, f64::from(set.param_value));
                }
                wire.broadcast(outbox, &value_message(parameter, BY_NAME, parameters));
            }
            _ => {}
        }
    }

    /// Sends the next value of each list that is under way.
    pub fn step(&mut self, parameters: &Parameters, wire: &mut Wire, outbox: &mut Vec<Packet>) {
        for link in Link::ALL {
            if let Some(index) = self.lists.take(link, Parameter::ALL.len()) {
                let message = value_message(Parameter::ALL[index], index as u16, parameters);
                wire.send(outbox, link, message);
            }
        }
    }
}

fn named(name: Option<&str>) -> Option<Parameter> {
    name.and_then(find)
}

fn value_message(parameter: Parameter, index: u16, parameters: &Parameters) -> MavMessage {
    MavMessage::PARAM_VALUE(PARAM_VALUE_DATA {
        param_value: parameters.get(parameter) as f32,
        param_count: Parameter::ALL.len() as u16,
        param_index: index,
        param_id: parameter.name().into(),
        param_type: parameter.kind().wire(),
    })
}
