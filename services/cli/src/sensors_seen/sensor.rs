//! What one sensor has said over some time.

use super::circle::{Interval, Sectors};
use super::frame::{Frame, SensorType};
use super::timing::Timing;
use jink_control::figures::round;
use jink_shared_types::orientation;
use jink_shared_types::quantile::quantile;
use jink_shared_types::ranges::{PointCloud, RangeScan};
use jink_shared_types::ring::SECTORS;
use jink_shared_types::{SampleHeader, Timestamp, topics};
use serde::{Deserialize, Serialize};

/// Looks into one direction that are kept: at 20 a second, fifty seconds. More would not change what is usual.
const LOOKS_KEPT: usize = 1_000;

/// A `[[sensor]]` table, as far as it says how often something is to come; other keys are of the driver.
#[derive(Clone, Debug, Default, Deserialize)]
pub struct SensorTable {
    /// Its name: the last part of its topic.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// The device's model, if its kind knows several.
    pub model: Option<String>,
    /// Samples a second, if they are set.
    pub rate_hz: Option<f64>,
    /// Where it looks: PX4's name or code.
    pub orientation: Option<OrientationKey>,
    /// Where it looks, as a turn to the right (deg).
    pub yaw_deg: Option<f64>,
}

/// An orientation in a table.
#[derive(Clone, Debug, Deserialize)]
#[serde(untagged)]
pub enum OrientationKey {
    /// PX4's code.
    Code(u8),
    /// The name of a code.
    Named(String),
}

/// How often a sensor is to send samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Rate {
    /// So often (Hz).
    Exact(f64),
    /// At least so often (Hz).
    AtLeast(f64),
}

impl SensorTable {
    /// Whether straight ahead lies within its field of view, mounted as its table says. A single beam has hardly any.
    pub fn looks_ahead(&self) -> bool {
        // Half of the narrowest field of view of its kind (deg): 87 of a RealSense D435, 70 of a Livox Avia, 320 of an SF45.
        let half_deg = match (self.kind.as_str(), self.model.as_deref()) {
            ("depth_camera", _) => 40.0,
            ("lidar_3d", Some("livox_avia")) => 35.0,
            ("lidar_2d", Some("sf45b")) => 160.0,
            ("lidar_3d" | "lidar_2d", _) => 180.0,
            _ => return false,
        };
        let code = match &self.orientation {
            Some(OrientationKey::Code(code)) => Some(*code),
            Some(OrientationKey::Named(name)) => orientation::by_name(name).map(|known| known.code),
            None => None,
        };
        let [yaw_deg, pitch_deg, _] =
            code.and_then(orientation::turns_deg)
                .unwrap_or([self.yaw_deg.unwrap_or(0.0), 0.0, 0.0]);
        let aside_deg = (yaw_deg + 180.0).rem_euclid(360.0) - 180.0;
        pitch_deg == 0.0 && aside_deg.abs() < half_deg
    }

    /// What is to be expected: the table's own rate, or that of its kind.
    pub fn rate(&self) -> Rate {
        // It says as many parts of its sweep as it turns past.
        if self.model.as_deref() == Some("sf45b") {
            return Rate::AtLeast(self.rate_hz.unwrap_or(topics::RANGE_SCAN.row.rate_hz));
        }
        if let Some(rate_hz) = self.rate_hz {
            return Rate::Exact(rate_hz);
        }
        match self.kind.as_str() {
            "lidar_3d" | "lidar_2d" => Rate::Exact(10.0),
            "depth_camera" => Rate::Exact(15.0),
            "rangefinder" | "autopilot_rangefinder" => Rate::Exact(topics::RANGE_SCAN.row.rate_hz),
            // Whoever sends it decides; below this it would be stale in between.
            _ => Rate::AtLeast(1e3 / topics::RANGE_SCAN.row.deadline_ms),
        }
    }
}

/// How often one direction was looked into.
#[derive(Clone, Debug, Default)]
struct Looks {
    count: u64,
    last: Timestamp,
    longest_s: f64,
    /// Of them, those that found the vehicle itself there.
    own: u64,
    nearest_m: Vec<f64>,
}

/// What one sensor has said.
#[derive(Clone, Debug)]
pub struct SensorSeen {
    /// Its table.
    pub table: SensorTable,
    /// When its samples came.
    pub timing: Timing,
    pub(super) sort: SensorType,
    pub(super) rays: u64,
    pub(super) unknown: u64,
    pub(super) hits: u64,
    pub(super) too_near: u64,
    pub(super) reach_m: [f32; 2],
    pub(super) elevation_deg: Option<[f64; 2]>,
    /// The range of every hit (m), as long as there is but one.
    pub(super) one_range_m: Option<f32>,
    /// Samples with obstacles in them, and how many of them said another thing than the one before.
    reported: u64,
    changes: u64,
    fingerprint: u64,
    looks: Vec<Looks>,
}

impl SensorSeen {
    /// One that has said nothing yet.
    pub fn new(table: SensorTable) -> Self {
        Self {
            table,
            timing: Timing::default(),
            sort: SensorType::default(),
            rays: 0,
            unknown: 0,
            hits: 0,
            too_near: 0,
            reach_m: [0.0; 2],
            elevation_deg: None,
            one_range_m: None,
            reported: 0,
            changes: 0,
            fingerprint: 0,
            looks: vec![Looks::default(); SECTORS],
        }
    }

    /// Takes a scan, seen by a vehicle with heading `heading_rad`; nearer than `own_m` to its centre it is the vehicle.
    pub fn scan(&mut self, scan: &RangeScan, header: &SampleHeader, heading_rad: f64, own_m: f64) {
        self.take(&Frame::of_scan(scan, heading_rad, own_m), header);
    }

    /// Takes a cloud, as above.
    pub fn cloud(&mut self, cloud: &PointCloud, header: &SampleHeader, own_m: f64) {
        self.take(&Frame::of_cloud(cloud, own_m), header);
    }

    fn take(&mut self, frame: &Frame, header: &SampleHeader) {
        self.timing.take(header);
        self.sort = frame.sort;
        self.reach_m = frame.reach_m;
        self.rays += frame.rays;
        self.unknown += frame.unknown;
        self.too_near += frame.too_near;
        if frame.hits > 0 {
            let is_first = self.hits == 0;
            self.one_range_m = frame
                .one_range_m
                .filter(|one_m| is_first || self.one_range_m == Some(*one_m));
            self.hits += frame.hits;
            self.reported += 1;
            self.changes += u64::from(!is_first && frame.fingerprint != self.fingerprint);
            self.fingerprint = frame.fingerprint;
        }
        if let Some([low_deg, high_deg]) = frame.elevation_deg {
            let [least_deg, most_deg] = self.elevation_deg.unwrap_or([low_deg, high_deg]);
            self.elevation_deg = Some([least_deg.min(low_deg), most_deg.max(high_deg)]);
        }
        for sector in frame.covered.each() {
            let looks = &mut self.looks[sector];
            if looks.count > 0 {
                let since_s = header.publish.seconds_since(looks.last);
                looks.longest_s = looks.longest_s.max(since_s);
            }
            looks.count += 1;
            looks.last = header.publish;
            looks.own += u64::from(frame.own.0[sector]);
            let nearest_m = frame.nearest_m[sector];
            if !nearest_m.is_nan() && looks.nearest_m.len() < LOOKS_KEPT {
                looks.nearest_m.push(f64::from(nearest_m));
            }
        }
    }

    /// Directions that it looks into.
    pub fn covered(&self) -> Sectors {
        Sectors::of(|sector| self.looks[sector].count > 0)
    }

    /// Directions in which it found something as near as the vehicle each of at least `least` times it looked.
    pub(super) fn own(&self, least: u64) -> Sectors {
        Sectors::of(|sector| {
            let looks = &self.looks[sector];
            looks.count >= least && looks.own == looks.count
        })
    }

    /// Samples with obstacles in them that were all the same, to the last bit; `None` if they were not.
    pub(super) fn frozen(&self) -> Option<u64> {
        (self.changes == 0).then_some(self.reported)
    }

    /// How often a second it comes back to a direction: the usual one of all directions. The same as its rate, unless
    /// it reports a part of its sweep at a time.
    pub fn sweeps_hz(&self) -> Option<f64> {
        let span_s = self.timing.span_s();
        let counts: Vec<f64> = self.looks_into().map(|looks| looks.count as f64).collect();
        let usual = quantile(&counts, 0.5)?;
        (span_s > 0.0).then(|| (usual - 1.0) / span_s)
    }

    /// Whether it reports a part of its sweep at a time.
    pub fn is_in_parts(&self) -> bool {
        let most = self.looks_into().map(|looks| looks.count).max().unwrap_or(0);
        self.sort == SensorType::Scan && 4 * most < 3 * self.timing.samples()
    }

    /// The longest time for which it did not look into one of its directions (s).
    pub fn unseen_s(&self) -> f64 {
        self.looks_into().map(|looks| looks.longest_s).fold(0.0, f64::max)
    }

    fn looks_into(&self) -> impl Iterator<Item = &Looks> {
        self.looks.iter().filter(|looks| looks.count > 0)
    }

    /// How far it usually sees in a sector until something stands there (m), infinity if nothing does; `None` if it says nothing
    /// of it most of the time.
    pub(super) fn usual_m(&self, sector: usize) -> Option<f64> {
        let looks = &self.looks[sector];
        let says = 2 * looks.nearest_m.len() as u64 > looks.count.min(LOOKS_KEPT as u64);
        says.then(|| quantile(&looks.nearest_m, 0.5)).flatten()
    }

    /// For scripts.
    pub fn figures(&self) -> SensorFigures {
        let ms = |seconds: Option<f64>| seconds.map(|s| round(s * 1e3));
        let (Rate::Exact(expected_hz) | Rate::AtLeast(expected_hz)) = self.table.rate();
        let covered = self.covered();
        SensorFigures {
            name: self.table.name.clone(),
            kind: self.table.kind.clone(),
            samples: self.timing.samples(),
            lost: self.timing.lost(),
            expected_hz,
            rate_hz: self.timing.rate_hz().map(round),
            sweeps_hz: self.sweeps_hz().map(round),
            unseen_max_ms: round(self.unseen_s() * 1e3),
            age_p50_ms: ms(self.timing.age_s(0.5)),
            age_p99_ms: ms(self.timing.age_s(0.99)),
            jitter_ms: ms(self.timing.jitter_s()),
            coverage_deg: covered.width_deg(),
            coverage: covered.intervals(),
            elevation_deg: self.elevation_deg.map(|span| span.map(round)),
            range_min_m: round(f64::from(self.reach_m[0])),
            range_max_m: round(f64::from(self.reach_m[1])),
            rays: self.rays,
            unknown_rays: self.unknown,
        }
    }
}

/// The figures of one sensor.
#[derive(Clone, Debug, Serialize)]
pub struct SensorFigures {
    /// Its name.
    pub name: String,
    /// Its kind.
    pub kind: String,
    /// Samples that came.
    pub samples: u64,
    /// Samples that were overwritten before they were read.
    pub lost: u64,
    /// How often they are to come (Hz).
    pub expected_hz: f64,
    /// How often they came (Hz).
    pub rate_hz: Option<f64>,
    /// How often it came back to a direction (Hz).
    pub sweeps_hz: Option<f64>,
    /// The longest time for which it did not look into one of its directions (ms).
    pub unseen_max_ms: f64,
    /// Age at publication (ms): half of the samples are younger.
    pub age_p50_ms: Option<f64>,
    /// 99 of 100 are younger (ms).
    pub age_p99_ms: Option<f64>,
    /// How irregularly it comes (ms).
    pub jitter_ms: Option<f64>,
    /// How much of the horizon it looks at (deg).
    pub coverage_deg: f64,
    /// Which part that is.
    pub coverage: Vec<Interval>,
    /// Lowest and highest ray (deg); clouds only.
    pub elevation_deg: Option<[f64; 2]>,
    /// Shortest range (m).
    pub range_min_m: f64,
    /// Longest range (m).
    pub range_max_m: f64,
    /// Rays in all samples.
    pub rays: u64,
    /// Of these, those that say nothing.
    pub unknown_rays: u64,
}
