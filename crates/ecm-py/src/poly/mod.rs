//! Polynomial and energy models, and model files: what their bindings share.

mod adapter;
mod energy;
mod model_file;
mod polynomial;
mod stepper;
mod triangle;

pub use adapter::Adapter;
pub use energy::EnergyEvaluator;
pub use model_file::{export_model, open_model, seal_model};
pub use polynomial::{PolynomialEvaluator, polynomial_exponents, polynomial_regressor};
pub use stepper::Stepper;
pub use triangle::merged_triangle;

use std::borrow::Cow;

use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::arrays::rows;
use crate::errors::ModelError;

fn error(error: ecm_poly::ModelError) -> PyErr {
    ModelError::new_err(error.to_string())
}

/// Row-major numbers of an array, borrowed where they already lie so.
fn numbers<'a>(array: &'a PyReadonlyArray2<'_, f64>) -> (Cow<'a, [f64]>, usize, usize) {
    let shape = array.shape();
    let view = array.as_array();
    let flat = match array.as_slice() {
        // A slice of columns that lie one after another is one as well.
        Ok(slice) if view.is_standard_layout() => Cow::Borrowed(slice),
        _ => Cow::Owned(view.iter().copied().collect()),
    };
    (flat, shape[0], shape[1])
}

/// Poses of an (N, 6) array, borrowed where they lie row by row.
fn poses_of<'a>(array: &'a PyReadonlyArray2<'_, f64>) -> PyResult<Cow<'a, [[f64; 6]]>> {
    match array.as_slice() {
        Ok(slice) if array.shape()[1] == 6 && array.as_array().is_standard_layout() => {
            Ok(Cow::Borrowed(slice.as_chunks().0))
        }
        _ => rows::<6>("poses", array).map(Cow::Owned),
    }
}

fn vector(array: &PyReadonlyArray1<'_, f64>) -> Vec<f64> {
    array.as_array().iter().copied().collect()
}

fn shaped<'py>(
    py: Python<'py>,
    flat: Vec<f64>,
    rows: usize,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    PyArray1::from_vec(py, flat).reshape([rows, columns])
}

fn check_columns(name: &str, found: usize, expected: usize) -> PyResult<()> {
    if found == expected {
        return Ok(());
    }
    Err(ModelError::new_err(format!(
        "{name} has {found} columns, expected {expected}"
    )))
}
