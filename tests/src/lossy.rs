//! A link that loses, doubles, delays, reorders and damages frames: deterministic, the same for the same seed.
//!
//! | in | out |
//! |---|---|
//! | a frame and the time it was sent ([`Lossy::send`]) | what arrives by a later time ([`Lossy::arrived`]): whole datagrams |

use rand_xoshiro::SplitMix64;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// What may happen to a frame on one way.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct LinkFaults {
    /// Part of the frames that are lost (1).
    pub loss: f64,
    /// Part of the frames that arrive twice (1).
    pub duplication: f64,
    /// Part of the frames in which one bit arrives as the other (1).
    pub corruption: f64,
    /// Time that every frame is on its way (s).
    pub delay_s: f64,
    /// Time that a frame is on its way besides, by lot for each between 0 and this (s): they overtake each other.
    pub reordering_s: f64,
}

/// One direction of such a link.
#[derive(Clone, Debug)]
pub struct Lossy {
    faults: LinkFaults,
    random: SplitMix64,
    under_way: Vec<(f64, Vec<u8>)>,
}

impl Lossy {
    /// With chances drawn from `seed`.
    pub fn new(faults: LinkFaults, seed: u64) -> Self {
        Self {
            faults,
            random: SplitMix64::seed_from_u64(seed),
            under_way: Vec::new(),
        }
    }

    /// A frame is sent at `time_s`.
    pub fn send(&mut self, time_s: f64, frame: &[u8]) {
        if self.chance() < self.faults.loss {
            return;
        }
        let copies = 1 + usize::from(self.chance() < self.faults.duplication);
        for _ in 0..copies {
            let due_s = time_s + self.faults.delay_s + self.chance() * self.faults.reordering_s;
            let mut frame = frame.to_vec();
            if self.chance() < self.faults.corruption {
                let bit = (self.chance() * frame.len() as f64 * 8.0) as usize;
                frame[bit / 8] ^= 1 << (bit % 8);
            }
            self.under_way.push((due_s, frame));
        }
    }

    /// What arrives until `time_s`, in the order of arrival.
    pub fn arrived(&mut self, time_s: f64) -> Vec<Vec<u8>> {
        // Stable: what was sent first arrives first, if nothing else is said.
        self.under_way.sort_by(|a, b| a.0.total_cmp(&b.0));
        let count = self.under_way.partition_point(|(due_s, _)| *due_s <= time_s);
        self.under_way.drain(..count).map(|(_, frame)| frame).collect()
    }

    /// Between 0 and 1, 1 excluded.
    fn chance(&mut self) -> f64 {
        (self.random.next_u64() >> 11) as f64 / (1u64 << 53) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::{LinkFaults, Lossy};

    /// Sends a thousand frames, one each 10 ms; answers what arrived with its time in ms.
    fn arrivals(faults: LinkFaults, seed: u64) -> Vec<(u32, Vec<u8>)> {
        let mut lossy = Lossy::new(faults, seed);
        let mut arrived = Vec::new();
        for ms in 0..12_000u32 {
            let time_s = f64::from(ms) / 1e3;
            if ms.is_multiple_of(10) && ms < 10_000 {
                lossy.send(time_s, &(ms / 10).to_le_bytes());
            }
            arrived.extend(lossy.arrived(time_s).into_iter().map(|frame| (ms, frame)));
        }
        arrived
    }

    fn numbers(arrived: &[(u32, Vec<u8>)]) -> Vec<u32> {
        let number = |frame: &Vec<u8>| u32::from_le_bytes(frame[..].try_into().unwrap());
        arrived.iter().map(|(_, frame)| number(frame)).collect()
    }

    #[test]
    fn without_faults_everything_arrives_at_once_and_in_order() {
        let arrived = arrivals(LinkFaults::default(), 1);
        assert_eq!(numbers(&arrived), (0..1000).collect::<Vec<_>>());
        assert!(arrived.iter().zip(0..).all(|((ms, _), n)| *ms == 10 * n));
    }

    #[test]
    fn each_fault_happens_as_often_as_it_is_asked_for_and_the_same_for_the_same_seed() {
        let none = LinkFaults::default();
        let lost = LinkFaults { loss: 0.2, ..none };
        let count = arrivals(lost, 7).len();
        assert!((760..840).contains(&count), "{count}");
        assert_eq!(arrivals(lost, 7), arrivals(lost, 7));
        assert_ne!(arrivals(lost, 7), arrivals(lost, 8));

        let doubled = LinkFaults {
            duplication: 0.1,
            ..none
        };
        let count = arrivals(doubled, 7).len();
        assert!((1070..1130).contains(&count), "{count}");

        let damaged = LinkFaults {
            corruption: 0.1,
            ..none
        };
        let numbers_damaged = numbers(&arrivals(damaged, 7));
        let count = numbers_damaged.iter().zip(0..).filter(|(n, i)| *n != i).count();
        assert!((70..130).contains(&count), "{count}");

        let late = LinkFaults {
            delay_s: 0.05,
            reordering_s: 0.1,
            ..none
        };
        let arrived = arrivals(late, 7);
        let ways: Vec<_> = arrived
            .iter()
            .zip(numbers(&arrived))
            .map(|((ms, _), n)| ms - 10 * n)
            .collect();
        assert!(arrived.len() == 1000 && ways.iter().all(|ms| (50..=151).contains(ms)));
        assert!(
            numbers(&arrived)
                .windows(2)
                .filter(|pair| pair[0] > pair[1])
                .count()
                > 100
        );
    }
}
