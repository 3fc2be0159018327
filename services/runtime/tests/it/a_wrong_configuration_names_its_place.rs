//! Whatever is in a configuration file: it is read, or refused in one sentence with file and line, and never a panic.

use jink_runtime::config::{self, Config};
use proptest::prelude::*;
use std::path::Path;

/// Every kind of table that the file may have.
const WHOLE: &str = r#"param_store = "/var/lib/jink/p.toml"
[params]
OA_SPD_MAX = 4
OA_VEH_RADIUS = 0.4
[link]
address = "udpin:127.0.0.1:14541"
profile = "auto"
[[link.also]]
name = "ground"
address = "udpin:127.0.0.1:14550"
[[sensor]]
name = "lidar"
kind = "lidar_3d"
rate_hz = 10
delay_ms = 20
[[sensor]]
name = "plane"
kind = "lidar_2d"
band_up_m = 0.5
no_return = "clear"
[[sensor]]
name = "tof"
kind = "user/tof"
output = "scan"
[simulation]
autopilot = "px4"
"#;

/// What refuses says: one line, the file, a line that there is.
fn is_an_answer(text: &str) -> Result<(), TestCaseError> {
    if let Err(error) = Config::parse(Path::new("jink.toml"), text) {
        let reported = error.to_string();
        prop_assert!(reported.starts_with("jink.toml:"), "{}", reported);
        prop_assert!(!reported.contains('\n'), "{}", reported);
        let lines = text.split('\n').count();
        prop_assert!(
            (1..=lines).contains(&error.line),
            "{} of {} lines: {}",
            error.line,
            lines,
            reported
        );
    }
    Ok(())
}

#[test]
fn the_whole_is_read() {
    let config = Config::parse(Path::new("jink.toml"), WHOLE).unwrap();
    assert_eq!(config.sensors.len(), 3);
}

#[test]
fn a_folder_without_a_configuration_is_named() {
    let folder = std::env::temp_dir().join(format!("jink_no_config_{}", std::process::id()));
    let error = Config::load(&folder).unwrap_err();
    let reported = error.to_string();
    assert!(
        reported.contains(&folder.display().to_string()) && reported.contains("jink.toml"),
        "{reported}"
    );
    assert!(reported.contains("cannot be read: "), "{reported}");
    // Whoever asks only for names of processes gets none.
    assert!(config::process_names(&folder).is_empty());
}

#[test]
fn a_file_that_is_no_text_is_refused() {
    let folder = std::env::temp_dir().join(format!("jink_no_text_{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    std::fs::write(folder.join("jink.toml"), [0xff, 0xfe, 0x00]).unwrap();
    let reported = Config::load(&folder).unwrap_err().to_string();
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(reported.contains("jink.toml: cannot be read: "), "{reported}");
}

#[test]
fn the_line_is_that_of_the_mistake_not_of_its_table() {
    for (wrong, line) in [
        ("OA_VEH_RADIUS = 0.4", 4),
        ("profile = \"auto\"", 7),
        ("rate_hz = 10", 14),
        ("no_return = \"clear\"", 20),
        ("output = \"scan\"", 24),
        ("autopilot = \"px4\"", 26),
    ] {
        let (key, _) = wrong.split_once(" = ").unwrap();
        let text = WHOLE.replace(wrong, &format!("{key} = {{}}"));
        let error = Config::parse(Path::new("jink.toml"), &text).unwrap_err();
        assert_eq!(error.line, line, "{wrong}: {error}");
    }
}

proptest! {
    /// A line is left out, doubled, moved, or has a character changed.
    #[test]
    fn a_file_with_a_slip_is_read_or_answered(
        edits in prop::collection::vec((0..4_u8, any::<prop::sample::Index>(), any::<prop::sample::Index>(), any::<char>()), 1..4)
    ) {
        let mut lines: Vec<String> = WHOLE.lines().map(str::to_owned).collect();
        for (how, which, whither, character) in edits {
            let at = which.index(lines.len());
            match how {
                0 if lines.len() > 1 => drop(lines.remove(at)),
                1 => lines.insert(whither.index(lines.len()), lines[at].clone()),
                2 => {
                    let line = lines.remove(at);
                    lines.insert(whither.index(lines.len() + 1), line);
                }
                _ => {
                    let mut characters: Vec<char> = lines[at].chars().collect();
                    match characters.is_empty() {
                        true => characters.push(character),
                        false => {
                            let place = whither.index(characters.len());
                            characters[place] = character;
                        }
                    }
                    lines[at] = characters.into_iter().collect();
                }
            }
        }
        is_an_answer(&lines.join("\n"))?;
    }

    /// No file at all.
    #[test]
    fn no_text_makes_it_panic(text in "(?s).{0,300}") {
        is_an_answer(&text)?;
    }
}
