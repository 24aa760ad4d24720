//! For any numbers whatever, every search ends with a finite design or with a message.

#![allow(clippy::unwrap_used)]

mod common;

use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

use ecm_doe::certificate::{CertificateSettings, continuous};
use ecm_doe::regressor::{Model, Regressor, column_ranges, normalise, prediction_region};
use ecm_doe::{
    Control, DSettings, Design, DesignError, InformationMatrix, MaximinSettings, Method, Problem,
    SpacingMethod, Status, a_optimal, compound_optimal, d_optimal, g_optimal, i_optimal, maximin,
};
use ecm_poly::{ModelError, Symmetry};
use proptest::collection::vec;
use proptest::prelude::*;

fn ordinary() -> impl Strategy<Value = f64> {
    prop_oneof![4 => -2.0..2.0, 1 => Just(0.0), 1 => Just(1.0)]
}

fn hostile() -> impl Strategy<Value = f64> {
    prop_oneof![
        20 => ordinary(),
        1 => Just(-0.0),
        1 => Just(1e200),
        1 => Just(-1e100),
        1 => Just(1e-200),
        1 => Just(5e-324),
        1 => Just(f64::INFINITY),
        1 => Just(f64::NAN),
    ]
}

/// `rows` x `columns` of ordinary numbers, of hostile ones, of one hostile number throughout, or of
/// rows and columns that repeat.
fn matrix(rows: usize, columns: usize) -> impl Strategy<Value = Vec<f64>> {
    let size = rows * columns;
    prop_oneof![
        4 => vec(ordinary(), size),
        2 => vec(hostile(), size),
        1 => hostile().prop_map(move |v| vec![v; size]),
        2 => vec(ordinary(), columns).prop_map(move |row| row.repeat(rows)),
        1 => (vec(ordinary(), size), hostile()).prop_map(move |(mut m, v)| {
            m.iter_mut().step_by(columns.max(1)).for_each(|x| *x = v);
            m
        }),
        1 => (vec(ordinary(), size), prop_oneof![Just(1e90), Just(1e-90), Just(1e-150)])
            .prop_map(|(m, s)| m.into_iter().map(|v| v * s).collect()),
        1 => vec(hostile(), 0..=size),
    ]
}

fn count() -> impl Strategy<Value = usize> {
    prop_oneof![8 => 1usize..4, 1 => Just(0), 1 => Just(usize::MAX)]
}

fn lists() -> impl Strategy<Value = Vec<usize>> {
    prop_oneof![
        3 => Just(std::vec![]),
        2 => vec(0usize..9, 0..8),
        1 => (0usize..9).prop_map(|n| (0..n).collect()),
        1 => (0usize..9).prop_map(|n| (n..9).collect()),
        1 => Just(std::vec![usize::MAX]),
    ]
}

prop_compose! {
    fn d_settings(k: usize)(
        n in prop_oneof![8 => 0usize..10, 1 => Just(usize::MAX)],
        starts in count(),
        iterations in 1usize..4,
        method in prop_oneof![Just(Method::Fedorov), Just(Method::RowWise), Just(Method::Search)],
        replicates: bool,
        include in lists(),
        exclude in lists(),
        measured in prop_oneof![3 => Just(vec![]), 1 => matrix(2, k)],
        prior in prop_oneof![3 => Just(None), 1 => matrix(k, k).prop_map(Some),
            1 => Just(Some((0..k * k).map(|i| f64::from(u8::from(i % (k + 1) == 0))).collect()))],
    ) -> DSettings {
        DSettings { n, starts, iterations, seed: 1, threads: 0, method, replicates, include, exclude,
            measured, prior }
    }
}

/// A refusal with words, or a design whose numbers are finite.
fn sound(found: Result<Design, DesignError>, n: usize) -> Result<(), TestCaseError> {
    match found {
        Err(error) => prop_assert!(error.to_string().len() > 20),
        Ok(design) => {
            prop_assert_eq!(design.indices.len(), n);
            for number in [design.value, design.bound, design.efficiency, design.gap] {
                prop_assert!(number.is_finite(), "{:?}", design);
            }
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(common::config(150))]

    #[test]
    fn every_criterion_ends(
        ((k, block), rows, settings, region) in (1usize..4, prop_oneof![4 => 1usize..3, 1 => Just(0), 1 => Just(usize::MAX)])
            .prop_flat_map(|(k, block)| {
                let width = k * block.min(2);
                (Just((k, block)), matrix(8, width), d_settings(k), matrix(2, width))
            }),
        share in prop_oneof![Just(0.0), Just(0.5), Just(1.0), hostile()],
        stopped: bool,
    ) {
        let flag = AtomicBool::new(stopped);
        let control = Control::new().with_cancel(&flag);
        let n = settings.n;
        let region = (region.len() % 2 == 0).then_some(region.as_slice());
        sound(d_optimal(&rows, block, k, &settings, &control), n)?;
        sound(a_optimal(&rows, block, k, &settings, &control), n)?;
        sound(g_optimal(&rows, block, k, &settings, &control), n)?;
        sound(i_optimal(&rows, block, k, region, &settings, &control), n)?;
        sound(compound_optimal(&rows, block, k, share, region, &settings, &control), n)?;
    }

    #[test]
    fn maximin_ends(
        (columns, points, measured) in (0usize..4).prop_flat_map(|c| {
            (Just(c), matrix(9, c), prop_oneof![3 => Just(vec![]), 1 => matrix(2, c)])
        }),
        n in prop_oneof![8 => 0usize..10, 1 => Just(usize::MAX)],
        starts in count(),
        include in lists(),
        exclude in lists(),
        exchange: bool,
        stopped: bool,
    ) {
        let flag = AtomicBool::new(stopped);
        let method = if exchange { SpacingMethod::Exchange } else { SpacingMethod::Search };
        let settings = MaximinSettings {
            n, starts, iterations: 1, seed: 2, threads: 0, method, include, exclude, measured,
        };
        sound(maximin(&points, columns, &settings, &Control::new().with_cancel(&flag)), n)?;
    }

    #[test]
    fn certificates_and_information_matrices_end(
        k in 0usize..4,
        numbers in vec(hostile(), 0..16),
        n in prop_oneof![4 => 0usize..6, 1 => Just(usize::MAX)],
        cap in prop_oneof![Just(1.0), Just(f64::INFINITY), hostile()],
        tolerance in prop_oneof![Just(1e-9), hostile()],
        iterations in 0usize..5,
    ) {
        if let Ok(mut m) = InformationMatrix::new(&numbers, k) {
            let row = vec![1.0; k];
            prop_assert!(!m.growth(&row, &row).is_nan() && !m.exchange(&row, &row).is_nan());
        }
        let Ok(problem) = Problem::new(&numbers, 1, k, None) else { return Ok(()) };
        let settings = CertificateSettings { tolerance, iterations };
        if let Ok(found) = continuous(&problem, n, cap, &settings, &Control::new()) {
            prop_assert!(found.merit.is_finite() && found.bound.is_finite(), "{:?}", found);
        }
    }

    #[test]
    fn regressors_end(
        columns in 0usize..3,
        points in vec(hostile(), 0..12),
        degree in prop_oneof![4 => 0usize..5, 1 => Just(usize::MAX)],
        length_m in hostile(),
        ranges in vec(hostile(), 0..6),
    ) {
        let (lower, upper) = column_ranges(&points, columns);
        let other = ranges.split_at(ranges.len() / 2);
        for (low, high) in [(lower.as_slice(), upper.as_slice()), other] {
            for rows in [Model::polynomial(&points, degree, low, high).map(|r| r.rows), normalise(&points, low, high)] {
                prop_assert!(rows.is_err() || rows.unwrap().iter().all(|v| v.is_finite()));
            }
            let rows_of = |p: &[f64]| Model::polynomial(p, degree, low, high);
            let region = prediction_region(&points, low, high, rows_of);
            prop_assert!(region.is_err() || region.unwrap().iter().all(|v| v.is_finite()));
        }
        // Rows of a caller's own function, of any number and with any number of terms.
        let own = |p: &[f64]| {
            let rows = p[..p.len().min(degree)].to_vec();
            Ok::<_, ModelError>(Regressor { rows, block: 0, terms: columns })
        };
        let _ = prediction_region(&points, &lower, &upper, own);
        let poses: Vec<[f64; 6]> = points.chunks_exact(6).map(|p| p.try_into().unwrap()).collect();
        let found = Model::energy(&poses, degree, Symmetry::Alike, length_m);
        prop_assert!(found.is_err() || found.unwrap().rows.iter().all(|v| v.is_finite()));
    }
}

/// Nine of 60 points of a quadratic in two coordinates, with a budget that never ends.
fn endless(report: &(dyn Fn(usize, usize, f64) + Sync), flag: &AtomicBool) -> Vec<Design> {
    let x = |i: usize, by: f64| (i as f64 * by).fract() - 0.5;
    let points: Vec<f64> = (0..60).flat_map(|i| [x(i, 0.618), x(i, 0.414)]).collect();
    let rows = Model::polynomial(&points, 2, &[-0.5; 2], &[0.5; 2])
        .unwrap()
        .rows;
    let control = Control::new().with_cancel(flag).with_progress(report);
    let settings = DSettings {
        n: 9,
        iterations: usize::MAX,
        ..DSettings::default()
    };
    let spread = MaximinSettings {
        n: 9,
        iterations: usize::MAX,
        ..MaximinSettings::default()
    };
    let run = |design: Result<Design, DesignError>| {
        flag.store(false, Ordering::Relaxed);
        design.unwrap()
    };
    vec![
        run(d_optimal(&rows, 1, 6, &settings, &control)),
        run(a_optimal(&rows, 1, 6, &settings, &control)),
        run(g_optimal(&rows, 1, 6, &settings, &control)),
        run(d_optimal(
            &rows,
            2,
            6,
            &DSettings {
                n: 5,
                ..settings.clone()
            },
            &control,
        )),
        run(maximin(&points, 2, &spread, &control)),
    ]
}

#[test]
fn a_flag_raised_after_some_calls_stops_every_search() {
    for after in [1, 7, 40] {
        let (flag, calls) = (AtomicBool::new(false), AtomicUsize::new(0));
        let report = |_: usize, _: usize, _: f64| {
            if calls.fetch_add(1, Ordering::Relaxed) % after == after - 1 {
                flag.store(true, Ordering::Relaxed);
            }
        };
        for design in endless(&report, &flag) {
            assert!(
                matches!(design.status, Status::Interrupted | Status::Converged),
                "{design:?}"
            );
        }
        assert!(calls.load(Ordering::Relaxed) >= after);
    }
}
