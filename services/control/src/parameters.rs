//! The parameter table with the values in force, as people and scripts see it.

use jink_shared_types::params::{Apply, Param, ParamType};
use serde::Serialize;

/// One parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Listed {
    /// Its name.
    pub name: &'static str,
    /// The value in force; of one that needs a restart, the value after it.
    pub value: f64,
    /// Value if nothing else is given.
    pub default: f64,
    /// Smallest value accepted.
    pub min: f64,
    /// Largest value accepted.
    pub max: f64,
    /// Unit; empty for none.
    pub unit: &'static str,
    /// `float`, `integer` or `boolean`.
    pub kind: &'static str,
    /// `live` or `restart`: when a change takes effect.
    pub apply: &'static str,
    /// One line of help.
    pub help: &'static str,
}

impl Listed {
    /// A row with its value.
    pub fn of(row: &'static Param, value: f64) -> Self {
        Self {
            name: row.name,
            value,
            default: row.default,
            min: row.min,
            max: row.max,
            unit: row.unit,
            kind: match row.kind {
                ParamType::Float => "float",
                ParamType::Integer => "integer",
                ParamType::Boolean => "boolean",
            },
            apply: match row.apply {
                Apply::Live => "live",
                Apply::Restart => "restart",
            },
            help: row.help,
        }
    }
}

/// As a table; a star marks what differs from its default.
pub fn table(rows: &[Listed]) -> String {
    let header = ["parameter", "value", "unit", "range", "takes effect", "meaning"].map(str::to_owned);
    let lines: Vec<[String; 6]> = std::iter::once(header)
        .chain(rows.iter().map(|row| {
            let star = if row.value == row.default { "" } else { " *" };
            [
                row.name.to_owned(),
                format!("{}{star}", row.value),
                row.unit.to_owned(),
                format!("{} to {}", row.min, row.max),
                match row.apply {
                    "live" => "at once".to_owned(),
                    _ => "after a restart".to_owned(),
                },
                row.help.to_owned(),
            ]
        }))
        .collect();
    let mut out = String::new();
    crate::status::write_table(&mut out, &lines);
    out
}

#[cfg(test)]
mod tests {
    use super::{Listed, table};
    use jink_shared_types::params::{GW_RATE, OA_SPD_MAX};

    #[test]
    fn what_differs_from_its_default_is_marked() {
        let text = table(&[
            Listed::of(&OA_SPD_MAX, 4.5),
            Listed::of(&GW_RATE, GW_RATE.default),
        ]);
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines[1].starts_with("OA_SPD_MAX  4.5 *") && lines[1].contains("at once"));
        assert!(lines[2].contains("20 ") && !lines[2].contains('*') && lines[2].contains("after a restart"));
    }
}
