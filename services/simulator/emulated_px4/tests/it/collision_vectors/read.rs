//! Numbers and run-length coded arrays of the vectors.

use jink_emulated_px4::collision_prevention::BINS;
use nalgebra::Vector2;
use serde_json::Value;

/// A number; what JSON cannot say is a string.
pub fn number(value: &Value) -> f64 {
    match value.as_str() {
        Some("NaN") => f64::NAN,
        Some("Infinity") => f64::INFINITY,
        Some("-Infinity") => f64::NEG_INFINITY,
        Some(other) => panic!("no number: {other}"),
        None => value.as_f64().expect("a number"),
    }
}

/// The input that PX4 had.
pub fn single(value: &Value) -> f32 {
    number(value) as f32
}

/// A whole number.
pub fn whole(value: &Value) -> i64 {
    value.as_i64().expect("a whole number")
}

/// North and east.
pub fn vector(value: &Value) -> Vector2<f32> {
    Vector2::new(single(&value[0]), single(&value[1]))
}

/// w, x, y, z.
pub fn quaternion(value: &Value) -> [f32; 4] {
    std::array::from_fn(|i| single(&value[i]))
}

/// An array of `[value, count]`, unrolled.
pub fn unrolled(value: &Value) -> [i64; BINS] {
    let mut all = [0; BINS];
    let mut at = 0;
    for run in value.as_array().expect("runs") {
        let len = whole(&run[1]) as usize;
        all[at..at + len].fill(whole(&run[0]));
        at += len;
    }
    assert_eq!(at, BINS, "counts add up");
    all
}

/// Distances (cm), unrolled.
pub fn distances_cm(value: &Value) -> [u16; BINS] {
    unrolled(value).map(|cm| cm as u16)
}

/// The numbers of a list, or none of a list that is not there.
pub fn indices(value: &Value) -> Vec<usize> {
    let list = value.as_array().map(Vec::as_slice).unwrap_or_default();
    list.iter().map(|index| whole(index) as usize).collect()
}
