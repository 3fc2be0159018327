//! `jink-transport-bench`, behind `jink bench transport`: what jink's transport costs beside bare iceoryx2 with the same hops and samples,
//! beside what is fastest, and beside what others use, in one run.
//!
//! | module | holds |
//! |---|---|
//! | [`samples`] | the samples of the hops |
//! | [`stubs`] | jink: services that compute nothing |
//! | [`bare`] | iceoryx2 |
//! | [`shared_memory`] | shared memory with a futex |
//! | [`sockets`] | Unix sockets, UDP |
//! | [`others`] | programs that measure transports of their own |
//! | [`report`] | the table, and the JSON object |

mod bare;
mod others;
mod report;
mod samples;
mod shared_memory;
mod sockets;
mod stubs;

use clap::Parser;
use jink_control::{EXIT_PROBLEM, Interrupt, Problem, places, provenance, say, sayln};
use jink_runtime::Instance;
use jink_runtime::realtime::{Scheduling, schedule};
use jink_transport_chain::program::Ends;
use jink_transport_chain::{Chain, Fault, Round, StageArgs, program};
use others::Other;
use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};
use report::{Bench, Head};
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stubs::Stubs;

/// jink itself.
const JINK: &str = "jink";
/// What it is compared with.
const BARE: &str = "iceoryx2";
/// All that this program measures by itself.
const OWN: [&str; 5] = [JINK, BARE, "shm-futex", "unix", "udp"];
/// SCHED_FIFO priority where real-time scheduling is measured.
const PRIORITY: u8 = 10;

/// Measure what handing samples from process to process costs, beside other transports
#[derive(Debug, Parser)]
#[command(
    name = "jink bench transport",
    bin_name = "jink bench transport",
    args_conflicts_with_subcommands = true,
    after_help = "\
Six processes hand samples on without computing anything: sensor, fusion, planner, generator, guard, gateway. Every process reads every
byte it gets and writes every byte it sends, as many as jink's services do. The latency is from the begin of writing the first sample
to the end of reading the last.

jink       services on jink's runtime and topics: headers, checks, ownership, heartbeats
iceoryx2   the same samples over one topic and one event per hop
shm-futex  a ring in shared memory and a futex: nothing can do less
unix, udp  sockets
others     programs of their own: --with PROGRAM

Every round measures every transport, in an order that the seed decides. A ratio is the median over the rounds of the ratio within one
round.

Exit codes: 0 everything was measured; 1 something was not; 2 wrong arguments."
)]
struct Args {
    /// Only these, separated by commas; iceoryx2 is always measured
    #[arg(long, value_delimiter = ',', value_name = "NAMES")]
    transports: Vec<String>,
    /// Also the transports of this program (tests/transport_bench/zenoh, tests/transport_bench/dora)
    #[arg(long, value_name = "PROGRAM")]
    with: Vec<PathBuf>,
    /// Times that everything is measured
    #[arg(long, default_value_t = 5, value_parser = clap::value_parser!(u32).range(1..=1_000))]
    rounds: u32,
    /// How long each of them is measured (s)
    #[arg(long, default_value_t = 5.0, value_parser = seconds)]
    seconds: f64,
    /// Clouds per second
    #[arg(long, default_value_t = 50, value_parser = clap::value_parser!(u32).range(1..=1_000), value_name = "HZ")]
    rate: u32,
    /// Points of a cloud
    #[arg(long, default_value_t = 20_000, value_parser = clap::value_parser!(u32).range(1..=131_072))]
    points: u32,
    /// Lets the kernel place the processes, instead of each on the core after that of its neighbour
    #[arg(long)]
    free: bool,
    /// With SCHED_FIFO for every process; needs the rights to it
    #[arg(long)]
    realtime: bool,
    /// Decides the order
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// One JSON object as the last line, instead of the table
    #[arg(long)]
    json: bool,
    /// Configuration folder; without it ./config, /etc/jink or that of the checkout
    #[arg(long, value_name = "DIR")]
    config: Option<PathBuf>,
    #[command(subcommand)]
    command: Option<Process>,
}

#[derive(Debug, clap::Subcommand)]
enum Process {
    /// Be one process of a chain
    #[command(hide = true)]
    Stage(StageArgs),
}

fn seconds(text: &str) -> Result<f64, String> {
    let seconds: Option<f64> = text.parse().ok();
    seconds
        .filter(|seconds| (0.5..=3600.0).contains(seconds))
        .ok_or_else(|| "not a number of seconds from 0.5 to 3600".to_owned())
}

/// The ends of the hops of a process that this program measures by itself.
fn open(args: &StageArgs) -> Result<Ends, Fault> {
    let incoming = args.place.checked_sub(1).zip(args.bytes_in());
    let outgoing = args.bytes_out().map(|message| (args.place, message));
    // Whoever is read from is waited for: the reading end first.
    let incoming = incoming.map(|(hop, message)| match args.transport.as_str() {
        BARE => bare::subscriber(args, hop, message),
        "shm-futex" => shared_memory::reader(args, hop, message),
        "unix" => sockets::stream_in(args, hop, message),
        "udp" => sockets::datagrams_in(args, hop, message),
        other => Err(format!("no transport is called {other}").into()),
    });
    let incoming = incoming.transpose()?;
    let outgoing = outgoing.map(|(hop, message)| match args.transport.as_str() {
        BARE => bare::publisher(args, hop, message),
        "shm-futex" => shared_memory::writer(args, hop, message),
        "unix" => sockets::stream_out(args, hop, message),
        "udp" => sockets::datagrams_out(args, hop, message),
        other => Err(format!("no transport is called {other}").into()),
    });
    Ok((incoming, outgoing.transpose()?))
}

/// The files of one measurement; they go with this.
struct Folder {
    path: PathBuf,
    instance: Instance,
}

impl Folder {
    fn new(number: usize) -> Result<Self, Problem> {
        let name = format!("bench_{}_{number}", std::process::id());
        let path = PathBuf::from("/dev/shm").join(&name);
        let instance: Instance = name.parse().map_err(|error| Problem::Other(format!("{error}")))?;
        std::fs::create_dir(&path).map_err(Problem::io(path.display().to_string()))?;
        std::fs::create_dir_all(instance.folder())
            .map_err(Problem::io(instance.folder().display().to_string()))?;
        Ok(Self { path, instance })
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let prefix = bare::prefix(&self.path);
        // What cannot be removed lies among what the next reboot removes.
        let _stays = std::fs::remove_dir_all(&self.path);
        let _stays = self.instance.wipe();
        let _stays = std::fs::remove_dir_all(self.instance.folder());
        for entry in std::fs::read_dir("/dev/shm").into_iter().flatten().flatten() {
            if entry
                .file_name()
                .to_str()
                .is_some_and(|name| name.starts_with(&prefix))
            {
                let _stays = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// A transport, and who measures it.
#[derive(Clone, Debug)]
enum Transport {
    Jink,
    Own(&'static str),
    Other(Other),
}

impl Transport {
    fn name(&self) -> &str {
        match self {
            Self::Jink => JINK,
            Self::Own(name) => name,
            Self::Other(other) => &other.name,
        }
    }
}

impl Args {
    /// What is to be measured.
    fn transports(&self) -> Result<Vec<Transport>, Problem> {
        let mut all = vec![Transport::Jink];
        all.extend(OWN.into_iter().filter(|name| *name != JINK).map(Transport::Own));
        for program in &self.with {
            all.extend(Other::of(program)?.into_iter().map(Transport::Other));
        }
        if let Some(unknown) = self
            .transports
            .iter()
            .find(|name| !all.iter().any(|one| one.name() == name.as_str()))
        {
            let names: Vec<&str> = all.iter().map(Transport::name).collect();
            return Err(Problem::Other(format!(
                "no transport is called {unknown}: {}",
                names.join(", ")
            )));
        }
        let is_asked = |one: &Transport| {
            self.transports.is_empty() || self.transports.iter().any(|name| name == one.name())
        };
        all.retain(|one| one.name() == BARE || is_asked(one));
        Ok(all)
    }

    fn measure(
        &self,
        transport: &Transport,
        number: usize,
        config: &Path,
        interrupt: &Interrupt,
    ) -> Result<Round, Problem> {
        let folder = Folder::new(number)?;
        let cores = std::thread::available_parallelism().map_or(1, std::num::NonZero::get);
        let chain = Chain {
            transport: transport.name().to_owned(),
            bytes: samples::bytes(self.points).to_vec(),
            rate_hz: f64::from(self.rate),
            seconds: self.seconds,
            folder: folder.path.clone(),
            cores: if self.free { 0 } else { cores },
        };
        let is_interrupted = || interrupt.has_come();
        let measured = match transport {
            Transport::Jink => {
                let stubs = Stubs {
                    instance: folder.instance.to_string(),
                    config: config.to_owned(),
                    points: self.points,
                    priority: if self.realtime { PRIORITY } else { 0 },
                };
                Stubs::program().and_then(|program| {
                    chain.measure(|place| stubs.command(&program, &chain, place), &is_interrupted)
                })
            }
            Transport::Own(_) => Stubs::program().and_then(|program| {
                chain.measure(|place| chain.stage_command(&program, place), &is_interrupted)
            }),
            Transport::Other(other) => other.measure(&chain, &is_interrupted),
        };
        measured.map_err(|fault| Problem::Other(format!("{}: {fault}", transport.name())))
    }
}

fn main() -> ExitCode {
    if let Some(code) = stubs::as_service() {
        return code;
    }
    let args = Args::parse();
    if let Some(Process::Stage(stage)) = &args.command {
        return match program::own_stage(stage, open) {
            Ok(()) => ExitCode::SUCCESS,
            Err(fault) => {
                eprintln!("jink: {}: {fault}", stage.transport);
                ExitCode::FAILURE
            }
        };
    }
    run(&args).unwrap_or_else(|problem| {
        eprintln!("jink: {problem}");
        ExitCode::from(problem.exit_code())
    })
}

fn run(args: &Args) -> Result<ExitCode, Problem> {
    let transports = args.transports()?;
    let config = places::config_folder(args.config.as_deref())?;
    let interrupt = Interrupt::listen()?;
    if args.realtime {
        // Whatever is started inherits it.
        schedule(0, Scheduling::Fifo(PRIORITY)).map_err(|error| {
            Problem::Other(format!(
                "no SCHED_FIFO priority ({error}): run with CAP_SYS_NICE, or without --realtime"
            ))
        })?;
    }
    let mut bench = Bench::new(Head {
        commit: provenance::commit(&places::program_folder()?),
        cpu: provenance::cpu(),
        kernel: provenance::kernel(),
        bytes: samples::bytes(args.points).to_vec(),
        rate_hz: args.rate,
        rounds: args.rounds,
        seconds: args.seconds,
        seed: args.seed,
        realtime: args.realtime,
        is_placed: !args.free,
    });
    let mut random = Xoshiro256PlusPlus::seed_from_u64(args.seed);
    let mut failed = false;
    let all = args.rounds as usize * transports.len();
    let mut number = 0;
    'rounds: for _ in 0..args.rounds {
        let mut order = transports.clone();
        for last in (1..order.len()).rev() {
            order.swap(last, (random.next_u64() % (last as u64 + 1)) as usize);
        }
        for transport in &order {
            number += 1;
            let left_s = (all - number + 1) as f64 * (args.seconds + 2.0);
            eprintln!(
                "{number} of {all}: {}, about {left_s:.0} s left",
                transport.name()
            );
            match args.measure(transport, number, &config, &interrupt) {
                Ok(round) => bench.add(round),
                Err(problem) => {
                    eprintln!("jink: {problem}");
                    failed = true;
                }
            }
            if interrupt.has_come() {
                failed = true;
                break 'rounds;
            }
        }
        bench.end_round();
    }
    if args.json {
        let json =
            serde_json::to_string(&bench.summary()).map_err(|error| Problem::Other(error.to_string()))?;
        sayln!("{json}");
    } else {
        say!("{}", bench.text());
    }
    Ok(ExitCode::from(if failed { EXIT_PROBLEM } else { 0 }))
}
