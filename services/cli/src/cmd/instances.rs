//! `jink instances`: which jinks this host has, running or ended, and what ended ones have left in memory.

use jink_control::status::write_table;
use jink_control::{Problem, running};
use jink_control::{say, sayln};
use jink_runtime::Instance;
use serde::Serialize;
use std::os::unix::fs::MetadataExt;
use std::path::Path;
use std::process::ExitCode;
use std::time::SystemTime;

/// Which to list, and whether to tidy up.
#[derive(Clone, Debug, clap::Args)]
#[command(after_help = "\
An instance that has ended leaves its logs in /dev/shm if something went wrong in it: the next `jink up` of the same name removes
them, a restart of the host removes all, and --remove does it now.

Exit codes: 0 listed; 1 something could not be removed.")]
pub struct Args {
    /// Remove what ended instances have left
    #[arg(long)]
    remove: bool,
    /// One JSON array instead of a table
    #[arg(long)]
    json: bool,
}

/// One instance.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Listed {
    name: String,
    /// `running`, `unsupervised` (its supervisor was killed), `ended`, or `of another user`, whose it is to say.
    state: &'static str,
    /// Process id of the supervisor.
    supervisor: Option<u32>,
    /// Id of the user it belongs to.
    user: u32,
    /// Size of its files, shared memory not among them (KiB).
    files_kib: u64,
    /// Since its folder was last changed (s).
    quiet_s: u64,
}

/// Lists all, after removing what is to be removed.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let mut failed = false;
    let mut all = Vec::new();
    for instance in Instance::all().map_err(Problem::io("/dev/shm"))? {
        let Some(listed) = look(&instance) else { continue };
        if args.remove && listed.state == ENDED {
            match std::fs::remove_dir_all(instance.folder()) {
                Ok(()) => continue,
                Err(cause) => {
                    eprintln!("jink: {}: {cause}", instance.folder().display());
                    failed = true;
                }
            }
        }
        all.push(listed);
    }
    if args.json {
        let json = serde_json::to_string(&all).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    } else {
        say!("{}", table(&all));
    }
    Ok(ExitCode::from(u8::from(failed)))
}

const ENDED: &str = "ended";

/// `None` where it has just been removed.
fn look(instance: &Instance) -> Option<Listed> {
    let metadata = std::fs::symlink_metadata(instance.folder()).ok()?;
    let us = rustix::process::geteuid();
    let supervisor = running::holder(instance);
    Some(Listed {
        name: instance.to_string(),
        state: match supervisor {
            Some(_) => "running",
            None if metadata.uid() != us.as_raw() && !us.is_root() => "of another user",
            None if running::has_orphans(instance) => "unsupervised",
            None => ENDED,
        },
        supervisor,
        user: metadata.uid(),
        files_kib: size_bytes(&instance.folder()).div_ceil(1024),
        quiet_s: metadata
            .modified()
            .ok()
            .and_then(|time| SystemTime::now().duration_since(time).ok())
            .map_or(0, |quiet| quiet.as_secs()),
    })
}

fn size_bytes(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries
        .map(|entry| match entry.metadata() {
            Ok(metadata) if metadata.is_dir() => size_bytes(&entry.path()),
            Ok(metadata) => metadata.len(),
            Err(_) => 0,
        })
        .sum()
}

fn table(all: &[Listed]) -> String {
    if all.is_empty() {
        return "no jink runs on this host, and none has left anything\n".to_owned();
    }
    let header = [
        "instance",
        "state",
        "supervisor",
        "user id",
        "files KiB",
        "quiet for s",
    ];
    let rows: Vec<[String; 6]> = std::iter::once(header.map(str::to_owned))
        .chain(all.iter().map(|one| {
            [
                one.name.clone(),
                one.state.to_owned(),
                one.supervisor.map_or("-".to_owned(), |pid| pid.to_string()),
                one.user.to_string(),
                one.files_kib.to_string(),
                one.quiet_s.to_string(),
            ]
        }))
        .collect();
    let mut text = String::new();
    write_table(&mut text, &rows);
    text
}
