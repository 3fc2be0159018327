//! Whether a topic was recorded with the layout that a program has, and where not.

use jink_recorder::schema::{self, Schema};
use jink_shared_types::topics::TABLE;
use serde_json::Value;
use std::collections::BTreeMap;

/// What differs between the layout in which `topic` was recorded, with this schema, and that which a program has.
pub(crate) fn difference(topic: &str, recorded: &str, schema: &str, program: &str) -> String {
    let begin = format!("{topic} was recorded with another layout ({recorded}, the program has {program})");
    let row = TABLE.iter().find(|row| row.member_of(topic).is_some());
    let ours = row.and_then(|row| Schema::of(&[row.payload.to_owned()]).ok());
    let ours = ours.and_then(|ours| serde_json::from_str::<Value>(&schema::json(&ours)).ok());
    let theirs = serde_json::from_str::<Value>(schema).ok();
    match theirs.zip(ours).and_then(|(theirs, ours)| field(&theirs, &ours)) {
        Some(field) => format!("{begin}: {field}"),
        None => begin,
    }
}

/// The first field that is not the same in two schemas.
fn field(recorded: &Value, ours: &Value) -> Option<String> {
    let fields = |schema: &Value| -> Vec<(String, String)> {
        let samples = schema["samples"].as_array().into_iter().flatten();
        let of_sample = |sample: &Value| -> Vec<(String, String)> {
            let name = sample["name"].as_str().unwrap_or_default();
            let fields = sample["fields"].as_array().into_iter().flatten();
            let of_field = |field: &Value| {
                let place = format!(
                    "at {}, {} bytes, {}",
                    field["offset"], field["size"], field["type"]
                );
                (
                    format!("{name}.{}", field["name"].as_str().unwrap_or_default()),
                    place,
                )
            };
            fields.map(of_field).collect()
        };
        samples.flat_map(of_sample).collect()
    };
    let (recorded, ours) = (fields(recorded), fields(ours));
    let by_name: BTreeMap<&String, &String> = ours.iter().map(|(name, place)| (name, place)).collect();
    let changed = recorded.iter().find_map(|(name, was)| match by_name.get(name) {
        None => Some(format!("{name} is there no more")),
        Some(is) if *is != was => Some(format!("{name} was {was}, is {is}")),
        Some(_) => None,
    });
    let is_new = |(name, _): &&(String, String)| !recorded.iter().any(|(known, _)| known == name);
    changed.or_else(|| Some(format!("{} is new", ours.iter().find(is_new)?.0)))
}

#[cfg(test)]
mod tests {
    use super::difference;
    use jink_recorder::schema::{self, Schema};

    #[test]
    fn the_field_that_differs_is_named() {
        let schema = schema::json(&Schema::of(&["VehicleState".to_owned()]).unwrap());
        let renamed = schema.replacen("\"velocity\"", "\"speed\"", 1);
        let said = difference(
            "vehicle/state",
            "jink.VehicleState#1",
            &renamed,
            "jink.VehicleState#2",
        );
        assert!(said.contains("VehicleState.speed is there no more"), "{said}");
        let said = difference("user/echo", "Echo#1", "", "Echo#2");
        assert!(said.ends_with("(Echo#1, the program has Echo#2)"), "{said}");
    }
}
