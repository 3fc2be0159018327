//! What ground stations ask of our components, apart from flying: commands, parameters, files, texts, figures of the board.
//!
//! | in | out |
//! |---|---|
//! | commands to components 196 and 191 ([`commands`]) | COMMAND_ACK, the message that was asked for, [`GatewayRequest`] |
//! | PARAM_REQUEST_LIST, PARAM_REQUEST_READ, PARAM_SET | PARAM_VALUE, PARAM_ERROR, a change for the parameter server |
//! | FILE_TRANSFER_PROTOCOL | FILE_TRANSFER_PROTOCOL: a read-only server |
//! | `event` of every process | STATUSTEXT |
//! | the board | ONBOARD_COMPUTER_STATUS of component 191 |
//!
//! [`GroundServices`] is pure. It knows no link: who is addressed, over which link a question came, and what the gateway's own
//! messages are doing come with the question ([`Question`], [`LinkFacts`]); what it wants of the gateway itself, which alone
//! sends HEARTBEAT and OBSTACLE_DISTANCE and alone is restarted, goes back as a [`GatewayRequest`]. Nothing here is needed to
//! fly: whatever has many parts leaves at a pace of its own.

pub mod board;
pub mod commands;
pub mod computer;
mod files;
mod ground_services;
mod parameters;
mod texts;
mod version;

pub use commands::{Command, Component};
pub use ground_services::{
    Answer, Answers, GatewayRequest, GroundServices, LinkFacts, Named, Question, is_question,
};
