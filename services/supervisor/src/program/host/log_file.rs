//! What a process writes to its standard output and error: a file of its own that never grows without bound.
//!
//! The process writes into the file itself. A pipe through the supervisor would tie every service to it: full when the
//! supervisor stands still, broken when it dies.

use jink_runtime::Instance;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::PathBuf;

/// The last lines are looked for in this much of the end (bytes).
const TAIL: u64 = 8 << 10;

/// One process's log.
#[derive(Debug)]
pub struct LogFile {
    path: PathBuf,
    /// Where the present generation's lines begin.
    start: u64,
}

impl LogFile {
    /// The log of process `name`.
    pub fn new(instance: &Instance, name: &str) -> Self {
        Self {
            path: instance.log_folder().join(format!("{name}.log")),
            start: 0,
        }
    }

    /// Opens it for a process to append to; what is there now belongs to earlier generations.
    pub fn open(&mut self) -> std::io::Result<File> {
        let file = File::options().create(true).append(true).open(&self.path)?;
        self.start = file.metadata()?.len();
        Ok(file)
    }

    /// The last lines of the present generation, at most `count`, oldest first. JSON records are reduced to their
    /// message.
    pub fn last_lines(&self, count: usize) -> Vec<String> {
        let text = self.tail().unwrap_or_default();
        let lines: Vec<&str> = text.lines().filter(|line| !line.trim().is_empty()).collect();
        let from = lines.len().saturating_sub(count);
        lines[from..].iter().map(|line| plain(line)).collect()
    }

    fn tail(&self) -> std::io::Result<String> {
        let mut file = File::open(&self.path)?;
        let end = file.metadata()?.len();
        file.seek(SeekFrom::Start(self.start.max(end.saturating_sub(TAIL)).min(end)))?;
        let mut bytes = Vec::new();
        file.take(TAIL).read_to_end(&mut bytes)?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    }

    /// Moves what has been written aside (`.log.1`, replacing what was there) if it is more than `max_bytes`. The writer
    /// appends, so it continues at the beginning of the emptied file.
    pub fn limit(&mut self, max_bytes: u64) -> std::io::Result<()> {
        if std::fs::metadata(&self.path)?.len() <= max_bytes {
            return Ok(());
        }
        std::fs::copy(&self.path, self.path.with_extension("log.1"))?;
        File::options().write(true).open(&self.path)?.set_len(0)?;
        self.start = 0;
        Ok(())
    }
}

/// The message of a JSON log record, or the line itself.
fn plain(line: &str) -> String {
    let record: Option<serde_json::Value> = serde_json::from_str(line).ok();
    let message = record.as_ref().and_then(|record| record.get("message")?.as_str());
    message.unwrap_or(line).to_owned()
}

#[cfg(test)]
mod tests {
    use super::{LogFile, plain};
    use std::io::Write;
    use std::path::PathBuf;

    fn log(test: &str) -> LogFile {
        let path: PathBuf = std::env::temp_dir().join(format!("jink_log_{test}_{}.log", std::process::id()));
        LogFile { path, start: 0 }
    }

    #[test]
    fn the_last_lines_are_those_of_the_present_generation() {
        let mut log = log("lines");
        writeln!(log.open().unwrap(), "first generation").unwrap();
        let mut second = log.open().unwrap();
        assert!(log.last_lines(3).is_empty());
        for line in 1..=5 {
            writeln!(second, "line {line}").unwrap();
        }
        assert_eq!(log.last_lines(2), ["line 4", "line 5"]);
        assert_eq!(log.last_lines(20).len(), 5);
        std::fs::remove_file(&log.path).unwrap();
    }

    #[test]
    fn a_log_never_holds_more_than_its_limit_for_long() {
        let mut log = log("limit");
        let mut writer = log.open().unwrap();
        writer.write_all(&[b'x'; 1001]).unwrap();
        log.limit(1000).unwrap();
        writeln!(writer, "after").unwrap();
        assert_eq!(
            std::fs::read_to_string(&log.path).unwrap(),
            "after\n",
            "the writer goes on at the start"
        );
        assert_eq!(log.last_lines(1), ["after"]);
        std::fs::remove_file(&log.path).unwrap();
        std::fs::remove_file(log.path.with_extension("log.1")).unwrap();
    }

    #[test]
    fn a_json_record_is_reduced_to_its_message() {
        assert_eq!(
            plain(r#"{"level":"ERROR","message":"no such port"}"#),
            "no such port"
        );
        assert_eq!(plain("thread 'main' panicked"), "thread 'main' panicked");
        assert_eq!(plain("[1, 2]"), "[1, 2]");
    }
}
