//! Leave-one-out errors of every number of principal components, from one decomposition.
//!
//! With the components held fixed the residual of a row that was left out is e/(1 − h), where
//! the leverage h of the row is the sum of its squared entries in the columns of U in use.
//! Source: Allen, Technometrics 16 (1974) 125 (PRESS).

use std::vec::Vec;

use crate::dense::ThinSvd;
use crate::error::ModelError;

/// Leave-one-out root mean square errors.
#[derive(Clone, Debug)]
pub struct LeaveOneOut {
    /// Singular values σ₁ ≥ σ₂ ≥ …; row r − 1 of `rmse` keeps the first r of them.
    pub singular_values: Vec<f64>,
    /// (ranks, outputs), row-major; infinite where one row alone determines a coefficient.
    pub rmse: Vec<f64>,
}

impl LeaveOneOut {
    /// The curves of row-major `observations` (N, outputs).
    ///
    /// # Errors
    /// Another number of observations than `outputs` for each row.
    pub fn new(
        factors: &ThinSvd,
        observations: &[f64],
        outputs: usize,
    ) -> Result<Self, ModelError> {
        factors.check_rows(observations, outputs)?;
        let rows = factors.u.nrows();
        let ranks = factors.numerical_rank();
        // Column by column of the residuals, so that the inner loops run along memory.
        let mut residuals: Vec<Vec<f64>> = (0..outputs)
            .map(|j| {
                observations
                    .iter()
                    .skip(j)
                    .step_by(outputs)
                    .copied()
                    .collect()
            })
            .collect();
        let mut kept = std::vec![1.0; rows];
        let mut inverse = std::vec![0.0; rows];
        let mut rmse = Vec::with_capacity(ranks * outputs);
        for r in 0..ranks {
            let column: Vec<f64> = factors.u.col(r).iter().copied().collect();
            for ((left, inverse), u) in kept.iter_mut().zip(&mut inverse).zip(&column) {
                *left -= u * u;
                *inverse = if *left > 1e-12 {
                    1.0 / *left
                } else {
                    f64::INFINITY
                };
            }
            for residual in &mut residuals {
                let share: f64 = column.iter().zip(residual.iter()).map(|(u, e)| u * e).sum();
                let mut sum = 0.0;
                for ((e, u), inverse) in residual.iter_mut().zip(&column).zip(&inverse) {
                    *e -= share * u;
                    let left_out = *e * inverse;
                    sum += left_out * left_out;
                }
                let mean = sum / rows as f64;
                rmse.push(if mean.is_nan() {
                    f64::INFINITY
                } else {
                    mean.sqrt()
                });
            }
        }
        Ok(Self {
            singular_values: factors.singular_values[..ranks].to_vec(),
            rmse,
        })
    }
}
