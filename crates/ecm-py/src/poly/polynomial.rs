//! Free polynomials: exponents, regressor, model.

use std::borrow::Cow;

use ecm_poly::Method;
use ecm_poly::basis::exponents;
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::model_file::parsed;
use super::triangle::merged;
use super::{check_columns, error, numbers, shaped, vector};
use crate::errors::ModelError;
use crate::se3::checked_rotations;
use crate::threads::detached;

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

/// Singular values (r,) and errors (r, m).
type Curves<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray2<f64>>);

/// Square of an angle just below pi, above which a rotation vector is looked at closely.
const NEAR_HALF_A_TURN: f64 = 9.8;

/// n inputs to m outputs; the paper's map has n = m = 6.
#[pyclass(frozen, module = "ecm._native")]
pub struct PolynomialEvaluator(ecm_poly::PolynomialModel);

#[pymethods]
impl PolynomialEvaluator {
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
        detached(py, || {
            ecm_poly::PolynomialModel::fit(
                &points,
                columns,
                &values,
                outputs,
                degree,
                method,
                weights.as_deref(),
            )
        })?
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
        let curves = detached(py, || {
            ecm_poly::PolynomialModel::leave_one_out(&points, columns, &values, outputs, degree)
        })?
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
        let part = detached(py, || {
            let ranges = (ranges.0.as_slice(), ranges.1.as_slice());
            ecm_poly::PolynomialModel::triangle(&points, &values, outputs, degree, ranges)
        })?
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
        detached(py, || {
            ecm_poly::PolynomialModel::of_triangle(&whole, degree, (&lower, &upper), method)
        })?
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
        detached(py, || {
            ecm_poly::PolynomialModel::condition_number_raw(&points, columns, degree)
        })?
        .map_err(error)
    }

    /// (N,) variance of the prediction in units of the residual variance.
    fn leverage<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let (points, _) = self.points(&inputs)?;
        let leverage = detached(py, || self.0.leverage(&points))?.map_err(error)?;
        Ok(PyArray1::from_vec(py, leverage))
    }

    /// (N, m) standard deviation of a new measurement around the prediction.
    fn prediction_sd<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (points, n) = self.points(&inputs)?;
        let sd = detached(py, || self.0.prediction_sd(&points))?.map_err(error)?;
        shaped(py, sd, n, self.0.outputs())
    }

    /// (N, m). turns: the last three inputs are a rotation vector, of at most pi.
    #[pyo3(signature = (inputs, turns = false))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
        turns: bool,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (points, n) = self.points(&inputs)?;
        self.check_turns(&points, turns)?;
        let values = detached(py, || self.0.predict(&points))?.map_err(error)?;
        shaped(py, values, n, self.0.outputs())
    }

    /// (N, m, n); K = dh/dp for the paper's map. turns: as of `predict`.
    #[pyo3(signature = (inputs, turns = false))]
    fn jacobian<'py>(
        &self,
        py: Python<'py>,
        inputs: PyReadonlyArray2<'py, f64>,
        turns: bool,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let (points, n) = self.points(&inputs)?;
        self.check_turns(&points, turns)?;
        let values = detached(py, || self.0.jacobian(&points))?.map_err(error)?;
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

impl PolynomialEvaluator {
    /// Refuses a rotation vector longer than pi, where the last three inputs are one.
    fn check_turns(&self, points: &[f64], turns: bool) -> PyResult<()> {
        let columns = self.0.inputs();
        if !turns || columns < 3 {
            return Ok(());
        }
        let of_row = |point: &[f64]| std::array::from_fn(|j| point[columns - 3 + j]);
        let near = |t: &[f64; 3]| t.iter().map(|v| v * v).sum::<f64>() > NEAR_HALF_A_TURN;
        if points.chunks_exact(columns).map(of_row).any(|t| near(&t)) {
            let vectors: Vec<_> = points.chunks_exact(columns).map(of_row).collect();
            checked_rotations("inputs", &vectors)?;
        }
        Ok(())
    }

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
