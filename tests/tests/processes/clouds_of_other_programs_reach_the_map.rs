//! Sensors that jink has no driver for publish point clouds by programs of others, in Python and in C++: the map shows what they saw,
//! what stands, what is free in front of it, and what nobody has seen behind it.

use jink_runtime::{Input, Instance, Session};
use jink_shared_types::map::{CELL_M, LocalMap, cell_of};
use jink_shared_types::ranges::{PointCloud, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{LocalNed, Point, topics};
use jink_tests::peers::{CLOUDS, Kit, OUSTER, python_or_say};
use jink_tests::ports::free_udp_port;
use jink_tests::processes::{System, TempFolder, answer, program, programs, until, workspace};
use nalgebra::Vector3;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::process::Command;

const NAME: &str = "eye";

/// A jink around a virtual vehicle in an empty world whose only sensor is that of `program`.
fn with_sensor(role: &str, program: &Path, arguments: &[&str]) -> (System, TempFolder) {
    // The simulator needs a sensor to render: one that looks down.
    let sensor = format!(
        "[[sensor]]\nname = \"{NAME}\"\nkind = \"user/eye\"\noutput = \"cloud\"\n\
         [[sensor]]\nname = \"ground\"\nkind = \"rangefinder\"\npitch_deg = -90\n"
    );
    let folder = TempFolder::with_sensors(&format!("{role}_config"), &sensor);
    let table = std::fs::read_to_string(folder.path().join("services.toml")).unwrap();
    // The imports of an SDK take seconds on a busy machine.
    let row = format!(
        "\n[[process]]\nname = \"user_eye\"\nprogram = {program:?}\narguments = {arguments:?}\n\
         publishes = [\"range/cloud/{NAME}\"]\nshadow = false\nheartbeat_timeout_ms = 2000\nstart_grace_ms = 60000\n"
    );
    folder.write("services.toml", &(table + &row));
    let link = format!("link.address=udpin:127.0.0.1:{}", free_udp_port());
    let settings = [link.as_str(), "simulation.ground_station_port=0"];
    let mut all = vec!["--world", "empty", "--config", folder.text()];
    all.extend(settings.iter().flat_map(|setting| ["--set", *setting]));
    (System::up(role, &all), folder)
}

/// An executable that runs `script` of tests/own_sensor in `kit`; `None`, and said, where the packages cannot be had.
fn python_program(role: &str, kit: &Kit, script: &str) -> Option<(TempFolder, PathBuf)> {
    let python = python_or_say(kit)?;
    let folder = TempFolder::new(role);
    for file in [
        "own_planner/foreign.py",
        "own_sensor/clouds.py",
        &format!("own_sensor/{script}"),
    ] {
        let text = std::fs::read_to_string(workspace().join("tests").join(file)).unwrap();
        folder.write(file.split('/').next_back().unwrap(), &text);
    }
    folder.write(
        "jink.py",
        &answer(&mut program("jink", &["schema", "--python"])).stdout,
    );
    let text = format!(
        "#!/bin/sh\nexec {} {} \"$@\"\n",
        python.display(),
        folder.path().join(script).display()
    );
    let path = folder.write("program", &text);
    std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).unwrap();
    Some((folder, path))
}

/// What is known of the surroundings, of the vehicle and of the sensor.
struct Watch {
    maps: Input<LocalMap>,
    states: Input<VehicleState>,
    clouds: Input<PointCloud>,
}

impl Watch {
    fn of(system: &System) -> Self {
        let instance: Instance = system.instance().parse().unwrap();
        let session = Session::open(&instance, "cli").unwrap();
        Self {
            maps: session.input(topics::LOCAL_MAP, "").unwrap(),
            states: session.input(topics::VEHICLE_STATE, "").unwrap(),
            clouds: session
                .input(topics::RANGE_CLOUD, NAME)
                .unwrap()
                .of_all_producers(),
        }
    }

    /// Hands the newest map, and what takes points of the body to it, to `look`.
    fn look<T>(
        &mut self,
        look: impl FnOnce(&LocalMap, &dyn Fn(Vector3<f64>) -> Point<LocalNed>) -> T,
    ) -> Option<T> {
        let mut state = None;
        self.states.each(|sample| state = Some(*sample.sample));
        let state = state.filter(|state| state.position_valid.is_set())?;
        let rotation = state.attitude.rotation()?;
        let at_m = state.position.vector();
        let now = jink_runtime::now();
        let map = self.maps.latest(now).fresh()?;
        Some(look(&map, &|body_m| Point::from_vector(at_m + rotation * body_m)))
    }
}

/// Whether an obstacle stands within a cell of `point`.
fn stands(map: &LocalMap, point: Point<LocalNed>) -> bool {
    let steps = [-CELL_M, 0.0, CELL_M];
    steps.iter().any(|x| {
        steps.iter().any(|y| {
            steps.iter().any(|z| {
                let near = point.vector() + Vector3::new(*x, *y, *z);
                map.is_occupied(cell_of(Point::from_vector(near)))
            })
        })
    })
}

/// Waits until the map shows the wall 3 m ahead of a camera 0.1 m ahead of the centre, and the post in front of it.
fn until_the_wall_and_the_post_stand(system: &System) {
    let mut watch = Watch::of(system);
    let mut said = String::new();
    until("the wall and the post in the map", || {
        let seen = watch.look(|map, local| {
            let at = |forward_m: f64, right_m: f64| local(Vector3::new(forward_m, right_m, -0.3));
            let wall = [-2.0, -1.4, -0.8, 0.8, 1.4, 2.0].map(|right_m| stands(map, at(3.1, right_m)));
            let post = stands(map, at(2.1, 0.0));
            let free = [0.9, 1.5, 2.2].map(|forward_m| map.is_free(cell_of(at(forward_m, 0.5))));
            // Behind the wall nobody has looked.
            let behind = [4.0, 4.6].map(|forward_m| {
                let cell = cell_of(at(forward_m, 0.8));
                map.is_free(cell) || map.is_occupied(cell)
            });
            said = format!("wall {wall:?}, post {post}, free {free:?}, known behind it {behind:?}");
            wall == [true; 6] && post && free == [true; 3] && behind == [false; 2]
        });
        seen == Some(true)
    });
    println!("{said}");
}

/// The line of its log that says how long it takes.
fn cost(system: &System) -> String {
    let instance: Instance = system.instance().parse().unwrap();
    let mut line = String::new();
    until("its figures", || {
        let text = std::fs::read_to_string(instance.log_folder().join("user_eye.log")).unwrap_or_default();
        line = text
            .lines()
            .rfind(|line| line.contains(" ms"))
            .unwrap_or_default()
            .to_owned();
        !line.is_empty()
    });
    line
}

#[test]
fn a_depth_camera_in_python_is_seen_in_the_map() {
    let Some((_folder, program)) = python_program("clouds_py", &CLOUDS, "own_depth_camera.py") else {
        return;
    };
    let (system, _config) = with_sensor("cloudpy", &program, &[NAME]);
    until_the_wall_and_the_post_stand(&system);
    // The guard, the examination and the commands take it for a sensor like any other.
    let reported = system
        .jink(&["check", "sensors", "--seconds", "2", "--json"])
        .stdout;
    let seen: serde_json::Value = serde_json::from_str(&reported).unwrap();
    let sensor = &seen["sensors"][0];
    assert_eq!(
        (&sensor["name"], &sensor["kind"]),
        (&NAME.into(), &"user/eye".into()),
        "{seen:#}"
    );
    assert!(sensor["samples"].as_u64().unwrap() > 10, "{seen:#}");
    println!("Python: {}", cost(&system));
}

#[test]
#[ignore = "takes its time: cargo process-campaigns"]
fn a_depth_camera_in_cpp_is_seen_in_the_map() {
    let folder = TempFolder::new("clouds_cpp");
    folder.write("jink.h", &answer(&mut program("jink", &["schema", "--c"])).stdout);
    let mut build = Command::new(env!("CARGO"));
    build
        .args(["build", "--quiet", "-p", "jink-own-sensor"])
        .current_dir(workspace());
    if programs().ends_with("release") {
        build.arg("--release");
    }
    let built = answer(&mut build);
    assert_eq!(built.code, Some(0), "{built:?}");
    let client = folder.path().join("own_depth_camera");
    let sources = workspace().join("tests/own_sensor");
    let compiled = answer(
        Command::new("c++")
            .args(["-std=c++17", "-O2", "-Wall", "-Wextra", "-Werror"])
            .arg(sources.join("own_depth_camera.cpp"))
            .args(["-I", folder.text(), "-I"])
            .arg(&sources)
            .arg("-o")
            .arg(&client)
            .arg(programs().join("libjink_own_sensor.a"))
            .args(["-lpthread", "-ldl", "-lm"]),
    );
    assert_eq!(compiled.code, Some(0), "{compiled:?}");
    let (system, _config) = with_sensor("cloudcpp", &client, &[NAME]);
    until_the_wall_and_the_post_stand(&system);
    println!("C++: {}", cost(&system));
}

#[test]
fn an_ouster_read_by_its_own_sdk_is_seen_in_the_map() {
    let recording = workspace().join("../shared/data/ouster_os1_128.pcap");
    if !recording.exists() {
        jink_tests::not_tested("there is no ../shared/data/ouster_os1_128.pcap");
        return;
    }
    let Some((_folder, program)) = python_program("clouds_ouster", &OUSTER, "own_ouster.py") else {
        return;
    };
    let recording = recording.canonicalize().unwrap();
    let (system, _config) = with_sensor("ouster", &program, &[recording.to_str().unwrap(), NAME]);
    let mut watch = Watch::of(&system);
    let mut said = String::new();
    until("the returns of the recording in the map", || {
        let mut hits_m: Vec<Vector3<f64>> = Vec::new();
        let mut points = 0;
        watch.clouds.each(|cloud| {
            points = cloud.sample.points().len();
            hits_m = (cloud.sample.points().iter())
                .filter(|point| point.kind.get() == RayKind::Hit)
                .map(|point| Vector3::new(point.forward_m, point.right_m, point.down_m).cast())
                // Beyond the vehicle itself, within the map's height.
                .filter(|hit_m: &Vector3<f64>| (1.0..7.0).contains(&hit_m.norm()) && hit_m.z.abs() < 2.0)
                .collect();
        });
        watch
            .look(|map, local| {
                let standing = hits_m.iter().filter(|hit_m| stands(map, local(**hit_m))).count();
                said = format!(
                    "{points} points, {} hits within 7 m, {standing} of them in the map",
                    hits_m.len()
                );
                hits_m.len() > 500 && standing * 100 > hits_m.len() * 95
            })
            .unwrap_or(false)
    });
    println!("{said}; {}", cost(&system));
}
