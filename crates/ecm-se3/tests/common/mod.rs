//! Settings that the property tests share.
#![allow(dead_code)]

use proptest::prelude::ProptestConfig;
use proptest::test_runner::RngSeed;

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
