//! What happens in a flight, chosen at random: messages from anybody, trajectories of the guard, samples, losses and
//! pauses.

use super::super::dice::Dice;
use super::super::messages;
use super::{SYSTEM, Story};
use jink_mavlink_gateway::{
    Body, COMPONENT_AUTOPILOT, COMPONENT_AVOIDANCE, COMPONENT_ONBOARD_COMPUTER, Content, HandoverState,
    Received,
};
use jink_mavlink_link::signing::stamps::Stamps;
use jink_shared_types::bezier::{self, End};
use jink_shared_types::events::{self, EventSample};
use jink_shared_types::ground::{GroundAction, GroundAnswer, MavlinkMessage};
use jink_shared_types::health::{Health, SystemStatus};
use jink_shared_types::motion::{ApprovedTrajectory, BezierPiece, Trajectory, TrajectoryMode, Verdict};
use jink_shared_types::param_messages::ParameterValues;
use jink_shared_types::prevention::{PreventedDemand, PreventionState};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::{Coded, Flag, SampleHeader, Velocity};
use mavlink::MavHeader;
use mavlink::dialect::{LOCAL_POSITION_NED_DATA, MANUAL_CONTROL_DATA, MavMessage, MavResult, TIMESYNC_DATA};
use nalgebra::Vector3;

impl Story {
    fn us(&self) -> u8 {
        self.gateway.us(self.now).system_id.unwrap_or(SYSTEM)
    }

    fn boot_ms(&self) -> u32 {
        (self.now.seconds_since(self.began) * 1e3) as u32 + 60_000
    }

    /// One thing happens.
    pub(super) fn go_on(&mut self, dice: &mut Dice<'_>) {
        match dice.below(24) {
            0..=3 => self.wait(f64::from(dice.below(120)) * 1e-3),
            4 => self.oversleep(f64::from(dice.byte()) * 0.05),
            5 => {
                // The autopilot falls silent.
                self.wait(f64::from(dice.below(40)) * 0.1);
            }
            6 | 7 => {
                let message = messages::heartbeat(dice, self.config.profile);
                self.autopilot_says(message);
            }
            8 => {
                let stamp_ms = if dice.once_in(8) {
                    dice.u32()
                } else {
                    self.boot_ms()
                };
                let message = messages::position(dice, stamp_ms);
                self.autopilot_says(message);
                self.locate();
            }
            9 => {
                let stamp_ms = if dice.once_in(8) {
                    dice.u32()
                } else {
                    self.boot_ms()
                };
                let message = messages::attitude(dice, stamp_ms);
                self.autopilot_says(message);
                self.locate();
            }
            10 | 11 => {
                let message = messages::wish(dice);
                self.autopilot_says(message);
            }
            12 => {
                let message = messages::telemetry(dice, self.boot_ms());
                self.autopilot_says(message);
            }
            13 => {
                if let Some(asked) = self.asked.take()
                    && let Some(answer) = messages::mission(dice, &asked, (self.us(), COMPONENT_AVOIDANCE))
                {
                    self.autopilot_says(answer);
                }
            }
            14 => self.somebody_says_anything(dice),
            15 => self.somebody_commands(dice),
            16 => {
                let whom = (self.us(), COMPONENT_AVOIDANCE);
                let message = match dice.below(3) {
                    0 => messages::parameter(dice, whom),
                    1 => messages::files(dice, whom),
                    _ => MavMessage::TIMESYNC(TIMESYNC_DATA {
                        tc1: if dice.once_in(2) { 0 } else { dice.u64() as i64 },
                        ts1: dice.u64() as i64,
                        target_system: dice.pick(&[0, whom.0, 9]),
                        target_component: dice.pick(&[0, whom.1, 9]),
                    }),
                };
                let copies = if dice.once_in(8) { 200 } else { 1 };
                for _ in 0..copies {
                    self.queue((255, 190), 1, Content::Message(message.clone()));
                }
                self.step();
            }
            17 | 18 => self.guard_says(dice),
            19 => self.approved = None,
            20 => {
                let (distance, range) = (dice.number(), dice.number());
                let ring = SectorRing {
                    distance_m: [distance; 72],
                    range_max_m: [range; 72],
                    range_min_m: dice.number(),
                    seen: [self.now; 72],
                    ..SectorRing::default()
                };
                self.ring = Some((Box::new(ring), SampleHeader::at(self.now)));
                let prevented = PreventedDemand {
                    velocity: Velocity::new(
                        f64::from(dice.number()),
                        f64::from(dice.number()),
                        f64::from(dice.number()),
                    ),
                    nearest_m: dice.number(),
                    state: Coded::new(dice.pick(&[
                        PreventionState::Off,
                        PreventionState::Acting,
                        PreventionState::Hold,
                    ])),
                    ..PreventedDemand::default()
                };
                self.prevented = Some((Box::new(prevented), SampleHeader::at(self.now)));
                let sticks = MANUAL_CONTROL_DATA {
                    x: dice.u16() as i16,
                    y: dice.u16() as i16,
                    ..MANUAL_CONTROL_DATA::default()
                };
                self.autopilot_says(MavMessage::MANUAL_CONTROL(sticks));
            }
            21 => {
                let health = dice.pick(&[
                    Health::Starting,
                    Health::Healthy,
                    Health::Healthy,
                    Health::Degraded,
                    Health::Failed,
                    Health::Stopping,
                ]);
                let status = SystemStatus {
                    health: Coded::new(health),
                    ..SystemStatus::default()
                };
                self.system = Some((Box::new(status), SampleHeader::at(self.now)));
            }
            22 => {
                let row = &events::TABLE[usize::from(dice.byte()) % events::TABLE.len()];
                self.events.push(EventSample {
                    id: dice.u16(),
                    ..EventSample::new(row, "planner", [f64::from(dice.number()); 2])
                });
            }
            _ => self.the_board_does_something(dice),
        }
        self.step();
    }

    fn queue(&mut self, (system, component_id): (u8, u8), link: u8, content: Content) {
        self.pending.push(Received {
            header: MavHeader {
                system_id: u32::from(system),
                component_id,
                sequence: 0,
            },
            content,
            time: self.now,
            link,
        });
    }

    fn autopilot_says(&mut self, message: MavMessage) {
        let link = self.gateway.autopilot_link();
        self.queue(messages::autopilot(self.us()), link, Content::Message(message));
        self.step();
    }

    /// Two sound positions: whatever the stamps before were, the second one counts.
    fn locate(&mut self) {
        for _ in 0..2 {
            self.autopilot_says(MavMessage::LOCAL_POSITION_NED(LOCAL_POSITION_NED_DATA {
                time_boot_ms: self.boot_ms(),
                x: 1.0,
                z: -5.0,
                ..LOCAL_POSITION_NED_DATA::default()
            }));
        }
    }

    /// From anybody, on any link.
    fn somebody_says_anything(&mut self, dice: &mut Dice<'_>) {
        let from = (
            dice.pick(&[self.us(), 0, 7, 255]),
            dice.pick(&[COMPONENT_AUTOPILOT, 0, 196]),
        );
        let link = dice.below(4);
        if let Some(content) = messages::any(dice, from) {
            self.queue(from, link, content);
            self.step();
            self.locate();
        }
    }

    fn somebody_commands(&mut self, dice: &mut Dice<'_>) {
        let components = [
            COMPONENT_AVOIDANCE,
            COMPONENT_ONBOARD_COMPUTER,
            COMPONENT_AUTOPILOT,
            0,
        ];
        let from = (dice.byte(), dice.byte());
        let targets = (dice.pick(&[self.us(), self.us(), 0, 9]), dice.pick(&components));
        let command = messages::command(dice, targets, from);
        let number = match &command {
            Content::Message(MavMessage::COMMAND_LONG(data)) => data.command as u16,
            Content::Message(MavMessage::COMMAND_INT(data)) => data.command as u16,
            Content::UnknownCommand { command, .. } => *command,
            // A number that the dialect knows in the third message.
            Content::Message(_) => return,
        };
        let us = self.gateway.us(self.now);
        let is_ours = us.system_id == Some(targets.0) && targets.1 != 0 && us.components.contains(&targets.1);
        // What was asked before has its answer.
        self.step();
        self.queue(from, dice.below(3), command);
        let mut acks = Vec::new();
        for _ in 0..2 {
            self.step();
            acks.extend(
                self.outputs
                    .messages()
                    .iter()
                    .filter_map(|sent| match &sent.body {
                        Body::CommandAck(ack) => Some((sent.component_id, *ack)),
                        Body::Message(_) => None,
                    }),
            );
        }
        assert_eq!(acks.len(), usize::from(is_ours), "to {targets:?}: {acks:?}");
        for (component, ack) in acks {
            assert_eq!((component, ack.command), (targets.1, number));
            assert_eq!((ack.target_system, ack.target_component), from);
            assert_ne!(ack.result, MavResult::MAV_RESULT_IN_PROGRESS, "no final answer");
        }
    }

    fn guard_says(&mut self, dice: &mut Dice<'_>) {
        let mut vector = || Vector3::new(dice.metres(), dice.metres(), dice.metres());
        let (from, velocity, to) = (vector(), vector() * 0.2, vector());
        let duration_s = 0.5 + f64::from(dice.below(60)) * 0.1;
        let end = |position, velocity| End {
            position,
            velocity,
            acceleration: Vector3::zeros(),
        };
        let mut trajectory = Trajectory {
            id: if dice.once_in(4) { dice.u64() } else { self.now.ns },
            start: self.now,
            splice: self.now,
            mode: Coded::new(dice.pick(&[
                TrajectoryMode::Plan,
                TrajectoryMode::Plan,
                TrajectoryMode::Stop,
                TrajectoryMode::Mirror,
            ])),
            ..Trajectory::default()
        };
        let points = bezier::quintic_between(&end(from, velocity), &end(to, Vector3::zeros()), duration_s);
        trajectory.push(BezierPiece::new(&points, [dice.metres(); 6], duration_s));
        if dice.once_in(3) {
            // Shared memory may hold anything.
            let piece = &mut trajectory.pieces[0];
            let number = f64::from(dice.number());
            match dice.below(6) {
                0 => piece.duration_s = number,
                1 => piece.yaw_rad[usize::from(dice.below(6))] = number,
                2 => piece.position[usize::from(dice.below(6))].x_m = number,
                3 => trajectory.len = dice.u32(),
                4 => trajectory.start.ns = dice.u64(),
                _ => piece.duration_s = f64::from_bits(dice.u64()),
            }
        }
        let approved = ApprovedTrajectory {
            trajectory,
            verdict: Coded::new(dice.pick(&[
                Verdict::Passed,
                Verdict::Passed,
                Verdict::Kept,
                Verdict::Braked,
                Verdict::Hold,
            ])),
            ..ApprovedTrajectory::default()
        };
        let mut header = SampleHeader::at(self.now);
        if dice.once_in(8) {
            header.capture.ns = dice.u64();
        }
        self.approved = Some((Box::new(approved), header));
    }

    fn the_board_does_something(&mut self, dice: &mut Dice<'_>) {
        match dice.below(5) {
            0 => {
                let mut values = ParameterValues::of(self.gateway.params());
                values.answered = dice.u64();
                if dice.once_in(4) {
                    values.table = dice.u64();
                }
                if let Some(value) = values.values.get_mut(usize::from(dice.byte())) {
                    *value = f64::from(dice.number());
                }
                self.parameters = Some(values);
            }
            1 => self.gateway.listen_only(dice.once_in(2)),
            2 => self.gateway.resume_now(self.now),
            3 => self.somebody_speaks_for_the_ground_services(dice),
            _ => {
                let handover = HandoverState::of(&self.gateway, &self.ours, Stamps::begin(dice.u64()));
                let mut bytes = handover.to_bytes();
                if dice.once_in(2) {
                    let reported = dice.take(bytes.len());
                    bytes[..reported.len()].copy_from_slice(reported);
                    // A wrong time may cost a beat, no more.
                    self.last_setpoint = self.last_setpoint.map(|_| self.now);
                }
                let handover = HandoverState::of_bytes(&bytes).expect("its length is right");
                let _stamps = handover.hand_to(self.now, &mut self.gateway, &mut self.ours);
            }
        }
    }

    /// A ground service that has gone wrong may say anything; it is never a setpoint.
    fn somebody_speaks_for_the_ground_services(&mut self, dice: &mut Dice<'_>) {
        let mut message = MavlinkMessage {
            id: dice.known_id(),
            len: dice.byte(),
            ..MavlinkMessage::default()
        };
        let bytes = dice.take(usize::from(message.len));
        message.payload[..bytes.len()].copy_from_slice(bytes);
        self.answers.push(GroundAnswer {
            message,
            period_us: dice.u32(),
            action: Coded::new(dice.pick(&[
                GroundAction::Send,
                GroundAction::Send,
                GroundAction::Heartbeat,
                GroundAction::Obstacles,
                GroundAction::ObstaclePeriod,
                GroundAction::Restart,
            ])),
            link: dice.byte(),
            of_computer: Flag::from(dice.once_in(2)),
            ..GroundAnswer::default()
        });
        self.step();
    }
}
