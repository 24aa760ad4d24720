//! What holds for every exchange and every input.

#![allow(clippy::unwrap_used)]

mod common;

use ecm_doe::regressor::Model;
use ecm_doe::{
    Control, DSettings, DesignError, InformationMatrix, MaximinSettings, Method, Problem,
    SpacingMethod, compound_optimal, d_optimal, g_optimal, i_optimal, maximin,
};
use proptest::prelude::*;

fn cubic(count: usize) -> Vec<f64> {
    Model::polynomial(&common::uniform(1, count, 6), 3, &[-1.0; 6], &[1.0; 6])
        .unwrap()
        .rows
}

fn gram(rows: &[f64], k: usize, chosen: &[usize]) -> Vec<f64> {
    let mut m = vec![0.0; k * k];
    for &i in chosen {
        let x = &rows[i * k..(i + 1) * k];
        for a in 0..k {
            for b in 0..k {
                m[a * k + b] += x[a] * x[b];
            }
        }
    }
    m
}

#[test]
fn updates_agree_with_a_fresh_factorisation() {
    let (k, count, n) = (84, 600, 200);
    let rows = cubic(count);
    let row = |i: usize| &rows[i * k..(i + 1) * k];
    let mut design: Vec<usize> = (0..n).collect();
    let mut m = InformationMatrix::new(&gram(&rows, k, &design), k).unwrap();
    let mut rng = common::Pcg64::new(5);
    let mut swaps = 0;
    while swaps < 10_000 {
        let at = (rng.next_f64() * n as f64) as usize;
        let candidate = (rng.next_f64() * count as f64) as usize;
        let growth = m.growth(row(design[at]), row(candidate));
        // Random swaps that neither ruin the conditioning nor repeat a row.
        if design.contains(&candidate) || growth < 0.6 {
            continue;
        }
        assert!((m.exchange(row(design[at]), row(candidate)) / growth - 1.0).abs() < 1e-12);
        design[at] = candidate;
        swaps += 1;
    }
    let fresh = InformationMatrix::new(&gram(&rows, k, &design), k).unwrap();
    let error = (m.log_det() - fresh.log_det()).abs();
    assert!(error < 1e-9, "{error}");
    let scale = fresh.inverse().iter().fold(0.0f64, |a, v| a.max(v.abs()));
    let worst = m
        .inverse()
        .iter()
        .zip(fresh.inverse())
        .fold(0.0f64, |a, (x, y)| a.max((x - y).abs() / scale));
    assert!(worst < 1e-9, "{worst}");
}

/// Six rows a pose, k coefficients, from a smooth map.
fn blocks(seed: u32, poses: usize) -> Vec<f64> {
    let poses = common::poses(seed, poses);
    Model::energy(&poses, 4, ecm_poly::Symmetry::Alike, 0.1)
        .unwrap()
        .rows
}

#[test]
fn more_swaps_never_lower_the_determinant() {
    let rows = cubic(300);
    let six = blocks(2, 120);
    for method in [Method::Fedorov, Method::RowWise] {
        for (rows, block, k, n) in [(&rows, 1, 84, 100), (&six, 6, 22, 8)] {
            let mut before = f64::NEG_INFINITY;
            for iterations in 1..25 {
                let settings = DSettings {
                    n,
                    starts: 1,
                    iterations,
                    method,
                    seed: 3,
                    ..DSettings::default()
                };
                let value = d_optimal(rows, block, k, &settings, &Control::new())
                    .unwrap()
                    .value;
                assert!(
                    value >= before - 1e-12,
                    "{method:?} {block} {iterations}: {value} {before}"
                );
                before = value;
            }
        }
    }
}

proptest! {
    #![proptest_config(common::config(24))]

    /// Exchanges only raise the determinant, the bound holds, and the value is the design's.
    #[test]
    fn designs_are_what_they_say(
        seed in 0u32..1000, n in 12usize..30, replicates: bool, method in 0usize..3,
    ) {
        let k = 10;
        let rows = Model::polynomial(&common::uniform(seed, 60, 3), 2, &[-1.0; 3], &[1.0; 3]).unwrap().rows;
        let method = [Method::Fedorov, Method::RowWise, Method::Search][method];
        let settings = |iterations| DSettings {
            n, starts: 1, iterations, method, replicates, seed: u64::from(seed), include: vec![7, 3], exclude: vec![1, 2],
            ..DSettings::default()
        };
        let few = d_optimal(&rows, 1, k, &settings(2), &Control::new()).unwrap();
        let many = d_optimal(&rows, 1, k, &settings(40), &Control::new()).unwrap();
        prop_assert!(many.value >= few.value - 1e-12);
        for d in [few, many] {
            prop_assert_eq!(d.indices.len(), n);
            prop_assert!(d.indices.contains(&3) && d.indices.contains(&7));
            prop_assert!(!d.indices.contains(&1) && !d.indices.contains(&2));
            if !replicates {
                prop_assert!(d.indices.windows(2).all(|p| p[0] < p[1]));
            }
            prop_assert!(d.efficiency <= 1.0 && d.value <= d.bound);
            let fresh = InformationMatrix::new(&gram(&rows, k, &d.indices), k).unwrap();
            let value = fresh.log_det() / k as f64 - (n as f64).ln();
            prop_assert!((value - d.value).abs() < 1e-10, "{} {}", value, d.value);
        }
    }

    /// The bound is above every random design of the same kind.
    #[test]
    fn no_design_beats_the_bound(seed in 0u32..1000, n in 8usize..20) {
        let rows = Model::polynomial(&common::uniform(seed, 24, 2), 2, &[-1.0; 2], &[1.0; 2]).unwrap().rows;
        let settings = DSettings { n, starts: 1, iterations: 1, ..DSettings::default() };
        let bound = d_optimal(&rows, 1, 6, &settings, &Control::new()).unwrap().bound;
        let problem = Problem::new(&rows, 1, 6, None).unwrap();
        let mut rng = common::Pcg64::new(seed);
        for _ in 0..200 {
            let mut order: Vec<(u64, usize)> = (0..24).map(|i| ((rng.next_f64() * 1e15) as u64, i)).collect();
            order.sort_unstable();
            let design: Vec<usize> = order[..n].iter().map(|p| p.1).collect();
            if let Some(v) = problem.log_det(&design) {
                prop_assert!(v / 6.0 - (n as f64).ln() <= bound + 1e-12);
            }
        }
    }

    /// Threshold search, exchange and bound against all subsets of a small set.
    #[test]
    fn maximin_bound_and_value_on_small_sets(seed in 0u32..1000, n in 3usize..6) {
        let points = common::uniform(seed, 12, 2);
        let distance = |i: usize, j: usize| {
            ((points[2 * i] - points[2 * j]).powi(2) + (points[2 * i + 1] - points[2 * j + 1]).powi(2)).sqrt()
        };
        let mut best = 0.0f64;
        for mask in 0u32..1 << 12 {
            if mask.count_ones() as usize == n {
                let set: Vec<usize> = (0..12).filter(|i| mask >> i & 1 == 1).collect();
                let least = set.iter().flat_map(|&i| set.iter().filter(move |&&j| j < i).map(move |&j| (i, j)))
                    .map(|(i, j)| distance(i, j)).fold(f64::INFINITY, f64::min);
                best = best.max(least);
            }
        }
        for method in [SpacingMethod::Search, SpacingMethod::Exchange] {
            let settings = MaximinSettings { n, iterations: 20, method, ..MaximinSettings::default() };
            let d = maximin(&points, 2, &settings, &Control::new()).unwrap();
            prop_assert!(d.bound >= best - 1e-12 && d.value <= best + 1e-12);
            if method == SpacingMethod::Search {
                prop_assert!((d.value - best).abs() < 1e-12, "{} {}", d.value, best);
            }
        }
    }
}

#[test]
fn threads_do_not_change_the_design() {
    let rows = cubic(400);
    let six = blocks(4, 150);
    let points = common::uniform(6, 300, 6);
    let run = |threads: usize| {
        let d = |rows: &[f64], block, k, n, method| {
            let s = DSettings {
                n,
                starts: 5,
                iterations: 60,
                seed: 9,
                threads,
                method,
                ..DSettings::default()
            };
            d_optimal(rows, block, k, &s, &Control::new()).unwrap()
        };
        let s = MaximinSettings {
            n: 40,
            iterations: 50,
            seed: 2,
            threads,
            ..MaximinSettings::default()
        };
        let m = maximin(&points, 6, &s, &Control::new()).unwrap();
        let linear = DSettings {
            n: 12,
            starts: 3,
            iterations: 8,
            threads,
            ..DSettings::default()
        };
        let control = Control::new();
        [
            i_optimal(&six, 6, 22, None, &linear, &control).unwrap(),
            g_optimal(&six, 6, 22, &linear, &control).unwrap(),
            compound_optimal(&six, 6, 22, 0.5, None, &linear, &control).unwrap(),
            d(&rows, 1, 84, 120, Method::Search),
            d(&rows, 1, 84, 120, Method::Fedorov),
            d(&six, 6, 22, 10, Method::Search),
            m,
        ]
        .map(|d| (d.indices, d.value.to_bits(), d.bound.to_bits()))
    };
    assert_eq!(run(1), run(2));
}

#[test]
fn six_rows_a_pose_match_a_fresh_determinant() {
    let rows = blocks(2, 200);
    let settings = DSettings {
        n: 12,
        starts: 4,
        iterations: 100,
        include: vec![5],
        ..DSettings::default()
    };
    let design = d_optimal(&rows, 6, 22, &settings, &Control::new()).unwrap();
    assert!(design.indices.contains(&5) && design.indices.len() == 12);
    let all: Vec<usize> = design
        .indices
        .iter()
        .flat_map(|&i| 6 * i..6 * i + 6)
        .collect();
    let fresh = InformationMatrix::new(&gram(&rows, 22, &all), 22).unwrap();
    let value = fresh.log_det() / 22.0 - 12f64.ln();
    assert!(
        (value - design.value).abs() < 1e-9,
        "{value} {}",
        design.value
    );
    assert!(design.efficiency > 0.95, "{}", design.efficiency);
}

/// Just enough poses: none of them can leave alone, only be exchanged.
#[test]
fn exchanges_of_designs_that_can_lose_no_pose() {
    let mut rows = blocks(2, 150);
    // Columns of one length, so that the fresh determinants below are not rounding.
    for c in 0..22 {
        let own = rows.iter().skip(c).step_by(22);
        let length = own.map(|v| v * v).sum::<f64>().sqrt();
        rows.iter_mut()
            .skip(c)
            .step_by(22)
            .for_each(|v| *v /= length);
    }
    let rows = rows;
    let swap_free = |design: &[usize], merit: &dyn Fn(&InformationMatrix) -> f64| {
        let all =
            |d: &[usize]| -> Vec<usize> { d.iter().flat_map(|&i| 6 * i..6 * i + 6).collect() };
        let own = merit(&InformationMatrix::new(&gram(&rows, 22, &all(design)), 22).unwrap());
        for at in 0..design.len() {
            for j in (0..150).filter(|j| !design.contains(j)) {
                let mut other = design.to_vec();
                other[at] = j;
                if let Ok(m) = InformationMatrix::new(&gram(&rows, 22, &all(&other)), 22) {
                    assert!(merit(&m) <= own + 1e-6, "{at} {j}: {} {own}", merit(&m));
                }
            }
        }
    };
    let of = |n| DSettings {
        n,
        starts: 3,
        iterations: 20,
        ..DSettings::default()
    };
    let settings = of(6);
    // 30 rows, but an energy makes them depend on each other: rank 21.
    let few = d_optimal(&rows, 6, 22, &of(5), &Control::new()).unwrap_err();
    assert_eq!(few, DesignError::Singular { n: 5, terms: 22 });
    let d = d_optimal(&rows, 6, 22, &settings, &Control::new()).unwrap();
    assert!(d.exchanges > 0);
    swap_free(&d.indices, &|m| m.log_det());
    let i = i_optimal(&rows, 6, 22, None, &settings, &Control::new()).unwrap();
    swap_free(&i.indices, &|m| {
        let one = |x: &[f64]| m.solve(x).iter().zip(x).map(|(a, b)| a * b).sum::<f64>();
        -rows.chunks_exact(22).map(one).sum::<f64>().ln()
    });
}

#[test]
fn measured_rows_count_and_change_the_choice() {
    let rows = cubic(400);
    let free = DSettings {
        n: 60,
        starts: 2,
        iterations: 20,
        ..DSettings::default()
    };
    assert!(matches!(
        d_optimal(&rows, 1, 84, &free, &Control::new()),
        Err(DesignError::TooFew {
            n: 60,
            needed: 84,
            ..
        })
    ));
    let settings = DSettings {
        measured: rows[..84 * 100].to_vec(),
        exclude: (0..100).collect(),
        ..free
    };
    let design = d_optimal(&rows, 1, 84, &settings, &Control::new()).unwrap();
    let all: Vec<usize> = (0..100).chain(design.indices.iter().copied()).collect();
    let fresh = InformationMatrix::new(&gram(&rows, 84, &all), 84).unwrap();
    assert!((fresh.log_det() / 84.0 - 160f64.ln() - design.value).abs() < 1e-10);
    assert!(design.indices.iter().all(|&i| i >= 100) && design.efficiency > 0.9);
}

#[test]
fn a_prior_allows_fewer_rows_than_coefficients() {
    let rows = cubic(400);
    let mut prior = vec![0.0; 84 * 84];
    for i in 0..84 {
        prior[i * 84 + i] = 0.1;
    }
    let settings = DSettings {
        n: 40,
        starts: 3,
        iterations: 30,
        prior: Some(prior),
        ..DSettings::default()
    };
    let design = d_optimal(&rows, 1, 84, &settings, &Control::new()).unwrap();
    let mut m = gram(&rows, 84, &design.indices);
    for i in 0..84 {
        m[i * 84 + i] += 0.1;
    }
    let fresh = InformationMatrix::new(&m, 84).unwrap();
    assert!((fresh.log_det() / 84.0 - 40f64.ln() - design.value).abs() < 1e-9);
    assert!(design.efficiency <= 1.0);
    // No single swap is better: 40 rows cannot reach the bound of 84 directions.
    let row = |i: usize| &rows[84 * i..84 * (i + 1)];
    for &i in &design.indices {
        for j in (0..400).filter(|j| !design.indices.contains(j)) {
            assert!(fresh.growth(row(i), row(j)) < 1.0 + 1e-5, "{i} {j}");
        }
    }
}

#[test]
fn wrong_input_is_refused_with_a_message() {
    let rows = cubic(200);
    let go = |rows: &[f64], settings: DSettings| d_optimal(rows, 1, 84, &settings, &Control::new());
    let n = |n| DSettings {
        n,
        starts: 1,
        iterations: 1,
        ..DSettings::default()
    };
    assert!(matches!(
        go(&rows, n(50)),
        Err(DesignError::TooFew { needed: 84, .. })
    ));
    assert!(matches!(
        go(&rows, n(201)),
        Err(DesignError::TooMany {
            n: 201,
            candidates: 200
        })
    ));
    assert!(matches!(go(&rows, n(0)), Err(DesignError::Small { .. })));
    assert!(matches!(go(&[], n(100)), Err(DesignError::Empty)));
    assert!(matches!(
        go(&rows[..100], n(100)),
        Err(DesignError::Shape { .. })
    ));
    let mut broken = rows.clone();
    broken[84 * 17 + 5] = f64::NAN;
    assert!(matches!(
        go(&broken, n(100)),
        Err(DesignError::NotFinite {
            row: 17,
            column: 5,
            ..
        })
    ));
    let mut same = rows.clone();
    for row in same.chunks_exact_mut(84) {
        row[40] = 2.0 * row[7] - row[3];
    }
    let error = go(&same, n(100)).unwrap_err();
    assert!(
        matches!(error, DesignError::RankDeficient { column: 40, .. }),
        "{error}"
    );
    let list = |include: Vec<usize>, exclude: Vec<usize>| DSettings {
        include,
        exclude,
        ..n(100)
    };
    assert!(matches!(
        go(&rows, list(vec![200], vec![])),
        Err(DesignError::Index { index: 200, .. })
    ));
    assert!(matches!(
        go(&rows, list(vec![4, 4], vec![])),
        Err(DesignError::Contradiction { index: 4, .. })
    ));
    assert!(matches!(
        go(&rows, list(vec![4], vec![4])),
        Err(DesignError::Contradiction { index: 4, .. })
    ));
    assert!(matches!(
        go(&rows, list((0..101).collect(), vec![])),
        Err(DesignError::IncludeTooLong { .. })
    ));
    let settings = MaximinSettings {
        n: 1,
        ..MaximinSettings::default()
    };
    assert!(matches!(
        maximin(&[0.0, 1.0], 1, &settings, &Control::new()),
        Err(DesignError::Small { .. })
    ));
}

/// Duplicates: two copies of every row give the same determinant as one copy with repeats.
#[test]
fn duplicate_candidates_act_as_repeats() {
    let rows = Model::polynomial(&common::uniform(3, 40, 2), 2, &[-1.0; 2], &[1.0; 2])
        .unwrap()
        .rows;
    let twice = [rows.clone(), rows].concat();
    let settings = DSettings {
        n: 20,
        starts: 5,
        iterations: 100,
        ..DSettings::default()
    };
    let d = d_optimal(&twice, 1, 6, &settings, &Control::new()).unwrap();
    assert!(d.indices.windows(2).all(|p| p[0] < p[1]));
    assert!(d.efficiency > 0.98, "{}", d.efficiency);
    let points = [0.0, 0.0, 0.0, 1.0, 2.0, 2.0];
    let settings = MaximinSettings {
        n: 3,
        iterations: 5,
        ..MaximinSettings::default()
    };
    let d = maximin(&points, 1, &settings, &Control::new()).unwrap();
    assert_eq!((d.value, d.bound), (1.0, 1.0));
    let settings = MaximinSettings {
        n: 4,
        iterations: 5,
        ..MaximinSettings::default()
    };
    assert_eq!(
        maximin(&points, 1, &settings, &Control::new())
            .unwrap()
            .value,
        0.0
    );
}

#[test]
fn grids_where_random_starts_are_singular() {
    // One informative point among a thousand equal ones.
    let mut rows = vec![0.0; 1000 * 2];
    for row in rows.chunks_exact_mut(2) {
        row[0] = 1.0;
    }
    rows[2 * 500 + 1] = 1.0;
    for method in [Method::Fedorov, Method::RowWise, Method::Search] {
        let settings = DSettings {
            n: 4,
            starts: 2,
            iterations: 10,
            method,
            ..DSettings::default()
        };
        let d = d_optimal(&rows, 1, 2, &settings, &Control::new()).unwrap();
        assert!(d.indices.contains(&500), "{method:?}");
    }
}

#[test]
fn a_raised_flag_stops_the_search_with_a_design() {
    use std::sync::atomic::{AtomicBool, Ordering};
    let rows = cubic(300);
    let flag = AtomicBool::new(false);
    let report = |done: usize, _: usize, _: f64| {
        if done > 3 {
            flag.store(true, Ordering::Relaxed);
        }
    };
    let control = Control::new().with_cancel(&flag).with_progress(&report);
    let settings = DSettings {
        n: 100,
        starts: 2,
        iterations: usize::MAX / 2,
        ..DSettings::default()
    };
    let d = d_optimal(&rows, 1, 84, &settings, &control).unwrap();
    assert_eq!(d.status, ecm_doe::Status::Interrupted);
    assert_eq!(d.indices.len(), 100);
}
