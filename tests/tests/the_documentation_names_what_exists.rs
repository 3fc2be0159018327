//! Documents that promise a test name one that is there, links lead somewhere, and every parameter that is examined is explained.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic)]

use jink_mavlink_gateway::ProfileName;
use jink_mavlink_gateway::check::examined_parameters;
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
    for entry in std::fs::read_dir(workspace().join("docs")).unwrap().flatten() {
        let text = std::fs::read_to_string(entry.path()).unwrap();
        for name in promised(&text) {
            names += 1;
            assert!(
                code.contains(&format!("fn {name}(")),
                "{}: there is no test {name}",
                entry.path().display()
            );
        }
    }
    assert!(names > 40, "only {names} names were found: is the search broken?");
}

#[test]
fn every_file_that_a_document_links_to_is_there() {
    let root = workspace();
    let mut documents = vec![root.join("README.md"), root.join("CONTRIBUTING.md")];
    let docs = std::fs::read_dir(root.join("docs")).unwrap().flatten();
    documents.extend(docs.map(|entry| entry.path()));
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
fn every_parameter_that_is_examined_is_explained_on_the_page_of_its_autopilot() {
    for (profile, page) in [
        (ProfileName::Px4Trajectory, "connect_px4_trajectory.md"),
        (ProfileName::Px4Offboard, "connect_px4_offboard.md"),
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
