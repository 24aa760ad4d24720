//! Exchange of poses with several regressor rows (an energy model: six a pose).

use super::pair::{Pair, Removal, addition};
use super::pool::Pool;
use super::{State, Swap};
use crate::linalg::{product, product_transposed, small_inverse};

/// Swaps after which M^-1 is computed again.
const REBUILD_AFTER: usize = 200;

/// A design with M^-1 and the blocks D_j = A_j M^-1 A_j' of every pool candidate.
///
/// Taking pose i out and j in multiplies det M by
/// det(I - D_i) det(I + D_j + H H'), H = A_j M^-1 A_i' L^-T, L L' = I - D_i; where M would be
/// singular in between, by the determinant of the [`Pair`].
#[derive(Debug, Clone)]
pub(crate) struct BlockState<'a> {
    pool: &'a Pool<'a>,
    design: Vec<usize>,
    free: Vec<bool>,
    inverse: Vec<f64>,
    log_det: f64,
    /// P blocks of block x block.
    variances: Vec<f64>,
    /// Scratch, (P * block) x block.
    cross: Vec<f64>,
    swaps_since_rebuild: usize,
}

impl<'a> BlockState<'a> {
    /// `None` when the design is singular.
    pub fn new(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<Self> {
        let b = pool.problem.block;
        let (log_det, inverse) = pool.problem.regular_inverse(&pool.information(&design))?;
        let mut free = vec![true; pool.len()];
        if !pool.replicates {
            for &c in &design {
                free[c] = false;
            }
        }
        let mut state = Self {
            pool,
            design,
            free,
            inverse,
            log_det,
            variances: vec![0.0; pool.len() * b * b],
            cross: vec![0.0; pool.len() * b * b],
            swaps_since_rebuild: 0,
        };
        state.rebuild_variances();
        Some(state)
    }

    fn rebuild_variances(&mut self) {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let mut t = vec![0.0; self.pool.rows.len()];
        product(
            &mut t,
            (self.pool.len() * b, k, k),
            &self.pool.rows,
            &self.inverse,
        );
        let own = self.pool.rows.chunks_exact(b * k);
        for ((v, t), a) in self
            .variances
            .chunks_exact_mut(b * b)
            .zip(t.chunks_exact(b * k))
            .zip(own)
        {
            product_transposed(v, (b, k, b), t, a);
        }
        self.swaps_since_rebuild = 0;
    }

    fn variance(&self, candidate: usize) -> &[f64] {
        let size = self.pool.problem.block * self.pool.problem.block;
        &self.variances[candidate * size..(candidate + 1) * size]
    }

    /// A_i M^-1, and the removal of that pose.
    fn leaving(&self, row: usize) -> (Vec<f64>, Option<Removal>) {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let pose = self.design[row];
        let mut t = vec![0.0; b * k];
        let rows = self.pool.block_rows(pose);
        product(&mut t, (b, k, k), rows, &self.inverse);
        let removal = Removal::new(b, self.variance(pose), &t);
        (t, removal)
    }

    /// The growth when `candidate` enters, `cross` being A_j z' or A_j M^-1 A_i'.
    fn growth(
        &self,
        row: usize,
        candidate: usize,
        cross: &[f64],
        removal: Option<&Removal>,
        pair: &mut Pair,
    ) -> f64 {
        let own = self.variance(candidate);
        let found = match removal {
            Some(removal) => {
                let added = addition(self.pool.problem.block, own, cross, None);
                added.map(|(log, _)| removal.log + log)
            }
            None => pair.growth(own, self.variance(self.design[row]), cross),
        };
        found.unwrap_or(f64::NEG_INFINITY)
    }
}

impl State for BlockState<'_> {
    const SCANS_ARE_CHEAP: bool = false;

    fn design(&self) -> &[usize] {
        &self.design
    }

    fn merit(&self) -> f64 {
        self.log_det
    }

    fn best_for_row(&mut self, row: usize) -> Option<Swap> {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let (solved, removal) = self.leaving(row);
        let factor = removal.as_ref().map_or(&solved, |r| &r.z);
        let mut cross = std::mem::take(&mut self.cross);
        let shape = (self.pool.len() * b, k, b);
        product_transposed(&mut cross, shape, &self.pool.rows, factor);
        let mut pair = Pair::new(b);
        let mut best: Option<Swap> = None;
        for (candidate, h) in cross.chunks_exact(b * b).enumerate() {
            if !self.free[candidate] {
                continue;
            }
            let gain = self.growth(row, candidate, h, removal.as_ref(), &mut pair);
            if gain > 0.0 && best.is_none_or(|s| gain > s.gain) {
                best = Some(Swap {
                    row,
                    candidate,
                    gain,
                });
            }
        }
        self.cross = cross;
        best
    }

    fn gain(&self, row: usize, candidate: usize) -> f64 {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let (solved, removal) = self.leaving(row);
        let factor = removal.as_ref().map_or(&solved, |r| &r.z);
        let mut h = vec![0.0; b * b];
        let rows = self.pool.block_rows(candidate);
        product_transposed(&mut h, (b, k, b), rows, factor);
        self.growth(row, candidate, &h, removal.as_ref(), &mut Pair::new(b))
    }

    fn swap(&mut self, row: usize, candidate: usize) -> bool {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let old = self.design[row];
        let mut pair = self.pool.block_rows(candidate).to_vec();
        pair.extend_from_slice(self.pool.block_rows(old));
        // U' = [A_j; A_i] M^-1 and C = (S + [A_j; A_i] U)^-1 with S = diag(I, -I).
        let mut u = vec![0.0; 2 * b * k];
        product(&mut u, (2 * b, k, k), &pair, &self.inverse);
        let mut c = vec![0.0; 4 * b * b];
        product_transposed(&mut c, (2 * b, k, 2 * b), &u, &pair);
        for r in 0..2 * b {
            c[r * 2 * b + r] += if r < b { 1.0 } else { -1.0 };
        }
        let mut c_inv = vec![0.0; 4 * b * b];
        let Some(growth) = small_inverse(&mut c, &mut c_inv, 2 * b) else {
            return false;
        };
        if growth < -20.0 {
            return false;
        }
        let mut cu = vec![0.0; 2 * b * k];
        product(&mut cu, (2 * b, 2 * b, k), &c_inv, &u);
        let mut change = vec![0.0; k * k];
        crate::linalg::add_transposed_product(&mut change, (k, 2 * b, k), &u, &cu);
        for (v, d) in self.inverse.iter_mut().zip(&change) {
            *v -= d;
        }
        self.log_det += growth;
        self.design[row] = candidate;
        if !self.pool.replicates {
            self.free[old] = true;
            self.free[candidate] = false;
        }
        self.swaps_since_rebuild += 1;
        if self.swaps_since_rebuild >= REBUILD_AFTER {
            let problem = self.pool.problem;
            let fresh = problem.regular_inverse(&self.pool.information(&self.design));
            if let Some((value, fresh)) = fresh {
                (self.log_det, self.inverse) = (value, fresh);
            }
            self.rebuild_variances();
            return true;
        }
        // D_p -= (A_p U) C (A_p U)'.
        let count = self.pool.len();
        let mut w = vec![0.0; count * b * 2 * b];
        product_transposed(&mut w, (count * b, k, 2 * b), &self.pool.rows, &u);
        let mut wc = vec![0.0; w.len()];
        product(&mut wc, (count * b, 2 * b, 2 * b), &w, &c_inv);
        for ((v, w), wc) in self
            .variances
            .chunks_exact_mut(b * b)
            .zip(w.chunks_exact(2 * b * b))
            .zip(wc.chunks_exact(2 * b * b))
        {
            for r in 0..b {
                for s in 0..b {
                    let mut sum = 0.0;
                    for a in 0..2 * b {
                        sum += wc[r * 2 * b + a] * w[s * 2 * b + a];
                    }
                    v[r * b + s] -= sum;
                }
            }
        }
        true
    }

    fn is_free(&self, candidate: usize) -> bool {
        self.free[candidate]
    }

    fn copy_from(&mut self, other: &Self) {
        self.design.copy_from_slice(&other.design);
        self.free.copy_from_slice(&other.free);
        self.inverse.copy_from_slice(&other.inverse);
        self.log_det = other.log_det;
        self.variances.copy_from_slice(&other.variances);
        self.swaps_since_rebuild = other.swaps_since_rebuild;
    }
}
