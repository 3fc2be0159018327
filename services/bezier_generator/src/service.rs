//! The Bezier generator as a process: one answer per route.

use crate::{Generator, NoTrajectory};
use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, Wake};
use jink_shared_types::motion::{ApprovedTrajectory, Route, Trajectory};
use jink_shared_types::{Stage, Timestamp, topics};
use std::fmt;

/// The service: see [`crate`].
pub struct GeneratorService {
    generator: Generator,
    trajectory: Trajectory,
    answered: Timestamp,
    route: Input<Route>,
    approved: Input<ApprovedTrajectory>,
    output: Output<Trajectory>,
}

impl fmt::Debug for GeneratorService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("GeneratorService")
    }
}

impl Service for GeneratorService {
    const PROGRAM: &'static str = "bezier_generator";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            generator: Generator::new(ports.setup().generation),
            trajectory: Trajectory::default(),
            answered: Timestamp::NEVER,
            route: ports.trigger(topics::ROUTE)?.needed(),
            approved: ports.input(topics::APPROVED)?,
            output: ports.output(topics::TRAJECTORY)?,
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        self.approved.latest(now);
        let flown = self.approved.newest().map(|approved| &approved.sample.trajectory);
        let Some(route) = self.route.latest(now).fresh() else {
            return Wake::on_data();
        };
        if route.header.publish == self.answered {
            return Wake::on_data();
        }
        self.answered = route.header.publish;
        match self
            .generator
            .step(now, route.sample, flown, &mut self.trajectory)
        {
            Ok(()) => {
                let header = route.header.derived(Stage::Generator, now);
                let trajectory = &self.trajectory;
                self.output.write(header, |slot| slot.clone_from(trajectory));
            }
            Err(NoTrajectory::NotAsked) => {}
            Err(cause) => tracing::debug!(route = route.id, "no trajectory: {cause:?}"),
        }
        Wake::on_data()
    }
}
