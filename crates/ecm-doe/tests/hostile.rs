//! Hostile input: every search ends, with a finite design or a message that says what to do.

#![allow(clippy::unwrap_used)]

mod common;

use ecm_doe::regressor::{Model, Regressor, prediction_region};
use ecm_doe::{
    Control, DSettings, DesignError, MaximinSettings, Method, Status, d_optimal, i_optimal, maximin,
};
use ecm_poly::{ModelError, Symmetry};

fn line() -> Vec<f64> {
    let x = (0..21).map(|i| f64::from(i) / 10.0 - 1.0);
    x.flat_map(|x| [1.0, x, x * x]).collect()
}

fn settings(n: usize) -> DSettings {
    DSettings {
        n,
        iterations: 5,
        starts: 2,
        ..DSettings::default()
    }
}

#[test]
fn a_region_without_information_or_with_too_much_is_refused() {
    let rows = line();
    let run = |size: f64| {
        let region = vec![size; 6];
        i_optimal(&rows, 1, 3, Some(&region), &settings(4), &Control::new())
    };
    let none = run(0.0).unwrap_err();
    assert!(
        matches!(none, DesignError::Information { found: 0.0, .. }),
        "{none}"
    );
    assert!(run(1e-200).unwrap_err().to_string().contains("the region"));
    let huge = run(1e200).unwrap_err().to_string();
    assert!(
        huge.contains("the region: row 0, column 0 is 1e200"),
        "{huge}"
    );
    assert!(run(1.0).is_ok());
}

#[test]
fn rows_of_another_size_than_the_candidates_are_refused() {
    // Beside measured rows of 1e90 the variance of a region of 1e-90 was 0, its efficiency NaN.
    let rows = [0.0, 1.0, -1.0, 1.0];
    let run = |measured: f64, region: f64| {
        let own = DSettings {
            measured: vec![0.0, measured],
            ..settings(1)
        };
        i_optimal(&rows, 1, 1, Some(&[0.0, region]), &own, &Control::new())
    };
    for (measured, region, what) in [
        (1.2875834758698162e90, -1.8203327687535403e-90, "the region"),
        (-1e100, 4.962458510730786e-92, "the region"),
        (-1e100, 1.0, "the measured rows"),
    ] {
        let error = run(measured, region).unwrap_err().to_string();
        assert!(error.starts_with(what), "{error}");
        assert!(error.contains("expected 1e-100 to 1e100"), "{error}");
    }
    for (measured, region) in [(1e40, 1e-40), (1e40, 1e40), (1e-40, 1e-40)] {
        let design = run(measured, region).unwrap();
        assert!(design.value > 0.0 && design.efficiency <= 1.0, "{design:?}");
    }
}

#[test]
fn rows_that_overflow_in_units_of_the_noise_are_refused() {
    for (pose, degree, length_m) in [
        (
            [-1e100, -1e100, 0.0, 1.0, 0.0, 1.0],
            3,
            0.0019387628761833352,
        ),
        ([0.0, 0.0, -1e100, 0.0, 1e-200, 0.0], 4, 0.01523400665369776),
    ] {
        let found = Model::energy(&[pose], degree, Symmetry::Alike, length_m);
        let error = found.unwrap_err().to_string();
        assert!(error.starts_with("the regressor: row"), "{error}");
    }
    // Finite terms whose change over a range of 1 is not.
    let point = |by: f64| {
        Ok::<_, ModelError>(Regressor {
            rows: vec![1.5e305 * by],
            block: 1,
            terms: 1,
        })
    };
    let region = prediction_region(&[1e3], &[0.0], &[1e3], |p| point(p[0]));
    let error = region.unwrap_err().to_string();
    assert!(error.starts_with("the region: row"), "{error}");
}

#[test]
fn included_poses_alone_are_the_design_or_singular() {
    // Poses 0 and 1 are nearly the same: with everything else excluded nothing can be exchanged.
    let mut rows = vec![1.0, 0.5, 1.0, 0.5 + 1e-6, 1.0, -0.5, 1.0, 0.9];
    for method in [Method::Fedorov, Method::RowWise, Method::Search] {
        let own = DSettings {
            include: vec![0, 1],
            exclude: vec![2, 3],
            method,
            ..settings(2)
        };
        let found = d_optimal(&rows, 1, 2, &own, &Control::new());
        assert_eq!(found.unwrap_err(), DesignError::Singular { n: 2, terms: 2 });
    }
    rows[3] = -0.5;
    for method in [Method::Fedorov, Method::RowWise, Method::Search] {
        let own = DSettings {
            include: vec![0, 1],
            exclude: vec![2, 3],
            method,
            ..settings(2)
        };
        let found = d_optimal(&rows, 1, 2, &own, &Control::new()).unwrap();
        assert_eq!(found.indices, [0, 1]);
        assert!((found.efficiency - 1.0).abs() < 1e-9);
    }
}

#[test]
fn distances_of_any_scale() {
    let run = |scale: f64| {
        let points: Vec<f64> = (0..11).map(|i| scale * (0.1 * f64::from(i))).collect();
        let settings = MaximinSettings {
            n: 3,
            iterations: 2,
            ..MaximinSettings::default()
        };
        maximin(&points, 1, &settings, &Control::new())
    };
    for scale in [1e-300, 1e-200, 1.0, 1e90] {
        let design = run(scale).unwrap();
        assert_eq!(design.indices, [0, 5, 10], "{scale}");
        assert!(
            (design.value / (0.5 * scale) - 1.0).abs() < 1e-12,
            "{scale}"
        );
        assert_eq!(design.status, Status::Converged);
    }
    let refused = run(1e200).unwrap_err().to_string();
    assert!(
        refused.contains("the points: row 10, column 0 is 1e200"),
        "{refused}"
    );
}
