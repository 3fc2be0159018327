//! `jink-foxglove live`: the flight of a running instance, for whoever connects.
//!
//! It looks on as `jink topic` does: it takes the places of spectators, which are never those that a service may need, and has a topic open
//! only while somebody has subscribed to something that is made of it. Nobody waits for it.

use crate::views::{self, View, Views, Visitor};
use foxglove::websocket::Capability;
use foxglove::{Context, FoxgloveError, WebSocketServerHandle};
use jink_control::watch::Watch;
use jink_control::{EXIT_NOT_RUNNING, Interrupt, Problem, running, sayln};
use jink_runtime::members::Members;
use jink_runtime::{Input, Instance, Session};
use jink_shared_types::Timestamp;
use jink_shared_types::topics::RANGE_CLOUD;
use std::net::{IpAddr, SocketAddr};
use std::process::ExitCode;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

/// How to serve.
#[derive(Debug, clap::Args)]
#[command(
    after_help = "Exit codes: 0 ended by Ctrl-C; 1 the address is in use or not allowed, or anything else; 3 nothing is running."
)]
pub struct Args {
    /// Which jink on this host
    #[arg(long, default_value = jink_control::DEFAULT_INSTANCE)]
    instance: Instance,
    /// Where to listen; port 0: any free one
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:8765")]
    listen: SocketAddr,
    /// Listen beyond this host, too: the protocol has no token, so everybody who reaches the address sees the flight
    #[arg(long)]
    unprotected: bool,
}

/// How often topics are looked at: of the fastest, which has 50 samples a second and keeps 16, three wait.
const LOOK: Duration = Duration::from_millis(50);
/// Messages that wait for a client, about half a second of everything; the oldest are left out then. So a client that is stuck costs the
/// memory of so many clouds, 40 MB, at most.
const BACKLOG: usize = 128;
/// How often an instance is looked for, or a topic whose places are all taken (s).
const AGAIN_S: f64 = 1.0;

/// Serves until Ctrl-C.
///
/// # Errors
/// [`Problem`] if the address cannot be had, or the instance is out of reach.
pub fn run(args: &Args) -> Result<ExitCode, Problem> {
    let interrupt = Interrupt::listen()?;
    let (instance, listen) = (&args.instance, args.listen);
    if !listen.ip().is_loopback() && !args.unprotected {
        return Err(Problem::Other(format!(
            "--listen {listen}: other hosts reach this address, and the protocol has no token: everybody there sees the flight. \
             Add --unprotected if that is meant"
        )));
    }
    if !is_running(instance)? {
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    }
    let context = Context::new();
    let mut views = Views::new(&context, ahead_ns()).map_err(|error| Problem::Other(error.to_string()))?;
    let host = match listen.ip() {
        IpAddr::V4(address) => address.to_string(),
        IpAddr::V6(address) => format!("[{address}]"),
    };
    let server = context
        .websocket_server()
        .name(format!("jink {instance}"))
        .bind(&host, listen.port())
        .message_backlog_size(BACKLOG)
        // The board's clock: what is shown together was measured together, whatever the clock of the client says.
        .capabilities([Capability::Time])
        .start_blocking()
        .map_err(|error| match error {
            FoxgloveError::Bind(cause) => Problem::io(format!("--listen {listen}"))(cause),
            other => Problem::Other(other.to_string()),
        })?;
    if !listen.ip().is_loopback() {
        eprintln!(
            "jink-foxglove: warning: everybody who reaches {listen} sees the flight: the protocol has no token"
        );
    }
    sayln!(
        "jink {instance}: live at ws://{host}:{}; Ctrl-C ends it",
        server.port()
    );
    serve(instance, &interrupt, &mut views, &server)?;
    server.stop().wait_blocking();
    Ok(ExitCode::SUCCESS)
}

fn serve(
    instance: &Instance,
    interrupt: &Interrupt,
    views: &mut Views,
    server: &WebSocketServerHandle,
) -> Result<(), Problem> {
    let mut flight: Option<Flight> = None;
    let mut look_for_due = Timestamp::NEVER;
    while !interrupt.has_come() {
        let now = jink_runtime::now();
        flight = flight.and_then(|open| open.of_this_run(instance));
        match &mut flight {
            Some(open) => open.look(now, views),
            None if now >= look_for_due => {
                look_for_due = now.plus_seconds(AGAIN_S);
                if is_running(instance)? {
                    flight = Flight::open(instance, views).inspect_err(log).ok();
                }
            }
            None => {}
        }
        server.broadcast_time(views::unix_ns(now, views.ahead_ns));
        std::thread::sleep(LOOK);
    }
    Ok(())
}

/// The instance may be gone, or its places for spectators taken, for now.
fn log(problem: &Problem) {
    tracing::warn!("{problem}");
}

/// Whether something flies: a supervisor, or what one has left that was killed, with memory that is ready.
fn is_running(instance: &Instance) -> Result<bool, Problem> {
    let runs = running::find(instance)?.is_some() || running::has_orphans(instance);
    Ok(runs && Watch::is_ready(instance))
}

/// Time of the day minus the clock of samples (ns): as it is at the start, so that times keep their distances if the clock is set.
fn ahead_ns() -> i64 {
    let unix = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    let unix_ns = i64::try_from(unix.as_nanos()).unwrap_or(i64::MAX);
    unix_ns.saturating_sub_unsigned(jink_runtime::now().ns)
}

/// A connection to the memory of a run of an instance.
struct Flight {
    run: Option<u64>,
    readers: Vec<Box<dyn Look>>,
    /// Last: the inputs above belong to its connection.
    watch: Watch,
}

impl Flight {
    fn open(instance: &Instance, views: &mut Views) -> Result<Self, Problem> {
        let run = instance.run();
        let members = Members::of_instance(instance);
        members.clouds.iter().for_each(|sensor| views.add_cloud(sensor));
        let mut readers = Readers {
            members,
            all: Vec::new(),
        };
        views::each(&mut readers);
        Ok(Self {
            run,
            readers: readers.all,
            watch: Watch::open(instance)?,
        })
    }

    /// Itself, as long as its run has not ended.
    fn of_this_run(self, instance: &Instance) -> Option<Self> {
        (self.run.is_some() && instance.run() == self.run).then_some(self)
    }

    fn look(&mut self, now: Timestamp, views: &mut Views) {
        for reader in &mut self.readers {
            reader.look(self.watch.session(), now, views);
        }
    }
}

/// A reader of each topic that is shown.
struct Readers {
    members: Members,
    all: Vec<Box<dyn Look>>,
}

impl Visitor for Readers {
    fn visit<V: View>(&mut self) {
        let one = [String::new()];
        let members = match V::TOPIC.row.name == RANGE_CLOUD.row.name {
            true => &self.members.clouds,
            false => &one[..],
        };
        let reader = |member: &String| -> Box<dyn Look> {
            Box::new(Reader::<V> {
                member: member.clone(),
                input: None,
                again_at: Timestamp::NEVER,
            })
        };
        self.all.extend(members.iter().map(reader));
    }
}

trait Look {
    /// Shows what has come, if anybody wants it.
    fn look(&mut self, session: &Session, now: Timestamp, views: &mut Views);
}

struct Reader<V: View> {
    member: String,
    input: Option<Input<V>>,
    /// When it is opened again if it could not be; never if that was not tried.
    again_at: Timestamp,
}

impl<V: View> Look for Reader<V> {
    fn look(&mut self, session: &Session, now: Timestamp, views: &mut Views) {
        if !V::is_wanted(views, &self.member) {
            (self.input, self.again_at) = (None, Timestamp::NEVER);
            return;
        }
        if self.input.is_none() && now >= self.again_at {
            let is_first = !self.again_at.is_set();
            self.again_at = now.plus_seconds(AGAIN_S);
            match session.input(V::TOPIC, &self.member) {
                Ok(input) if V::TOPIC.row.is_shared() => self.input = Some(input.of_all_producers()),
                Ok(input) => self.input = Some(input),
                Err(error) if is_first => tracing::warn!("{error}; tried again every second"),
                Err(_) => {}
            }
        }
        if let Some(input) = &mut self.input {
            input.each(|sample| V::show(sample, &self.member, views));
        }
    }
}
