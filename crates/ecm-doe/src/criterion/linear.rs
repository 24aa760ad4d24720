//! I- and A-optimal designs: the smallest average variance of predictions or coefficients.

use super::d::{DSettings, Design, fix_known};
use super::model_based::search;
use crate::budget::on_threads;
use crate::linalg::{add_transposed_product, cholesky, product_transposed};
use crate::problem::Objective;
use crate::{Control, DesignError, Problem};

/// The design with the smallest mean of tr(A M^-1 A') over `region`: the average variance of
/// the predicted rows of a pose, in units of the noise variance.
///
/// `value` is that average, `bound` a certified lower bound, `efficiency` bound / value.
///
/// # Arguments
/// - `regressor`: (N * block) x k row-major, `block` rows a pose
/// - `region`: rows over which the average is taken, as `regressor`; the candidates if `None`
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
    let k = terms;
    let white = match region {
        None => problem.rows.clone(),
        Some(rows) => {
            if rows.is_empty() || !rows.len().is_multiple_of(block * k) {
                let expected = rows.len().div_ceil(block * k).max(1) * block * k;
                let found = rows.len();
                return Err(DesignError::Shape {
                    what: "the region",
                    found,
                    expected,
                });
            }
            crate::problem::check_finite("the region", rows, k)?;
            let mut white = vec![0.0; rows.len()];
            product_transposed(&mut white, (rows.len() / k, k, k), rows, &problem.back);
            white
        }
    };
    let mut moment = vec![0.0; k * k];
    add_transposed_product(&mut moment, (k, white.len() / k, k), &white, &white);
    let poses = (white.len() / (k * block)) as f64;
    for v in &mut moment {
        *v /= poses;
    }
    problem.objective = Objective::Trace(half(moment, k));
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

fn finish(
    mut problem: Problem,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let measured = fix_known(&mut problem, settings)?;
    on_threads(settings.threads, || {
        search(&problem, settings, measured, control)
    })?
}

/// H with H H' = B; a B that is singular by rounding gets 1e-12 of its trace on the diagonal.
fn half(moment: Vec<f64>, k: usize) -> Vec<f64> {
    let trace: f64 = (0..k).map(|i| moment[i * k + i]).sum();
    let mut factor = moment.clone();
    let mut shift = 0.0;
    while cholesky(&mut factor, k, 0.0).is_err() {
        shift = if shift == 0.0 {
            1e-12 * trace
        } else {
            10.0 * shift
        };
        factor.copy_from_slice(&moment);
        for i in 0..k {
            factor[i * k + i] += shift;
        }
    }
    factor
}
