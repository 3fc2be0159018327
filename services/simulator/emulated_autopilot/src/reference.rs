//! The motions on which tracking and stopping of autopilots are measured, real and emulated ones alike.
//!
//! North at constant speed after a 3 s minimum-jerk ramp, with a lateral wave `A sin(2 pi s / L)` that fades in as
//! `1 - exp(-(s / 10 m)^3)`; a stop is of minimum jerk with the given peak deceleration.

use nalgebra::Vector3;

/// Flight level (m down).
pub const LEVEL_DOWN_M: f64 = -5.0;
/// Ramp of the reference (s).
const RAMP_S: f64 = 3.0;
/// Where a stop begins (s).
pub const STOP_AT_S: f64 = 8.0;

/// Errors count from here (s) ...
const COUNT_FROM_S: f64 = 5.0;
/// ... to here (s).
pub const COUNT_TO_S: f64 = 14.0;
/// How long a flight that stops is watched (s).
pub const STOP_WATCHED_S: f64 = 18.0;

/// North at constant speed after a ramp, with a wave to the side, and perhaps a stop. It begins at time 0.
#[derive(Clone, Copy, Debug)]
pub struct Reference {
    /// Speed north (m/s).
    pub speed: f64,
    /// Of the wave, to the side (m).
    pub amplitude: f64,
    /// Of the wave (m).
    pub wavelength: f64,
    /// Peak deceleration of a stop (m/s^2); 0 = none.
    pub stop: f64,
}

impl Reference {
    fn north(&self, t: f64) -> f64 {
        let ramp = |tau: f64| tau.powi(4) * (2.5 - 3.0 * tau + tau * tau);
        let t = t.max(0.0);
        let started = if t < RAMP_S {
            RAMP_S * ramp(t / RAMP_S)
        } else {
            t - RAMP_S / 2.0
        };
        if self.stop == 0.0 || t < STOP_AT_S {
            return self.speed * started;
        }
        let duration = 1.875 * self.speed / self.stop;
        let tau = ((t - STOP_AT_S) / duration).min(1.0);
        self.speed * (STOP_AT_S - RAMP_S / 2.0 + duration * (tau - ramp(tau)))
    }

    /// Where it is at time `t` (s), local NED (m).
    pub fn position(&self, t: f64) -> Vector3<f64> {
        let s = self.north(t);
        Vector3::new(s, self.wave(s), LEVEL_DOWN_M)
    }

    fn wave(&self, s: f64) -> f64 {
        let fade = 1.0 - (-(s / 10.0).powi(3)).exp();
        self.amplitude * (std::f64::consts::TAU * s / self.wavelength).sin() * fade
    }

    /// Its velocity at time `t` (s), local NED (m/s).
    pub fn velocity(&self, t: f64) -> Vector3<f64> {
        let h = 1e-4;
        (self.position(t + h) - self.position(t - h)) / (2.0 * h)
    }

    /// Its acceleration at time `t` (s), local NED (m/s^2).
    pub fn acceleration(&self, t: f64) -> Vector3<f64> {
        let h = 1e-3;
        (self.position(t + h) - self.position(t) * 2.0 + self.position(t - h)) / (h * h)
    }

    /// How far north of the end of its stop the positions in `track` go (m).
    pub fn overshoot(&self, track: &[(f64, Vector3<f64>)]) -> f64 {
        let end = self.position(STOP_WATCHED_S).x;
        track.iter().map(|(_, p)| p.x - end).fold(f64::MIN, f64::max)
    }

    /// Distance of `point` (local NED, m) from the nearest point of the path, level (m).
    pub fn cross(&self, point: &Vector3<f64>) -> f64 {
        (-400..=400)
            .map(|i| {
                let s = point.x + f64::from(i) * 0.01;
                (s - point.x).hypot(self.wave(s) - point.y)
            })
            .fold(f64::INFINITY, f64::min)
    }
}

/// How far a flight strays from its reference (m), level.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// Distance at the same time: median, largest.
    pub total: [f64; 2],
    /// Along the path: median, furthest behind.
    pub along: [f64; 2],
    /// From the nearest point of the path: median, largest.
    pub cross: [f64; 2],
}

impl Errors {
    /// Those of the positions in `track`, each with its time (s), from 5 s on.
    pub fn of(reference: &Reference, track: &[(f64, Vector3<f64>)]) -> Self {
        let (mut total, mut along, mut cross) = (Vec::new(), Vec::new(), Vec::new());
        for (t, position) in track.iter().filter(|(t, _)| *t >= COUNT_FROM_S) {
            let error = (position - reference.position(*t)).xy();
            let direction = reference.velocity(*t).xy().normalize();
            total.push(error.norm());
            along.push(error.dot(&direction));
            cross.push(reference.cross(position));
        }
        for list in [&mut total, &mut along, &mut cross] {
            list.sort_by(f64::total_cmp);
        }
        let (middle, last) = (along.len() / 2, along.len() - 1);
        Self {
            total: [total[middle], total[last]],
            along: [along[middle], along[0]],
            cross: [cross[middle], cross[last]],
        }
    }

    /// In the order of the table.
    pub fn list(&self) -> [f64; 6] {
        let [total, along, cross] = [self.total, self.along, self.cross];
        [total[0], total[1], along[0], along[1], cross[0], cross[1]]
    }
}

/// A motion without a stop: speed (m/s), amplitude and length of the wave (m).
pub const fn wave(speed: f64, amplitude: f64, wavelength: f64) -> Reference {
    Reference {
        speed,
        amplitude,
        wavelength,
        stop: 0.0,
    }
}
