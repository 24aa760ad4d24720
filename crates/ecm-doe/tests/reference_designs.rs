//! The reference problem: 1700 uniform candidates, 84 cubic terms, n = 200.

#![allow(clippy::unwrap_used)]

mod common;

use ecm_doe::certificate::{CertificateSettings, continuous};
use ecm_doe::regressor::Model;
use ecm_doe::{Control, DSettings, Method, Problem, d_optimal};

fn cubic() -> Vec<f64> {
    Model::polynomial(&common::uniform(0, 1700, 6), 3, &[-1.0; 6], &[1.0; 6])
        .unwrap()
        .rows
}

/// The first numbers of `numpy.random.default_rng(0).random()`.
#[test]
fn candidates_are_those_of_numpy() {
    let mut rng = common::Pcg64::new(0);
    assert_eq!(rng.next_f64(), 0.636_961_687_321_454_3);
    assert_eq!(rng.next_f64(), 0.269_786_713_763_870_3);
}

#[test]
fn certified_bounds() {
    let problem = Problem::new(&cubic(), 1, 84, None).unwrap();
    for (cap, expected) in [(1.0, -2.371_834_928), (f64::INFINITY, -2.354_180_813)] {
        let best = continuous(
            &problem,
            200,
            cap,
            &CertificateSettings::default(),
            &Control::new(),
        )
        .unwrap();
        let bound = (best.bound + problem.log_det_shift()) / 84.0 - 200f64.ln();
        assert!((bound - expected).abs() < 1e-8, "{bound} {expected}");
        assert!(best.gap / 84.0 < 1e-8);
        let sum: f64 = best.weights.iter().sum();
        assert!((sum - 200.0).abs() < 1e-8);
    }
}

#[test]
fn efficiency_of_each_method() {
    let rows = cubic();
    for (method, starts, iterations, least) in [
        (Method::Fedorov, 2, 0, 0.9820),
        (Method::RowWise, 2, 0, 0.9815),
        (Method::Search, 4, 100, 0.9842),
    ] {
        let settings = DSettings {
            n: 200,
            starts,
            iterations,
            method,
            threads: 2,
            ..DSettings::default()
        };
        let design = d_optimal(&rows, 1, 84, &settings, &Control::new()).unwrap();
        assert!(design.efficiency > least);
        assert_eq!(design.indices.len(), 200);
        assert!(design.indices.windows(2).all(|p| p[0] < p[1]));
        let problem = Problem::new(&rows, 1, 84, None).unwrap();
        let fresh = problem.log_det(&design.indices).unwrap() / 84.0 - 200f64.ln();
        assert!(
            (fresh - design.value).abs() < 1e-11,
            "{fresh} {}",
            design.value
        );
    }
}
