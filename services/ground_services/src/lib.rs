//! Answers what ground stations ask of our components, apart from flying: commands, parameters, files, texts, figures of the board.
//!
//! | in | out |
//! |---|---|
//! | `mavlink/requests`: commands to components 196 and 191 (`commands`) | `mavlink/answers`: COMMAND_ACK, the message that was asked for, what the gateway is to do |
//! | `mavlink/requests`: PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET; `parameters` | PARAM_VALUE, PARAM_ERROR; `parameters/change` |
//! | `mavlink/requests`: FILE_TRANSFER_PROTOCOL | FILE_TRANSFER_PROTOCOL: a read-only server |
//! | `event` of every process | STATUSTEXT |
//! | the board | ONBOARD_COMPUTER_STATUS of component 191 |
//!
//! [`GroundServices::step`] is pure. It knows no link: the gateway decides who is addressed, and says with each request over which
//! link it came and what it sends at which rate. Nothing here is needed to fly. A ground station that brings this process down
//! interrupts its own answers: the setpoints are the gateway's, another process. What asks again gets its answer from the next
//! instance, some 20 ms later; a list of parameters or a file that was under way is asked for anew by every ground station.
//!
//! MAV_CMD_USER_1 (assisted flight) and the protocol of missions stay with the gateway: both decide which setpoints leave next, in the
//! same cycle, and are worth nothing without it.

mod board;
mod commands;
pub mod computer;
mod files;
mod ground_services;
mod parameters;
mod service;
mod texts;
mod version;

pub use ground_services::{GroundServices, Inputs, Outputs};
pub use service::GroundServicesService;
