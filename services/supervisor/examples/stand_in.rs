//! A service that does nothing and misbehaves on request: what the supervisor's tests start instead of real services.
//!
//! Arguments after `--`, all optional: `cannot_start`, `crash_after_ms=N`, `hang_after_ms=N` (from then on it is deaf
//! to SIGTERM as well), `generations=N` (misbehaves only up to its Nth start).

use jink_runtime::{Cycle, Ports, Service, StartError, Wake};
use jink_shared_types::Timestamp;
use std::process::ExitCode;
use std::time::Duration;

struct StandIn {
    started: Timestamp,
    crash_after_s: f64,
    hang_after_s: f64,
}

impl Service for StandIn {
    const PROGRAM: &'static str = "stand_in";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let arguments = &ports.setup().arguments;
        let value = |key: &str| {
            let found = arguments
                .iter()
                .find_map(|text| text.strip_prefix(key)?.strip_prefix('='));
            found.and_then(|text| text.parse::<f64>().ok())
        };
        let misbehaves = value("generations").is_none_or(|last| f64::from(ports.setup().generation) <= last);
        let after_s = |key: &str| {
            value(key)
                .filter(|_| misbehaves)
                .map_or(f64::INFINITY, |ms| ms * 1e-3)
        };
        if misbehaves && arguments.iter().any(|text| text == "cannot_start") {
            return Err(StartError::Needs {
                what: "a device".to_owned(),
                cause: "it is not plugged in".to_owned(),
            });
        }
        println!("stand-in, generation {}", ports.setup().generation);
        Ok(Self {
            started: jink_runtime::now(),
            crash_after_s: after_s("crash_after_ms"),
            hang_after_s: after_s("hang_after_ms"),
        })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let lived_s = cycle.now.seconds_since(self.started);
        if lived_s >= self.crash_after_s {
            eprintln!("stand-in crashes as asked");
            std::process::abort();
        }
        if lived_s >= self.hang_after_s {
            loop {
                std::thread::sleep(Duration::from_millis(10));
            }
        }
        Wake::at(cycle.now.plus_seconds(0.005))
    }
}

fn main() -> ExitCode {
    jink_runtime::run::<StandIn>()
}
