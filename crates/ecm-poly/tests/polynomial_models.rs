//! The paper's polynomials: recovery, naive agreement, Jacobian, condition numbers, methods.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_poly::basis::{exponents, number_of_terms};
use ecm_poly::dense::singular_values;
use ecm_poly::polynomial_model::polynomial_regressor;
use ecm_poly::{Method, PolynomialModel};
use proptest::prelude::*;

/// A fixed stream of numbers in [−1, 1].
fn stream(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1;
    move || {
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        (state >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

/// Poses as a neck has them: position and bending go together, so X is nearly collinear.
fn poses(rows: usize, seed: u64) -> Vec<f64> {
    let mut next = stream(seed);
    (0..rows)
        .flat_map(|_| {
            let bend = [0.8 * next(), 0.8 * next(), 0.8 * next()];
            let r = [
                0.1034 + 0.003 * next(),
                0.05 * bend[2] + 0.004 * next(),
                -0.05 * bend[1] + 0.004 * next(),
            ];
            [r[0], r[1], r[2], bend[0], bend[1], bend[2]]
        })
        .collect()
}

/// Solves A x = b by elimination with pivots, rows of A first.
fn eliminate(mut a: Vec<Vec<f64>>, mut b: Vec<f64>) -> Vec<f64> {
    let n = b.len();
    for c in 0..n {
        let p = (c..n)
            .max_by(|&i, &j| a[i][c].abs().total_cmp(&a[j][c].abs()))
            .unwrap();
        a.swap(c, p);
        b.swap(c, p);
        for r in c + 1..n {
            let f = a[r][c] / a[c][c];
            for k in c..n {
                a[r][k] -= f * a[c][k];
            }
            b[r] -= f * b[c];
        }
    }
    for c in (0..n).rev() {
        b[c] = (b[c] - (c + 1..n).map(|k| a[c][k] * b[k]).sum::<f64>()) / a[c][c];
    }
    b
}

#[test]
fn naive_monomials_and_normal_equations_agree() {
    let mut next = stream(3);
    let points: Vec<f64> = (0..80 * 2).map(|_| next()).collect();
    let values: Vec<f64> = points
        .chunks(2)
        .flat_map(|p| [(2.0 * p[0]).sin() + p[1], p[0] * p[1].exp()])
        .collect();
    let model =
        PolynomialModel::fit(&points, 2, &values, 2, 3, Method::LeastSquares, None).unwrap();
    let naive = |p: &[f64]| -> Vec<f64> {
        let u: Vec<f64> = (0..2)
            .map(|i| 2.0 * (p[i] - model.lower()[i]) / (model.upper()[i] - model.lower()[i]) - 1.0)
            .collect();
        exponents(2, 3)
            .unwrap()
            .chunks(2)
            .map(|e| u[0].powi(i32::from(e[0])) * u[1].powi(i32::from(e[1])))
            .collect()
    };
    let x: Vec<Vec<f64>> = points.chunks(2).map(naive).collect();
    let library = polynomial_regressor(&points, 3, model.lower(), model.upper()).unwrap();
    for (a, b) in library.iter().zip(x.iter().flatten()) {
        assert!((a - b).abs() < 1e-14);
    }
    for lambda in [0.0, 0.7] {
        let method = if lambda == 0.0 {
            Method::LeastSquares
        } else {
            Method::Ridge(lambda)
        };
        let model = PolynomialModel::fit(&points, 2, &values, 2, 3, method, None).unwrap();
        for output in 0..2 {
            let gram = (0..10)
                .map(|i| {
                    (0..10)
                        .map(|j| {
                            x.iter().map(|r| r[i] * r[j]).sum::<f64>()
                                + if i == j { lambda } else { 0.0 }
                        })
                        .collect()
                })
                .collect();
            let side = (0..10)
                .map(|i| {
                    x.iter()
                        .zip(values.chunks(2))
                        .map(|(r, v)| r[i] * v[output])
                        .sum()
                })
                .collect();
            for (t, expected) in eliminate(gram, side).iter().enumerate() {
                assert!((model.coefficients()[2 * t + output] - expected).abs() < 1e-9);
            }
        }
    }
}

#[test]
fn condition_falls_with_normalisation_and_with_the_threshold() {
    let points = poses(400, 5);
    let values: Vec<f64> = points
        .chunks(6)
        .map(|p| (3.0 * p[5]).sin() * p[0] + p[1])
        .collect();
    let fit = |method| PolynomialModel::fit(&points, 6, &values, 1, 3, method, None).unwrap();
    let ordinary = fit(Method::LeastSquares);
    let facts = ordinary.facts();
    assert_eq!((ordinary.coefficients().len(), facts.rank), (84, 84));
    let raw = PolynomialModel::condition_number_raw(&points, 6, 3).unwrap();
    assert!(raw > 100.0 * facts.condition_number);
    let x = polynomial_regressor(&points, 3, ordinary.lower(), ordinary.upper()).unwrap();
    let sigma = singular_values(&x, 84).unwrap();
    assert!((facts.condition_number / (sigma[0] / sigma[83]) - 1.0).abs() < 1e-9);
    let mut last = facts.condition_number;
    for b in [0.3, 1.0] {
        let reduced = fit(Method::Pcr(b));
        let kept = sigma.iter().filter(|&&s| s >= b).count();
        assert_eq!(reduced.facts().rank, kept);
        assert!(kept < 84 && reduced.facts().condition_number < last);
        assert!(reduced.facts().condition_number <= sigma[0] / b);
        last = reduced.facts().condition_number;
    }
    let (a, b) = (fit(Method::Pcr(0.0)), &ordinary);
    assert_eq!(a.coefficients(), b.coefficients());
    assert!(PolynomialModel::fit(&points, 6, &values, 1, 3, Method::Pcr(1e6), None).is_err());
}

#[test]
fn a_weight_of_zero_leaves_the_row_out() {
    let mut points = poses(120, 6);
    let mut values: Vec<f64> = points.chunks(6).map(|p| p[0] * p[5] + p[2]).collect();
    let clean =
        PolynomialModel::fit(&points, 6, &values, 1, 2, Method::LeastSquares, None).unwrap();
    let copy = points[..6].to_vec();
    points.extend(copy);
    values.push(1e3);
    let mut weights = vec![2.0; 120];
    weights.push(0.0);
    let weighted = PolynomialModel::fit(
        &points,
        6,
        &values,
        1,
        2,
        Method::LeastSquares,
        Some(&weights),
    )
    .unwrap();
    for (a, b) in clean.coefficients().iter().zip(weighted.coefficients()) {
        assert!((a - b).abs() < 1e-9);
    }
    weights[7] = -1.0;
    let message = PolynomialModel::fit(
        &points,
        6,
        &values,
        1,
        2,
        Method::LeastSquares,
        Some(&weights),
    )
    .unwrap_err()
    .to_string();
    assert!(message.contains("-1 in row 7"), "{message}");
}

#[test]
fn an_input_that_never_moves_tells_nothing() {
    let mut points = poses(60, 8);
    points.chunks_mut(6).for_each(|p| p[3] = 0.25);
    let values: Vec<f64> = points.chunks(6).map(|p| p[1] - p[5]).collect();
    let model =
        PolynomialModel::fit(&points, 6, &values, 1, 1, Method::LeastSquares, None).unwrap();
    assert_eq!(model.facts().rank, 6);
    let p = [0.1, 0.01, 0.0, 0.9, 0.1, 0.2];
    assert!((model.predict(&p).unwrap()[0] - (p[1] - p[5])).abs() < 1e-12);
    assert!(model.jacobian(&p).unwrap()[3].abs() < 1e-15);
}

proptest! {
    #![proptest_config(common::config(40))]

    #[test]
    fn polynomials_are_found_and_differentiated(
        inputs in 1usize..7, degree in 0usize..4, outputs in 1usize..7, seed in 0u64..1000,
    ) {
        let k = number_of_terms(inputs, degree).unwrap();
        let mut next = stream(seed);
        let lower: Vec<f64> = (0..inputs).map(|_| next() - 1.5).collect();
        let upper: Vec<f64> = lower.iter().map(|l| l + 1.0 + next().abs()).collect();
        let coefficients: Vec<f64> = (0..k * outputs).map(|_| next()).collect();
        let truth = PolynomialModel::from_coefficients(degree, &lower, &upper, &coefficients).unwrap();
        let points: Vec<f64> = (0..(2 * k + 6) * inputs)
            .map(|i| lower[i % inputs] + (upper[i % inputs] - lower[i % inputs]) * 0.5 * (1.0 + next()))
            .collect();
        let values = truth.predict(&points).unwrap();
        let found = PolynomialModel::fit(&points, inputs, &values, outputs, degree, Method::LeastSquares, None).unwrap();
        let fresh: Vec<f64> = lower.iter().zip(&upper).map(|(l, u)| 0.5 * (l + u) + 0.1 * next()).collect();
        for (a, b) in found.predict(&fresh).unwrap().iter().zip(truth.predict(&fresh).unwrap()) {
            prop_assert!((a - b).abs() < 1e-7, "{a} {b}");
        }
        let jacobian = truth.jacobian(&fresh).unwrap();
        for i in 0..inputs {
            let e = 1e-3;
            let at = |s: f64| { let mut x = fresh.clone(); x[i] += s * e; truth.predict(&x).unwrap() };
            let (a, b, c, d) = (at(-2.0), at(-1.0), at(1.0), at(2.0));
            for j in 0..outputs {
                let rate = (a[j] - 8.0 * b[j] + 8.0 * c[j] - d[j]) / (12.0 * e);
                prop_assert!((rate - jacobian[j * inputs + i]).abs() < 1e-9 * (1.0 + rate.abs()));
            }
        }
    }
}

#[test]
fn a_row_of_weight_zero_is_no_observation() {
    let points = poses(90, 51);
    let values: Vec<f64> = points.chunks(6).map(|p| (5.0 * p[4]).sin()).collect();
    // The rows of weight zero are the widest ones, so that they would also move the ranges.
    let weights: Vec<f64> = (0..90).map(|i| f64::from(u8::from(i < 60))).collect();
    let mut far = points.clone();
    far[60 * 6..].iter_mut().for_each(|p| *p *= 3.0);
    let fit = |points: &[f64], values: &[f64], weights: Option<&[f64]>| {
        PolynomialModel::fit(points, 6, values, 1, 2, Method::LeastSquares, weights).unwrap()
    };
    let weighted = fit(&far, &values, Some(&weights));
    let alone = fit(&points[..60 * 6], &values[..60], None);
    assert_eq!(weighted.coefficients(), alone.coefficients());
    assert_eq!(weighted.lower(), alone.lower());
    let (own, other) = (weighted.facts(), alone.facts());
    assert_eq!(own.residual_variance, other.residual_variance);
    let few: Vec<f64> = (0..90).map(|i| f64::from(u8::from(i < 27))).collect();
    let method = Method::LeastSquares;
    let error = PolynomialModel::fit(&points, 6, &values, 1, 2, method, Some(&few)).unwrap_err();
    assert!(
        error.to_string().starts_with("27 equations for 28"),
        "{error}"
    );
    let one: Vec<f64> = (0..90).map(|i| f64::from(u8::from(i < 1))).collect();
    let error = PolynomialModel::fit(&points, 6, &values, 1, 2, method, Some(&one)).unwrap_err();
    assert!(
        error.to_string().starts_with("1 equation for 28"),
        "{error}"
    );
    let none = [0.0; 90];
    let error = PolynomialModel::fit(&points, 6, &values, 1, 2, method, Some(&none)).unwrap_err();
    assert!(error.to_string().contains("0 in every row"), "{error}");
}

#[test]
fn a_fit_of_no_outputs_is_refused() {
    let points = poses(40, 61);
    let error =
        PolynomialModel::fit(&points, 6, &[], 0, 2, Method::LeastSquares, None).unwrap_err();
    assert!(
        error.to_string().contains("outputs is 0 columns"),
        "{error}"
    );
    assert!(PolynomialModel::leave_one_out(&points, 6, &[], 0, 2).is_err());
}

#[test]
fn the_gram_of_the_factors_is_that_of_the_matrix() {
    let x = poses(40, 71);
    let svd = ecm_poly::dense::ThinSvd::new(&x, 6).unwrap();
    let gram = svd.gram(|_, s| s * s);
    for i in 0..6 {
        for j in 0..6 {
            let direct: f64 = x.chunks(6).map(|row| row[i] * row[j]).sum();
            assert!((gram[6 * i + j] - direct).abs() < 1e-12);
            assert_eq!(gram[6 * i + j], gram[6 * j + i]);
        }
    }
}

#[test]
fn leave_one_out_curves_are_those_of_leaving_out() {
    // With the components held fixed: refit on the scores U σ without the row, for every row.
    let points = poses(60, 11);
    let values: Vec<f64> = points
        .chunks(6)
        .flat_map(|p| [(4.0 * p[5]).sin() + p[1], p[3] * p[0] + p[4].cos()])
        .collect();
    let curves = PolynomialModel::leave_one_out(&points, 6, &values, 2, 2).unwrap();
    assert_eq!((curves.singular_values.len(), curves.rmse.len()), (28, 56));
    let model =
        PolynomialModel::fit(&points, 6, &values, 2, 2, Method::LeastSquares, None).unwrap();
    let x = polynomial_regressor(&points, 2, model.lower(), model.upper()).unwrap();
    let svd = ecm_poly::dense::ThinSvd::new(&x, 28).unwrap();
    let u = svd.left_vectors();
    for rank in [1, 5, 17, 28] {
        let score = |row: usize| -> Vec<f64> {
            (0..rank)
                .map(|j| u[28 * row + j] * svd.singular_values[j])
                .collect()
        };
        for output in 0..2 {
            let mut sum = 0.0;
            for left in 0..60 {
                let rows: Vec<usize> = (0..60).filter(|&i| i != left).collect();
                let gram = (0..rank)
                    .map(|a| {
                        (0..rank)
                            .map(|b| rows.iter().map(|&i| score(i)[a] * score(i)[b]).sum::<f64>())
                            .collect()
                    })
                    .collect();
                let side = (0..rank)
                    .map(|a| {
                        rows.iter()
                            .map(|&i| score(i)[a] * values[2 * i + output])
                            .sum()
                    })
                    .collect();
                let weights = eliminate(gram, side);
                let predicted: f64 = score(left).iter().zip(&weights).map(|(a, b)| a * b).sum();
                sum += (values[2 * left + output] - predicted).powi(2);
            }
            let direct = (sum / 60.0).sqrt();
            let found = curves.rmse[2 * (rank - 1) + output];
            assert!(
                (found / direct - 1.0).abs() < 1e-8,
                "rank {rank}: {found} {direct}"
            );
        }
    }
}

#[test]
fn ninety_five_percent_of_new_measurements_fall_into_the_interval() {
    let mut next = stream(21);
    let mut normal = move || (0..12).map(|_| next()).sum::<f64>() / 2.0;
    let truth = |p: &[f64]| 3.0 * p[1] - 2.0 * p[5] * p[5] + p[0] * p[3];
    let train = poses(150, 31);
    let values: Vec<f64> = train.chunks(6).map(|p| truth(p) + 0.2 * normal()).collect();
    let fresh = poses(2000, 41);
    for (method, tolerance) in [(Method::LeastSquares, 0.03), (Method::Pcr(0.05), 0.03)] {
        let model = PolynomialModel::fit(&train, 6, &values, 1, 2, method, None).unwrap();
        let s = model.facts().residual_variance[0].sqrt();
        assert!((s / 0.2 - 1.0).abs() < 0.2, "{s}");
        let (predicted, sd) = (
            model.predict(&fresh).unwrap(),
            model.prediction_sd(&fresh).unwrap(),
        );
        let inside = fresh
            .chunks(6)
            .zip(predicted.iter().zip(&sd))
            .filter(|(p, (h, sd))| (truth(p) + 0.2 * normal() - **h).abs() < 1.98 * **sd)
            .count();
        assert!(
            (inside as f64 / 2000.0 - 0.95).abs() < tolerance,
            "{method:?} {inside}"
        );
    }
    // The leverages of the training rows sum to the rank.
    let model = PolynomialModel::fit(&train, 6, &values, 1, 2, Method::LeastSquares, None).unwrap();
    let sum: f64 = model.leverage(&train).unwrap().iter().sum();
    assert!((sum - 28.0).abs() < 1e-9, "{sum}");
}

#[test]
fn a_column_that_is_constant_up_to_rounding_has_no_effect() {
    let next = f64::from_bits(0.1034_f64.to_bits() + 1);
    let rows: Vec<[f64; 2]> = (0..30)
        .map(|i| [f64::from(i), if i % 2 == 0 { 0.1034 } else { next }])
        .collect();
    let values: Vec<f64> = (0..30)
        .map(|i| 3.0 + f64::from(i) + 0.1 * f64::from(i % 2))
        .collect();
    let model = PolynomialModel::fit(
        rows.as_flattened(),
        2,
        &values,
        1,
        3,
        Method::LeastSquares,
        None,
    )
    .unwrap();
    let beside = model.predict(&[15.0, 0.1034 + 1e-9]).unwrap()[0];
    assert!((beside - 18.0).abs() < 0.1, "{beside}");
    assert_eq!(model.jacobian(&[15.0, 0.1034]).unwrap()[1], 0.0);
}
