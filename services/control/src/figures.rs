//! Figures of a running system as people and scripts read them.

use jink_shared_types::STAGE_NAMES;
use jink_shared_types::health::{EXIT_UNKNOWN, Histogram};
use serde::Serialize;

/// To three decimals: what is measured is not known better, and JSON stays readable.
pub fn round(value: f64) -> f64 {
    (value * 1e3).round() / 1e3
}

/// Median, 99th percentile and longest of what `latency` has counted (ms); nothing before the first.
pub fn latency_ms(latency: &Histogram) -> [Option<f64>; 3] {
    let figures_us = [
        latency.quantile_us(0.5),
        latency.quantile_us(0.99),
        f64::from(latency.max_us),
    ];
    figures_us.map(|us| (latency.count > 0).then(|| round(us * 1e-3)))
}

/// Those three for people; a dash where nothing was measured.
pub fn latency_text(figures_ms: [Option<f64>; 3]) -> String {
    match figures_ms {
        [Some(p50_ms), Some(p99_ms), Some(max_ms)] => {
            format!("{p50_ms:.1} / {p99_ms:.1} / {max_ms:.1} ms p50/p99/max")
        }
        _ => "-".to_owned(),
    }
}

/// What one stage of the chain adds to the way from capture to wire, waiting included.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StageLatency {
    /// The stage.
    pub stage: &'static str,
    /// Median (ms).
    pub p50_ms: f64,
    /// 99th percentile (ms).
    pub p99_ms: f64,
    /// How much of that was before its begin: the wake-up, and what it was still busy with. Median (ms).
    pub hop_p50_ms: f64,
    /// 99th percentile (ms).
    pub hop_p99_ms: f64,
}

impl StageLatency {
    /// Of all stages that were passed at all, in their order.
    pub fn of(stages: &[Histogram], hops: &[Histogram]) -> Vec<Self> {
        let ms = |histogram: &Histogram, quantile: f64| round(histogram.quantile_us(quantile) * 1e-3);
        STAGE_NAMES
            .into_iter()
            .zip(stages.iter().zip(hops))
            .filter(|(_, (whole, _))| whole.count > 0)
            .map(|(stage, (whole, hop))| Self {
                stage,
                p50_ms: ms(whole, 0.5),
                p99_ms: ms(whole, 0.99),
                hop_p50_ms: ms(hop, 0.5),
                hop_p99_ms: ms(hop, 0.99),
            })
            .collect()
    }

    /// `sensor 4.1/9.0, fusion 6.2/12.0 (begun after 0.1/0.3)`; p50/p99 in ms.
    pub fn line(stages: &[Self]) -> String {
        let words = stages.iter().map(|stage| {
            let whole = format!("{} {:.1}/{:.1}", stage.stage, stage.p50_ms, stage.p99_ms);
            match stage.stage == STAGE_NAMES[0] {
                true => whole,
                false => format!(
                    "{whole} (begun after {:.1}/{:.1})",
                    stage.hop_p50_ms, stage.hop_p99_ms
                ),
            }
        });
        words.collect::<Vec<_>>().join(", ")
    }
}

/// An exit status as the supervisor codes it, in words.
pub fn exit_text(last_exit: u32) -> String {
    match last_exit {
        0..256 => format!("code {last_exit}"),
        EXIT_UNKNOWN => "not known".to_owned(),
        signal => format!("signal {}", signal - 256),
    }
}
