//! Ordinary least squares by singular values.

use crate::dense::ThinSvd;
use crate::regression::{Solution, pcr};

/// β = X⁺ Y: every singular value above rounding is used.
///
/// # Panics
/// Where `observations` has not `outputs` numbers for each row of X; [`super::solve`] says so.
pub fn solve(factors: &ThinSvd, observations: &[f64], outputs: usize) -> Solution {
    pcr::truncated(factors, observations, outputs, factors.numerical_rank())
}
