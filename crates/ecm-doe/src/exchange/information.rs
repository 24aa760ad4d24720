//! Inverse and log determinant of M, updated under exchanges of single rows.

use crate::DesignError;
use crate::linalg::{dot, inverse};
use crate::problem::check_finite;

/// M^-1 and log det M of an information matrix that changes by exchanges of regressor rows.
///
/// Swapping x_i for x_j: det M' = det M [(1 + d_j)(1 - d_i) + g_ij^2] with d = x' M^-1 x and
/// g_ij = x_i' M^-1 x_j; M'^-1 follows by the rank-two Woodbury formula.
#[derive(Debug, Clone)]
pub struct InformationMatrix {
    terms: usize,
    inverse: Vec<f64>,
    log_det: f64,
}

/// Largest number of M⁻¹: products of two must not overflow.
const LARGEST_INVERSE: f64 = 1e100;

impl InformationMatrix {
    /// From M (k x k, row-major).
    ///
    /// # Errors
    /// A wrong shape, numbers that are not finite, and an M that is not positive definite.
    pub fn new(matrix: &[f64], terms: usize) -> Result<Self, DesignError> {
        if terms == 0 || terms.checked_mul(terms) != Some(matrix.len()) {
            return Err(DesignError::Shape {
                what: "the information matrix",
                found: matrix.len(),
                expected: terms.saturating_mul(terms),
            });
        }
        check_finite("the information matrix", matrix, terms)?;
        let refused = |value| DesignError::Setting {
            name: "information",
            value,
            expected: "a symmetric positive definite matrix; add rows or take a smaller model",
        };
        let (log_det, inverse) = inverse(matrix, terms).map_err(|column| {
            refused(format!(
                "a matrix whose column {column} depends on those before it"
            ))
        })?;
        if let Some(large) = inverse.iter().find(|v| v.abs() > LARGEST_INVERSE) {
            return Err(refused(format!("a matrix whose inverse holds {large:e}")));
        }
        Ok(Self {
            terms,
            inverse,
            log_det,
        })
    }

    /// From a matrix that [`crate::Problem`] has found to be regular.
    pub(crate) fn from_inverse((log_det, inverse): (f64, Vec<f64>), terms: usize) -> Self {
        Self {
            terms,
            inverse,
            log_det,
        }
    }

    /// log det M.
    pub fn log_det(&self) -> f64 {
        self.log_det
    }

    /// M^-1, k x k.
    pub fn inverse(&self) -> &[f64] {
        &self.inverse
    }

    /// M^-1 x.
    pub fn solve(&self, x: &[f64]) -> Vec<f64> {
        self.inverse
            .chunks_exact(self.terms)
            .map(|row| dot(row, x))
            .collect()
    }

    /// The factor by which det M grows when `leaving` is swapped for `entering`.
    pub fn growth(&self, leaving: &[f64], entering: &[f64]) -> f64 {
        let (out, into) = (self.solve(leaving), self.solve(entering));
        let g = dot(leaving, &into);
        (1.0 + dot(entering, &into)) * (1.0 - dot(leaving, &out)) + g * g
    }

    /// Swaps the rows; the growth of det M. Nothing changes when M would become singular.
    pub fn exchange(&mut self, leaving: &[f64], entering: &[f64]) -> f64 {
        let (out, into) = (self.solve(leaving), self.solve(entering));
        let (g, d_in, d_out) = (
            dot(leaving, &into),
            dot(entering, &into),
            dot(leaving, &out),
        );
        let growth = (1.0 + d_in) * (1.0 - d_out) + g * g;
        if growth > 1e-12 && growth.is_finite() {
            let c = woodbury(d_in, d_out, g);
            self.subtract(&into, &out, c);
            self.log_det += growth.ln();
        }
        growth
    }

    pub(crate) fn subtract(&mut self, into: &[f64], out: &[f64], c: [f64; 3]) {
        let k = self.terms;
        for (r, row) in self.inverse.chunks_exact_mut(k).enumerate() {
            let a = c[0] * into[r] + c[1] * out[r];
            let b = c[1] * into[r] + c[2] * out[r];
            for ((v, x), y) in row.iter_mut().zip(into).zip(out) {
                *v -= a * x + b * y;
            }
        }
    }

    pub(crate) fn add_log(&mut self, log_growth: f64) {
        self.log_det += log_growth;
    }

    pub(crate) fn copy_from(&mut self, other: &Self) {
        self.inverse.copy_from_slice(&other.inverse);
        self.log_det = other.log_det;
    }
}

/// C = [[1 + d_in, g], [g, d_out - 1]]^-1 as (C_11, C_12, C_22): M'^-1 = M^-1 - U C U'.
pub(crate) fn woodbury(d_in: f64, d_out: f64, g: f64) -> [f64; 3] {
    let det = (1.0 + d_in) * (d_out - 1.0) - g * g;
    [(d_out - 1.0) / det, -g / det, (1.0 + d_in) / det]
}
