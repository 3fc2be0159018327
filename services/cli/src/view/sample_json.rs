//! A sample as JSON, for scripts: what its [`Shape`] says of its bytes.
//!
//! | in memory | in JSON |
//! |---|---|
//! | number | number; `null` for NaN, `"inf"` and `"-inf"` for the infinities |
//! | flag, enum, name | boolean, text, text |
//! | time stamp | seconds of CLOCK_MONOTONIC; `null` = never |
//! | vector in a frame, rotation | object of its components |
//! | array behind a field that says how much of it is used | so many elements |
//! | field added later | `null` while it is absent |
//! | reserved | nothing |

use jink_shared_types::health::Name;
use jink_shared_types::layout::{Layout, bytes_of};
use jink_shared_types::shape::{FieldShape, Number, Shape, StructShape};
use jink_shared_types::{STAGE_NAMES, SampleHeader};
use serde_json::{Map, Value, json};

/// One sample of `topic` with its header.
pub fn sample<T: Layout>(topic: &str, header: &SampleHeader, sample: &T) -> Value {
    json!({
        "topic": topic,
        "header": self::header(header),
        "sample": of(sample),
    })
}

/// The sample alone.
pub fn of<T: Layout>(sample: &T) -> Value {
    value(&T::SHAPE, bytes_of(sample))
}

/// One sample whose payload only its own programs know.
pub fn unknown(topic: &str, header: &SampleHeader, bytes: &[u8]) -> Value {
    let digits: String = bytes.iter().map(|byte| format!("{byte:02x}")).collect();
    json!({ "topic": topic, "header": self::header(header), "hex": digits })
}

fn header(header: &SampleHeader) -> Value {
    let mut all = value(&SampleHeader::SHAPE, bytes_of(header));
    let times = all.get_mut("stages").map(Value::take);
    let times = times.as_ref().and_then(Value::as_array).into_iter().flatten();
    let stages: Map<String, Value> = STAGE_NAMES
        .iter()
        .map(|name| (*name).to_owned())
        .zip(times.cloned())
        .collect();
    all["stages"] = Value::Object(stages);
    all
}

/// What `bytes` hold according to `shape`; `null` where there are too few of them.
fn value(shape: &Shape, bytes: &[u8]) -> Value {
    match shape {
        Shape::Number(kind) => number(*kind, bytes),
        Shape::Flag => json!(bytes.first().is_some_and(|byte| *byte != 0)),
        Shape::Timestamp => match first::<8>(bytes).map(u64::from_le_bytes) {
            Some(0) | None => Value::Null,
            Some(ns) => json!(ns as f64 * 1e-9),
        },
        Shape::Enum(shape) => {
            let code = bytes.first().copied().unwrap_or_default();
            let known = shape.variants.iter().find(|variant| variant.code == code);
            json!(known.or(shape.variants.first()).map(|variant| variant.text))
        }
        Shape::Quantity(quantity) => components(&quantity.components, bytes),
        Shape::Rotation { .. } => components(&["w", "x", "y", "z"], bytes),
        Shape::Array { of, len } => elements(of, *len, bytes),
        name if *name == Name::SHAPE => {
            let text = bytes.split(|byte| *byte == 0).next().unwrap_or_default();
            json!(String::from_utf8_lossy(text))
        }
        Shape::Struct(shape) => fields(shape, bytes),
        Shape::Reserved(_) => Value::Null,
        Shape::Added(_) if bytes.iter().all(|byte| *byte == 0) => Value::Null,
        Shape::Added(shape) => value(shape, bytes),
    }
}

fn fields(shape: &StructShape, bytes: &[u8]) -> Value {
    let part = |field: &FieldShape| {
        bytes
            .get(field.offset..field.offset + field.size)
            .unwrap_or_default()
    };
    let mut object = Map::new();
    for field in shape.fields {
        let shown = match &field.shape {
            Shape::Reserved(_) => continue,
            Shape::Array { of, len } => elements(of, used(&object, field.name, *len), part(field)),
            shape => value(shape, part(field)),
        };
        object.insert(field.name.to_owned(), shown);
    }
    Value::Object(object)
}

/// How many of the `most` elements of the array called `name` count, by the fields before it: `NAME_len`, `len`, or `beams`.
fn used(before: &Map<String, Value>, name: &str, most: usize) -> usize {
    let own = format!("{name}_len");
    let said = [own.as_str(), "len", "beams"]
        .into_iter()
        .find_map(|key| before.get(key)?.as_u64());
    said.map_or(most, |said| usize::try_from(said).unwrap_or(most).min(most))
}

fn elements(of: &Shape, len: usize, bytes: &[u8]) -> Value {
    let size = of.size().max(1);
    Value::Array(
        bytes
            .chunks(size)
            .take(len)
            .map(|chunk| value(of, chunk))
            .collect(),
    )
}

fn components(names: &[&str], bytes: &[u8]) -> Value {
    let numbers = bytes.chunks(8).map(|chunk| number(Number::F64, chunk));
    Value::Object(names.iter().map(|name| (*name).to_owned()).zip(numbers).collect())
}

fn first<const N: usize>(bytes: &[u8]) -> Option<[u8; N]> {
    bytes.first_chunk::<N>().copied()
}

fn number(kind: Number, bytes: &[u8]) -> Value {
    let read = match kind {
        Number::U8 => first(bytes).map(|raw| json!(u8::from_le_bytes(raw))),
        Number::U16 => first(bytes).map(|raw| json!(u16::from_le_bytes(raw))),
        Number::U32 => first(bytes).map(|raw| json!(u32::from_le_bytes(raw))),
        Number::U64 => first(bytes).map(|raw| json!(u64::from_le_bytes(raw))),
        Number::I8 => first(bytes).map(|raw| json!(i8::from_le_bytes(raw))),
        Number::I16 => first(bytes).map(|raw| json!(i16::from_le_bytes(raw))),
        Number::I32 => first(bytes).map(|raw| json!(i32::from_le_bytes(raw))),
        Number::I64 => first(bytes).map(|raw| json!(i64::from_le_bytes(raw))),
        Number::F32 => first(bytes).map(|raw| real(shortest(f32::from_le_bytes(raw)))),
        Number::F64 => first(bytes).map(|raw| real(f64::from_le_bytes(raw))),
    };
    read.unwrap_or(Value::Null)
}

/// The double with the fewest digits that is this float.
fn shortest(value: f32) -> f64 {
    value.to_string().parse().unwrap_or(f64::NAN)
}

fn real(value: f64) -> Value {
    match value {
        f64::INFINITY => json!("inf"),
        f64::NEG_INFINITY => json!("-inf"),
        // NaN becomes null.
        value => json!(value),
    }
}

#[cfg(test)]
mod tests {
    use super::{sample, unknown};
    use jink_shared_types::coded::{Coded, Flag};
    use jink_shared_types::health::{Health, Name, ServiceState, SystemStatus};
    use jink_shared_types::ring::SectorRing;
    use jink_shared_types::vehicle::{NavMode, VehicleState};
    use jink_shared_types::{LocalNed, Point, SampleHeader, Stage, Timestamp};

    fn header() -> SampleHeader {
        let at = Timestamp::from_seconds;
        let mut header = SampleHeader {
            capture: at(1.25),
            publish: at(1.5),
            generation: 2,
            ..SampleHeader::default()
        };
        header.stages[Stage::Fusion as usize].end = at(1.375);
        header
    }

    #[test]
    fn a_sample_is_an_object_of_its_fields_in_their_units() {
        let state = VehicleState {
            position: Point::<LocalNed>::new(1.0, -2.5, f64::NAN),
            armed: Flag::YES,
            mode: Coded::new(NavMode::Mission),
            ..VehicleState::default()
        };
        let json = sample("vehicle/state", &header(), &state);
        assert_eq!(json["topic"], "vehicle/state");
        assert_eq!(json["header"]["capture"], 1.25);
        assert_eq!(json["header"]["generation"], 2);
        assert_eq!(json["header"]["stages"]["fusion"]["end"], 1.375);
        assert!(json["header"]["stages"]["planner"]["end"].is_null());
        let sample = &json["sample"];
        assert_eq!(sample["position"]["x_m"], 1.0, "{sample}");
        assert_eq!(sample["position"]["y_m"], -2.5);
        assert!(sample["position"]["z_m"].is_null());
        assert_eq!(sample["armed"], true);
        assert_eq!(sample["mode"], "mission");
        assert!(!sample.to_string().contains("reserved"), "{sample}");
        let one = VehicleState {
            attitude: jink_shared_types::frames::Attitude::from_rotation(nalgebra::UnitQuaternion::identity()),
            ..state
        };
        assert_eq!(super::sample("", &header(), &one)["sample"]["attitude"]["w"], 1.0);
    }

    #[test]
    fn lists_end_where_their_length_says_and_names_are_texts() {
        let mut status = SystemStatus {
            health: Coded::new(Health::Degraded),
            len: 2,
            ..SystemStatus::default()
        };
        status.processes[1].heartbeat.name = Name::new("planner");
        status.processes[1].state = Coded::new(ServiceState::Stopped);
        let json = sample("system/status", &header(), &status);
        let processes = json["sample"]["processes"].as_array().unwrap();
        assert_eq!(json["sample"]["health"], "degraded");
        assert_eq!(processes.len(), 2);
        assert_eq!(processes[1]["heartbeat"]["name"], "planner");
        assert_eq!(processes[1]["state"], "stopped");
    }

    #[test]
    fn what_json_has_no_number_for_is_written_otherwise() {
        let mut ring = SectorRing::default();
        ring.distance_m[..3].copy_from_slice(&[f32::NAN, f32::INFINITY, 0.3]);
        let json = sample("guard/ring", &header(), &ring);
        let distances = &json["sample"]["distance_m"];
        assert!(distances[0].is_null());
        assert_eq!(distances[1], "inf");
        assert_eq!(distances[2].to_string(), "0.3");
        assert!(json["sample"]["seen"][0].is_null());
    }

    #[test]
    fn bytes_of_an_unknown_payload_are_digits() {
        let json = unknown("user/wind", &header(), &[0, 255, 16]);
        assert_eq!(json["hex"], "00ff10");
    }
}
