//! The part of a model document that describes the map.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use serde_json::{Map, Value, json};

use crate::energy::model::EnergyModel;
use crate::polynomial_model::PolynomialModel;

/// Pose columns of a model of all six components, in their order.
pub const POSE: [&str; 6] = [
    "x_m",
    "y_m",
    "z_m",
    "theta_x_rad",
    "theta_y_rad",
    "theta_z_rad",
];
/// Wrench columns of a model of all six components, in their order.
pub const WRENCH: [&str; 6] = ["fx_N", "fy_N", "fz_N", "tau_x_Nm", "tau_y_Nm", "tau_z_Nm"];

/// Name of an energy: `energyD`, then `-revolution` or `-general`, then `+group` for each group.
pub fn energy_name(model: &EnergyModel) -> String {
    let mut name = format!("energy{}", model.degree());
    if model.symmetry().name() != "alike" {
        name = format!("{name}-{}", model.symmetry().name());
    }
    for group in model.groups() {
        name = format!("{name}+{}", group.name());
    }
    name
}

/// Terms, scales and coefficients of an energy.
pub fn energy_document(model: &EnergyModel) -> Map<String, Value> {
    let mut terms: Vec<Vec<u8>> = model.exponents().iter().map(|row| row.to_vec()).collect();
    terms.extend(model.group_terms().iter().map(|term| term.row()));
    let mut document = object(json!({
        "kind": "energy",
        "name": energy_name(model),
        "inputs": POSE,
        "outputs": WRENCH,
        "length_m": model.length_m(),
        "degree": model.degree(),
        "symmetry": model.symmetry().name(),
        "normalisation": {"scale": model.scale()},
        "terms": terms,
        "coefficients": model.coefficients(),
    }));
    if !model.groups().is_empty() {
        let names: Vec<&str> = model.groups().iter().map(|group| group.name()).collect();
        document.insert("groups".into(), json!(names));
    }
    document
}

/// Terms, ranges and coefficients of a polynomial from `inputs` to `outputs` columns.
pub fn polynomial_document<S: AsRef<str>>(
    model: &PolynomialModel,
    inputs: &[S],
    outputs: &[S],
) -> Map<String, Value> {
    let names = |columns: &[S]| -> Vec<String> {
        columns.iter().map(|name| name.as_ref().into()).collect()
    };
    let coefficients: Vec<&[f64]> = model
        .coefficients()
        .chunks(model.outputs().max(1))
        .collect();
    let terms: Vec<&[u8]> = model.exponents().chunks(model.inputs().max(1)).collect();
    object(json!({
        "kind": "polynomial",
        "name": format!("poly:{}", model.degree()),
        "inputs": names(inputs),
        "outputs": names(outputs),
        "length_m": null,
        "degree": model.degree(),
        "normalisation": {"lower": model.lower(), "upper": model.upper()},
        "terms": terms,
        "coefficients": coefficients,
    }))
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}
