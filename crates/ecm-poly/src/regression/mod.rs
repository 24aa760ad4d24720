//! Linear regression on a polynomial regressor: ordinary, ridge, and on principal components.

pub mod least_squares;
pub mod leave_one_out;
pub mod pcr;
pub mod ridge;

use std::vec::Vec;

use crate::dense::ThinSvd;
use crate::error::ModelError;

/// How the coefficients are found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Method {
    /// Ordinary least squares; the shortest solution where the regressor has no full rank.
    LeastSquares,
    /// Least squares with the penalty λ |β|² on all coefficients of the normalised regressor.
    Ridge(f64),
    /// Principal components: singular values of the normalised, un-centred regressor below b go.
    Pcr(f64),
}

/// Coefficients and what is known about how they were found.
#[derive(Clone, Debug)]
pub struct Solution {
    /// (k, outputs), row-major.
    pub coefficients: Vec<f64>,
    /// Singular values that were kept.
    pub rank: usize,
    /// κ of what was kept.
    pub condition_number: f64,
    /// What the fit spends of the degrees of freedom, per output: tr(2H − H²) of the hat matrix.
    pub effective_parameters: f64,
    /// (XᵀX)⁻¹ of what was kept, row-major (k, k): times σ² the coefficients' covariance.
    pub unscaled_covariance: Vec<f64>,
}

/// Solves X β = Y with X decomposed.
pub fn solve(
    factors: &ThinSvd,
    observations: &[f64],
    outputs: usize,
    method: Method,
) -> Result<Solution, ModelError> {
    match method {
        Method::LeastSquares => Ok(least_squares::solve(factors, observations, outputs)),
        Method::Ridge(lambda) => ridge::solve(factors, observations, outputs, lambda),
        Method::Pcr(threshold) => pcr::solve(factors, observations, outputs, threshold),
    }
}
