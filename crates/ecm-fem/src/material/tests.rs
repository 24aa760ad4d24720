//! Energy, stress and tangent of every material belong together.
#![allow(clippy::unwrap_used)]

use super::*;
use crate::tensor::{determinant, product};
use ecm_se3::rotation_matrix;

fn all() -> Vec<Box<dyn Material>> {
    let kappa = 1e7;
    let neo = || NeoHookean::new(0.72e6, 0.49).unwrap();
    let own: [Box<dyn Material>; 6] = [
        Box::new(neo()),
        Box::new(MooneyRivlin::new(0.8e5, 0.4e5, kappa).unwrap()),
        Box::new(Yeoh::new([1e5, -1e4, 5e3], kappa).unwrap()),
        Box::new(Gent::new(2.4e5, 3.0, kappa).unwrap()),
        Box::new(Ogden::new(vec![(1.5e5, 1.3), (2e4, 5.0), (1e4, -2.0)], kappa).unwrap()),
        Box::new(Fibre::new(Box::new(neo()), [1.0, 0.3, -0.2], 5e4, 2.0).unwrap()),
    ];
    own.into_iter().chain(listed()).collect()
}

/// Every model of the list, with the parameters that its own fit starts from.
fn listed() -> Vec<Box<dyn Material>> {
    let made = MODELS.iter().map(|model| {
        let values = model.decode(&model.start(2e5, 2).unwrap()).unwrap();
        let terms = values.len() / model.parameters.len();
        let named = model.parameters.iter().zip(values.chunks(terms));
        let named = named.map(|(name, v)| ((*name).to_string(), v.to_vec()));
        choose(model.name, &named.collect()).unwrap()
    });
    made.collect()
}

const STATES: [Mat3; 3] = [
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
    [[1.2, 0.3, -0.1], [0.05, 0.9, 0.2], [0.1, -0.3, 1.1]],
    [[0.7, 0.2, 0.3], [-0.4, 1.3, 0.1], [0.2, 0.1, 1.1]],
];

fn at(material: &dyn Material, f: &Mat3) -> Response {
    material.respond(f, determinant(f))
}

#[test]
fn stress_is_the_derivative_of_energy_and_tangent_of_stress() {
    let h = 1e-6;
    for material in all() {
        for f in STATES {
            let here = at(&*material, &f);
            let mu = material.shear_modulus_Pa();
            for r in 0..9 {
                let (mut up, mut down) = (f, f);
                up[r / 3][r % 3] += h;
                down[r / 3][r % 3] -= h;
                let (up, down) = (at(&*material, &up), at(&*material, &down));
                let slope = (up.energy - down.energy) / (2.0 * h);
                // Where fibres begin to pull, their tangent jumps.
                let kink = f == STATES[0] && format!("{material:?}").starts_with("Fibre");
                let rough = if kink { 1.0 } else { 1e-6 };
                assert!(
                    (slope - here.stress[r / 3][r % 3]).abs() < 1e-6 * mu,
                    "{material:?}"
                );
                for q in 0..9 {
                    let rate = (up.stress[q / 3][q % 3] - down.stress[q / 3][q % 3]) / (2.0 * h);
                    let exact = here.tangent[q][r];
                    assert!(
                        (rate - exact).abs() < rough * mu,
                        "{material:?} {q} {r} {rate} {exact}"
                    );
                    assert!((exact - here.tangent[r][q]).abs() < 1e-9 * mu);
                }
            }
        }
    }
}

#[test]
fn at_rest_without_stress_and_with_the_shear_modulus() {
    for material in all() {
        let rest = at(&*material, &STATES[0]);
        let mu = material.shear_modulus_Pa();
        assert!(rest.energy.abs() < 1e-9 * mu);
        assert!(rest.stress.iter().flatten().all(|p| p.abs() < 1e-9 * mu));
        // ∂P_01/∂F_01 is μ in simple shear.
        assert!((rest.tangent[1][1] / mu - 1.0).abs() < 1e-9, "{material:?}");
    }
}

#[test]
fn energy_does_not_see_rotation_or_volume() {
    let turn = rotation_matrix(&[0.4, -1.0, 0.7]);
    for material in all() {
        let f = STATES[1];
        let here = at(&*material, &f).energy;
        assert!((at(&*material, &product(&turn, &f)).energy / here - 1.0).abs() < 1e-12);
        let swollen = f.map(|row| row.map(|v| 1.1 * v));
        assert!((at(&*material, &swollen).energy / here - 1.0).abs() < 1e-12);
    }
}

/// Uniaxial, incompressible, axial stress P = ∂W/∂λ with lateral λ^(−1/2):
/// neo-Hookean μ (λ − λ⁻²); Ogden with the one term α = 2 is the same.
#[test]
fn uniaxial_tension_of_the_neo_hookean() {
    let mu = 0.72e6 / 2.98;
    let neo: Box<dyn Material> = Box::new(NeoHookean::new(0.72e6, 0.49).unwrap());
    let ogden: Box<dyn Material> = Box::new(Ogden::new(vec![(mu, 2.0)], 1e7).unwrap());
    let mooney: Box<dyn Material> = Box::new(MooneyRivlin::new(0.5 * mu, 0.0, 1e7).unwrap());
    let yeoh: Box<dyn Material> = Box::new(Yeoh::new([0.5 * mu, 0.0, 0.0], 1e7).unwrap());
    for material in [neo, ogden, mooney, yeoh] {
        for (stretch, ratio) in [(1.5f64, 1.055_556), (0.7, -1.340_816)] {
            let side = stretch.powf(-0.5);
            let f = [[stretch, 0.0, 0.0], [0.0, side, 0.0], [0.0, 0.0, side]];
            let stress = at(&*material, &f).stress;
            let axial = stress[0][0] - stress[1][1] * side / stretch;
            assert!((axial / mu - ratio).abs() < 1e-6, "{material:?}");
        }
    }
}

/// Closed forms with W(I1, I2): uniaxial 2 (l − l⁻²)(W1 + W2 / l), equibiaxial
/// 2 (l − l⁻⁵)(W1 + l² W2), pure shear 2 (l − l⁻³)(W1 + W2).
#[test]
fn classical_tests_follow_their_closed_forms() {
    let (c10, c01) = (0.8e5, 0.4e5);
    let material = MooneyRivlin::new(c10, c01, f64::INFINITY).unwrap();
    for l in [0.6_f64, 1.0, 1.3, 2.5] {
        for (test, exact) in [
            ("uniaxial", 2.0 * (l - l.powi(-2)) * (c10 + c01 / l)),
            ("equibiaxial", 2.0 * (l - l.powi(-5)) * (c10 + l * l * c01)),
            ("pure_shear", 2.0 * (l - l.powi(-3)) * (c10 + c01)),
        ] {
            let stress = nominal_stress(&material, test, &[l]).unwrap()[0];
            assert!(
                (stress - exact).abs() < 1e-9 * (c10 + exact.abs()),
                "{test} {l}"
            );
        }
    }
    assert!(nominal_stress(&material, "shear", &[1.0]).is_err());
    assert!(nominal_stress(&material, "uniaxial", &[-1.0]).is_err());
}

#[test]
fn wrong_parameters_are_named() {
    let message = |e: FemError| e.to_string();
    assert!(message(MooneyRivlin::new(1.0, -0.5, 1.0).unwrap_err()).contains("c01_Pa"));
    assert!(message(Yeoh::new([1.0, -5.0, 0.1], 1.0).unwrap_err()).contains("c_Pa[1]"));
    assert!(message(Yeoh::new([1.0, 0.0, -0.1], 1.0).unwrap_err()).contains("c_Pa[2]"));
    assert!(message(Gent::new(1.0, 0.0, 1.0).unwrap_err()).contains("lock"));
    assert!(message(Ogden::new(vec![], 1.0).unwrap_err()).contains("terms"));
    assert!(message(Ogden::new(vec![(1.0, 0.0)], 1.0).unwrap_err()).contains("alpha"));
    let neo = Box::new(NeoHookean::new(1.0, 0.4).unwrap());
    assert!(message(Fibre::new(neo, [0.0; 3], 1.0, 1.0).unwrap_err()).contains("direction"));
}
