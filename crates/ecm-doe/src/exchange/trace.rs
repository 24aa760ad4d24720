//! Exchange for tr(M^-1 B): the average variance of predictions (I) or coefficients (A).

use super::pool::Pool;
use super::{State, Swap};
use crate::linalg::{dot, inverse, product, product_transposed, small_inverse};

/// A design with M^-1, Q = M^-1 B M^-1, and the blocks of both of every pool candidate.
///
/// Taking pose i out and j in lowers Phi = tr(M^-1 B) by tr(C W) with
/// C^-1 = [I + D_j, G_ji; G_ij, D_i - I], G = A M^-1 A', and W the same blocks of A Q A'.
#[derive(Debug, Clone)]
pub(crate) struct TraceState<'a> {
    pool: &'a Pool<'a>,
    design: Vec<usize>,
    free: Vec<bool>,
    inverse: Vec<f64>,
    weighted: Vec<f64>,
    trace: f64,
    log_det: f64,
    /// Share of log det M in the merit.
    share: f64,
    /// P blocks of A M^-1 A'.
    variances: Vec<f64>,
    /// P blocks of A Q A'.
    shares: Vec<f64>,
}

impl<'a> TraceState<'a> {
    /// `None` when the design is singular.
    pub fn new(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<Self> {
        let (b, k) = (pool.problem.block, pool.problem.terms);
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
            inverse: Vec::new(),
            weighted: vec![0.0; k * k],
            trace: f64::INFINITY,
            log_det: f64::NEG_INFINITY,
            share: 0.0,
            variances: vec![0.0; pool.len() * b * b],
            shares: vec![0.0; pool.len() * b * b],
        };
        state.rebuild().then_some(state)
    }

    /// Everything anew from the design; `false` when it is singular.
    fn rebuild(&mut self) -> bool {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let Ok((log_det, fresh)) = inverse(&self.pool.information(&self.design), k) else {
            return false;
        };
        let Some((half, share)) = self.pool.problem.objective.trace_part() else {
            return false;
        };
        (self.log_det, self.share) = (log_det, share);
        let mut root = vec![0.0; k * k];
        product(&mut root, (k, k, k), &fresh, half, 1.0, false);
        product_transposed(&mut self.weighted, (k, k, k), &root, &root);
        self.trace = dot(&root, half);
        self.inverse = fresh;
        let mut t = vec![0.0; self.pool.rows.len()];
        for (matrix, blocks) in [
            (&self.inverse, &mut self.variances),
            (&self.weighted, &mut self.shares),
        ] {
            product(
                &mut t,
                (self.pool.len() * b, k, k),
                &self.pool.rows,
                matrix,
                1.0,
                false,
            );
            let own = self.pool.rows.chunks_exact(b * k);
            for ((v, t), a) in blocks
                .chunks_exact_mut(b * b)
                .zip(t.chunks_exact(b * k))
                .zip(own)
            {
                product_small(v, b, k, t, a);
            }
        }
        true
    }

    /// A_i M^-1 and A_i Q.
    fn leaving(&self, row: usize) -> (Vec<f64>, Vec<f64>) {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let rows = self.pool.block_rows(self.design[row]);
        let (mut t, mut s) = (vec![0.0; b * k], vec![0.0; b * k]);
        product(&mut t, (b, k, k), rows, &self.inverse, 1.0, false);
        product(&mut s, (b, k, k), rows, &self.weighted, 1.0, false);
        (t, s)
    }

    /// Growth of the merit when `candidate` (cross blocks g, f) replaces pool pose `old`.
    fn growth(&self, old: usize, candidate: usize, g: &[f64], f: &[f64], work: &mut Work) -> f64 {
        let b = self.pool.problem.block;
        let at = |blocks: &'_ [f64], c: usize, i: usize| blocks[c * b * b + i];
        let (lowered, log_growth) = if b == 1 {
            let (d_in, d_out) = (
                at(&self.variances, candidate, 0),
                at(&self.variances, old, 0),
            );
            let (e_in, e_out) = (at(&self.shares, candidate, 0), at(&self.shares, old, 0));
            let growth = (1.0 + d_in) * (1.0 - d_out) + g[0] * g[0];
            if growth < 1e-9 {
                return f64::NEG_INFINITY;
            }
            let lowered =
                ((1.0 - d_out) * e_in + 2.0 * g[0] * f[0] - (1.0 + d_in) * e_out) / growth;
            (lowered, growth.ln())
        } else {
            let n = 2 * b;
            for r in 0..b {
                for c in 0..b {
                    let unit = if r == c { 1.0 } else { 0.0 };
                    let i = r * b + c;
                    work.c[r * n + c] = at(&self.variances, candidate, i) + unit;
                    work.c[(r + b) * n + c + b] = at(&self.variances, old, i) - unit;
                    work.c[r * n + c + b] = g[i];
                    work.c[(c + b) * n + r] = g[i];
                    work.w[r * n + c] = at(&self.shares, candidate, i);
                    work.w[(r + b) * n + c + b] = at(&self.shares, old, i);
                    work.w[r * n + c + b] = f[i];
                    work.w[(c + b) * n + r] = f[i];
                }
            }
            match small_inverse(&mut work.c, &mut work.inverse, n) {
                Some(growth) if growth > -20.0 => (dot(&work.inverse, &work.w), growth),
                _ => return f64::NEG_INFINITY,
            }
        };
        let after = self.trace - lowered;
        if after <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let k = self.pool.problem.terms as f64;
        (1.0 - self.share) * k * (self.trace / after).ln() + self.share * log_growth
    }
}

/// Scratch of the small inverse.
struct Work {
    c: Vec<f64>,
    inverse: Vec<f64>,
    w: Vec<f64>,
}

impl Work {
    fn new(b: usize) -> Self {
        let zeros = || vec![0.0; 4 * b * b];
        Self {
            c: zeros(),
            inverse: zeros(),
            w: zeros(),
        }
    }
}

/// V = T A' of b x k blocks.
fn product_small(v: &mut [f64], b: usize, k: usize, t: &[f64], a: &[f64]) {
    for r in 0..b {
        for c in 0..b {
            v[r * b + c] = dot(&t[r * k..(r + 1) * k], &a[c * k..(c + 1) * k]);
        }
    }
}

impl State for TraceState<'_> {
    const SCANS_ARE_CHEAP: bool = false;

    fn design(&self) -> &[usize] {
        &self.design
    }

    fn merit(&self) -> f64 {
        let k = self.pool.problem.terms as f64;
        // Without the determinant its infinite start must not count.
        let determinant = if self.share > 0.0 {
            self.share * self.log_det
        } else {
            0.0
        };
        determinant - (1.0 - self.share) * k * self.trace.ln()
    }

    fn best_for_row(&mut self, row: usize) -> Option<Swap> {
        let (b, k, count) = (
            self.pool.problem.block,
            self.pool.problem.terms,
            self.pool.len(),
        );
        let (t, s) = self.leaving(row);
        let (mut g, mut f) = (vec![0.0; count * b * b], vec![0.0; count * b * b]);
        product_transposed(&mut g, (count * b, k, b), &self.pool.rows, &t);
        product_transposed(&mut f, (count * b, k, b), &self.pool.rows, &s);
        let mut work = Work::new(b);
        let old = self.design[row];
        let mut best: Option<Swap> = None;
        for candidate in (0..count).filter(|&c| self.free[c]) {
            let own = candidate * b * b..(candidate + 1) * b * b;
            let gain = self.growth(old, candidate, &g[own.clone()], &f[own], &mut work);
            if gain > 0.0 && best.is_none_or(|s| gain > s.gain) {
                best = Some(Swap {
                    row,
                    candidate,
                    gain,
                });
            }
        }
        best
    }

    fn gain(&self, row: usize, candidate: usize) -> f64 {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let (t, s) = self.leaving(row);
        let (mut g, mut f) = (vec![0.0; b * b], vec![0.0; b * b]);
        product_small(&mut g, b, k, self.pool.block_rows(candidate), &t);
        product_small(&mut f, b, k, self.pool.block_rows(candidate), &s);
        self.growth(self.design[row], candidate, &g, &f, &mut Work::new(b))
    }

    fn swap(&mut self, row: usize, candidate: usize) -> bool {
        let old = std::mem::replace(&mut self.design[row], candidate);
        if !self.rebuild() {
            self.design[row] = old;
            return false;
        }
        if !self.pool.replicates {
            self.free[old] = true;
            self.free[candidate] = false;
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
        self.weighted.copy_from_slice(&other.weighted);
        self.trace = other.trace;
        self.log_det = other.log_det;
        self.variances.copy_from_slice(&other.variances);
        self.shares.copy_from_slice(&other.shares);
    }
}
