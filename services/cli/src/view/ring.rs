//! The sector ring for human eyes and for plots: a picture of characters, one line of figures, JSON.
//!
//! | in the picture | is |
//! |---|---|
//! | `#` | an obstacle |
//! | `.` | free |
//! | blank | not known, or behind an obstacle |
//! | `^` | the vehicle; its nose points up |

use jink_control::figures::round;
use jink_shared_types::Timestamp;
use jink_shared_types::ring::{SECTORS, SectorRing, sector_bearing_rad, sector_of};
use serde::Serialize;
use std::fmt::Write as _;

/// Rows of the picture above and below the vehicle.
const ROWS: i32 = 15;
/// Columns to its left and right: characters are twice as high as wide.
const COLUMNS: i32 = 30;
/// The picture reaches this far (m), or as far as the ring does, if that is less.
const FAR_M: f64 = 20.0;
/// The picture reaches at least this far (m).
const NEAR_M: f64 = 2.0;

/// One sector.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct SectorView {
    /// Direction of its centre, clockwise from the nose (deg).
    pub bearing_deg: f64,
    /// `obstacle`, `free` or `unknown`.
    pub state: &'static str,
    /// To the obstacle, or as far as it is known to be free (m).
    pub distance_m: Option<f64>,
    /// How long ago it was measured (s).
    pub age_s: Option<f64>,
}

/// The ring at one moment.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct RingView {
    /// How old the ring is (s).
    pub age_s: f64,
    /// Nearest obstacle (m).
    pub nearest_m: Option<f64>,
    /// Its direction, clockwise from the nose (deg).
    pub nearest_deg: Option<f64>,
    /// How much of the circle is known (deg).
    pub known_deg: f64,
    /// Every sector, from the nose clockwise.
    pub sectors: Vec<SectorView>,
}

impl RingView {
    /// Of `ring`, which was published at `published`.
    pub fn of(ring: &SectorRing, published: Timestamp, now: Timestamp) -> Self {
        let sectors: Vec<SectorView> = (0..SECTORS).map(|sector| view(ring, sector, now)).collect();
        let nearest = sectors
            .iter()
            .filter(|sector| sector.state == "obstacle")
            .min_by(|a, b| {
                a.distance_m
                    .partial_cmp(&b.distance_m)
                    .unwrap_or(std::cmp::Ordering::Equal)
            });
        let known = sectors.iter().filter(|sector| sector.state != "unknown").count();
        Self {
            age_s: round(now.seconds_since(published).max(0.0)),
            nearest_m: nearest.and_then(|sector| sector.distance_m),
            nearest_deg: nearest.map(|sector| sector.bearing_deg),
            known_deg: round(known as f64 * 360.0 / SECTORS as f64),
            sectors,
        }
    }

    /// The picture and the figures.
    pub fn text(&self) -> String {
        let reach_m = self
            .sectors
            .iter()
            .filter_map(|sector| sector.distance_m)
            .fold(NEAR_M, f64::max)
            .min(FAR_M);
        let mut text = String::new();
        for row in -ROWS..=ROWS {
            let line: String = (-COLUMNS..=COLUMNS)
                .map(|column| self.character(row, column, reach_m))
                .collect();
            let _infallible = writeln!(text, "{}", line.trim_end());
        }
        let _infallible = writeln!(text, "{}", self.summary(reach_m));
        text
    }

    fn summary(&self, reach_m: f64) -> String {
        let nearest = match (self.nearest_m, self.nearest_deg) {
            (Some(m), Some(deg)) => format!("nearest {m:.2} m at {deg:.0} deg"),
            _ => "no obstacle".to_owned(),
        };
        format!(
            "{nearest}, {:.0} deg known, up to {reach_m:.1} m shown, {:.2} s old",
            self.known_deg, self.age_s
        )
    }

    fn character(&self, row: i32, column: i32, reach_m: f64) -> char {
        if (row, column) == (0, 0) {
            return '^';
        }
        let metres_per_row = reach_m / f64::from(ROWS);
        let forward_m = -f64::from(row) * metres_per_row;
        let right_m = f64::from(column) * reach_m / f64::from(COLUMNS);
        let here_m = forward_m.hypot(right_m);
        let sector = &self.sectors[sector_of(right_m.atan2(forward_m))];
        match sector.distance_m {
            Some(m) if sector.state == "obstacle" && (here_m - m).abs() <= 0.5 * metres_per_row => '#',
            Some(m) if here_m <= m.min(reach_m) => '.',
            _ => ' ',
        }
    }

    /// One object of numbers for a plotting program that makes a curve of each: `timestamp` in seconds, distances in metres. What is not
    /// known is left out.
    pub fn plot_json(&self, time_s: f64) -> serde_json::Value {
        let mut distances = serde_json::Map::new();
        for sector in &self.sectors {
            if let Some(distance_m) = sector.distance_m {
                let name = format!("{:03}", sector.bearing_deg.round());
                distances.insert(name, distance_m.into());
            }
        }
        let mut ring = serde_json::Map::new();
        ring.insert("distance_m".to_owned(), distances.into());
        ring.insert("known_deg".to_owned(), self.known_deg.into());
        if let Some(nearest_m) = self.nearest_m {
            ring.insert("nearest_m".to_owned(), nearest_m.into());
        }
        serde_json::json!({ "timestamp": time_s, "jink": { "ring": ring } })
    }
}

fn view(ring: &SectorRing, sector: usize, now: Timestamp) -> SectorView {
    let (distance_m, reach_m) = (ring.distance_m[sector], ring.range_max_m[sector]);
    let (state, known_m) = if distance_m.is_nan() {
        ("unknown", None)
    } else if distance_m.is_finite() {
        ("obstacle", Some(f64::from(distance_m)))
    } else {
        ("free", Some(f64::from(reach_m)))
    };
    SectorView {
        bearing_deg: round(sector_bearing_rad(sector).to_degrees()),
        state,
        distance_m: known_m.map(round),
        age_s: known_m.map(|_| round(now.seconds_since(ring.seen[sector]).max(0.0))),
    }
}

#[cfg(test)]
mod tests {
    use super::RingView;
    use jink_shared_types::Timestamp;
    use jink_shared_types::ring::{SECTORS, SectorRing};

    fn ring() -> SectorRing {
        let mut ring = SectorRing {
            distance_m: [f32::INFINITY; SECTORS],
            range_max_m: [10.0; SECTORS],
            seen: [Timestamp::from_seconds(9.9); SECTORS],
            ..SectorRing::default()
        };
        ring.distance_m[0] = 4.0;
        ring.distance_m[1] = 4.5;
        ring.distance_m[36..54].fill(f32::NAN);
        ring
    }

    fn seen() -> RingView {
        RingView::of(
            &ring(),
            Timestamp::from_seconds(9.95),
            Timestamp::from_seconds(10.0),
        )
    }

    #[test]
    fn the_nearest_obstacle_and_what_is_known_are_reported() {
        let view = seen();
        assert_eq!((view.nearest_m, view.nearest_deg), (Some(4.0), Some(0.0)));
        assert_eq!(view.known_deg, 270.0);
        assert!((view.age_s - 0.05).abs() < 1e-9);
        assert_eq!(view.sectors[40].state, "unknown");
        assert_eq!(view.sectors[20].distance_m, Some(10.0));
    }

    #[test]
    fn the_picture_has_the_nose_up_and_right_on_the_right() {
        let text = seen().text();
        let lines: Vec<&str> = text.lines().collect();
        let vehicle = lines.iter().position(|line| line.contains('^')).unwrap();
        let obstacle = lines.iter().position(|line| line.contains('#')).unwrap();
        assert!(obstacle < vehicle, "ahead is up");
        // Behind and to the left nothing is known, behind and to the right all is free.
        let behind = lines[vehicle + 5];
        let (left, right) = behind.split_at(behind.len().min(30));
        assert!(left.trim().is_empty(), "{behind:?}");
        assert!(right.contains('.'), "{behind:?}");
    }

    #[test]
    fn a_plot_gets_numbers_only_and_nothing_of_what_is_unknown() {
        let json = seen().plot_json(12.5);
        assert_eq!(json["timestamp"], 12.5);
        assert_eq!(json["jink"]["ring"]["distance_m"]["000"], 4.0);
        assert_eq!(json["jink"]["ring"]["nearest_m"], 4.0);
        assert!(json["jink"]["ring"]["distance_m"].get("200").is_none());
    }
}
