//! Bytes to messages: nothing is lost, nothing is made up, and how the bytes are cut makes no difference.

use super::dice::Dice;
use super::messages;
use jink_mavlink_gateway::{Body, Content, Encoder};
use jink_mavlink_link::frame::{SPLITTER_BYTES, Splitter};

/// The longest frame with the longest header and a signature.
const FRAME_MAX: usize = 1 + 12 + 255 + 2 + 13;

/// A stream, and where intact frames were put into it.
#[derive(Default)]
struct Stream {
    bytes: Vec<u8>,
    intact: Vec<(usize, usize)>,
}

/// A frame that came out: where it was, and whether its checksum was verified.
type Found = (usize, usize, bool);

impl Stream {
    fn of(dice: &mut Dice<'_>) -> Self {
        let mut stream = Self::default();
        while !dice.is_empty() && stream.bytes.len() < 3 * SPLITTER_BYTES {
            let from = (dice.below(4), dice.below(4));
            let len = usize::from(dice.byte());
            match dice.below(8) {
                0..=2 => {
                    let frame = messages::frame(dice.known_id(), from, dice.take(len));
                    stream.intact.push((stream.bytes.len(), frame.len()));
                    stream.bytes.extend(frame);
                }
                3 => {
                    let mut frame = messages::frame(dice.known_id(), from, dice.take(len));
                    let at = usize::from(dice.byte()) % frame.len();
                    frame[at] ^= dice.byte();
                    stream.bytes.extend(frame);
                }
                4 => stream
                    .bytes
                    .extend(messages::frame(dice.u32(), from, dice.take(len))),
                // A false start.
                5 => stream
                    .bytes
                    .extend([dice.pick(&[0xfd, 0xfe]), dice.byte(), dice.below(4), 0]),
                _ => stream.bytes.extend(dice.take(len)),
            }
        }
        // Whatever a false start asked for is there.
        stream.bytes.extend([0; FRAME_MAX]);
        stream
    }

    /// What comes out of it in pieces of sizes that `dice` says.
    fn split(&self, with_unknown: bool, mut piece: impl FnMut() -> usize) -> Vec<Found> {
        let mut splitter = Splitter::new();
        if with_unknown {
            splitter.with_unknown();
        }
        let (mut found, mut at, mut in_frames) = (Vec::new(), 0, 0);
        while at < self.bytes.len() {
            let now = &self.bytes[at..self.bytes.len().min(at + piece().max(1))];
            let taken = splitter.push(now);
            assert!(
                taken == now.len() || taken > 0 && now.len() > SPLITTER_BYTES - 293,
                "of {} bytes {taken} had room",
                now.len()
            );
            at += taken;
            take_all(&mut splitter, &self.bytes, &mut found, &mut in_frames);
            let accounted = splitter.garbage_bytes() as usize + in_frames + splitter.pending();
            assert_eq!(accounted, at, "bytes got lost");
        }
        found
    }
}

fn take_all(splitter: &mut Splitter, stream: &[u8], found: &mut Vec<Found>, in_frames: &mut usize) {
    loop {
        let Some(frame) = splitter.next_frame() else {
            return;
        };
        let (len, is_verified) = (frame.bytes.len(), frame.is_verified);
        let copy = frame.bytes.to_vec();
        understand(&frame);
        *in_frames += len;
        let at = splitter.garbage_bytes() as usize + *in_frames - len;
        assert_eq!(&stream[at..at + len], copy, "a frame that was never sent");
        found.push((at, len, is_verified));
    }
}

/// What a frame says can be said again in the same words.
fn understand(frame: &jink_mavlink_link::frame::MavlinkFrame<'_>) {
    assert!(
        frame
            .signature()
            .is_none_or(|signature| frame.bytes.ends_with(signature))
    );
    if !frame.is_verified {
        return;
    }
    let Some(content) = Content::of(frame) else { return };
    let _target = content.target();
    if let Content::Message(message) = content {
        let say = |message| {
            let mut encoder = Encoder::new();
            encoder.encode(1, 2, &Body::Message(message)).to_vec()
        };
        let said = say(message);
        let mut again = Splitter::new();
        again.load_datagram(&said);
        let received = again.next_frame().expect("what we say is intact");
        let meant = received.decode().expect("what we say is understood");
        assert_eq!(say(meant), said);
    }
}

/// Runs the laws of the decoder.
pub fn laws(data: &[u8]) {
    let mut dice = Dice::new(data);
    let with_unknown = dice.once_in(2);
    let sizes = dice.take(16).to_vec();
    let stream = Stream::of(&mut dice);

    let whole = stream.split(with_unknown, || SPLITTER_BYTES / 2);
    let mut turn = 0;
    let pieces = stream.split(with_unknown, || {
        turn += 1;
        sizes.get(turn % 16).map_or(1, |size| usize::from(*size) + 1)
    });
    assert_eq!(whole, pieces, "how the bytes are cut makes a difference");
    let bytewise = stream.split(with_unknown, || 1);
    assert_eq!(whole, bytewise, "how the bytes are cut makes a difference");
    for (at, len) in &stream.intact {
        let met = whole
            .iter()
            .any(|(found, found_len, _)| *found < at + len && *at < found + found_len);
        assert!(met, "the frame of {len} bytes at {at} was lost");
    }
    datagrams(&stream, &sizes, with_unknown);
}

/// Datagrams have nothing to do with each other.
fn datagrams(stream: &Stream, sizes: &[u8], with_unknown: bool) {
    let fresh = || {
        let mut splitter = Splitter::new();
        if with_unknown {
            splitter.with_unknown();
        }
        splitter
    };
    let mut kept = fresh();
    let mut rest = &stream.bytes[..];
    for size in sizes {
        let (datagram, later) = rest.split_at(rest.len().min(8 * usize::from(*size)));
        rest = later;
        let frames = |splitter: &mut Splitter| {
            let mut frames = Vec::new();
            splitter.load_datagram(datagram);
            while let Some(frame) = splitter.next_frame() {
                frames.push((frame.bytes.to_vec(), frame.is_verified));
            }
            assert_eq!(splitter.pending(), 0, "the rest of a datagram waits for the next");
            frames
        };
        assert_eq!(frames(&mut kept), frames(&mut fresh()));
    }
}
