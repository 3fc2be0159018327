//! Flights as JSON Lines: written as they come, read back when a campaign that was interrupted goes on.

use super::FlightReport;
use std::fs::{File, OpenOptions};
use std::io::Write;
use std::path::Path;

/// Opens `path` for the reports of a campaign; with `resumes` behind those that stand in it already, which are returned. A last
/// line that was not written to its end is cut off.
///
/// # Errors
/// A text naming the file, and the line that is no report.
pub fn open(path: &Path, resumes: bool) -> Result<(File, Vec<FlightReport>), String> {
    let wrong = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
    if !resumes || !path.exists() {
        return Ok((File::create(path).map_err(|error| wrong(&error))?, Vec::new()));
    }
    let text = std::fs::read_to_string(path).map_err(|error| wrong(&error))?;
    let mut reports = Vec::new();
    let whole = text.rfind('\n').map_or(0, |end| end + 1);
    for (number, line) in text[..whole].lines().enumerate() {
        let report = serde_json::from_str(line.trim_start_matches('\u{feff}')).map_err(|error| {
            format!(
                "{}:{}: not the report of a flight: {error}",
                path.display(),
                number + 1
            )
        })?;
        reports.push(report);
    }
    let file = OpenOptions::new()
        .append(true)
        .open(path)
        .map_err(|error| wrong(&error))?;
    file.set_len(whole as u64).map_err(|error| wrong(&error))?;
    Ok((file, reports))
}

/// Writes a report behind the others.
///
/// # Errors
/// A text.
pub fn write(file: &mut File, report: &FlightReport) -> Result<(), String> {
    let mut line = serde_json::to_string(report).map_err(|error| error.to_string())?;
    line.push('\n');
    // At once: whoever is killed leaves whole lines.
    file.write_all(line.as_bytes()).map_err(|error| error.to_string())
}
