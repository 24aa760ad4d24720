//! The model in a model file, ready for evaluation.

use alloc::boxed::Box;
use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

use serde_json::{Map, Value};

use crate::energy::actuated::ActuatedModel;
use crate::energy::groups::Group;
use crate::energy::invariants::Symmetry;
use crate::energy::model::EnergyModel;
use crate::error::ModelError;
use crate::polynomial_model::PolynomialModel;

/// A model of one of the families.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub enum Model {
    /// Free polynomials.
    Polynomial(Box<PolynomialModel>),
    /// An energy; of kind `physics` with its factor multiplied in.
    Energy(Box<EnergyModel>),
    /// An energy of pose and actuation, written as its `parts`.
    Actuated(Box<ActuatedModel>),
}

impl Model {
    /// From the document that [`crate::open_model`] returns, without its effects.
    pub fn from_document(document: &Map<String, Value>) -> Result<Self, ModelError> {
        let degree = document.get("degree").and_then(Value::as_u64).unwrap_or(0) as usize;
        let ranges = |key: &str| numbers(document.get("normalisation").and_then(|n| n.get(key)));
        let coefficients = numbers(document.get("coefficients"));
        if document.get("kind").and_then(Value::as_str) == Some("polynomial") {
            let (lower, upper) = (ranges("lower"), ranges("upper"));
            return PolynomialModel::from_coefficients(degree, &lower, &upper, &coefficients)
                .map(|model| Model::Polynomial(Box::new(model)));
        }
        let kind = document.get("kind").and_then(Value::as_str).unwrap_or("");
        if kind == "actuated" {
            return actuated(document, degree).map(|model| Model::Actuated(Box::new(model)));
        }
        if !matches!(kind, "energy" | "physics") {
            return Err(ModelError::Setting {
                name: "kind",
                found: format!("{kind:?}"),
                expected: "a polynomial, an energy or a physics model: others are not exported",
            });
        }
        let name = document
            .get("symmetry")
            .and_then(Value::as_str)
            .unwrap_or("");
        let symmetry = Symmetry::from_name(name).ok_or_else(|| ModelError::Key {
            key: "symmetry".to_string(),
            found: format!("{name:?}"),
            expected: "alike, revolution or general".to_string(),
        })?;
        let scale = ranges("scale");
        let scale = [0, 1].map(|i| scale.get(i).copied().unwrap_or(f64::NAN));
        let factor = document
            .get("factor")
            .and_then(Value::as_f64)
            .unwrap_or(1.0);
        let weights: Vec<f64> = coefficients.iter().map(|c| factor * c).collect();
        let length = document.get("length_m").and_then(Value::as_f64);
        let names = document.get("groups").and_then(Value::as_array);
        let names: Vec<&str> = names
            .into_iter()
            .flatten()
            .filter_map(Value::as_str)
            .collect();
        EnergyModel::with_groups(
            length.unwrap_or(f64::NAN),
            degree,
            symmetry,
            &Group::from_names(&names, symmetry)?,
            scale,
            &weights,
        )
        .map(|model| Model::Energy(Box::new(model)))
    }

    /// Numbers of inputs and outputs.
    pub fn shape(&self) -> (usize, usize) {
        match self {
            Model::Polynomial(model) => (model.inputs(), model.outputs()),
            Model::Energy(_) => (6, 6),
            Model::Actuated(model) => (6 + model.actuators(), 6),
        }
    }

    /// h and ∂h/∂p of one point: pose, and inputs of actuators behind it.
    pub fn value_and_jacobian(&self, point: &[f64]) -> Result<(Vec<f64>, Vec<f64>), ModelError> {
        match self {
            Model::Polynomial(model) => Ok((model.predict(point)?, model.jacobian(point)?)),
            Model::Actuated(model) => model.value_and_jacobian(point),
            Model::Energy(model) => {
                let pose = core::array::from_fn(|i| point.get(i).copied().unwrap_or(f64::NAN));
                let k = model.stiffness(&[pose], ecm_se3::stiffness::StiffnessKind::Partial)?;
                let h = model.predict(&[pose])?;
                Ok((
                    h.as_flattened().to_vec(),
                    k.as_flattened().as_flattened().to_vec(),
                ))
            }
        }
    }
}

/// An energy of pose and actuation, from `scale`, `input_scale`, and `powers` and `coefficients_J` of
/// each of its `parts`.
fn actuated(document: &Map<String, Value>, degree: usize) -> Result<ActuatedModel, ModelError> {
    let scale = numbers(document.get("scale"));
    let parts = document.get("parts").and_then(Value::as_array);
    let parts: Vec<(Vec<u8>, Vec<f64>)> = (parts.into_iter().flatten())
        .map(|part| {
            let powers = numbers(part.get("powers"));
            let powers = powers.iter().map(|&e| e as u8).collect();
            (powers, numbers(part.get("coefficients_J")))
        })
        .collect();
    ActuatedModel::new(
        (document.get("length_m").and_then(Value::as_f64)).unwrap_or(f64::NAN),
        degree,
        [0, 1].map(|i| scale.get(i).copied().unwrap_or(f64::NAN)),
        &numbers(document.get("input_scale")),
        &parts,
    )
}

/// All numbers of a nested list, row by row.
fn numbers(value: Option<&Value>) -> Vec<f64> {
    match value {
        Some(Value::Array(list)) => list.iter().flat_map(|v| numbers(Some(v))).collect(),
        Some(value) => value.as_f64().into_iter().collect(),
        None => Vec::new(),
    }
}
