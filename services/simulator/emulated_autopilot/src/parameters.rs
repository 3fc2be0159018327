//! What the parameters of any autopilot have in common: a table of names, and the protocol that reads and sets them.

use crate::link::{Link, Packet, Wire};
use mavlink::dialect::{MavMessage, MavSeverity, PARAM_SET_DATA, PARAM_VALUE_DATA};

/// Declares `Parameter`, the parameters of an autopilot: a name, a kind and a default each. The kinds are those of an enum
/// `Kind` beside it.
#[macro_export]
macro_rules! parameters {
    ($( $(#[$meta:meta])* $name:ident : $kind:ident = $default:expr; )*) => {
        /// One parameter; the variant is the autopilot's name of it.
        #[allow(non_camel_case_types)]
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Parameter { $( $(#[$meta])* $name, )* }

        impl Parameter {
            /// All of them, in the order of their MAVLink index.
            pub const ALL: &'static [Parameter] = &[$( Parameter::$name ),*];

            /// The autopilot's name.
            pub const fn name(self) -> &'static str {
                match self { $( Parameter::$name => stringify!($name), )* }
            }

            /// How it is stored.
            pub const fn kind(self) -> Kind {
                match self { $( Parameter::$name => Kind::$kind, )* }
            }

            const fn default(self) -> f64 {
                match self { $( Parameter::$name => $default, )* }
            }
        }
    };
}

/// The parameters of one autopilot, as [`ParameterProtocol`] needs them.
pub trait ParameterTable {
    /// How many there are.
    fn count(&self) -> usize;

    /// PARAM_VALUE of the one at `index` in the list.
    fn at(&self, index: usize) -> Option<PARAM_VALUE_DATA>;

    /// PARAM_VALUE of the one called `name`, asked for by its name.
    fn named(&self, name: &str) -> Option<PARAM_VALUE_DATA>;

    /// Sets the one called `name` as PARAM_SET asks. If it is not set, what is said of that.
    fn take(&mut self, name: &str, set: &PARAM_SET_DATA) -> Result<(), &'static str>;
}

/// PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET. For each link the next index of the list being sent, if any.
#[derive(Clone, Debug, Default)]
pub struct ParameterProtocol {
    next: [Option<usize>; 2],
}

impl ParameterProtocol {
    /// Takes a message of the protocol. What is not known is not answered.
    pub fn receive(
        &mut self,
        packet: &Packet,
        parameters: &mut impl ParameterTable,
        wire: &mut Wire,
        outbox: &mut Vec<Packet>,
    ) {
        match &packet.message {
            MavMessage::PARAM_REQUEST_LIST(_) => self.next[packet.link as usize] = Some(0),
            MavMessage::PARAM_REQUEST_READ(request) => {
                let wanted = match usize::try_from(request.param_index) {
                    Ok(index) => parameters.at(index),
                    Err(_) => request
                        .param_id
                        .to_str()
                        .ok()
                        .and_then(|name| parameters.named(name)),
                };
                if let Some(value) = wanted {
                    wire.send(outbox, packet.link, MavMessage::PARAM_VALUE(value));
                }
            }
            MavMessage::PARAM_SET(set) => {
                let name = set.param_id.to_str().unwrap_or_default();
                if parameters.named(name).is_none() {
                    return;
                }
                if let Err(text) = parameters.take(name, set) {
                    wire.say(outbox, MavSeverity::MAV_SEVERITY_ERROR, text);
                } else if let Some(value) = parameters.named(name) {
                    wire.broadcast(outbox, &MavMessage::PARAM_VALUE(value));
                }
            }
            _ => {}
        }
    }

    /// Sends the next value of each list that is under way.
    pub fn step(&mut self, parameters: &impl ParameterTable, wire: &mut Wire, outbox: &mut Vec<Packet>) {
        for link in Link::ALL {
            let next = &mut self.next[link as usize];
            let Some(index) = next.take() else { continue };
            *next = (index + 1 < parameters.count()).then_some(index + 1);
            if let Some(value) = parameters.at(index) {
                wire.send(outbox, link, MavMessage::PARAM_VALUE(value));
            }
        }
    }
}
