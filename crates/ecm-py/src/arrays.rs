//! Array conversions: read-only numpy views in, owned arrays out.

use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray2, PyUntypedArrayMethods,
};
use pyo3::prelude::*;

use crate::errors::EcmError;

/// Rows of an (N, C) array as fixed-size rows; the error names the argument and the shape.
pub fn rows<const C: usize>(
    name: &str,
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<[f64; C]>> {
    let shape = array.shape();
    if shape[1] != C {
        return Err(EcmError::new_err(format!(
            "{name} has shape ({}, {}), expected (N, {C})",
            shape[0], shape[1]
        )));
    }
    let view = array.as_array();
    Ok(view
        .outer_iter()
        .map(|row| std::array::from_fn(|j| row[j]))
        .collect())
}

/// Row-major copy of a two-dimensional array with its shape.
pub fn matrix(array: &PyReadonlyArray2<'_, f64>) -> (Vec<f64>, usize, usize) {
    let shape = array.shape();
    (
        array.as_array().iter().copied().collect(),
        shape[0],
        shape[1],
    )
}

/// (N, C) array of fixed-size rows; an empty list keeps its columns.
pub fn from_rows<'py, const C: usize>(
    py: Python<'py>,
    rows: &[[f64; C]],
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let flat: Vec<f64> = rows.iter().flatten().copied().collect();
    PyArray1::from_vec(py, flat).reshape([rows.len(), C])
}

/// (N, A, B) array of fixed-size matrices.
pub fn from_matrices<'py, const A: usize, const B: usize>(
    py: Python<'py>,
    matrices: &[[[f64; B]; A]],
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let flat: Vec<f64> = matrices.iter().flatten().flatten().copied().collect();
    PyArray1::from_vec(py, flat).reshape([matrices.len(), A, B])
}
