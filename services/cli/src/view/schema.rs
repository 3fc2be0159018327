//! The topics and samples of this build, for programs in other languages: what the topic table and `sample!` say, as
//! a C header, a Python module, JSON or a table.

mod c;
mod python;
mod table;

pub use c::header;
pub use jink_recorder::schema::{Schema, json};
pub use python::module;
pub use table::table;

use jink_recorder::schema::comment;
use jink_shared_types::shape::{FieldShape, Shape};

/// What the bytes of a field say to somebody who looks at its number: `None` for what its type says already.
fn remark(field: &FieldShape) -> Option<&'static str> {
    match field.shape {
        Shape::Timestamp => Some("Nanoseconds of CLOCK_MONOTONIC; 0 = never."),
        Shape::Flag => Some("0 = no, anything else = yes."),
        Shape::Added(_) => Some("All bytes zero = not given."),
        _ => None,
    }
}

/// `LocalNed` as `local_ned`, `range/scan/*` as `range_scan`.
fn snake(name: &str) -> String {
    let mut out = String::new();
    for letter in name.chars() {
        match letter {
            'A'..='Z' => {
                if !out.is_empty() {
                    out.push('_');
                }
                out.push(letter.to_ascii_lowercase());
            }
            '/' => out.push('_'),
            '*' => {}
            _ => out.push(letter),
        }
    }
    out.trim_end_matches('_').to_owned()
}

/// The same in capitals.
fn capitals(name: &str) -> String {
    snake(name).to_ascii_uppercase()
}

#[cfg(test)]
mod tests {
    use super::{capitals, snake};

    #[test]
    fn names_become_those_of_other_languages() {
        assert_eq!(snake("VehicleState"), "vehicle_state");
        assert_eq!(capitals("range/scan/*"), "RANGE_SCAN");
        assert_eq!(snake("parameters/change"), "parameters_change");
    }
}
