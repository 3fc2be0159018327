use foxglove::Decode;
use foxglove::messages::PoseInFrame;
use jink_recorder::{About, Channel, Kept, Recording};
use jink_shared_types::frames::{Attitude, Point, Velocity};
use jink_shared_types::layout::{bytes_of, type_name};
use jink_shared_types::topics::VEHICLE_STATE;
use jink_shared_types::vehicle::VehicleState;
use jink_shared_types::{Flag, SampleHeader, Timestamp};
use nalgebra::UnitQuaternion;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

const BEGIN: Timestamp = Timestamp::from_ns(1_000_000_000);
const UNIX_NS: u64 = 1_800_000_000_000_000_000;
const SAMPLES: u32 = 100;

/// A folder that is removed when the test ends.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("jink_foxglove_{name}_{}", std::process::id()));
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.join(name)
    }

    /// What is in it, by name.
    fn names(&self) -> Vec<String> {
        let entries = std::fs::read_dir(&self.0).unwrap();
        let mut names: Vec<String> = entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

fn publish(sample: u32) -> Timestamp {
    BEGIN.plus_seconds(f64::from(sample) * 0.02)
}

/// A recording of a vehicle that looks east, 1 m north, 2 m east, and climbs.
fn record(path: &Path, type_name: &str) {
    let mut recording =
        Recording::begin(File::create(path).unwrap(), BEGIN, UNIX_NS, &About::default()).unwrap();
    let channel = Channel {
        topic: VEHICLE_STATE.row.name.to_owned(),
        type_name: type_name.to_owned(),
        payload_bytes: size_of::<VehicleState>(),
        schema: "{}".to_owned(),
    };
    recording.add(&channel).unwrap();
    for sample in 0..SAMPLES {
        let state = VehicleState {
            position: Point::new(1.0, 2.0, -f64::from(sample)),
            velocity: Velocity::new(3.0, 4.0, 0.0),
            attitude: Attitude::from_rotation(UnitQuaternion::from_euler_angles(
                0.0,
                0.0,
                90_f64.to_radians(),
            )),
            position_valid: Flag::YES,
            ..VehicleState::default()
        };
        let header = &SampleHeader::at(publish(sample));
        let payload = bytes_of(&state);
        recording
            .write(&Kept {
                channel: 0,
                header,
                payload,
            })
            .unwrap();
    }
    recording.finish().unwrap();
}

fn convert(file: &Path, out: &Path) -> Output {
    Command::new(env!("CARGO_BIN_EXE_jink-foxglove"))
        .arg("convert")
        .arg(file)
        .arg("--out")
        .arg(out)
        .output()
        .unwrap()
}

/// Refused with exit code 1 and one line that says `why`.
fn assert_refused(output: &Output, why: &str) {
    let said = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains(why) && said.lines().count() == 1, "{why}: {said}");
}

#[test]
fn views_have_the_times_of_the_recording_and_the_axes_of_ros() {
    let folder = Folder::new("views");
    let (file, out) = (folder.path("flight.mcap"), folder.path("views.mcap"));
    record(&file, type_name::<VehicleState>());
    let output = convert(&file, &out);
    assert!(output.status.success(), "{output:?}");
    let bytes = std::fs::read(&out).unwrap();
    let messages = mcap::MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    let poses: Vec<_> = messages
        .filter(|message| message.channel.topic == "/vehicle/state")
        .collect();
    assert_eq!(poses.len(), SAMPLES as usize);
    for (sample, message) in (0..SAMPLES).zip(&poses) {
        assert_eq!(message.log_time, UNIX_NS + publish(sample).ns_since(BEGIN));
        let decoded = PoseInFrame::decode(&*message.data).unwrap();
        let pose = decoded.pose.unwrap();
        let (at, turn) = (pose.position.unwrap(), pose.orientation.unwrap());
        assert_eq!(
            (decoded.frame_id.as_str(), [at.x, at.y, at.z]),
            ("map", [2.0, 1.0, f64::from(sample)])
        );
        assert!((turn.w.abs() - 1.0).abs() < 1e-9, "east is no turn: {turn:?}");
    }
    assert_eq!(folder.names(), ["flight.mcap", "views.mcap"]);
}

#[test]
fn what_was_cut_off_is_converted_as_far_as_it_goes() {
    let folder = Folder::new("cut");
    let (file, out) = (folder.path("flight.mcap"), folder.path("views.mcap"));
    record(&file, type_name::<VehicleState>());
    // The end of a file is its index.
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() - 20]).unwrap();
    let output = convert(&file, &out);
    assert!(output.status.success(), "{output:?}");
    assert!(String::from_utf8_lossy(&output.stderr).contains("was cut off"));
    assert!(out.is_file());
}

#[test]
fn what_is_no_recording_leaves_no_file() {
    let folder = Folder::new("refused");
    let (file, out) = (folder.path("flight.mcap"), folder.path("views.mcap"));
    assert_refused(&convert(&file, &out), "No such file");
    std::fs::write(&file, "").unwrap();
    assert_refused(&convert(&file, &out), "the file is empty");
    std::fs::write(&file, "no recording at all").unwrap();
    assert_refused(&convert(&file, &out), "not an MCAP file");
    record(&file, type_name::<VehicleState>());
    let mut bytes = std::fs::read(&file).unwrap();
    // A recording that begins as one does, and has no sample yet.
    std::fs::write(&file, &bytes[..100]).unwrap();
    assert_refused(&convert(&file, &out), "no sample in it can be shown");
    // In the midst of the chunk with the samples.
    let middle = bytes.len() / 3;
    bytes[middle..middle + 64].fill(0x5a);
    std::fs::write(&file, &bytes).unwrap();
    assert_refused(&convert(&file, &out), "damaged");
    record(&file, "jink.VehicleState#0000000000000000");
    assert_refused(&convert(&file, &out), "another layout");
    assert_eq!(folder.names(), ["flight.mcap"]);
}

#[test]
fn nothing_is_overwritten() {
    let folder = Folder::new("kept");
    let (file, out) = (folder.path("flight.mcap"), folder.path("views.mcap"));
    record(&file, type_name::<VehicleState>());
    let recorded = std::fs::read(&file).unwrap();
    assert_refused(&convert(&file, &file), "is there already");
    assert!(convert(&file, &out).status.success());
    // Views are no recording.
    assert_refused(&convert(&out, &folder.path("again.mcap")), "no recording of jink");
    let views = std::fs::read(&out).unwrap();
    assert_refused(&convert(&file, &out), "is there already");
    assert_eq!(std::fs::read(&file).unwrap(), recorded);
    assert_eq!(std::fs::read(&out).unwrap(), views);
    assert_refused(
        &convert(&file, &folder.path("nowhere/views.mcap")),
        "No such file",
    );
    assert_eq!(folder.names(), ["flight.mcap", "views.mcap"]);
}
