//! What is read of the logs of PX4 and ArduPilot, and what becomes of damaged ones.

use jink_report::{AutopilotLog, ReportError};
use jink_testkit::temp_folder::TempFolder;
use proptest::prelude::*;
use std::path::{Path, PathBuf};

/// A log of a flight in simulation, beside the checkout.
fn ulog() -> Option<Vec<u8>> {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../../shared/data/px4_flight.ulg");
    let bytes = std::fs::read(&file).ok();
    if bytes.is_none() {
        jink_testkit::not_tested(&format!("ULog of PX4: no {}", file.display()));
    }
    bytes
}

fn written(folder: &TempFolder, bytes: &[u8]) -> PathBuf {
    let file = folder.join("log");
    std::fs::write(&file, bytes).unwrap();
    file
}

/// Messages of ArduPilot's DataFlash format: <https://ardupilot.org/dev/docs/code-overview-adding-a-new-log-message.html>.
struct DataFlash(Vec<u8>);

impl DataFlash {
    const FMT: u8 = 128;

    fn new() -> Self {
        let mut log = Self(Vec::new());
        log.format(Self::FMT, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns");
        log
    }

    fn begin(&mut self, kind: u8) {
        self.0.extend([0xa3, 0x95, kind]);
    }

    fn text(&mut self, text: &str, room: usize) {
        let mut bytes = text.as_bytes().to_vec();
        bytes.resize(room, 0);
        self.0.extend(bytes);
    }

    fn format(&mut self, kind: u8, length: u8, name: &str, format: &str, columns: &str) {
        self.begin(Self::FMT);
        self.0.extend([kind, length]);
        self.text(name, 4);
        self.text(format, 16);
        self.text(columns, 64);
    }

    fn message(&mut self, kind: u8, time_us: u64, values: &[f32]) {
        self.begin(kind);
        self.0.extend(time_us.to_le_bytes());
        for value in values {
            self.0.extend(value.to_le_bytes());
        }
    }

    fn estimate(&mut self, time_us: u64, core: u8, position: [f32; 3]) {
        self.begin(1);
        self.0.extend(time_us.to_le_bytes());
        self.0.push(core);
        for value in position {
            self.0.extend(value.to_le_bytes());
        }
    }
}

fn of_ardupilot() -> Vec<u8> {
    let mut log = DataFlash::new();
    log.format(1, 3 + 8 + 1 + 12, "XKF1", "QBfff", "TimeUS,C,PN,PE,PD");
    for (kind, axis) in [(2, "N"), (3, "E"), (4, "D")] {
        let columns = format!("TimeUS,TP{axis},P{axis}");
        log.format(kind, 3 + 8 + 8, &format!("PSC{axis}"), "Qff", &columns);
    }
    for step in 0..20_u8 {
        let time_us = 1_000_000 + u64::from(step) * 100_000;
        let x = f32::from(step);
        log.estimate(time_us, 0, [x, -x, -2.5]);
        log.estimate(time_us, 1, [99.0, 99.0, 99.0]);
        log.message(2, time_us, &[x + 0.5, x]);
        log.message(3, time_us, &[-x, -x]);
        log.message(4, time_us, &[-2.5, -2.5]);
    }
    log.0
}

#[test]
fn a_dataflash_log_says_where_the_controller_wanted_to_be_and_where_the_first_core_was() {
    let folder = TempFolder::new("dataflash");
    let log = AutopilotLog::read(&written(&folder, &of_ardupilot())).unwrap();
    assert_eq!((log.maker, &log.damage), ("ArduPilot", &None));
    let was = log.was.at(1_050_000, 200_000).unwrap();
    assert!(
        (was - nalgebra::Vector3::new(0.5, -0.5, -2.5)).norm() < 1e-6,
        "{was}"
    );
    let wanted = log.wanted.at(1_050_000, 200_000).unwrap();
    assert!(
        (wanted - nalgebra::Vector3::new(1.0, -0.5, -2.5)).norm() < 1e-6,
        "{wanted}"
    );
    assert_eq!(log.was.at(900_000, 200_000), None, "before it");
    assert_eq!(log.was.at(9_000_000, 200_000), None, "after it");
    assert_eq!(
        log.was.at(1_050_000, 50_000),
        None,
        "further apart than is asked for"
    );
}

#[test]
fn a_ulog_says_the_same_of_px4() {
    let Some(bytes) = ulog() else { return };
    let folder = TempFolder::new("ulog");
    let log = AutopilotLog::read(&written(&folder, &bytes)).unwrap();
    assert_eq!((log.maker, &log.damage), ("PX4", &None));
    assert!(log.was.all().len() > 100, "{}", log.was.all().len());
    let half = AutopilotLog::read(&written(&folder, &bytes[..bytes.len() / 2])).unwrap();
    assert!(half.damage.is_some());
    let shorter = half.was.all().len();
    assert!(shorter > 0 && shorter < log.was.all().len());
    assert_eq!(
        half.was.all(),
        &log.was.all()[..shorter],
        "what is there is the same"
    );
}

#[test]
fn what_is_no_log_is_refused_by_name() {
    let folder = TempFolder::new("no_log");
    for bytes in [&b""[..], b"ULo", b"no log at all"] {
        let file = written(&folder, bytes);
        let refused = AutopilotLog::read(&file).unwrap_err();
        assert!(matches!(refused, ReportError::ForeignLog(_)), "{refused}");
        assert!(refused.to_string().contains(file.to_str().unwrap()));
    }
    let begun = AutopilotLog::read(&written(&folder, b"ULog\x01\x12\x35")).unwrap_err();
    assert!(!begun.to_string().is_empty());
    let only_formats = AutopilotLog::read(&written(&folder, &DataFlash::new().0)).unwrap_err();
    assert!(
        matches!(only_formats, ReportError::NoPositions(_)),
        "{only_formats}"
    );
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is wrong with a log, it is read up to there or refused.
    #[test]
    fn a_damaged_log_ends_nobody(cut in 0.0..1.0_f64, flips in proptest::collection::vec((0.0..1.0_f64, 1..=255_u8), 0..20)) {
        let folder = TempFolder::new("damaged");
        for whole in [Some(of_ardupilot()), ulog()].into_iter().flatten() {
            let mut bytes = whole[..(cut * whole.len() as f64) as usize].to_vec();
            let len = bytes.len() as f64;
            for (place, bits) in &flips {
                if let Some(byte) = bytes.get_mut((place * len) as usize) {
                    *byte ^= bits;
                }
            }
            let _read_or_refused = AutopilotLog::read(&written(&folder, &bytes));
        }
    }
}
