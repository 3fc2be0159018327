//! The parameter server as a process: woken by changes, and once a second.

use crate::ParameterServer;
use jink_runtime::{Cycle, Input, Output, Ports, Service, StartError, StoreWriter, Wake};
use jink_shared_types::events::{EventSample, PARAMETERS_NOT_KEPT};
use jink_shared_types::param_messages::{ParameterChange, ParameterValues};
use jink_shared_types::{SampleHeader, topics};
use std::fmt;

/// The service: see [`crate`].
pub struct ParameterService {
    server: ParameterServer,
    changes: Input<ParameterChange>,
    values: Output<ParameterValues>,
    store: StoreWriter,
    /// Changes of this cycle.
    asked: Vec<ParameterChange>,
}

/// Changes taken in one cycle: more than the buffers of several who ask at once hold. Others are lost, and are asked for again.
const CHANGES_MAX: usize = 16;

impl fmt::Debug for ParameterService {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("ParameterService")
    }
}

impl Service for ParameterService {
    const PROGRAM: &'static str = "parameter_server";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        Ok(Self {
            // As they were changed last: rows that need a restart are in force with older values.
            server: ParameterServer::new(&ports.param_store().load().0),
            // Each command that asks is a producer of its own.
            changes: ports.trigger(topics::PARAMETER_CHANGE)?.of_all_producers(),
            values: ports.output(topics::PARAMETERS)?,
            store: ports.param_store().clone().writer(),
            asked: Vec::with_capacity(CHANGES_MAX),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let now = cycle.now;
        self.asked.clear();
        let asked = &mut self.asked;
        self.changes.each(|change| {
            if asked.len() < CHANGES_MAX {
                asked.push(*change.sample);
            }
        });
        let mut is_new = false;
        for change in &self.asked {
            is_new |= self.server.take(change);
            // One after the other, so that each of those who ask sees his answer.
            self.values.send(SampleHeader::at(now), &self.server.publish(now));
        }
        if now >= self.server.due() {
            self.values.send(SampleHeader::at(now), &self.server.publish(now));
        }
        let written = match is_new {
            true => self.store.save(self.server.set()),
            false => Ok(()),
        };
        if let Some(cause) = written.err().or_else(|| self.store.failure()) {
            tracing::warn!("parameters are not kept: {cause}");
            cycle
                .events
                .publish(now, &EventSample::new(&PARAMETERS_NOT_KEPT, "", [0.0; 2]));
        }
        Wake::at(self.server.due())
    }
}
