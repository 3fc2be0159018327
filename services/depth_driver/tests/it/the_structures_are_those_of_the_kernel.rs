//! Request numbers, sizes and offsets agree with `linux/videodev2.h` of this machine, as its C compiler reads it.

use jink_depth_driver::v4l2::{ABI, FIELDS};
use jink_testkit::temp_folder::TempFolder;
use std::fmt::Write as _;
use std::process::Command;

#[test]
fn a_c_compiler_finds_every_number_and_every_field_as_this_driver_has_it() {
    let folder = TempFolder::new("videodev2");
    let mut program =
        "#include <linux/videodev2.h>\n#include <stddef.h>\n#include <stdio.h>\nint main(void) {\n"
            .to_owned();
    let mut expected = String::new();
    for (request, structure, number, size) in ABI {
        writeln!(
            program,
            "printf(\"{request} %lu %zu\\n\", (unsigned long){request}, sizeof({structure}));"
        )
        .unwrap();
        writeln!(expected, "{request} {number} {size}").unwrap();
    }
    for (structure, field, offset) in FIELDS {
        writeln!(
            program,
            "printf(\"{structure}.{field} %zu\\n\", offsetof({structure}, {field}));"
        )
        .unwrap();
        writeln!(expected, "{structure}.{field} {offset}").unwrap();
    }
    program.push_str("return 0;\n}\n");
    folder.write("main.c", &program);
    let compiled = Command::new("cc")
        .current_dir(&*folder)
        .args(["-o", "main", "main.c"])
        .output();
    let has_header = std::path::Path::new("/usr/include/linux/videodev2.h").exists();
    match compiled {
        Ok(compiled) if compiled.status.success() => {
            let read = Command::new(folder.join("main")).output().unwrap();
            assert_eq!(String::from_utf8(read.stdout).unwrap(), expected);
        }
        Ok(compiled) if has_header => panic!("{}", String::from_utf8_lossy(&compiled.stderr)),
        _ => {
            jink_testkit::not_tested(
                "a C compiler and linux/videodev2.h (package linux-libc-dev) are needed",
            );
        }
    }
}
