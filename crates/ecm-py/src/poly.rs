//! Polynomial and energy models, and model files.

use std::borrow::Cow;

use ecm_poly::basis::exponents;
use ecm_poly::energy::regressor::regressor;
use ecm_poly::energy::{EnergyTerms, Group};
use ecm_poly::export::Precision;
use ecm_poly::regression::triangle::Triangle;
use ecm_poly::{EnergyFit, Method, Symmetry};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::rows;
use crate::errors::ModelError;
use crate::se3::{matrices, stiffness_kind};

fn error(error: ecm_poly::ModelError) -> PyErr {
    ModelError::new_err(error.to_string())
}

/// Row-major numbers of an array, borrowed where they already lie so.
fn numbers<'a>(array: &'a PyReadonlyArray2<'_, f64>) -> (Cow<'a, [f64]>, usize, usize) {
    let shape = array.shape();
    let flat = match array.as_slice() {
        Ok(slice) => Cow::Borrowed(slice),
        Err(_) => Cow::Owned(array.as_array().iter().copied().collect()),
    };
    (flat, shape[0], shape[1])
}

/// Poses of an (N, 6) array, borrowed where they lie row by row.
fn poses_of<'a>(array: &'a PyReadonlyArray2<'_, f64>) -> PyResult<Cow<'a, [[f64; 6]]>> {
    match array.as_slice() {
        Ok(slice) if array.shape()[1] == 6 => Ok(Cow::Borrowed(slice.as_chunks().0)),
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

/// (k, n_inputs), k = C(degree + n_inputs, degree), in the order of the paper's eq. (4).
#[pyfunction]
pub fn polynomial_exponents(
    py: Python<'_>,
    n_inputs: usize,
    degree: usize,
) -> PyResult<Bound<'_, PyArray2<i64>>> {
    let table = exponents(n_inputs, degree).map_err(error)?;
    let flat: Vec<i64> = table.into_iter().map(i64::from).collect();
    let k = flat.len() / n_inputs;
    PyArray1::from_vec(py, flat).reshape([k, n_inputs])
}

/// (N, k) regressor of inputs mapped from [lower, upper] to [-1, 1].
#[pyfunction]
pub fn polynomial_regressor<'py>(
    py: Python<'py>,
    inputs: PyReadonlyArray2<'py, f64>,
    degree: usize,
    lower: PyReadonlyArray1<'py, f64>,
    upper: PyReadonlyArray1<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let (points, n, columns) = numbers(&inputs);
    let (lower, upper) = (vector(&lower), vector(&upper));
    check_columns("inputs", columns, lower.len())?;
    let x = ecm_poly::polynomial_model::polynomial_regressor(&points, degree, &lower, &upper)
        .map_err(error)?;
    let k = exponents(columns, degree).map_err(error)?.len() / columns;
    shaped(py, x, n, k)
}

fn check_columns(name: &str, found: usize, expected: usize) -> PyResult<()> {
    if found == expected {
        return Ok(());
    }
    Err(ModelError::new_err(format!(
        "{name} has {found} columns, expected {expected}"
    )))
}

/// The triangle of the rows of several triangles (c, c), `rows` in all.
fn merged(triangles: &[PyReadonlyArray2<'_, f64>], rows: usize) -> PyResult<Triangle> {
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

/// Singular values (r,) and errors (r, m).
type Curves<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// n inputs to m outputs; the paper's map has n = m = 6.
#[pyclass(frozen, module = "ecm._native")]
pub struct PolynomialModel(ecm_poly::PolynomialModel);

#[pymethods]
impl PolynomialModel {
    /// threshold: PCR drops singular values of the normalised, un-centred regressor below it.
    #[staticmethod]
    #[pyo3(signature = (inputs, outputs, degree, *, method = "least_squares", threshold = 0.0, ridge = 0.0, weights = None))]
    #[allow(clippy::too_many_arguments)]
    fn fit(
        py: Python<'_>,
        inputs: PyReadonlyArray2<'_, f64>,
        outputs: PyReadonlyArray2<'_, f64>,
        degree: usize,
        method: &str,
        threshold: f64,
        ridge: f64,
        weights: Option<PyReadonlyArray1<'_, f64>>,
    ) -> PyResult<Self> {
        let method = match method {
            "least_squares" => Method::LeastSquares,
            "ridge" => Method::Ridge(ridge),
            "pcr" => Method::Pcr(threshold),
            _ => {
                return Err(ModelError::new_err(format!(
                    "method is {method:?}, expected least_squares, ridge or pcr"
                )));
            }
        };
        let (points, n, columns) = numbers(&inputs);
        let (values, m, outputs) = numbers(&outputs);
        if n != m {
            return Err(ModelError::new_err(format!(
                "inputs have {n} rows and outputs {m}, expected as many"
            )));
        }
        let weights = weights.as_ref().map(vector);
        py.detach(|| {
            ecm_poly::PolynomialModel::fit(
                &points,
                columns,
                &values,
                outputs,
                degree,
                method,
                weights.as_deref(),
            )
        })
        .map(Self)
        .map_err(error)
    }

    #[staticmethod]
    fn from_coefficients(
        degree: usize,
        lower: PyReadonlyArray1<'_, f64>,
        upper: PyReadonlyArray1<'_, f64>,
        coefficients: PyReadonlyArray2<'_, f64>,
    ) -> PyResult<Self> {
        let (lower, upper) = (vector(&lower), vector(&upper));
        let table = exponents(lower.len(), degree).map_err(error)?;
        let (flat, k, _) = numbers(&coefficients);
        if k * lower.len() != table.len() {
            return Err(ModelError::new_err(format!(
                "coefficients have {k} rows, expected {} of degree {degree} in {} inputs",
                table.len() / lower.len(),
                lower.len()
            )));
        }
        ecm_poly::PolynomialModel::from_coefficients(degree, &lower, &upper, &flat)
            .map(Self)
            .map_err(error)
    }

    /// Singular values (r,) and leave-one-out RMSE (r, m) of keeping the first 1, 2, ... r of them.
    #[staticmethod]
    fn leave_one_out<'py>(
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
        outputs: PyReadonlyArray2<'py, f64>,
        degree: usize,
    ) -> PyResult<Curves<'py>> {
        let (points, _, columns) = numbers(&inputs);
        let (values, _, outputs) = numbers(&outputs);
        let curves = py
            .detach(|| {
                ecm_poly::PolynomialModel::leave_one_out(&points, columns, &values, outputs, degree)
            })
            .map_err(error)?;
        let ranks = curves.singular_values.len();
        Ok((
            PyArray1::from_vec(py, curves.singular_values),
            shaped(py, curves.rmse, ranks, outputs)?,
        ))
    }

    /// (c, c) triangle of [regressor | outputs] of some of the rows of `fit_triangles`.
    #[staticmethod]
    fn triangle<'py>(
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
        outputs: PyReadonlyArray2<'py, f64>,
        degree: usize,
        lower: PyReadonlyArray1<'py, f64>,
        upper: PyReadonlyArray1<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let ((points, _, columns), (values, _, outputs)) = (numbers(&inputs), numbers(&outputs));
        let ranges = (vector(&lower), vector(&upper));
        check_columns("inputs", columns, ranges.0.len())?;
        let part = py
            .detach(|| {
                let ranges = (ranges.0.as_slice(), ranges.1.as_slice());
                ecm_poly::PolynomialModel::triangle(&points, &values, outputs, degree, ranges)
            })
            .map_err(error)?;
        shaped(py, part.to_row_major(), part.columns(), part.columns())
    }

    /// Least squares of the rows of several triangles, `rows` in all.
    #[staticmethod]
    fn fit_triangles(
        py: Python<'_>,
        triangles: Vec<PyReadonlyArray2<'_, f64>>,
        rows: usize,
        degree: usize,
        lower: PyReadonlyArray1<'_, f64>,
        upper: PyReadonlyArray1<'_, f64>,
    ) -> PyResult<Self> {
        let whole = merged(&triangles, rows)?;
        let (lower, upper) = (vector(&lower), vector(&upper));
        let method = Method::LeastSquares;
        py.detach(|| {
            ecm_poly::PolynomialModel::of_triangle(&whole, degree, (&lower, &upper), method)
        })
        .map(Self)
        .map_err(error)
    }

    /// Condition number of the regressor without normalisation.
    #[staticmethod]
    fn condition_number_raw(
        py: Python<'_>,
        inputs: PyReadonlyArray2<'_, f64>,
        degree: usize,
    ) -> PyResult<f64> {
        let (points, _, columns) = numbers(&inputs);
        py.detach(|| ecm_poly::PolynomialModel::condition_number_raw(&points, columns, degree))
            .map_err(error)
    }

    /// (N,) variance of the prediction in units of the residual variance.
    fn leverage<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (points, _) = self.points(&inputs)?;
        let leverage = py.detach(|| self.0.leverage(&points)).map_err(error)?;
        Ok(PyArray1::from_vec(py, leverage))
    }

    /// (N, m) standard deviation of a new measurement around the prediction.
    fn prediction_sd<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (points, n) = self.points(&inputs)?;
        let sd = py.detach(|| self.0.prediction_sd(&points)).map_err(error)?;
        shaped(py, sd, n, self.0.outputs())
    }

    fn predict<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (points, n) = self.points(&inputs)?;
        let values = py.detach(|| self.0.predict(&points)).map_err(error)?;
        shaped(py, values, n, self.0.outputs())
    }

    /// (N, m, n); K = dh/dp for the paper's map.
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (points, n) = self.points(&inputs)?;
        let values = py.detach(|| self.0.jacobian(&points)).map_err(error)?;
        PyArray1::from_vec(py, values).reshape([n, self.0.outputs(), self.0.inputs()])
    }

    /// The map's part of a model file, with these column names.
    fn document<'py>(
        &self,
        py: Python<'py>,
        inputs: Vec<String>,
        outputs: Vec<String>,
    ) -> PyResult<Bound<'py, PyDict>> {
        let shape = (self.0.inputs(), self.0.outputs());
        if (inputs.len(), outputs.len()) != shape {
            return Err(ModelError::new_err(format!(
                "{} inputs and {} outputs are named, the model has {} and {}",
                inputs.len(),
                outputs.len(),
                shape.0,
                shape.1
            )));
        }
        let document = ecm_poly::model_file::map::polynomial_document(&self.0, &inputs, &outputs);
        parsed(py, &serde_json::Value::Object(document).to_string())
    }

    #[getter]
    fn degree(&self) -> usize {
        self.0.degree()
    }
    /// (k, m), of the normalised inputs, outputs in their own unit.
    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let flat = self.0.coefficients().to_vec();
        let k = flat.len() / self.0.outputs();
        shaped(py, flat, k, self.0.outputs())
    }
    #[getter]
    fn lower<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.lower())
    }
    #[getter]
    fn upper<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.upper())
    }
    /// Condition number of the normalised regressor over the singular values in use (after PCR).
    #[getter]
    fn condition_number(&self) -> f64 {
        self.0.facts().condition_number
    }
    #[getter]
    fn rank(&self) -> usize {
        self.0.facts().rank
    }
    /// (k, k) covariance of the coefficients of an output in units of its residual variance.
    #[getter]
    fn unscaled_covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let flat = self.0.facts().unscaled_covariance.clone();
        let k = flat.len().isqrt();
        shaped(py, flat, k, k)
    }
    /// (m,) residual square per degree of freedom; NaN where it was not fitted.
    #[getter]
    fn residual_variance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.facts().residual_variance)
    }
}

impl PolynomialModel {
    /// Row-major inputs and their number of rows.
    fn points<'a>(
        &self,
        inputs: &'a PyReadonlyArray2<'_, f64>,
    ) -> PyResult<(Cow<'a, [f64]>, usize)> {
        let (points, rows, columns) = numbers(inputs);
        check_columns("inputs", columns, self.0.inputs())?;
        Ok((points, rows))
    }
}

/// U(q) in mid-frame coordinates; Q = dU/dq; h by inverting conventions' two lines.
#[pyclass(frozen, module = "ecm._native")]
pub struct EnergyModel(ecm_poly::EnergyModel);

#[pymethods]
impl EnergyModel {
    /// covariance: (N, 6, 6) of each row's wrench; without it the components are weighted
    /// by the spread of each.
    #[staticmethod]
    #[pyo3(signature = (poses, wrenches, *, length_m, degree, symmetry = "alike", covariance = None, groups = Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn fit(
        py: Python<'_>,
        poses: PyReadonlyArray2<'_, f64>,
        wrenches: PyReadonlyArray2<'_, f64>,
        length_m: f64,
        degree: usize,
        symmetry: &str,
        covariance: Option<PyReadonlyArray3<'_, f64>>,
        groups: Vec<String>,
    ) -> PyResult<Self> {
        let symmetry = symmetry_of(symmetry)?;
        let groups = Group::from_names(&groups, symmetry).map_err(error)?;
        let poses = poses_of(&poses)?;
        let wrenches = rows::<6>("wrenches", &wrenches)?;
        let covariance = match &covariance {
            Some(array) => Some(matrices::<6, 6>("covariance", array)?),
            None => None,
        };
        py.detach(|| {
            let fit = EnergyFit {
                length_m,
                degree,
                symmetry,
                groups: &groups,
                covariance: covariance.as_deref(),
            };
            fit.run(&poses, &wrenches)
        })
        .map(Self)
        .map_err(error)
    }

    /// (2,) length and angle that a fit to these poses makes dimensionless with.
    #[staticmethod]
    fn scale_of<'py>(
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        length_m: f64,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let poses = poses_of(&poses)?;
        let scale = ecm_poly::energy::fit::scale_of(&poses, length_m).map_err(error)?;
        Ok(PyArray1::from_slice(py, &scale))
    }

    /// (c, c) triangle of the whitened [regressor | wrenches] of some of the rows of `fit_triangles`.
    #[staticmethod]
    #[pyo3(signature = (poses, wrenches, covariance, *, length_m, degree, symmetry, scale, groups = Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn triangle<'py>(
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        wrenches: PyReadonlyArray2<'py, f64>,
        covariance: PyReadonlyArray3<'py, f64>,
        length_m: f64,
        degree: usize,
        symmetry: &str,
        scale: PyReadonlyArray1<'py, f64>,
        groups: Vec<String>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let symmetry = symmetry_of(symmetry)?;
        let groups = Group::from_names(&groups, symmetry).map_err(error)?;
        let poses = poses_of(&poses)?;
        let wrenches = rows::<6>("wrenches", &wrenches)?;
        let covariance = matrices::<6, 6>("covariance", &covariance)?;
        let scale = scale_of(&scale)?;
        let part = py
            .detach(|| {
                let fit = EnergyFit {
                    length_m,
                    degree,
                    symmetry,
                    groups: &groups,
                    covariance: Some(&covariance),
                };
                fit.triangle(&poses, &wrenches, scale)
            })
            .map_err(error)?;
        shaped(py, part.to_row_major(), part.columns(), part.columns())
    }

    /// The fit of several triangles, which stand for `rows` poses.
    #[staticmethod]
    #[pyo3(signature = (triangles, rows, *, length_m, degree, symmetry, scale, groups = Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn fit_triangles(
        py: Python<'_>,
        triangles: Vec<PyReadonlyArray2<'_, f64>>,
        rows: usize,
        length_m: f64,
        degree: usize,
        symmetry: &str,
        scale: PyReadonlyArray1<'_, f64>,
        groups: Vec<String>,
    ) -> PyResult<Self> {
        let symmetry = symmetry_of(symmetry)?;
        let groups = Group::from_names(&groups, symmetry).map_err(error)?;
        let scale = scale_of(&scale)?;
        let whole = merged(&triangles, 6 * rows)?;
        py.detach(|| {
            let fit = EnergyFit {
                length_m,
                degree,
                symmetry,
                groups: &groups,
                covariance: None,
            };
            fit.of_triangle(whole, scale, true)
        })
        .map(Self)
        .map_err(error)
    }

    #[staticmethod]
    #[pyo3(signature = (*, length_m, degree, symmetry, scale, coefficients, groups = Vec::new()))]
    fn from_coefficients(
        length_m: f64,
        degree: usize,
        symmetry: &str,
        scale: PyReadonlyArray1<'_, f64>,
        coefficients: PyReadonlyArray1<'_, f64>,
        groups: Vec<String>,
    ) -> PyResult<Self> {
        let symmetry = symmetry_of(symmetry)?;
        let (scale, coefficients) = (scale_of(&scale)?, vector(&coefficients));
        let groups = Group::from_names(&groups, symmetry).map_err(error)?;
        ecm_poly::EnergyModel::with_groups(
            length_m,
            degree,
            symmetry,
            &groups,
            scale,
            &coefficients,
        )
        .map(Self)
        .map_err(error)
    }

    /// (N, 6, k): h = regressor @ coefficients.
    #[staticmethod]
    #[pyo3(signature = (poses, *, length_m, degree, symmetry, scale, groups = Vec::new()))]
    #[allow(clippy::too_many_arguments)]
    fn regressor<'py>(
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        length_m: f64,
        degree: usize,
        symmetry: &str,
        scale: PyReadonlyArray1<'py, f64>,
        groups: Vec<String>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let symmetry = symmetry_of(symmetry)?;
        let scale = scale_of(&scale)?;
        let poses = poses_of(&poses)?;
        let groups = Group::from_names(&groups, symmetry).map_err(error)?;
        let terms = EnergyTerms::new(symmetry, degree, &groups).map_err(error)?;
        let flat = py
            .detach(|| regressor(&poses, length_m, &terms, scale))
            .map_err(error)?;
        PyArray1::from_vec(py, flat).reshape([poses.len(), 6, terms.count()])
    }

    #[pyo3(name = "energy_J")]
    fn energy<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let poses = poses_of(&poses)?;
        let energies = py.detach(|| self.0.energy(&poses)).map_err(error)?;
        Ok(PyArray1::from_vec(py, energies))
    }

    fn predict<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let poses = poses_of(&poses)?;
        let wrenches = py.detach(|| self.0.predict(&poses)).map_err(error)?;
        shaped(py, wrenches.into_flattened(), poses.len(), 6)
    }

    /// (N, 6, 6) covariance of the predicted wrench, of the coefficients' covariance.
    fn prediction_covariance<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let poses = poses_of(&poses)?;
        let results = py
            .detach(|| self.0.prediction_covariance(&poses))
            .map_err(error)?;
        PyArray1::from_vec(py, results.into_flattened().into_flattened()).reshape([
            poses.len(),
            6,
            6,
        ])
    }

    #[pyo3(signature = (poses, kind = "partial"))]
    fn stiffness<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        kind: &str,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let kind = stiffness_kind(kind)?;
        let poses = poses_of(&poses)?;
        let results = py
            .detach(|| self.0.stiffness(&poses, kind))
            .map_err(error)?;
        PyArray1::from_vec(py, results.into_flattened().into_flattened()).reshape([
            poses.len(),
            6,
            6,
        ])
    }

    /// The map's part of a model file.
    fn document<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let document = ecm_poly::model_file::map::energy_document(&self.0);
        parsed(py, &serde_json::Value::Object(document).to_string())
    }
    /// `energyD`, then `-revolution` or `-general`, then `+group` for each group.
    #[getter]
    fn name(&self) -> String {
        ecm_poly::model_file::map::energy_name(&self.0)
    }

    #[getter]
    fn coefficients<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.coefficients())
    }
    /// (k, k) of the coefficients.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let k = self.0.coefficients().len();
        shaped(py, self.0.covariance().to_vec(), k, k)
    }
    /// (k, n_invariants) exponents.
    #[getter]
    fn terms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let table = self.0.exponents();
        let flat: Vec<i64> = table.iter().flatten().map(|&e| i64::from(e)).collect();
        PyArray1::from_vec(py, flat).reshape([table.len(), 6])
    }
    /// (g, 7) powers of c_x, theta_x, C, C*, D, D*, and 0 for Re or 1 for Im.
    #[getter]
    fn group_terms<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let table = self.0.group_terms();
        let rows = table.iter().flat_map(|term| term.row());
        let flat: Vec<i64> = rows.map(i64::from).collect();
        PyArray1::from_vec(py, flat).reshape([table.len(), 7])
    }
    /// Names of the broken symmetries.
    #[getter]
    fn groups(&self) -> Vec<&'static str> {
        self.0.groups().iter().map(|group| group.name()).collect()
    }
    /// (2,) length and angle that make the coordinates dimensionless.
    #[getter]
    fn scale<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, &self.0.scale())
    }
    #[getter]
    fn length_m(&self) -> f64 {
        self.0.length_m()
    }
    #[getter]
    fn degree(&self) -> usize {
        self.0.degree()
    }
    /// Singular values that the fit used.
    #[getter]
    fn rank(&self) -> usize {
        self.0.rank()
    }
    /// kappa of the whitened, column-scaled regressor; NaN where it was not fitted.
    #[getter]
    fn condition_number(&self) -> f64 {
        self.0.condition_number()
    }
    /// Whitened residual square per degree of freedom: 1 where the covariance is right.
    #[getter]
    fn residual_variance(&self) -> f64 {
        self.0.residual_variance()
    }
    #[getter]
    fn symmetry(&self) -> &'static str {
        self.0.symmetry().name()
    }
}

fn symmetry_of(name: &str) -> PyResult<Symmetry> {
    Symmetry::from_name(name).ok_or_else(|| {
        ModelError::new_err(format!(
            "symmetry is {name:?}, expected alike, revolution or general"
        ))
    })
}

fn scale_of(scale: &PyReadonlyArray1<'_, f64>) -> PyResult<[f64; 2]> {
    let values = vector(scale);
    <[f64; 2]>::try_from(values).map_err(|values| {
        ModelError::new_err(format!(
            "scale has {} numbers, expected a length in m and an angle in rad",
            values.len()
        ))
    })
}

/// A model document (JSON text, interfaces.md) checked, and sealed with its sha256.
#[pyfunction]
pub fn seal_model(document: &str) -> PyResult<String> {
    ecm_poly::seal_model(document).map_err(error)
}

/// The document of a model file; ModelError when its sum, version, kind or a range is wrong.
#[pyfunction]
pub fn open_model<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    ecm_poly::open_model(text).map_err(error)?;
    parsed(py, text)
}

/// JSON as Python objects, by Python's own reader.
fn parsed<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    let document = py.import("json")?.call_method1("loads", (text,))?;
    Ok(document.cast_into::<PyDict>()?)
}

/// Source files, by path, of a model file's map: C with golden vectors, or a const Rust crate.
#[pyfunction]
#[pyo3(signature = (text, name, *, target, precision = "double"))]
pub fn export_model<'py>(
    py: Python<'py>,
    text: &str,
    name: &str,
    target: &str,
    precision: &str,
) -> PyResult<Bound<'py, PyDict>> {
    let precision = match precision {
        "double" => Precision::Double,
        "single" => Precision::Single,
        _ => {
            return Err(ModelError::new_err(format!(
                "precision is {precision:?}, expected double or single"
            )));
        }
    };
    let document = ecm_poly::open_model(text).map_err(error)?;
    let files = match target {
        "c" => ecm_poly::export::c::export(&document, name, precision),
        "rust" => ecm_poly::export::rust::export(&document, name, precision),
        _ => {
            return Err(ModelError::new_err(format!(
                "target is {target:?}, expected c or rust"
            )));
        }
    };
    let paths = PyDict::new(py);
    for file in files.map_err(error)? {
        paths.set_item(file.path, file.text)?;
    }
    Ok(paths)
}
