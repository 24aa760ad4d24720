//! The six-by-six tangent of the platform.

use super::Fem;
use super::newton::Workspace;

impl Fem {
    /// K_s = K_66 − K_6f K_ff⁻¹ K_f6 + geometric term, in (δr, δφ), from L⁻¹ K_f6 and the pivots.
    pub(super) fn at_constant_inputs(&self, work: &Workspace) -> [[f64; 6]; 6] {
        let n = self.pattern.unknowns;
        let mut k = work.sums.platform;
        let column = |i: usize| &work.columns[i * n..(i + 1) * n];
        for i in 0..6 {
            for j in 0..=i {
                let sum = work.along(column(i), column(j));
                k[i][j] -= sum;
                if i != j {
                    k[j][i] -= sum;
                }
            }
        }
        for i in 0..3 {
            for j in 0..3 {
                k[3 + i][3 + j] += work.balance.geometric[i][j];
            }
        }
        k
    }
}
