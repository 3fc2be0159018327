//! The files in `config/` pass their own checks, and say what the parameter table says.

use jink_runtime::config::Config;
use jink_shared_types::params;
use jink_supervisor::table::ProcessTable;
use std::path::{Path, PathBuf};

fn config() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../config")
}

#[test]
fn every_profile_resolves_and_every_row_is_understood() {
    let profiles: Vec<String> = std::fs::read_dir(config().join("profiles"))
        .unwrap()
        .map(|entry| {
            entry
                .unwrap()
                .path()
                .file_stem()
                .unwrap()
                .to_str()
                .unwrap()
                .to_owned()
        })
        .collect();
    assert!(!profiles.is_empty());
    for profile in &profiles {
        let resolved = Config::resolve(&config(), Some(profile), None, &[]).unwrap();
        assert!(!resolved.config.sensors.is_empty());
    }
    let table = ProcessTable::load(&config()).unwrap();
    assert!(
        table.rows.iter().any(|row| row.rules.is_output),
        "somebody talks to the autopilot"
    );
}

#[test]
fn the_comments_of_the_parameters_give_the_real_defaults() {
    let text = std::fs::read_to_string(config().join("jink.toml")).unwrap();
    for param in params::TABLE {
        let line = text
            .lines()
            .find_map(|line| line.strip_prefix("# ")?.strip_prefix(param.name))
            .unwrap_or_else(|| panic!("{} is not mentioned", param.name));
        let value: f64 = line
            .trim_start()
            .strip_prefix('=')
            .unwrap()
            .split('#')
            .next()
            .unwrap()
            .trim()
            .parse()
            .unwrap();
        assert_eq!(value, param.default, "{}", param.name);
    }
}
