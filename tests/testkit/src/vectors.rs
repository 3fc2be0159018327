//! Scenarios with what PX4's own code answered, as they are written: one JSON object a line.
//!
//! Arrays of 72 are run-length coded; numbers that are none are the texts NaN, Infinity and -Infinity. What is not as it is
//! expected fails the test.

use serde_json::Value;
use std::path::Path;

/// Elements of a map or of a row.
pub const BINS: usize = 72;

/// Every scenario of the `.jsonl` files in `folder`, in the order of their names; none if there is no such folder.
pub fn scenarios(folder: &Path) -> Vec<Value> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut files: Vec<_> = entries
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|extension| extension == "jsonl"))
        .collect();
    files.sort();
    let texts = files.iter().map(|file| std::fs::read_to_string(file).unwrap());
    texts
        .flat_map(|text| text.lines().map(scenario).collect::<Vec<_>>())
        .collect()
}

/// One of them.
pub fn scenario(line: &str) -> Value {
    serde_json::from_str(line).expect("a JSON object per line")
}

/// A number; what JSON cannot say is a text.
#[track_caller]
pub fn number(value: &Value) -> f64 {
    match value.as_str() {
        Some("NaN") => f64::NAN,
        Some("Infinity") => f64::INFINITY,
        Some("-Infinity") => f64::NEG_INFINITY,
        _ => value.as_f64().unwrap_or_else(|| panic!("no number: {value}")),
    }
}

/// `N` numbers.
#[track_caller]
pub fn numbers<const N: usize>(value: &Value) -> [f64; N] {
    assert_eq!(list(value).len(), N, "{value}");
    std::array::from_fn(|i| number(&value[i]))
}

/// A whole number.
#[track_caller]
pub fn whole(value: &Value) -> i64 {
    value
        .as_i64()
        .unwrap_or_else(|| panic!("no whole number: {value}"))
}

/// Yes or no.
#[track_caller]
pub fn flag(value: &Value) -> bool {
    value
        .as_bool()
        .unwrap_or_else(|| panic!("neither true nor false: {value}"))
}

/// The members of a list.
#[track_caller]
pub fn list(value: &Value) -> &[Value] {
    value.as_array().unwrap_or_else(|| panic!("no list: {value}"))
}

/// The members of the list `name`; none if it is not there.
#[track_caller]
pub fn list_if_any<'a>(value: &'a Value, name: &str) -> &'a [Value] {
    value.get(name).map(list).unwrap_or_default()
}

/// Numbers of bins, none if there is no list of them.
#[track_caller]
pub fn indices(value: &Value, name: &str) -> Vec<usize> {
    let list = list_if_any(value, name).iter();
    list.map(|index| whole(index) as usize).collect()
}

/// An array of `[value, count]`, unrolled.
#[track_caller]
pub fn unrolled(value: &Value) -> [i64; BINS] {
    let runs = list(value)
        .iter()
        .map(|run| (whole(&run[0]), whole(&run[1]) as usize));
    let all: Vec<i64> = runs
        .flat_map(|(value, count)| std::iter::repeat_n(value, count))
        .collect();
    all.try_into()
        .unwrap_or_else(|_| panic!("not {BINS} numbers: {value}"))
}

/// Distances (cm), unrolled.
#[track_caller]
pub fn distances_cm(value: &Value) -> [u16; BINS] {
    unrolled(value).map(|cm| cm as u16)
}
