//! For any numbers whatever, fits and predictions are finite or refused with a message.

#![allow(clippy::unwrap_used)]

mod common;

use ecm_poly::dense::{ThinSvd, condition_number, singular_values};
use ecm_poly::energy::groups::Group;
use ecm_poly::polynomial_model::polynomial_regressor;
use ecm_poly::regression::solve;
use ecm_poly::{EnergyFit, EnergyModel, Method, ModelError, PolynomialModel, Symmetry};
use ecm_se3::stiffness::StiffnessKind;
use proptest::collection::vec;
use proptest::prelude::*;

fn hostile() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -2.0..2.0,
        2 => Just(0.0),
        1 => prop::sample::select(vec![-0.0, 1e200, -1e100, 1e60, 1e-200, 5e-324, f64::MAX,
            f64::INFINITY, f64::NAN]),
    ]
}

/// Ordinary, hostile, or one number throughout; sometimes of the wrong length.
fn numbers(size: usize) -> impl Strategy<Value = Vec<f64>> {
    prop_oneof![
        4 => vec(-2.0..2.0, size),
        2 => vec(hostile(), size),
        1 => hostile().prop_map(move |v| vec![v; size]),
        1 => (vec(-2.0..2.0, size), prop::sample::select(vec![1e99, 1e90, 1e-90, 1e-170]))
            .prop_map(|(m, s)| m.into_iter().map(|v| v * s).collect()),
        1 => vec(hostile(), 0..=size),
    ]
}

fn method() -> impl Strategy<Value = Method> {
    prop_oneof![
        Just(Method::LeastSquares),
        hostile().prop_map(Method::Ridge),
        hostile().prop_map(Method::Pcr),
    ]
}

/// A refusal with words, or finite numbers.
fn sound(found: Result<Vec<f64>, ModelError>) -> Result<(), TestCaseError> {
    match found {
        Err(error) => prop_assert!(error.to_string().len() > 15, "{}", error),
        Ok(values) => prop_assert!(values.iter().all(|v| v.is_finite()), "{:?}", values),
    }
    Ok(())
}

proptest! {
    #![proptest_config(common::config(400))]

    #[test]
    fn polynomials_are_finite_or_refused(
        (inputs, points, observations) in (0usize..4).prop_flat_map(|n| {
            (Just(n), numbers(12 * n), numbers(24))
        }),
        outputs in prop_oneof![8 => 1usize..3, 1 => Just(0), 1 => Just(usize::MAX)],
        degree in prop_oneof![8 => 0usize..4, 1 => Just(usize::MAX)],
        method in method(),
        weights in prop_oneof![2 => Just(None), 1 => numbers(12).prop_map(Some)],
        others in numbers(9),
    ) {
        let observations = &observations[..observations.len().min(12 * outputs.min(2))];
        let fitted = PolynomialModel::fit(
            &points, inputs, observations, outputs, degree, method, weights.as_deref(),
        );
        match fitted {
            Err(error) => sound(Err(error))?,
            Ok(model) => {
                sound(Ok(model.coefficients().to_vec()))?;
                sound(Ok(model.facts().unscaled_covariance.clone()))?;
                prop_assert!(model.facts().residual_variance.iter().all(|v| !v.is_infinite()));
                for at in [&points, &others] {
                    sound(model.predict(at))?;
                    sound(model.jacobian(at))?;
                    sound(model.leverage(at))?;
                }
            }
        }
        let curve = PolynomialModel::leave_one_out(&points, inputs, observations, outputs, degree);
        prop_assert!(curve.is_err() || curve.unwrap().rmse.iter().all(|v| !v.is_nan()));
        let raw = PolynomialModel::condition_number_raw(&points, inputs, degree);
        prop_assert!(raw.is_err() || raw.unwrap() >= 1.0);
        let (lower, upper) = others.split_at(others.len() / 2);
        sound(polynomial_regressor(&points, degree, lower, upper))?;
        if let Ok(model) = PolynomialModel::from_coefficients(degree, lower, upper, &points) {
            sound(model.predict(&others))?;
        }
    }

    #[test]
    fn energies_are_finite_or_refused(
        poses in numbers(24 * 6),
        wrenches in numbers(24 * 6),
        sigma in prop_oneof![2 => Just(None), 1 => vec(hostile(), 36).prop_map(Some),
            1 => hostile().prop_map(|v| Some((0..36).map(|i| if i % 7 == 0 { v } else { 0.0 }).collect()))],
        length_m in prop_oneof![4 => Just(0.1), 1 => hostile()],
        degree in prop_oneof![4 => 2usize..5, 1 => Just(0), 1 => Just(usize::MAX)],
        kind in prop::sample::select(vec![StiffnessKind::Partial]),
    ) {
        let six = |values: &[f64]| -> Vec<[f64; 6]> {
            values.chunks_exact(6).map(|p| p.try_into().unwrap()).collect()
        };
        let (poses, wrenches) = (six(&poses), six(&wrenches));
        let covariance: Option<Vec<[[f64; 6]; 6]>> = sigma.map(|s: Vec<f64>| {
            let one: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| s[6 * i + j]));
            vec![one; poses.len()]
        });
        let groups: [Group; 0] = [];
        let fit = EnergyFit {
            length_m,
            degree,
            symmetry: Symmetry::Alike,
            groups: &groups,
            covariance: covariance.as_deref(),
        };
        match fit.run(&poses, &wrenches) {
            Err(error) => sound(Err(error))?,
            Ok(model) => {
                sound(Ok(model.coefficients().to_vec()))?;
                sound(Ok(model.covariance().to_vec()))?;
                prop_assert!(!model.residual_variance().is_infinite());
                sound(model.predict(&poses).map(|w| w.into_flattened()))?;
                sound(model.predict(&wrenches).map(|w| w.into_flattened()))?;
                sound(model.energy(&wrenches))?;
                sound(model.stiffness(&wrenches, kind).map(|k| k.into_flattened().into_flattened()))?;
                sound(model.prediction_covariance(&wrenches).map(|k| k.into_flattened().into_flattened()))?;
            }
        }
        let scale = [length_m, 1.0];
        let given: Vec<f64> = wrenches.as_flattened().to_vec();
        if let Ok(model) = EnergyModel::from_coefficients(length_m, degree, Symmetry::Alike, scale, &given) {
            sound(model.predict(&poses).map(|w| w.into_flattened()))?;
        }
    }

    #[test]
    fn decompositions_are_finite_or_refused(
        matrix in numbers(24),
        columns in prop_oneof![8 => 1usize..7, 1 => Just(0), 1 => Just(usize::MAX)],
        outputs in prop_oneof![8 => 0usize..3, 1 => Just(usize::MAX)],
        method in method(),
    ) {
        let undefined = singular_values(&matrix, columns).is_ok_and(|s| s.iter().any(|v| v.is_nan()));
        prop_assert!(!undefined);
        prop_assert!(!condition_number(&matrix, columns).is_ok_and(f64::is_nan));
        if let Ok(factors) = ThinSvd::new(&matrix, columns) {
            let _ = solve(&factors, &matrix, outputs, method);
        }
    }
}
