//! The runtime of jink behind a C interface, for sensors whose programs are in C or C++: `jink_sensor.h`.
//!
//! iceoryx2's own C and C++ bindings are built with CMake from its repository and are in no package index, so that a program with
//! them must be given a build of the right version. This library is built by cargo with everything else, is of the build that
//! flies, and does more than transport.
#![allow(
    unsafe_code,
    reason = "pointers from C cannot be followed without; the header says what they must be"
)]

use jink_runtime::{Cycle, Output, Ports, Service, StartError, Wake};
use jink_shared_types::ranges::PointCloud;
use jink_shared_types::{SampleHeader, Stage, Timestamp, topics};
use std::ffi::{c_int, c_void};
use std::sync::OnceLock;

/// What the C program hands over: `jink_cloud_sensor_t`.
#[repr(C)]
#[derive(Clone, Copy, Debug)]
pub struct CloudSensor {
    /// Clouds per second (Hz).
    pub rate_hz: f64,
    /// How often `next` is called (Hz).
    pub poll_hz: u32,
    /// Handed to both functions.
    pub context: *mut c_void,
    /// Whether there is a new cloud, and when it was captured.
    pub next: Option<extern "C" fn(*mut c_void, u64, *mut u64) -> c_int>,
    /// Writes it.
    pub fill: Option<extern "C" fn(*mut c_void, *mut PointCloud)>,
}

// SAFETY: the context is used by the thread that calls `jink_cloud_run` alone, as the header demands.
unsafe impl Send for CloudSensor {}
// SAFETY: as above.
unsafe impl Sync for CloudSensor {}

/// A service is opened by its type: this is what it finds then. There is one sensor in a process.
static SENSOR: OnceLock<CloudSensor> = OnceLock::new();

/// Exit code of a call with nothing in it: the same as that of a wrong configuration.
const NOTHING: c_int = jink_runtime::service::EXIT_CANNOT_START as c_int;

/// Runs the sensor until SIGTERM, and returns the exit code.
///
/// # Safety
/// `sensor` must be null or point to a `jink_cloud_sensor_t` whose functions keep to `jink_sensor.h`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn jink_cloud_run(sensor: *const CloudSensor) -> c_int {
    // SAFETY: the caller's promise.
    let Some(sensor) = (unsafe { sensor.as_ref() }) else {
        return NOTHING;
    };
    if sensor.next.is_none() || sensor.fill.is_none() || SENSOR.set(*sensor).is_err() {
        return NOTHING;
    }
    let code = jink_runtime::run::<Client>();
    c_int::from(code != std::process::ExitCode::SUCCESS) * NOTHING
}

struct Client {
    sensor: CloudSensor,
    clouds: Output<PointCloud>,
}

impl Service for Client {
    const PROGRAM: &'static str = "own_sensor";

    fn open(ports: &mut Ports) -> Result<Self, StartError> {
        let needs = |what: &str, cause: String| StartError::Needs {
            what: what.to_owned(),
            cause,
        };
        let sensor = *SENSOR
            .get()
            .ok_or_else(|| needs("a sensor", "jink_cloud_run was not called".to_owned()))?;
        let arguments = ports.setup().arguments.clone();
        let [name] = arguments.as_slice() else {
            return Err(needs(
                "the sensor's name",
                format!("the arguments are {arguments:?}"),
            ));
        };
        let is_rate = sensor.rate_hz.is_finite() && sensor.rate_hz > 0.0;
        if !is_rate || !(1..=1_000).contains(&sensor.poll_hz) {
            let cause = format!("rate_hz = {}, poll_hz = {}", sensor.rate_hz, sensor.poll_hz);
            return Err(needs("a rate above 0 and a poll_hz from 1 to 1000", cause));
        }
        let clouds = ports.range_output(topics::RANGE_CLOUD, name, sensor.rate_hz)?;
        Ok(Self { sensor, clouds })
    }

    fn cycle(&mut self, cycle: &mut Cycle<'_>) -> Wake {
        let mut capture_ns = cycle.now.ns;
        let CloudSensor { context, .. } = self.sensor;
        if let (Some(next), Some(fill)) = (self.sensor.next, self.sensor.fill)
            && next(context, cycle.now.ns, &raw mut capture_ns) != 0
        {
            let capture = Timestamp::from_ns(capture_ns);
            let header = SampleHeader {
                capture,
                ..SampleHeader::default()
            };
            self.clouds
                .write(header.derived(Stage::Sensor, capture), |cloud| {
                    cloud.first_point = capture;
                    fill(context, &raw mut *cloud);
                });
        }
        Wake::at(cycle.now.next_beat(self.sensor.poll_hz))
    }
}
