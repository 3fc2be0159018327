//! The files that say what our parameters mean, made once from their rows.
//!
//! | file | format |
//! |---|---|
//! | `general.json` | general.schema.json of MAVLink's component metadata: where the others are, with their checksums |
//! | `parameters.json` | parameter.schema.json: name, type, range, default, unit, help, whether a restart is needed |

use super::crc::crc32;
use jink_shared_types::params::{Apply, Param, ParamSet, ParamType};
use serde_json::{Map, Value, json};

/// Name of the general file; its address in COMPONENT_METADATA is [`GENERAL_URI`].
pub const GENERAL: &str = "general.json";
/// Where ground stations find it.
pub const GENERAL_URI: &str = "mftp:///general.json";
/// Name of the parameters' file.
pub const PARAMETERS: &str = "parameters.json";

/// COMP_METADATA_TYPE_PARAMETER.
const TYPE_PARAMETER: u32 = 1;

/// The general file, given the parameters' file.
pub fn general(parameters: &[u8]) -> Vec<u8> {
    let text = json!({
        "version": 1,
        "metadataTypes": [{
            "type": TYPE_PARAMETER,
            "uri": format!("mftp:///{PARAMETERS}"),
            "fileCrc": crc32(parameters),
        }],
    });
    text.to_string().into_bytes()
}

/// The parameters' file, of these rows.
pub fn parameters(params: &ParamSet) -> Vec<u8> {
    let rows: Vec<Value> = params.rows().map(|(row, _)| parameter(row)).collect();
    json!({ "version": 1, "parameters": rows })
        .to_string()
        .into_bytes()
}

fn parameter(row: &Param) -> Value {
    let number = |value: f64| match row.kind {
        ParamType::Float => json!(value),
        ParamType::Integer | ParamType::Boolean => json!(value as i64),
    };
    let mut entry = Map::new();
    let mut say = |key: &str, value: Value| entry.insert(key.to_owned(), value);
    say("name", json!(row.name));
    say(
        "type",
        json!(match row.kind {
            ParamType::Float => "Float",
            ParamType::Integer => "Int32",
            ParamType::Boolean => "Uint8",
        }),
    );
    say("shortDesc", json!(short(row.help)));
    say("longDesc", json!(row.help));
    say("group", json!(group(row.name)));
    say("category", json!("Standard"));
    say("default", number(row.default));
    say("min", number(row.min));
    say("max", number(row.max));
    if row.kind == ParamType::Float {
        say("decimalPlaces", json!(2));
    }
    if !row.unit.is_empty() {
        say("units", json!(row.unit));
    }
    if row.apply == Apply::Restart {
        say("rebootRequired", json!(true));
    }
    Value::Object(entry)
}

/// The first part of a line of help: what stands before its first explanation.
fn short(help: &str) -> &str {
    help.split([':', ',']).next().unwrap_or(help)
}

/// Under which heading ground stations show it.
fn group(name: &str) -> &'static str {
    match name.split('_').next() {
        Some("OA") => "Avoidance",
        Some("GD") => "Collision guard",
        Some("GW") => "Gateway",
        Some("USR") => "Own",
        _ => "Other",
    }
}

#[cfg(test)]
mod tests {
    use super::{GENERAL_URI, crc32, general, parameters};
    use jink_shared_types::params::{Apply, ParamSet, TABLE};
    use serde_json::Value;

    /// The keys that parameter.schema.json allows for a parameter, with a check of each value's type.
    fn allows(key: &str, value: &Value) -> bool {
        match key {
            "name" => value.as_str().is_some_and(|name| {
                let first = name.starts_with(|c: char| c.is_ascii_alphabetic());
                first && name.len() <= 16 && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
            }),
            "type" => {
                let types = ["Uint8", "Int8", "Uint16", "Int16", "Uint32", "Int32", "Float"];
                value.as_str().is_some_and(|kind| types.contains(&kind))
            }
            "shortDesc" | "longDesc" | "units" | "group" | "category" => {
                value.as_str().is_some_and(|text| !text.is_empty())
            }
            "default" | "min" | "max" | "increment" => value.is_number(),
            "decimalPlaces" => value.is_u64(),
            "rebootRequired" | "volatile" => value.is_boolean(),
            "values" | "bitmask" => value.is_array(),
            _ => false,
        }
    }

    #[test]
    fn the_parameters_file_keeps_to_its_schema_and_names_every_row() {
        let file: Value = serde_json::from_slice(&parameters(&ParamSet::default())).unwrap();
        assert_eq!(file["version"], 1);
        assert_eq!(file.as_object().unwrap().len(), 2);
        let entries = file["parameters"].as_array().unwrap();
        assert_eq!(entries.len(), TABLE.len());
        for (entry, row) in entries.iter().zip(TABLE) {
            for (key, value) in entry.as_object().unwrap() {
                assert!(allows(key, value), "{}: {key} = {value}", row.name);
            }
            assert_eq!(entry["name"], row.name);
            let number = |key: &str| entry[key].as_f64().unwrap();
            assert_eq!(
                (number("min"), number("max"), number("default")),
                (row.min, row.max, row.default)
            );
            assert_eq!(
                entry["rebootRequired"].as_bool().unwrap_or(false),
                row.apply == Apply::Restart
            );
            let (short, long) = (
                entry["shortDesc"].as_str().unwrap(),
                entry["longDesc"].as_str().unwrap(),
            );
            assert!(long.starts_with(short));
        }
    }

    #[test]
    fn the_general_file_points_at_the_parameters_with_their_checksum() {
        let parameters = parameters(&ParamSet::default());
        let file: Value = serde_json::from_slice(&general(&parameters)).unwrap();
        assert_eq!(file["version"], 1);
        let entry = &file["metadataTypes"][0];
        assert_eq!(entry["type"], 1);
        assert_eq!(entry["fileCrc"], crc32(&parameters));
        assert_eq!(entry["uri"], "mftp:///parameters.json");
        assert!(
            GENERAL_URI.len() < 100,
            "the message has room for 100 bytes with a final zero"
        );
    }
}
