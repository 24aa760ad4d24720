//! Principal component regression (Massy 1965) on the un-centred, normalised regressor.
//!
//! The paper's threshold b drops the singular values below b: this definition gives the
//! condition numbers of its Tables II and III, and their fall with √N.

use std::format;

use crate::dense::ThinSvd;
use crate::error::ModelError;
use crate::regression::Solution;

/// β = Σ v_j (u_j·Y)/σ_j over the singular values σ_j ≥ `threshold`.
///
/// # Errors
/// Another number of observations than `outputs` for each row of X; a threshold out of range.
pub fn solve(
    factors: &ThinSvd,
    observations: &[f64],
    outputs: usize,
    threshold: f64,
) -> Result<Solution, ModelError> {
    factors.check_rows(observations, outputs)?;
    if !(threshold >= 0.0 && threshold.is_finite()) {
        return Err(ModelError::Setting {
            name: "threshold",
            found: format!("{threshold}"),
            expected: "a finite number, 0 or above",
        });
    }
    let values = &factors.singular_values;
    let rank = values
        .iter()
        .filter(|&&s| s >= threshold)
        .count()
        .min(factors.numerical_rank());
    if rank == 0 {
        return Err(ModelError::Setting {
            name: "threshold",
            found: format!("{threshold}"),
            expected: "below the largest singular value of the regressor, or nothing is left",
        });
    }
    Ok(truncated(factors, observations, outputs, rank))
}

/// The solution on the first `rank` singular values.
///
/// # Panics
/// Where `observations` has not `outputs` numbers for each row of X.
pub fn truncated(factors: &ThinSvd, observations: &[f64], outputs: usize, rank: usize) -> Solution {
    let inverse = |power: i32| move |i: usize, s: f64| if i < rank { s.powi(-power) } else { 0.0 };
    Solution {
        coefficients: factors.solve(observations, outputs, inverse(1)),
        rank,
        condition_number: factors.condition_number(rank),
        effective_parameters: rank as f64,
        unscaled_covariance: factors.gram(inverse(2)),
    }
}
