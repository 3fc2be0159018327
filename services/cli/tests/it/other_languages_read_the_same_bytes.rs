//! What `jink schema` prints is compiled by a C compiler and imported by Python: every field of every sample lies
//! where Rust has it.
//!
//! Where there is no `cc`, `c++` or `python3` it is said; `.ci/run` installs them.

use jink_cli::view::schema::Schema;
use jink_testkit::temp_folder::TempFolder;
use std::fmt::Write;
use std::path::Path;
use std::process::Command;

fn all() -> Schema {
    Schema::of(&[]).unwrap()
}

fn printed(flag: &str) -> String {
    output(Command::new(env!("CARGO_BIN_EXE_jink")).args(["schema", flag]))
}

/// Whether `program` can be had here.
fn is_there(program: &str) -> bool {
    let is_there = Command::new(program).arg("--version").output().is_ok();
    if !is_there {
        jink_testkit::not_tested(&format!("there is no {program}"));
    }
    is_there
}

/// What `command` prints; it must succeed.
fn output(command: &mut Command) -> String {
    let output = command.output().unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// `VehicleState` as `vehicle_state`.
fn snake(name: &str) -> String {
    let mut out = String::new();
    for letter in name.chars() {
        if letter.is_ascii_uppercase() && !out.is_empty() {
            out.push('_');
        }
        out.push(letter.to_ascii_lowercase());
    }
    out
}

/// One line per sample and per field as Rust has them: name, offset, size.
fn expected() -> Vec<String> {
    let mut lines = Vec::new();
    for shape in &all().structs {
        lines.push(format!("{} {} {}", shape.name, shape.align, shape.size));
        for field in shape.fields {
            lines.push(format!(
                "{}.{} {} {}",
                shape.name, field.name, field.offset, field.size
            ));
        }
    }
    lines
}

fn assert_same(read: &str, language: &str) {
    let expected = expected();
    let read: Vec<&str> = read.lines().collect();
    assert!(
        expected.len() > 200,
        "{} lines are not every field",
        expected.len()
    );
    assert_eq!(read.len(), expected.len(), "{language}");
    for (read, expected) in read.iter().zip(&expected) {
        assert_eq!(read, expected, "{language}");
    }
}

/// A program that prints what the compiler makes of the header.
fn c_program() -> String {
    let mut program = String::from("#include \"jink.h\"\n#include <stdio.h>\nint main(void) {\n");
    for shape in &all().structs {
        let (name, type_name) = (shape.name, format!("jink_{}_t", snake(shape.name)));
        writeln!(
            program,
            "    printf(\"{name} %zu %zu\\n\", _Alignof({type_name}), sizeof({type_name}));"
        )
        .unwrap();
        for field in shape.fields {
            let member = field.name;
            writeln!(
                program,
                "    printf(\"{name}.{member} %zu %zu\\n\", offsetof({type_name}, {member}), sizeof((({type_name} *)0)->{member}));"
            )
            .unwrap();
        }
    }
    program.push_str("    return 0;\n}\n");
    program
}

fn compile(folder: &Path, compiler: &str, arguments: &[&str]) {
    let mut command = Command::new(compiler);
    output(command.current_dir(folder).args(arguments));
}

#[test]
fn a_c_compiler_finds_every_field_where_rust_has_it() {
    if !is_there("cc") {
        return;
    }
    let folder = TempFolder::new("schema_c");
    folder.write("jink.h", &printed("--c"));
    folder.write("main.c", &c_program());
    compile(
        &folder,
        "cc",
        &[
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-pedantic",
            "-o",
            "main",
            "main.c",
        ],
    );
    let read = output(&mut Command::new(folder.join("main")));
    assert_same(&read, "C");
}

#[test]
fn a_cpp_compiler_takes_the_header_and_finds_the_type_names() {
    if !is_there("c++") {
        return;
    }
    let folder = TempFolder::new("schema_cpp");
    folder.write("jink.h", &printed("--c"));
    let mut program = String::from("#include \"jink.h\"\n#include <string_view>\n");
    for payload in &all().payloads {
        let (name, type_name) = (snake(payload.shape.name), payload.type_name);
        writeln!(
            program,
            "static_assert(std::string_view(jink_{name}_t::IOX2_TYPE_NAME) == \"{type_name}\");"
        )
        .unwrap();
    }
    folder.write("main.cpp", &program);
    compile(
        &folder,
        "c++",
        &[
            "-std=c++17",
            "-Wall",
            "-Wextra",
            "-Werror",
            "-fsyntax-only",
            "main.cpp",
        ],
    );
}

#[test]
fn the_header_names_types_topics_and_codes() {
    let header = printed("--c");
    let schema = all();
    for topic in &schema.topics {
        assert!(
            header.contains(&format!("\"{}\"", topic.payload.type_name)),
            "{}",
            topic.row.name
        );
        assert!(header.contains(&format!("\"{}\"", topic.row.name.trim_end_matches('*'))));
    }
    let ray_kinds = ["UNKNOWN = 0", "HIT = 1", "CLEAR = 2"].map(|code| format!("JINK_RAY_KIND_{code}"));
    for code in ray_kinds {
        assert!(header.contains(&code), "{code}");
    }
    assert!(header.contains("#define JINK_LOCAL_MAP_CELL_M 0.2"));
}

/// Prints what ctypes makes of the module, in the order of the samples that are given.
const PYTHON: &str = r#"
import ctypes, sys
import jink
for name in sys.argv[1:]:
    sample = getattr(jink, name)
    print(name, ctypes.alignment(sample), ctypes.sizeof(sample))
    for field in sample._fields_:
        place = getattr(sample, field[0])
        print(f"{name}.{field[0].rstrip('_')}", place.offset, place.size)
"#;

fn python(folder: &TempFolder) -> Command {
    folder.write("jink.py", &printed("--python"));
    let mut command = Command::new("python3");
    command.current_dir(&**folder).env("PYTHONDONTWRITEBYTECODE", "1");
    command
}

#[test]
fn python_finds_every_field_where_rust_has_it() {
    if !is_there("python3") {
        return;
    }
    let folder = TempFolder::new("schema_python");
    let schema = all();
    let names = schema.structs.iter().map(|shape| shape.name);
    let read = output(python(&folder).args(["-c", PYTHON]).args(names));
    assert_same(&read, "Python");
}

#[test]
fn python_knows_type_names_topics_and_codes() {
    if !is_there("python3") {
        return;
    }
    let folder = TempFolder::new("schema_names");
    let schema = all();
    let mut checks = String::from("import jink\n");
    for payload in &schema.payloads {
        let (name, type_name) = (payload.shape.name, payload.type_name);
        writeln!(checks, "assert jink.{name}.type_name() == '{type_name}'").unwrap();
    }
    for topic in &schema.topics {
        let row = topic.row;
        writeln!(checks, "topic = jink.TOPICS['{}']", row.name).unwrap();
        writeln!(checks, "assert topic.payload is jink.{}, topic", row.payload).unwrap();
        writeln!(
            checks,
            "assert topic.deadline_ms == {:?} and topic.buffer == {}, topic",
            row.deadline_ms, row.buffer
        )
        .unwrap();
    }
    for shape in &schema.enums {
        let codes: Vec<u8> = shape.variants.iter().map(|variant| variant.code).collect();
        writeln!(
            checks,
            "assert [int(code) for code in jink.{}] == {codes:?}",
            shape.name
        )
        .unwrap();
    }
    checks.push_str("assert jink.USER_HEADER is jink.SampleHeader\n");
    output(python(&folder).args(["-c", &checks]));
}

#[test]
fn json_holds_every_topic_sample_and_enum() {
    let json: serde_json::Value = serde_json::from_str(&printed("--json")).unwrap();
    let schema = all();
    let names = |key: &str| -> Vec<String> {
        let all = json[key].as_array().unwrap().iter();
        all.map(|one| one["name"].as_str().unwrap().to_owned()).collect()
    };
    assert_eq!(
        names("topics"),
        schema
            .topics
            .iter()
            .map(|topic| topic.row.name)
            .collect::<Vec<_>>()
    );
    assert_eq!(
        names("samples"),
        schema.structs.iter().map(|shape| shape.name).collect::<Vec<_>>()
    );
    assert_eq!(
        names("enums"),
        schema.enums.iter().map(|shape| shape.name).collect::<Vec<_>>()
    );
    for (sample, shape) in json["samples"].as_array().unwrap().iter().zip(&schema.structs) {
        let end =
            |field: &serde_json::Value| field["offset"].as_u64().unwrap() + field["size"].as_u64().unwrap();
        assert_eq!(
            sample["fields"].as_array().unwrap().last().map(end),
            Some(shape.size as u64)
        );
    }
}
