//! Reproducible random numbers: xoshiro256++ seeded through SplitMix64.
//!
//! Source: D. Blackman, S. Vigna, "Scrambled Linear Pseudorandom Number Generators", ACM TOMS 47(4), 2021. A flight must be
//! the same to the bit for ever: rand_xoshiro promises that for the bits of its named generators, which `StdRng` and `SmallRng` of
//! rand do not. Nobody promises it for the numbers made of them, so uniform, normal and Poisson numbers are written out here.

use rand_xoshiro::Xoshiro256PlusPlus;
use rand_xoshiro::rand_core::{Rng, SeedableRng};

/// A stream of random numbers; the same seed gives the same stream.
#[derive(Clone, Debug)]
pub struct Random {
    generator: Xoshiro256PlusPlus,
}

impl Random {
    /// The stream of `seed`; `purpose` keeps streams of one seed apart (one per sensor, for example).
    pub fn new(seed: u64, purpose: u64) -> Self {
        let seed = seed ^ purpose.wrapping_mul(0x9e37_79b9_7f4a_7c15);
        Self {
            generator: Xoshiro256PlusPlus::seed_from_u64(seed),
        }
    }

    /// The next 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.generator.next_u64()
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
        let streams: [(u64, u64, [u64; 4]); 3] = [
            (
                1,
                0,
                [
                    0xcfc5_d07f_6f03_c29b,
                    0xbf42_4132_963f_e08d,
                    0x19a3_7d57_57aa_f520,
                    0xbf08_119f_05cd_56d6,
                ],
            ),
            (
                7,
                3,
                [
                    0x619b_b877_8b35_b307,
                    0x5306_4720_de52_9a2c,
                    0x6a6f_638b_2ceb_7b4e,
                    0x9c3e_16a2_8735_b4f5,
                ],
            ),
            (
                u64::MAX,
                0xFEED,
                [
                    0x1a7f_b811_eb5c_9e4c,
                    0xec32_51e2_17bc_04ca,
                    0x6892_c023_bab8_3733,
                    0x4d27_2d2e_27f7_bd89,
                ],
            ),
        ];
        for (seed, purpose, bits) in streams {
            let mut random = Random::new(seed, purpose);
            assert_eq!(bits.map(|_| random.bits()), bits, "{seed} {purpose}");
        }
    }

    #[test]
    fn the_numbers_made_of_it_are_the_same_for_ever() {
        // After the four of the stream above.
        let random = || {
            let mut random = Random::new(7, 3);
            for _ in 0..4 {
                random.bits();
            }
            random
        };
        assert_eq!(random().unit(), 0.342_145_666_110_227_9);
        assert_eq!(random().between(-2.0, 3.0), -0.289_271_669_448_860_6);
        assert_eq!(random().normal(), 0.914_681_360_748_093_8);
        assert_eq!(random().poisson(6.5), 5);
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
