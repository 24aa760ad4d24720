//! Linear regression on a polynomial regressor: ordinary, ridge, and on principal components.

pub mod least_squares;
pub mod leave_one_out;
pub mod pcr;
pub mod ridge;
pub mod triangle;

use std::vec::Vec;

use crate::dense::ThinSvd;
use crate::error::ModelError;

/// Method of regression.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum Method {
    /// Ordinary least squares; the shortest solution where the regressor has no full rank.
    LeastSquares,
    /// Least squares with the penalty λ |β|² on all coefficients of the normalised regressor.
    Ridge(f64),
    /// Principal components: drops singular values of the normalised, un-centred regressor below b.
    Pcr(f64),
}

/// Coefficients and the quality of the fit.
#[derive(Clone, Debug)]
pub struct Solution {
    /// (k, outputs), row-major.
    pub coefficients: Vec<f64>,
    /// Number of singular values in use.
    pub rank: usize,
    /// Condition number over the singular values in use.
    pub condition_number: f64,
    /// Effective number of parameters per output: tr(2H − H²) of the hat matrix H.
    pub effective_parameters: f64,
    /// (XᵀX)⁻¹ over the singular values in use, row-major (k, k); times σ² it is the covariance
    /// of the coefficients.
    pub unscaled_covariance: Vec<f64>,
}

/// Solves X β = Y with X decomposed.
///
/// # Errors
/// Another number of observations than `outputs` for each row of X; a setting out of range.
pub fn solve(
    factors: &ThinSvd,
    observations: &[f64],
    outputs: usize,
    method: Method,
) -> Result<Solution, ModelError> {
    factors.check_rows(observations, outputs)?;
    match method {
        Method::LeastSquares => Ok(least_squares::solve(factors, observations, outputs)),
        Method::Ridge(lambda) => ridge::solve(factors, observations, outputs, lambda),
        Method::Pcr(threshold) => pcr::solve(factors, observations, outputs, threshold),
    }
}
