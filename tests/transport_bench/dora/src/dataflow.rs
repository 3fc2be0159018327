//! `dora run`, started, watched and ended.

use crate::node::MESSAGE;
use jink_transport_chain::{Chain, Fault, PLACES, Round};
use rustix::io::Errno;
use rustix::process::{Pid, Signal, WaitOptions, getpid, kill_process, set_child_subreaper, wait};
use serde_json::{Value, json};
use std::ffi::OsString;
use std::fs::File;
use std::os::unix::process::CommandExt;
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Stdio};
use std::time::{Duration, Instant};

/// The environment variable with dora's command.
const DORA: &str = "DORA";
/// Where zenoh, which dora is built on, reads which threads it is to have.
const RUNTIME: &str = "ZENOH_RUNTIME";
/// One for everything.
const ONE_THREAD: &str = "(rx: (handover: app), tx: (handover: app), acc: (handover: app), net: (handover: app), \
    app: (worker_threads: 1))";
/// Dora has this long to end with all its nodes after SIGTERM.
const END: Duration = Duration::from_secs(20);
/// What is left of it has this long when it is killed.
const KILL: Duration = Duration::from_secs(3);
/// An error shows so much of what dora has said last (bytes).
const SHOWN_BYTES: usize = 2000;

/// Measures the chain as a dataflow.
pub fn measure(chain: &Chain, is_interrupted: &dyn Fn() -> bool) -> Result<Round, Fault> {
    let folder = std::path::absolute(&chain.folder)?;
    let chain = Chain {
        folder: folder.clone(),
        ..chain.clone()
    };
    let dataflow = folder.join("dataflow.yml");
    std::fs::write(&dataflow, serde_json::to_vec_pretty(&description(&chain)?)?)?;
    let mut dora = Dora::start(&dataflow, &folder)?;
    let outcome = measure_running(&chain, &mut dora, is_interrupted);
    // Without a word of dora's if somebody has interrupted it.
    outcome.map_err(|fault| {
        if is_interrupted() {
            fault
        } else {
            dora.explained(&fault)
        }
    })
}

fn measure_running(
    chain: &Chain,
    dora: &mut Dora,
    is_interrupted: &dyn Fn() -> bool,
) -> Result<Round, Fault> {
    chain.watch(&mut || dora.check(), is_interrupted)?;
    let begin = (Instant::now(), dora.cpu_s()?);
    let window = chain.window(is_interrupted)?;
    dora.check()?;
    let cpu_percent = 100.0 * (dora.cpu_s()? - begin.1) / begin.0.elapsed().as_secs_f64();
    dora.end()?;
    let mut round = chain.round(window)?;
    round.cpu_percent += cpu_percent;
    Ok(round)
}

/// The dataflow: each process gets what the one before it sends. Dora reads YAML, which JSON is too.
fn description(chain: &Chain) -> Result<Value, Fault> {
    let program = std::env::current_exe()?;
    let last = chain.bytes.len();
    let nodes: Result<Vec<Value>, Fault> = (0..=last)
        .map(|place| {
            let command = chain.stage_command(&program, place);
            let args: Option<Vec<String>> = command
                .get_args()
                .map(|arg| arg.to_str().map(in_quotes))
                .collect();
            let args = args.ok_or("dora cannot start what has a name that is no text")?;
            let mut node = json!({ "id": PLACES[place], "path": program, "args": args.join(" ") });
            if let Some(before) = place.checked_sub(1) {
                node["inputs"] = json!({ MESSAGE: format!("{}/{MESSAGE}", PLACES[before]) });
            }
            if place < last {
                node["outputs"] = json!([MESSAGE]);
            }
            Ok(node)
        })
        .collect();
    Ok(json!({ "nodes": nodes? }))
}

/// An argument as dora splits a line into them: as a shell does.
fn in_quotes(argument: &str) -> String {
    format!("'{}'", argument.replace('\'', r"'\''"))
}

/// Dora's command: a name for the search path, or a path that is the same in every folder.
fn dora() -> Result<OsString, Fault> {
    let program = std::env::var_os(DORA).unwrap_or_else(|| "dora".into());
    let is_name = Path::new(&program).components().count() == 1;
    Ok(if is_name {
        program
    } else {
        std::path::absolute(program)?.into()
    })
}

/// Turns this process into `dora run`. It gets SIGTERM when the process that started it ends.
pub fn become_dora(dataflow: &Path) -> Result<(), Fault> {
    rustix::process::set_parent_process_death_signal(Some(Signal::TERM))?;
    let program = dora()?;
    let error = Command::new(&program).arg("run").arg(dataflow).exec();
    Err(format!("{}: {error}", program.display()).into())
}

/// `dora run` and all nodes that it has started; they end with this.
struct Dora {
    child: Child,
    log: std::path::PathBuf,
}

impl Dora {
    fn start(dataflow: &Path, folder: &Path) -> Result<Dora, Fault> {
        // Nodes that lose dora become children of this process, which ends them.
        set_child_subreaper(Some(getpid()))?;
        let log = folder.join("dora.log");
        let file = File::create(&log)?;
        let runtime = std::env::var_os(RUNTIME).unwrap_or_else(|| ONE_THREAD.into());
        let child = Command::new(std::env::current_exe()?)
            .arg("run")
            .arg(dataflow)
            .current_dir(folder)
            // Whoever else may be in this network is none of ours.
            .env("DORA_ZENOH_MULTICAST", "off")
            .env(DORA, dora()?)
            .env(RUNTIME, runtime)
            // Its last words are to be read.
            .envs([
                ("NO_COLOR", "1"),
                ("RUST_BACKTRACE", "0"),
                ("RUST_LIB_BACKTRACE", "0"),
            ])
            .stdin(Stdio::null())
            .stdout(file.try_clone()?)
            .stderr(file)
            .spawn()?;
        Ok(Dora { child, log })
    }

    /// An error if it has ended.
    fn check(&mut self) -> Result<(), Fault> {
        match self.child.try_wait()? {
            Some(status) => Err(format!("dora has ended: {status}").into()),
            None => Ok(()),
        }
    }

    /// Processor time that it has used (s).
    fn cpu_s(&self) -> Result<f64, Fault> {
        let text = std::fs::read_to_string(format!("/proc/{}/stat", self.child.id()))?;
        // After the name, which may have spaces: 11 fields, then the ticks in the program and in the kernel.
        let fields = text
            .rsplit(')')
            .next()
            .unwrap_or_default()
            .split_whitespace()
            .skip(11);
        let ticks: Result<Vec<u64>, _> = fields.take(2).map(str::parse).collect();
        Ok(ticks?.iter().sum::<u64>() as f64 / rustix::param::clock_ticks_per_second() as f64)
    }

    /// Asks it to end with all nodes, and waits for it.
    fn end(&mut self) -> Result<(), Fault> {
        kill_process(Pid::from_child(&self.child), Signal::TERM)?;
        match self.wait(END)? {
            Some(status) if status.success() => Ok(()),
            Some(status) => Err(format!("dora failed: {status}").into()),
            None => Err("dora does not end".into()),
        }
    }

    /// Waits for its end, at most for `patience`.
    fn wait(&mut self, patience: Duration) -> Result<Option<ExitStatus>, Fault> {
        let until = Instant::now() + patience;
        loop {
            let status = self.child.try_wait()?;
            if status.is_some() || Instant::now() > until {
                return Ok(status);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// An error with the last of what dora and the nodes have said.
    fn explained(&self, fault: &Fault) -> Fault {
        let said = std::fs::read(&self.log).unwrap_or_default();
        let last = &said[said.len().saturating_sub(SHOWN_BYTES)..];
        format!(
            "{fault}; dora's last words:\n{}",
            String::from_utf8_lossy(last).trim_end()
        )
        .into()
    }
}

impl Drop for Dora {
    fn drop(&mut self) {
        if let Ok(None) = self.child.try_wait() {
            // It ends its nodes if it still can. What fails here has ended already.
            let _told = kill_process(Pid::from_child(&self.child), Signal::TERM);
            let _ended = self.wait(KILL);
            let _gone = self.child.kill();
            let _reaped = self.child.wait();
        }
        let until = Instant::now() + KILL;
        while Instant::now() < until {
            match wait(WaitOptions::NOHANG) {
                Ok(Some(_)) | Err(Errno::INTR) => {}
                Ok(None) => {
                    own_children().for_each(|child| {
                        let _gone = kill_process(child, Signal::KILL);
                    });
                    std::thread::sleep(Duration::from_millis(5));
                }
                // There are none.
                Err(_) => break,
            }
        }
    }
}

/// The children of this process.
fn own_children() -> impl Iterator<Item = Pid> {
    let text = std::fs::read_to_string("/proc/thread-self/children").unwrap_or_default();
    let pids: Vec<Pid> = text
        .split_whitespace()
        .filter_map(|pid| pid.parse().ok())
        .filter_map(Pid::from_raw)
        .collect();
    pids.into_iter()
}

#[cfg(test)]
mod tests {
    use super::in_quotes;

    #[test]
    fn an_argument_stays_one() {
        assert_eq!(in_quotes("a b"), "'a b'");
        assert_eq!(in_quotes("it's"), r"'it'\''s'");
    }
}
