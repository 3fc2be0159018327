//! The thread that carries what others have written from memory to the disk.

use jink_runtime::Instance;
use jink_runtime::config::Config;
use jink_runtime::spool::{self, Carrier};
use jink_shared_types::events::{EventSample, LOGS_KEPT, LOGS_LOST};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError, Weak};
use std::time::{Duration, Instant};

/// How often it is carried: what a failing power supply takes of the logs.
const PERIOD: Duration = Duration::from_millis(500);
/// A disk that takes longer is reported: an SD card that tidies up needs a second or two.
const PATIENCE: Duration = Duration::from_secs(10);

/// What the thread found last.
#[derive(Debug)]
struct Carried {
    at: Instant,
    logs_are_lost: bool,
}

/// The side of the service.
#[derive(Debug)]
pub struct CarrierThread {
    /// `None`: there is nothing to carry.
    last: Option<Arc<Mutex<Carried>>>,
    /// As far as it was reported.
    logs_are_lost: bool,
    /// The file by which `jink status` knows it.
    marker: PathBuf,
}

impl CarrierThread {
    /// Begins, if `config` has something carried.
    ///
    /// # Errors
    /// The system's about the thread.
    pub fn begin(instance: &Instance, config: &Config) -> std::io::Result<Self> {
        let mut thread = Self {
            last: None,
            logs_are_lost: false,
            marker: instance.logs_lost(),
        };
        // The recorder before this one may have left it.
        let _was_none = std::fs::remove_file(&thread.marker);
        if spool::is_wanted(config) {
            let last = Arc::new(Mutex::new(Carried {
                at: Instant::now(),
                logs_are_lost: false,
            }));
            let (carrier, report) = (Carrier::new(instance, config), Arc::downgrade(&last));
            std::thread::Builder::new()
                .name("carrier".to_owned())
                .spawn(move || run(carrier, &report))?;
            thread.last = Some(last);
        }
        Ok(thread)
    }

    /// That logs are lost, or kept again, if that is new.
    pub fn judge(&mut self) -> Option<EventSample> {
        let last = self.last.as_ref()?.lock().unwrap_or_else(PoisonError::into_inner);
        let are_lost = last.logs_are_lost || last.at.elapsed() > PATIENCE;
        if std::mem::replace(&mut self.logs_are_lost, are_lost) == are_lost {
            return None;
        }
        let (event, marked) = match are_lost {
            true => (
                &LOGS_LOST,
                std::fs::create_dir_all(self.marker.parent()?)
                    .and_then(|()| std::fs::write(&self.marker, "")),
            ),
            false => (&LOGS_KEPT, std::fs::remove_file(&self.marker)),
        };
        if let Err(error) = marked {
            tracing::warn!("{}: {error}", self.marker.display());
        }
        Some(EventSample::new(event, "", [0.0; 2]))
    }
}

/// Carries until the service has dropped its side: the process does not wait for a disk when it ends.
fn run(mut carrier: Carrier, report: &Weak<Mutex<Carried>>) {
    // Of this thread alone; where it is refused the thread writes all the same.
    let _refused = rustix::process::setpriority_process(None, 19);
    let mut logged = None;
    while report.strong_count() > 0 {
        let not_carried = carrier.carry();
        let why = not_carried.logs.clone().or(not_carried.tlog);
        if why != logged {
            match &why {
                Some(why) => tracing::error!("not on the disk: {why}"),
                None => tracing::info!("on the disk again"),
            }
            logged = why;
        }
        if let Some(report) = report.upgrade() {
            *report.lock().unwrap_or_else(PoisonError::into_inner) = Carried {
                at: Instant::now(),
                logs_are_lost: not_carried.logs.is_some(),
            };
        }
        std::thread::sleep(PERIOD);
    }
}

#[cfg(test)]
mod tests {
    use super::CarrierThread;
    use jink_runtime::Instance;
    use jink_runtime::config::Config;
    use jink_shared_types::events::{LOGS_KEPT, LOGS_LOST};

    #[test]
    fn logs_that_cannot_be_kept_are_said_once_and_so_are_those_that_are_kept_again() {
        let name = format!("carrier_{}", std::process::id());
        let instance: Instance = name.parse().unwrap();
        let place = std::env::temp_dir().join(&name);
        std::fs::create_dir_all(instance.log_folder()).unwrap();
        std::fs::write(instance.log_folder().join("planner.log"), "a line\n").unwrap();
        let config = Config {
            log_dir: Some(place.join("logs")),
            ..Config::default()
        };
        let mut carrier = CarrierThread::begin(&instance, &config).unwrap();
        let begin = std::time::Instant::now();
        let mut next = || loop {
            if let Some(event) = carrier.judge() {
                return event.id;
            }
            assert!(begin.elapsed().as_secs() < 60, "nothing is reported");
            std::thread::sleep(std::time::Duration::from_millis(10));
        };
        assert_eq!(next(), LOGS_LOST.id);
        assert!(instance.logs_lost().exists());
        std::fs::create_dir(&place).unwrap();
        assert_eq!(next(), LOGS_KEPT.id);
        assert!(!instance.logs_lost().exists());
        let run = place.join("logs").join(&name).join("000001/planner.log");
        assert_eq!(std::fs::read_to_string(run).unwrap(), "a line\n");
        std::fs::remove_dir_all(place).unwrap();
        std::fs::remove_dir_all(instance.folder()).unwrap();
    }
}
