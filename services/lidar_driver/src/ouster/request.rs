//! Asks an Ouster sensor for its metadata from a thread of its own, until it answers.

use super::{Metadata, http};
use std::net::{IpAddr, SocketAddr};
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::time::Duration;

/// Port of the sensor's web server.
const HTTP_PORT: u16 = 80;
/// First pause before the request is repeated, and the longest one.
const PAUSE: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(8)];

/// A request that is under way.
#[derive(Debug)]
pub struct MetadataRequest {
    answer: Receiver<Metadata>,
}

impl MetadataRequest {
    /// Begins the requests to the sensor at `sensor`, whose packets shall go to `port` of this computer; `control_port`
    /// zero is the usual one. `None` where no thread can be started.
    pub fn begin(sensor: IpAddr, host: Option<IpAddr>, port: u16, control_port: u16) -> Option<Self> {
        let address = SocketAddr::new(
            sensor,
            if control_port == 0 {
                HTTP_PORT
            } else {
                control_port
            },
        );
        let (sender, answer) = channel();
        let asks = move || {
            let mut pause = PAUSE[0];
            let mut said = String::new();
            loop {
                match http::set_up(address, host, port) {
                    Ok(metadata) => {
                        let _ = sender.send(metadata);
                        return;
                    }
                    Err(error) => {
                        let error = error.to_string();
                        if said != error {
                            tracing::warn!("{error}; asking again");
                            said = error;
                        }
                    }
                }
                std::thread::sleep(pause);
                pause = (2 * pause).min(PAUSE[1]);
            }
        };
        let thread = std::thread::Builder::new()
            .name("ouster_http".to_owned())
            .spawn(asks);
        thread.ok().map(|_| Self { answer })
    }

    /// What the sensor has answered; `Err` if it never will.
    ///
    /// # Errors
    /// Where the thread has ended without an answer.
    pub fn answer(&self) -> Result<Option<Metadata>, TryRecvError> {
        match self.answer.try_recv() {
            Ok(metadata) => Ok(Some(metadata)),
            Err(TryRecvError::Empty) => Ok(None),
            Err(gone @ TryRecvError::Disconnected) => Err(gone),
        }
    }
}
