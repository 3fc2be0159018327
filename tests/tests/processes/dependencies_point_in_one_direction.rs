//! `shared_types <- services/runtime <- services/*`: checked over `cargo metadata`, so that the folder list stays a
//! layering and the heavy crates stay behind one door each.

use serde_json::Value;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Normal and build dependencies by name of every workspace package, with its folder relative to the workspace.
fn packages() -> BTreeMap<String, (String, BTreeSet<String>)> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let output = Command::new(env!("CARGO"))
        .args(["metadata", "--format-version", "1", "--no-deps", "--offline"])
        .current_dir(root)
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap().iter().map(|package| {
        let manifest = Path::new(package["manifest_path"].as_str().unwrap());
        let folder = manifest.parent().unwrap().strip_prefix(root).unwrap();
        let dependencies = package["dependencies"].as_array().unwrap().iter();
        let normal = dependencies
            .filter(|dependency| dependency["kind"].as_str() != Some("dev"))
            .map(|dependency| dependency["name"].as_str().unwrap().to_owned())
            .collect();
        let name = package["name"].as_str().unwrap().to_owned();
        (name, (folder.to_str().unwrap().to_owned(), normal))
    });
    packages.collect()
}

#[test]
fn services_depend_on_the_runtime_and_the_contract_only() {
    let packages = packages();
    let ours = |name: &String| packages.contains_key(name);
    for (name, (_, dependencies)) in &packages {
        let allowed: &[&str] = match name.as_str() {
            "jink-shared-types" | "jink-mavlink-dialect" | "jink-first-flight" => &[],
            "jink-config" => &["jink-shared-types"],
            "jink-runtime" => &["jink-shared-types", "jink-config"],
            // The library of whoever speaks MAVLink.
            "jink-ground-services" | "jink-link-check" => {
                &["jink-shared-types", "jink-runtime", "jink-mavlink-link"]
            }
            // And the answers to ground stations.
            "jink-mavlink-gateway" => &[
                "jink-shared-types",
                "jink-runtime",
                "jink-mavlink-link",
                "jink-ground-services",
            ],
            // The libraries of the simulation: neither emulated autopilot knows the other.
            "jink-simulated-world" => &["jink-shared-types", "jink-runtime"],
            "jink-emulated-autopilot" => &["jink-shared-types", "jink-simulated-world"],
            "jink-emulated-px4" | "jink-emulated-arducopter" => &[
                "jink-shared-types",
                "jink-simulated-world",
                "jink-emulated-autopilot",
            ],
            "jink-emulated-ground-station" => &["jink-shared-types", "jink-emulated-autopilot"],
            "jink-simulator" => &[
                "jink-shared-types",
                "jink-runtime",
                "jink-simulated-world",
                "jink-emulated-autopilot",
                "jink-emulated-px4",
                "jink-emulated-arducopter",
                "jink-emulated-ground-station",
            ],
            "jink-calibration" => &["jink-shared-types", "jink-control"],
            // It shows what the commands show, in their words.
            "jink-viewer" => &["jink-shared-types", "jink-runtime", "jink-control"],
            // All that an aircraft needs is one file. Simulations are never part of it.
            "jink-cli" => &[
                "jink-shared-types",
                "jink-runtime",
                "jink-control",
                "jink-calibration",
                "jink-supervisor",
                "jink-obstacle-fusion",
                "jink-planner",
                "jink-bezier-generator",
                "jink-collision-guard",
                "jink-mavlink-gateway",
                "jink-parameter-server",
                "jink-ground-services",
                "jink-recorder",
                "jink-replay",
                "jink-report",
                "jink-viewer",
                "jink-rangefinder-driver",
                "jink-depth-driver",
                "jink-lidar-driver",
                "jink-link-check",
            ],
            // What reads recordings.
            "jink-replay" => &["jink-shared-types", "jink-runtime", "jink-recorder"],
            "jink-report" => &["jink-shared-types", "jink-control", "jink-recorder"],
            "jink-lab" => &[
                "jink-shared-types",
                "jink-runtime",
                "jink-control",
                "jink-simulator",
            ],
            "jink-tests" | "jink-real-autopilots" | "jink-map-bench" | "jink-transport-bench" => continue,
            // Also built by programs outside of the workspace, with other transports.
            "jink-transport-chain" => &[],
            _ => &["jink-shared-types", "jink-runtime"],
        };
        // Who speaks MAVLink is looked at below.
        let not_mavlink = |dependency: &&String| *dependency != "jink-mavlink-dialect";
        for dependency in dependencies.iter().filter(|one| ours(one)).filter(not_mavlink) {
            assert!(
                allowed.contains(&dependency.as_str()),
                "{name} must not depend on {dependency}"
            );
        }
    }
}

#[test]
fn a_package_is_named_after_its_folder() {
    for (name, (folder, _)) in packages() {
        let last = folder.rsplit('/').next().unwrap().replace('_', "-");
        assert_eq!(name, format!("jink-{last}"));
    }
}

#[test]
fn heavy_crates_stay_behind_one_door() {
    let doors: [(&str, &[&str]); 5] = [
        ("mavlink-core", &["jink-mavlink-dialect"]),
        (
            "jink-mavlink-dialect",
            &[
                "jink-mavlink-link",
                "jink-ground-services",
                "jink-mavlink-gateway",
                "jink-link-check",
                "jink-emulated-autopilot",
                "jink-emulated-px4",
                "jink-emulated-arducopter",
                "jink-emulated-ground-station",
                "jink-simulator",
                "jink-tests",
                "jink-real-autopilots",
            ],
        ),
        // The other one measures it as it comes.
        ("iceoryx2", &["jink-runtime", "jink-transport-bench"]),
        ("svg", &["jink-lab"]),
        ("iceoryx2-bb-elementary-traits", &["jink-shared-types"]),
    ];
    let packages = packages();
    for (heavy, allowed) in doors {
        let users: Vec<_> = packages
            .iter()
            .filter(|(_, (_, dependencies))| dependencies.contains(heavy))
            .map(|(name, _)| name.as_str())
            .collect();
        assert!(
            !users.is_empty(),
            "nobody uses {heavy} any more: update this list"
        );
        for user in users {
            assert!(allowed.contains(&user), "{user} must not depend on {heavy}");
        }
    }
}

#[test]
fn every_program_in_the_topic_table_is_a_folder_of_services() {
    // A planner that users bring.
    let of_users = ["proposer"];
    let folders: BTreeSet<String> = packages()
        .values()
        .map(|(folder, _)| folder.trim_start_matches("services/").to_owned())
        .collect();
    for row in jink_shared_types::topics::TABLE {
        for program in row
            .producers
            .iter()
            .chain(row.consumers)
            .filter(|program| **program != "*")
        {
            assert!(
                folders.contains(*program) || of_users.contains(program),
                "{}: {program}",
                row.name
            );
        }
    }
}
