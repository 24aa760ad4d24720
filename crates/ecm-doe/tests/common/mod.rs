//! Shared by the tests of designs: candidates equal to `numpy.random.default_rng(seed).uniform(-1, 1, (count, 6))`.

#![allow(dead_code, clippy::unwrap_used)]

use ecm_doe::InformationMatrix;
use ecm_doe::regressor::Model;
use proptest::prelude::ProptestConfig;
use proptest::test_runner::RngSeed;

const MULTIPLIER: u128 = 0x2360_ED05_1FC6_5DA4_4385_DF64_9FCC_F645;

/// numpy's SeedSequence: four 64-bit words from one small seed.
fn seed_words(seed: u32) -> [u64; 4] {
    let mut hash = 0x43b0_d7e5u32;
    let mut mixed = |value: u32| {
        let mut v = value ^ hash;
        hash = hash.wrapping_mul(0x931e_8875);
        v = v.wrapping_mul(hash);
        v ^ (v >> 16)
    };
    let mut pool = [0u32; 4];
    for (i, slot) in pool.iter_mut().enumerate() {
        *slot = mixed(if i == 0 { seed } else { 0 });
    }
    for from in 0..4 {
        for to in 0..4 {
            if from != to {
                let m = mixed(pool[from]);
                let v = pool[to]
                    .wrapping_mul(0xca01_f9dd)
                    .wrapping_sub(m.wrapping_mul(0x4973_f715));
                pool[to] = v ^ (v >> 16);
            }
        }
    }
    let mut hash = 0x8b51_f9ddu32;
    let mut state = [0u32; 8];
    for (i, slot) in state.iter_mut().enumerate() {
        let mut v = pool[i % 4] ^ hash;
        hash = hash.wrapping_mul(0x58f3_8ded);
        v = v.wrapping_mul(hash);
        *slot = v ^ (v >> 16);
    }
    std::array::from_fn(|i| u64::from(state[2 * i]) | (u64::from(state[2 * i + 1]) << 32))
}

/// numpy's PCG64 (XSL-RR 128/64).
pub struct Pcg64 {
    state: u128,
    increment: u128,
}

impl Pcg64 {
    pub fn new(seed: u32) -> Self {
        let w = seed_words(seed);
        let join = |high: u64, low: u64| (u128::from(high) << 64) | u128::from(low);
        let increment = (join(w[2], w[3]) << 1) | 1;
        let mut rng = Self {
            state: 0,
            increment,
        };
        rng.step();
        rng.state = rng.state.wrapping_add(join(w[0], w[1]));
        rng.step();
        rng
    }

    fn step(&mut self) {
        self.state = self
            .state
            .wrapping_mul(MULTIPLIER)
            .wrapping_add(self.increment);
    }

    /// Uniform in [0, 1).
    pub fn next_f64(&mut self) -> f64 {
        self.step();
        let folded = ((self.state >> 64) as u64) ^ (self.state as u64);
        let bits = folded.rotate_right((self.state >> 122) as u32);
        (bits >> 11) as f64 / (1u64 << 53) as f64
    }
}

/// `count` x `columns` uniform in [-1, 1].
pub fn uniform(seed: u32, count: usize, columns: usize) -> Vec<f64> {
    let mut rng = Pcg64::new(seed);
    (0..count * columns)
        .map(|_| -1.0 + 2.0 * rng.next_f64())
        .collect()
}

/// Quadratic regressor of `count` uniform points in three coordinates.
pub fn quadratic(seed: u32, count: usize) -> Vec<f64> {
    let points = uniform(seed, count, 3);
    Model::polynomial(&points, 2, &[-1.0; 3], &[1.0; 3])
        .unwrap()
        .rows
}

/// Information matrix of a design.
pub fn information(rows: &[f64], block: usize, k: usize, design: &[usize]) -> InformationMatrix {
    let mut m = vec![0.0; k * k];
    for &i in design {
        for x in rows[i * block * k..(i + 1) * block * k].chunks_exact(k) {
            for a in 0..k {
                for b in 0..k {
                    m[a * k + b] += x[a] * x[b];
                }
            }
        }
    }
    InformationMatrix::new(&m, k).unwrap()
}

/// `count` poses around a mechanism of length 0.1 m.
pub fn poses(seed: u32, count: usize) -> Vec<[f64; 6]> {
    let scale = [0.01, 0.02, 0.02, 0.5, 0.5, 0.5];
    uniform(seed, count, 6)
        .chunks_exact(6)
        .map(|p| std::array::from_fn(|c| if c == 0 { 0.1 } else { 0.0 } + scale[c] * p[c]))
        .collect()
}

/// `cases` with the same seed in every run; with PROPTEST_CASES that many, and another seed.
pub fn config(cases: u32) -> ProptestConfig {
    let wanted = std::env::var("PROPTEST_CASES").ok();
    let rng_seed = if wanted.is_some() {
        RngSeed::Random
    } else {
        RngSeed::Fixed(1)
    };
    let cases = wanted.and_then(|n| n.parse().ok()).unwrap_or(cases);
    ProptestConfig {
        cases,
        rng_seed,
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}
