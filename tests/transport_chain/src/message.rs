//! What is filled and read: as many words as the real sample has, all of them the same.

/// Writes `mark` into every word of `message`, whose length is a multiple of eight bytes.
pub fn fill(message: &mut [u8], mark: u64) {
    message.as_chunks_mut().0.fill(mark.to_ne_bytes());
}

/// The mark of a message, of which every word is read; `None` if they are not all the same.
pub fn mark_of(message: &[u8]) -> Option<u64> {
    let (words, _) = message.as_chunks();
    let mark = u64::from_ne_bytes(*words.first()?);
    // Without a way out at the first difference, so that it is as fast as memory.
    let difference = words
        .iter()
        .fold(0, |differs, word| differs | (u64::from_ne_bytes(*word) ^ mark));
    (difference == 0).then_some(mark)
}

#[cfg(test)]
mod tests {
    use super::{fill, mark_of};

    #[test]
    fn a_message_is_whole_or_has_no_mark() {
        let mut message = vec![0; 64];
        fill(&mut message, 7);
        assert_eq!(mark_of(&message), Some(7));
        message[63] ^= 1;
        assert_eq!(mark_of(&message), None);
        assert_eq!(mark_of(&[]), None);
    }
}
