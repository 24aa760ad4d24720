//! G-optimal and compound designs against direct computation.

#![allow(clippy::unwrap_used)]

mod common;

use common::{information, quadratic};
use ecm_doe::regressor::Model;
use ecm_doe::{
    Control, DSettings, DesignError, InformationMatrix, compound_optimal, d_optimal, g_optimal,
    i_optimal,
};

/// tr(A M^-1 A') of every pose.
fn variances(rows: &[f64], block: usize, k: usize, design: &[usize]) -> Vec<f64> {
    let m = information(rows, block, k, design);
    let one = |x: &[f64]| m.solve(x).iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
    rows.chunks_exact(block * k)
        .map(|pose| pose.chunks_exact(k).map(one).sum())
        .collect()
}

fn largest(values: &[f64]) -> f64 {
    values.iter().copied().fold(0.0, f64::max)
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn settings(n: usize) -> DSettings {
    DSettings {
        n,
        starts: 4,
        iterations: 40,
        ..DSettings::default()
    }
}

#[test]
fn the_largest_variance_is_what_a_fresh_evaluation_gives() {
    for (block, n) in [(1, 18), (2, 12)] {
        let (k, count) = (10, 60);
        let rows = quadratic(1, count * block);
        let g = g_optimal(&rows, block, k, &settings(n), &Control::new()).unwrap();
        let direct = largest(&variances(&rows, block, k, &g.indices));
        assert!(
            (g.value / direct - 1.0).abs() < 1e-9,
            "{} {direct}",
            g.value
        );
        // The design's own variances sum to k.
        assert!(g.bound >= k as f64 / n as f64 * (1.0 - 1e-9) && g.bound <= g.value);
        let d = d_optimal(&rows, block, k, &settings(n), &Control::new()).unwrap();
        let i = i_optimal(&rows, block, k, None, &settings(n), &Control::new()).unwrap();
        for other in [d, i] {
            assert!(g.value <= largest(&variances(&rows, block, k, &other.indices)) + 1e-12);
        }
        // Entering the worst pose in place of any other does not help.
        let all = variances(&rows, block, k, &g.indices);
        let worst = (0..count)
            .max_by(|&a, &b| all[a].total_cmp(&all[b]))
            .unwrap();
        if !g.indices.contains(&worst) {
            for at in 0..n {
                let mut swapped = g.indices.clone();
                swapped[at] = worst;
                let after = largest(&variances(&rows, block, k, &swapped));
                assert!(after > g.value * (1.0 - 1e-8));
            }
        }
    }
}

#[test]
fn no_subset_beats_the_bound_of_the_largest_variance() {
    let k = 3;
    let points = common::uniform(5, 11, 2);
    let rows = Model::polynomial(&points, 1, &[-1.0; 2], &[1.0; 2])
        .unwrap()
        .rows;
    let n = 4;
    let g = g_optimal(&rows, 1, k, &settings(n), &Control::new()).unwrap();
    let mut best = f64::INFINITY;
    for mask in 0u32..1 << 11 {
        if mask.count_ones() as usize == n {
            let design: Vec<usize> = (0..11).filter(|i| mask >> i & 1 == 1).collect();
            let mut m = vec![0.0; k * k];
            for &i in &design {
                let x = &rows[i * k..(i + 1) * k];
                (0..k * k).for_each(|at| m[at] += x[at / k] * x[at % k]);
            }
            if InformationMatrix::new(&m, k).is_ok() {
                best = best.min(largest(&variances(&rows, 1, k, &design)));
            }
        }
    }
    assert!(g.bound <= best * (1.0 + 1e-9), "{} {best}", g.bound);
    assert!((g.value / best - 1.0).abs() < 1e-9, "{} {best}", g.value);
}

#[test]
fn lists_hold_for_the_largest_variance() {
    let rows = quadratic(3, 60);
    let given = DSettings {
        include: vec![5, 9],
        exclude: vec![0, 1, 2],
        ..settings(14)
    };
    let g = g_optimal(&rows, 1, 10, &given, &Control::new()).unwrap();
    assert!(g.indices.len() == 14 && g.indices.contains(&5) && g.indices.contains(&9));
    assert!(g.indices.iter().all(|i| *i > 2));
    assert!((largest(&variances(&rows, 1, 10, &g.indices)) / g.value - 1.0).abs() < 1e-9);
    let again = g_optimal(
        &rows,
        1,
        10,
        &DSettings {
            threads: 2,
            ..given
        },
        &Control::new(),
    );
    assert_eq!(again.unwrap().indices, g.indices);
}

#[test]
fn shares_lead_from_i_to_d() {
    for (block, n) in [(1, 16), (2, 12)] {
        let (k, count) = (10, 80);
        let rows = quadratic(2, count * block);
        let merit = |share: f64, design: &[usize]| {
            let m = information(&rows, block, k, design);
            let d = m.log_det() / k as f64 - (n as f64).ln();
            share * d - (1.0 - share) * mean(&variances(&rows, block, k, design)).ln()
        };
        let run = |share| {
            compound_optimal(&rows, block, k, share, None, &settings(n), &Control::new()).unwrap()
        };
        let found: Vec<_> = [0.0, 0.5, 1.0].map(|share| (share, run(share))).to_vec();
        for (share, design) in &found {
            let direct = merit(*share, &design.indices);
            assert!(
                (direct - design.value).abs() < 1e-9,
                "{direct} {}",
                design.value
            );
            assert!(design.bound >= design.value && design.efficiency > 0.8);
            assert!((design.efficiency - (design.value - design.bound).exp()).abs() < 1e-12);
            // Each is at least as good as the others in its own criterion.
            for (_, other) in &found {
                assert!(merit(*share, &other.indices) <= design.value + 1e-9);
            }
        }
        let d = d_optimal(&rows, block, k, &settings(n), &Control::new()).unwrap();
        assert!(found[2].1.value >= d.value - 2e-3);
    }
    let wrong = compound_optimal(
        &quadratic(2, 50),
        1,
        10,
        1.5,
        None,
        &settings(16),
        &Control::new(),
    );
    assert!(matches!(
        wrong,
        Err(DesignError::Setting { name: "share", .. })
    ));
}

#[test]
fn no_subset_beats_the_bound_of_both_criteria_and_it_is_near() {
    let (k, count, n, share) = (3, 11, 5, 0.4);
    let points = common::uniform(8, count, 2);
    let rows = Model::polynomial(&points, 1, &[-1.0; 2], &[1.0; 2])
        .unwrap()
        .rows;
    let design = compound_optimal(&rows, 1, k, share, None, &settings(n), &Control::new()).unwrap();
    let mut best = f64::NEG_INFINITY;
    for mask in 0u32..1 << count {
        if mask.count_ones() as usize == n {
            let chosen: Vec<usize> = (0..count).filter(|i| mask >> i & 1 == 1).collect();
            let m = information(&rows, 1, k, &chosen);
            let d = m.log_det() / k as f64 - (n as f64).ln();
            let i = mean(&variances(&rows, 1, k, &chosen)).ln();
            best = best.max(share * d - (1.0 - share) * i);
        }
    }
    assert!(
        (design.value - best).abs() < 1e-9,
        "{} {best}",
        design.value
    );
    assert!(design.bound >= best - 1e-9);
    // Of many poses whole numbers cost little: the bound is that of both together.
    let rows = quadratic(4, 300);
    let many = compound_optimal(&rows, 1, 10, 0.5, None, &settings(80), &Control::new()).unwrap();
    assert!(many.efficiency > 0.997, "{}", many.efficiency);
    assert!(many.gap < 1e-6);
}

/// Where weights are capped the average over the D-optimum alone says too little.
#[test]
fn the_bound_of_the_largest_variance_is_near_for_many_poses() {
    let rows = quadratic(6, 300);
    let g = g_optimal(&rows, 1, 10, &settings(100), &Control::new()).unwrap();
    assert!(g.efficiency > 0.95, "{}", g.efficiency);
}
