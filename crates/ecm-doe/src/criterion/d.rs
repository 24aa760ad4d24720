//! D-optimal designs: the largest log det of the information matrix.

use super::search::search;
use super::settings::{DSettings, Design, apply_settings};
use crate::budget::on_threads;
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
    let mut problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    let measured = apply_settings(&mut problem, settings)?;
    on_threads(settings.threads, || {
        search(&problem, settings, measured, control)
    })?
}
