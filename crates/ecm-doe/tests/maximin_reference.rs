//! Maximin on the reference candidates: 200 of 1700 uniform in [-1, 1]^6.

#![allow(clippy::unwrap_used)]

mod common;

use ecm_doe::{Control, MaximinSettings, SpacingMethod, maximin};

fn smallest(points: &[f64], design: &[usize]) -> f64 {
    let mut least = f64::INFINITY;
    for (a, &i) in design.iter().enumerate() {
        for &j in &design[..a] {
            let d: f64 = (0..6)
                .map(|c| (points[6 * i + c] - points[6 * j + c]).powi(2))
                .sum();
            least = least.min(d);
        }
    }
    least.sqrt()
}

#[test]
fn both_methods_reach_their_distance() {
    let points = common::uniform(0, 1700, 6);
    for (method, iterations, least) in [
        (SpacingMethod::Exchange, 0, 0.90),
        (SpacingMethod::Search, 150, 0.974),
    ] {
        let settings = MaximinSettings {
            n: 200,
            iterations,
            method,
            ..MaximinSettings::default()
        };
        let d = maximin(&points, 6, &settings, &Control::new()).unwrap();
        assert!(d.value >= least, "{method:?} {}", d.value);
        assert_eq!(d.value, smallest(&points, &d.indices));
        assert!(d.bound < 1.161 && d.bound > d.value, "{}", d.bound);
    }
}

#[test]
fn a_search_without_a_budget_ends_once_it_goes_on_in_vain() {
    let points = common::uniform(3, 80, 3);
    let with = |iterations| {
        let settings = MaximinSettings {
            n: 10,
            iterations,
            ..MaximinSettings::default()
        };
        maximin(&points, 3, &settings, &Control::new()).unwrap()
    };
    let (found, long) = (with(0), with(1000));
    assert_eq!((found.value, &found.indices), (long.value, &long.indices));
    assert!(found.exchanges < long.exchanges / 2, "{}", found.exchanges);
}

#[test]
fn included_and_measured_points_keep_their_distance() {
    let points = common::uniform(0, 400, 6);
    let settings = MaximinSettings {
        n: 30,
        iterations: 30,
        include: vec![11, 17],
        exclude: vec![0, 1, 2],
        measured: points[6 * 50..6 * 60].to_vec(),
        ..MaximinSettings::default()
    };
    let d = maximin(&points, 6, &settings, &Control::new()).unwrap();
    assert!(d.indices.len() == 30 && d.indices.contains(&11) && d.indices.contains(&17));
    assert!(d.indices.iter().all(|i| *i > 2 && !(50..60).contains(i)));
    let mut all = d.indices.clone();
    all.extend(50..60);
    assert_eq!(smallest(&points, &all), d.value);
}

#[test]
fn many_candidates_are_thinned_with_a_valid_bound() {
    let points = common::uniform(2, 20_000, 2);
    let settings = MaximinSettings {
        n: 15,
        iterations: 20,
        starts: 2,
        ..MaximinSettings::default()
    };
    let d = maximin(&points, 2, &settings, &Control::new()).unwrap();
    // Fifteen equal circles in a square of side 2: the largest distance is 0.6823 (packing tables).
    assert!(d.value > 0.62 && d.value <= 0.6823, "{}", d.value);
    assert!(d.bound >= 0.6823 * 0.98, "{}", d.bound);
}
