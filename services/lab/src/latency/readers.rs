//! Additional readers of every large topic, as a recorder, an `echo` or a plugin of one's own is.

use super::load::lidar_name;
use jink_control::Problem;
use jink_runtime::{Instance, OpenError, Session, now};
use jink_shared_types::topics;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

/// They look for new samples this often: ten times per frame of a fast sensor.
const PERIOD: Duration = Duration::from_millis(3);

/// Readers that go on; they end with this.
#[derive(Debug)]
pub struct Readers {
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl Readers {
    /// Starts `count` of them in `instance`, whose services are all there.
    ///
    /// # Errors
    /// A topic has no room for so many.
    pub fn start(instance: &Instance, count: u32) -> Result<Self, Problem> {
        let mut readers = Self {
            stop: Arc::new(AtomicBool::new(false)),
            threads: Vec::new(),
        };
        for number in 1..=count {
            let (stop, instance) = (Arc::clone(&readers.stop), instance.clone());
            let (ready, is_ready) = channel();
            readers.threads.push(std::thread::spawn(move || {
                if let Err(error) = read(&instance, &stop, &ready) {
                    // Whoever waited for it has gone.
                    let _nobody_waits = ready.send(Err(error));
                }
            }));
            // Those before end when this is dropped.
            match is_ready.recv() {
                Ok(Ok(())) => {}
                Ok(Err(error)) => return Err(Problem::Other(format!("reader {number} of {count}: {error}"))),
                Err(_) => {
                    return Err(Problem::Other(format!(
                        "reader {number} of {count} ended at once"
                    )));
                }
            }
        }
        Ok(readers)
    }
}

impl Drop for Readers {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // It has nothing to say.
            let _ended = thread.join();
        }
    }
}

fn read(
    instance: &Instance,
    stop: &AtomicBool,
    ready: &Sender<Result<(), OpenError>>,
) -> Result<(), OpenError> {
    let session = Session::open(instance, "cli")?;
    let mut cloud = session.input(topics::RANGE_CLOUD, &lidar_name(0))?;
    let mut map = session.input(topics::LOCAL_MAP, "")?;
    let mut approved = session.input(topics::APPROVED, "")?;
    // Whoever waited for it has gone: the stop flag is set as well.
    let _nobody_waits = ready.send(Ok(()));
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
