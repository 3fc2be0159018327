//! The laws of [`harness`] under bytes of a seeded generator: the same stories at every run, some seconds of them.
//!
//! `JINK_FUZZ_SECONDS` runs further stories for so many seconds per book of laws. Targets that look for new stories by
//! themselves are in `fuzz/`.

use crate::harness;
use rand::{Rng, RngExt, SeedableRng};
use rand_xoshiro::Xoshiro256PlusPlus;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind};
use std::time::{Duration, Instant};

/// Bytes of the longest story.
const LONGEST: usize = 6000;

/// Generates stories: random sequences of bytes.
struct Generator(Xoshiro256PlusPlus);

impl Generator {
    /// Short stories are as likely as long ones.
    fn story(&mut self, longest: usize) -> Vec<u8> {
        let len = (longest >> self.0.random_range(0..8)).max(1);
        let mut story = vec![0; self.0.random_range(1..=len)];
        self.0.fill_bytes(&mut story);
        story
    }

    /// A story like `before`, with some bytes changed, left out or repeated.
    fn variation(&mut self, before: &[u8]) -> Vec<u8> {
        let mut story = before.to_vec();
        for _ in 0..self.0.random_range(1..=8) {
            let at = self.0.random_range(0..story.len());
            match self.0.random_range(0..4) {
                0 => story[at] = self.0.random(),
                1 => story[at] ^= 1 << self.0.random_range(0..8),
                2 if story.len() > 1 => drop(story.remove(at)),
                _ => {
                    let again = story[at..story.len().min(at + 16)].to_vec();
                    story.splice(at..at, again);
                }
            }
        }
        story
    }
}

/// Runs `stories` random sequences, or as many as there is time for, and names the one that breaks a law.
fn run_stories(book: &str, stories: u64, longest: usize, laws: fn(&[u8])) {
    let began = Instant::now();
    let seconds_given = std::env::var("JINK_FUZZ_SECONDS").ok();
    let patience =
        seconds_given.map(|seconds| Duration::from_secs_f64(seconds.parse().expect("a number of seconds")));
    let mut generator = Generator(Xoshiro256PlusPlus::seed_from_u64(1));
    let (mut count, mut bytes) = (0, 0);
    let mut story = Vec::new();
    while count < stories || patience.is_some_and(|patience| began.elapsed() < patience) {
        story = match count % 2 {
            0 => generator.story(longest),
            _ => generator.variation(&story),
        };
        if let Err(cause) = catch_unwind(AssertUnwindSafe(|| laws(&story))) {
            let hex: String = story.iter().map(|byte| format!("{byte:02x}")).collect();
            eprintln!(
                "{book}: story {count} of {} bytes breaks a law: {hex}",
                story.len()
            );
            resume_unwind(cause);
        }
        count += 1;
        bytes += story.len();
    }
    let seconds = began.elapsed().as_secs_f64();
    println!(
        "{book}: {count} executions of {bytes} bytes in {seconds:.1} s, {:.0} per second",
        count as f64 / seconds
    );
}

#[test]
fn every_intact_frame_comes_out_however_the_bytes_are_cut() {
    run_stories("decoder", 30_000, LONGEST, harness::decoder::laws);
}

#[test]
fn what_is_sent_may_be_flown_and_it_never_falls_silent() {
    run_stories("flight", 8000, LONGEST, harness::flight::laws);
}

#[test]
fn what_comes_in_goes_where_the_rules_say_and_nowhere_else() {
    run_stories("network", 8000, 2000, harness::network::laws);
}

#[test]
fn whatever_is_asked_is_answered_once_and_changes_nothing_it_should_not() {
    run_stories("requests", 3000, 2000, harness::requests::laws);
}

#[test]
fn damaged_batons_keys_and_stamps_are_refused_or_made_the_best_of() {
    run_stories("storage", 100_000, 600, harness::storage::laws);
    run_stories("files", 500, 2000, harness::storage::laws_of_files);
}
