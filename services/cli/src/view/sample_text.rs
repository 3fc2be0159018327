//! A sample for people: what [`sample_json`] says of it, a field a line, three decimals, long lists cut.

use super::sample_json;
use jink_shared_types::layout::Layout;
use jink_shared_types::shape::Shape;
use jink_shared_types::{STAGE_NAMES, SampleHeader};
use serde_json::Value;

/// Elements of a list that are shown.
const SHOWN: usize = 6;

/// A sample's header on one line: who, when, how old, and what each stage took of that (ms).
pub fn header_line(header: &SampleHeader) -> String {
    let mut line = format!(
        "start {}, sample {}, published {:?}",
        header.sequence >> 32,
        header.sequence & u64::from(u32::MAX),
        header.publish
    );
    if header.capture.is_set() {
        let age_ms = header.publish.seconds_since(header.capture) * 1e3;
        line += &format!(", captured {age_ms:.1} ms before");
    }
    let mut before = header.capture;
    for (name, stage) in STAGE_NAMES.iter().zip(&header.stages) {
        if stage.end.is_set() {
            line += &format!(", {name} {:.1} ms", stage.end.seconds_since(before) * 1e3);
            before = stage.end;
        }
    }
    line
}

/// The fields of a sample in their order; `full`: nothing is left out of lists.
pub fn text<T: Layout>(sample: &T, full: bool) -> String {
    let mut out = String::new();
    fields(&T::SHAPE, &sample_json::of(sample), full, 0, &mut out);
    out
}

/// The fields of a struct, or whatever else it is, each on lines of its own.
fn fields(shape: &Shape, value: &Value, full: bool, depth: usize, out: &mut String) {
    let indent = "  ".repeat(depth);
    match (inner(shape), value) {
        (Shape::Struct(shape), Value::Object(object)) => {
            for field in shape.fields {
                if let Some(value) = object.get(field.name) {
                    named(field.name, &field.shape, value, full, depth, out);
                }
            }
        }
        (_, value) => *out += &format!("{indent}{}\n", short(shape, value)),
    }
}

/// One value with its name: on one line where it is a number, a word or a vector.
fn named(name: &str, shape: &Shape, value: &Value, full: bool, depth: usize, out: &mut String) {
    let indent = "  ".repeat(depth);
    match (inner(shape), value) {
        (Shape::Array { of, .. }, Value::Array(list)) => {
            let shown = if full { list.len() } else { list.len().min(SHOWN) };
            let more = match list.len() - shown {
                0 => String::new(),
                more => format!("... {more} more"),
            };
            if list.first().is_some_and(Value::is_object) && is_struct(of) {
                *out += &format!("{indent}{name}: {}\n", list.len());
                for (number, value) in list.iter().take(shown).enumerate() {
                    *out += &format!("{indent}  {number}\n");
                    fields(of, value, full, depth + 2, out);
                }
                if !more.is_empty() {
                    *out += &format!("{indent}  {more}\n");
                }
            } else {
                let one = |value: &Value| match (short(of, value), value.is_object()) {
                    (components, true) => format!("({components})"),
                    (number, false) => number,
                };
                let values = list.iter().take(shown).map(one);
                let values: Vec<String> = values.chain((!more.is_empty()).then_some(more)).collect();
                *out += &format!("{indent}{name}: [{}]\n", values.join(", "));
            }
        }
        (inner, Value::Object(_)) if is_struct(inner) => {
            *out += &format!("{indent}{name}\n");
            fields(inner, value, full, depth + 1, out);
        }
        (_, value) => *out += &format!("{indent}{name}: {}\n", short(shape, value)),
    }
}

fn inner(shape: &Shape) -> &Shape {
    match shape {
        Shape::Added(shape) => inner(shape),
        shape => shape,
    }
}

fn is_struct(shape: &Shape) -> bool {
    matches!(inner(shape), Shape::Struct(_))
}

/// A number, a word, or the components of a vector.
fn short(shape: &Shape, value: &Value) -> String {
    match value {
        Value::Null => match shape {
            Shape::Number(_) | Shape::Quantity(_) | Shape::Rotation { .. } => "NaN".to_owned(),
            _ => "-".to_owned(),
        },
        Value::String(word) => word.clone(),
        Value::Number(number) if number.is_f64() => {
            format!("{:.3}", number.as_f64().unwrap_or(f64::NAN))
        }
        Value::Object(object) => {
            let names: &[&str] = match inner(shape) {
                Shape::Quantity(quantity) => &quantity.components,
                _ => &["w", "x", "y", "z"],
            };
            let one = |name: &&str| Some(format!("{name} {}", short(shape, object.get(*name)?)));
            names.iter().filter_map(one).collect::<Vec<_>>().join(", ")
        }
        Value::Array(list) => {
            let values: Vec<String> = list.iter().map(|value| short(shape, value)).collect();
            format!("[{}]", values.join(", "))
        }
        other => other.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use super::{header_line, text};
    use jink_shared_types::health::{Name, SystemStatus};
    use jink_shared_types::moving::MovingObstacles;
    use jink_shared_types::ring::SectorRing;
    use jink_shared_types::vehicle::VehicleState;
    use jink_shared_types::{Point, SampleHeader, StageTime, Timestamp};

    #[test]
    fn a_header_is_one_line() {
        let at = |ms: u64| Timestamp::from_ns(5_000_000_000 + ms * 1_000_000);
        let mut header = SampleHeader {
            sequence: 2 << 32 | 7,
            capture: at(0),
            publish: at(9),
            ..SampleHeader::default()
        };
        for (n, (begin, end)) in [(1, 3), (4, 9)].into_iter().enumerate() {
            header.stages[n] = StageTime {
                begin: at(begin),
                end: at(end),
            };
        }
        assert_eq!(
            header_line(&header),
            "start 2, sample 7, published 5.009000000 s, captured 9.0 ms before, sensor 3.0 ms, fusion 6.0 ms"
        );
    }

    #[test]
    fn numbers_have_three_decimals_and_a_vector_is_one_line() {
        let state = VehicleState {
            position: Point::new(22.149_268_685_773_897, -2.5, f64::NAN),
            ..VehicleState::default()
        };
        let text = text(&state, false);
        assert!(
            text.contains("position: x_m 22.149, y_m -2.500, z_m NaN\n"),
            "{text}"
        );
    }

    #[test]
    fn a_list_ends_where_its_length_says_and_a_long_one_is_cut_unless_all_of_it_is_wanted() {
        let nothing = text(&MovingObstacles::default(), false);
        assert!(
            nothing.contains("len: 0\n") && nothing.lines().count() < 10,
            "{nothing}"
        );
        let mut status = SystemStatus {
            len: 2,
            ..SystemStatus::default()
        };
        status.processes[1].heartbeat.name = Name::new("planner");
        let processes = text(&status, false);
        assert!(
            processes.contains("processes: 2\n") && processes.contains("name: planner\n"),
            "{processes}"
        );
        let ring = SectorRing::default();
        assert!(
            text(&ring, false).contains("... 66 more]\n"),
            "{}",
            text(&ring, false)
        );
        assert!(!text(&ring, true).contains("more"));
    }
}
