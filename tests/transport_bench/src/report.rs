//! What was measured, as a table and as one JSON object.

use crate::{BARE, JINK};
use jink_control::figures::round;
use jink_shared_types::quantile::{quantile, quantiles};
use jink_transport_chain::Round;
use serde::Serialize;
use std::fmt::Write as _;

/// Under which circumstances.
#[derive(Clone, Debug, Serialize)]
pub struct Head {
    /// Of the checkout.
    pub commit: Option<String>,
    /// Name and number of cores.
    pub cpu: String,
    /// Its release.
    pub kernel: String,
    /// Message of each hop.
    pub bytes: Vec<usize>,
    /// Of the first process.
    pub rate_hz: u32,
    /// Times that everything was measured.
    pub rounds: u32,
    /// How long each time (s).
    pub seconds: f64,
    /// Of the order.
    pub seed: u64,
    /// With SCHED_FIFO.
    pub realtime: bool,
    /// Each process on the core after that of its neighbour.
    pub is_placed: bool,
}

/// What is known of one transport.
#[derive(Clone, Debug, Serialize)]
pub struct Figures {
    /// Its name.
    pub name: String,
    /// Messages.
    pub n: usize,
    /// Median over all rounds (us).
    pub p50_us: f64,
    /// Nine of ten.
    pub p90_us: f64,
    /// 99 of a hundred.
    pub p99_us: f64,
    /// 999 of a thousand.
    pub p999_us: f64,
    /// The longest.
    pub max_us: f64,
    /// Least and largest median of a round (us).
    pub p50_spread_us: [f64; 2],
    /// To bare iceoryx2 in the same round: median, least, largest.
    pub ratio_p50: Option<[f64; 3]>,
    /// The same of the 99th percentile.
    pub ratio_p99: Option<[f64; 3]>,
    /// Of all processes (% of one core).
    pub cpu_percent: f64,
    /// Messages that did not pass.
    pub lost: usize,
    /// Messages that were not whole.
    pub torn: u64,
}

/// All figures.
#[derive(Clone, Debug, Serialize)]
pub struct Summary {
    /// jink to bare iceoryx2: median over the rounds of the ratio of the medians within one.
    pub ratio_p50: Option<f64>,
    /// The same of the 99th percentile.
    pub ratio_p99: Option<f64>,
    /// The transports, fastest first.
    pub transports: Vec<Figures>,
    /// Under which circumstances.
    #[serde(flatten)]
    pub head: Head,
}

/// What has been measured so far.
#[derive(Debug)]
pub struct Bench {
    head: Head,
    rounds: Vec<Vec<Round>>,
}

/// Median and 99th percentile of a round (us).
fn typical(round: &Round) -> Option<[f64; 2]> {
    quantiles(&round.latencies_us, [0.5, 0.99])
}

impl Bench {
    /// Nothing yet.
    pub fn new(head: Head) -> Self {
        Self {
            head,
            rounds: vec![Vec::new()],
        }
    }

    /// One transport has been measured.
    pub fn add(&mut self, measured: Round) {
        if let Some(last) = self.rounds.last_mut() {
            last.push(measured);
        }
    }

    /// All have been.
    pub fn end_round(&mut self) {
        self.rounds.push(Vec::new());
    }

    /// Median, least and largest ratio of `name` to bare iceoryx2: of the medians and of the 99th percentiles.
    fn ratios(&self, name: &str) -> [Option<[f64; 3]>; 2] {
        let of_rounds: Vec<[f64; 2]> = self
            .rounds
            .iter()
            .filter_map(|rounds| {
                let figure = |name: &str| rounds.iter().find(|one| one.transport == name).and_then(typical);
                let (one, bare) = (figure(name)?, figure(BARE)?);
                Some([0, 1].map(|which: usize| one[which] / bare[which].max(1e-9)))
            })
            .collect();
        [0, 1].map(|which: usize| {
            let ratios: Vec<f64> = of_rounds.iter().map(|ratios| ratios[which]).collect();
            quantiles(&ratios, [0.5, 0.0, 1.0]).map(|ratios| ratios.map(round))
        })
    }

    fn figures(&self, name: &str) -> Option<Figures> {
        let rounds: Vec<&Round> = self
            .rounds
            .iter()
            .flatten()
            .filter(|one| one.transport == name)
            .collect();
        let all: Vec<f64> = rounds
            .iter()
            .flat_map(|one| one.latencies_us.iter().copied())
            .collect();
        let [p50, p90, p99, p999, max] = quantiles(&all, [0.5, 0.9, 0.99, 0.999, 1.0])?;
        let medians: Vec<f64> = rounds
            .iter()
            .filter_map(|one| typical(one))
            .map(|[p50, _]| p50)
            .collect();
        let cpu: Vec<f64> = rounds.iter().map(|one| one.cpu_percent).collect();
        let [ratio_p50, ratio_p99] = self.ratios(name);
        Some(Figures {
            name: name.to_owned(),
            n: all.len(),
            p50_us: round(p50),
            p90_us: round(p90),
            p99_us: round(p99),
            p999_us: round(p999),
            max_us: round(max),
            p50_spread_us: quantiles(&medians, [0.0, 1.0])?.map(round),
            ratio_p50,
            ratio_p99,
            cpu_percent: round(quantile(&cpu, 0.5)?),
            lost: rounds.iter().map(|one| one.lost).sum(),
            torn: rounds.iter().map(|one| one.torn).sum(),
        })
    }

    /// All figures.
    pub fn summary(&self) -> Summary {
        let mut names: Vec<&str> = self
            .rounds
            .iter()
            .flatten()
            .map(|one| one.transport.as_str())
            .collect();
        names.sort_unstable();
        names.dedup();
        let mut transports: Vec<Figures> = names.into_iter().filter_map(|name| self.figures(name)).collect();
        transports.sort_by(|one, other| one.p50_us.total_cmp(&other.p50_us));
        let [p50, p99] = self.ratios(JINK);
        Summary {
            ratio_p50: p50.map(|[median, ..]| median),
            ratio_p99: p99.map(|[median, ..]| median),
            transports,
            head: self.head.clone(),
        }
    }

    /// The table.
    pub fn text(&self) -> String {
        let summary = self.summary();
        let Head {
            commit,
            cpu,
            kernel,
            bytes,
            rate_hz,
            rounds,
            seconds,
            seed,
            realtime,
            is_placed,
        } = &summary.head;
        let mut text = String::new();
        let _never_fails = writeln!(
            text,
            "{cpu}, Linux {kernel}, commit {}\n{rate_hz} Hz, hops of {} bytes, {rounds} rounds of {seconds} s, seed {seed}, {} scheduling, {}",
            commit.as_deref().unwrap_or("unknown"),
            bytes.iter().map(usize::to_string).collect::<Vec<_>>().join(" + "),
            if *realtime { "SCHED_FIFO" } else { "ordinary" },
            if *is_placed {
                "neighbours on different cores"
            } else {
                "placed by the kernel"
            },
        );
        let _never_fails = writeln!(
            text,
            "\n{:12} {:>7} {:>8} {:>8} {:>8} {:>8} {:>8}  {:>15}  {:>19} {:>19} {:>6} {:>5} {:>5}",
            "",
            "n",
            "p50 us",
            "p90",
            "p99",
            "p99.9",
            "max",
            "p50 of rounds",
            "p50 / iceoryx2",
            "p99 / iceoryx2",
            "CPU %",
            "lost",
            "torn"
        );
        for one in &summary.transports {
            let spread = format!("{:.0}..{:.0}", one.p50_spread_us[0], one.p50_spread_us[1]);
            let ratio = |ratio: Option<[f64; 3]>| {
                ratio.map_or("-".to_owned(), |[median, least, most]| {
                    format!("{median:.2} ({least:.2}..{most:.2})")
                })
            };
            let _never_fails = writeln!(
                text,
                "{:12} {:>7} {:>8.0} {:>8.0} {:>8.0} {:>8.0} {:>8.0}  {:>15}  {:>19} {:>19} {:>6.1} {:>5} {:>5}",
                one.name,
                one.n,
                one.p50_us,
                one.p90_us,
                one.p99_us,
                one.p999_us,
                one.max_us,
                spread,
                ratio(one.ratio_p50),
                ratio(one.ratio_p99),
                one.cpu_percent,
                one.lost,
                one.torn
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::{Bench, Head};
    use jink_transport_chain::Round;

    fn round(transport: &str, latency_us: f64) -> Round {
        Round {
            transport: transport.to_owned(),
            latencies_us: vec![latency_us; 10],
            ..Round::default()
        }
    }

    #[test]
    fn a_ratio_is_taken_within_a_round() {
        let mut bench = Bench::new(Head {
            commit: None,
            cpu: String::new(),
            kernel: String::new(),
            bytes: vec![8],
            rate_hz: 1,
            rounds: 3,
            seconds: 1.0,
            seed: 1,
            realtime: false,
            is_placed: true,
        });
        // A machine that is ten times slower in the second round, and a round without jink.
        for (bare, jink) in [(100.0, Some(110.0)), (1_000.0, Some(1_200.0)), (100.0, None)] {
            bench.add(round("iceoryx2", bare));
            jink.into_iter().for_each(|jink| bench.add(round("jink", jink)));
            bench.end_round();
        }
        let summary = bench.summary();
        assert_eq!(summary.ratio_p50, Some(1.2));
        let names: Vec<&str> = summary.transports.iter().map(|one| one.name.as_str()).collect();
        assert_eq!(names, ["iceoryx2", "jink"]);
        assert_eq!(summary.transports[1].ratio_p99, Some([1.2, 1.1, 1.2]));
        assert!(bench.text().contains("1.20 (1.10..1.20)"), "{}", bench.text());
    }
}
