//! Rotations, mid-frame coordinates and stiffness conversion of many rows at once.

use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Pose, Wrench};
use numpy::{PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{from_matrices, from_rows, rows};
use crate::errors::ModelError;

/// exp of (N, 3) rotation vectors: (N, 3, 3); refuses those longer than pi.
#[pyfunction]
pub fn rotation_matrices<'py>(
    py: Python<'py>,
    rotation_vectors: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let vectors = rows::<3>("rotation_vectors", &rotation_vectors)?;
    checked_rotations("rotation_vectors", &vectors)?;
    let results: Vec<_> = vectors.iter().map(ecm_se3::rotation_matrix).collect();
    from_matrices(py, &results)
}

/// log of (N, 3, 3) rotations: (N, 3), |theta| <= pi; refuses reflections.
#[pyfunction]
pub fn rotation_vectors<'py>(
    py: Python<'py>,
    rotation_matrices: PyReadonlyArray3<'py, f64>,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let rotations = matrices::<3, 3>("rotation_matrices", &rotation_matrices)?;
    let vector = |(row, rotation)| {
        ecm_se3::rotation_vector(rotation)
            .map_err(|error| ModelError::new_err(format!("rotation_matrices: row {row}: {error}")))
    };
    let results = rotations.iter().enumerate().map(vector);
    from_rows(py, &results.collect::<PyResult<Vec<_>>>()?)
}

/// Refuses (N, 3) rotation vectors longer than pi, naming the row.
#[pyfunction]
pub fn check_rotations(rotation_vectors: PyReadonlyArray2<'_, f64>) -> PyResult<()> {
    let vectors = rows::<3>("rotation_vectors", &rotation_vectors)?;
    checked_rotations("rotation_vectors", &vectors)
}

/// J(theta) with dphi = J dtheta: (N, 3, 3).
#[pyfunction]
pub fn left_jacobians<'py>(
    py: Python<'py>,
    rotation_vectors: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let vectors = rows::<3>("rotation_vectors", &rotation_vectors)?;
    checked_rotations("rotation_vectors", &vectors)?;
    let results: Vec<_> = vectors.iter().map(ecm_se3::left_jacobian).collect();
    from_matrices(py, &results)
}

/// J(theta)^-1 with dtheta = J^-1 dphi: (N, 3, 3).
#[pyfunction]
pub fn inverse_left_jacobians<'py>(
    py: Python<'py>,
    rotation_vectors: PyReadonlyArray2<'py, f64>,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let vectors = rows::<3>("rotation_vectors", &rotation_vectors)?;
    checked_rotations("rotation_vectors", &vectors)?;
    let results: Vec<_> = vectors.iter().map(ecm_se3::left_jacobian_inverse).collect();
    from_matrices(py, &results)
}

/// q = (c, theta) of (N, 6) poses: c = A' r - (L, 0, 0), A = exp(theta/2).
#[pyfunction]
pub fn mid_frame<'py>(
    py: Python<'py>,
    poses: PyReadonlyArray2<'py, f64>,
    length_m: f64,
) -> PyResult<Bound<'py, PyArray2<f64>>> {
    let poses = checked_poses("poses", &rows::<6>("poses", &poses)?)?;
    let results: Vec<_> = poses
        .iter()
        .map(|p| ecm_se3::mid_frame::coordinates(p, length_m))
        .collect();
    from_rows(py, &results)
}

/// Between K = dh/dp, H = d(f, J' tau)/dp and K_s = K diag(I, J^-1): (N, 6, 6).
#[pyfunction]
#[pyo3(signature = (stiffness, poses, wrenches, *, source, target))]
pub fn convert_stiffness<'py>(
    py: Python<'py>,
    stiffness: PyReadonlyArray3<'py, f64>,
    poses: PyReadonlyArray2<'py, f64>,
    wrenches: PyReadonlyArray2<'py, f64>,
    source: &str,
    target: &str,
) -> PyResult<Bound<'py, PyArray3<f64>>> {
    let (source, target) = (stiffness_kind(source)?, stiffness_kind(target)?);
    let stiffness = matrices::<6, 6>("stiffness", &stiffness)?;
    let poses = checked_poses("poses", &rows::<6>("poses", &poses)?)?;
    let wrenches = rows::<6>("wrenches", &wrenches)?;
    if stiffness.len() != poses.len() || wrenches.len() != poses.len() {
        return Err(ModelError::new_err(format!(
            "stiffness, poses and wrenches have {}, {} and {} rows, expected as many of each",
            stiffness.len(),
            poses.len(),
            wrenches.len()
        )));
    }
    let results: Vec<_> = stiffness
        .iter()
        .zip(poses.iter().zip(&wrenches))
        .map(|(k, (pose, h))| convert(k, pose, &Wrench::from_array(h), source, target))
        .collect();
    from_matrices(py, &results)
}

/// Poses of rows; the error names the first that has a number that is not finite or turns by more
/// than pi.
fn checked_poses(name: &'static str, rows: &[[f64; 6]]) -> PyResult<Vec<Pose<f64>>> {
    ecm_poly::checked_poses(name, rows).map_err(|error| ModelError::new_err(error.to_string()))
}

/// `ModelError` where a rotation vector is longer than pi, with its row.
pub fn checked_rotations(name: &'static str, vectors: &[[f64; 3]]) -> PyResult<()> {
    let poses: Vec<_> = vectors
        .iter()
        .map(|t| [0.0, 0.0, 0.0, t[0], t[1], t[2]])
        .collect();
    checked_poses(name, &poses).map(drop)
}

/// The stiffness kind of a name.
pub fn stiffness_kind(name: &str) -> PyResult<StiffnessKind> {
    match name {
        "partial" => Ok(StiffnessKind::Partial),
        "generalised" => Ok(StiffnessKind::Generalised),
        "screw" => Ok(StiffnessKind::Screw),
        _ => Err(ModelError::new_err(format!(
            "stiffness kind is {name:?}, expected partial, generalised or screw"
        ))),
    }
}

/// Matrices of an (N, A, B) array; the error names the argument and the shape.
pub fn matrices<const A: usize, const B: usize>(
    name: &str,
    array: &PyReadonlyArray3<'_, f64>,
) -> PyResult<Vec<[[f64; B]; A]>> {
    let shape = array.shape();
    if shape[1..] != [A, B] {
        return Err(ModelError::new_err(format!(
            "{name} has shape {shape:?}, expected (N, {A}, {B})"
        )));
    }
    let view = array.as_array();
    Ok(view
        .outer_iter()
        .map(|m| std::array::from_fn(|i| std::array::from_fn(|j| m[[i, j]])))
        .collect())
}
