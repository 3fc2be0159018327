//! Whether a peer's heartbeats still come: silence is noticed after a while, and so is its end.

/// How long a change takes to be believed.
#[derive(Clone, Copy, Debug)]
pub struct Patience {
    /// From the last heartbeat to the loss (us).
    pub loss_us: u64,
    /// From the first heartbeat after a loss to the return (us).
    pub back_us: u64,
}

/// What a check found.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Change {
    /// The peer has fallen silent.
    Lost,
    /// It is back.
    Back,
}

/// One peer. Nobody is missed before he was seen.
#[derive(Clone, Debug, Default)]
pub struct HeartbeatWatch {
    received_us: Option<u64>,
    lost: bool,
    back_since_us: Option<u64>,
}

impl HeartbeatWatch {
    /// A heartbeat came.
    pub fn receive(&mut self, now_us: u64) {
        self.received_us = Some(now_us);
        if self.lost {
            self.back_since_us.get_or_insert(now_us);
        }
    }

    /// Whether the peer counts as lost.
    pub fn is_lost(&self) -> bool {
        self.lost
    }

    /// Looks at the clock.
    pub fn check(&mut self, now_us: u64, patience: &Patience) -> Option<Change> {
        if self.lost {
            let since_us = self.back_since_us?;
            if now_us - since_us < patience.back_us {
                return None;
            }
            self.lost = false;
            self.back_since_us = None;
            return Some(Change::Back);
        }
        if now_us - self.received_us? <= patience.loss_us {
            return None;
        }
        self.lost = true;
        Some(Change::Lost)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn silence_and_its_end_are_noticed_once_each_after_their_time() {
        let patience = Patience {
            loss_us: 6_000_000,
            back_us: 1_000_000,
        };
        let mut watch = HeartbeatWatch::default();
        let mut changes = Vec::new();
        for now_us in (0..40_000_000u64).step_by(4_000) {
            if now_us % 500_000 == 0 && (1_000_000..=5_000_000).contains(&now_us) || now_us >= 20_000_000 {
                watch.receive(now_us);
            }
            changes.extend(watch.check(now_us, &patience).map(|change| (now_us, change)));
        }
        assert_eq!(changes, [(11_004_000, Change::Lost), (21_000_000, Change::Back)]);
    }
}
