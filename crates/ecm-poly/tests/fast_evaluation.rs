//! Fast evaluation gives what the term-by-term one gives, in double and single precision.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_poly::arithmetic::Plain;
use ecm_poly::cubic::Cubic;
use ecm_poly::energy::plan::{EnergyPlan, ROWS};
use ecm_poly::energy::terms::terms;
use ecm_poly::{EnergyModel, Polynomial, PolynomialModel, Symmetry};
use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Mat6, Pose};
use proptest::prelude::*;

fn point() -> impl Strategy<Value = [f64; 6]> {
    (
        prop::array::uniform3(-0.02..0.02_f64),
        prop::array::uniform3(-0.8..0.8_f64),
    )
        .prop_map(|(c, t)| [0.1 + c[0], c[1], c[2], t[0], t[1], t[2]])
}

fn wave(n: usize, seed: f64) -> Vec<f64> {
    (0..n)
        .map(|i| ((i as f64 + 1.0) * 12.9898 + seed).sin())
        .collect()
}

fn largest<'a>(values: impl IntoIterator<Item = &'a f64>) -> f64 {
    values.into_iter().fold(0.0, |m: f64, x| m.max(x.abs()))
}

/// dⁿ(vᵉ)/dvⁿ for n = 0, 1, 2.
fn power_derivative(v: f64, e: u8, order: i32) -> f64 {
    let e = i32::from(e);
    let factor: i32 = (0..order).map(|n| e - n).product();
    if e < order {
        0.0
    } else {
        f64::from(factor) * v.powi(e - order)
    }
}

/// U, h and K of an energy without groups, term by term.
fn term_by_term(
    model: &EnergyModel,
    pose: &Pose<f64>,
    kind: StiffnessKind,
) -> (f64, [f64; 6], Mat6<f64>) {
    let frame = MidFrame::new(pose, model.length_m());
    let (symmetry, scale) = (model.symmetry(), model.scale());
    let coordinates = frame.coordinates();
    let q = std::array::from_fn(|i| coordinates[i] / scale[i / 3]);
    let v = symmetry.variables(&q);
    let (mut energy, mut first, mut second) = (0.0, [0.0; 6], [[0.0; 6]; 6]);
    for (exponents, weight) in model.exponents().iter().zip(model.coefficients()) {
        let derivative = |by: &[usize]| -> f64 {
            let order = |i: usize| by.iter().filter(|&&j| j == i).count() as i32;
            (0..6)
                .map(|i| power_derivative(v[i], exponents[i], order(i)))
                .product()
        };
        energy += weight * derivative(&[]);
        for i in 0..6 {
            first[i] += weight * derivative(&[i]);
            for j in 0..6 {
                second[i][j] += weight * derivative(&[i, j]);
            }
        }
    }
    let gradient = symmetry.gradient(&q, &first);
    let force = std::array::from_fn(|i| gradient[i] / scale[i / 3]);
    let mut hessian = symmetry.hessian(&q, &first, &second);
    for i in 0..6 {
        for j in 0..6 {
            hessian[i][j] /= scale[i / 3] * scale[j / 3];
        }
    }
    let wrench = frame.wrench(&force);
    let k = convert(
        &frame.hessian(&force, &hessian),
        pose,
        &wrench,
        StiffnessKind::Generalised,
        kind,
    );
    (energy, wrench.to_array(), k)
}

proptest! {
    #![proptest_config(common::config(100))]

    #[test]
    fn one_pass_cubic(p in point(), seed in 0.0..9.0_f64) {
        let (lower, upper) = ([0.07, -0.03, -0.025, -0.9, -1.0, -0.8], [0.13, 0.02, 0.03, 0.8, 0.9, 1.0]);
        let coefficients = wave(84 * 6, seed);
        let model = PolynomialModel::from_coefficients(3, &lower, &upper, &coefficients).unwrap();
        let naive: Polynomial<'_, f64> = model.map().unwrap();
        let mut scratch = vec![0.0; naive.scratch_len()];
        let (mut h, mut k) = ([0.0; 6], [0.0; 36]);
        naive.value_and_jacobian(&p, &mut h, &mut k, &mut scratch).unwrap();
        let cubic = Cubic::new(&lower, &upper, &coefficients).unwrap();
        let (plain_h, plain_k) = cubic.value_and_jacobian::<Plain>(&p);
        let (fast_h, fast_k) = (model.predict(&p).unwrap(), model.jacobian(&p).unwrap());
        let size = largest(&k);
        for j in 0..6 {
            prop_assert!((fast_h[j] - h[j]).abs() < 1e-12 && (plain_h[j] - h[j]).abs() < 1e-12);
            for i in 0..6 {
                prop_assert!((fast_k[6 * j + i] - k[6 * j + i]).abs() < 1e-13 * size);
                prop_assert!((plain_k[j][i] - k[6 * j + i]).abs() < 1e-13 * size);
            }
        }
        let single = |x: &[f64]| -> Vec<f32> { x.iter().map(|&x| x as f32).collect() };
        let cubic = Cubic::new(&single(&lower), &single(&upper), &single(&coefficients)).unwrap();
        let (h32, k32) = cubic.value_and_jacobian::<Plain>(&p.map(|x| x as f32));
        for j in 0..6 {
            prop_assert!((f64::from(h32[j]) - h[j]).abs() < 2e-5 * (1.0 + largest(&h)));
            for i in 0..6 { prop_assert!((f64::from(k32[j][i]) - k[6 * j + i]).abs() < 1e-5 * size); }
        }
    }

    #[test]
    fn planned_energy(p in point(), seed in 0.0..9.0_f64) {
        let cases = [
            (Symmetry::Alike, 3), (Symmetry::Alike, 4), (Symmetry::Alike, 5), (Symmetry::Alike, 6),
            (Symmetry::Alike, 7), (Symmetry::Alike, 8), (Symmetry::Revolution, 4), (Symmetry::Revolution, 5),
            (Symmetry::Revolution, 6), (Symmetry::Revolution, 7), (Symmetry::Revolution, 8), (Symmetry::General, 4), (Symmetry::General, 6),
        ];
        for (symmetry, degree) in cases {
            let rows = terms(symmetry, degree).unwrap();
            let coefficients = wave(rows.len(), seed);
            let scale = [0.03, 0.9];
            let model = EnergyModel::from_coefficients(0.1, degree, symmetry, scale, &coefficients).unwrap();
            let pose = Pose::from_array(&p).unwrap();
            for kind in [StiffnessKind::Partial, StiffnessKind::Generalised, StiffnessKind::Screw] {
                let (u, h, k) = term_by_term(&model, &pose, kind);
                let fast_u = model.energy(&[p]).unwrap()[0];
                prop_assert!((fast_u - u).abs() < 1e-12 * (1.0 + u.abs()), "{symmetry:?} {degree}");
                let fast_h = model.predict(&[p]).unwrap()[0];
                let fast_k = model.stiffness(&[p], kind).unwrap()[0];
                for j in 0..6 {
                    prop_assert!((fast_h[j] - h[j]).abs() < 1e-12 * (1.0 + largest(&h)));
                    for i in 0..6 {
                        let size = largest(k.as_flattened());
                        prop_assert!((fast_k[j][i] - k[j][i]).abs() < 1e-12 * size, "{symmetry:?} {degree}");
                    }
                }
            }
            if degree <= 6 && symmetry != Symmetry::General {
                let tables = model.tables::<f32>().unwrap();
                let plan = tables.plan::<128>().unwrap();
                let single = Pose::from_array(&p.map(|x| x as f32)).unwrap();
                let (h32, k32) = plan.wrench_and_stiffness::<Plain>(&single, StiffnessKind::Partial);
                let (u, h, k) = term_by_term(&model, &pose, StiffnessKind::Partial);
                for j in 0..6 {
                    let (a, b) = (f64::from(h32.to_array()[j]), h[j]);
                    prop_assert!((a - b).abs() < 2e-4 * (1.0 + largest(&h)));
                    for i in 0..6 {
                        prop_assert!((f64::from(k32[j][i]) - k[j][i]).abs() < 2e-4 * largest(k.as_flattened()));
                    }
                }
                let energy = f64::from(plan.energy::<Plain>(&single));
                prop_assert!((energy - u).abs() < 1e-3 * (1.0 + energy.abs()));
            }
        }
    }
}

#[test]
fn too_small_a_memory_is_refused() {
    let rows = terms(Symmetry::Alike, 6).unwrap();
    let weights = wave(rows.len(), 1.0);
    let model =
        EnergyModel::from_coefficients(0.1, 6, Symmetry::Alike, [0.03, 0.9], &weights).unwrap();
    let tables = model.tables::<f64>().unwrap();
    assert!(tables.plan::<16>().is_err());
    assert!(tables.plan::<64>().is_err());
    assert!(tables.plan::<127>().is_err());
    assert!(tables.plan::<128>().is_ok());
}

#[test]
fn tables_that_do_not_fit_together_are_no_plan() {
    let mut ends = [1; ROWS];
    type Tables<'a> = (&'a [(u16, u8)], [u16; ROWS], &'a [u16], &'a [f64]);
    let plan = |(products, ends, columns, weights): Tables<'_>| {
        EnergyPlan::<f64, 4>::new(Symmetry::Alike, 0.1, products, ends, columns, weights).map(drop)
    };
    assert!(plan((&[(0, 0)], ends, &[1], &[2.0])).is_ok());
    assert!(
        plan((&[(1, 0)], ends, &[1], &[2.0])).is_err(),
        "its own factor"
    );
    assert!(
        plan((&[(0, 6)], ends, &[1], &[2.0])).is_err(),
        "a seventh variable"
    );
    assert!(
        plan((&[(0, 0)], ends, &[2], &[2.0])).is_err(),
        "no such monomial"
    );
    assert!(plan((&[(0, 0)], ends, &[1], &[])).is_err(), "no weight");
    ends[3] = 0;
    assert!(
        plan((&[(0, 0)], ends, &[1], &[2.0])).is_err(),
        "rows not in order"
    );
    assert!(
        plan((&[(0, 0)], [2; ROWS], &[1], &[2.0])).is_err(),
        "beyond the entries"
    );
}
