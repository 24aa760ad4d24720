//! Symmetric energies.

use ecm_poly::energy::regressor::regressor;
use ecm_poly::energy::{EnergyTerms, Group};
use ecm_poly::{EnergyFit, Pose, Symmetry};
use ecm_se3::stiffness::StiffnessKind;
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::model_file::parsed;
use super::triangle::merged;
use super::{error, poses_of, shaped, vector};
use crate::arrays::rows;
use crate::errors::ModelError;
use crate::se3::{matrices, stiffness_kind};
use crate::threads::detached;

/// U(q) in mid-frame coordinates; Q = dU/dq; h by inverting conventions' two lines.
#[pyclass(frozen, module = "ecm._native")]
pub struct EnergyEvaluator(ecm_poly::EnergyModel);

#[pymethods]
impl EnergyEvaluator {
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
        detached(py, || {
            let fit = EnergyFit {
                length_m,
                degree,
                symmetry,
                groups: &groups,
                covariance: covariance.as_deref(),
            };
            fit.run(&poses, &wrenches)
        })?
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
        let part = detached(py, || {
            let fit = EnergyFit {
                length_m,
                degree,
                symmetry,
                groups: &groups,
                covariance: Some(&covariance),
            };
            fit.triangle(&poses, &wrenches, scale)
        })?
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
        detached(py, || {
            let fit = EnergyFit {
                length_m,
                degree,
                symmetry,
                groups: &groups,
                covariance: None,
            };
            fit.of_triangle(whole, scale, true)
        })?
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
        let flat = detached(py, || regressor(&poses, length_m, &terms, scale))?.map_err(error)?;
        PyArray1::from_vec(py, flat).reshape([poses.len(), 6, terms.count()])
    }

    #[pyo3(name = "energy_J")]
    fn energy<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let poses = poses_of(&poses)?;
        let energies = detached(py, || self.0.energy(&poses))?.map_err(error)?;
        Ok(PyArray1::from_vec(py, energies))
    }

    fn predict<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let poses = poses_of(&poses)?;
        let wrenches = detached(py, || self.0.predict(&poses))?.map_err(error)?;
        shaped(py, wrenches.into_flattened(), poses.len(), 6)
    }

    /// (N, 6, 6) covariance of the predicted wrench, of the coefficients' covariance.
    fn prediction_covariance<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
    ) -> PyResult<Bound<'py, PyArray3<f64>>> {
        let poses = poses_of(&poses)?;
        let results = detached(py, || self.0.prediction_covariance(&poses))?.map_err(error)?;
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
        let results = detached(py, || self.0.stiffness(&poses, kind))?.map_err(error)?;
        PyArray1::from_vec(py, results.into_flattened().into_flattened()).reshape([
            poses.len(),
            6,
            6,
        ])
    }

    /// (N, 6) and (N, 6, 6): wrench and stiffness. A single pose has the path of a controller.
    #[pyo3(signature = (poses, kind = "partial"))]
    fn wrench_and_stiffness<'py>(
        &self,
        py: Python<'py>,
        poses: PyReadonlyArray2<'py, f64>,
        kind: &str,
    ) -> PyResult<WrenchAndStiffness<'py>> {
        let kind = stiffness_kind(kind)?;
        let poses = poses_of(&poses)?;
        let (wrenches, stiffnesses) = match (&*poses, kind) {
            ([pose], StiffnessKind::Partial) => {
                let pose = Pose::from_array(pose);
                let found = pose.map(|pose| self.0.wrench_and_stiffness(&pose));
                match found {
                    Ok((h, k)) if finite(&h.to_array()) && finite(k.as_flattened()) => {
                        (vec![h.to_array()], vec![k])
                    }
                    // The same refusal as of many poses.
                    _ => self.both(&poses, kind)?,
                }
            }
            _ => detached(py, || self.both(&poses, kind))??,
        };
        let rows = wrenches.len();
        let flat = stiffnesses.into_flattened().into_flattened();
        Ok((
            shaped(py, wrenches.into_flattened(), rows, 6)?,
            PyArray1::from_vec(py, flat).reshape([rows, 6, 6])?,
        ))
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

impl EnergyEvaluator {
    fn both(&self, poses: &[[f64; 6]], kind: StiffnessKind) -> PyResult<Both> {
        let wrenches = self.0.predict(poses).map_err(error)?;
        Ok((wrenches, self.0.stiffness(poses, kind).map_err(error)?))
    }
}

/// (N, 6) and (N, 6, 6).
type WrenchAndStiffness<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// Wrench and stiffness of each pose.
type Both = (Vec<[f64; 6]>, Vec<[[f64; 6]; 6]>);

fn finite(values: &[f64]) -> bool {
    values.iter().all(|value| value.is_finite())
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
