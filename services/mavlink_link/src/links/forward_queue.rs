//! Frames on their way from one link to others, as they came: kept from the reading of one link to the writing of the
//! next.

use crate::router::LinkSet;
use jink_shared_types::link::LINKS;

/// Bytes that are kept at most: as many as a link reads in four turns.
const BYTES: usize = 32_768;
/// Frames that are kept at most: so many heartbeats.
const FRAMES: usize = 1024;

/// The frames.
#[derive(Debug)]
pub(super) struct ForwardQueue {
    bytes: Vec<u8>,
    frames: Vec<(LinkSet, usize)>,
    /// Per link: frames that there was no room for.
    pub(super) lost: [u64; LINKS],
}

impl Default for ForwardQueue {
    fn default() -> Self {
        Self {
            bytes: Vec::with_capacity(BYTES),
            frames: Vec::with_capacity(FRAMES),
            lost: [0; LINKS],
        }
    }
}

impl ForwardQueue {
    /// Keeps a copy of `frame` for the links `to`.
    pub(super) fn add(&mut self, to: LinkSet, frame: &[u8]) {
        if to.is_empty() {
            return;
        }
        if self.frames.len() < FRAMES && self.bytes.len() + frame.len() <= BYTES {
            self.bytes.extend_from_slice(frame);
            self.frames.push((to, frame.len()));
            return;
        }
        for (link, lost) in self.lost.iter_mut().enumerate() {
            *lost += u64::from(to.contains(link as u8));
        }
    }

    /// The frames with where they go, in the order they came.
    pub(super) fn frames(&self) -> impl Iterator<Item = (LinkSet, &[u8])> {
        let mut rest = &self.bytes[..];
        self.frames.iter().map(move |(to, len)| {
            let (frame, behind) = rest.split_at(*len);
            rest = behind;
            (*to, frame)
        })
    }

    pub(super) fn clear(&mut self) {
        self.bytes.clear();
        self.frames.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::{BYTES, FRAMES, ForwardQueue};
    use crate::router::LinkSet;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn frames_come_out_as_they_went_in_and_what_has_no_room_is_counted(
            frames in proptest::collection::vec((0..8u8, 8..280usize), 0..300),
        ) {
            let mut forward_queue = ForwardQueue::default();
            let sets: Vec<_> = frames
                .iter()
                .map(|(bits, len)| {
                    let set = (0..3).filter(|bit| bits >> bit & 1 == 1).fold(LinkSet::default(), LinkSet::with);
                    (set, vec![*bits; *len])
                })
                .collect();
            for (set, frame) in &sets {
                forward_queue.add(*set, frame);
            }
            let kept: Vec<_> = forward_queue.frames().map(|(set, frame)| (set, frame.to_vec())).collect();
            let wanted: Vec<_> = sets.into_iter().filter(|(set, _)| !set.is_empty()).collect();
            let to_link_1 = |some: &[(LinkSet, Vec<u8>)]| some.iter().filter(|(set, _)| set.contains(1)).count() as u64;
            prop_assert_eq!(to_link_1(&kept) + forward_queue.lost[1], to_link_1(&wanted));
            prop_assert!(kept.iter().all(|frame| wanted.contains(frame)));
            prop_assert_eq!(&kept[..kept.len().min(100)], &wanted[..kept.len().min(100)]);
            prop_assert!(forward_queue.bytes.capacity() <= BYTES && forward_queue.frames.capacity() <= FRAMES);
        }
    }
}
