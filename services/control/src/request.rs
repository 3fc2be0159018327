//! Requests to a running supervisor.

use crate::Problem;
use jink_runtime::request::{Answer, Request};
use std::io::{BufRead, BufReader, ErrorKind, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;
use std::time::Duration;

/// From one answer to the next: longer than the longest start and the longest probation, which are a minute each.
const PATIENCE: Duration = Duration::from_secs(150);

/// Puts a request to the supervisor behind `socket`, and hands on every answer until the last one.
pub fn put(socket: &Path, request: &Request, mut receive: impl FnMut(&Answer)) -> Result<(), Problem> {
    let failed = || Problem::io(socket.display().to_string());
    let mut stream = UnixStream::connect(socket).map_err(failed())?;
    let mut line = serde_json::to_vec(request).map_err(|error| Problem::Other(error.to_string()))?;
    line.push(b'\n');
    stream.set_read_timeout(Some(PATIENCE)).map_err(failed())?;
    stream.write_all(&line).map_err(failed())?;
    for line in BufReader::new(stream).lines() {
        let line = line.map_err(|error| match error.kind() {
            ErrorKind::WouldBlock => Problem::Other(format!(
                "the supervisor has not answered for {} s; see `jink status`",
                PATIENCE.as_secs()
            )),
            _ => failed()(error),
        })?;
        let answer: Answer = serde_json::from_str(&line)
            .map_err(|error| Problem::Other(format!("the supervisor's answer is not understood: {error}")))?;
        receive(&answer);
        if answer.last {
            return Ok(());
        }
    }
    Err(Problem::Other(
        "the supervisor ended the conversation before its last answer; see `jink status`".to_owned(),
    ))
}
