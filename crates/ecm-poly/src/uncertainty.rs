//! Uncertainty of a prediction: leverage, standard deviation, covariance of a wrench.

use std::vec::Vec;

use ecm_se3::{Mat6, Vec6};

use crate::energy::model::EnergyModel;
use crate::error::{ModelError, check_count, check_finite};
use crate::polynomial_model::{PolynomialModel, regressor};

impl PolynomialModel {
    /// Leverage x′ (X′X)⁻¹ x of each row-major point: the variance of ĥ in units of σ².
    ///
    /// Inside the data it stays below about one; a point far above the training rows is an
    /// extrapolation. For ridge it is |X (X′X + λ)⁻¹ x|².
    pub fn leverage(&self, points: &[f64]) -> Result<Vec<f64>, ModelError> {
        let covariance = &self.facts().unscaled_covariance;
        let k = self.exponents().len() / self.inputs();
        check_count("covariance of the fit", "numbers", covariance.len(), k * k)?;
        self.rows_of(points)?;
        let x = regressor(points, self.exponents(), self.lower(), self.upper())?;
        let leverage: Vec<f64> = x.chunks_exact(k).map(|row| form(row, covariance)).collect();
        check_finite("the leverage", &leverage, 1)?;
        Ok(leverage)
    }

    /// Standard deviation (N, outputs) of a new measurement around ĥ: s √(1 + leverage).
    ///
    /// Multiplied by the quantile of Student's t it is the half width of a prediction interval.
    pub fn prediction_sd(&self, points: &[f64]) -> Result<Vec<f64>, ModelError> {
        let variance = &self.facts().residual_variance;
        let leverage = self.leverage(points)?;
        Ok(leverage
            .iter()
            .flat_map(|h| variance.iter().map(move |s| (s * (1.0 + h)).sqrt()))
            .collect())
    }
}

impl EnergyModel {
    /// Covariance (6, 6) of the predicted wrench of each pose: Φ cov(β) Φ′.
    pub fn prediction_covariance(&self, poses: &[Vec6<f64>]) -> Result<Vec<Mat6<f64>>, ModelError> {
        let k = self.coefficients().len();
        let phi = self.regressor(poses)?;
        let covariance = self.covariance();
        let mut carried = std::vec![0.0; k];
        let mut results = Vec::with_capacity(poses.len());
        for block in phi.chunks_exact((6 * k).max(1)) {
            let mut wrench = [[0.0; 6]; 6];
            for i in 0..6 {
                apply(covariance, &block[i * k..(i + 1) * k], &mut carried);
                for j in 0..=i {
                    let row = &block[j * k..(j + 1) * k];
                    wrench[i][j] = row.iter().zip(&carried).map(|(a, b)| a * b).sum();
                    wrench[j][i] = wrench[i][j];
                }
            }
            results.push(wrench);
        }
        check_finite("the covariance", results.as_flattened().as_flattened(), 36)?;
        Ok(results)
    }
}

/// C x of a row-major square matrix.
fn apply(matrix: &[f64], x: &[f64], result: &mut [f64]) {
    for (entry, row) in result.iter_mut().zip(matrix.chunks_exact(x.len())) {
        *entry = row.iter().zip(x).map(|(a, b)| a * b).sum();
    }
}

/// x′ C x.
fn form(x: &[f64], matrix: &[f64]) -> f64 {
    x.iter()
        .zip(matrix.chunks_exact(x.len()))
        .map(|(xi, row)| xi * row.iter().zip(x).map(|(a, b)| a * b).sum::<f64>())
        .sum()
}
