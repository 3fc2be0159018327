//! What lies in files and what one gateway sends to the next: damaged, it is refused or used in part, without a crash.

use super::dice::Dice;
use jink_mavlink_gateway::{Encoder, Gateway, GatewayConfig, HandoverState};
use jink_mavlink_link::signing::Key;
use jink_mavlink_link::signing::stamps::{StampKeeper, Stamps, wall};
use jink_mavlink_link::tlog::Tlog;
use jink_shared_types::Timestamp;
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};

/// A stamp has so many bits in a signature.
const STAMP_BITS: u32 = 48;

/// A path of its own.
fn own_path(what: &str) -> PathBuf {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let count = COUNT.fetch_add(1, Ordering::Relaxed);
    std::env::temp_dir().join(format!("jink-laws-{what}-{}-{count}", std::process::id()))
}

/// Runs the laws of what is stored, without touching a disk.
pub fn laws(data: &[u8]) {
    let mut dice = Dice::new(data);
    match dice.below(3) {
        0 => handover(&mut dice),
        1 => key(dice.take(2000)),
        _ => stamps(&mut dice),
    }
}

/// The same with real files: slower.
pub fn laws_of_files(data: &[u8]) {
    let mut dice = Dice::new(data);
    match dice.below(2) {
        0 => stamps_file(dice.take(200)),
        _ => log(&mut dice),
    }
}

fn handover(dice: &mut Dice<'_>) {
    let len = if dice.once_in(4) {
        usize::from(dice.byte())
    } else {
        32
    };
    let bytes = dice.take(len);
    let Some(handover) = HandoverState::of_bytes(bytes) else {
        return;
    };
    assert_eq!(handover.to_bytes()[..], *bytes);
    let now = Timestamp::from_seconds(f64::from(dice.u32()));
    let (mut gateway, mut encoder) = (Gateway::new(GatewayConfig::default()), Encoder::new());
    signs(handover.hand_to(now, &mut gateway, &mut encoder), dice);
}

fn key(content: &[u8]) {
    let key = Key::of_bytes(content);
    assert_eq!(key.is_some(), Key::of_bytes(content).is_some());
    assert!(content.len() != 32 || content.starts_with(b"passphrase:") || key.is_some());
    assert!(!content.is_empty() || key.is_none());
    assert_eq!(
        key.map_or("Key(secret)".to_owned(), |key| format!("{key:?}")),
        "Key(secret)"
    );
}

fn stamps(dice: &mut Dice<'_>) {
    let stored = match dice.below(4) {
        0 => dice.u64(),
        1 => u64::MAX - u64::from(dice.byte()),
        2 => (1 << STAMP_BITS) - u64::from(dice.u32()),
        _ => u64::from(dice.u32()) << 16,
    };
    signs(Stamps::begin(stored), dice);
}

/// Signs for a while: stamps only grow, stay below the bound that is stored, and have room in a signature.
fn signs(mut stamps: Stamps, dice: &mut Dice<'_>) {
    let mut clock = u64::from(dice.u32()) << 14;
    let mut last = None;
    let mut reserved = None;
    for _ in 0..64 {
        match dice.below(8) {
            0 => clock = clock.saturating_add(u64::from(dice.u32())),
            1 => clock = clock.saturating_sub(u64::from(dice.u32())),
            2 => clock = dice.u64(),
            _ => {}
        }
        if let Some(bound) = stamps.wants(clock)
            && !dice.once_in(4)
        {
            stamps.reserved(bound);
            reserved = reserved.max(Some(bound));
        }
        if let Some(stamp) = stamps.take(clock) {
            assert!(last < Some(stamp), "{stamp} after {last:?}");
            assert!(stamp >> STAMP_BITS == 0, "{stamp} has no room in a signature");
            last = Some(stamp);
        }
        if dice.once_in(16) {
            // It passes on, or dies and starts behind what was stored.
            match (dice.once_in(2), reserved) {
                (true, Some(bound)) => stamps = Stamps::begin(bound),
                _ => stamps = Stamps::of_bytes(&stamps.to_bytes()),
            }
        }
    }
}

fn stamps_file(content: &[u8]) {
    let path = own_path("stamps");
    std::fs::write(&path, content).unwrap();
    let opened = StampKeeper::open(&path).and_then(|mut keeper| keeper.begin(wall()).map(|()| keeper));
    match opened {
        Ok(mut keeper) => {
            let first = keeper.take(wall());
            let second = keeper.take(wall());
            if second.is_none() {
                // All stamps are used up.
                assert!(keeper.stamps().next() >= (1 << STAMP_BITS) - 1);
                return std::fs::remove_file(&path).unwrap();
            }
            assert!(first.is_some() && second > first, "{first:?}, {second:?}");
            drop(keeper);
            let mut next = StampKeeper::open(&path).unwrap();
            next.begin(wall()).unwrap();
            let third = next.take(wall());
            assert!(
                third.is_none_or(|third| Some(third) > second),
                "{third:?} after {second:?}"
            );
        }
        Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::InvalidData, "{error}"),
    }
    std::fs::remove_file(&path).unwrap();
}

/// Frames of any length: what fits is in the log, in order, and what does not is counted.
fn log(dice: &mut Dice<'_>) {
    let folder = own_path("tlog");
    let mut log = Tlog::begin(&folder, 1, 0).unwrap();
    let path = log.path().to_owned();
    let (mut expected, mut left_out) = (Vec::new(), 0);
    while !dice.is_empty() {
        let len = usize::from(dice.u16() % 320);
        let mut frame = dice.take(len).to_vec();
        frame.resize(len, 0);
        log.add(&frame);
        match frame.len() {
            0..=300 => expected.push(frame),
            _ => left_out += 1,
        }
    }
    assert_eq!(log.left_out(), left_out);
    drop(log);
    let written = std::fs::read(&path).unwrap();
    std::fs::remove_dir_all(&folder).unwrap();
    let mut rest = &written[..];
    for frame in expected {
        let (_time, behind) = rest.split_at(8);
        let (same, behind) = behind.split_at(frame.len());
        assert_eq!(same, frame);
        rest = behind;
    }
    assert!(rest.is_empty());
}
