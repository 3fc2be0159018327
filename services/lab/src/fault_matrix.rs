//! A fault campaign in figures: the matrix of what came of its faults.

use crate::drill::Fault;
use crate::flight_log::{FaultRecord, Outcome, Summary};
use crate::handover::SeamFigures;
use jink_control::figures::round;
use jink_shared_types::quantile::quantile;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// What came of all faults of one kind to one process in one phase.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Cell {
    /// Process.
    pub service: String,
    /// Kind of fault.
    pub fault: String,
    /// Mode of the autopilot.
    pub phase: String,
    /// How many.
    pub count: usize,
    /// How many of them the process did not survive.
    pub not_back: usize,
    /// Contacts with obstacles.
    pub collisions: u32,
    /// Falls to Hold.
    pub holds: u32,
    /// Largest gap between setpoints (ms).
    pub gap_max_ms: f64,
    /// Recovery, median (ms); `None` if there is nothing to recover from.
    pub recovery_ms_p50: Option<f64>,
    /// Longest recovery (ms).
    pub recovery_ms_max: Option<f64>,
}

/// What the readers of one topic saw of all swaps of its producer.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SeamRow {
    /// Process.
    pub service: String,
    /// Topic.
    pub topic: String,
    /// Swaps.
    pub swaps: usize,
    /// Samples looked at.
    pub samples: usize,
    /// Measurements that nobody passed on.
    pub missing: usize,
    /// Measurements that both passed on.
    pub doubled: usize,
    /// Samples out of order.
    pub reordered: usize,
    /// From the last sample of one to the first of the next, in declared periods: median.
    pub gap_periods_p50: f64,
    /// 95th percentile.
    pub gap_periods_p95: f64,
    /// Largest.
    pub gap_periods_max: f64,
}

/// The whole campaign.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Campaign {
    /// Flights.
    pub flights: usize,
    /// Of those, flights that did not reach the goal.
    pub lost: usize,
    /// Faults made.
    pub faults: usize,
    /// Of those, the ones that a process did not survive.
    pub not_back: usize,
    /// Contacts with obstacles.
    pub collisions: u32,
    /// Largest gap between setpoints (ms).
    pub setpoint_max_gap_ms: f64,
    /// Largest gap that no fault was under way in (ms): what the machine does by itself.
    pub quiet_max_gap_ms: f64,
    /// Falls to Hold.
    pub fcu_hold_count: u32,
    /// Detection of hangs, median (ms).
    pub detection_ms_p50: Option<f64>,
    /// 99th percentile (ms).
    pub detection_ms_p99: Option<f64>,
    /// Recovery, median (ms).
    pub recovery_ms_p50: Option<f64>,
    /// 99th percentile (ms).
    pub recovery_ms_p99: Option<f64>,
    /// Longest time by which the machine woke an idle thread late (ms).
    pub machine_stall_max_ms: f64,
    /// By process, fault and phase.
    pub matrix: Vec<Cell>,
    /// By process and topic, of swaps.
    pub seams: Vec<SeamRow>,
    /// Swaps that were not made, and why.
    pub refused: Vec<String>,
}

impl Campaign {
    /// The figures of `flights`.
    pub fn of(flights: &[Summary]) -> Self {
        let faults = || flights.iter().flat_map(|flight| &flight.faults);
        let recoveries: Vec<f64> = faults().filter_map(|fault| fault.recovery_ms).collect();
        let detections: Vec<f64> = faults().filter_map(|fault| fault.detection_ms).collect();
        let largest = |values: &mut dyn Iterator<Item = f64>| values.fold(0.0, f64::max);
        Self {
            flights: flights.len(),
            lost: flights
                .iter()
                .filter(|flight| flight.outcome != Outcome::Goal.word())
                .count(),
            faults: faults().count(),
            not_back: faults().filter(|fault| !fault.survived).count(),
            collisions: flights.iter().map(|flight| flight.collisions).sum(),
            setpoint_max_gap_ms: largest(&mut flights.iter().map(|flight| flight.setpoint_max_gap_ms)),
            quiet_max_gap_ms: largest(&mut flights.iter().filter_map(quiet_gap_ms)),
            fcu_hold_count: flights.iter().map(|flight| flight.fcu_hold_count).sum(),
            detection_ms_p50: at(&detections, 0.5),
            detection_ms_p99: at(&detections, 0.99),
            recovery_ms_p50: at(&recoveries, 0.5),
            recovery_ms_p99: at(&recoveries, 0.99),
            machine_stall_max_ms: largest(&mut flights.iter().map(|flight| flight.machine_stall_max_ms)),
            matrix: matrix(faults()),
            seams: seams(faults()),
            refused: faults()
                .filter(|fault| fault.fault == Fault::Swap && !fault.survived)
                .map(FaultRecord::line)
                .collect(),
        }
    }

    /// For people.
    pub fn text(&self) -> String {
        let ms = |value: Option<f64>| value.map_or("-".to_owned(), |ms| format!("{ms:.0}"));
        let mut out = format!(
            "{} flights, {} faults: {} not at the goal, {} collisions, {} falls to Hold, {} not back\n\
             largest gap {:.0} ms (without a fault under way {:.0}); the machine stood still for {:.0} ms at most\n\
             detection {} / {} ms, recovery {} / {} ms p50/p99\n\n\
             {:<17} {:<8} {:<8} {:>5} {:>8} {:>10} {:>5} {:>7} {:>13}\n",
            self.flights,
            self.faults,
            self.lost,
            self.collisions,
            self.fcu_hold_count,
            self.not_back,
            self.setpoint_max_gap_ms,
            self.quiet_max_gap_ms,
            self.machine_stall_max_ms,
            ms(self.detection_ms_p50),
            ms(self.detection_ms_p99),
            ms(self.recovery_ms_p50),
            ms(self.recovery_ms_p99),
            "service",
            "fault",
            "phase",
            "count",
            "not back",
            "collisions",
            "holds",
            "gap ms",
            "recovery ms"
        );
        for cell in &self.matrix {
            // Writing into a string cannot fail.
            let _infallible = writeln!(
                out,
                "{:<17} {:<8} {:<8} {:>5} {:>8} {:>10} {:>5} {:>7.0} {:>13}",
                cell.service,
                cell.fault,
                cell.phase,
                cell.count,
                cell.not_back,
                cell.collisions,
                cell.holds,
                cell.gap_max_ms,
                format!("{} / {}", ms(cell.recovery_ms_p50), ms(cell.recovery_ms_max)),
            );
        }
        if !self.seams.is_empty() {
            let _infallible = writeln!(
                out,
                "\n{:<17} {:<18} {:>5} {:>7} {:>7} {:>7} {:>9} {:>23}",
                "swapped",
                "topic",
                "swaps",
                "samples",
                "missing",
                "doubled",
                "reordered",
                "gap periods p50/p95/max"
            );
        }
        for row in &self.seams {
            let _infallible = writeln!(
                out,
                "{:<17} {:<18} {:>5} {:>7} {:>7} {:>7} {:>9} {:>23}",
                row.service,
                row.topic,
                row.swaps,
                row.samples,
                row.missing,
                row.doubled,
                row.reordered,
                format!(
                    "{:.2} / {:.2} / {:.2}",
                    row.gap_periods_p50, row.gap_periods_p95, row.gap_periods_max
                ),
            );
        }
        if !self.refused.is_empty() {
            out.push_str("\nswaps that were not made:\n");
        }
        for refused in &self.refused {
            let _infallible = writeln!(out, "  {refused}");
        }
        out
    }
}

/// The largest gap of a flight if it is larger than that of any of its faults.
fn quiet_gap_ms(flight: &Summary) -> Option<f64> {
    let of_faults = flight.faults.iter().map(|fault| fault.gap_ms).fold(0.0, f64::max);
    // The simulation counts in steps of 4 ms, the watcher in samples of them.
    (flight.setpoint_max_gap_ms > of_faults + 8.0).then_some(flight.setpoint_max_gap_ms)
}

fn matrix<'a>(faults: impl Iterator<Item = &'a FaultRecord>) -> Vec<Cell> {
    let mut cells: BTreeMap<(String, Fault, String), Vec<&FaultRecord>> = BTreeMap::new();
    for fault in faults {
        let key = (fault.process.clone(), fault.fault, fault.phase.clone());
        cells.entry(key).or_default().push(fault);
    }
    let cell = |((service, fault, phase), records): ((String, Fault, String), Vec<&FaultRecord>)| {
        let recoveries: Vec<f64> = records.iter().filter_map(|record| record.recovery_ms).collect();
        Cell {
            service,
            fault: fault.to_string(),
            phase,
            count: records.len(),
            not_back: records.iter().filter(|record| !record.survived).count(),
            collisions: records.iter().map(|record| record.collisions).sum(),
            holds: records.iter().map(|record| record.holds).sum(),
            gap_max_ms: records.iter().map(|record| record.gap_ms).fold(0.0, f64::max),
            recovery_ms_p50: at(&recoveries, 0.5),
            recovery_ms_max: at(&recoveries, 1.0),
        }
    };
    cells.into_iter().map(cell).collect()
}

fn seams<'a>(faults: impl Iterator<Item = &'a FaultRecord>) -> Vec<SeamRow> {
    let mut rows: BTreeMap<(&str, &str), Vec<&SeamFigures>> = BTreeMap::new();
    for fault in faults {
        for seam in &fault.seams {
            rows.entry((&fault.process, &seam.topic)).or_default().push(seam);
        }
    }
    let row = |((service, topic), seams): ((&str, &str), Vec<&SeamFigures>)| {
        let gaps: Vec<f64> = seams.iter().map(|seam| seam.gap_periods).collect();
        SeamRow {
            service: service.to_owned(),
            topic: topic.to_owned(),
            swaps: seams.len(),
            samples: seams.iter().map(|seam| seam.samples).sum(),
            missing: seams.iter().map(|seam| seam.missing).sum(),
            doubled: seams.iter().map(|seam| seam.doubled).sum(),
            reordered: seams.iter().map(|seam| seam.reordered).sum(),
            gap_periods_p50: at(&gaps, 0.5).unwrap_or(0.0),
            gap_periods_p95: at(&gaps, 0.95).unwrap_or(0.0),
            gap_periods_max: at(&gaps, 1.0).unwrap_or(0.0),
        }
    };
    rows.into_iter().map(row).collect()
}

/// The value at `share` as it is shown; `None` without values.
fn at(values: &[f64], share: f64) -> Option<f64> {
    quantile(values, share).map(round)
}

#[cfg(test)]
mod tests {
    use super::Campaign;
    use crate::drill::Fault;
    use crate::flight_log::{FaultRecord, FlightLog, Outcome};

    fn record(fault: Fault, recovery_ms: Option<f64>, gap_ms: f64) -> FaultRecord {
        FaultRecord {
            fault,
            process: "planner".to_owned(),
            at_s: 5.0,
            phase: "mission".to_owned(),
            survived: recovery_ms.is_some(),
            detection_ms: None,
            recovery_ms,
            gap_ms,
            collisions: 0,
            holds: 0,
            north_m: 0.0,
            east_m: 0.0,
            seams: Vec::new(),
            reason: None,
        }
    }

    #[test]
    fn the_matrix_sums_up_and_an_unsurvived_fault_is_not_hidden() {
        let faults = vec![
            record(Fault::Kill, Some(12.0), 60.0),
            record(Fault::Kill, Some(20.0), 64.0),
            record(Fault::Stop, None, 80.0),
        ];
        let mut flown = FlightLog::default().summary(&Outcome::Timeout, "forest", 1, 0, faults);
        flown.setpoint_max_gap_ms = 120.0;
        let campaign = Campaign::of(&[flown]);
        assert_eq!((campaign.faults, campaign.lost, campaign.not_back), (3, 1, 1));
        assert_eq!(
            (campaign.setpoint_max_gap_ms, campaign.quiet_max_gap_ms),
            (120.0, 120.0)
        );
        assert_eq!(campaign.matrix.len(), 2);
        assert_eq!(campaign.matrix[0].count, 2);
        assert_eq!(campaign.matrix[0].recovery_ms_max, Some(20.0));
        assert!(
            campaign
                .text()
                .contains("planner           stop     mission      1        1"),
            "{}",
            campaign.text()
        );
    }
}
