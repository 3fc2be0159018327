//! Every mistake of a text at once. A parser says the first one it meets, with its line: that line is taken out and what is left is read
//! again, until nothing is wrong with it. So every parser, that of a driver too, finds all mistakes without having been made for it.

use super::ConfigError;
use toml::Table;

/// What is wrong with a text, and what is right of it.
#[derive(Clone, Debug)]
pub struct Examination<T> {
    /// What was read of the right part; `None` where a mistake has no line, or cannot be taken out.
    pub value: Option<T>,
    /// The right part, with an empty line for each one that was taken out.
    pub text: String,
    /// The mistakes, by their lines.
    pub mistakes: Vec<ConfigError>,
}

/// Reads `text` with `parse` as often as it finds something wrong.
pub fn all_mistakes<T>(text: &str, parse: impl Fn(&str) -> Result<T, ConfigError>) -> Examination<T> {
    let mut left = Lines(text.lines().map(str::to_owned).collect());
    // Where a table begins, and the key of a line that was taken out of it.
    let mut taken: Vec<(usize, String)> = Vec::new();
    let mut mistakes: Vec<ConfigError> = Vec::new();
    loop {
        let text = left.text();
        let mut error = match parse(&text) {
            Ok(value) => return Examination::of(Some(value), text, mistakes),
            Err(error) => error,
        };
        let table = left.table_of(error.line);
        if error.message.starts_with(MISSING) {
            // No line is to blame, and nothing more can be said of the table.
            error.line = table.max(1);
        }
        // What is only missing because it was taken out is no mistake of its own.
        let complaint = error.message.split(SUGGESTION).next().unwrap_or_default();
        let misses = |(of, key): &(usize, String)| *of == table && complaint.contains(&format!("`{key}`"));
        let is_consequence = taken.iter().any(misses);
        taken.extend(left.key(error.line).map(|key| (table, key)));
        let is_left = left.take_out(error.line);
        if !is_consequence && !mistakes.contains(&error) {
            mistakes.push(error);
        }
        if !is_left {
            return Examination::of(None, text, mistakes);
        }
    }
}

/// Begins what serde says of a key that is not there.
const MISSING: &str = "missing field";
/// Begins the suggestion behind a complaint ([`jink_shared_types::suggestion::DidYouMean`]).
const SUGGESTION: &str = "; did you mean";

impl<T> Examination<T> {
    fn of(value: Option<T>, text: String, mut mistakes: Vec<ConfigError>) -> Self {
        mistakes.sort_by_key(|mistake| mistake.line);
        Self {
            value,
            text,
            mistakes,
        }
    }
}

/// The lines of a TOML text; numbers count from 1.
struct Lines(Vec<String>);

impl Lines {
    fn text(&self) -> String {
        let mut text = self.0.join("\n");
        text.push('\n');
        text
    }

    fn is_toml(&self) -> bool {
        self.text().parse::<Table>().is_ok()
    }

    fn line(&self, number: usize) -> &str {
        number
            .checked_sub(1)
            .and_then(|index| self.0.get(index))
            .map_or("", |line| line.trim())
    }

    fn begins_table(&self, number: usize) -> bool {
        let inside = self.line(number).trim_start_matches('[');
        inside.len() < self.line(number).len()
            && inside.starts_with(|c: char| c.is_ascii_alphabetic() || c == '"')
            && !inside.contains(',')
    }

    /// Where the table of a line begins; 0 for what stands above all tables.
    fn table_of(&self, number: usize) -> usize {
        (1..=number)
            .rev()
            .find(|line| self.begins_table(*line))
            .unwrap_or(0)
    }

    fn key(&self, number: usize) -> Option<String> {
        let (key, _) = self.line(number).split_once('=')?;
        Some(key.trim().trim_matches('"').to_owned())
    }

    /// Takes out the line, with the rest of the value that begins there, or the table; whether what is left can be read.
    fn take_out(&mut self, number: usize) -> bool {
        if self.line(number).is_empty() {
            return false;
        }
        let is_table = self.begins_table(number);
        let was_toml = self.is_toml();
        for line in number..=self.0.len() {
            let is_next = line > number && self.begins_table(line);
            if (is_table && is_next) || (!is_table && line > number && (is_next || self.is_toml())) {
                break;
            }
            if let Some(text) = self.0.get_mut(line - 1) {
                text.clear();
            }
            // Of a text that was none it is not known where a value ends.
            if !was_toml {
                break;
            }
        }
        self.is_toml()
    }
}

#[cfg(test)]
mod tests {
    use super::all_mistakes;
    use crate::Config;
    use std::path::Path;

    fn mistakes(text: &str) -> Vec<String> {
        let found = all_mistakes(text, |text| Config::parse(Path::new("jink.toml"), text));
        found.mistakes.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn all_mistakes_of_a_file_are_found_each_once_and_with_its_line() {
        let text = "lnk = 3\n[params]\nOA_SPD_MAX = 99\nOA_SPEED_MAX = 3\nOA_YAW_MODE = [\n 1,\n [2],\n]\n[link]\nadress = \"x\"\n\
                    [[sensor]]\nname = \"front\"\nkind = \"rangefindr\"\nrate_hz = -1\n\
                    [[sensor]]\nname = \"A\"\nkind = \"rangefinder\"\n[[sensor]]\nkind = \"lidar_3d\"\ndelay_ms = 9000\n";
        assert_eq!(
            mistakes(text),
            [
                "jink.toml:1: unknown key `lnk`; did you mean `link`?",
                "jink.toml:3: OA_SPD_MAX = 99 is outside 0.3 to 20",
                "jink.toml:4: unknown parameter OA_SPEED_MAX; did you mean `OA_SPD_MAX`?",
                "jink.toml:5: invalid type: sequence, expected f64",
                "jink.toml:10: unknown key `adress`; did you mean `address`?",
                "jink.toml:13: unknown kind of sensor \"rangefindr\"; did you mean `rangefinder`?",
                "jink.toml:14: sensor \"front\": rate_hz is a number from 0 to 2000",
                "jink.toml:16: sensor name \"A\": use 1 to 20 lower-case letters, digits and underscores",
                "jink.toml:18: missing field `name`",
            ]
        );
    }

    #[test]
    fn a_text_that_is_no_toml_is_reported_where_it_stops_being_one() {
        assert_eq!(mistakes("[params]\nOA_SPD_MAX = = 3\nOA_ALT_MAX = 0\n").len(), 2);
        assert_eq!(mistakes("[params\nOA_SPD_MAX = [\n").len(), 1);
        assert!(mistakes("").is_empty());
    }

    #[test]
    fn what_is_right_is_read_whatever_else_is_wrong() {
        let text = "[params]\nOA_SPD_MAX = 4\nOA_ALT_MAX = -1\n";
        let found = all_mistakes(text, |text| Config::parse(Path::new("jink.toml"), text));
        assert_eq!(found.value.unwrap().params.named("OA_SPD_MAX"), Some(4.0));
        assert_eq!(found.text, "[params]\nOA_SPD_MAX = 4\n\n");
    }
}
