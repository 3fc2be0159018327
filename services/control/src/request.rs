//! Requests to a running supervisor.

use crate::Problem;
use jink_runtime::request::{Answer, Request};
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::UnixStream;
use std::path::Path;

/// Puts a request to the supervisor behind `socket`, and hands on every answer until the last one.
pub fn put(socket: &Path, request: &Request, mut receive: impl FnMut(&Answer)) -> Result<(), Problem> {
    let failed = || Problem::io(socket.display().to_string());
    let mut stream = UnixStream::connect(socket).map_err(failed())?;
    let mut line = serde_json::to_vec(request).map_err(|error| Problem::Other(error.to_string()))?;
    line.push(b'\n');
    stream.write_all(&line).map_err(failed())?;
    for line in BufReader::new(stream).lines() {
        let answer: Answer = serde_json::from_str(&line.map_err(failed())?)
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
