//! Reproducible random numbers: xoshiro256++ seeded through SplitMix64.
//!
//! Source: D. Blackman, S. Vigna, "Scrambled Linear Pseudorandom Number Generators", ACM TOMS 47(4), 2021. Written out
//! here because a flight must be the same to the bit for ever. Of the crate rand `StdRng` and `SmallRng` do not promise that; its
//! named generators do (rand_xoshiro has this one), and what is left to write are the uniform and normal numbers made of it.

/// A stream of random numbers; the same seed gives the same stream.
#[derive(Clone, Debug)]
pub struct Random {
    state: [u64; 4],
}

impl Random {
    /// The stream of `seed`; `purpose` keeps streams of one seed apart (one per sensor, for example).
    pub fn new(seed: u64, purpose: u64) -> Self {
        let mut mixer = seed ^ purpose.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        let mut next = || {
            mixer = mixer.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = mixer;
            z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            z ^ (z >> 31)
        };
        Self {
            state: [next(), next(), next(), next()],
        }
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        let [a, b, c, d] = self.state;
        let result = a.wrapping_add(d).rotate_left(23).wrapping_add(a);
        let mut next = [a, b, c ^ a, d ^ b];
        next[1] ^= next[2];
        next[0] ^= next[3];
        next[2] ^= b << 17;
        next[3] = next[3].rotate_left(45);
        self.state = next;
        result
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 * (1.0 / (1u64 << 53) as f64)
    }

    /// Uniform in [`low`, `high`).
    pub fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// Normal with mean 0 and standard deviation 1 (Box and Muller 1958, one of the pair).
    pub fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.unit()).ln()).sqrt();
        radius * (std::f64::consts::TAU * self.unit()).cos()
    }

    /// Poisson with the given mean (Knuth's product method, fine up to a mean of some hundreds).
    pub fn poisson(&mut self, mean: f64) -> u32 {
        let limit = (-mean).exp();
        let mut product = self.unit();
        let mut count = 0;
        while product > limit {
            product *= self.unit();
            count += 1;
        }
        count
    }
}

#[cfg(test)]
mod tests {
    use super::Random;

    #[test]
    fn a_seed_gives_one_stream_for_ever() {
        let mut random = Random::new(1, 0);
        let first: Vec<u64> = (0..3).map(|_| random.bits()).collect();
        let mut again = Random::new(1, 0);
        assert_eq!(first, (0..3).map(|_| again.bits()).collect::<Vec<_>>());
        assert_ne!(first[0], Random::new(2, 0).bits());
        assert_ne!(first[0], Random::new(1, 1).bits());
    }

    #[test]
    fn the_moments_are_those_of_the_distributions() {
        let mut random = Random::new(7, 3);
        let n = 20_000;
        let (mut sum, mut square, mut counts, mut unit) = (0.0, 0.0, 0.0, 0.0);
        for _ in 0..n {
            let value = random.normal();
            sum += value;
            square += value * value;
            counts += f64::from(random.poisson(6.5));
            unit += random.unit();
        }
        let n = f64::from(n);
        assert!((sum / n).abs() < 0.03);
        assert!((square / n - 1.0).abs() < 0.04);
        assert!((counts / n - 6.5).abs() < 0.08);
        assert!((unit / n - 0.5).abs() < 0.01);
    }
}
