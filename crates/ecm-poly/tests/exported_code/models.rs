//! Models of every kind that is exported.

use ecm_poly::basis::exponents;
use ecm_poly::energy::groups::{Group, GroupTerm, group_terms};
use ecm_poly::energy::terms::terms;
use ecm_poly::model_file::map::{POSE, WRENCH};
use ecm_poly::stepper::{Branch, Effects, Softening, diagonal};
use ecm_poly::{Symmetry, open_model, seal_model};
use serde_json::{Map, Value, json};

pub fn wave(n: usize) -> Vec<f64> {
    (0..n).map(|i| ((i as f64 + 1.0) * 12.9898).sin()).collect()
}

pub fn sealed(document: &Value) -> Map<String, Value> {
    open_model(&seal_model(&document.to_string()).unwrap()).unwrap()
}

pub fn energy(symmetry: Symmetry, degree: usize) -> Map<String, Value> {
    let rows = terms(symmetry, degree).unwrap();
    sealed(&json!({
        "kind": "energy", "inputs": POSE, "outputs": WRENCH, "length_m": 0.1034, "degree": degree,
        "symmetry": symmetry.name(), "normalisation": {"scale": [0.03, 0.9]},
        "coefficients": wave(rows.len()), "terms": rows,
    }))
}

/// An energy with broken symmetries.
pub fn broken(names: &[&str]) -> Map<String, Value> {
    let groups = Group::from_names(names, Symmetry::Alike).unwrap();
    let mut rows: Vec<Vec<u8>> = terms(Symmetry::Alike, 4)
        .unwrap()
        .iter()
        .map(|row| row.to_vec())
        .collect();
    rows.extend(group_terms(&groups, 4).iter().map(GroupTerm::row));
    sealed(&json!({
        "kind": "energy", "inputs": POSE, "outputs": WRENCH, "length_m": 0.1034, "degree": 4,
        "symmetry": "alike", "groups": names, "normalisation": {"scale": [0.03, 0.9]},
        "coefficients": wave(rows.len()), "terms": rows,
    }))
}

pub fn polynomial(inputs: usize, outputs: usize, degree: usize) -> Map<String, Value> {
    let table = exponents(inputs, degree).unwrap();
    let rows: Vec<&[u8]> = table.chunks(inputs).collect();
    let weights = wave(rows.len() * outputs);
    let coefficients: Vec<&[f64]> = weights.chunks(outputs).collect();
    let upper: Vec<f64> = (0..inputs).map(|i| 0.5 + 0.1 * i as f64).collect();
    sealed(&json!({
        "kind": "polynomial", "inputs": POSE[..inputs], "outputs": WRENCH[..outputs],
        "length_m": null, "degree": degree, "terms": rows, "coefficients": coefficients,
        "normalisation": {"lower": vec![-0.4; inputs], "upper": upper},
    }))
}

/// One of each effect of time.
pub fn effects() -> Effects<f64> {
    let mut effects = Effects::none(0.1034);
    effects.stiffness = diagonal(&[40.0, 30.0, 30.0, 0.5, 1.0, 1.0]);
    for (branch, (tau_s, linear)) in effects
        .branches
        .iter_mut()
        .zip([(0.5, true), (30.0, false)])
    {
        *branch = Branch {
            share: 0.3,
            tau_s,
            linear,
        };
    }
    effects.friction = effects.stiffness.map(|row| row.map(|k| 0.3 * k));
    effects.slip = [2e-3, 2e-3, 2e-3, 0.05, 0.05, 0.05];
    effects.play = [0.0, 1e-3, 5e-4, 0.02, 0.0, 0.03];
    effects.softer_per_kelvin = 5e-3;
    effects.reference_degc = 21.5;
    effects.growth_per_kelvin = 2e-5;
    effects.ageing_per_s = 1e-5;
    effects.settling_per_s = 1.0 / 3e3;
    effects.damping = diagonal(&[2e-3, 2e-3, 2e-3, 2e-4, 2e-4, 2e-4]);
    effects.softening.share = 0.1;
    effects.set_share = 0.02;
    effects.temperature_range_degc = Some([15.0, 30.0]);
    effects.age_range_s = Some([0.0, 7200.0]);
    effects
}

/// The same of columns that have no frame, with what couples them.
pub fn effects_of_columns() -> Effects<f64> {
    let mut effects = effects();
    effects.length_m = 0.0;
    effects.columns = Some([[-1e3; 6], [1e3; 6]]);
    (effects.stiffness[0][2], effects.stiffness[1][0]) = (7.0, -3.0);
    effects.friction[1][2] = 5.0;
    effects.damping[0][1] = 3e-3;
    effects.softening = Softening {
        share: 0.1,
        width: 0.4,
        hyperbolic: false,
        of_pose: [0.0; 6],
        of_wrench: [1.0, 1.0, 1.0, 0.0, 0.0, 0.0],
    };
    effects
}
