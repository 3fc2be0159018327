//! Programs that measure transports of their own, with what those need.

use jink_control::Problem;
use jink_transport_chain::{Chain, Fault, Round};
use rustix::process::{Pid, Signal, kill_process};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Duration;

/// A transport of another program.
#[derive(Clone, Debug)]
pub struct Other {
    /// Its name.
    pub name: String,
    program: PathBuf,
}

impl Other {
    /// All transports of `program`.
    ///
    /// # Errors
    /// It is not there, or does not say which it has.
    pub fn of(program: &Path) -> Result<Vec<Self>, Problem> {
        let name = program.display().to_string();
        let output = Command::new(program)
            .arg("list")
            .output()
            .map_err(Problem::io(&name))?;
        let names: Vec<String> = serde_json::from_slice(&output.stdout)
            .map_err(|error| Problem::Other(format!("{name} list: no array of names: {error}")))?;
        Ok(names
            .into_iter()
            .map(|name| Self {
                name,
                program: program.to_owned(),
            })
            .collect())
    }

    /// Has it measure `chain`.
    ///
    /// # Errors
    /// It cannot, or `is_interrupted`.
    pub fn measure(&self, chain: &Chain, is_interrupted: &dyn Fn() -> bool) -> Result<Round, Fault> {
        let bytes: Vec<String> = chain.bytes.iter().map(usize::to_string).collect();
        let mut child = Command::new(&self.program)
            .args([
                "chain",
                "--transport",
                &chain.transport,
                "--bytes",
                &bytes.join(","),
            ])
            .args([
                "--rate-hz",
                &chain.rate_hz.to_string(),
                "--seconds",
                &chain.seconds.to_string(),
            ])
            .args(["--cores", &chain.cores.to_string(), "--folder"])
            .arg(&chain.folder)
            .stdin(Stdio::null())
            .stdout(Stdio::piped())
            .spawn()?;
        let stdout = child.stdout.take();
        // A thread of its own, since what is printed may be longer than a pipe.
        let reader = std::thread::spawn(move || {
            let mut text = String::new();
            stdout
                .map(|mut stdout| std::io::Read::read_to_string(&mut stdout, &mut text))
                .transpose()
                .map(|_| text)
        });
        let mut asked = false;
        let status = loop {
            if let Some(status) = child.try_wait()? {
                break status;
            }
            if is_interrupted() && !asked {
                kill_process(Pid::from_child(&child), Signal::TERM)?;
                asked = true;
            }
            std::thread::sleep(Duration::from_millis(10));
        };
        let text = reader.join().map_err(|_| "its output cannot be read")??;
        if !status.success() {
            return Err(format!("{}: {status}", self.program.display()).into());
        }
        Ok(serde_json::from_str(text.trim())?)
    }
}
