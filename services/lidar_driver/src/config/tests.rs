use super::{Device, LidarSpec, Mistake, NoReturn, Returns, SensorTable};
use nalgebra::Vector3;

fn tables(text: &str) -> Vec<SensorTable> {
    let file: toml::Table = text.parse().unwrap();
    file["sensor"].clone().try_into().unwrap()
}

fn read_kind(kind: &str, keys: &str) -> Result<LidarSpec, Mistake> {
    let text = format!(
        "[[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\n[[sensor]]\nname = \"top\"\nkind = \"{kind}\"\n{keys}"
    );
    LidarSpec::find(&tables(&text), "top")
}

fn read(keys: &str) -> Result<LidarSpec, Mistake> {
    read_kind("lidar_3d", keys)
}

const PUCK: &str = "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\n";

#[test]
fn model_and_device_are_enough() {
    let spec = read(PUCK).unwrap();
    assert_eq!(spec.device, Device::Udp("0.0.0.0:2368".parse().unwrap()));
    assert_eq!(
        (spec.cloud.range_min_m, spec.cloud.range_max_m, spec.rate_hz),
        (0.5, 100.0, 10.0)
    );
    assert_eq!(
        (spec.cloud.no_return, spec.cloud.returns),
        (NoReturn::Unknown, Returns::Nearest)
    );
    let scanner = read_kind("lidar_2d", "model = \"ld19\"\ndevice = \"/dev/ttyUSB0\"\n").unwrap();
    assert_eq!(
        (scanner.beams, scanner.device),
        (
            360,
            Device::Serial {
                path: "/dev/ttyUSB0".to_owned(),
                baud: 230_400
            }
        )
    );
}

#[test]
fn everything_that_is_given_takes_effect() {
    let spec = read(
        "model = \"ouster\"\ndevice = \"pcap:/tmp/a.pcap\"\nreplay = \"once\"\nmetadata = \"/tmp/a.json\"\nforward_m = 0.1\n\
         orientation = 8\nrange_min_m = 1\nrange_max_m = 30\nsigma_m = 0.1\nrate_hz = 20\nreturns = \"both\"\n\
         no_return = \"clear\"\nblind_deg = [[170, 190], [350, 10]]\ndropout = 0.1\n",
    )
    .unwrap();
    assert_eq!(
        spec.device,
        Device::Pcap {
            path: "/tmp/a.pcap".into(),
            loops: false
        }
    );
    assert!((spec.cloud.mounting.rotation().unwrap() * Vector3::z() + Vector3::z()).norm() < 1e-12);
    assert_eq!(
        (spec.cloud.no_return, spec.cloud.returns),
        (NoReturn::Clear, Returns::Both)
    );
    for (direction, blind) in [
        ([-1.0, 0.0, 0.0], true),
        ([1.0, 0.1, 0.0], true),
        ([1.0, -0.1, 0.5], true),
        ([0.0, 1.0, 0.0], false),
        ([1.0, -0.3, 0.0], false),
    ] {
        assert_eq!(spec.cloud.is_blind(direction), blind, "{direction:?}");
    }
}

#[test]
fn every_mistake_names_the_sensor_the_key_and_what_is_possible() {
    for (keys, said) in [
        (
            "device = \"udp:0.0.0.0:2368\"\n",
            "sensor \"top\": `model` is missing; possible: ouster, ouster_os0, ouster_os1, ouster_os2, vlp16, vlp16_hires, livox_mid360, livox_avia",
        ),
        (
            "model = \"ld06\"\ndevice = \"/dev/ttyS4\"\n",
            "sensor \"top\": a ld06 is of kind = \"lidar_2d\"",
        ),
        (
            "model = \"vlp16\"\n",
            "sensor \"top\": `device` is missing; possible: \"udp:0.0.0.0:2368\", an address of this computer, or \"pcap:/path/file.pcap\"",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:everywhere\"\n",
            "sensor \"top\": device = \"udp:everywhere\" is not possible; possible: \"udp:0.0.0.0:2368\", an address of this computer, or \"pcap:/path/file.pcap\"",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\nreturn = \"both\"\n",
            "sensor \"top\": a lidar has no key `return`; did you mean `returns`?",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\nreturns = \"all\"\n",
            "sensor \"top\": returns = \"all\" is not possible; possible: \"nearest\", \"strongest\", \"both\"",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\nreplay = \"once\"\n",
            "sensor \"top\": a vlp16 has no replay; it is for device = \"pcap:...\"",
        ),
        (
            "model = \"livox_avia\"\ndevice = \"udp:0.0.0.0:60001\"\nno_return = \"clear\"\n",
            "sensor \"top\": a livox_avia has no no_return; all but livox models have",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\nrange_max_m = 120\n",
            "sensor \"top\": range_max_m = 120 is not possible; possible: 0.5 to 100",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\nblind_deg = [170, 190]\n",
            "sensor \"top\": blind_deg = [170, 190] is not possible; possible: [[FROM, TO], ...], at most 16, -360 to 360, clockwise from the front",
        ),
        (
            "model = \"vlp16\"\ndevice = \"udp:0.0.0.0:2368\"\nsensor_address = \"sensor\"\n",
            "sensor \"top\": sensor_address = \"sensor\" is not possible; possible: an IP address, e.g. \"192.168.1.150\"",
        ),
        (
            "model = \"ouster\"\ndevice = \"udp:0.0.0.0:7502\"\n",
            "sensor \"top\": `metadata` is missing; possible: the path of a file made by `curl http://SENSOR/api/v1/sensor/metadata -o FILE`; or give sensor_address, where the driver asks for them itself",
        ),
    ] {
        assert_eq!(read(keys).unwrap_err().to_string(), said);
    }
}

#[test]
fn a_sensor_that_is_not_there_or_of_another_kind_is_reported_as_such() {
    let two = tables(
        "[[sensor]]\nname = \"top\"\nkind = \"lidar_3d\"\n[[sensor]]\nname = \"front\"\nkind = \"rangefinder\"\n",
    );
    let said = |name| LidarSpec::find(&two, name).unwrap_err().to_string();
    assert_eq!(
        said("rear"),
        "there is no sensor \"rear\"; the configuration has top, front"
    );
    assert_eq!(
        said("front"),
        "sensor \"front\" is a rangefinder; this driver is for the kinds lidar_3d, lidar_2d"
    );
}
