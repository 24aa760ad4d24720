//! Meshes, the finite-element solver and the rod.

use std::path::Path;
use std::sync::Mutex;

use ecm_fem::output::vtu;
use ecm_fem::{
    Case, CaseResult, ChamberShape, Chambered, Formulation, Laid, Load, MOST_ACTUATORS, Outcome,
    Quality, Rod, Settings, Status, Tendon, Watch, material,
};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use rayon::prelude::*;

use crate::arrays::{from_matrices, from_rows, matrix, rows};
use crate::errors::{FemError, fem_error};
use crate::material::{NamedNumbers, parameters as named_numbers};
use crate::py_task::{TaskState, run_task, run_task_polling};
use crate::threads::detached;

/// Poses (N, 6) and whether each converged.
type RodPoses<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray1<bool>>);

/// Wrenches (N, 6) and d pose / d wrench (N, 6, 6).
type RodWrenches<'py> = (Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>);

/// G (N, 6, m) and C (N, m, m).
type Jacobians<'py> = (Bound<'py, PyArray3<f64>>, Bound<'py, PyArray3<f64>>);

/// Ten-node tetrahedra with a clamped face `base` and a rigid face `top`.
#[pyclass(frozen, module = "ecm._native")]
pub struct Mesh(ecm_fem::Mesh);

#[pymethods]
impl Mesh {
    /// A cylinder along x.
    #[staticmethod]
    #[pyo3(signature = (*, length_m, radius_m, quality = "standard"))]
    fn cylinder(length_m: f64, radius_m: f64, quality: &str) -> PyResult<Self> {
        let quality: Quality = quality.parse().map_err(fem_error)?;
        ecm_fem::Mesh::cylinder(length_m, radius_m, quality)
            .map(Self)
            .map_err(fem_error)
    }

    /// A tube along x.
    #[staticmethod]
    #[pyo3(signature = (*, length_m, radius_m, inner_radius_m, quality = "standard"))]
    fn tube(length_m: f64, radius_m: f64, inner_radius_m: f64, quality: &str) -> PyResult<Self> {
        let quality: Quality = quality.parse().map_err(fem_error)?;
        ecm_fem::Mesh::tube(length_m, radius_m, inner_radius_m, quality)
            .map(Self)
            .map_err(fem_error)
    }

    /// A body of revolution, r(x) = waist + (radius - waist)(2x/L - 1)^2.
    #[staticmethod]
    #[pyo3(signature = (*, length_m, radius_m, waist_radius_m, quality = "standard"))]
    fn hourglass(
        length_m: f64,
        radius_m: f64,
        waist_radius_m: f64,
        quality: &str,
    ) -> PyResult<Self> {
        let quality: Quality = quality.parse().map_err(fem_error)?;
        ecm_fem::Mesh::hourglass(length_m, radius_m, waist_radius_m, quality)
            .map(Self)
            .map_err(fem_error)
    }

    /// Discs with rounded waists, r(x) = waist + (radius - waist) cos^2(pi (discs - 1) x / L).
    #[staticmethod]
    #[pyo3(signature = (*, length_m, radius_m, waist_radius_m, disc_count, quality = "standard"))]
    fn stacked_discs(
        length_m: f64,
        radius_m: f64,
        waist_radius_m: f64,
        disc_count: usize,
        quality: &str,
    ) -> PyResult<Self> {
        let quality: Quality = quality.parse().map_err(fem_error)?;
        ecm_fem::Mesh::stacked_discs(length_m, radius_m, waist_radius_m, disc_count, quality)
            .map(Self)
            .map_err(fem_error)
    }

    /// Cylinder with chambers round its axis, named chamber_1, chamber_2, ...; the first lies towards y.
    #[staticmethod]
    #[pyo3(signature = (
        *, length_m, radius_m, chamber_count, chamber_inner_m, chamber_outer_m, chamber_angle_rad,
        channel_radius_m = 0.0, end_wall_m = 0.0, quality = "standard"
    ))]
    #[allow(clippy::too_many_arguments)] // By name only.
    fn chambered(
        length_m: f64,
        radius_m: f64,
        chamber_count: usize,
        chamber_inner_m: f64,
        chamber_outer_m: f64,
        chamber_angle_rad: f64,
        channel_radius_m: f64,
        end_wall_m: f64,
        quality: &str,
    ) -> PyResult<Self> {
        let quality: Quality = quality.parse().map_err(fem_error)?;
        let shape = if chamber_angle_rad > 0.0 {
            ChamberShape::Sector {
                inner_radius_m: chamber_inner_m,
                outer_radius_m: chamber_outer_m,
                angle_rad: chamber_angle_rad,
            }
        } else {
            ChamberShape::Round {
                radius_m: 0.5 * (chamber_outer_m - chamber_inner_m),
                offset_m: 0.5 * (chamber_outer_m + chamber_inner_m),
            }
        };
        let body = Chambered {
            length_m,
            radius_m,
            channel_radius_m,
            chambers: chamber_count,
            shape,
            end_wall_m,
        };
        ecm_fem::Mesh::chambered(&body, quality)
            .map(Self)
            .map_err(fem_error)
    }

    /// With a closed chamber whose wall holds all of these nodes.
    fn with_chamber(&self, name: &str, nodes: PyReadonlyArray1<'_, i64>) -> PyResult<Self> {
        let nodes = nodes.as_array().iter().map(|&n| n as usize).collect();
        (self.0.clone().with_chamber(name, nodes))
            .map(Self)
            .map_err(fem_error)
    }

    /// With a tendon: straight between points of the base, of the body, then of the platform.
    #[pyo3(signature = (name, *, base_m = Vec::new(), body_m = Vec::new(), platform_m = Vec::new()))]
    fn with_tendon(
        &self,
        name: &str,
        base_m: Vec<[f64; 3]>,
        body_m: Vec<[f64; 3]>,
        platform_m: Vec<[f64; 3]>,
    ) -> PyResult<Self> {
        let tendon = Tendon {
            name: name.into(),
            base_m,
            body_m,
            platform_m,
        };
        (self.0.clone().with_tendon(tendon))
            .map(Self)
            .map_err(fem_error)
    }

    /// With threads bonded to a surface (stiffness in N/m) or through a region (Pa), at two angles
    /// from the direction round it.
    #[pyo3(signature = (on, *, angles_rad, stiffness_N_m = None, stiffness_Pa = None))]
    #[allow(non_snake_case)]
    fn with_winding(
        &self,
        on: &str,
        angles_rad: [f64; 2],
        stiffness_N_m: Option<f64>,
        stiffness_Pa: Option<f64>,
    ) -> PyResult<Self> {
        let laid = match (stiffness_N_m, stiffness_Pa) {
            (Some(stiffness_N_m), None) => Laid::OnSurface { stiffness_N_m },
            (None, Some(stiffness_Pa)) => Laid::InRegion { stiffness_Pa },
            _ => {
                return Err(FemError::new_err(
                    "a winding has either winding_stiffness_N_m, on a surface, or winding_stiffness_Pa, in a region",
                ));
            }
        };
        (self.0.clone().with_winding(on, angles_rad, laid))
            .map(Self)
            .map_err(fem_error)
    }

    /// Name and nodes of each chamber's wall.
    #[getter]
    fn chambers<'py>(&self, py: Python<'py>) -> Vec<(String, Bound<'py, PyArray1<i64>>)> {
        (self.0.chambers().iter())
            .map(|(name, nodes)| (name.clone(), integers(py, nodes)))
            .collect()
    }

    /// From arrays: nodes (N, 3), tetrahedra (M, 10), node numbers of both faces.
    #[staticmethod]
    #[pyo3(signature = (nodes_m, tetrahedra, *, base_nodes, top_nodes))]
    fn from_arrays(
        nodes_m: PyReadonlyArray2<'_, f64>,
        tetrahedra: PyReadonlyArray2<'_, i64>,
        base_nodes: PyReadonlyArray1<'_, i64>,
        top_nodes: PyReadonlyArray1<'_, i64>,
    ) -> PyResult<Self> {
        let nodes = rows::<3>("nodes_m", &nodes_m)?;
        let tetrahedra = tetrahedra.as_array();
        if tetrahedra.ncols() != 10 {
            return Err(FemError::new_err(format!(
                "tetrahedra have {} nodes each, expected 10: corners, then mid-edge nodes 01 12 \
                 02 03 13 23",
                tetrahedra.ncols()
            )));
        }
        // A negative number becomes one beyond the last node, which the mesh's checks name.
        let index = |i: &i64| usize::try_from(*i).unwrap_or(usize::MAX);
        let elements = (tetrahedra.rows().into_iter())
            .map(|row| std::array::from_fn(|a| index(&row[a])))
            .collect();
        let list = |a: &PyReadonlyArray1<'_, i64>| a.as_array().iter().map(index).collect();
        ecm_fem::Mesh::new(nodes, elements, list(&base_nodes), list(&top_nodes))
            .map(Self)
            .map_err(fem_error)
    }

    /// Gmsh 4.1 ASCII with named faces `base` and `top`; linear or quadratic tetrahedra.
    #[staticmethod]
    fn read(py: Python<'_>, path: &str) -> PyResult<Self> {
        detached(py, || ecm_fem::Mesh::read(Path::new(path)))?
            .map(Self)
            .map_err(fem_error)
    }

    /// (N, 3).
    #[getter]
    fn nodes_m<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, self.0.nodes_m())
    }

    /// (M, 10), corner nodes then mid-edge nodes 01 12 02 03 13 23.
    #[getter]
    fn tetrahedra<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let flat = self
            .0
            .tetrahedra()
            .iter()
            .flatten()
            .map(|&i| i as i64)
            .collect();
        PyArray1::from_vec(py, flat).reshape([self.0.tetrahedra().len(), 10])
    }

    /// Nodes of the clamped face.
    #[getter]
    fn base_nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        integers(py, self.0.base_nodes())
    }

    /// Nodes of the rigid face.
    #[getter]
    fn top_nodes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        integers(py, self.0.top_nodes())
    }

    /// Distance of the centres of the two named faces.
    #[getter]
    fn length_m(&self) -> f64 {
        self.0.length_m()
    }

    /// Volume of the undeformed body.
    #[getter]
    fn volume_m3(&self) -> f64 {
        self.0.volume_m3()
    }

    fn __repr__(&self) -> String {
        format!(
            "Mesh({} nodes, {} tetrahedra, length_m={})",
            self.0.nodes_m().len(),
            self.0.tetrahedra().len(),
            self.0.length_m()
        )
    }
}

fn integers<'py>(py: Python<'py>, values: &[usize]) -> Bound<'py, PyArray1<i64>> {
    PyArray1::from_iter(py, values.iter().map(|&i| i as i64))
}

/// One row per load case; rows that did not converge hold the last stable state.
#[pyclass(frozen, module = "ecm._native")]
pub struct FemResults(Vec<CaseResult>, Vec<Vec<f32>>);

impl FemResults {
    fn column<'py>(
        &self,
        py: Python<'py>,
        of: impl Fn(&CaseResult) -> f64,
    ) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_iter(py, self.0.iter().map(of))
    }

    /// Number of actuators; 0 where no case has a state.
    fn actuators(&self) -> usize {
        let count = self.0.iter().map(|r| r.actuators.len());
        count.max().unwrap_or(0)
    }

    /// (N, width) array of one row per case; NaN where a case has no state.
    fn matrix<'py>(
        &self,
        py: Python<'py>,
        width: usize,
        row: impl Fn(&CaseResult) -> Vec<f64>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let mut flat = Vec::with_capacity(self.0.len() * width);
        for result in &self.0 {
            let mut values = row(result);
            values.resize(width, f64::NAN);
            flat.extend(values);
        }
        PyArray1::from_vec(py, flat).reshape([self.0.len(), width])
    }
}

#[pymethods]
impl FemResults {
    /// solved | unstable | not_converged | inverted | collapsed | cancelled
    #[getter]
    fn status(&self) -> Vec<&'static str> {
        self.0.iter().map(|r| r.status.word()).collect()
    }

    /// (N, 6).
    #[getter]
    fn poses<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, &self.0.iter().map(|r| r.pose).collect::<Vec<_>>())
    }

    /// (N, 6).
    #[getter]
    fn wrenches<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        from_rows(py, &self.0.iter().map(|r| r.wrench).collect::<Vec<_>>())
    }

    /// (N, 6 + m): wrench and pressures as the solver takes them.
    #[getter]
    fn loads<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let row = |r: &CaseResult| {
            let pressures = r.actuators.iter().map(|a| a.input);
            r.wrench.into_iter().chain(pressures).collect()
        };
        let width = 6 + self.actuators();
        self.matrix(py, width, row)
    }

    /// Change of each chamber's volume, and shortening of each tendon, from the undeformed body, (N, m).
    #[getter]
    fn amounts<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        self.matrix(py, self.actuators(), |r| {
            r.actuators.iter().map(|a| a.amount).collect()
        })
    }

    /// G = dh/da, (N, 6, m), and C = dq/da, (N, m, m), at fixed pose.
    #[getter]
    fn actuation_jacobians<'py>(&self, py: Python<'py>) -> PyResult<Jacobians<'py>> {
        let (n, m) = (self.0.len(), self.actuators());
        let on_wrench = self.matrix(py, 6 * m, |r| {
            let entry = |i: usize| r.actuators.iter().map(move |a| a.on_wrench[i]);
            (0..6).flat_map(entry).collect()
        })?;
        let on_amounts = self.matrix(py, m * m, |r| {
            let entry = |i: usize| r.actuators.iter().map(move |a| a.on_amounts[i]);
            (0..r.actuators.len()).flat_map(entry).collect()
        })?;
        Ok((
            on_wrench.reshape([n, 6, m])?,
            on_amounts.reshape([n, m, m])?,
        ))
    }

    /// Stored energy.
    #[getter]
    #[pyo3(name = "energy_J")]
    fn energy<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.energy_J)
    }

    /// K = dh/dp, (N, 6, 6).
    #[getter]
    fn stiffness<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        from_matrices(py, &self.0.iter().map(|r| r.stiffness).collect::<Vec<_>>())
    }

    /// H = d(f, J' tau)/dp, (N, 6, 6), symmetric.
    #[getter]
    fn hessian<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f64>>> {
        from_matrices(py, &self.0.iter().map(|r| r.hessian).collect::<Vec<_>>())
    }

    /// Why a case is unstable; empty for all others.
    #[getter]
    fn reason(&self) -> Vec<&'static str> {
        let words = |r: &CaseResult| r.reason.map_or("", ecm_fem::Reason::words);
        self.0.iter().map(words).collect()
    }

    /// Smallest ratio of the smallest to the largest principal stretch.
    #[getter]
    fn stretch_ratio<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.stretch_ratio)
    }

    /// Smallest principal stretch.
    #[getter]
    fn smallest_stretch<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.smallest_stretch)
    }

    /// det K_s with lengths over L.
    #[getter]
    fn determinant<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.determinant)
    }

    /// Smallest eigenvalue of the symmetric part of K_s with lengths over L.
    #[getter]
    fn smallest_eigenvalue<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.smallest_eigenvalue)
    }

    /// Largest principal stretch.
    #[getter]
    fn largest_stretch<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.largest_stretch)
    }

    /// Smallest det F.
    #[getter]
    fn smallest_jacobian<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.smallest_jacobian)
    }

    /// Newton iterations of all load steps.
    #[getter]
    fn iterations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.0.iter().map(|r| r.iterations as i64))
    }

    /// States for [`Fem::fit_warm_start`], (N, M), from `solve_each`; rows of zeros where there is none.
    #[getter]
    fn fields<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let width = self.1.iter().map(Vec::len).max().unwrap_or(0);
        let mut flat = vec![0.0; self.1.len() * width];
        for (row, field) in self.1.iter().enumerate() {
            flat[row * width..row * width + field.len()].copy_from_slice(field);
        }
        PyArray1::from_vec(py, flat).reshape([self.1.len(), width])
    }

    /// Norm of the residual over mu V / L.
    #[getter]
    fn residual<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.column(py, |r| r.residual)
    }
}

/// Warm start: initial guesses of states, fitted by `Fem.fit_warm_start`.
#[pyclass(frozen, module = "ecm._native")]
pub struct WarmStart(ecm_fem::WarmStart);

#[pymethods]
impl WarmStart {
    /// From the bytes of `to_bytes`, for instance in another process.
    #[new]
    fn new(data: &[u8]) -> PyResult<Self> {
        ecm_fem::WarmStart::from_bytes(data)
            .map(Self)
            .ok_or_else(|| {
                FemError::new_err(format!(
                    "WarmStart: found {} bytes that are not a warm start, expected the bytes of to_bytes",
                    data.len()
                ))
            })
    }

    /// Bytes to send to another process that has the same body.
    fn to_bytes<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.0.to_bytes())
    }
}

/// Body clamped at `base`, rigid platform on `top`.
#[pyclass(frozen, module = "ecm._native")]
pub struct Fem(ecm_fem::Fem);

fn formulation(element: &str) -> PyResult<Formulation> {
    match element {
        "P2/P1" => Ok(Formulation::TaylorHood),
        "P2/P0" => Ok(Formulation::ConstantPressure),
        "P2" => Ok(Formulation::Displacement),
        _ => Err(FemError::new_err(format!(
            "element = {element:?}: expected \"P2/P1\", \"P2/P0\" or \"P2\""
        ))),
    }
}

/// Rows of an (N, 6 + m) array as loads with m pressures.
fn loads(
    name: &str,
    array: &PyReadonlyArray2<'_, f64>,
    load: fn([f64; 6]) -> Load,
    given: &[bool],
) -> PyResult<Vec<Case>> {
    let (values, _, width) = matrix(array);
    if !(6..=6 + MOST_ACTUATORS).contains(&width) {
        rows::<6>(name, array)?;
    }
    (values.chunks_exact(width))
        .map(|row| {
            let (own, actuation) = row.split_at(6);
            let own = std::array::from_fn(|k| own[k]);
            Case::new(load(own), actuation)
                .map(|case| case.with_amounts(given))
                .map_err(fem_error)
        })
        .collect()
}

/// The outcomes as results with their state vectors.
fn results(outcomes: Vec<Outcome>) -> FemResults {
    let (results, fields) = outcomes.into_iter().map(|o| (o.result, o.field)).unzip();
    FemResults(results, fields)
}

/// Cancel flag and counter of a task, as the solver watches them.
fn watch(task: &TaskState) -> Watch<'_> {
    Watch {
        cancel: Some(&task.cancel),
        done: Some(&task.done),
    }
}

#[pymethods]
impl Fem {
    #[new]
    #[pyo3(signature = (
        mesh, *, young_modulus_Pa = None, poisson_ratio = None, model = None, parameters = None,
        element_modulus_scale = None, body_force_N_m3 = None, element = "P2/P1"
    ))]
    #[allow(non_snake_case, clippy::too_many_arguments)] // The unit stands in the name.
    fn new(
        py: Python<'_>,
        mesh: &Mesh,
        young_modulus_Pa: Option<f64>,
        poisson_ratio: Option<f64>,
        model: Option<&str>,
        parameters: Option<NamedNumbers>,
        element_modulus_scale: Option<PyReadonlyArray1<'_, f64>>,
        body_force_N_m3: Option<[f64; 3]>,
        element: &str,
    ) -> PyResult<Self> {
        let scale = element_modulus_scale.map(|a| a.as_array().to_vec());
        let mut values = named_numbers(parameters.unwrap_or_default());
        for (key, value) in [
            ("young_modulus_Pa", young_modulus_Pa),
            ("poisson_ratio", poisson_ratio),
        ] {
            if let Some(value) = value {
                values.insert(key.into(), vec![value]);
            }
        }
        let settings = Settings {
            formulation: formulation(element)?,
            ..Settings::default()
        };
        detached(py, || {
            let material = material::choose(model.unwrap_or("neo_hookean"), &values)?;
            let fem = ecm_fem::Fem::with_settings(mesh.0.clone(), material, scale, settings)?;
            match body_force_N_m3 {
                Some(force) => fem.with_body_force(force),
                None => Ok(fem),
            }
        })?
        .map(Self)
        .map_err(fem_error)
    }

    /// Solves one wrench or pose and writes displacement, stretch and stress for ParaView.
    #[pyo3(signature = (path, *, wrench = None, pose = None, actuation = None))]
    fn write_vtu(
        &self,
        py: Python<'_>,
        path: &str,
        wrench: Option<[f64; 6]>,
        pose: Option<[f64; 6]>,
        actuation: Option<Vec<f64>>,
    ) -> PyResult<FemResults> {
        let load = match (wrench, pose) {
            (Some(h), None) => Load::Wrench(h),
            (None, Some(p)) => Load::Pose(p),
            _ => return Err(FemError::new_err("write_vtu: give either wrench or pose")),
        };
        let case = Case::new(load, &actuation.unwrap_or_default()).map_err(fem_error)?;
        let (result, field) = run_task(py, 1, None, |task| self.0.solve_field(case, watch(task)))?
            .map_err(fem_error)?;
        std::fs::write(path, vtu(self.0.body(), &field).map_err(fem_error)?)?;
        Ok(FemResults(vec![result], Vec::new()))
    }

    /// Names of the actuators in the order of their inputs: the chambers, then the tendons.
    #[getter]
    fn actuators(&self) -> Vec<String> {
        self.0.actuators()
    }

    /// K at rest.
    fn rest_stiffness<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let k = run_task(py, 1, None, |task| self.0.rest_stiffness(watch(task)))?;
        from_rows(py, &k.map_err(fem_error)?)
    }

    /// Equilibria under dead wrenches. `given`: of which actuators the amount stands in place of the
    /// input.
    #[pyo3(signature = (wrenches, *, given = None, threads = 0, progress = None))]
    fn solve_wrenches(
        &self,
        py: Python<'_>,
        wrenches: PyReadonlyArray2<'_, f64>,
        given: Option<Vec<bool>>,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<FemResults> {
        let given = given.unwrap_or_default();
        let loads = loads("wrenches", &wrenches, Load::Wrench, &given)?;
        self.solve(py, loads, threads, progress)
    }

    /// Equilibria under dead wrenches, each solved on its own from `warm_start`, or from rest.
    /// `finished(rows, results)` is called within 0.1 s of the end of each case.
    #[pyo3(signature = (wrenches, *, warm_start = None, threads = 0, progress = None, finished = None))]
    fn solve_each(
        &self,
        py: Python<'_>,
        wrenches: PyReadonlyArray2<'_, f64>,
        warm_start: Option<&WarmStart>,
        threads: usize,
        progress: Option<Py<PyAny>>,
        finished: Option<Py<PyAny>>,
    ) -> PyResult<FemResults> {
        let loads = loads("wrenches", &wrenches, Load::Wrench, &[])?;
        let queue: Mutex<Vec<(usize, Outcome)>> = Mutex::new(Vec::new());
        let wanted = finished.is_some();
        let store = |row: usize, outcome: &Outcome| {
            let done = outcome.result.status != Status::Cancelled;
            if let (true, true, Ok(mut queue)) = (wanted, done, queue.lock()) {
                queue.push((row, outcome.clone()));
            }
        };
        let poll = |py: Python<'_>| -> PyResult<()> {
            let taken = queue.lock().map(|mut q| std::mem::take(&mut *q));
            match (&finished, taken) {
                (Some(callback), Ok(taken)) if !taken.is_empty() => {
                    let (rows, outcomes): (Vec<usize>, Vec<_>) = taken.into_iter().unzip();
                    callback.call1(py, (rows, results(outcomes))).map(|_| ())
                }
                _ => Ok(()),
            }
        };
        run_task_polling(py, threads, progress, &poll, |task| {
            task.total
                .store(loads.len(), std::sync::atomic::Ordering::Relaxed);
            self.0
                .solve_from(&loads, warm_start.map(|w| &w.0), watch(task), &store)
        })?
        .map(results)
        .map_err(fem_error)
    }

    /// Poses (N, 6) that a warm start predicts under wrenches; nothing is solved.
    fn predict_poses<'py>(
        &self,
        py: Python<'py>,
        wrenches: PyReadonlyArray2<'py, f64>,
        warm_start: &WarmStart,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let loads = loads("wrenches", &wrenches, Load::Wrench, &[])?;
        let poses = run_task(py, 0, None, |task| {
            self.0.predict_poses(&loads, &warm_start.0, watch(task))
        })?;
        from_rows(py, &poses.map_err(fem_error)?)
    }

    /// A warm start fitted to states and their wrenches; None when there are too few.
    fn fit_warm_start(
        &self,
        py: Python<'_>,
        wrenches: PyReadonlyArray2<'_, f64>,
        fields: PyReadonlyArray2<'_, f32>,
    ) -> PyResult<Option<WarmStart>> {
        let loads = loads("wrenches", &wrenches, Load::Wrench, &[])?;
        let fields: Vec<Vec<f32>> = (fields.as_array().rows().into_iter())
            .map(|row| row.to_vec())
            .collect();
        run_task(py, 0, None, |task| {
            let fields: Vec<&[f32]> = fields.iter().map(Vec::as_slice).collect();
            self.0.fit_warm_start(&loads, &fields, watch(task))
        })?
        .map(|fitted| fitted.map(WarmStart))
        .map_err(fem_error)
    }

    /// Wrenches that hold poses.
    #[pyo3(signature = (poses, *, given = None, threads = 0, progress = None))]
    fn solve_poses(
        &self,
        py: Python<'_>,
        poses: PyReadonlyArray2<'_, f64>,
        given: Option<Vec<bool>>,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<FemResults> {
        let given = given.unwrap_or_default();
        let loads = loads("poses", &poses, Load::Pose, &given)?;
        self.solve(py, loads, threads, progress)
    }
}

impl Fem {
    fn solve(
        &self,
        py: Python<'_>,
        loads: Vec<Case>,
        threads: usize,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<FemResults> {
        run_task(py, threads, progress, |task| {
            task.total
                .store(loads.len(), std::sync::atomic::Ordering::Relaxed);
            self.0.solve_all(&loads, watch(task))
        })?
        .map(|results| FemResults(results, Vec::new()))
        .map_err(fem_error)
    }
}

/// Cosserat rod clamped at its base under a dead tip wrench: poses (N, 6), converged (N,).
#[pyfunction]
#[pyo3(signature = (
    wrenches, *, length_m, axial_stiffness_N, shear_stiffness_N, bending_stiffness_Nm2,
    torsion_stiffness_Nm2
))]
#[allow(non_snake_case)] // The unit stands in the name.
pub fn rod_poses<'py>(
    py: Python<'py>,
    wrenches: PyReadonlyArray2<'py, f64>,
    length_m: f64,
    axial_stiffness_N: f64,
    shear_stiffness_N: f64,
    bending_stiffness_Nm2: f64,
    torsion_stiffness_Nm2: f64,
) -> PyResult<RodPoses<'py>> {
    let wrenches = rows::<6>("wrenches", &wrenches)?;
    let rod = Rod {
        length_m,
        axial_stiffness_N,
        shear_stiffness_N,
        bending_stiffness_Nm2,
        torsion_stiffness_Nm2,
    }
    .checked()
    .map_err(fem_error)?;
    let (poses, converged): (Vec<[f64; 6]>, Vec<bool>) =
        detached(py, || wrenches.par_iter().map(|h| rod.pose(h)).unzip())?;
    Ok((from_rows(py, &poses)?, PyArray1::from_vec(py, converged)))
}

/// Dead wrenches (N, 6) that hold the tip of a rod at poses, and d pose / d wrench (N, 6, 6); NaN
/// where there is no equilibrium. `start`: a first guess of the wrenches.
#[pyfunction]
#[pyo3(signature = (
    poses, start, *, length_m, axial_stiffness_N, shear_stiffness_N, bending_stiffness_Nm2,
    torsion_stiffness_Nm2
))]
#[allow(non_snake_case, clippy::too_many_arguments)] // Python's keywords, with their units.
pub fn rod_wrenches<'py>(
    py: Python<'py>,
    poses: PyReadonlyArray2<'py, f64>,
    start: PyReadonlyArray2<'py, f64>,
    length_m: f64,
    axial_stiffness_N: f64,
    shear_stiffness_N: f64,
    bending_stiffness_Nm2: f64,
    torsion_stiffness_Nm2: f64,
) -> PyResult<RodWrenches<'py>> {
    let poses = rows::<6>("poses", &poses)?;
    let start = rows::<6>("start", &start)?;
    if start.len() != poses.len() {
        return Err(FemError::new_err(format!(
            "start has {} rows, expected one for each of {} poses",
            start.len(),
            poses.len()
        )));
    }
    let rod = Rod {
        length_m,
        axial_stiffness_N,
        shear_stiffness_N,
        bending_stiffness_Nm2,
        torsion_stiffness_Nm2,
    }
    .checked()
    .map_err(fem_error)?;
    let nowhere = ([f64::NAN; 6], [[f64::NAN; 6]; 6]);
    let (wrenches, slopes): (Vec<[f64; 6]>, Vec<[[f64; 6]; 6]>) = detached(py, || {
        poses
            .par_iter()
            .zip(&start)
            .map(|(pose, first)| rod.wrench(pose, first).unwrap_or(nowhere))
            .unzip()
    })?;
    Ok((from_rows(py, &wrenches)?, from_matrices(py, &slopes)?))
}
