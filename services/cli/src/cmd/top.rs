//! `jink top`.

use jink_cli::view::top::{Pressed, Rate, Screen};
use jink_cli::view::topic_statistics::TopicStatistics;
use jink_control::meter::Meter;
use jink_control::say;
use jink_control::status::{LEGEND, Report};
use jink_control::watch::Watch;
use jink_control::{EXIT_NOT_RUNNING, EXIT_PROBLEM, Interrupt, Problem, running};
use jink_runtime::members::Members;
use jink_runtime::{Input, Instance};
use jink_shared_types::events::EventSample;
use jink_shared_types::topics::{EVENT, HEALTH, TABLE};
use ratatui::Terminal;
use ratatui::backend::{Backend, TermionBackend};
use ratatui::termion::raw::IntoRawMode;
use ratatui::termion::screen::IntoAlternateScreen;
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// How often unread samples are taken: a reader that sleeps longer would miss some of the fastest topic.
const LOOK: Timespec = Timespec {
    tv_sec: 0,
    tv_nsec: 5_000_000,
};
/// Rates are counted over this time, and the screen is drawn this often.
const WINDOW: Duration = Duration::from_secs(1);
/// Columns where there is no terminal to ask.
const WIDTH: u16 = 160;
/// A supervisor that is silent for so long does not work.
const PATIENCE: Duration = Duration::from_secs(2);

/// How to look.
#[derive(Clone, Debug, clap::Args)]
#[command(
    after_help = format!("Keys: up, down, PgUp, PgDn, Home and End scroll the topics; Tab shows topics alone, services alone, both again; q ends it.\n\n{LEGEND}\nExit codes: 0 shown; 1 the supervisor gives no status; 3 not running.")
)]
pub struct Args {
    /// Show one screen as plain text and end
    #[arg(long)]
    once: bool,
}

/// Shows the instance until the user has seen enough.
pub fn run(instance: &Instance, args: &Args) -> Result<ExitCode, Problem> {
    if running::find(instance)?.is_none() || !Watch::is_ready(instance) {
        eprintln!("jink {instance}: not running");
        return Ok(ExitCode::from(EXIT_NOT_RUNNING));
    }
    let interrupt = Interrupt::listen()?;
    let mut live = Live::open(instance)?;
    if args.once || !std::io::stdout().is_terminal() {
        let begin = Instant::now();
        while begin.elapsed() < WINDOW || live.screen.is_none() {
            live.look();
            if interrupt.has_come() || begin.elapsed() > PATIENCE {
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        live.turn();
        let Some(screen) = &live.screen else {
            eprintln!("jink {instance}: the supervisor gives no status");
            return Ok(ExitCode::from(EXIT_PROBLEM));
        };
        say!("{}", screen.text(WIDTH));
        return Ok(ExitCode::SUCCESS);
    }
    show(&mut live, &interrupt)
}

fn show(live: &mut Live, interrupt: &Interrupt) -> Result<ExitCode, Problem> {
    let io = |what: &'static str| Problem::io(what);
    let out = std::io::stdout().into_raw_mode().map_err(io("terminal"))?;
    let out = out.into_alternate_screen().map_err(io("terminal"))?;
    let mut terminal = Terminal::new(TermionBackend::new(out)).map_err(io("terminal"))?;
    terminal.hide_cursor().map_err(io("terminal"))?;
    let stdin = std::io::stdin();
    let mut turned = Instant::now();
    while !interrupt.has_come() {
        live.look();
        if turned.elapsed() >= WINDOW {
            turned = Instant::now();
            live.turn();
            live.draw(&mut terminal).map_err(io("terminal"))?;
        }
        let mut fds = [PollFd::new(&stdin, PollFlags::IN)];
        // Interrupted by a signal: the loop looks at it.
        let pressed = poll(&mut fds, Some(&LOOK)).unwrap_or(0) > 0;
        if pressed {
            // All that was typed meanwhile, before the screen is drawn once. A reader with a buffer of its own would keep the rest
            // of it until the next key.
            let mut typed = [0; 256];
            let count = rustix::io::read(&stdin, &mut typed).unwrap_or(0);
            let keys = Pressed::of(&typed[..count]);
            if count == 0 || keys.contains(&Pressed::End) {
                break;
            }
            if let Some(screen) = &mut live.screen {
                keys.into_iter().for_each(|key| screen.press(key));
            }
            live.draw(&mut terminal).map_err(io("terminal"))?;
        }
    }
    terminal.show_cursor().map_err(io("terminal"))?;
    Ok(ExitCode::SUCCESS)
}

/// What is read again and again.
struct Live {
    name: String,
    watch: Watch,
    meters: Vec<(Meter, TopicStatistics)>,
    events: Input<EventSample>,
    new_events: Vec<String>,
    screen: Option<Screen>,
}

impl Live {
    fn open(instance: &Instance) -> Result<Self, Problem> {
        let watch = Watch::open(instance)?;
        let members = Members::of_instance(instance);
        let mut meters = Vec::new();
        // Heartbeats are in the table of services, events in a list of their own.
        let measured = TABLE
            .iter()
            .filter(|row| row.name != HEALTH.row.name && row.name != EVENT.row.name);
        for row in measured {
            let one = [String::new()];
            let names = if row.is_family() {
                members.of(row)
            } else {
                &one[..]
            };
            for member in names {
                meters.push((
                    Meter::open(watch.session(), row, member)?,
                    TopicStatistics::default(),
                ));
            }
        }
        for row in super::topic::declared(instance) {
            let meter = Meter::open_declared(watch.session(), &row)?;
            meters.extend(meter.map(|meter| (meter, TopicStatistics::default())));
        }
        let events = watch.session().input(EVENT, "")?;
        Ok(Self {
            name: instance.to_string(),
            watch,
            meters,
            events,
            new_events: Vec::new(),
            screen: None,
        })
    }

    /// Takes what has come.
    fn look(&mut self) {
        for (meter, statistics) in &mut self.meters {
            meter.look(|header| statistics.take(header));
        }
        self.events.each(|event| {
            let EventSample { process, .. } = event.sample;
            self.new_events
                .push(format!("{}: {}", process.as_str(), event.sample.text()));
        });
    }

    fn draw<B: Backend>(&mut self, terminal: &mut Terminal<B>) -> Result<(), B::Error> {
        if let Some(screen) = &mut self.screen {
            terminal.draw(|frame| screen.draw(frame))?;
        }
        Ok(())
    }

    /// A window is over: what was counted in it is what is shown.
    fn turn(&mut self) {
        let Some(status) = self.watch.status() else { return };
        let now = jink_runtime::now();
        let report = Report::new(&self.name, now, &status, self.watch.link(), Vec::new());
        let rates = self
            .meters
            .iter_mut()
            .map(|(meter, statistics)| Rate {
                name: meter.name.clone(),
                row: meter.row,
                statistics: std::mem::take(statistics),
            })
            .collect();
        let before = self.screen.take().unwrap_or_else(|| Screen::of(report.clone()));
        let mut screen = Screen {
            report,
            rates,
            ..before
        };
        self.new_events.drain(..).for_each(|line| screen.push_event(line));
        self.screen = Some(screen);
    }
}
