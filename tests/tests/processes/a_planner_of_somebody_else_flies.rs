//! A planner that is no part of jink is a row of the process table: the planner of jink flies its ways, in Rust and in Python.
//! It is killed and replaced in flight like any other process; the goal is reached and nothing is touched.

use jink_runtime::Session;
use jink_shared_types::motion::{Route, RouteMode};
use jink_shared_types::proposal::{Proposal, ProposalAnswer};
use jink_shared_types::{coded::Wire, topics};
use jink_tests::peers::{ICEORYX2, python_or_say};
use jink_tests::processes::{Flight, TempFolder, answer, programs, until, workspace};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::JoinHandle;
use std::time::Duration;

const PROCESS: &str = "user_planner";

/// Its row, with what is its own besides.
fn row(program: &str, more: &str) -> String {
    format!(
        "\n[[process]]\nname = \"{PROCESS}\"\nprogram = \"{program}\"\nreads = [\"map/local\", \"vehicle/desired_path\"]\n\
         publishes = [\"plan/proposal\"]\nessential = false\n{more}"
    )
}

/// The configuration of the workspace with another row.
fn with_row(role: &str, row: &str) -> TempFolder {
    let folder = TempFolder::with_config(role);
    let table = std::fs::read_to_string(folder.path().join("services.toml")).unwrap();
    folder.write("services.toml", &(table + row));
    folder
}

/// What was proposed, and what became of it.
#[derive(Debug, Default)]
struct Seen {
    /// Proposals of each start of the proposer, and how many of them stood when the newest answer said that they are flown.
    proposed: BTreeMap<u32, (u32, u32)>,
    /// Answers by what they say.
    answers: BTreeMap<&'static str, u32>,
    /// Plans, and how many of them were made of proposals.
    plans: (u32, u32),
    flown: bool,
}

impl Seen {
    fn propose(&mut self, generation: u32) {
        let (all, flown) = self.proposed.entry(generation).or_default();
        *all += 1;
        *flown += u32::from(self.flown);
    }

    fn answer(&mut self, answer: &ProposalAnswer) {
        let verdict = answer.verdict.get();
        self.flown = verdict.is_flown();
        *self.answers.entry(verdict.name()).or_default() += 1;
    }

    fn plan(&mut self, route: &Route) {
        if route.mode == RouteMode::Plan {
            self.plans.0 += 1;
            self.plans.1 += u32::from(route.proposal_id.get().is_some());
        }
    }

    /// Starts of the proposer whose proposals were flown.
    fn starts_flown(&self) -> usize {
        self.proposed.values().filter(|(_, flown)| *flown > 0).count()
    }

    fn text(&self) -> String {
        let (all, flown) = (self.proposed.values()).fold((0, 0), |(a, f), (all, flown)| (a + all, f + flown));
        let (plans, of_proposals) = self.plans;
        let mut text =
            format!("{flown} of {all} proposals flown, {of_proposals} of {plans} plans made of them;");
        for (verdict, count) in &self.answers {
            // Writing into a string cannot fail.
            let _infallible = write!(text, " {verdict} {count}");
        }
        text
    }
}

/// Watches both topics until it is asked to end.
struct Observer {
    seen: Arc<Mutex<Seen>>,
    end: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Observer {
    fn of(instance: &str) -> Self {
        let (seen, end) = (
            Arc::new(Mutex::new(Seen::default())),
            Arc::new(AtomicBool::new(false)),
        );
        let (shared, over, instance) = (Arc::clone(&seen), Arc::clone(&end), instance.to_owned());
        let thread = std::thread::spawn(move || {
            let session = Session::open(&instance.parse().unwrap(), "cli").unwrap();
            let mut proposals = session
                .input::<Proposal>(topics::PROPOSAL, "")
                .unwrap()
                .of_all_producers();
            let mut answers = session
                .input::<ProposalAnswer>(topics::PROPOSAL_ANSWER, "")
                .unwrap();
            let mut routes = session.input::<Route>(topics::ROUTE, "").unwrap();
            while !over.load(Ordering::Relaxed) {
                let mut seen = shared.lock().unwrap();
                routes.each(|route| seen.plan(route.sample));
                answers.each(|answer| seen.answer(answer.sample));
                proposals.each(|proposal| seen.propose(proposal.header.generation));
                drop(seen);
                std::thread::sleep(Duration::from_millis(20));
            }
        });
        Self {
            seen,
            end,
            thread: Some(thread),
        }
    }

    fn starts_flown(&self) -> usize {
        self.seen.lock().unwrap().starts_flown()
    }

    /// Lets go of shared memory.
    fn finish(&mut self) -> Seen {
        self.end.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.join().unwrap();
        }
        std::mem::take(&mut *self.seen.lock().unwrap())
    }
}

impl Drop for Observer {
    fn drop(&mut self) {
        self.end.store(true, Ordering::Relaxed);
    }
}

/// Flies with the planner of `folder`, which is killed and then replaced by `replacement` while its ways are flown.
fn fly(folder: &TempFolder, replacement: &str) {
    let flight = Flight::begin(&["--seed", "5", "--speed", "2", "--config", folder.text()]);
    flight.until_it_flies();
    let mut observer = Observer::of(flight.instance());
    until("a proposal that is flown", || observer.starts_flown() == 1);

    let killed = flight.kill(PROCESS);
    until("a proposal of the second start that is flown", || {
        observer.starts_flown() == 2
    });
    assert_ne!(flight.service(PROCESS)["pid"], killed);
    assert_eq!(flight.service(PROCESS)["restarts"], 1);

    let swap = flight.jink(&["swap", PROCESS, replacement]);
    assert_eq!(swap.code, Some(0), "{swap:?}");
    until("a proposal of the replacement that is flown", || {
        observer.starts_flown() == 3
    });
    assert!(flight.truth()["mode"] == "mission", "it was replaced in flight");

    until("the end of the mission", || flight.truth()["mode"] != "mission");
    let seen = observer.finish();
    let figures: Value = flight.end();
    println!(
        "{}; clearance {} m, flight {} s, restarts {}",
        seen.text(),
        figures["min_clearance_m"],
        figures["flight_time_s"],
        figures["restarts"]
    );
    assert_eq!(figures["outcome"], "goal", "{figures}");
    assert_eq!(figures["collisions"], 0, "{figures}");
    assert_eq!(figures["fcu_hold_count"], 0, "{figures}");
    // The rest are those before the first proposal, around both replacements, and on the way out of narrow places.
    let (plans, of_proposals) = seen.plans;
    assert!(2 * of_proposals > plans, "{}", seen.text());
}

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn one_in_rust_is_killed_and_swapped_in_flight() {
    let folder = with_row(
        "own_planner",
        &row("jink-own-planner", "cycle_budget_us = 20000\n"),
    );
    // Another planner altogether.
    let replacement = programs().join("jink-minimal-planner");
    fly(&folder, replacement.to_str().unwrap());
}

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn one_in_python_is_killed_and_replaced_in_flight() {
    let Some(python) = python_or_say(&ICEORYX2) else {
        return;
    };
    let folder = TempFolder::new("own_planner_py");
    for file in ["foreign.py", "own_planner.py"] {
        let text = std::fs::read_to_string(workspace().join("tests/own_planner").join(file)).unwrap();
        folder.write(file, &text);
    }
    let schema = answer(&mut jink_tests::processes::program(
        "jink",
        &["schema", "--python"],
    ));
    folder.write("jink.py", &schema.stdout);
    let program = |name: &str| -> PathBuf {
        let script = folder.path().join("own_planner.py");
        let text = format!(
            "#!/bin/sh\nexec {} {} \"$@\"\n",
            python.display(),
            script.display()
        );
        let path = folder.write(name, &text);
        let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
        std::fs::set_permissions(&path, mode).unwrap();
        path
    };
    let (first, second) = (program("planner"), program("planner_2"));
    let more = "shadow = false\nheartbeat_timeout_ms = 500\n";
    let config = with_row("own_planner_py_config", &row(first.to_str().unwrap(), more));
    fly(&config, second.to_str().unwrap());
}
