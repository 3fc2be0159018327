//! One table, key by key.

use super::{CloudSpec, Device, KINDS, LidarSpec, Mistake, NoReturn, Returns, Sector, models_of};
use crate::models::{self, Connection, LidarModel, NetworkProtocol};
use jink_runtime::config::sensor_table::{SensorKeys, number_of};
use jink_shared_types::Point;
use jink_shared_types::ranges::SCAN_BEAMS;
use std::net::IpAddr;
use std::ops::Deref;
use std::path::PathBuf;
use toml::Value;

const KEYS: &[&str] = &[
    "name",
    "kind",
    "model",
    "device",
    "replay",
    "metadata",
    "sensor_address",
    "host_address",
    "control_port",
    "baud",
    "forward_m",
    "right_m",
    "down_m",
    "orientation",
    "yaw_deg",
    "pitch_deg",
    "roll_deg",
    "quaternion",
    "range_min_m",
    "range_max_m",
    "sigma_m",
    "rate_hz",
    "delay_ms",
    "beams",
    "returns",
    "no_return",
    "blind_deg",
    // Declarations for the map.
    "band_up_m",
    "band_down_m",
];
/// What the simulator's lidars have besides.
const SIMULATED: &[&str] = &[
    "seed",
    "sigma_ratio",
    "dropout",
    "rays",
    "rings",
    "fov_horizontal_deg",
    "elevation_min_deg",
    "elevation_max_deg",
    "beam_width_deg",
    "thin_miss",
];
/// Sectors at most.
const SECTORS: usize = 16;

/// One table, with what its errors need.
pub(super) struct Keys<'a>(pub SensorKeys<'a>);

impl<'a> Deref for Keys<'a> {
    type Target = SensorKeys<'a>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl Keys<'_> {
    pub fn spec(&self) -> Result<LidarSpec, Mistake> {
        let kind = self.check_names(&KINDS, "lidar", KEYS, SIMULATED)?;
        // First what does not hang on the model: a wrong one hides nothing else then.
        let offset = |key| self.number(key, 0.0, -5.0..=5.0);
        let position = Point::new(offset("forward_m")?, offset("right_m")?, offset("down_m")?);
        let mounting = self.mounting()?;
        let [sensor_address, host_address] = [self.address("sensor_address")?, self.address("host_address")?];
        let (blind, metadata) = (self.blind()?, self.path("metadata")?);
        let model = self.model(kind)?;
        let device = self.device(model)?;
        self.check_keys(model, &device)?;
        let [min_m, max_m] = self.ranges(model)?;
        let velodyne = matches!(
            model.connection,
            Connection::Network(NetworkProtocol::Velodyne(_))
        );
        let spec = LidarSpec {
            name: self.sensor.to_owned(),
            rate_hz: self.number("rate_hz", model.rate_hz, 2.0..=50.0)?,
            cloud: CloudSpec {
                position,
                mounting,
                range_min_m: min_m as f32,
                range_max_m: max_m as f32,
                sigma_m: self.number("sigma_m", model.sigma_m, 0.0..=10.0)? as f32,
                no_return: self.word(
                    "no_return",
                    &[("unknown", NoReturn::Unknown), ("clear", NoReturn::Clear)],
                )?,
                returns: self.word(
                    "returns",
                    &[
                        ("nearest", Returns::Nearest),
                        ("strongest", Returns::Strongest),
                        ("both", Returns::Both),
                    ],
                )?,
                // Velodyne lists the last return first.
                strongest: u8::from(velodyne),
                blind,
            },
            beams: self.number("beams", f64::from(model.beams), 90.0..=SCAN_BEAMS as f64)? as u32,
            metadata,
            sensor_address,
            host_address,
            control_port: self.number("control_port", 0.0, 1.0..=65_535.0)? as u16,
            model,
            device,
        };
        self.check_set_up(&spec)?;
        Ok(spec)
    }

    fn model(&self, kind: &str) -> Result<&'static LidarModel, Mistake> {
        let value = self.given("model", || models_of(kind))?;
        let model = value.as_str().and_then(models::find);
        let model = model.ok_or_else(|| self.not_possible("model", value, models_of(kind)))?;
        if model.kind() == kind {
            return Ok(model);
        }
        Err(Mistake::ModelOfOtherKind {
            sensor: self.sensor.to_owned(),
            model: model.name,
            kind: model.kind(),
        })
    }

    fn device(&self, model: &LidarModel) -> Result<Device, Mistake> {
        let network = matches!(model.connection, Connection::Network(_));
        let possible = || {
            if network {
                format!(
                    "\"udp:0.0.0.0:{}\", an address of this computer, or \"pcap:/path/file.pcap\"",
                    model.port
                )
            } else {
                "the path of a serial port, e.g. \"/dev/ttyUSB0\"".to_owned()
            }
        };
        let value = self.given("device", possible)?;
        let text = value.as_str().unwrap_or_default();
        let device = if network {
            let udp = text.strip_prefix("udp:").and_then(|address| address.parse().ok());
            let pcap = text.strip_prefix("pcap:").filter(|path| path.starts_with('/'));
            udp.map(Device::Udp).or(pcap.map(|path| Device::Pcap {
                path: path.into(),
                loops: true,
            }))
        } else {
            text.starts_with('/').then(|| Device::Serial {
                path: text.to_owned(),
                baud: model.baud,
            })
        };
        match device.ok_or_else(|| self.not_possible("device", value, possible()))? {
            Device::Pcap { path, .. } => Ok(Device::Pcap {
                path,
                loops: self.word("replay", &[("loop", true), ("once", false)])?,
            }),
            Device::Serial { path, baud } => Ok(Device::Serial {
                path,
                baud: self.number("baud", f64::from(baud), 9_600.0..=4_000_000.0)? as u32,
            }),
            udp @ Device::Udp(_) => Ok(udp),
        }
    }

    /// Keys that only some models or devices have.
    fn check_keys(&self, model: &'static LidarModel, device: &Device) -> Result<(), Mistake> {
        let network = matches!(model.connection, Connection::Network(_));
        let ouster = model.connection == Connection::Network(NetworkProtocol::Ouster);
        let livox = matches!(
            model.connection,
            Connection::Network(NetworkProtocol::Livox1 | NetworkProtocol::Livox2)
        );
        let replays = matches!(device, Device::Pcap { .. });
        let rules: [(&'static str, bool, &'static str); 11] = [
            ("replay", replays, "it is for device = \"pcap:...\""),
            ("metadata", ouster, "ouster has"),
            (
                "sensor_address",
                network && !replays,
                "network lidars at device = \"udp:...\" have",
            ),
            (
                "host_address",
                (ouster || livox) && !replays,
                "ouster and livox models at device = \"udp:...\" have",
            ),
            (
                "control_port",
                (ouster || livox) && !replays,
                "ouster and livox models at device = \"udp:...\" have",
            ),
            ("baud", !network, "serial scanners have"),
            (
                "beams",
                !network || self.table.contains_key("seed"),
                "lidar_2d has",
            ),
            ("returns", network, "network lidars have"),
            ("band_up_m", !network, "lidar_2d has"),
            ("band_down_m", !network, "lidar_2d has"),
            ("no_return", !livox, "all but livox models have"),
        ];
        match rules
            .into_iter()
            .find(|(key, has, _)| !has && self.table.contains_key(*key))
        {
            None => Ok(()),
            Some((key, _, possible)) => Err(Mistake::NotOfThisModel {
                sensor: self.sensor.to_owned(),
                key,
                model: model.name,
                possible: possible.to_owned(),
            }),
        }
    }

    /// An Ouster needs its metadata, from a file or from itself.
    fn check_set_up(&self, spec: &LidarSpec) -> Result<(), Mistake> {
        let ouster = spec.network() == Some(NetworkProtocol::Ouster);
        if !ouster || spec.metadata.is_some() || spec.sensor_address.is_some() {
            return Ok(());
        }
        let possible = "the path of a file made by `curl http://SENSOR/api/v1/sensor/metadata -o FILE`; or give sensor_address, where \
                        the driver asks for them itself";
        Err(self.missing("metadata", possible.to_owned()))
    }

    /// The configured range lies within the device's.
    fn ranges(&self, model: &LidarModel) -> Result<[f64; 2], Mistake> {
        let min_m = self.number("range_min_m", model.range_min_m, 0.0..=10.0)?;
        let max_m = self.number("range_max_m", model.range_max_m, 0.5..=model.range_max_m)?;
        if min_m < max_m {
            return Ok([min_m, max_m]);
        }
        let possible = format!("more than range_min_m = {min_m}, up to {}", model.range_max_m);
        Err(self.not_possible("range_max_m", max_m, possible))
    }

    fn blind(&self) -> Result<Vec<Sector>, Mistake> {
        let Some(value) = self.table.get("blind_deg") else {
            return Ok(Vec::new());
        };
        let sector = |pair: &Value| {
            let [from, to] = pair.as_array()?.as_slice() else {
                return None;
            };
            let angle_rad = |value| {
                number_of(value)
                    .filter(|deg| deg.abs() <= 360.0)
                    .map(|deg| deg.to_radians() as f32)
            };
            Some(Sector {
                from_rad: angle_rad(from)?,
                to_rad: angle_rad(to)?,
            })
        };
        let list = value.as_array().filter(|list| list.len() <= SECTORS);
        let sectors: Option<Vec<Sector>> = list.and_then(|list| list.iter().map(sector).collect());
        sectors.ok_or_else(|| {
            self.not_possible(
                "blind_deg",
                value,
                format!("[[FROM, TO], ...], at most {SECTORS}, -360 to 360, clockwise from the front"),
            )
        })
    }

    fn address(&self, key: &'static str) -> Result<Option<IpAddr>, Mistake> {
        let Some(value) = self.table.get(key) else {
            return Ok(None);
        };
        let address = value.as_str().and_then(|text| text.parse().ok());
        address
            .map(Some)
            .ok_or_else(|| self.not_possible(key, value, "an IP address, e.g. \"192.168.1.150\"".to_owned()))
    }

    fn path(&self, key: &'static str) -> Result<Option<PathBuf>, Mistake> {
        let Some(value) = self.table.get(key) else {
            return Ok(None);
        };
        let path = value.as_str().filter(|path| path.starts_with('/'));
        path.map(|path| Some(path.into()))
            .ok_or_else(|| self.not_possible(key, value, "the whole path of a file".to_owned()))
    }

    /// The meaning of the word given for `key`; the first one stands for none.
    fn word<T: Copy>(&self, key: &'static str, words: &[(&str, T)]) -> Result<T, Mistake> {
        let value = self.table.get(key);
        let found = match value {
            None => words.first(),
            Some(value) => words.iter().find(|(word, _)| value.as_str() == Some(word)),
        };
        found.map(|(_, meaning)| *meaning).ok_or_else(|| {
            let possible: Vec<String> = words.iter().map(|(word, _)| format!("{word:?}")).collect();
            let value = value.map(ToString::to_string).unwrap_or_default();
            self.not_possible(key, value, possible.join(", "))
        })
    }
}
