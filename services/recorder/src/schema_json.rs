//! The schema for machines.

use crate::schema::{Schema, comment};
use jink_shared_types::shape::{EnumShape, FieldShape, Shape, StructShape, Value as Constant};
use jink_shared_types::topics::{FINGERPRINT, MAX_BORROWED, MAX_NODES};
use serde_json::{Map, Value, json};

/// One JSON object with everything in it.
pub fn json(schema: &Schema) -> String {
    let user_header = schema.payloads.first().map(|payload| payload.shape.name);
    let topics: Vec<Value> = schema
        .topics
        .iter()
        .map(|topic| {
            let row = topic.row;
            json!({
                "name": row.name,
                "is_family": row.is_family(),
                "payload": row.payload,
                "type_name": topic.payload.type_name,
                "rate_hz": row.rate_hz,
                "deadline_ms": row.deadline_ms,
                "buffer": row.buffer,
                "wakes": row.wakes,
                "max_publishers": row.max_publishers(),
                "max_subscribers": row.max_subscribers(),
                "producers": row.producers,
                "consumers": row.consumers,
            })
        })
        .collect();
    let samples: Vec<Value> = schema.structs.iter().map(|shape| sample(schema, shape)).collect();
    let enums: Vec<Value> = schema.enums.iter().map(|shape| variants(shape)).collect();
    let all = json!({
        "fingerprint": format!("{FINGERPRINT:016x}"),
        "user_header": user_header,
        "max_nodes": MAX_NODES,
        "max_borrowed_samples": MAX_BORROWED,
        "history": 1,
        "topics": topics,
        "samples": samples,
        "enums": enums,
    });
    format!("{all:#}\n")
}

fn lines(docs: &[&str]) -> String {
    comment(docs).collect::<Vec<_>>().join("\n")
}

fn sample(schema: &Schema, shape: &StructShape) -> Value {
    let means: Map<String, Value> = shape
        .means
        .iter()
        .map(|meaning| {
            let value = match meaning.value {
                Constant::Float(value) => json!(value),
                Constant::Count(value) => json!(value),
                Constant::Texts(texts) => json!(texts),
            };
            (meaning.name.to_owned(), value)
        })
        .collect();
    let fields: Vec<Value> = shape.fields.iter().map(field).collect();
    json!({
        "name": shape.name,
        "type_name": schema.type_name(shape),
        "docs": lines(shape.docs),
        "size": shape.size,
        "align": shape.align,
        "means": means,
        "fields": fields,
    })
}

fn field(field: &FieldShape) -> Value {
    json!({
        "name": field.name,
        "docs": lines(field.docs),
        "offset": field.offset,
        "size": field.size,
        "type": type_of(&field.shape),
    })
}

fn type_of(shape: &Shape) -> Value {
    match shape {
        Shape::Number(number) => json!({ "kind": "number", "name": number.name() }),
        Shape::Flag => json!({ "kind": "flag" }),
        Shape::Timestamp => json!({ "kind": "timestamp" }),
        Shape::Enum(shape) => json!({ "kind": "enum", "name": shape.name }),
        Shape::Quantity(shape) => json!({
            "kind": "quantity",
            "name": shape.name,
            "unit": shape.unit,
            "frame": shape.frame,
            "components": shape.components,
        }),
        Shape::Rotation { from, to } => json!({ "kind": "rotation", "from": from, "to": to }),
        Shape::Array { of, len } => json!({ "kind": "array", "of": type_of(of), "len": len }),
        Shape::Struct(shape) => json!({ "kind": "sample", "name": shape.name }),
        Shape::Reserved(bytes) => json!({ "kind": "reserved", "bytes": bytes }),
        Shape::Added(shape) => json!({ "kind": "added", "of": type_of(shape) }),
    }
}

fn variants(shape: &EnumShape) -> Value {
    let variants: Vec<Value> = shape
        .variants
        .iter()
        .map(|variant| {
            json!({
                "name": variant.name,
                "text": variant.text,
                "code": variant.code,
                "docs": lines(variant.docs),
            })
        })
        .collect();
    json!({ "name": shape.name, "docs": lines(shape.docs), "variants": variants })
}
