//! `jink ring`.

use jink_cli::view::ring::RingView;
use jink_control::watch::Watch;
use jink_control::{EXIT_NOT_RUNNING, Problem, running};
use jink_control::{say, sayln};
use jink_runtime::{Input, Instance};
use jink_shared_types::ring::SectorRing;
use jink_shared_types::topics;
use std::net::{SocketAddr, ToSocketAddrs, UdpSocket};
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// How to look.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = "Exit codes: 0 shown; 1 the guard says nothing; 3 not running.\n\nPlotJuggler: Streaming, UDP Server, port 9870, protocol JSON, \
                  use field \"timestamp\" as time; then `jink ring --plotjuggler 127.0.0.1:9870`."
)]
pub struct Args {
    /// One JSON object instead of a picture
    #[arg(long, conflicts_with_all = ["watch", "plotjuggler"])]
    json: bool,
    /// Show it again and again, until Ctrl-C
    #[arg(long, conflicts_with = "plotjuggler")]
    watch: bool,
    /// Send every ring as one JSON datagram to a PlotJuggler there, until Ctrl-C
    #[arg(long, value_name = "HOST:PORT")]
    plotjuggler: Option<String>,
}

/// The ring comes fifteen times a second.
const PATIENCE: Duration = Duration::from_secs(2);
const PAUSE: Duration = Duration::from_millis(10);
const EXIT_SILENT: u8 = 1;
/// Clears the screen and goes to its beginning.
const CLEAR: &str = "\x1b[2J\x1b[H";

/// Shows what the guard sees around the vehicle.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    if running::find(instance)?.is_none() || !Watch::is_ready(instance) {
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    }
    let watch = Watch::open(instance)?;
    let mut input = watch.session().input(topics::RING, "")?;
    let mut plot = args.plotjuggler.as_deref().map(Plot::open).transpose()?;
    let mut shown = 0u64;
    while let Some(view) = next(&mut input) {
        shown += 1;
        if let Some(plot) = &mut plot {
            plot.send(&view);
        } else if args.json {
            let json = serde_json::to_string(&view).map_err(|error| Problem::Other(error.to_string()))?;
            sayln!("{json}");
        } else if args.watch {
            say!("{CLEAR}{}", view.text());
        } else {
            say!("{}", view.text());
        }
        if plot.is_none() && !args.watch {
            return Ok(ExitCode::SUCCESS);
        }
    }
    eprintln!("jink {instance}: the guard says nothing; `jink status` shows how it is");
    Ok(ExitCode::from(if shown > 0 { 0 } else { EXIT_SILENT }))
}

/// The next ring that comes; `None` if none does.
fn next(input: &mut Input<SectorRing>) -> Option<RingView> {
    let begin = Instant::now();
    while begin.elapsed() < PATIENCE {
        let now = jink_runtime::now();
        let mut view = None;
        input.each(|ring| view = Some(RingView::of(ring.sample, ring.header.publish, now)));
        if view.is_some() {
            return view;
        }
        std::thread::sleep(PAUSE);
    }
    None
}

/// Where rings are sent to be plotted.
struct Plot {
    socket: UdpSocket,
    to: SocketAddr,
}

impl Plot {
    fn open(address: &str) -> Result<Self, Problem> {
        let other = |error: std::io::Error| Problem::Other(format!("--plotjuggler {address}: {error}"));
        let to = address
            .to_socket_addrs()
            .map_err(other)?
            .next()
            .ok_or_else(|| Problem::Other(format!("--plotjuggler {address}: nobody has this name")))?;
        let any = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
        let socket = UdpSocket::bind(any).map_err(other)?;
        Ok(Self { socket, to })
    }

    /// Nobody may listen yet: that is no reason to end.
    fn send(&mut self, view: &RingView) {
        let json = view.plot_json(jink_runtime::now().seconds()).to_string();
        let _nobody_listens = self.socket.send_to(json.as_bytes(), self.to);
    }
}
