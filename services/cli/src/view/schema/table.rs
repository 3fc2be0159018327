//! The schema as people read it.

use super::{Schema, comment};
use jink_control::status::write_table;
use jink_shared_types::shape::{FieldShape, Shape, StructShape, Value};
use std::fmt::Write;

/// Every topic, and every sample with its fields.
pub fn table(schema: &Schema) -> String {
    let mut out = String::new();
    let header = ["topic", "payload", "stale ms", "buffer", "wakes"].map(str::to_owned);
    let topics = schema.topics.iter().map(|topic| {
        [
            topic.row.name.to_owned(),
            topic.row.payload.to_owned(),
            format!("{}", topic.row.deadline_ms),
            format!("{}", topic.row.buffer),
            if topic.row.wakes { "yes" } else { "no" }.to_owned(),
        ]
    });
    write_table(
        &mut out,
        &std::iter::once(header).chain(topics).collect::<Vec<_>>(),
    );
    for shape in &schema.structs {
        sample(&mut out, schema, shape);
    }
    // Writing into a string cannot fail.
    for shape in &schema.enums {
        let _infallible = writeln!(out, "\n{} (u8): {}", shape.name, first_sentence(shape.docs));
        let rows = shape.variants.iter().map(|variant| {
            let code = format!("  {}", variant.code);
            [code, variant.text.to_owned(), first_sentence(variant.docs)]
        });
        write_table(&mut out, &rows.collect::<Vec<_>>());
    }
    out
}

fn sample(out: &mut String, schema: &Schema, shape: &StructShape) {
    let name = schema.type_name(shape).unwrap_or(shape.name);
    // Writing into a string cannot fail.
    let _infallible = writeln!(
        out,
        "\n{name}, {} bytes: {}",
        shape.size,
        first_sentence(shape.docs)
    );
    for meaning in shape.means {
        let _infallible = match meaning.value {
            Value::Float(value) => writeln!(out, "  with {} = {value}", meaning.name),
            Value::Count(value) => writeln!(out, "  with {} = {value}", meaning.name),
            Value::Texts(texts) => writeln!(out, "  with {} = {}", meaning.name, texts.join(", ")),
        };
    }
    let rows = shape.fields.iter().map(|field: &FieldShape| {
        [
            format!("  {}", field.offset),
            format!("{}", field.size),
            field.name.to_owned(),
            type_of(&field.shape),
            first_sentence(field.docs),
        ]
    });
    write_table(out, &rows.collect::<Vec<_>>());
}

fn first_sentence(docs: &[&str]) -> String {
    let text = comment(docs).collect::<Vec<_>>().join(" ");
    match text.find(". ") {
        Some(end) => text[..=end].to_owned(),
        None => text,
    }
}

fn type_of(shape: &Shape) -> String {
    match shape {
        Shape::Number(number) => number.name().to_owned(),
        Shape::Flag => "flag".to_owned(),
        Shape::Timestamp => "timestamp ns".to_owned(),
        Shape::Enum(shape) => shape.name.to_owned(),
        Shape::Quantity(shape) => format!("{}<{}> {}", shape.name, shape.frame, shape.unit),
        Shape::Rotation { from, to } => format!("Rotation<{from}, {to}>"),
        Shape::Array { of, len } => format!("[{}; {len}]", type_of(of)),
        Shape::Struct(shape) => shape.name.to_owned(),
        Shape::Reserved(_) => "reserved".to_owned(),
        Shape::Added(shape) => format!("{}, if given", type_of(shape)),
    }
}
