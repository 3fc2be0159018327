//! Documents that promise a test name one that is there, links lead somewhere, and every parameter that is examined is explained.

use jink_link_check::examined_parameters;
use jink_mavlink_link::profile_name::ProfileName;
use jink_tests::processes::workspace;
use std::path::{Path, PathBuf};

/// Every Rust file below `folder`.
fn rust_files(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let path = entry.path();
        if path.is_dir() {
            rust_files(&path, into);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            into.push(path);
        }
    }
}

/// Every page in docs.
fn pages() -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(workspace().join("docs")).unwrap().flatten();
    let files = entries.map(|entry| entry.path());
    files.filter(|path| path.extension().is_some_and(|extension| extension == "md"))
}

/// Names in backticks that look like tests: several words joined by underscores.
fn promised(text: &str) -> Vec<&str> {
    let quoted = text.split('`').skip(1).step_by(2);
    let is_test = |name: &&str| {
        name.matches('_').count() >= 3
            && name
                .chars()
                .all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
    };
    quoted.filter(is_test).collect()
}

#[test]
fn every_test_that_the_documents_name_is_there() {
    let mut files = Vec::new();
    for folder in ["services", "shared_types", "tests"] {
        rust_files(&workspace().join(folder), &mut files);
    }
    let code: String = files
        .iter()
        .map(|file| std::fs::read_to_string(file).unwrap())
        .collect();
    let mut names = 0;
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        for name in promised(&text) {
            names += 1;
            assert!(
                code.contains(&format!("fn {name}(")),
                "{}: there is no test {name}",
                page.display()
            );
        }
    }
    assert!(names > 40, "only {names} names were found: is the search broken?");
}

#[test]
fn every_file_that_a_document_links_to_is_there() {
    let root = workspace();
    let mut documents = vec![root.join("README.md"), root.join("CONTRIBUTING.md")];
    documents.extend(pages());
    let mut links = 0;
    for document in documents {
        let text = std::fs::read_to_string(&document).unwrap();
        for rest in text.split("](").skip(1) {
            let target = rest.split(&[')', '#'][..]).next().unwrap();
            if target.is_empty() || target.contains("://") {
                continue;
            }
            links += 1;
            let path = document.parent().unwrap().join(target);
            assert!(path.exists(), "{}: {target} is not there", document.display());
        }
    }
    assert!(links > 15, "only {links} links were found: is the search broken?");
}

#[test]
fn every_program_of_the_process_table_is_one_that_an_aircraft_needs_or_not() {
    let table = std::fs::read_to_string(workspace().join("config/services.toml")).unwrap();
    let page = std::fs::read_to_string(workspace().join("docs/programs.md")).unwrap();
    let programs = table.lines().filter_map(|line| line.strip_prefix("program = \""));
    for program in programs.map(|rest| rest.trim_end_matches('"')) {
        assert!(
            page.contains(&format!("`{program}`")),
            "docs/programs.md: {program}"
        );
    }
}

/// What the unit forbids by the judgement of systemd, 0 being all, in tenths.
#[test]
fn the_unit_of_a_flight_computer_forbids_what_jink_does_without() {
    const EXPOSURE_MAX: &str = "--threshold=30";
    let unit = workspace().join("deploy/jink.service");
    let judged = std::process::Command::new("systemd-analyze")
        .args(["security", "--offline=true", "--no-pager", EXPOSURE_MAX])
        .arg(unit)
        .output();
    let said = judged.as_ref().map_or_else(
        |_| String::new(),
        |judged| String::from_utf8_lossy(&judged.stdout).into_owned(),
    );
    let Some(exposure) = said.lines().find(|line| line.contains("exposure level")) else {
        jink_tests::not_tested("a systemd-analyze that judges units without a running systemd");
        return;
    };
    assert!(judged.is_ok_and(|judged| judged.status.success()), "{exposure}");
}

#[test]
fn every_parameter_that_is_examined_is_explained_on_the_page_of_its_autopilot() {
    for (profile, page) in [
        (ProfileName::Px4Trajectory, "connect_px4_trajectory.md"),
        (ProfileName::Px4Offboard, "connect_px4_offboard.md"),
        (ProfileName::Px4Deviation, "connect_px4_deviation.md"),
        (ProfileName::ArdupilotGuided, "connect_ardupilot.md"),
    ] {
        let text = std::fs::read_to_string(workspace().join("docs").join(page)).unwrap();
        for name in examined_parameters(profile) {
            assert!(
                text.contains(&format!("`{name}`")),
                "{page} does not explain {name}"
            );
        }
        assert!(
            text.contains(&format!("profile = \"{}\"", profile.name())),
            "{page}"
        );
    }
}

/// References to tests in backticks: a crate's folder, a file in it without its ending, a function.
fn references(text: &str) -> Vec<(&str, &str, &str)> {
    let quoted = text.split('`').skip(1).step_by(2);
    quoted
        .filter_map(|reference| {
            let (place, function) = reference.split_once("::")?;
            let (folder, file) = place.split_once('/')?;
            Some((folder, file, function))
        })
        .collect()
}

/// Whether `code` holds a test of that name, or flights that campaigns fly.
fn has_test(code: &str, function: &str) -> bool {
    if code.contains(&format!("pub fn {function}() -> Flights {{")) {
        return true;
    }
    let Some(at) = code.find(&format!("fn {function}(")) else {
        return false;
    };
    let before = code[..at].trim_end();
    let attributes = before
        .lines()
        .rev()
        .take_while(|line| line.trim_start().starts_with("#["));
    attributes.into_iter().any(|line| line.trim() == "#[test]")
}

#[test]
fn every_row_of_the_conformance_names_tests_and_every_one_is_where_it_says() {
    let mut files = Vec::new();
    for folder in ["services", "shared_types", "tests"] {
        rust_files(&workspace().join(folder), &mut files);
    }
    let page = std::fs::read_to_string(workspace().join("docs/conformance.md")).unwrap();
    let (mut trajectories, mut prevention) = (0, 0);
    for row in page
        .lines()
        .filter(|line| line.starts_with("| ") && !line.contains("| tests |"))
    {
        let named = references(row);
        assert!(!named.is_empty(), "no test: {row}");
        trajectories += usize::from(row.starts_with("| PP"));
        prevention += usize::from(row.starts_with("| CP"));
        for (folder, file, function) in named {
            let found = files.iter().any(|path| {
                path.file_stem().is_some_and(|stem| stem == file)
                    && path.components().any(|part| part.as_os_str() == folder)
                    && has_test(&std::fs::read_to_string(path).unwrap(), function)
            });
            assert!(found, "there is no test {folder}/{file}::{function}");
        }
    }
    assert_eq!(
        (trajectories, prevention),
        (30, 19),
        "one row for each documented requirement"
    );
}
