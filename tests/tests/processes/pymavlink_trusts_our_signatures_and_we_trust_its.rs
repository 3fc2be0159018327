//! Signatures in both directions against pymavlink: what is signed with the key is taken, once; what was changed, signed
//! with another key, played back, or not signed at all is not.

use jink_mavlink_link::encoder::Encoder;
use jink_mavlink_link::frame::Splitter;
use jink_mavlink_link::message::Body;
use jink_mavlink_link::signing::{Key, SIGNED_FRAME_MAX, SignatureRefusal, Verifier, sign};
use jink_runtime::config::Signing;
use jink_tests::processes::{python_with_pymavlink, workspace};
use mavlink::dialect::{ATTITUDE_DATA, MavMessage};
use serde_json::{Value, json};
use std::io::Write;
use std::process::{Command, Stdio};

const PASSPHRASE: &str = "correct horse battery staple";

fn hex(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

fn unhex(text: &str) -> Vec<u8> {
    let pairs = text.as_bytes().chunks_exact(2);
    let byte = |pair: &[u8]| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap();
    pairs.map(byte).collect()
}

fn signed(n: u32, key: &Key, stamp: u64) -> Vec<u8> {
    let message = MavMessage::ATTITUDE(ATTITUDE_DATA {
        time_boot_ms: n,
        ..ATTITUDE_DATA::default()
    });
    let mut into = [0; SIGNED_FRAME_MAX];
    let mut encoder = Encoder::new();
    let frame = encoder.encode(1, 196, &Body::Message(message));
    sign(frame, key, 3, stamp, &mut into).unwrap().to_vec()
}

#[test]
fn in_both_directions() {
    let python = match python_with_pymavlink() {
        Ok(python) => python,
        Err(missing) => {
            jink_tests::not_tested(&missing);
            return;
        }
    };
    let key = Key::of_bytes(format!("passphrase:{PASSPHRASE}\n").as_bytes()).unwrap();
    let other = Key::of_bytes(b"passphrase:another\n").unwrap();
    let stamp = 10u64.pow(12);
    let mut check: Vec<_> = (0..20).map(|n| signed(n, &key, stamp + u64::from(n))).collect();
    let taken = check.len();
    let mut changed = signed(20, &key, stamp + 20);
    let last = changed.len() - 1;
    changed[last] ^= 1;
    check.push(changed);
    check.push(signed(21, &other, stamp + 21));
    check.push(check[0].clone());
    let mut unsigned = Encoder::new();
    let message = MavMessage::ATTITUDE(ATTITUDE_DATA::default());
    check.push(unsigned.encode(1, 196, &Body::Message(message)).to_vec());

    let mut peer = Command::new(python)
        .arg(workspace().join("tests/peers/signing.py"))
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let frames: Vec<_> = check.iter().map(|frame| hex(frame)).collect();
    let asked = json!({ "passphrase": PASSPHRASE, "check": frames });
    peer.stdin
        .take()
        .unwrap()
        .write_all(asked.to_string().as_bytes())
        .unwrap();
    let output = peer.wait_with_output().unwrap();
    let answer: Value = serde_json::from_slice(&output.stdout).unwrap_or_else(|_| panic!("{output:?}"));

    let accepted: Vec<_> = answer["accepted"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| one == true)
        .collect();
    let wanted: Vec<_> = (0..check.len()).map(|frame| frame < taken).collect();
    assert_eq!(accepted, wanted, "{answer}");

    assert_eq!(
        Key::of_bytes(answer["key"].as_str().unwrap().as_bytes()),
        Some(key.clone())
    );
    let (mut verifier, mut splitter) = (Verifier::default(), Splitter::new());
    let theirs: Vec<_> = answer["signed"]
        .as_array()
        .unwrap()
        .iter()
        .map(|frame| unhex(frame.as_str().unwrap()))
        .collect();
    assert_eq!(theirs.len(), 20);
    let mut verify = |bytes: &[u8], key: &Key| {
        splitter.load_datagram(bytes);
        let frame = splitter.next_frame().unwrap();
        assert_eq!(frame.signature().unwrap()[0], 7, "the link's number");
        verifier.verify(&frame, Signing::Require, Some(key), 0)
    };
    for frame in &theirs {
        assert_eq!(verify(frame, &other), Err(SignatureRefusal::Signature));
        assert_eq!(verify(frame, &key), Ok(()));
        assert_eq!(verify(frame, &key), Err(SignatureRefusal::Replayed));
    }
}
