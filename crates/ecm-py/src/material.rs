//! Material models by name: the list, the moduli, the classical tests, the variables of a fit.

use std::collections::BTreeMap;

use ecm_fem::material::{self, MODELS, Parameters, nominal_stress};
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;

use crate::errors::fem_error;

/// A number, or a list of them, in a table of material parameters.
#[derive(FromPyObject)]
pub(crate) enum Numbers {
    One(f64),
    Many(Vec<f64>),
}

impl From<Numbers> for Vec<f64> {
    fn from(numbers: Numbers) -> Self {
        match numbers {
            Numbers::One(value) => vec![value],
            Numbers::Many(values) => values,
        }
    }
}

pub(crate) type NamedNumbers = BTreeMap<String, Numbers>;

pub(crate) fn parameters(named: NamedNumbers) -> Parameters {
    let numbers = named.into_iter();
    numbers.map(|(key, value)| (key, value.into())).collect()
}

/// Name, own parameters and whether these are lists of terms, of every material model.
#[pyfunction]
pub fn material_models() -> Vec<(&'static str, Vec<&'static str>, bool)> {
    let models = MODELS.iter();
    models
        .map(|m| (m.name, m.parameters.to_vec(), m.has_terms))
        .collect()
}

/// Shear and bulk modulus at small strain, Pa.
#[pyfunction]
pub fn material_moduli(model: &str, named: NamedNumbers) -> PyResult<(f64, f64)> {
    let material = material::choose(model, &parameters(named)).map_err(fem_error)?;
    Ok((material.shear_modulus_Pa(), material.bulk_modulus_Pa()))
}

/// Force per undeformed area, Pa, of the solid that keeps its volume.
#[pyfunction]
pub fn material_stress<'py>(
    py: Python<'py>,
    model: &str,
    named: NamedNumbers,
    test: &str,
    stretches: PyReadonlyArray1<'_, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let material = material::choose(model, &parameters(named)).map_err(fem_error)?;
    let stretches = stretches.as_array().to_vec();
    let stress = nominal_stress(&*material, test, &stretches).map_err(fem_error)?;
    Ok(PyArray1::from_vec(py, stress))
}

/// Free variables of a fit for a solid with this shear modulus.
#[pyfunction]
#[allow(non_snake_case)] // The unit stands in the name.
pub fn material_start<'py>(
    py: Python<'py>,
    model: &str,
    shear_modulus_Pa: f64,
    terms: usize,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let model = material::model(model).map_err(fem_error)?;
    let free = model.start(shear_modulus_Pa, terms).map_err(fem_error)?;
    Ok(PyArray1::from_vec(py, free))
}

/// Parameters, one after the other, of free variables.
#[pyfunction]
pub fn material_decode<'py>(
    py: Python<'py>,
    model: &str,
    free: PyReadonlyArray1<'_, f64>,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let model = material::model(model).map_err(fem_error)?;
    let free = free.as_array().to_vec();
    let values = model.decode(&free).map_err(fem_error)?;
    Ok(PyArray1::from_vec(py, values))
}
