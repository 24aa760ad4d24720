//! Every public function under any numbers, finite or not: it answers or refuses, it never panics.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use ecm_se3::jacobian::torque_derivative;
use ecm_se3::mid_frame::MidFrame;
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::*;
use proptest::prelude::*;
use proptest::sample::select;

const KINDS: [StiffnessKind; 3] = [
    StiffnessKind::Partial,
    StiffnessKind::Generalised,
    StiffnessKind::Screw,
];

fn number() -> impl Strategy<Value = f64> {
    let special = vec![
        0.0,
        -0.0,
        5e-324,
        -1e-310,
        0.1,
        -1.0,
        3.0,
        4.0,
        1e16,
        1e155,
        -1e308,
        f64::MAX,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NAN,
    ];
    prop_oneof![1 => select(special), 1 => -2.0..2.0_f64, 1 => any::<f64>()]
}

fn all<R: Real>(p: &[R; 6], h: &[R; 6], matrix: &[[R; 6]; 6], length_m: R) {
    let (theta, torque) = ([p[3], p[4], p[5]], [h[3], h[4], h[5]]);
    let rotation = rotation_matrix(&theta);
    half_rotation(&theta);
    left_jacobian(&theta);
    left_jacobian_inverse(&theta);
    left_jacobian_derivatives(&theta);
    torque_derivative(&theta, &torque);
    RotationForm::new(&theta, &torque, &[p[0], p[1], p[2]]);
    Stumpff::new(p[0]);
    linear_algebra(&theta, &torque, &rotation, matrix, length_m);
    let wrench = Wrench::from_array(h);
    wrench.moved(&rotation, &torque);
    for pose in [Pose::from_array(p).ok(), Some(Pose::at_rest(p[0]))]
        .into_iter()
        .flatten()
    {
        pose.base_from_top();
        wrench.generalised(&pose);
        let frame = MidFrame::new(&pose, length_m);
        frame.jacobian();
        frame.generalised_force(&wrench);
        let (q, hessian) = (frame.coordinates(), frame.hessian(h, matrix));
        frame.partial_from_generalised(&hessian, &frame.wrench(&q));
        for a in KINDS {
            for b in KINDS {
                convert(matrix, &pose, &wrench, a, b);
            }
        }
    }
}

fn linear_algebra<R: Real>(a: &[R; 3], b: &[R; 3], m: &[[R; 3]; 3], six: &[[R; 6]; 6], s: R) {
    use linear::*;
    let _ = (add(a, b), sub(a, b), cross(a, b), scaled(s, a));
    let _ = (
        dot(a, b),
        skew(a),
        outer(a, b),
        diagonal(s),
        identity::<R>(),
    );
    let _ = (
        apply(m, a),
        apply_transposed(m, a),
        transposed(m),
        times(s, m),
    );
    let _ = (
        product(m, m),
        transposed_product(m, m),
        sum(m, m),
        difference(m, m),
    );
    from_blocks(m, &block(six, 0, 1), &block(six, 1, 0), m);
}

fn any_index() -> impl Strategy<Value = usize> {
    prop_oneof![3 => 0..9_usize, 1 => any::<usize>(), 1 => (0..9_usize).prop_map(|i| usize::MAX - i)]
}

proptest! {
    #![proptest_config(common::config(500))]

    #[test]
    fn any_index_has_a_number_or_none(k in any_index(), i in any_index(), j in any_index(), s in 0.0..16.0_f64) {
        let functions = Stumpff::new(s);
        prop_assert_eq!(functions.first(k).is_nan(), k > 5);
        prop_assert_eq!(functions.second(k).is_nan(), k > 3);
        let matrix: [[f64; 6]; 6] = std::array::from_fn(|a| std::array::from_fn(|b| (6 * a + b) as f64));
        let found = linear::block(&matrix, i, j);
        for a in 0..3 {
            for b in 0..3 {
                let exact = (i < 2 && j < 2).then(|| matrix[3 * i + a][3 * j + b]);
                prop_assert_eq!(found[a][b].is_nan(), exact.is_none());
                prop_assert!(exact.is_none_or(|x| x == found[a][b]));
            }
        }
    }

    #[test]
    fn any_numbers(p in prop::array::uniform6(number()), h in prop::array::uniform6(number()),
                   entries in prop::collection::vec(number(), 36), length_m in number()) {
        let matrix: [[f64; 6]; 6] = std::array::from_fn(|i| std::array::from_fn(|j| entries[6 * i + j]));
        all(&p, &h, &matrix, length_m);
        let single = |v: &[f64; 6]| v.map(|x| x as f32);
        all(&single(&p), &single(&h), &matrix.map(|row| row.map(|x| x as f32)), length_m as f32);
        // What is no pose says so, and what is a rotation vector is one of at most half a turn.
        if let Err(error) = Pose::from_array(&p) { prop_assert!(!error.to_string().is_empty()); }
        let m: [[f64; 3]; 3] = std::array::from_fn(|i| [matrix[i][0], matrix[i][1], matrix[i][2]]);
        match rotation_vector(&m) {
            Ok(theta) => prop_assert!(linear::dot(&theta, &theta) < 9.87),
            Err(error) => prop_assert!(error.to_string().contains("no rotation")),
        }
        let theta = [p[3], p[4], p[5]];
        if let Ok(back) = rotation_vector(&rotation_matrix(&theta)) {
            prop_assert!(linear::dot(&back, &back) < 9.87);
            prop_assert!(linear::dot(&theta, &theta) <= 16.0);
        }
    }
}
