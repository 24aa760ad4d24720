//! D-, I-, A- and compound designs: the largest determinant of the information matrix, the smallest
//! average variance of predictions or of coefficients, or D and I together.

use super::search::search;
use super::settings::{DSettings, Design, apply_settings};
use crate::budget::on_threads;
use crate::linalg::{add_transposed_product, cholesky, product_transposed};
use crate::problem::{INFORMATION, Objective};
use crate::{Control, DesignError, Problem};

/// The `settings.n` poses whose regressor rows have the largest log det(X'X).
///
/// # Arguments
/// - `regressor`: (N * block) x k row-major, `block` rows a pose
///
/// # Errors
/// Wrong input: shapes, numbers that are not finite, n larger than the candidates or too small
/// for the coefficients, candidates that cannot determine the model, contradictory lists.
pub fn d_optimal(
    regressor: &[f64],
    block: usize,
    terms: usize,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    finish(problem, settings, control)
}

/// The design with the smallest mean of tr(A M^-1 A') over `region`: the average variance of
/// the predicted rows of a pose, in units of the noise variance.
///
/// `value` is that average, `bound` a certified lower bound, `efficiency` bound / value.
///
/// # Arguments
/// - `regressor`: (N * block) x k row-major, `block` rows a pose
/// - `region`: rows over which the average is taken, in blocks as `regressor`, for instance of
///   [`crate::regressor::prediction_region`]; the candidates' own (h alone) if `None`
///
/// # Errors
/// As [`crate::d_optimal`].
pub fn i_optimal(
    regressor: &[f64],
    block: usize,
    terms: usize,
    region: Option<&[f64]>,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let mut problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    let half = region_root(&problem, region)?;
    problem.objective = Objective::Trace(half);
    finish(problem, settings, control)
}

/// The design with the largest share x log det(M/n)/k - (1 - share) x log of the average variance:
/// the geometric mean of D- and I-efficiency.
///
/// `value` is that sum, `bound` the same of the bounds of both criteria, `efficiency` exp of the
/// difference: a design cannot be best in both, so it stays below 1.
///
/// # Arguments
/// - `share`: of the determinant, 0 to 1
/// - `region`: as in [`i_optimal`]
///
/// # Errors
/// As [`crate::d_optimal`], and a share outside 0 to 1.
pub fn compound_optimal(
    regressor: &[f64],
    block: usize,
    terms: usize,
    share: f64,
    region: Option<&[f64]>,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    if !(0.0..=1.0).contains(&share) {
        return Err(DesignError::Setting {
            name: "share",
            value: share.to_string(),
            expected: "0 (I alone) to 1 (D alone)",
        });
    }
    let mut problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    let half = region_root(&problem, region)?;
    problem.objective = Objective::Compound { half, share };
    finish(problem, settings, control)
}

/// The design with the smallest tr(M^-1): the summed variance of the coefficients as given.
///
/// `value` is that sum in units of the noise variance, `bound` a certified lower bound.
///
/// # Errors
/// As [`crate::d_optimal`].
pub fn a_optimal(
    regressor: &[f64],
    block: usize,
    terms: usize,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let mut problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    // M = R' M_w R, so tr(M^-1) = tr(M_w^-1 T T') with T = R^-T.
    problem.objective = Objective::Trace(problem.back.clone());
    finish(problem, settings, control)
}

/// H of the average over the region, or over the candidates.
fn region_root(problem: &Problem, region: Option<&[f64]>) -> Result<Vec<f64>, DesignError> {
    let (block, k) = (problem.block, problem.terms);
    let Some(rows) = region else {
        return root_of_moment(&problem.rows, None, block, k).map_err(|found| {
            DesignError::Information {
                what: "the regressor",
                found,
            }
        });
    };
    if rows.is_empty() || !rows.len().is_multiple_of(block * k) {
        return Err(DesignError::Shape {
            what: "the region",
            found: rows.len(),
            expected: rows.len().div_ceil(block * k).max(1) * block * k,
        });
    }
    crate::problem::check_sizes("the region", rows, k, 0.0)?;
    let mut white = vec![0.0; rows.len()];
    product_transposed(&mut white, (rows.len() / k, k, k), rows, &problem.back);
    root_of_moment(&white, None, block, k).map_err(|found| DesignError::Information {
        what: "the region",
        found,
    })
}

/// Applies the settings and searches.
fn finish(
    mut problem: Problem,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let measured = apply_settings(&mut problem, settings)?;
    on_threads(settings.threads, || {
        search(&problem, settings, measured, control)
    })?
}

/// H with H H' = the mean of A' A over whitened poses, or their mean with the given weights.
///
/// # Errors
/// The trace of this mean where it is outside [`INFORMATION`].
pub(crate) fn root_of_moment(
    white: &[f64],
    weights: Option<&[f64]>,
    block: usize,
    k: usize,
) -> Result<Vec<f64>, f64> {
    let poses = white.len() / (k * block);
    let total: f64 = weights.map_or(poses as f64, |w| w.iter().sum());
    let mut moment = vec![0.0; k * k];
    match weights {
        None => add_transposed_product(&mut moment, (k, poses * block, k), white, white),
        Some(weights) => {
            let rows: Vec<f64> = white
                .chunks_exact(k * block)
                .zip(weights)
                .filter(|(_, w)| **w > 0.0)
                .flat_map(|(pose, w)| pose.iter().map(|v| v * w.sqrt()))
                .collect();
            add_transposed_product(&mut moment, (k, rows.len() / k, k), &rows, &rows);
        }
    }
    for v in &mut moment {
        *v /= total;
    }
    half(&moment, k)
}

/// H with H H' = B; a B that is singular by rounding gets 1e-12 of its trace on the diagonal, or
/// more where that does not do. The error is the trace.
fn half(moment: &[f64], k: usize) -> Result<Vec<f64>, f64> {
    let trace: f64 = (0..k).map(|i| moment[i * k + i]).sum();
    if !INFORMATION.contains(&trace) {
        return Err(if trace.is_nan() { f64::INFINITY } else { trace });
    }
    let shifts = (0..=12).map(|power| 1e-12 * trace * 10f64.powi(power));
    for shift in std::iter::once(0.0).chain(shifts) {
        let mut factor = moment.to_vec();
        for i in 0..k {
            factor[i * k + i] += shift;
        }
        if cholesky(&mut factor, k, 0.0).is_ok() {
            return Ok(factor);
        }
    }
    Err(trace)
}
