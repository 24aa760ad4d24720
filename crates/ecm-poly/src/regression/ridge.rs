//! Ridge regression (Hoerl and Kennard 1970) on the normalised, un-centred regressor.

use std::format;

use crate::dense::ThinSvd;
use crate::error::ModelError;
use crate::regression::Solution;

/// β = (XᵀX + λ I)⁻¹ Xᵀ Y; every coefficient is penalised, the constant too.
///
/// # Errors
/// Another number of observations than `outputs` for each row of X; λ not above 0.
pub fn solve(
    factors: &ThinSvd,
    observations: &[f64],
    outputs: usize,
    lambda: f64,
) -> Result<Solution, ModelError> {
    factors.check_rows(observations, outputs)?;
    if !(lambda > 0.0 && lambda.is_finite()) {
        return Err(ModelError::Setting {
            name: "ridge",
            found: format!("{lambda}"),
            expected: "a finite number above 0 (0 is method least_squares)",
        });
    }
    let values = &factors.singular_values;
    let ends = (values.first(), values.last());
    let condition_number = match ends {
        // κ of the augmented regressor [X; √λ I].
        (Some(&first), Some(&last)) => ((first * first + lambda) / (last * last + lambda)).sqrt(),
        _ => f64::INFINITY,
    };
    Ok(Solution {
        coefficients: factors.solve(observations, outputs, |_, s| s / (s * s + lambda)),
        rank: values.len(),
        condition_number,
        effective_parameters: values
            .iter()
            .map(|s| s * s / (s * s + lambda))
            .map(|h| 2.0 * h - h * h)
            .sum(),
        unscaled_covariance: factors.gram(|_, s| (s / (s * s + lambda)).powi(2)),
    })
}
