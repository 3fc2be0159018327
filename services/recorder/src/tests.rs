//! What is written is read again, whatever happens to the file.

use crate::reading::{Ends, Message, ReadError, Reading};
use crate::recording::{About, Channel, Kept, Recording};
use crate::writer::{Batch, WriterThread};
use jink_runtime::file_series::FileSeries;
use jink_shared_types::layout::bytes_of;
use jink_shared_types::{SampleHeader, Timestamp};
use proptest::prelude::*;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::{Path, PathBuf};

const NOW: Timestamp = Timestamp::from_ns(5_000_000_000);
const UNIX_NS: u64 = 1_700_000_000_000_000_000;

fn channel(number: usize) -> Channel {
    Channel {
        topic: format!("some/{number}"),
        type_name: format!("jink.Some#{number:016x}"),
        payload_bytes: 1000,
        schema: "{}".to_owned(),
    }
}

fn header(sequence: u64) -> SampleHeader {
    SampleHeader {
        sequence,
        publish: NOW.plus_seconds(sequence as f64 * 0.01),
        capture: NOW,
        ..SampleHeader::default()
    }
}

/// A sample as it is read again.
type Read = (String, Vec<u8>, Vec<u8>);

fn file_of(samples: &[(usize, Vec<u8>)]) -> Vec<u8> {
    let mut file = Vec::new();
    let about = About {
        facts: BTreeMap::from([("instance".to_owned(), "test".to_owned())]),
        files: BTreeMap::from([("jink.toml".to_owned(), "[params]\n".to_owned())]),
    };
    let mut recording = Recording::begin(Cursor::new(&mut file), NOW, UNIX_NS, &about).unwrap();
    for number in 0..3 {
        recording.add(&channel(number)).unwrap();
    }
    for (sequence, (channel, payload)) in samples.iter().enumerate() {
        let header = &header(sequence as u64);
        let channel = *channel;
        recording
            .write(&Kept {
                channel,
                header,
                payload,
            })
            .unwrap();
        if sequence % 7 == 6 {
            recording.flush().unwrap();
        }
    }
    recording.finish().unwrap();
    file
}

fn written(samples: &[(usize, Vec<u8>)]) -> Vec<Read> {
    let samples = samples.iter().enumerate();
    samples
        .map(|(sequence, (number, payload))| {
            let header = bytes_of(&header(sequence as u64)).to_vec();
            (channel(*number).topic, header, payload.clone())
        })
        .collect()
}

/// What is read of a file with these bytes.
fn read(role: &str, bytes: &[u8]) -> Result<(Vec<Read>, Ends), ReadError> {
    let folder = folder(role);
    std::fs::create_dir_all(&folder).unwrap();
    let path = folder.join("it");
    std::fs::write(&path, bytes).unwrap();
    let all = read_file(&path);
    std::fs::remove_dir_all(&folder).unwrap();
    all
}

fn read_file(path: &Path) -> Result<(Vec<Read>, Ends), ReadError> {
    let reading = Reading::open(path)?;
    let mut all = Vec::new();
    let ends = reading.each(|message| {
        if let Message::Sample(sample) = message {
            let header = bytes_of(sample.header).to_vec();
            all.push((sample.topic.to_owned(), header, sample.payload.to_vec()));
        }
        true
    })?;
    Ok((all, ends))
}

fn samples() -> impl Strategy<Value = Vec<(usize, Vec<u8>)>> {
    let payload = proptest::collection::vec(any::<u8>(), 0..200);
    proptest::collection::vec((0usize..3, payload), 1..60)
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, cases: 64, ..ProptestConfig::default() })]

    #[test]
    fn every_byte_is_read_again_and_of_a_file_that_is_cut_off_what_came_before(
        samples in samples(), cuts in proptest::collection::vec(0.0..1.0f64, 10),
    ) {
        let (file, all) = (file_of(&samples), written(&samples));
        let (again, ends) = read("whole", &file).unwrap();
        prop_assert_eq!(&again, &all);
        prop_assert_eq!(ends, Ends::Whole);
        for cut in cuts {
            let kept = (cut * file.len() as f64) as usize;
            match read("cut", &file[..kept]) {
                Ok((some, ends)) => {
                    prop_assert_eq!(&some[..], &all[..some.len()]);
                    prop_assert_eq!(ends, Ends::CutOff);
                }
                Err(ReadError::Empty(_) | ReadError::Foreign(_)) => prop_assert!(kept < 8, "{kept} bytes"),
                Err(error) => prop_assert!(false, "{kept} of {} bytes: {error}", file.len()),
            }
        }
    }

    #[test]
    fn a_damaged_file_is_no_reason_to_panic(
        samples in samples(), damage in proptest::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..20),
    ) {
        let mut file = file_of(&samples);
        for (place, byte) in damage {
            let place = place.index(file.len());
            file[place] = byte;
        }
        let _whatever_it_says = read("damaged", &file);
    }
}

#[test]
fn what_is_no_recording_is_said_to_be_none() {
    let text = |bytes: &[u8]| {
        let said = read("none", bytes).unwrap_err().to_string();
        said.rsplit_once("/it: ").unwrap().1.to_owned()
    };
    assert_eq!(text(b""), "the file is empty");
    assert_eq!(
        text(b"ULog\x01\x12\x35 and whatever follows in such a file"),
        "not an MCAP file"
    );
    let mut other = Vec::new();
    let options = mcap::WriteOptions::new().profile("ros2");
    options.create(Cursor::new(&mut other)).unwrap().finish().unwrap();
    assert_eq!(
        text(&other),
        "an MCAP file, but no recording of jink (its profile is \"ros2\")"
    );
}

#[test]
fn times_of_the_day_lead_back_to_the_boards_clock() {
    let path = folder("times");
    std::fs::write(&path, file_of(&[])).unwrap();
    let reading = Reading::open(&path).unwrap();
    std::fs::remove_file(&path).unwrap();
    assert_eq!(
        reading.on_boards_clock(UNIX_NS + 1),
        Some(Timestamp::from_ns(NOW.ns + 1))
    );
    assert_eq!(reading.on_boards_clock(1), None);
    assert_eq!(reading.about["instance"], "test");
    assert_eq!(reading.files["jink.toml"], "[params]\n");
}

fn folder(role: &str) -> PathBuf {
    std::env::temp_dir().join(format!("jink_recorder_{role}_{}", std::process::id()))
}

/// The recordings in a folder, oldest first.
fn recordings(folder: &Path) -> Vec<(Vec<Read>, u64)> {
    let mut files: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    // The names of those that were begun in one second are in no order.
    files.sort_by_key(|path| path.metadata().unwrap().modified().unwrap());
    let read = |path: &PathBuf| {
        let reading = Reading::open(path).unwrap();
        let (mut all, mut lost) = (Vec::new(), 0);
        let ends = reading.each(|message| {
            match message {
                Message::Sample(sample) => all.push((
                    sample.topic.to_owned(),
                    bytes_of(sample.header).to_vec(),
                    sample.payload.to_vec(),
                )),
                Message::Lost(_, count) => lost += count,
            }
            true
        });
        assert_eq!(ends.unwrap(), Ends::Whole);
        (all, lost)
    };
    files.iter().map(read).collect()
}

/// Noise: nothing is gained by compressing it.
fn payload(seed: u64) -> Vec<u8> {
    let mut state = 2 * seed + 1;
    let mut byte = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
        (state >> 56) as u8
    };
    (0..4000).map(|_| byte()).collect()
}

fn newest(folder: &Path) -> PathBuf {
    folder.with_extension("newest")
}

#[test]
fn of_a_black_box_what_was_before_and_after_an_event_is_written_and_nothing_else() {
    let folder = folder("black_box");
    let series = FileSeries::new(&folder, "mcap", 1, 0);
    let writer = WriterThread::begin(series, About::default(), newest(&folder), Some(5.0)).unwrap();
    for second in 0..100u64 {
        let mut batch = writer.batch();
        if second % 60 == 0 {
            batch.channels.push(channel(second as usize / 60));
        }
        batch.push(0, &header(second), &payload(second));
        batch.has_event = [50, 53, 80].contains(&second);
        batch.sort(NOW.plus_seconds(second as f64));
        writer.send(batch).unwrap();
    }
    drop(writer);
    assert!(std::fs::read_link(newest(&folder)).is_ok_and(|file| file.is_file()));
    std::fs::remove_file(newest(&folder)).unwrap();
    let files = recordings(&folder);
    std::fs::remove_dir_all(&folder).unwrap();
    let all: Vec<_> = (0..100).map(|second| (0, payload(second))).collect();
    let all = written(&all);
    assert_eq!(files.len(), 2);
    for expected in [&all[45..=58], &all[75..=85]] {
        assert!(files.iter().any(|(samples, _)| samples == expected));
    }
}

#[test]
fn a_file_that_is_full_is_followed_by_another_and_nothing_is_lost_between_them() {
    let folder = folder("rotation");
    let series = FileSeries::new(&folder, "mcap", 1, 20_000_000);
    let writer = WriterThread::begin(series, About::default(), newest(&folder), None).unwrap();
    let mut all = Vec::new();
    for sequence in 0..3000u64 {
        let mut batch = Batch::default();
        if sequence < 2 {
            batch.channels.push(channel(sequence as usize));
        }
        let number = if sequence == 0 { 0 } else { (sequence % 2) as usize };
        batch.push(number, &header(sequence), &payload(sequence));
        batch.sort(NOW);
        all.push((number, payload(sequence)));
        writer.send(batch).unwrap();
    }
    drop(writer);
    let files = recordings(&folder);
    std::fs::remove_dir_all(&folder).unwrap();
    assert!(files.len() >= 3, "{} files", files.len());
    let again: Vec<Read> = files.into_iter().flat_map(|(samples, _)| samples).collect();
    assert!(again == written(&all), "{} of {} samples", again.len(), all.len());
}

#[test]
fn what_the_disk_is_too_slow_for_is_handed_back_and_new_channels_are_not() {
    // Nobody reads: as slow as a disk can be.
    let folder = folder("slow");
    let series = FileSeries::new(&folder, "mcap", 1, 0);
    let writer = WriterThread::begin(series, About::default(), newest(&folder), None).unwrap();
    let huge = || {
        let mut batch = Batch::default();
        batch.push(0, &header(1), &vec![0; 49 << 20]);
        batch
    };
    assert!(writer.send(huge()).is_err());
    let mut with_channel = huge();
    with_channel.channels.push(channel(0));
    assert!(writer.send(with_channel).is_ok());
    drop(writer);
    let files = recordings(&folder);
    std::fs::remove_dir_all(&folder).unwrap();
    assert_eq!(files[0].0.len(), 1);
}

#[test]
fn a_disk_that_is_not_there_yet_is_waited_for() {
    let disk = folder("disk");
    let folder = disk.join("recordings");
    let series = FileSeries::new(&folder, "mcap", 1, 0);
    let writer = WriterThread::begin(series, About::default(), newest(&folder), None).unwrap();
    let mut batch = Batch::default();
    batch.channels.push(channel(0));
    batch.push(0, &header(1), &[1, 2, 3]);
    writer.send(batch).unwrap();
    let begin = std::time::Instant::now();
    while !writer.has_failed() {
        assert!(begin.elapsed().as_secs() < 60);
        std::thread::yield_now();
    }
    // What was lost meanwhile is said.
    std::fs::create_dir(&disk).unwrap();
    while writer.has_failed() {
        assert!(begin.elapsed().as_secs() < 60);
        let mut batch = writer.batch();
        batch.push(0, &header(2), &[4]);
        writer.send(batch).unwrap();
        std::thread::sleep(std::time::Duration::from_millis(100));
    }
    drop(writer);
    let files = recordings(&folder);
    std::fs::remove_dir_all(&disk).unwrap();
    assert!(!files[0].0.is_empty() && files[0].1 > 50, "{} lost", files[0].1);
}
