//! The six-by-six tangent of the platform.

use super::Fem;
use super::newton::Balance;
use crate::assembly::Sums;
use nalgebra::{Matrix6, Vector6};

/// K_s = K_66 − K_6f K_ff⁻¹ K_f6 + geometric term, in (δr, δφ).
#[derive(Debug, Clone, Copy)]
pub(super) struct Condensed(pub [[f64; 6]; 6]);

impl Condensed {
    /// δ with K_s δ = right; `None` when K_s is singular.
    pub fn solve(&self, right: &[f64; 6]) -> Option<[f64; 6]> {
        let k = Matrix6::from_fn(|i, j| self.0[i][j]);
        k.lu()
            .solve(&Vector6::from_column_slice(right))
            .map(Into::into)
    }
}

impl Fem {
    /// From L⁻¹ K_f6 (`six`, column by column) and the pivots.
    pub(super) fn condensed(
        &self,
        sums: &Sums,
        balance: &Balance,
        six: &[f64],
        pivots: &[f64],
    ) -> Condensed {
        let n = self.pattern.unknowns;
        let mut k = sums.platform;
        for i in 0..6 {
            for j in 0..=i {
                let (a, b) = (&six[i * n..(i + 1) * n], &six[j * n..(j + 1) * n]);
                let sum: f64 = (0..n).map(|m| a[m] * b[m] / pivots[m]).sum();
                k[i][j] -= sum;
                if i != j {
                    k[j][i] -= sum;
                }
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                k[3 + i][3 + j] += balance.geometric[i][j];
            }
        }
        Condensed(k)
    }
}
