//! "Did you mean": the name that a mistyped one most likely stands for.

use std::fmt;

/// The candidate most similar to `name`, case ignored: the least number of letters to insert, leave out, exchange or swap with
/// their neighbour (optimal string alignment). `None` where even that one differs in more than a third of its letters: a guess
/// would then only mislead.
pub fn nearest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_ascii_lowercase();
    let distance = |candidate: &str| strsim::osa_distance(&name, &candidate.to_ascii_lowercase());
    let (distance, candidate) = candidates
        .map(|candidate| (distance(candidate), candidate))
        .min_by_key(|(distance, _)| *distance)?;
    (3 * distance <= candidate.len().max(3)).then_some(candidate)
}

/// The end of an error text about an unknown name: "; did you mean `NAME`?", or nothing.
#[derive(Clone, Copy, Debug)]
pub struct DidYouMean<'a>(pub Option<&'a str>);

impl fmt::Display for DidYouMean<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            Some(candidate) => write!(f, "; did you mean `{candidate}`?"),
            None => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::{DidYouMean, nearest};
    use proptest::prelude::*;

    const PROCESSES: [&str; 3] = ["planner", "sensors", "mavlink_gateway"];

    fn nearest_process(name: &str) -> Option<&'static str> {
        nearest(name, PROCESSES.into_iter())
    }

    #[test]
    fn what_is_mistyped_is_found_and_what_is_similar_to_nothing_is_not() {
        for (name, meant) in [
            ("planer", Some("planner")),
            ("palnner", Some("planner")),
            ("Sensor", Some("sensors")),
            ("mavlink-gateway", Some("mavlink_gateway")),
            ("nosuch", None),
            ("supervisor", None),
            ("", None),
        ] {
            assert_eq!(nearest_process(name), meant, "{name}");
        }
        assert_eq!(nearest("x", std::iter::empty()), None);
        assert_eq!(
            DidYouMean(Some("planner")).to_string(),
            "; did you mean `planner`?"
        );
        assert_eq!(DidYouMean(None).to_string(), "");
    }

    proptest! {
        #[test]
        fn one_letter_too_many_or_missing_never_hides_a_name(index in 0usize..3, at in 0usize..15, letter in "[a-z]") {
            let name = PROCESSES[index];
            let at = at % name.len();
            prop_assert_eq!(nearest_process(&format!("{}{letter}{}", &name[..at], &name[at..])), Some(name));
            prop_assert_eq!(nearest_process(&format!("{}{}", &name[..at], &name[at + 1..])), Some(name));
        }
    }
}
