//! Files and parameters, asked of the ground services through a gateway: whatever is asked, at most one answer comes back, to whom it belongs, and no value leaves its range.

use super::dice::Dice;
use super::ground::Ground;
use super::messages;
use jink_mavlink_gateway::{
    Body, COMPONENT_AUTOPILOT, COMPONENT_AVOIDANCE, Content, Gateway, GatewayConfig, Inputs, Outputs,
    Received,
};
use jink_parameter_server::ParameterServer;
use jink_shared_types::layout::Layout;
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::params;
use jink_shared_types::{Reading, Timestamp};
use mavlink::MavHeader;
use mavlink::dialect::*;

/// Who asks.
const CLIENTS: [(u8, u8); 6] = [(255, 190), (255, 191), (254, 190), (1, 100), (0, 0), (7, 196)];
/// Long enough for every burst and every list (s).
const PATIENCE_S: f64 = 60.0;
const ACK: u8 = 128;
const NAK: u8 = 129;
const BURST: u8 = 15;

struct Requests {
    gateway: Gateway,
    outputs: Outputs,
    ground: Ground,
    now: Timestamp,
    said: Vec<MavMessage>,
    server: ParameterServer,
    server_lives: bool,
    parameters: Option<ParameterValues>,
}

/// Runs the laws of requests.
pub fn laws(data: &[u8]) {
    let mut dice = Dice::new(data);
    let mut requests = Requests::begin(dice.once_in(2));
    while !dice.is_empty() {
        let client = dice.pick(&CLIENTS);
        let target = (
            dice.pick(&[1, 1, 1, 0, 2]),
            dice.pick(&[COMPONENT_AVOIDANCE, COMPONENT_AVOIDANCE, 0, 191]),
        );
        match dice.below(4) {
            0 => requests.asks_for_parameters(client, messages::parameter(&mut dice, target)),
            1 | 2 => requests.asks_for_files(client, target, messages::files(&mut dice, target)),
            _ => {
                requests.server_lives = !dice.once_in(4);
                requests.wait(f64::from(dice.byte()) * 0.02);
            }
        }
    }
    requests.comes_to_rest();
}

impl Requests {
    /// An autopilot has been seen, of one make or the other.
    fn begin(copter: bool) -> Self {
        let mut requests = Self {
            gateway: Gateway::new(GatewayConfig::default()),
            outputs: Outputs::default(),
            ground: Ground::new(),
            now: Timestamp::from_seconds(1000.0),
            said: Vec::new(),
            server: ParameterServer::new(&params::ParamSet::default()),
            server_lives: true,
            parameters: None,
        };
        let autopilot = if copter {
            MavAutopilot::MAV_AUTOPILOT_ARDUPILOTMEGA
        } else {
            MavAutopilot::MAV_AUTOPILOT_PX4
        };
        let heartbeat = MavMessage::HEARTBEAT(HEARTBEAT_DATA {
            autopilot,
            ..HEARTBEAT_DATA::default()
        });
        requests.receive((1, COMPONENT_AUTOPILOT), heartbeat);
        requests
    }

    fn receive(&mut self, (system, component_id): (u8, u8), message: MavMessage) {
        self.step(&[Received {
            header: MavHeader {
                system_id: u32::from(system),
                component_id,
                sequence: 0,
            },
            content: Content::Message(message),
            time: self.now,
            link: 0,
        }]);
    }

    fn step(&mut self, messages: &[Received]) {
        let inputs = |messages, answers| Inputs {
            messages,
            link: Default::default(),
            approved: Reading::Never,
            prevented: Reading::Never,
            ring: Reading::Never,
            system: Reading::Never,
            events: &[],
            parameters: None,
            answers,
        };
        self.gateway
            .step(self.now, &inputs(messages, &[]), &mut self.outputs);
        let parameters = self.parameters.take();
        self.ground
            .step(self.now, &self.outputs, &[], parameters.as_ref());
        self.gateway.step(
            self.now,
            &inputs(&[], self.ground.outputs.answers()),
            &mut self.outputs,
        );
        if let Some(change) = &self.ground.outputs.parameter_change {
            assert!(change.is_plausible(), "{change:?}");
            // Dead at times.
            if self.server_lives {
                self.server.take(change);
                self.parameters = Some(self.server.publish(self.now));
            }
        }
        self.said.clear();
        self.said.extend(
            self.outputs
                .messages()
                .iter()
                .filter_map(|sent| match &sent.body {
                    Body::Message(message) => Some(message.clone()),
                    Body::CommandAck(_) => None,
                }),
        );
        for value in self.said.iter().filter_map(value) {
            let row = &params::TABLE[usize::from(value.param_index)];
            assert_eq!(value.param_id.to_str().ok(), Some(row.name));
            assert_eq!(usize::from(value.param_count), params::TABLE.len());
        }
        for row in params::TABLE {
            let value = self.ground.services.params().get(row);
            assert!((row.min..=row.max).contains(&value), "{} = {value}", row.name);
        }
    }

    fn asks_for_parameters(&mut self, client: (u8, u8), message: MavMessage) {
        let is_list = matches!(message, MavMessage::PARAM_REQUEST_LIST(_));
        self.receive(client, message);
        let errors: Vec<_> = self
            .said
            .iter()
            .filter_map(|said| match said {
                MavMessage::PARAM_ERROR(error) => Some(error),
                _ => None,
            })
            .collect();
        assert!(errors.len() <= 1 && (errors.is_empty() || !is_list));
        for error in errors {
            assert_eq!((error.target_system, error.target_component), client);
        }
        // One answer, that to an earlier change, and one piece of a list.
        assert!(self.said.iter().filter_map(value).count() <= 3);
    }

    fn asks_for_files(&mut self, client: (u8, u8), target: (u8, u8), message: MavMessage) {
        let MavMessage::FILE_TRANSFER_PROTOCOL(request) = &message else {
            return;
        };
        let request = request.payload;
        let opcode = request[3];
        self.receive(client, message);
        let number = u16::from_le_bytes([request[0], request[1]]).wrapping_add(1);
        let answers: Vec<_> = self
            .said
            .iter()
            .filter_map(transfer)
            // Pieces of bursts may come in between.
            .filter(|answer| answer.payload[5] == opcode && answer.payload[..2] == number.to_le_bytes())
            .collect();
        let named = target == (1, COMPONENT_AVOIDANCE);
        let expected = usize::from(named && !matches!(opcode, ACK | NAK));
        match opcode {
            BURST => assert!(answers.len() <= 2),
            _ => assert_eq!(answers.len(), expected, "{:?}", &request[..16]),
        }
        for answer in answers.iter().filter(|_| opcode != BURST) {
            assert_eq!((answer.target_system, answer.target_component), client);
        }
        self.judge_transfers();
    }

    fn judge_transfers(&self) {
        for answer in self.said.iter().filter_map(transfer) {
            let payload = &answer.payload;
            assert!(matches!(payload[3], ACK | NAK), "a server only answers");
            assert!(payload[4] <= 239);
            if payload[3] == NAK {
                assert!(payload[4] >= 1 && payload[12] != 0, "refused without a reason");
                assert_ne!(payload[12], 1, "a failure without a name");
            }
            let writes = (6..=13).contains(&payload[5]);
            assert!(!writes || payload[3] == NAK, "something was written");
        }
    }

    fn next_wake(&self) -> Timestamp {
        self.gateway
            .next_wake(self.now)
            .min(self.ground.services.next_wake())
    }

    fn wait(&mut self, seconds: f64) {
        let until = self.now.plus_seconds(seconds);
        loop {
            let wake = self.next_wake().max(self.now);
            if wake > until {
                break;
            }
            self.now = wake;
            self.step(&[]);
            self.judge_transfers();
            let pieces = self.said.iter().filter_map(transfer).count();
            assert!(pieces <= 1, "{pieces} pieces at once");
            assert!(self.next_wake() > self.now, "it would be woken without end");
        }
        self.now = until;
    }

    /// What comes in many pieces has an end.
    fn comes_to_rest(&mut self) {
        self.wait(PATIENCE_S);
        let until = self.now.plus_seconds(2.0);
        while self.now < until {
            self.now = self.next_wake();
            self.step(&[]);
            let pieces = self
                .said
                .iter()
                .any(|said| transfer(said).is_some() || value(said).is_some());
            assert!(!pieces, "it goes on for ever");
        }
    }
}

fn value(message: &MavMessage) -> Option<&PARAM_VALUE_DATA> {
    match message {
        MavMessage::PARAM_VALUE(value) => Some(value),
        _ => None,
    }
}

fn transfer(message: &MavMessage) -> Option<&FILE_TRANSFER_PROTOCOL_DATA> {
    match message {
        MavMessage::FILE_TRANSFER_PROTOCOL(transfer) => Some(transfer),
        _ => None,
    }
}
