//! Group laws, finite differences and the symmetry of the three stiffnesses.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_se3::linear::{apply, cross, dot, product, skew, sub, transposed};
use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::*;
use proptest::prelude::*;

const LENGTH: f64 = 0.1034;

fn vector(limit: f64) -> impl Strategy<Value = [f64; 3]> {
    prop::array::uniform3(-limit..limit)
}

/// Rotation vectors up to |θ| = π, small ones as likely as large ones.
fn rotation() -> impl Strategy<Value = [f64; 3]> {
    (vector(1.0), -12.0..0.0_f64).prop_map(|(v, exponent)| {
        let norm = dot(&v, &v).sqrt().max(1e-3);
        let angle = std::f64::consts::PI * exponent.exp2().powi(2).min(1.0);
        v.map(|x| x / norm * angle * 0.999)
    })
}

fn pose() -> impl Strategy<Value = Pose<f64>> {
    (vector(0.03), rotation()).prop_map(|(c, t)| {
        Pose::from_array(&[c[0] + LENGTH, c[1], c[2], t[0], t[1], t[2]]).unwrap()
    })
}

fn wrench() -> impl Strategy<Value = Wrench<f64>> {
    (vector(100.0), vector(5.0)).prop_map(|(force, torque)| Wrench { force, torque })
}

fn distance<const A: usize, const B: usize>(a: &[[f64; B]; A], b: &[[f64; B]; A]) -> f64 {
    let pairs = a.iter().flatten().zip(b.iter().flatten());
    pairs.fold(0.0, |m: f64, (x, y)| m.max((x - y).abs()))
}

fn shifted(pose: &Pose<f64>, index: usize, step: f64) -> Pose<f64> {
    let mut p = pose.to_array();
    p[index] += step;
    Pose::from_array(&p).unwrap()
}

/// A quartic energy without any symmetry: gradient and Hessian in q.
fn energy(q: &[f64; 6]) -> ([f64; 6], [[f64; 6]; 6]) {
    let scale = [200.0, 150.0, 170.0, 2.0, 4.0, 3.0];
    let mut gradient = [0.0; 6];
    let mut hessian = [[0.0; 6]; 6];
    // U = Σ kᵢ sᵢ²/2 + s⁴/24 of s = w·q, several w.
    for i in 0..6 {
        let mut w = [0.0; 6];
        w[i] = scale[i];
        w[(i + 2) % 6] = 0.3 * scale[(i + 2) % 6];
        w[(i + 5) % 6] = -0.2 * scale[(i + 5) % 6];
        let s: f64 = w.iter().zip(q).map(|(a, b)| a * b).sum();
        let (first, second) = (s + s * s * s / 6.0, 1.0 + s * s / 2.0);
        for a in 0..6 {
            gradient[a] += first * w[a];
            for b in 0..6 {
                hessian[a][b] += second * w[a] * w[b];
            }
        }
    }
    (gradient, hessian)
}

fn energy_wrench(pose: &Pose<f64>) -> Wrench<f64> {
    let frame = MidFrame::new(pose, LENGTH);
    frame.wrench(&energy(&frame.coordinates()).0)
}

proptest! {
    #![proptest_config(common::config(300))]

    #[test]
    fn rotations_are_orthogonal_and_inverted_by_minus(theta in rotation()) {
        let r = rotation_matrix(&theta);
        prop_assert!(distance(&product(&r, &transposed(&r)), &linear::identity()) < 4e-15);
        let back = rotation_matrix(&theta.map(|x| -x));
        prop_assert!(distance(&back, &transposed(&r)) < 1e-15);
        let a = half_rotation(&theta);
        prop_assert!(distance(&product(&a, &a), &r) < 4e-15);
        prop_assert!(apply(&r, &theta).iter().zip(theta).all(|(x, y)| (x - y).abs() < 4e-15));
    }

    #[test]
    fn logarithm_inverts_the_exponential(theta in rotation()) {
        let back = rotation_vector(&rotation_matrix(&theta)).unwrap();
        prop_assert!(back.iter().zip(theta).all(|(x, y)| (x - y).abs() < 1e-13), "{theta:?} {back:?}");
    }

    #[test]
    fn left_jacobian_is_the_rate_of_the_exponential(theta in rotation(), v in vector(1.0)) {
        let e = 1e-5;
        let moved = |s: f64| rotation_matrix(&std::array::from_fn::<f64, 3, _>(|i| theta[i] + s * v[i]));
        let (plus, minus) = (moved(e), moved(-e));
        let r = rotation_matrix(&theta);
        let mut rate = [[0.0; 3]; 3];
        for i in 0..3 { for j in 0..3 { rate[i][j] = (plus[i][j] - minus[i][j]) / (2.0 * e); } }
        let spin = product(&rate, &transposed(&r));
        let expected = skew(&apply(&left_jacobian(&theta), &v));
        prop_assert!(distance(&spin, &expected) < 1e-9);
    }

    #[test]
    fn inverse_left_jacobian(theta in rotation()) {
        let unit = product(&left_jacobian(&theta), &left_jacobian_inverse(&theta));
        prop_assert!(distance(&unit, &linear::identity()) < 1e-14);
        // J(−θ) = J(θ)ᵀ and R = J J⁻ᵀ
        let r = product(&left_jacobian(&theta), &transposed(&left_jacobian_inverse(&theta)));
        prop_assert!(distance(&r, &rotation_matrix(&theta)) < 2e-14);
    }

    #[test]
    fn derivatives_of_the_left_jacobian(theta in rotation(), torque in vector(2.0)) {
        let e = 1e-5;
        let derivatives = left_jacobian_derivatives(&theta);
        let d = torque_derivative(&theta, &torque);
        for k in 0..3 {
            let mut up = theta; up[k] += e;
            let mut down = theta; down[k] -= e;
            let (jp, jm) = (left_jacobian(&up), left_jacobian(&down));
            let mut rate = [[0.0; 3]; 3];
            for i in 0..3 { for j in 0..3 { rate[i][j] = (jp[i][j] - jm[i][j]) / (2.0 * e); } }
            prop_assert!(distance(&rate, &derivatives[k]) < 1e-9);
            let column = linear::apply_transposed(&derivatives[k], &torque);
            for i in 0..3 { prop_assert!((column[i] - d[i][k]).abs() < 1e-13); }
        }
    }

    #[test]
    fn rotation_form_has_its_derivatives(theta in rotation(), a in vector(1.0), b in vector(1.0)) {
        let form = RotationForm::new(&theta, &a, &b);
        prop_assert!((form.value - dot(&apply(&rotation_matrix(&theta), &a), &b)).abs() < 1e-14);
        let e = 1e-5;
        for k in 0..3 {
            let mut up = theta; up[k] += e;
            let mut down = theta; down[k] -= e;
            let (p, m) = (RotationForm::new(&up, &a, &b), RotationForm::new(&down, &a, &b));
            prop_assert!(((p.value - m.value) / (2.0 * e) - form.gradient[k]).abs() < 1e-9);
            for i in 0..3 {
                let rate = (p.gradient[i] - m.gradient[i]) / (2.0 * e);
                prop_assert!((rate - form.hessian[i][k]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn moving_a_wrench_keeps_its_work_and_composes(
        w in wrench(), one in pose(), two in pose(), twist in (vector(1.0), vector(1.0)),
    ) {
        let (r1, r2) = (one.base_from_top(), two.base_from_top());
        let direct = w.moved(&r1, one.position()).moved(&r2, two.position());
        let t: [f64; 3] = linear::add(&apply(&r2, one.position()), two.position());
        let at_once = w.moved(&product(&r2, &r1), &t);
        for (x, y) in direct.to_array().iter().zip(at_once.to_array()) {
            prop_assert!((x - y).abs() < 1e-11);
        }
        // Power f·v + τ·ω of the same motion seen in both frames.
        let (v, omega) = twist;
        let moved = w.moved(&r1, one.position());
        let omega_new = apply(&r1, &omega);
        let v_new = sub(&apply(&r1, &v), &cross(&omega_new, one.position()));
        let here = dot(&w.force, &v) + dot(&w.torque, &omega);
        let there = dot(&moved.force, &v_new) + dot(&moved.torque, &omega_new);
        prop_assert!((here - there).abs() < 1e-11);
    }

    #[test]
    fn mid_frame_force_keeps_the_work_and_inverts(p in pose(), w in wrench()) {
        let frame = MidFrame::new(&p, LENGTH);
        let q = frame.generalised_force(&w);
        for (x, y) in frame.wrench(&q).to_array().iter().zip(w.to_array()) {
            prop_assert!((x - y).abs() < 1e-11);
        }
        let j = frame.jacobian();
        let g = w.generalised(&p);
        for k in 0..6 {
            let work: f64 = (0..6).map(|i| q[i] * j[i][k]).sum();
            prop_assert!((work - g[k]).abs() < 1e-11);
            let e = 1e-6;
            let up = mid_frame::coordinates(&shifted(&p, k, e), LENGTH);
            let down = mid_frame::coordinates(&shifted(&p, k, -e), LENGTH);
            for i in 0..6 {
                prop_assert!(((up[i] - down[i]) / (2.0 * e) - j[i][k]).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn stiffness_of_an_energy(p in pose()) {
        let frame = MidFrame::new(&p, LENGTH);
        let (q, second) = energy(&frame.coordinates());
        let w = frame.wrench(&q);
        let h = frame.hessian(&q, &second);
        let k = frame.partial_from_generalised(&h, &w);
        let size = k.iter().flatten().fold(0.0_f64, |m, x| m.max(x.abs()));
        for j in 0..6 {
            for i in 0..6 { prop_assert!(h[i][j] == h[j][i]); }
            let e = 1e-6;
            let up = energy_wrench(&shifted(&p, j, e)).to_array();
            let down = energy_wrench(&shifted(&p, j, -e)).to_array();
            for i in 0..6 {
                let rate = (up[i] - down[i]) / (2.0 * e);
                prop_assert!((rate - k[i][j]).abs() < 1e-7 * size, "{i}{j} {rate} {}", k[i][j]);
            }
        }
        let screw = convert(&k, &p, &w, StiffnessKind::Partial, StiffnessKind::Screw);
        let minus_torque = skew(&w.torque.map(|x| -x));
        for i in 0..6 { for j in 0..6 {
            let skew_part = screw[i][j] - screw[j][i];
            let geometric = if i.min(j) < 3 { 0.0 } else { minus_torque[i - 3][j - 3] };
            prop_assert!((skew_part - geometric).abs() < 1e-12 * size);
        } }
    }

    #[test]
    fn conversions_round_trip(p in pose(), w in wrench(), entries in prop::collection::vec(-10.0..10.0_f64, 36)) {
        let m: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| entries[6 * i + j]));
        let kinds = [StiffnessKind::Partial, StiffnessKind::Generalised, StiffnessKind::Screw];
        for a in kinds { for b in kinds {
            let there = convert(&m, &p, &w, a, b);
            prop_assert!(distance(&convert(&there, &p, &w, b, a), &m) < 1e-12);
        } }
    }
}

#[test]
fn swapping_alike_ends_turns_the_mid_frame() {
    // Seen from the other end: r' = −Rᵀ r, R' = Rᵀ; both turned by π about z, θ' = θ mirrored.
    let p = Pose::from_array(&[0.1, 0.02, -0.015, 0.3, -0.5, 0.4_f64]).unwrap();
    let r = p.base_from_top();
    let seen = linear::apply_transposed(&r, p.position()).map(|x| -x);
    let turn = |v: [f64; 3]| [-v[0], -v[1], v[2]];
    let (r, t) = (turn(seen), turn(p.rotation_vector().map(|x| -x)));
    let swapped = Pose::from_array(&[r[0], r[1], r[2], t[0], t[1], t[2]]).unwrap();
    let (q, s) = (
        mid_frame::coordinates(&p, LENGTH),
        mid_frame::coordinates(&swapped, LENGTH),
    );
    let expected = [q[0], q[1], -q[2], q[3], q[4], -q[5]];
    for k in 0..6 {
        assert!((s[k] - expected[k]).abs() < 1e-15, "{s:?} {expected:?}");
    }
}

#[test]
fn single_precision_agrees() {
    let p = [0.1, 0.02, -0.015, 0.3, -0.5, 0.4];
    let (pose, rounded) = (Pose::from_array(&p), Pose::from_array(&p.map(|x| x as f32)));
    let double = MidFrame::new(&pose.unwrap(), LENGTH).coordinates();
    let single = MidFrame::new(&rounded.unwrap(), LENGTH as f32).coordinates();
    for k in 0..6 {
        assert!((double[k] - f64::from(single[k])).abs() < 2e-7);
    }
}

#[test]
fn reflections_and_shears_have_no_rotation_vector() {
    let r = rotation_matrix(&[0.3, -0.5, 0.4]);
    let mirrored: Mat3<f64> = std::array::from_fn(|i| r[i].map(|x| -x));
    let mut sheared = r;
    sheared[0][1] += 0.01;
    let mut rounded = r;
    rounded[0][1] += 1e-4;
    let mut lost = r;
    lost[2][2] = f64::NAN;
    assert_eq!(
        rotation_vector(&mirrored).unwrap_err().determinant.round(),
        -1.0
    );
    assert!(rotation_vector(&sheared).is_err() && rotation_vector(&lost).is_err());
    assert!(rotation_vector(&[[0.0; 3]; 3]).is_err());
    assert!(rotation_vector(&rounded).is_ok());
}

#[test]
fn poses_are_finite_and_turn_by_at_most_pi() {
    let pi = std::f64::consts::PI;
    assert!(Pose::from_array(&[0.1, 0.0, 0.0, pi, 0.0, 0.0]).is_ok());
    assert!(Pose::from_array(&[0.1_f32, 0.0, 0.0, 0.0, pi as f32, 0.0]).is_ok());
    assert!(Pose::from_array(&[0.1, 0.0, 0.0, pi + 1e-9, 0.0, 0.0]).is_err());
    assert!(Pose::from_array(&[0.1, 0.0, 0.0, 2.0, 2.0, 2.0]).is_err());
    for k in 0..6 {
        for bad in [f64::NAN, f64::INFINITY] {
            let mut p = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0];
            p[k] = bad;
            assert!(matches!(
                Pose::from_array(&p),
                Err(PoseError::NotFinite { component, .. }) if component == k
            ));
        }
    }
}
