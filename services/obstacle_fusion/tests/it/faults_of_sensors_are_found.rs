//! Faults of sensors are found within some frames of a flight with turns, and where there is none, none is reported.

use crate::flights::{FlightPath, FlightResult, SensorSample, fly, fly_until, set};
use jink_lidar_driver::capture::Capture;
use jink_lidar_driver::ouster::Metadata;
use jink_lidar_driver::{CloudAssembler, Decoder, LidarSpec, NetworkLidarDriver};
use jink_obstacle_fusion::{Fusion, FusionConfig};
use jink_runtime::config::sensor_sets;
use jink_shared_types::faults::SensorFault;
use jink_shared_types::frames::{Attitude, Mounting, Point};
use jink_shared_types::params::ParamSet;
use jink_shared_types::ranges::{PointCloud, RangeScan, RayKind};
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Flag, SampleHeader, Timestamp};
use jink_simulated_world::world::{World, WorldKind};
use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use std::net::{IpAddr, Ipv4Addr};
use std::path::{Path, PathBuf};

fn world(name: &str) -> World {
    World::generate(name.parse::<WorldKind>().unwrap(), 1).unwrap()
}

/// Transforms every point of `cloud` by `matrix` about the sensor.
fn transformed_cloud(cloud: &mut PointCloud, matrix: &Matrix3<f64>) {
    let origin = cloud.origin.vector();
    let count = cloud.len as usize;
    for point in &mut cloud.points[..count] {
        if point.kind.get() == RayKind::Unknown {
            continue;
        }
        let end = Vector3::new(point.forward_m, point.right_m, point.down_m).cast::<f64>();
        let end = origin + matrix * (end - origin);
        [point.forward_m, point.right_m, point.down_m] = [end.x, end.y, end.z].map(|part| part as f32);
    }
}

fn turned_scan(scan: &mut RangeScan, turn: &UnitQuaternion<f64>) {
    let body_q_sensor = scan.mounting.rotation().unwrap();
    scan.mounting = Mounting::from_rotation(turn * body_q_sensor);
}

/// A flight of the set called `name` through the forest with `fault` on every frame of its first sensor.
fn flown(name: &str, mut fault: impl FnMut(u64, SensorSample<'_>, &mut SampleHeader) -> u32) -> FlightResult {
    let world = world("forest");
    let path = FlightPath::through(&world);
    fly(&world, &set(name), &path, 16.0, |number, sample, header| {
        fault(number, sample, header)
    })
}

/// The same up to the first finding.
fn flown_until_found(
    name: &str,
    fault: impl FnMut(u64, SensorSample<'_>, &mut SampleHeader) -> u32,
) -> FlightResult {
    let world = world("forest");
    let path = FlightPath::through(&world);
    fly_until(&world, &set(name), &path, 16.0, |found| !found.is_empty(), fault)
}

/// The first fault found of the first sensor, and in which frame.
fn first(flown: &FlightResult) -> Option<(u64, SensorFault, [f64; 2])> {
    let found = flown.findings.first()?;
    assert_eq!(found.1.sensor, 0);
    Some((found.0, found.1.fault, found.1.numbers))
}

#[test]
fn a_clean_flight_of_any_set_through_a_forest_shows_no_fault() {
    shows_no_fault("forest");
}

#[test]
fn a_clean_flight_of_any_set_through_a_corridor_shows_no_fault() {
    shows_no_fault("corridor");
}

fn shows_no_fault(kind: &str) {
    let world = world(kind);
    let path = FlightPath::through(&world);
    let shows_none = |name: &str| {
        let flown = fly(&world, &set(name), &path, 16.0, |_, _, _| 1);
        println!("{name} {kind}: {} frames, {:?}", flown.frames, flown.findings);
        assert!(flown.frames > 50);
        assert_eq!(flown.findings, [], "{name} {kind}");
        assert_eq!(flown.adrift, [], "{name} {kind}");
        assert_eq!(flown.fusion.counters().frames_repeated, 0);
    };
    // The longest test of this binary: every other set in a thread of its own.
    std::thread::scope(|scope| {
        scope.spawn(|| sensor_sets::names().step_by(2).for_each(shows_none));
        sensor_sets::names().skip(1).step_by(2).for_each(shows_none);
    });
}

#[test]
fn a_position_that_runs_off_stops_the_vehicle_within_seconds_and_no_sensor_is_blamed() {
    let world = world("forest");
    for name in ["mid360", "os1", "vlp16"] {
        for off_mps in [[2.0, 0.0, 0.0], [-1.5, 2.5, 0.0], [0.0, -1.2, 0.0]] {
            let mut path = FlightPath::through(&world);
            path.runs_off = (14.0, Vector3::from(off_mps));
            let flown = fly(&world, &set(name), &path, 20.0, |_, _, _| 1);
            println!("{name}, {off_mps:?}: {:?}, {:?}", flown.adrift, flown.findings);
            assert_eq!(flown.findings, [], "{name}, {off_mps:?}");
            assert!(
                matches!(flown.adrift[..], [(noticed_s, true), ..] if (14.0..20.0).contains(&noticed_s)),
                "{name}, {off_mps:?}: {:?}",
                flown.adrift
            );
            let is_adrift = flown.adrift.last().is_some_and(|(_, is_adrift)| *is_adrift);
            assert_eq!(flown.map().ranges_fresh.is_set(), !is_adrift);
        }
    }
}

#[test]
fn a_reset_ends_the_alarm_only_when_the_velocity_is_right_too() {
    const RUNS_OFF_S: f64 = 14.0;
    const RESET_S: f64 = 18.0;
    let world = world("forest");
    let flown = |right_s: f64, off_mps: f64| {
        let mut path = FlightPath::through(&world);
        path.runs_off = (RUNS_OFF_S, Vector3::new(2.0, 0.0, 0.0));
        path.reset = (RESET_S, right_s, Vector3::new(0.0, off_mps, 0.0));
        let flown = fly(&world, &set("mid360"), &path, 25.0, |_, _, _| 1);
        println!("{off_mps} m/s until {right_s} s: {:?}", flown.adrift);
        assert_eq!(flown.findings, []);
        flown.adrift
    };
    for (right_s, off_mps) in [(RESET_S, 0.0), (RESET_S + 3.0, 4.0)] {
        let adrift = flown(right_s, off_mps);
        let [(noticed_s, true), (ended_s, false)] = adrift[..] else {
            panic!("{adrift:?}");
        };
        assert!((RUNS_OFF_S..RESET_S).contains(&noticed_s));
        assert!((right_s..right_s + 3.0).contains(&ended_s), "{ended_s} s");
    }
}

#[test]
fn a_wrong_velocity_alone_stops_the_vehicle_within_two_seconds_and_a_reset_of_2_m_never_does() {
    let world = world("forest");
    for (jump_m, off_mps) in [(2.0, 0.0), (0.0, 2.0)] {
        let mut path = FlightPath::through(&world);
        // Too slowly to be noticed.
        path.runs_off = (2.0, Vector3::new(jump_m / 8.0, 0.0, 0.0));
        path.reset = (10.0, 20.0, Vector3::new(0.0, off_mps, 0.0));
        let flown = fly(&world, &set("mid360"), &path, 14.0, |_, _, _| 1);
        println!("{jump_m} m, {off_mps} m/s: {:?}", flown.adrift);
        let is_wrong = off_mps > 1.0;
        assert_eq!(flown.map().ranges_fresh.is_set(), !is_wrong);
        assert!(match flown.adrift[..] {
            [] => !is_wrong,
            [(noticed_s, true)] => is_wrong && (10.0..12.0).contains(&noticed_s),
            _ => false,
        });
    }
}

#[test]
fn a_fast_flight_with_a_late_estimate_blames_no_sensor() {
    let world = world("forest");
    for name in ["mid360", "os1", "vlp16", "sphere"] {
        let mut path = FlightPath::through(&world);
        (path.speed_mps, path.late_s) = (12.0, 0.06);
        let flown = fly(&world, &set(name), &path, 5.0, |_, _, _| 1);
        println!("{name}: {:?}, {:?}", flown.adrift, flown.findings);
        assert_eq!(
            (&flown.findings[..], &flown.adrift[..]),
            (&[][..], &[][..]),
            "{name}"
        );
    }
}

#[test]
fn a_mirrored_lidar_is_found_within_100_frames_of_a_flight_that_turns() {
    for name in ["mid360", "os0", "os1", "sphere", "vlp16", "rplidar"] {
        let flown = flown_until_found(name, |_, sample, _| {
            match sample {
                SensorSample::Cloud(cloud) => {
                    transformed_cloud(cloud, &Matrix3::from_diagonal(&Vector3::new(1.0, -1.0, 1.0)));
                }
                SensorSample::Scan(scan) => {
                    scan.angle_first_rad = -scan.angle_first_rad;
                    scan.angle_step_rad = -scan.angle_step_rad;
                }
            }
            1
        });
        println!("{name} mirrored: {:?}", flown.findings);
        let found = first(&flown);
        // A fan as high as it is deep looks, mirrored, as if it were mounted upside down.
        let is_found = match found {
            Some((frame, SensorFault::Mirrored, _)) => frame <= 100,
            Some((frame, SensorFault::WrongMounting, [turned_deg, _])) => {
                name == "vlp16" && frame <= 150 && turned_deg == 180.0
            }
            _ => false,
        };
        assert!(is_found, "{name}: {found:?}");
    }
}

#[test]
fn ranges_in_wrong_units_are_found_within_125_frames_and_the_factor_is_reported() {
    for name in ["mid360", "os0", "vlp16", "d435", "rplidar"] {
        for factor in [3.280_84, 0.304_8, 1_000.0, 0.001] {
            let flown = flown_until_found(name, |_, sample, _| {
                match sample {
                    SensorSample::Cloud(cloud) => transformed_cloud(cloud, &(Matrix3::identity() * factor)),
                    SensorSample::Scan(scan) => {
                        for range_m in &mut scan.range_m {
                            *range_m *= factor as f32;
                        }
                    }
                }
                1
            });
            println!("{name} scale {factor}: {:?}", flown.findings);
            let limit = 125;
            let found = first(&flown);
            assert!(
                matches!(found, Some((frame, SensorFault::WrongScale, [said_m, true_m]))
                    if frame <= limit && (said_m / true_m / factor - 1.0).abs() < 0.01),
                "{name} {factor}: {found:?}"
            );
        }
    }
}

#[test]
fn a_sensor_turned_by_30_degrees_is_found_within_150_frames() {
    for name in ["mid360", "os0", "vlp16", "d435", "rplidar"] {
        for axis in [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()] {
            // A fan of 30 degrees that is tilted sees little of what it saw before: there it may take longer, or never
            // be. A Mid-360 that is rolled sees the sky on one side, which does not answer, and the ground on the
            // other; of what a camera that is yawed sees it flies past little.
            if matches!(name, "rplidar" | "vlp16") && axis != Vector3::z_axis()
                || name == "mid360" && axis == Vector3::x_axis()
                || name == "d435" && axis == Vector3::z_axis()
            {
                continue;
            }
            let turn = UnitQuaternion::from_axis_angle(&axis, 30f64.to_radians());
            let flown = flown_until_found(name, |_, sample, _| {
                match sample {
                    SensorSample::Cloud(cloud) => {
                        transformed_cloud(cloud, &Rotation3::from(turn).into_inner());
                    }
                    SensorSample::Scan(scan) => turned_scan(scan, &turn),
                }
                1
            });
            println!("{name} turned about {:?}: {:?}", axis.as_slice(), flown.findings);
            let found = first(&flown);
            let is_found = match found {
                Some((frame, SensorFault::WrongMounting, _)) => frame <= 150,
                // Sixteen rows overlap so little that another cause may fit as well.
                Some((frame, SensorFault::WrongScale, _)) => name == "vlp16" && frame <= 150,
                _ => false,
            };
            assert!(is_found, "{name} {axis:?}: {found:?}");
        }
    }
}

#[test]
fn a_stuck_sensor_opens_no_space_from_its_first_repetition_on_and_expires() {
    const ONSET: u64 = 60;
    for name in ["mid360", "os0", "vlp16", "d435", "rplidar"] {
        let (mut kept_cloud, mut kept_scan) = (PointCloud::boxed(), RangeScan::default());
        let flown = flown(name, |number, sample, header| {
            match sample {
                SensorSample::Cloud(cloud) if number <= ONSET => {
                    kept_cloud.points.copy_from_slice(&cloud.points);
                    kept_cloud.len = cloud.len;
                }
                SensorSample::Cloud(cloud) => {
                    cloud.points.copy_from_slice(&kept_cloud.points);
                    cloud.len = kept_cloud.len;
                    cloud.first_point = header.capture;
                }
                SensorSample::Scan(scan) if number <= ONSET => kept_scan.range_m = scan.range_m,
                SensorSample::Scan(scan) => scan.range_m = kept_scan.range_m,
            }
            1
        });
        println!("{name} stuck: {:?}", flown.findings);
        let found = first(&flown);
        assert!(
            matches!(found, Some((frame, SensorFault::Stuck, _)) if (ONSET + 2..=ONSET + 5).contains(&frame)),
            "{name}: {found:?}"
        );
        let map = flown.map();
        assert!(!map.ranges_fresh.is_set(), "{name}");
        assert_eq!(map.fault_of(0), Some(SensorFault::Stuck));
        let repeated = flown.fusion.counters().frames_repeated;
        // The first of them may come before the vehicle has moved by a decimetre.
        assert!(
            repeated + 2 >= flown.frames - ONSET,
            "{name}: {repeated} of {}",
            flown.frames - ONSET
        );
    }
}

#[test]
fn a_time_that_stands_still_is_found_within_six_frames() {
    const ONSET: u64 = 40;
    let mut kept = SampleHeader::default();
    let flown = flown("os0", |number, _, header| {
        if number <= ONSET {
            kept = *header;
        } else {
            *header = kept;
        }
        1
    });
    let found = first(&flown);
    assert!(
        matches!(found, Some((frame, SensorFault::Stuck, _)) if frame <= ONSET + 6),
        "{found:?}"
    );
    assert!(!flown.map().ranges_fresh.is_set());
}

#[test]
fn too_many_and_too_few_frames_are_found_within_7_seconds_and_reported_with_both_rates() {
    let world = world("forest");
    let path = FlightPath::through(&world);
    let mut specs = set("mid360");
    specs[0].rate_hz = Some(10.0);
    let right = fly(&world, &specs, &path, 9.0, |_, _, _| 1);
    assert_eq!(right.findings, []);
    for (times, expected_hz) in [([2, 2, 2], 20.0), ([0, 0, 1], 3.33)] {
        let flown = fly(&world, &specs, &path, 16.0, |number, _, _| {
            times[number as usize % 3]
        });
        let found = first(&flown);
        println!("rate {times:?}: {:?}", flown.findings);
        assert!(
            matches!(found, Some((frame, SensorFault::WrongRate, [rate_hz, table_hz]))
                if frame <= 80 && (rate_hz / expected_hz - 1.0).abs() < 0.1 && table_hz == 10.0),
            "{times:?}: {found:?}"
        );
    }
}

/// A file of ../shared beside the checkout; reports where there is none.
fn shared(path: &str) -> Option<PathBuf> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let places = ["../../../shared", "../../../../shared"].map(|place| here.join(place).join(path));
    let found = places.into_iter().find(|place| place.is_file());
    if found.is_none() {
        jink_testkit::not_tested(&format!("there is no ../shared/{path}"));
    }
    found
}

/// The scans of the real recording as its driver publishes them, each with its time.
fn recorded() -> Option<Vec<(Timestamp, Box<PointCloud>)>> {
    let (pcap, json) = (
        shared("data/ouster_os1_128.pcap")?,
        shared("data/ouster_os1_128.json")?,
    );
    let metadata = Metadata::parse(&std::fs::read_to_string(json).unwrap()).unwrap();
    let table =
        "name = \"top\"\nkind = \"lidar_3d\"\nmodel = \"ouster\"\ndevice = \"pcap:/x\"\nmetadata = \"/x\"\n";
    let table = table.parse::<toml::Table>().unwrap().into_iter().collect();
    let spec = LidarSpec::find(&[table], "top").unwrap();
    let mut driver = NetworkLidarDriver::new(spec, Some(Decoder::ouster(metadata)));
    let mut capture = Capture::open(&pcap).unwrap();
    let mut scans = Vec::new();
    let mut publish = |assembler: &CloudAssembler| {
        let mut cloud = PointCloud::boxed();
        assembler.write(&mut cloud);
        scans.push((assembler.capture(), cloud));
    };
    let mut last = Timestamp::NEVER;
    while let Some(datagram) = capture.next_datagram().unwrap() {
        last = Timestamp::from_ns(1_000_000_000 + datagram.time_ns % 1_000_000_000_000);
        let sender = IpAddr::V4(Ipv4Addr::LOCALHOST);
        driver.datagram(last, sender, datagram.payload, &mut publish);
    }
    driver.tick(last.plus_seconds(1.0), &mut publish);
    Some(scans)
}

#[test]
fn a_real_recording_shows_no_fault_again_and_again_and_as_one_scan_repeated_it_is_stuck() {
    let Some(scans) = recorded() else {
        return;
    };
    assert!(scans.len() >= 2, "{} scans", scans.len());
    for (repeats_one, expected) in [(false, vec![]), (true, vec![SensorFault::Stuck])] {
        let mut fusion = Fusion::new(FusionConfig::from_params(&ParamSet::default(), 1));
        let mut found = Vec::new();
        for number in 0..40 {
            let now = Timestamp::from_seconds(50.0 + 0.1 * number as f64);
            let state = VehicleState {
                position: Point::new(0.0, 0.0, -2.0),
                attitude: Attitude::from_rotation(UnitQuaternion::identity()),
                position_valid: Flag::YES,
                ..VehicleState::default()
            };
            fusion.vehicle(&state, &SampleHeader::at(now));
            let scan = if repeats_one { 0 } else { number % scans.len() };
            let cloud = &scans[scan].1;
            let mut shown = PointCloud::boxed();
            shown.points[..cloud.len as usize].copy_from_slice(cloud.points());
            shown.len = cloud.len;
            shown.origin = cloud.origin;
            (shown.range_min_m, shown.range_max_m) = (cloud.range_min_m, cloud.range_max_m);
            shown.range_sigma_m = cloud.range_sigma_m;
            shown.first_point = now.plus_seconds(-0.0999);
            fusion.cloud(0, &shown, &SampleHeader::at(now));
            while let Some(finding) = fusion.next_finding() {
                found.push(finding.fault);
            }
        }
        assert_eq!(found, expected);
    }
}
