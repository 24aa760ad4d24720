//! From a model file to wrench and stiffness: the same method on every model.
#![allow(clippy::unwrap_used, missing_docs)]

use ecm_poly::cubic::Cubic;
use ecm_poly::model_file::map::{POSE, WRENCH, energy_document, polynomial_document};
use ecm_poly::{
    EnergyModel, PolynomialModel, Pose, PoseModel, PosePolynomial, Symmetry, open_model, seal_model,
};
use ecm_se3::stiffness::StiffnessKind;
use serde_json::{Value, json};

const P: [f64; 6] = [0.1, 0.004, -0.003, 0.2, 0.1, -0.3];

fn wave(count: usize) -> Vec<f64> {
    (0..count)
        .map(|i| ((i as f64 + 1.0) * 12.9898).sin())
        .collect()
}

fn polynomial(degree: usize) -> PolynomialModel {
    let count = ecm_poly::basis::number_of_terms(6, degree).unwrap();
    PolynomialModel::from_coefficients(degree, &[-0.4; 6], &[0.5; 6], &wave(6 * count)).unwrap()
}

fn energy() -> EnergyModel {
    EnergyModel::from_coefficients(0.1034, 4, Symmetry::Alike, [0.03, 0.8], &wave(22)).unwrap()
}

fn sealed(document: serde_json::Map<String, Value>) -> String {
    seal_model(&Value::Object(document).to_string()).unwrap()
}

#[test]
fn a_polynomial_file_gives_its_wrench_and_stiffness() {
    let pose = Pose::from_array(&P).unwrap();
    for degree in [1, 2, 3, 4] {
        let model = polynomial(degree);
        let text = sealed(polynomial_document(&model, &POSE, &WRENCH));
        let (value, jacobian) = (model.predict(&P).unwrap(), model.jacobian(&P).unwrap());
        let one = PosePolynomial::from_json(&text).unwrap();
        let either = PoseModel::from_json(&text).unwrap();
        for (h, k) in [
            one.wrench_and_stiffness(&pose),
            either.wrench_and_stiffness(&pose),
        ] {
            // The one pass of h and K rounds h differently than h alone.
            for (a, b) in h.to_array().iter().zip(&value) {
                assert!(
                    (a - b).abs() < 1e-14 * (1.0 + b.abs()),
                    "degree {degree}: {a} {b}"
                );
            }
            assert_eq!(k.as_flattened(), jacobian, "degree {degree}");
        }
        assert!(EnergyModel::from_json(&text).is_err());
    }
    let model = polynomial(3);
    let cubic = Cubic::new(model.lower(), model.upper(), model.coefficients()).unwrap();
    let (h, k) = cubic.wrench_and_stiffness(&pose);
    for (a, b) in h.to_array().iter().zip(model.predict(&P).unwrap()) {
        assert!((a - b).abs() < 1e-12);
    }
    for (a, b) in k.as_flattened().iter().zip(model.jacobian(&P).unwrap()) {
        assert!((a - b).abs() < 1e-10);
    }
}

#[test]
fn an_energy_file_gives_its_wrench_and_stiffness() {
    let pose = Pose::from_array(&P).unwrap();
    let model = energy();
    let text = sealed(energy_document(&model));
    let h = model.predict(&[P]).unwrap()[0];
    let k = model.stiffness(&[P], StiffnessKind::Partial).unwrap()[0];
    let either = PoseModel::from_json(&text)
        .unwrap()
        .wrench_and_stiffness(&pose);
    let (wrench, stiffness) = EnergyModel::from_json(&text)
        .unwrap()
        .wrench_and_stiffness(&pose);
    assert_eq!((wrench.to_array(), stiffness), (h, k));
    assert_eq!((either.0.to_array(), either.1), (h, k));
    assert!(PosePolynomial::from_json(&text).is_err());
    // A physics model is an energy times a factor.
    let mut physics = energy_document(&model);
    physics.insert("kind".into(), json!("physics"));
    physics.insert("factor".into(), json!(2.0));
    let twice = EnergyModel::from_json(&sealed(physics))
        .unwrap()
        .wrench_and_stiffness(&pose)
        .0;
    for (a, b) in twice.to_array().iter().zip(h) {
        assert!((a - 2.0 * b).abs() < 1e-12 * b.abs().max(1.0));
    }
}

#[test]
fn files_that_hold_more_or_something_else_are_refused() {
    let with = |key: &str, value: Value| {
        let mut document = energy_document(&energy());
        document.insert(key.into(), value);
        EnergyModel::from_json(&sealed(document))
            .unwrap_err()
            .to_string()
    };
    let message = with("effects", json!([{"id": "payload"}]));
    assert!(
        message.contains("effects") && message.contains("ecm export"),
        "{message}"
    );
    let mut text = sealed(energy_document(&energy()));
    text = text.replace("0.1034", "0.1035");
    assert!(
        EnergyModel::from_json(&text)
            .unwrap_err()
            .to_string()
            .contains("sha256")
    );
    let swapped = [
        "x_m",
        "z_m",
        "y_m",
        "theta_x_rad",
        "theta_y_rad",
        "theta_z_rad",
    ];
    let other = sealed(polynomial_document(&polynomial(1), &swapped, &WRENCH));
    let message = PosePolynomial::from_json(&other).unwrap_err().to_string();
    assert!(
        message.contains("inputs") && message.contains("x_m, y_m, z_m"),
        "{message}"
    );
    assert!(open_model(&other).is_ok());
    let narrow = PolynomialModel::from_coefficients(1, &[0.0; 2], &[1.0; 2], &wave(9)).unwrap();
    assert!(PosePolynomial::new(narrow).is_err());
}

#[test]
fn bulk_polynomials_give_the_same_bytes_on_any_number_of_threads() {
    let points = wave(6 * 3000);
    for degree in [2, 3] {
        let model = polynomial(degree);
        let of_threads = |n: usize| {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(n)
                .build()
                .unwrap();
            pool.install(|| {
                (
                    model.predict(&points).unwrap(),
                    model.jacobian(&points).unwrap(),
                )
            })
        };
        let one = of_threads(1);
        assert_eq!(one, of_threads(3));
        assert_eq!(
            one.0[6 * 2999..],
            model.predict(&points[6 * 2999..]).unwrap()
        );
        assert_eq!(
            one.1[36 * 2999..],
            model.jacobian(&points[6 * 2999..]).unwrap()
        );
    }
}
