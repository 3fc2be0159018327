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
    _thread: Disturber,
}

impl Readers {
    /// Starts `count` of them in `instance`, whose services are all there.
    ///
    /// # Errors
    /// A topic has no room for so many.
    pub fn start(instance: &Instance, count: u32) -> Result<Self, Problem> {
        let instance = instance.clone();
        let words = format!("{count} readers");
        let thread = Disturber::start(&words, move |stop, ready| read(&instance, count, stop, ready));
        thread.map(|thread| Self { _thread: thread })
    }
}

/// As one program: of those that only look on, few may open what is large.
fn read(instance: &Instance, count: u32, stop: &AtomicBool, ready: &Ready) -> Result<(), OpenError> {
    let session = Session::open(instance, topics::SPECTATOR)?;
    let mut readers = Vec::new();
    for _ in 0..count {
        readers.push((
            session.input(topics::RANGE_CLOUD, &lidar_name(0))?,
            session.input(topics::LOCAL_MAP, "")?,
            session.input(topics::APPROVED, "")?,
        ));
    }
    begins(ready);
    while !stop.load(Ordering::Relaxed) {
        let at = now();
        for (cloud, map, approved) in &mut readers {
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
        }
        std::thread::sleep(PERIOD);
    }
    Ok(())
}
