//! The page of each sensor has the table of its set, with the keys of a real device, and the drivers take it as the
//! page says.

use jink_lidar_driver::config::{LidarSpec, SensorTable};
use jink_runtime::config::{Config, sensor_sets};
use std::path::{Path, PathBuf};
use toml::{Table, Value};

const PAGES: [&str; 7] = ["mid360", "os0", "os1", "vlp16", "d435", "sf45", "rplidar"];

fn docs() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs")
}

/// The only TOML block of the page called `name`.
fn block(name: &str) -> (PathBuf, String) {
    let file = docs().join(format!("sensors/{name}.md"));
    let text = std::fs::read_to_string(&file).unwrap();
    let blocks: Vec<&str> = text.split("```toml\n").skip(1).collect();
    assert_eq!(blocks.len(), 1, "{}", file.display());
    let block = blocks[0].split("```").next().unwrap().to_owned();
    (file, block)
}

fn sensors(table: &Table) -> Vec<&Table> {
    let sensors = table["sensor"].as_array().unwrap().iter();
    sensors.map(|sensor| sensor.as_table().unwrap()).collect()
}

#[test]
fn every_table_to_copy_is_that_of_its_set_with_a_device() {
    for name in PAGES {
        let (file, text) = block(name);
        let config = Config::parse(&file, &text).unwrap();
        assert!(config.sensors.iter().all(|sensor| sensor.has_device), "{name}");
        let page: Table = text.parse().unwrap();
        let set: Table = sensor_sets::named(name).unwrap().text.parse().unwrap();
        assert_eq!(page.get("params"), set.get("params"), "{name}");
        let (page, set) = (sensors(&page), sensors(&set));
        assert_eq!(page.len(), set.len(), "{name}");
        for (page, set) in page.iter().zip(set) {
            let mut rest = (*page).clone();
            for (key, value) in set {
                assert_eq!(rest.remove(key).as_ref(), Some(value), "{name}: {key}");
            }
            // What the page has besides is of the device alone.
            let known = ["device", "sensor_address", "model"];
            assert!(
                rest.keys().all(|key| known.contains(&key.as_str())),
                "{name}: {rest}"
            );
        }
    }
}

#[test]
fn the_driver_takes_the_table_of_every_lidar_as_its_page_says() {
    let mut taken = 0;
    for name in PAGES {
        let (_, text) = block(name);
        let page: Table = text.parse().unwrap();
        for sensor in sensors(&page) {
            let kind = sensor["kind"].as_str().unwrap();
            if !kind.starts_with("lidar_") {
                continue;
            }
            let table: SensorTable = Value::Table(sensor.clone()).try_into().unwrap();
            let sensor = sensor["name"].as_str().unwrap();
            if let Err(mistake) = LidarSpec::find(&[table], sensor) {
                panic!("{name}: {mistake}");
            }
            taken += 1;
        }
    }
    assert_eq!(taken, 5);
}

#[test]
fn the_index_lists_every_page_and_every_page_has_a_place_for_measured_speeds() {
    let index = std::fs::read_to_string(docs().join("sensors/README.md")).unwrap();
    for name in PAGES {
        assert!(index.contains(&format!("({name}.md)")), "{name}");
        let page = std::fs::read_to_string(docs().join(format!("sensors/{name}.md"))).unwrap();
        assert_eq!(page.matches("<!-- speeds -->").count(), 1, "{name}");
        for link in page.split("](").skip(1) {
            let target = link.split([')', '#']).next().unwrap();
            assert!(
                docs().join("sensors").join(target).exists(),
                "{name}: {target} is not there"
            );
        }
    }
}
