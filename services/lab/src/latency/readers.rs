//! Additional readers of every large topic, as a recorder, an `echo` or a plugin of one's own is.

use super::disturbance::{Disturber, Ready, begins};
use super::load::lidar_name;
use jink_control::Problem;
use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::topics;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// They look for new samples this often: ten times per frame of a fast sensor.
const PERIOD: Duration = Duration::from_millis(3);

/// Readers that go on; they end with this.
#[derive(Debug)]
pub struct Readers {
    _threads: Vec<Disturber>,
}

impl Readers {
    /// Starts `count` of them in `instance`, whose services are all there.
    ///
    /// # Errors
    /// A topic has no room for so many.
    pub fn start(instance: &Instance, count: u32) -> Result<Self, Problem> {
        let start = |number| {
            let instance = instance.clone();
            let words = format!("reader {number} of {count}");
            Disturber::start(&words, move |stop, ready| read(&instance, stop, ready))
        };
        // Where one fails, those before end.
        let threads: Result<_, _> = (1..=count).map(start).collect();
        threads.map(|threads| Self { _threads: threads })
    }
}

fn read(instance: &Instance, stop: &AtomicBool, ready: &Ready) -> Result<(), OpenError> {
    let session = Session::open(instance, "cli")?;
    let mut cloud = session.input(topics::RANGE_CLOUD, &lidar_name(0))?;
    let mut map = session.input(topics::LOCAL_MAP, "")?;
    let mut approved = session.input(topics::APPROVED, "")?;
    begins(ready);
    while !stop.load(Ordering::Relaxed) {
        let at = now();
        // Looked at where they lie, as every reader does.
        let newest = [
            cloud.latest(at).fresh().map(|cloud| cloud.header.capture),
            map.latest(at).fresh().map(|map| map.header.capture),
            approved
                .latest(at)
                .fresh()
                .map(|approved| approved.header.capture),
        ];
        std::hint::black_box(newest);
        std::thread::sleep(PERIOD);
    }
    Ok(())
}
