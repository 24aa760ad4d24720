//! Numbers that break careless code, and a small body to try them on.
#![allow(clippy::unwrap_used, dead_code, missing_docs)]

use ecm_fem::mesh::FACES;
use ecm_fem::{Fem, Material, Mesh, NeoHookean, Quality};
use proptest::prelude::*;
use proptest::test_runner::RngSeed;
use std::collections::HashMap;

pub const COARSE: Quality = Quality::custom([1, 2, 4], [1000, 1000]);

pub fn neo() -> Box<dyn Material> {
    Box::new(NeoHookean::new(1e6, 0.49).unwrap())
}

pub fn mesh() -> Mesh {
    Mesh::cylinder(0.1, 0.03, COARSE).unwrap()
}

pub fn fem() -> Fem {
    Fem::new(mesh(), neo(), None).unwrap()
}

/// Any double, with the awkward ones often.
pub fn hostile() -> impl Strategy<Value = f64> {
    let awkward = [
        0.0,
        -0.0,
        f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        1e-30,
        1e30,
        1e100,
        -1.0,
        std::f64::consts::PI,
    ];
    prop_oneof![
        any::<f64>(),
        prop::sample::select(awkward.to_vec()),
        -3.0..3.0,
    ]
}

pub fn six() -> impl Strategy<Value = [f64; 6]> {
    // All six awkward at once hardly ever reach the solver: most numbers are ordinary.
    prop_oneof![
        prop::array::uniform6(hostile()),
        (prop::array::uniform6(-1.0..1.0), 0..6usize, hostile()).prop_map(|(mut x, k, value)| {
            x[k] = value;
            x
        }),
        (prop::array::uniform6(-1.0..1.0), 0..30i32)
            .prop_map(|(x, e)| x.map(|v| v * 10.0_f64.powi(e))),
    ]
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

/// Nodes of element faces that belong to one element only.
pub fn surface_nodes(mesh: &Mesh) -> Vec<usize> {
    let mut faces: HashMap<[usize; 3], (usize, [usize; 6])> = HashMap::new();
    for tet in mesh.tetrahedra() {
        for face in FACES {
            let nodes = face.map(|i| tet[i]);
            let mut key = [nodes[0], nodes[1], nodes[2]];
            key.sort_unstable();
            faces.entry(key).or_insert((0, nodes)).0 += 1;
        }
    }
    let outer = faces.into_values().filter(|(count, _)| *count == 1);
    let mut found: Vec<usize> = outer.flat_map(|(_, nodes)| nodes).collect();
    found.sort_unstable();
    found.dedup();
    found
}
