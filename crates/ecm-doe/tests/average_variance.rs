//! I- and A-optimal designs against direct computation.

#![allow(clippy::unwrap_used)]

mod common;

use common::{information, quadratic};
use ecm_doe::regressor::{Model, prediction_region};
use ecm_doe::{Control, DSettings, Method, a_optimal, d_optimal, i_optimal};

/// Mean over poses of tr(A M^-1 A').
fn average_variance(rows: &[f64], block: usize, k: usize, design: &[usize], region: &[f64]) -> f64 {
    let m = information(rows, block, k, design);
    let sum: f64 = region
        .chunks_exact(k)
        .map(|x| m.solve(x).iter().zip(x).map(|(a, b)| a * b).sum::<f64>())
        .sum();
    sum / (region.len() / (block * k)) as f64
}

fn trace(rows: &[f64], k: usize, design: &[usize]) -> f64 {
    let m = information(rows, 1, k, design);
    (0..k).map(|i| m.inverse()[i * k + i]).sum()
}

#[test]
fn i_optimal_is_a_local_optimum_within_its_bound() {
    let (k, n, count) = (10, 16, 60);
    let rows = quadratic(1, count);
    for method in [Method::Search, Method::RowWise, Method::Fedorov] {
        let settings = DSettings {
            n,
            starts: 3,
            iterations: 40,
            method,
            ..DSettings::default()
        };
        let d = i_optimal(&rows, 1, k, None, &settings, &Control::new()).unwrap();
        let direct = average_variance(&rows, 1, k, &d.indices, &rows);
        assert!(
            (direct / d.value - 1.0).abs() < 1e-9,
            "{direct} {}",
            d.value
        );
        assert!(d.bound <= d.value && (d.efficiency - d.bound / d.value).abs() < 1e-12);
        assert!(d.efficiency > 0.9, "{}", d.efficiency);
        for at in 0..n {
            for other in (0..count).filter(|c| !d.indices.contains(c)) {
                let mut swapped = d.indices.clone();
                swapped[at] = other;
                assert!(average_variance(&rows, 1, k, &swapped, &rows) > d.value * (1.0 - 1e-8));
            }
        }
    }
}

#[test]
fn no_subset_beats_the_lower_bounds() {
    let k = 3;
    let points = common::uniform(8, 12, 2);
    let rows = Model::polynomial(&points, 1, &[-1.0; 2], &[1.0; 2])
        .unwrap()
        .rows;
    let settings = DSettings {
        n: 5,
        starts: 3,
        iterations: 30,
        ..DSettings::default()
    };
    let i = i_optimal(&rows, 1, k, None, &settings, &Control::new()).unwrap();
    let a = a_optimal(&rows, 1, k, &settings, &Control::new()).unwrap();
    let (mut best_i, mut best_a) = (f64::INFINITY, f64::INFINITY);
    for mask in 0u32..1 << 12 {
        if mask.count_ones() == 5 {
            let set: Vec<usize> = (0..12).filter(|b| mask >> b & 1 == 1).collect();
            best_i = best_i.min(average_variance(&rows, 1, k, &set, &rows));
            best_a = best_a.min(trace(&rows, k, &set));
        }
    }
    assert!(i.bound <= best_i * (1.0 + 1e-12) && (i.value / best_i - 1.0).abs() < 1e-9);
    assert!(a.bound <= best_a * (1.0 + 1e-12) && (a.value / best_a - 1.0).abs() < 1e-9);
    assert!(i.bound > 0.8 * best_i && a.bound > 0.8 * best_a);
}

#[test]
fn six_rows_a_pose_and_a_region_of_its_own() {
    let mut all = common::poses(2, 80);
    all.extend(common::poses(3, 40));
    let rows = Model::energy(&all, 4, ecm_poly::Symmetry::Alike, 0.1)
        .unwrap()
        .rows;
    let (candidates, region) = rows.split_at(80 * 6 * 22);
    let settings = DSettings {
        n: 9,
        starts: 2,
        iterations: 15,
        include: vec![4],
        ..DSettings::default()
    };
    let d = i_optimal(candidates, 6, 22, Some(region), &settings, &Control::new()).unwrap();
    let direct = average_variance(candidates, 6, 22, &d.indices, region);
    assert!(
        (direct / d.value - 1.0).abs() < 1e-7,
        "{direct} {}",
        d.value
    );
    assert!(d.indices.contains(&4) && d.indices.len() == 9 && d.bound <= d.value);
    let other = d_optimal(candidates, 6, 22, &settings, &Control::new()).unwrap();
    assert!(d.value <= average_variance(candidates, 6, 22, &other.indices, region) * (1.0 + 1e-9));
    assert!(
        d.gap < 1e-8 && d.efficiency > 0.6,
        "{} {}",
        d.gap,
        d.efficiency
    );
}

#[test]
fn the_bound_converges_on_the_reference_candidates() {
    let points = common::uniform(0, 1700, 6);
    let rows = Model::polynomial(&points, 3, &[-1.0; 6], &[1.0; 6])
        .unwrap()
        .rows;
    let settings = DSettings {
        n: 200,
        starts: 1,
        iterations: 1,
        ..DSettings::default()
    };
    let d = i_optimal(&rows, 1, 84, None, &settings, &Control::new()).unwrap();
    assert!(d.gap < 1e-6, "{}", d.gap);
    // The D-optimal design has .373, the maximin one .347 (mean over the candidates).
    assert!(
        d.value < 0.33 && d.efficiency > 0.95,
        "{} {}",
        d.value,
        d.efficiency
    );
}

/// h and K of a quadratic over [-1, 1]: rows (1, u, u^2) and, over half the range, (0, 1, 2u).
#[test]
fn the_region_holds_h_and_k_over_half_the_range() {
    let points: Vec<f64> = (0..9).map(|i| 3.0 + f64::from(i)).collect();
    let rows_of = |p: &[f64]| Model::polynomial(p, 2, &[3.0], &[11.0]);
    let region = prediction_region(&points, &[3.0], &[11.0], rows_of).unwrap();
    assert_eq!(region.len(), 2 * 9 * 3);
    let rows = rows_of(&points).unwrap().rows;
    let settings = DSettings {
        n: 5,
        starts: 3,
        iterations: 20,
        ..DSettings::default()
    };
    let design = i_optimal(&rows, 1, 3, Some(&region), &settings, &Control::new()).unwrap();
    let m = information(&rows, 1, 3, &design.indices);
    let variance = |x: [f64; 3]| m.solve(&x).iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
    let both = |p: &f64| {
        let u = (p - 7.0) / 4.0;
        variance([1.0, u, u * u]) + variance([0.0, 1.0, 2.0 * u])
    };
    let direct = points.iter().map(both).sum::<f64>() / 9.0;
    assert!(
        (design.value / direct - 1.0).abs() < 1e-6,
        "{} {direct}",
        design.value
    );
    // K is known from the ends: more of the poses go there than for h alone.
    let h = i_optimal(&rows, 1, 3, None, &settings, &Control::new()).unwrap();
    assert!(h.value < design.value);
}
