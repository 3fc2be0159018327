//! How far the work on a mission item has come.

/// Time without coming nearer in height after which a companion's flight level is accepted (s).
const HEIGHT_PATIENCE_S: f64 = 2.0;
/// Coming nearer by less than this is no progress (m).
const HEIGHT_PROGRESS_M: f64 = 0.02;

/// How the present mission item is being worked on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Work {
    /// Straight up to this down coordinate (m) first.
    Climb(f64),
    /// Level above the landing place first.
    ApproachLanding,
    /// The item itself.
    Item,
}

/// Notices that the vehicle, led by a companion, does not come nearer in height.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct HeightPatience {
    best_m: Option<f64>,
    waited_s: f64,
}

impl HeightPatience {
    /// After a cycle of `dt_s` (s) with `error_m` (m) left.
    pub(super) fn is_exhausted(&mut self, error_m: f64, dt_s: f64) -> bool {
        if self.best_m.is_none_or(|best| error_m < best - HEIGHT_PROGRESS_M) {
            self.best_m = Some(error_m);
            self.waited_s = 0.0;
        }
        self.waited_s += dt_s;
        self.waited_s > HEIGHT_PATIENCE_S
    }
}
