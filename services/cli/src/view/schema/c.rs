//! The schema as a C11 header, which a C++ compiler takes as well.

use super::{Schema, capitals, comment, remark, snake};
use jink_shared_types::shape::{EnumShape, FieldShape, Number, QuantityShape, Shape, StructShape, Value};
use jink_shared_types::topics::{FINGERPRINT, MAX_BORROWED, MAX_NODES};
use std::fmt::Write;

/// Words that are no names of fields in C or C++.
const KEYWORDS: &[&str] = &[
    "auto",
    "bool",
    "break",
    "case",
    "catch",
    "char",
    "class",
    "const",
    "continue",
    "default",
    "delete",
    "do",
    "double",
    "else",
    "enum",
    "extern",
    "float",
    "for",
    "goto",
    "if",
    "inline",
    "int",
    "long",
    "namespace",
    "new",
    "operator",
    "private",
    "protected",
    "public",
    "register",
    "return",
    "short",
    "signed",
    "sizeof",
    "static",
    "struct",
    "switch",
    "template",
    "this",
    "throw",
    "try",
    "typedef",
    "typename",
    "union",
    "unsigned",
    "using",
    "virtual",
    "void",
    "volatile",
    "while",
];

/// The header. Writing into a string cannot fail.
pub fn header(schema: &Schema) -> String {
    let mut out = String::from(
        "/* The topics and samples of jink, as `jink schema --c` of one build prints them. Generated: do not edit.\n \
         *\n \
         * A sample travels through iceoryx2 0.10 as its payload, with JINK_SAMPLE_HEADER_TYPE_NAME as the user header's type.\n \
         * Type names end in a hash of the layout: a program with an older header is refused, it misreads nothing. */\n\
         #ifndef JINK_SCHEMA_H\n#define JINK_SCHEMA_H\n\n#include <assert.h>\n#include <stddef.h>\n#include <stdint.h>\n",
    );
    let _ = writeln!(
        out,
        "\n// In common to builds that agree on every topic.\n#define JINK_FINGERPRINT 0x{FINGERPRINT:016x}u"
    );
    let _ = writeln!(
        out,
        "\n// Quality of service of every topic: safe overflow, a history of one."
    );
    let _ = writeln!(
        out,
        "#define JINK_MAX_NODES {MAX_NODES}\n#define JINK_MAX_BORROWED_SAMPLES {MAX_BORROWED}\n#define JINK_HISTORY 1"
    );
    out.push_str("\n// Nanoseconds of CLOCK_MONOTONIC; 0 = never.\ntypedef uint64_t jink_timestamp_ns_t;\n");
    out.push_str("// 0 = no, anything else = yes.\ntypedef uint8_t jink_flag_t;\n");
    for shape in &schema.enums {
        enumeration(&mut out, shape);
    }
    for shape in &schema.quantities {
        quantity(&mut out, shape);
    }
    for (from, to) in &schema.rotations {
        rotation(&mut out, from, to);
    }
    for shape in &schema.structs {
        structure(&mut out, schema, shape);
    }
    topics(&mut out, schema);
    out.push_str("\n#endif\n");
    out
}

/// Name of the type of a struct or an enum.
fn type_name(name: &str) -> String {
    format!("jink_{}_t", snake(name))
}

fn docs(out: &mut String, indentation: &str, docs: &[&str]) {
    for line in comment(docs) {
        // A backslash at the end of a line would go on with the comment.
        let _ = writeln!(out, "{indentation}// {}", line.trim_end_matches('\\'));
    }
}

fn enumeration(out: &mut String, shape: &EnumShape) {
    out.push('\n');
    docs(out, "", shape.docs);
    let _ = writeln!(out, "typedef uint8_t {};\nenum {{", type_name(shape.name));
    for variant in shape.variants {
        docs(out, "    ", variant.docs);
        let (of, name) = (capitals(shape.name), capitals(variant.name));
        let _ = writeln!(out, "    JINK_{of}_{name} = {},", variant.code);
    }
    out.push_str("};\n");
}

fn quantity_name(shape: &QuantityShape) -> String {
    format!("jink_{}_{}_t", snake(shape.name), snake(shape.frame))
}

fn quantity(out: &mut String, shape: &QuantityShape) {
    let [x, y, z] = shape.components;
    let _ = writeln!(
        out,
        "\n// {} in frame {} ({}).",
        shape.name, shape.frame, shape.unit
    );
    let _ = writeln!(
        out,
        "typedef struct {{\n    double {x};\n    double {y};\n    double {z};\n}} {};",
        quantity_name(shape)
    );
}

fn rotation_name(from: &str, to: &str) -> String {
    format!("jink_rotation_{}_to_{}_t", snake(from), snake(to))
}

fn rotation(out: &mut String, from: &str, to: &str) {
    let _ = writeln!(
        out,
        "\n// Unit quaternion that takes components in {from} to components in {to}."
    );
    let _ = writeln!(
        out,
        "typedef struct {{\n    double w;\n    double x;\n    double y;\n    double z;\n}} {};",
        rotation_name(from, to)
    );
}

fn structure(out: &mut String, schema: &Schema, shape: &StructShape) {
    let (name, prefix) = (type_name(shape.name), capitals(shape.name));
    out.push('\n');
    docs(out, "", shape.docs);
    let _ = writeln!(out, "typedef struct jink_{} {{", snake(shape.name));
    if let Some(type_name) = schema.type_name(shape) {
        let _ = writeln!(
            out,
            "#ifdef __cplusplus\n    // iceoryx2's C++ binding looks for this.\n    \
             static constexpr const char *IOX2_TYPE_NAME = \"{type_name}\";\n#endif"
        );
    }
    for field in shape.fields {
        docs(out, "    ", field.docs);
        docs(out, "    ", remark(field).as_slice());
        let _ = writeln!(out, "    {};", declaration(field));
    }
    let _ = writeln!(out, "}} {name};");
    let _ = writeln!(
        out,
        "static_assert(sizeof({name}) == {}, \"size of {name}\");",
        shape.size
    );
    for field in shape.fields {
        let member = member(field.name);
        let _ = writeln!(
            out,
            "static_assert(offsetof({name}, {member}) == {}, \"offset of {member}\");",
            field.offset
        );
    }
    for meaning in shape.means {
        let _ = match meaning.value {
            Value::Float(value) => writeln!(out, "#define JINK_{prefix}_{} {value:?}", meaning.name),
            Value::Count(value) => writeln!(out, "#define JINK_{prefix}_{} {value}", meaning.name),
            Value::Texts(texts) => {
                let quoted: Vec<String> = texts.iter().map(|text| format!("\"{text}\"")).collect();
                writeln!(
                    out,
                    "#define JINK_{prefix}_{} {{{}}}",
                    meaning.name,
                    quoted.join(", ")
                )
            }
        };
    }
    if let Some(type_name) = schema.type_name(shape) {
        let _ = writeln!(out, "#define JINK_{prefix}_TYPE_NAME \"{type_name}\"");
    }
}

/// The name of a field, with an underscore where the language has the word for itself.
fn member(name: &str) -> String {
    let suffix = if KEYWORDS.contains(&name) { "_" } else { "" };
    format!("{name}{suffix}")
}

fn declaration(field: &FieldShape) -> String {
    let (mut shape, mut dimensions) = (&field.shape, String::new());
    loop {
        match shape {
            Shape::Array { of, len } => {
                let _ = write!(dimensions, "[{len}]");
                shape = of;
            }
            Shape::Added(of) => shape = of,
            Shape::Reserved(bytes) => {
                let _ = write!(dimensions, "[{bytes}]");
                break;
            }
            _ => break,
        }
    }
    format!("{} {}{dimensions}", element(shape), member(field.name))
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Number(Number::F32) => "float".to_owned(),
        Shape::Number(Number::F64) => "double".to_owned(),
        Shape::Number(integer) => {
            let (sign, bits) = integer.name().split_at(1);
            format!("{}int{bits}_t", if sign == "u" { "u" } else { "" })
        }
        Shape::Flag => "jink_flag_t".to_owned(),
        Shape::Timestamp => "jink_timestamp_ns_t".to_owned(),
        Shape::Enum(shape) => type_name(shape.name),
        Shape::Quantity(shape) => quantity_name(shape),
        Shape::Rotation { from, to } => rotation_name(from, to),
        Shape::Struct(shape) => type_name(shape.name),
        Shape::Array { of, .. } | Shape::Added(of) => element(of),
        Shape::Reserved(_) => "uint8_t".to_owned(),
    }
}

fn topics(out: &mut String, schema: &Schema) {
    for topic in &schema.topics {
        let row = topic.row;
        let prefix = format!("#define JINK_TOPIC_{}", capitals(row.name));
        let _ = match row.name.strip_suffix('*') {
            Some(family) => writeln!(
                out,
                "\n// One topic per sensor or process: its name comes behind this.\n{prefix}_FAMILY \"{family}\""
            ),
            None => writeln!(out, "\n{prefix}_NAME \"{}\"", row.name),
        };
        let _ = writeln!(out, "{prefix}_TYPE_NAME JINK_{}_TYPE_NAME", capitals(row.payload));
        let _ = writeln!(out, "{prefix}_DEADLINE_MS {:?}", row.deadline_ms);
        let _ = writeln!(out, "{prefix}_BUFFER {}", row.buffer);
        let _ = writeln!(out, "{prefix}_MAX_PUBLISHERS {}", row.max_publishers());
        let _ = writeln!(out, "{prefix}_MAX_SUBSCRIBERS {}", row.max_subscribers());
        let _ = writeln!(out, "{prefix}_WAKES {}", u8::from(row.wakes));
    }
}
