//! Hostile loads, settings and constraints: an error or a status, never a panic nor an endless loop.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use common::{config, fem, hostile, mesh, neo, six};
use ecm_fem::output::vtu;
use ecm_fem::{
    Constraint, Fem, FemError, Formulation, Load, Outcome, Settings, Status, WarmStart, Watch,
};
use proptest::prelude::*;
use std::sync::atomic::AtomicBool;

/// With each treatment of the pressure.
fn of_formulation(formulation: Formulation) -> Fem {
    let settings = Settings {
        formulation,
        ..Settings::default()
    };
    Fem::with_settings(mesh(), neo(), None, settings).unwrap()
}

fn formulation() -> impl Strategy<Value = Formulation> {
    prop::sample::select(vec![
        Formulation::TaylorHood,
        Formulation::ConstantPressure,
        Formulation::Displacement,
    ])
}

/// Bytes of a warm start of degree 1, its coefficients all `value`.
fn warm_start(value: f32) -> WarmStart {
    let mut bytes: Vec<u8> = [1u32, 7, 6].iter().flat_map(|v| v.to_le_bytes()).collect();
    bytes.extend([1.0_f64; 6].iter().flat_map(|v| v.to_le_bytes()));
    let numbers = 7 * fem().field_length();
    bytes.extend((0..numbers).flat_map(|_| value.to_le_bytes()));
    WarmStart::from_bytes(&bytes).unwrap()
}

proptest! {
    #![proptest_config(config(24))]

    #[test]
    fn loads_end_with_a_status_or_an_error(values in six(), held: bool, formulation in formulation()) {
        let load = if held { Load::Pose(values) } else { Load::Wrench(values) };
        match of_formulation(formulation).solve_field(load, Watch::default()) {
            Ok((result, field)) => {
                prop_assert!(values.iter().all(|v| v.is_finite()));
                prop_assert!(result.has_state());
                prop_assert!(field.displacement.iter().all(|v| v.is_finite()));
                prop_assert_eq!(result.reason.is_some(), result.status == Status::Unstable);
            }
            Err(FemError::NotFinite { .. } | FemError::Parameter { .. }) => {}
            Err(other) => prop_assert!(false, "{other}"),
        }
    }

    #[test]
    fn batches_from_any_warm_start_end(values in six(), held: bool, coefficient in hostile()) {
        let fem = fem();
        let load = if held { Load::Pose(values) } else { Load::Wrench(values) };
        let guess = warm_start(coefficient as f32);
        match fem.solve_from(&[load, load], Some(&guess), Watch::default(), &|_, _| {}) {
            Ok(found) => {
                prop_assert_eq!(format!("{:?}", found[0].result), format!("{:?}", found[1].result));
                prop_assert!(!found.iter().any(Outcome::is_state) || found[0].result.has_state());
                let fields: Vec<&[f32]> = found.iter().map(|o| o.field.as_slice()).collect();
                prop_assert!(fem.fit_warm_start(&[load; 2], &fields, Watch::default()).is_ok());
                prop_assert!(fem.predict_poses(&[load], &guess, Watch::default()).is_ok());
            }
            Err(FemError::NotFinite { .. } | FemError::Parameter { .. }) => {}
            Err(other) => prop_assert!(false, "{other}"),
        }
    }

    #[test]
    fn bodies_under_any_weight_end_with_a_status(force in prop::array::uniform3(hostile())) {
        if let Ok(body) = fem().with_body_force(force) {
            let result = body.solve_wrench(&[0.0; 6]).unwrap();
            prop_assert_eq!(result.status == Status::Solved, body.rest_stiffness(Watch::default()).is_ok());
            prop_assert_eq!(result.status == Status::Solved, result.has_state());
        }
    }

    #[test]
    fn any_components_may_be_prescribed(
        kinds in prop::collection::vec(0..4u8, 16),
        value in hostile(),
        force in hostile(),
        formulation in formulation(),
    ) {
        let settings = Settings { formulation, ..Settings::default() };
        let components = 3 * mesh().nodes_m().len();
        let constraints: Vec<Constraint> = (0..components)
            .map(|i| match kinds[i % 16] {
                0 => Constraint::Free,
                3 => Constraint::Platform,
                _ => Constraint::Prescribed,
            })
            .collect();
        let body = Fem::with_prescribed(mesh(), neo(), settings, &constraints);
        let Ok(body) = body.and_then(|b| b.with_dead_force(vec![force; components])) else {
            return Ok(());
        };
        if let Ok(result) = body.solve_prescribed(&vec![value; components], Watch::default()) {
            prop_assert!((0.0..=1.0).contains(&result.share));
        }
        let _ = body.rest_stiffness(Watch::default());
    }
}

proptest! {
    #![proptest_config(config(200))]

    #[test]
    fn settings_are_checked(tolerance in hostile(), limit in hostile(), smallest in hostile(), iterations: usize) {
        let settings = Settings {
            tolerance,
            iterations,
            step_limit: limit,
            smallest_load_step: smallest,
            ..Settings::default()
        };
        let good = settings.validate().is_ok();
        prop_assert!(!good || (tolerance > 0.0 && limit > 0.0 && smallest > 0.0 && iterations > 0));
        prop_assert_eq!(Fem::with_settings(mesh(), neo(), None, settings).is_ok(), good);
    }

    #[test]
    fn warm_starts_of_any_bytes_are_read_or_refused(
        bytes in prop::collection::vec(any::<u8>(), 0..400),
        degree in 0..2000u32,
    ) {
        let _ = WarmStart::from_bytes(&bytes);
        // Degree 1 has 7 terms, degree 5 has 462; a degree of 1000 would ask for all memory.
        for (of_degree, terms) in [(1, 7), (5, 462)] {
            let mut head: Vec<u8> = [degree, terms].iter().flat_map(|v: &u32| v.to_le_bytes()).collect();
            head.extend([0; 48]);
            head.extend(vec![0; 4 * terms as usize]);
            prop_assert_eq!(WarmStart::from_bytes(&head).is_some(), degree == of_degree);
        }
    }
}

/// Without pressures there is no unknown left.
#[test]
fn a_body_whose_displacements_are_all_given_is_solved() {
    let settings = Settings {
        formulation: Formulation::Displacement,
        ..Settings::default()
    };
    let components = 3 * mesh().nodes_m().len();
    let mut constraints = vec![Constraint::Prescribed; components];
    constraints[components - 3..].fill(Constraint::Platform);
    let body = Fem::with_prescribed(mesh(), neo(), settings, &constraints).unwrap();
    let result = body.solve_prescribed(&vec![0.0; components], Watch::default());
    assert_eq!(result.unwrap().status, Status::Solved);
    // A wrench of 1e30 N on one node turns the body inside out.
    let pushed = body
        .solve_wrench(&[-1e30, 0.0, 0.0, 0.0, 0.0, 0.0])
        .unwrap();
    assert_ne!(pushed.status, Status::Solved);
}

#[test]
fn each_wrong_setting_is_named() {
    let good = Settings::default();
    for (wrong, word) in [
        (
            Settings {
                tolerance: f64::NAN,
                ..good.clone()
            },
            "tolerance is NaN",
        ),
        (
            Settings {
                tolerance: -1e-9,
                ..good.clone()
            },
            "tolerance is -0.000000001",
        ),
        (
            Settings {
                iterations: 0,
                ..good.clone()
            },
            "iterations is 0",
        ),
        (
            Settings {
                step_limit: 0.0,
                ..good.clone()
            },
            "step_limit is 0",
        ),
        (
            Settings {
                smallest_load_step: 1e-300,
                ..good.clone()
            },
            "smallest_load_step",
        ),
    ] {
        let components = vec![Constraint::Free; 3 * mesh().nodes_m().len()];
        for error in [
            wrong.validate().unwrap_err(),
            Fem::with_settings(mesh(), neo(), None, wrong.clone()).unwrap_err(),
            Fem::with_prescribed(mesh(), neo(), wrong.clone(), &components).unwrap_err(),
        ] {
            assert!(error.to_string().contains(word), "{error}");
        }
    }
}

#[test]
fn wrenches_and_poses_are_not_mixed() {
    let fem = fem();
    let loads = [
        Load::Wrench([1.0; 6]),
        Load::Wrench([2.0; 6]),
        Load::Pose([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]),
    ];
    let (watch, guess) = (Watch::default(), warm_start(0.0));
    let field = vec![0.0_f32; fem.field_length()];
    let fields = [field.as_slice(); 3];
    for error in [
        fem.solve_all(&loads, watch).unwrap_err(),
        fem.solve_from(&loads, None, watch, &|_, _| {}).unwrap_err(),
        fem.fit_warm_start(&loads, &fields, watch).unwrap_err(),
        fem.predict_poses(&loads, &guess, watch).unwrap_err(),
    ] {
        let (found, first) = ("pose", "wrench");
        assert_eq!(
            error,
            FemError::MixedLoads {
                row: 2,
                found,
                first
            }
        );
    }
}

#[test]
fn a_set_flag_ends_every_long_work() {
    let cancel = AtomicBool::new(true);
    let watch = Watch {
        cancel: Some(&cancel),
        done: None,
    };
    let heavy = fem().with_body_force([-1e4, 0.0, 0.0]).unwrap();
    for body in [fem(), heavy] {
        for load in [
            Load::Wrench([5.0; 6]),
            Load::Pose([0.1, 0.0, 0.0, 0.0, 0.1, 0.0]),
        ] {
            let all = body.solve_all(&[load; 3], watch).unwrap();
            assert!(all.iter().all(|r| r.status == Status::Cancelled));
            let (one, _) = body.solve_field(load, watch).unwrap();
            assert_eq!(one.status, Status::Cancelled);
            let field = vec![0.0; body.field_length()];
            for error in [
                body.fit_warm_start(&[load], &[&field], watch).map(|_| ()),
                body.predict_poses(&[load], &warm_start(0.0), watch)
                    .map(|_| ()),
                body.rest_stiffness(watch).map(|_| ()),
            ] {
                assert_eq!(error.unwrap_err(), FemError::Cancelled);
            }
        }
        let still = vec![0.0; 3 * body.mesh().nodes_m().len()];
        let result = body.solve_prescribed(&still, watch).unwrap();
        assert_eq!(result.status, Status::Cancelled);
    }
}

#[test]
fn a_field_of_another_body_is_not_drawn() {
    let fem = fem();
    let load = Load::Wrench([0.0; 6]);
    let (_, mut field) = fem.solve_field(load, Watch::default()).unwrap();
    assert!(vtu(fem.body(), &field).is_ok());
    field.pressure.pop();
    assert!(matches!(
        vtu(fem.body(), &field),
        Err(FemError::Size { .. })
    ));
    field.displacement.clear();
    assert!(matches!(
        vtu(fem.body(), &field),
        Err(FemError::Size { .. })
    ));
}
