//! Designs: D-optimal and maximin subsets of candidates.

use std::sync::atomic::Ordering;

use ecm_doe::{
    CRITERIA, Candidates, Control, Criterion, DSettings, Design, MaximinSettings, Method,
    SpacingMethod, maximin as search_maximin,
};
use numpy::{PyArray1, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;

use crate::arrays::matrix;
use crate::errors::DesignError;
use crate::py_task::{TaskState, run_task};

fn design_error(error: ecm_doe::DesignError) -> PyErr {
    DesignError::new_err(error.to_string())
}

/// A design, its value and a certified bound.
#[pyclass(frozen, module = "ecm._native")]
pub struct DesignResult(Design);

#[pymethods]
impl DesignResult {
    /// Rows of the candidates, sorted.
    #[getter]
    fn indices<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        PyArray1::from_iter(py, self.0.indices.iter().map(|&i| i as i64))
    }

    /// log det(M/n)/k, the average or largest variance, or the smallest distance.
    #[getter]
    fn value(&self) -> f64 {
        self.0.value
    }

    /// Certified bound of `value` for any design of this size: upper, for `i`, `a` and `g` lower.
    #[getter]
    fn bound(&self) -> f64 {
        self.0.bound
    }

    /// exp(value - bound), bound / value, or value / bound.
    #[getter]
    fn efficiency(&self) -> f64 {
        self.0.efficiency
    }

    /// Number of swaps.
    #[getter]
    fn exchanges(&self) -> usize {
        self.0.exchanges
    }

    /// converged | budget | interrupted.
    #[getter]
    fn status(&self) -> &'static str {
        self.0.status.name()
    }

    fn __repr__(&self) -> String {
        format!(
            "DesignResult(n={}, value={:.6}, bound={:.6}, efficiency={:.4}, status={:?})",
            self.0.indices.len(),
            self.0.value,
            self.0.bound,
            self.0.efficiency,
            self.0.status.name()
        )
    }
}

/// Candidate rows of the argument `name`.
fn indices(name: &str, list: Option<PyReadonlyArray1<'_, i64>>) -> PyResult<Vec<usize>> {
    let Some(list) = list else {
        return Ok(Vec::new());
    };
    let row = |&i: &i64| {
        usize::try_from(i).map_err(|_| {
            DesignError::new_err(format!(
                "{name} names row {i}, expected rows counted from 0; check the list"
            ))
        })
    };
    list.as_array().iter().map(row).collect()
}

/// Values of the argument `name`, which has as many columns as the candidates.
fn same_columns(
    name: &str,
    array: Option<PyReadonlyArray2<'_, f64>>,
    columns: usize,
) -> PyResult<Option<Vec<f64>>> {
    let Some((values, _, found)) = array.as_ref().map(matrix) else {
        return Ok(None);
    };
    if found == columns {
        return Ok(Some(values));
    }
    Err(DesignError::new_err(format!(
        "{name} has {found} columns, expected {columns} as the candidates have"
    )))
}

/// Runs a search with the GIL released, with progress and Ctrl-C.
fn search<W>(
    py: Python<'_>,
    threads: usize,
    time_limit_s: f64,
    progress: Option<Py<PyAny>>,
    work: W,
) -> PyResult<DesignResult>
where
    W: FnOnce(&Control<'_>) -> Result<Design, ecm_doe::DesignError> + Send,
{
    if !(time_limit_s >= 0.0 && time_limit_s.is_finite()) {
        return Err(DesignError::new_err(format!(
            "time_limit_s = {time_limit_s}, expected seconds, 0 for none"
        )));
    }
    run_task(py, threads, progress, |state: &TaskState| {
        let report = |done: usize, total: usize, _best: f64| {
            state.done.fetch_max(done, Ordering::Relaxed);
            state.total.store(total, Ordering::Relaxed);
        };
        let control = Control::new()
            .with_cancel(&state.cancel)
            .with_progress(&report)
            .with_time_limit(time_limit_s);
        work(&control)
    })?
    .map(DesignResult)
    .map_err(design_error)
}

/// The subset with the largest log det(X'X), or for `i`, `a` and `g` the smallest average variance of
/// the prediction, summed variance of the coefficients or largest variance of the prediction; `di`
/// is D in `share` and I in the rest; regressor (N * rows_per_pose, k). `region` holds the rows of
/// which `i` and `di` take the average, the candidates' own by default.
#[pyfunction]
#[pyo3(signature = (
    regressor, n, *, rows_per_pose = 1, starts = 10, iterations = 0, seed = 0, threads = 0,
    time_limit_s = 0.0, include = None, replicates = false, progress = None, method = "search",
    exclude = None, measured = None, criterion = "d", prior = None, share = 0.5,
    region = None
))]
#[allow(clippy::too_many_arguments)]
pub fn d_optimal(
    py: Python<'_>,
    regressor: PyReadonlyArray2<'_, f64>,
    n: usize,
    rows_per_pose: usize,
    starts: usize,
    iterations: usize,
    seed: u64,
    threads: usize,
    time_limit_s: f64,
    include: Option<PyReadonlyArray1<'_, i64>>,
    replicates: bool,
    progress: Option<Py<PyAny>>,
    method: &str,
    exclude: Option<PyReadonlyArray1<'_, i64>>,
    measured: Option<PyReadonlyArray2<'_, f64>>,
    criterion: &str,
    prior: Option<PyReadonlyArray2<'_, f64>>,
    share: f64,
    region: Option<PyReadonlyArray2<'_, f64>>,
) -> PyResult<DesignResult> {
    let method = match method {
        "search" => Method::Search,
        "fedorov" => Method::Fedorov,
        "rowwise" => Method::RowWise,
        other => {
            return Err(DesignError::new_err(format!(
                "method = {other:?}, expected \"search\", \"fedorov\" or \"rowwise\""
            )));
        }
    };
    let criterion = Criterion::of_model(criterion).map_err(design_error)?;
    let (rows, _, terms) = matrix(&regressor);
    let region = same_columns("region", region, terms)?;
    let settings = DSettings {
        n,
        starts,
        iterations,
        seed,
        method,
        replicates,
        include: indices("include", include)?,
        exclude: indices("exclude", exclude)?,
        measured: same_columns("measured", measured, terms)?.unwrap_or_default(),
        prior: prior.map(|p| matrix(&p).0),
        ..DSettings::default()
    };
    let candidates = Candidates {
        regressor: &rows,
        block: rows_per_pose,
        terms,
        share,
        region: region.as_deref(),
    };
    search(py, threads, time_limit_s, progress, |control| {
        criterion.search(&candidates, &settings, control)
    })
}

type Visited = (&'static str, &'static str, usize, i64, f64);

/// Kind, action, pose, pose from which it is approached (-1: the initial pose) and rest (s) of each visit
/// of a diagnosable campaign of poses (m, 6), in random orders of the poses, of the poses, of the visits
/// and of their rests.
#[pyfunction]
pub fn diagnosable_visits(
    poses: PyReadonlyArray2<'_, f64>,
    dwells_s: Vec<f64>,
    orders: [Vec<usize>; 4],
) -> PyResult<Vec<Visited>> {
    let poses = six(&poses)?;
    let visits = ecm_doe::diagnosable_visits(&poses, &dwells_s, orders.each_ref().map(|o| &o[..]));
    let row = |visit: &ecm_doe::Visit| {
        let (kind, action) = visit.kind.words();
        let from = visit.from.map_or(-1, |i| i as i64);
        (
            kind,
            action,
            visit.pose,
            from,
            visit.dwell_s.unwrap_or(f64::NAN),
        )
    };
    Ok(visits.map_err(design_error)?.iter().map(row).collect())
}

/// For each pose (m, 6) the nearest one from which it is approached from outside, or -1.
#[pyfunction]
pub fn outer_poses(poses: PyReadonlyArray2<'_, f64>) -> PyResult<Vec<i64>> {
    let outer = ecm_doe::outer_poses(&six(&poses)?);
    Ok(outer.iter().map(|i| i.map_or(-1, |i| i as i64)).collect())
}

fn six(poses: &PyReadonlyArray2<'_, f64>) -> PyResult<Vec<[f64; 6]>> {
    match matrix(poses) {
        (values, _, 6) => Ok(values.as_chunks().0.to_vec()),
        (_, _, columns) => Err(DesignError::new_err(format!(
            "poses have {columns} columns, expected 6"
        ))),
    }
}

/// Rows (from 0) of a list like `1,5-9`, which counts from 1, of a table of `count` rows.
#[pyfunction]
pub fn row_list(text: &str, count: usize) -> PyResult<Vec<usize>> {
    ecm_doe::row_list(text, count).map_err(design_error)
}

/// Rows (from 0) of `values` (N, d) inside a region like `x_m<0.09&y_m>0` of the d `names`.
#[pyfunction]
pub fn rows_inside(
    text: &str,
    names: Vec<String>,
    values: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<usize>> {
    ecm_doe::rows_inside(text, &names, &matrix(&values).0).map_err(design_error)
}

/// Rows of points (N, d) with the coordinates of an earlier one that may be chosen, or of an included one.
#[pyfunction]
pub fn repeated_rows(
    points: PyReadonlyArray2<'_, f64>,
    include: Vec<usize>,
    exclude: Vec<usize>,
) -> Vec<usize> {
    let (values, _, columns) = matrix(&points);
    ecm_doe::repeated_rows(&values, columns, &include, &exclude)
}

/// Name, meaning and whether it averages over a region, of every criterion.
#[pyfunction]
pub fn criteria() -> Vec<(&'static str, &'static str, bool)> {
    CRITERIA
        .iter()
        .map(|c| (c.name, c.meaning, c.averaged))
        .collect()
}

/// The subset whose closest two points are farthest apart; distances of the points as given.
#[pyfunction]
#[pyo3(signature = (
    points, n, *, method = "search", starts = 10, iterations = 0, seed = 0, threads = 0,
    time_limit_s = 0.0, include = None, progress = None, exclude = None, measured = None
))]
#[allow(clippy::too_many_arguments)]
pub fn maximin(
    py: Python<'_>,
    points: PyReadonlyArray2<'_, f64>,
    n: usize,
    method: &str,
    starts: usize,
    iterations: usize,
    seed: u64,
    threads: usize,
    time_limit_s: f64,
    include: Option<PyReadonlyArray1<'_, i64>>,
    progress: Option<Py<PyAny>>,
    exclude: Option<PyReadonlyArray1<'_, i64>>,
    measured: Option<PyReadonlyArray2<'_, f64>>,
) -> PyResult<DesignResult> {
    let method = match method {
        "search" => SpacingMethod::Search,
        "exchange" => SpacingMethod::Exchange,
        other => {
            return Err(DesignError::new_err(format!(
                "method = {other:?}, expected \"search\" or \"exchange\""
            )));
        }
    };
    let (values, _, columns) = matrix(&points);
    let settings = MaximinSettings {
        n,
        starts,
        iterations,
        seed,
        method,
        include: indices("include", include)?,
        exclude: indices("exclude", exclude)?,
        measured: same_columns("measured", measured, columns)?.unwrap_or_default(),
        ..MaximinSettings::default()
    };
    search(py, threads, time_limit_s, progress, |control| {
        search_maximin(&values, columns, &settings, control)
    })
}
