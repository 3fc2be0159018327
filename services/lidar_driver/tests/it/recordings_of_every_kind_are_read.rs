//! Datagrams come out of a recording whatever wrote it: byte order, time unit, file format, link type, tags, fragments.

use crate::common::{ethernet, ipv4, pcap, pcapng, pcapng_of_interfaces};
use crate::encoder::ouster_metadata;
use jink_lidar_driver::capture::Capture;
use jink_lidar_driver::dump::{DumpRequest, dump};
use jink_lidar_driver::ouster::Metadata;
use jink_testkit::temp_folder::TempFolder;
use std::path::Path;

/// Times and payloads of a recording.
fn read(path: &Path) -> Vec<(u64, Vec<u8>)> {
    let mut capture = Capture::open(path).unwrap();
    let mut datagrams = Vec::new();
    while let Some(datagram) = capture.next_datagram().unwrap() {
        assert_eq!(datagram.address.destination.port(), 7502);
        assert_eq!(datagram.address.source.to_string(), "192.168.1.201:2368");
        datagrams.push((datagram.time_ns, datagram.payload.to_vec()));
    }
    datagrams
}

fn payload(number: usize) -> Vec<u8> {
    (0..3_000 + number)
        .map(|index| (index * 7 + number) as u8)
        .collect()
}

const BEGIN_NS: u64 = 1_700_000_000_123_456_000;

/// Five datagrams in fragments, a millisecond apart.
fn frames(link_header: Header<'_>) -> Vec<(u64, Vec<u8>)> {
    let packets = (0..5usize).flat_map(|number| {
        let time_ns = BEGIN_NS + number as u64 * 1_000_000;
        let fragments = ipv4(&payload(number), 7502, number as u16, 1_480);
        fragments.into_iter().map(move |ip| (time_ns, ip))
    });
    packets.map(|(time_ns, ip)| (time_ns, link_header(&ip))).collect()
}

#[test]
fn both_byte_orders_both_time_units_and_the_newer_format_say_the_same() {
    let folder = TempFolder::new("formats");
    let frames = frames(&|ip| ethernet(ip, 0));
    let expected: Vec<(u64, Vec<u8>)> = (0..5)
        .map(|number| (BEGIN_NS + number as u64 * 1_000_000, payload(number)))
        .collect();
    for (name, bytes) in [
        ("le_us", pcap(false, false, 1, &frames)),
        ("be_us", pcap(true, false, 1, &frames)),
        ("le_ns", pcap(false, true, 1, &frames)),
        ("be_ns", pcap(true, true, 1, &frames)),
        ("ng_us", pcapng(6, 1, &frames)),
        ("ng_ns", pcapng(9, 1, &frames)),
    ] {
        let path = folder.join(name);
        std::fs::write(&path, bytes).unwrap();
        assert_eq!(read(&path), expected, "{name}");
    }
}

/// Puts the header of a link before an IP packet.
type Header<'a> = &'a dyn Fn(&[u8]) -> Vec<u8>;

#[test]
fn every_link_type_that_carries_ip_is_known() {
    let folder = TempFolder::new("links");
    let sll = |ip: &[u8]| [&[0, 0, 0, 1, 0, 6, 1, 2, 3, 4, 5, 6, 0, 0, 8, 0], ip].concat();
    let sll2 = |ip: &[u8]| {
        let head: &[u8] = &[8, 0, 0, 0, 0, 0, 0, 2, 0, 1, 0, 6, 1, 2, 3, 4, 5, 6, 0, 0];
        [head, ip].concat()
    };
    let links: [(u32, Header<'_>); 7] = [
        (1, &|ip| ethernet(ip, 1)),
        (1, &|ip| ethernet(ip, 2)),
        (0, &|ip| [&[2, 0, 0, 0], ip].concat()),
        (101, &<[u8]>::to_vec),
        (228, &<[u8]>::to_vec),
        (113, &sll),
        (276, &sll2),
    ];
    for (link, header) in links {
        let path = folder.join(format!("link_{link}"));
        std::fs::write(&path, pcap(false, false, link, &frames(header))).unwrap();
        let payloads: Vec<Vec<u8>> = read(&path).into_iter().map(|(_, payload)| payload).collect();
        assert_eq!(
            payloads,
            (0..5).map(payload).collect::<Vec<_>>(),
            "link type {link}"
        );
    }
}

#[test]
fn fragments_in_any_order_make_the_datagram_and_a_missing_one_makes_none() {
    let folder = TempFolder::new("fragments");
    let mut frames = frames(&|ip| ethernet(ip, 0));
    frames.swap(0, 2);
    frames.remove(4);
    let path = folder.join("swapped");
    std::fs::write(&path, pcap(false, false, 1, &frames)).unwrap();
    let lengths: Vec<usize> = read(&path).iter().map(|(_, payload)| payload.len()).collect();
    assert_eq!(lengths, [3_000, 3_002, 3_003, 3_004]);
}

#[test]
fn a_file_that_was_cut_off_ends_where_it_was_cut_and_one_that_is_none_is_reported_as_such() {
    let folder = TempFolder::new("cut");
    let bytes = pcap(false, false, 1, &frames(&|ip| ethernet(ip, 0)));
    let path = folder.join("cut");
    for length in [0, 1, 10, 24, 30, 100, 5_000, bytes.len() - 1] {
        std::fs::write(&path, &bytes[..length]).unwrap();
        match Capture::open(&path) {
            Err(error) => assert!(
                length < 24 && error.to_string().ends_with("neither a pcap nor a pcapng file"),
                "{length}: {error}"
            ),
            Ok(_) => assert!(read(&path).len() < 5),
        }
    }
    std::fs::write(&path, pcap(false, false, 105, &[(BEGIN_NS, vec![0; 60])])).unwrap();
    let mut capture = Capture::open(&path).unwrap();
    let said = capture.next_datagram().unwrap_err().to_string();
    assert!(said.contains("link type 105 is not supported"), "{said}");
}

#[test]
fn what_is_foreign_in_a_recording_is_passed_over_and_counted() {
    let folder = TempFolder::new("foreign");
    let path = folder.join("file");
    let ours = frames(&|ip| ethernet(ip, 0));
    // Link type 239 is that of the kernel's packet filter.
    let mixed = ours
        .iter()
        .flat_map(|(time_ns, frame)| [(0, *time_ns, vec![7; 90]), (1, *time_ns, frame.clone())]);
    let mixed: Vec<(u32, u64, Vec<u8>)> = mixed.collect();
    let bytes = pcapng_of_interfaces(6, &[239, 1], &mixed);
    std::fs::write(&path, &bytes).unwrap();
    let payloads: Vec<Vec<u8>> = read(&path).into_iter().map(|(_, payload)| payload).collect();
    assert_eq!(payloads, (0..5).map(payload).collect::<Vec<_>>());
    let skipped = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let mut capture = Capture::open(&path).unwrap();
        while capture.next_datagram().unwrap().is_some() {}
        capture.skipped().to_string()
    };
    assert_eq!(
        skipped(&bytes),
        format!("0 no UDP, {} of links without IP", ours.len())
    );
    let cut = skipped(&bytes[..bytes.len() - 30]);
    assert!(cut.ends_with(", the file ends within a packet"), "{cut}");
    // As a snap length leaves them: the header says how long the packet was.
    let mut short = pcap(false, false, 1, &[(BEGIN_NS, ours[0].1[..60].to_vec())]);
    short[36..40].copy_from_slice(&1_500u32.to_le_bytes());
    let short = skipped(&short);
    assert!(short.starts_with("0 no UDP, 1 recorded in part only"), "{short}");
}

#[test]
fn a_recording_without_a_lidar_is_refused_and_leaves_no_table() {
    let folder = TempFolder::new("no_table");
    let request = DumpRequest {
        pcap: folder.join("file"),
        csv: folder.join("table.csv"),
        ..DumpRequest::default()
    };
    let hello: Vec<(u64, Vec<u8>)> = ipv4(b"hello", 7502, 1, 1_480)
        .into_iter()
        .map(|ip| (BEGIN_NS, ethernet(&ip, 0)))
        .collect();
    std::fs::write(&request.pcap, pcap(false, false, 1, &hello)).unwrap();
    let error = dump(&request, &mut |_, _| {}).unwrap_err().to_string();
    assert!(
        error.contains("none of 1 datagrams is a packet of a known lidar"),
        "{error}"
    );
    assert!(!request.csv.exists());
}

#[test]
fn metadata_are_read_as_editors_of_windows_save_them() {
    let text = ouster_metadata(16, 512, "RNG19_RFL8_SIG16_NIR16");
    let of_windows = format!("\u{feff}{}", text.replace('\n', "\r\n"));
    assert_eq!(Metadata::parse(&of_windows), Metadata::parse(&text));
    assert!(Metadata::parse(&text).is_ok());
}

#[test]
fn damaged_files_are_read_without_a_panic() {
    let folder = TempFolder::new("damaged");
    let path = folder.join("file");
    let mut state = 88172645463325252u64;
    let mut random = move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state
    };
    for bytes in [
        pcap(false, false, 1, &frames(&|ip| ethernet(ip, 1))),
        pcapng(6, 1, &frames(&|ip| ethernet(ip, 0))),
    ] {
        for _ in 0..300 {
            let mut bytes = bytes.clone();
            for _ in 0..20 {
                let at = random() as usize % bytes.len();
                bytes[at] = random() as u8;
            }
            std::fs::write(&path, &bytes).unwrap();
            if let Ok(mut capture) = Capture::open(&path) {
                while let Ok(Some(_)) = capture.next_datagram() {}
            }
        }
    }
}
