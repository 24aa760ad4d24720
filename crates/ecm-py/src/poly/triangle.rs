//! Triangles of many rows, from which fits start.

use ecm_poly::regression::triangle::Triangle;
use numpy::{PyArray2, PyReadonlyArray2, PyUntypedArrayMethods};
use pyo3::prelude::*;

use super::{check_columns, numbers, shaped};

/// The triangle of the rows of several triangles (c, c), `rows` in all.
pub(super) fn merged(triangles: &[PyReadonlyArray2<'_, f64>], rows: usize) -> PyResult<Triangle> {
    let columns = triangles.first().map_or(0, |part| part.shape()[1]);
    for part in triangles {
        check_columns("a triangle", part.shape()[1], columns)?;
    }
    let parts = triangles.iter().map(|part| numbers(part).0);
    Ok(Triangle::of_parts(parts, columns, rows))
}

/// (c, c) triangle of the rows of several triangles.
#[pyfunction]
pub fn merged_triangle<'py>(
    py: Python<'py>,
    triangles: Vec<PyReadonlyArray2<'py, f64>>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let whole = merged(&triangles, 0)?;
    shaped(py, whole.to_row_major(), whole.columns(), whole.columns())
}
