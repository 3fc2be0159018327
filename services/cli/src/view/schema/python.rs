//! The schema as a Python module: ctypes structures that iceoryx2's own binding takes as they are.

use super::{Schema, capitals, comment, remark};
use jink_shared_types::shape::{FieldShape, Number, QuantityShape, Shape, StructShape, Value};
use jink_shared_types::topics::{FINGERPRINT, MAX_BORROWED, MAX_NODES};
use std::fmt::Write;

/// Words that are no names of fields.
const KEYWORDS: &[&str] = &[
    "False", "None", "True", "and", "as", "assert", "async", "await", "break", "class", "continue", "def",
    "del", "elif", "else", "except", "finally", "for", "from", "global", "if", "import", "in", "is",
    "lambda", "nonlocal", "not", "or", "pass", "raise", "return", "try", "while", "with", "yield",
];

/// The module. Writing into a string cannot fail.
pub fn module(schema: &Schema) -> String {
    let mut out = String::from(
        "\"\"\"The topics and samples of jink, as `jink schema --python` of one build prints them. Generated: do not edit.\n\n\
         The classes are what iceoryx2's Python binding (PyPI: iceoryx2, version 0.10) takes as payload and user header.\n\
         Type names end in a hash of the layout: a program with an older module is refused, it misreads nothing.\n\"\"\"\n\n\
         import ctypes\nimport enum\nimport typing\n",
    );
    let _ = writeln!(
        out,
        "\n# In common to builds that agree on every topic.\nFINGERPRINT = 0x{FINGERPRINT:016X}"
    );
    let _ = writeln!(out, "# Quality of service of every topic, besides safe overflow.");
    let _ = writeln!(
        out,
        "MAX_NODES = {MAX_NODES}\nMAX_BORROWED_SAMPLES = {MAX_BORROWED}\nHISTORY = 1"
    );
    for shape in &schema.enums {
        let _ = writeln!(out, "\n\nclass {}(enum.IntEnum):", shape.name);
        docs(&mut out, shape.docs);
        for variant in shape.variants {
            out.push('\n');
            remarks(&mut out, "    ", variant.docs);
            let _ = writeln!(out, "    {} = {}", name(&capitals(variant.name)), variant.code);
        }
    }
    for shape in &schema.quantities {
        let _ = writeln!(out, "\n\nclass {}(ctypes.Structure):", quantity_name(shape));
        let _ = writeln!(
            out,
            "    \"\"\"{} in frame {} ({}).\"\"\"\n",
            shape.name, shape.frame, shape.unit
        );
        doubles(&mut out, &shape.components);
    }
    for (from, to) in &schema.rotations {
        let _ = writeln!(out, "\n\nclass {}(ctypes.Structure):", rotation_name(from, to));
        let _ = writeln!(
            out,
            "    \"\"\"Unit quaternion that takes components in {from} to components in {to}.\"\"\"\n"
        );
        doubles(&mut out, &["w", "x", "y", "z"]);
    }
    for shape in &schema.structs {
        structure(&mut out, schema, shape);
    }
    topics(&mut out, schema);
    out
}

fn docs(out: &mut String, docs: &[&str]) {
    let text = comment(docs).collect::<Vec<_>>().join("\n    ");
    let escaped = text.replace('\\', "\\\\").replace("\"\"\"", "\\\"\\\"\\\"");
    let _ = writeln!(out, "    \"\"\"{}\"\"\"", escaped.replace("\n    \n", "\n\n"));
}

fn remarks(out: &mut String, indentation: &str, docs: &[&str]) {
    for line in comment(docs) {
        let _ = writeln!(out, "{}", format!("{indentation}# {line}").trim_end());
    }
}

/// A name, with an underscore behind it where the language has the word for itself.
fn name(name: &str) -> String {
    let suffix = if KEYWORDS.contains(&name) { "_" } else { "" };
    format!("{name}{suffix}")
}

fn doubles(out: &mut String, components: &[&str]) {
    let fields: Vec<String> = components
        .iter()
        .map(|component| format!("(\"{component}\", ctypes.c_double)"))
        .collect();
    let _ = writeln!(out, "    _fields_ = [{}]", fields.join(", "));
}

fn quantity_name(shape: &QuantityShape) -> String {
    format!("{}{}", shape.name, shape.frame)
}

fn rotation_name(from: &str, to: &str) -> String {
    format!("Rotation{from}To{to}")
}

fn structure(out: &mut String, schema: &Schema, shape: &StructShape) {
    let _ = writeln!(out, "\n\nclass {}(ctypes.Structure):", shape.name);
    docs(out, shape.docs);
    if !shape.means.is_empty() {
        out.push('\n');
    }
    for meaning in shape.means {
        let _ = match meaning.value {
            Value::Float(value) => writeln!(out, "    {} = {value:?}", meaning.name),
            Value::Count(value) => writeln!(out, "    {} = {value}", meaning.name),
            Value::Texts(texts) => writeln!(out, "    {} = {texts:?}", meaning.name),
        };
    }
    out.push_str("\n    _fields_ = [\n");
    for field in shape.fields {
        remarks(out, "        ", field.docs);
        remarks(out, "        ", remark(field).as_slice());
        let _ = writeln!(
            out,
            "        (\"{}\", {}),{}",
            name(field.name),
            type_of(&field.shape),
            code_of(field)
        );
    }
    out.push_str("    ]\n");
    if let Some(type_name) = schema.type_name(shape) {
        let _ = writeln!(
            out,
            "\n    @staticmethod\n    def type_name() -> str:\n        \"\"\"The name under which iceoryx2 knows it.\"\"\"\n        \
             return \"{type_name}\""
        );
    }
    let _ = writeln!(out, "\n\nassert ctypes.sizeof({}) == {}", shape.name, shape.size);
}

/// Says which enum the byte of a field is a code of.
fn code_of(field: &FieldShape) -> String {
    match field.shape {
        Shape::Enum(shape) => format!("  # {}", shape.name),
        _ => String::new(),
    }
}

fn type_of(shape: &Shape) -> String {
    match shape {
        Shape::Number(Number::F32) => "ctypes.c_float".to_owned(),
        Shape::Number(Number::F64) => "ctypes.c_double".to_owned(),
        Shape::Number(integer) => {
            let (sign, bits) = integer.name().split_at(1);
            format!("ctypes.c_{}int{bits}", if sign == "u" { "u" } else { "" })
        }
        Shape::Flag | Shape::Enum(_) => "ctypes.c_uint8".to_owned(),
        Shape::Timestamp => "ctypes.c_uint64".to_owned(),
        Shape::Quantity(shape) => quantity_name(shape),
        Shape::Rotation { from, to } => rotation_name(from, to),
        Shape::Array { of, len } => format!("{} * {len}", type_of(of)),
        Shape::Struct(shape) => shape.name.to_owned(),
        Shape::Reserved(bytes) => format!("ctypes.c_uint8 * {bytes}"),
        Shape::Added(shape) => type_of(shape),
    }
}

fn topics(out: &mut String, schema: &Schema) {
    out.push_str(
        "\n\nclass Topic(typing.NamedTuple):\n    \"\"\"One row of the topic table.\"\"\"\n\n    \
         payload: type\n    # Age at which a sample counts as stale (ms).\n    deadline_ms: float\n    \
         # Samples a reader can fall behind.\n    buffer: int\n    max_publishers: int\n    max_subscribers: int\n    \
         # Its samples come with an event on the event service of the same name.\n    wakes: bool\n\n\n\
         USER_HEADER = SampleHeader\n\n\
         # By name. What ends in * is a family: the name of a sensor or process takes the place of the star.\nTOPICS = {\n",
    );
    for topic in &schema.topics {
        let row = topic.row;
        let wakes = if row.wakes { "True" } else { "False" };
        let _ = writeln!(
            out,
            "    \"{}\": Topic({}, {:?}, {}, {}, {}, {wakes}),",
            row.name,
            row.payload,
            row.deadline_ms,
            row.buffer,
            row.max_publishers(),
            row.max_subscribers(),
        );
    }
    out.push_str("}\n");
}
