//! `[[parameter]]` rows of `jink.toml`: parameters of others, behind those of the parameter table.
//!
//! | key | default | meaning |
//! |---|---|---|
//! | `name` | - | `USR_` and capital letters, digits, underscores, 16 characters at most |
//! | `default`, `min`, `max` | - | value if nothing else is given, smallest and largest value accepted |
//! | `text` | - | one line of help |
//! | `unit` | none | its unit |
//! | `type` | `"float"` | `"float"`, `"integer"`, `"boolean"` |
//! | `live` | `true` | a change takes effect at once, not with the next start of the services |

use super::ConfigError;
use super::foreign::leaked;
use jink_shared_types::param_messages::PARAMETERS_MAX;
use jink_shared_types::params::{Apply, Loosens, Param, ParamType, TABLE, USER_PARAMETERS};
use serde::Deserialize;
use toml::Spanned;

/// Longest line of help: it travels in one piece in a file, and is read on one line of a list.
const TEXT_MAX: usize = 200;
/// Longest unit: a column of a list.
const UNIT_MAX: usize = 12;

const TYPES: [(&str, ParamType); 3] = [
    ("float", ParamType::Float),
    ("integer", ParamType::Integer),
    ("boolean", ParamType::Boolean),
];

/// A row as written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Written {
    name: Option<Spanned<String>>,
    default: Option<Spanned<f64>>,
    min: Option<Spanned<f64>>,
    max: Option<Spanned<f64>>,
    text: Option<Spanned<String>>,
    unit: Option<Spanned<String>>,
    #[serde(rename = "type")]
    kind: Option<Spanned<String>>,
    live: Option<bool>,
}

/// The rows, checked. They live as long as the program, like those of the table.
pub(super) fn rows(
    written: &[Spanned<Written>],
    at: &impl Fn(usize, String) -> ConfigError,
) -> Result<&'static [Param], ConfigError> {
    let mut rows: Vec<Param> = Vec::new();
    for one in written {
        let row = row(one, at)?;
        if rows.iter().any(|other| other.name == row.name) {
            return Err(at(
                one.span().start,
                format!("two parameters are called {}", row.name),
            ));
        }
        if TABLE.len() + rows.len() == PARAMETERS_MAX {
            let most = PARAMETERS_MAX - TABLE.len();
            return Err(at(
                one.span().start,
                format!("more than {most} parameters: there is no room"),
            ));
        }
        rows.push(row);
    }
    Ok(Box::leak(rows.into_boxed_slice()))
}

fn row(written: &Spanned<Written>, at: &impl Fn(usize, String) -> ConfigError) -> Result<Param, ConfigError> {
    let start = written.span().start;
    let written = written.get_ref();
    let needs = |key: &str| at(start, format!("a parameter needs `{key}`"));
    let name = written.name.as_ref().ok_or_else(|| needs("name"))?;
    if !is_name(name.get_ref()) {
        let message = format!(
            "parameter name {:?}: use {USER_PARAMETERS} and capital letters, digits and underscores, 16 characters at most",
            name.get_ref()
        );
        return Err(at(name.span().start, message));
    }
    let kind = match &written.kind {
        None => ParamType::Float,
        Some(word) => {
            let known = TYPES.iter().find(|(known, _)| known == word.get_ref());
            let names = TYPES.map(|(known, _)| known).join(", ");
            let refused = || format!("unknown type {:?}; use one of {names}", word.get_ref());
            known.ok_or_else(|| at(word.span().start, refused()))?.1
        }
    };
    let number = |key: &str, value: &Option<Spanned<f64>>| {
        let value = value.as_ref().ok_or_else(|| needs(key))?;
        let number = *value.get_ref();
        let is_one = number.is_finite() && (kind == ParamType::Float || number.fract() == 0.0);
        match is_one {
            true => Ok(number),
            false => Err(at(
                value.span().start,
                format!("{key} = {number} is no value of this type"),
            )),
        }
    };
    let (min, max) = (number("min", &written.min)?, number("max", &written.max)?);
    let default = number("default", &written.default)?;
    if !(min..=max).contains(&default) {
        let place = written.default.as_ref().map_or(start, |value| value.span().start);
        return Err(at(
            place,
            format!("default = {default} is outside {min} to {max}"),
        ));
    }
    if kind == ParamType::Boolean && (min, max) != (0.0, 1.0) {
        return Err(at(
            start,
            "a boolean parameter has min = 0 and max = 1".to_owned(),
        ));
    }
    let text = |key: &str, text: &Spanned<String>, most: usize| {
        let fits = text.get_ref().len() <= most && !text.get_ref().contains(char::is_control);
        let message = format!("{key}: one line of {most} bytes at most");
        fits.then(|| leaked(text.get_ref()))
            .ok_or_else(|| at(text.span().start, message))
    };
    let help = written.text.as_ref().filter(|text| !text.get_ref().is_empty());
    Ok(Param {
        name: leaked(name.get_ref()),
        kind,
        default,
        min,
        max,
        unit: match &written.unit {
            Some(unit) => text("unit", unit, UNIT_MAX)?,
            None => "",
        },
        help: text("text", help.ok_or_else(|| needs("text"))?, TEXT_MAX)?,
        apply: match written.live {
            Some(false) => Apply::Restart,
            _ => Apply::Live,
        },
        loosens: Loosens::Never,
    })
}

fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_uppercase() || c.is_ascii_digit() || c == '_';
    let own = text.strip_prefix(USER_PARAMETERS);
    text.len() <= 16 && own.is_some_and(|own| !own.is_empty() && own.chars().all(plain))
}

#[cfg(test)]
mod tests {
    use crate::Config;
    use jink_shared_types::params::{Apply, TABLE};
    use std::path::Path;

    const ROW: &str = "[[parameter]]\nname = \"USR_WIND_MAX\"\ndefault = 8\nmin = 0\nmax = 20\nunit = \"m/s\"\n\
                       text = \"Wind above which it turns back\"\n";

    fn error_of(text: &str) -> String {
        let error = Config::parse(Path::new("jink.toml"), text).unwrap_err();
        error.to_string()
    }

    #[test]
    fn a_parameter_of_others_stands_behind_the_table_and_is_set_like_any() {
        let text = format!("[params]\nUSR_WIND_MAX = 6\n{ROW}live = false\n");
        let params = Config::parse(Path::new("jink.toml"), &text).unwrap().params;
        let (row, value) = params.rows().nth(TABLE.len()).unwrap();
        assert_eq!(
            (row.name, row.unit, row.apply, value),
            ("USR_WIND_MAX", "m/s", Apply::Restart, 6.0)
        );
        assert_eq!(params.named("USR_WIND_MAX"), Some(6.0));
    }

    #[test]
    fn what_is_wrong_with_a_row_is_reported_with_its_line() {
        let with = |from: &str, to: &str| error_of(&ROW.replace(from, to));
        assert!(
            with("USR_WIND_MAX", "WIND_MAX")
                .starts_with("jink.toml:2: parameter name \"WIND_MAX\": use USR_")
        );
        assert!(with("USR_WIND_MAX", "USR_WIND_SPEED_MAX").starts_with("jink.toml:2: parameter name"));
        assert_eq!(
            with("default = 8", "default = 80"),
            "jink.toml:3: default = 80 is outside 0 to 20"
        );
        assert_eq!(with("min = 0\n", ""), "jink.toml:1: a parameter needs `min`");
        assert_eq!(
            with("max = 20", "max = nan"),
            "jink.toml:5: max = NaN is no value of this type"
        );
        assert_eq!(
            with("unit", "units"),
            "jink.toml:6: unknown key `units`; did you mean `unit`?"
        );
        assert_eq!(
            error_of(&format!("{ROW}{ROW}")),
            "jink.toml:8: two parameters are called USR_WIND_MAX"
        );
        assert_eq!(
            error_of(&format!("[params]\nUSR_WND_MAX = 3\n{ROW}")),
            "jink.toml:2: unknown parameter USR_WND_MAX; did you mean `USR_WIND_MAX`?"
        );
        let many: String = (0..64)
            .map(|n| ROW.replace("WIND_MAX", &format!("P{n}")))
            .collect();
        assert!(error_of(&many).contains("there is no room"));
    }
}
