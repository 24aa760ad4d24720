//! Every public evaluation under any numbers, finite or not: it answers or refuses, it never panics.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use std::ops::Range;

use ecm_poly::arithmetic::Plain;
use ecm_poly::basis::{advance, exponents, number_of_terms};
use ecm_poly::cubic::Cubic;
use ecm_poly::dense::{ThinSvd, condition_number, singular_values};
use ecm_poly::energy::groups::GroupTerm;
use ecm_poly::energy::plan::{EnergyPlan, ROWS};
use ecm_poly::energy::regressor::regressor;
use ecm_poly::energy::terms::term_name;
use ecm_poly::energy::{EnergyTerms, Group};
use ecm_poly::normalise::{ranges, to_unit, unit_slope};
use ecm_poly::polynomial_model::polynomial_regressor;
use ecm_poly::regression::leave_one_out::LeaveOneOut;
use ecm_poly::regression::triangle::Triangle;
use ecm_poly::regression::{least_squares, pcr, ridge, solve};
use ecm_poly::{
    EnergyFit, EnergyModel, Method, Polynomial, PolynomialModel, Pose, PoseModel, PosePolynomial,
    Symmetry, checked_poses, open_model, seal_model,
};
use ecm_se3::stiffness::StiffnessKind;
use proptest::prelude::*;
use proptest::sample::select;

const SYMMETRIES: [Symmetry; 3] = [Symmetry::Alike, Symmetry::Revolution, Symmetry::General];
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
        1e-17,
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
    prop_oneof![3 => select(special), 2 => -1.0..1.0_f64, 1 => any::<f64>()]
}

/// Mostly poses that a model accepts.
fn pose() -> impl Strategy<Value = [f64; 6]> {
    let small = prop::array::uniform6(-1.0..1.0_f64);
    prop_oneof![2 => small, 1 => prop::array::uniform6(number())]
}

fn numbers(count: impl Into<prop::collection::SizeRange>) -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(number(), count)
}

/// Small, or anything at all.
fn count() -> impl Strategy<Value = usize> {
    prop_oneof![8 => 0..7_usize, 1 => any::<usize>(), 1 => Just(usize::MAX)]
}

/// Degree, symmetry and groups, most of them possible.
fn terms() -> impl Strategy<Value = (usize, Symmetry, Vec<Group>)> {
    let degree = prop_oneof![4 => 0..6_usize, 1 => Just(7), 1 => any::<usize>()];
    let groups = prop::collection::vec(select(Group::ALL.to_vec()), 0..3);
    (degree, select(SYMMETRIES.to_vec()), groups)
}

proptest! {
    #![proptest_config(common::config(150))]

    #[test]
    fn energies(
        (degree, symmetry, groups) in terms(), length_m in number(), scale in prop::array::uniform2(number()),
        usual in any::<bool>(), coefficients in numbers(64), poses in prop::collection::vec(pose(), 0..4),
    ) {
        let (length_m, scale) = if usual { (0.1, [0.03, 0.8]) } else { (length_m, scale) };
        let Ok(terms) = EnergyTerms::new(symmetry, degree, &groups) else { return Ok(()) };
        let cycle = coefficients.iter().copied().cycle();
        let finite = |x: f64| if usual && !x.is_finite() { 1.0 } else { x };
        let weights: Vec<f64> = cycle.map(finite).take(terms.count()).collect();
        let _ = regressor(&poses, length_m, &terms, scale);
        let _ = checked_poses("poses", &poses);
        let Ok(model) = EnergyModel::with_groups(length_m, degree, symmetry, &groups, scale, &weights) else {
            return Ok(());
        };
        let _ = (model.energy(&poses), model.predict(&poses), model.prediction_covariance(&poses));
        for kind in KINDS { let _ = model.stiffness(&poses, kind); }
        let tables = model.tables::<f32>().unwrap();
        for p in &poses {
            if let Ok(pose) = Pose::from_array(p) { model.wrench_and_stiffness(&pose); }
            if let (Ok(pose), Ok(plan)) = (Pose::from_array(&p.map(|x| x as f32)), tables.plan::<1024>()) {
                plan.energy::<Plain>(&pose);
                plan.wrench::<Plain>(&pose);
                for kind in KINDS { plan.wrench_and_stiffness::<Plain>(&pose, kind); }
            }
        }
    }

    #[test]
    fn plans_of_any_tables(
        products in prop::collection::vec((0..20_u16, 0..8_u8), 0..12), ends in prop::collection::vec(0..9_u16, ROWS),
        columns in prop::collection::vec(0..14_u16, 0..9), weights in numbers(0..9), length_m in number(), p in pose(),
        valid in any::<bool>(),
    ) {
        let mut ends: [u16; ROWS] = ends.try_into().unwrap();
        let (mut columns, mut weights, mut products) = (columns, weights, products);
        if valid {
            ends.sort_unstable();
            columns.resize(usize::from(ends[ROWS - 1]), 0);
            weights.resize(columns.len(), 1.0);
            for (t, product) in products.iter_mut().enumerate() { *product = (product.0.min(t as u16), product.1 % 6); }
            for column in &mut columns { *column = (*column).min(products.len() as u16); }
        }
        for symmetry in SYMMETRIES {
            let plan = EnergyPlan::<f64, 16>::new(symmetry, length_m, &products, ends, &columns, &weights);
            prop_assert!(plan.is_ok() || !valid);
            if let (Ok(plan), Ok(pose)) = (plan, Pose::from_array(&p)) {
                plan.energy::<Plain>(&pose);
                for kind in KINDS { plan.wrench_and_stiffness::<Plain>(&pose, kind); }
            }
        }
    }

    #[test]
    fn polynomials(
        inputs in 0..7_usize, outputs in 0..4_usize, degree in 0..5_usize, off in 0..2_usize, lower in numbers(7),
        upper in numbers(7), coefficients in numbers(0..40), points in numbers(0..30),
    ) {
        let count = number_of_terms(inputs, degree).unwrap() * outputs + off;
        let weights: Vec<f64> = coefficients.iter().copied().cycle().take(count).collect();
        let (lower, upper) = (&lower[..inputs], &upper[..inputs]);
        let _ = ranges(&points, inputs);
        let _ = polynomial_regressor(&points, degree, lower, upper);
        if let Ok(model) = PolynomialModel::from_coefficients(degree, lower, upper, &weights) {
            let _ = (model.predict(&points), model.jacobian(&points));
            let _ = (model.leverage(&points), model.prediction_sd(&points));
            if let (Ok(model), Ok(pose)) = (PosePolynomial::new(model), Pose::from_array(&[0.1; 6])) {
                model.wrench_and_stiffness(&pose);
            }
        }
        let table: Vec<u8> = points.iter().map(|x| *x as u8).collect();
        let (mut value, mut jacobian, mut row) = (vec![0.0; outputs], vec![0.0; outputs * inputs], vec![0.0; 9]);
        if let Ok(map) = Polynomial::new(&table, lower, upper, &weights) {
            for length in [0, map.scratch_len()] {
                let mut scratch = vec![0.0; length];
                let _ = map.value(lower, &mut value, &mut scratch);
                let _ = map.value_and_jacobian(lower, &mut value, &mut jacobian, &mut scratch);
                let _ = map.regressor_row(&points, &mut row, &mut scratch);
            }
        }
    }

    #[test]
    fn cubics(lower in numbers(6), upper in numbers(6), coefficients in numbers(40), p in pose()) {
        let weights: Vec<f64> = coefficients.iter().copied().cycle().take(84 * 6).collect();
        let cubic = Cubic::new(&lower, &upper, &weights).unwrap();
        cubic.value::<Plain>(&p);
        cubic.value_and_jacobian::<Plain>(&p);
        if let Ok(pose) = Pose::from_array(&p) { cubic.wrench_and_stiffness(&pose); }
        if let Ok(model) = PolynomialModel::from_coefficients(3, &lower, &upper, &weights) {
            let _ = (model.predict(&p), model.jacobian(&p));
        }
        prop_assert!(Cubic::new(&lower[1..], &upper, &weights).is_err());
    }

    #[test]
    fn bases_and_normalisation(
        inputs in prop_oneof![0..9_usize, any::<usize>()], degree in prop_oneof![0..4_usize, any::<usize>()],
        mut powers in prop::collection::vec(any::<u8>(), 0..8), x in prop::array::uniform3(number()),
    ) {
        prop_assert_eq!(number_of_terms(inputs, degree), number_of_terms(degree, inputs));
        let _ = exponents(inputs, degree);
        advance(&mut powers);
        prop_assert!(!unit_slope(x[0], x[1]).is_nan());
        to_unit(x[2], x[0], x[1]);
        to_unit(x[2] as f32, x[0] as f32, x[1] as f32);
    }

    #[test]
    fn names_and_symmetries(exponents in prop::array::uniform6(any::<u8>()), imaginary in any::<bool>()) {
        for symmetry in SYMMETRIES {
            symmetry.admits(&exponents);
            term_name(symmetry, &exponents);
        }
        let term = GroupTerm { powers: exponents, imaginary, monomials: Vec::new() };
        let _ = (term.name(), term.row());
    }

    #[test]
    fn regressions(
        numbers in numbers(0..40), observations in numbers(0..12), columns in count(), outputs in count(), rank in count(),
        setting in number(),
    ) {
        let _ = (singular_values(&numbers, columns), condition_number(&numbers, columns));
        let Ok(factors) = ThinSvd::new(&numbers, columns) else { return Ok(()) };
        factors.condition_number(rank);
        let _ = ridge::solve(&factors, &observations, outputs, setting);
        let _ = pcr::solve(&factors, &observations, outputs, setting);
        for method in [Method::LeastSquares, Method::Ridge(setting), Method::Pcr(setting)] {
            let found = solve(&factors, &observations, outputs, method);
            let rows = numbers.len() / columns;
            prop_assert!(found.is_err() || Some(observations.len()) == rows.checked_mul(outputs));
        }
        let _ = LeaveOneOut::new(&factors, &observations, outputs);
        if Some(observations.len()) == (numbers.len() / columns).checked_mul(outputs) {
            pcr::truncated(&factors, &observations, outputs, rank);
            least_squares::solve(&factors, &observations, outputs);
        }
    }

    #[test]
    fn triangles_of_any_rows(
        rows in 0..9_usize, lines in count(), columns in count(), size in 0..60_usize, k in count(), degree in count(),
        lower in numbers(0..4), upper in numbers(0..4), values in numbers(1..9), setting in number(),
    ) {
        let filled = |n: usize| -> Vec<f64> { values.iter().copied().cycle().take(n).collect() };
        // Blocks of the right size, or of one that does not follow from the range.
        let columns = columns.min(9);
        let right = |part: Range<usize>| Ok(filled(part.len() * lines.min(9) * columns));
        let any = Triangle::of_rows(rows, lines, columns, |_| Ok(filled(size)));
        prop_assert!(lines > 0 && columns > 0 || any.is_err());
        let some = Triangle::of_rows(rows, lines.min(9), columns, right);
        for triangle in [any, some].into_iter().flatten() {
            for method in [Method::LeastSquares, Method::Ridge(setting), Method::Pcr(setting)] {
                let found = triangle.solve(k, method);
                prop_assert!(found.is_err() || k <= triangle.columns());
                let _ = PolynomialModel::of_triangle(&triangle, degree, (&lower, &upper), method);
            }
            let fit = EnergyFit { length_m: setting, degree, symmetry: Symmetry::Alike, groups: &[], covariance: None };
            let _ = fit.of_triangle(triangle, [setting, setting], true);
        }
    }

    #[test]
    fn model_files(text in ".{0,200}", key in "[a-z_]{0,12}", x in number()) {
        let document = format!("{{\"kind\": \"energy\", \"{key}\": {x:?}, \"effects\": {text:?}}}");
        for candidate in [&text, &document] {
            let _ = (open_model(candidate), seal_model(candidate), PoseModel::from_json(candidate).is_ok());
        }
    }

    #[test]
    fn fits_of_energies(
        poses in prop::collection::vec(pose(), 0..9), wrenches in prop::collection::vec(prop::array::uniform6(number()), 0..9),
        length_m in number(), (degree, symmetry, groups) in terms(),
    ) {
        let fit = EnergyFit {
            length_m: if length_m > 0.0 { length_m } else { 0.1 }, degree: degree.min(3), symmetry, groups: &groups,
            covariance: None,
        };
        let _ = fit.run(&poses, &wrenches);
        let count = poses.len().min(wrenches.len());
        let _ = fit.run(&poses[..count], &wrenches[..count]);
    }
}
