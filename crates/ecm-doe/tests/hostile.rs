//! Hostile input: every search ends, with a finite design or a message that says what to do.

#![allow(clippy::unwrap_used)]

mod common;

use ecm_doe::{
    Control, DSettings, DesignError, MaximinSettings, Method, Status, d_optimal, i_optimal, maximin,
};

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
