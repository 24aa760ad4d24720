//! Exchange for tr(M^-1 B): the average variance of predictions (I) or coefficients (A).

use super::pair::{Pair, Removal, addition, left_product, removed_trace};
use super::pool::Pool;
use super::{State, Swap};
use crate::linalg::{add_transposed_product, dot, product, product_transposed, small_inverse};

/// Swaps after which everything is computed again.
const REBUILD_AFTER: usize = 100;

/// A design with M^-1, Q = M^-1 B M^-1, and the blocks of both of every pool candidate.
///
/// Taking pose i out and j in lowers Phi = tr(M^-1 B) by tr(C W) with
/// C^-1 = [I + D_j, G_ji; G_ij, D_i - I], G = A M^-1 A', and W the same blocks of A Q A'.
/// With U = [A_j; A_i] the swap changes M^-1 by -u' C u, u = U M^-1, and Q by -u' E - E' u,
/// E = C (F - W C u / 2), F = U Q.
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
    swaps_since_rebuild: usize,
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
            swaps_since_rebuild: 0,
        };
        state.rebuild().then_some(state)
    }

    /// Computes everything again from the design; `false` when it is singular.
    fn rebuild(&mut self) -> bool {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let m = self.pool.information(&self.design);
        let Some((log_det, fresh)) = self.pool.problem.regular_inverse(&m) else {
            return false;
        };
        let Some((half, share)) = self.pool.problem.objective.trace_part() else {
            return false;
        };
        (self.log_det, self.share) = (log_det, share);
        let mut root = vec![0.0; k * k];
        product(&mut root, (k, k, k), &fresh, half);
        product_transposed(&mut self.weighted, (k, k, k), &root, &root);
        self.trace = dot(&root, half);
        self.inverse = fresh;
        self.swaps_since_rebuild = 0;
        let mut t = vec![0.0; self.pool.rows.len()];
        for (matrix, blocks) in [
            (&self.inverse, &mut self.variances),
            (&self.weighted, &mut self.shares),
        ] {
            product(&mut t, (self.pool.len() * b, k, k), &self.pool.rows, matrix);
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

    /// Takes pool pose `old` out and `candidate` in; `false`, and nothing changed, when M would
    /// be singular.
    fn update(&mut self, old: usize, candidate: usize) -> bool {
        let (b, k, count) = (
            self.pool.problem.block,
            self.pool.problem.terms,
            self.pool.len(),
        );
        let n = 2 * b;
        let mut pair = self.pool.block_rows(candidate).to_vec();
        pair.extend_from_slice(self.pool.block_rows(old));
        let (mut u, mut f) = (vec![0.0; n * k], vec![0.0; n * k]);
        product(&mut u, (n, k, k), &pair, &self.inverse);
        product(&mut f, (n, k, k), &pair, &self.weighted);
        let (mut small, mut w) = (vec![0.0; n * n], vec![0.0; n * n]);
        product_transposed(&mut small, (n, k, n), &u, &pair);
        product_transposed(&mut w, (n, k, n), &f, &pair);
        for r in 0..n {
            small[r * n + r] += if r < b { 1.0 } else { -1.0 };
        }
        let mut c = vec![0.0; n * n];
        let growth = small_inverse(&mut small, &mut c, n).filter(|g| *g > -20.0);
        let (Some(growth), lowered) = (growth, dot(&c, &w)) else {
            return false;
        };
        if self.trace <= lowered {
            return false;
        }
        // E = C F - C W C u / 2.
        let (mut cu, mut wcu, mut e) = (vec![0.0; n * k], vec![0.0; n * k], vec![0.0; n * k]);
        product(&mut cu, (n, n, k), &c, &u);
        product(&mut wcu, (n, n, k), &w, &cu);
        for (f, half) in f.iter_mut().zip(&wcu) {
            *f -= 0.5 * half;
        }
        product(&mut e, (n, n, k), &c, &f);
        let mut change = vec![0.0; k * k];
        add_transposed_product(&mut change, (k, n, k), &u, &cu);
        for (v, d) in self.inverse.iter_mut().zip(&change) {
            *v -= d;
        }
        change.fill(0.0);
        add_transposed_product(&mut change, (k, n, k), &u, &e);
        for r in 0..k {
            for s in 0..k {
                self.weighted[r * k + s] -= change[r * k + s] + change[s * k + r];
            }
        }
        self.trace -= lowered;
        self.log_det += growth;
        // The same for A_p M^-1 A_p' and A_p Q A_p' of every candidate.
        let (mut own_u, mut own_cu, mut own_e) = (
            vec![0.0; count * b * n],
            vec![0.0; count * b * n],
            vec![0.0; count * b * n],
        );
        let rows = &self.pool.rows;
        product_transposed(&mut own_u, (count * b, k, n), rows, &u);
        product(&mut own_cu, (count * b, n, n), &own_u, &c);
        product_transposed(&mut own_e, (count * b, k, n), rows, &e);
        let parts = own_u
            .chunks_exact(b * n)
            .zip(own_cu.chunks_exact(b * n).zip(own_e.chunks_exact(b * n)));
        let blocks = self.variances.chunks_exact_mut(b * b);
        let blocks = blocks.zip(self.shares.chunks_exact_mut(b * b));
        for ((v, q), (u, (cu, e))) in blocks.zip(parts) {
            for r in 0..b {
                for s in 0..b {
                    let (mut of_v, mut of_q) = (0.0, 0.0);
                    for a in 0..n {
                        of_v += cu[r * n + a] * u[s * n + a];
                        of_q += u[r * n + a] * e[s * n + a] + e[r * n + a] * u[s * n + a];
                    }
                    v[r * b + s] -= of_v;
                    q[r * b + s] -= of_q;
                }
            }
        }
        true
    }

    /// A_i M^-1 and A_i Q.
    fn leaving(&self, row: usize) -> (Vec<f64>, Vec<f64>) {
        let (b, k) = (self.pool.problem.block, self.pool.problem.terms);
        let rows = self.pool.block_rows(self.design[row]);
        let (mut t, mut s) = (vec![0.0; b * k], vec![0.0; b * k]);
        product(&mut t, (b, k, k), rows, &self.inverse);
        product(&mut s, (b, k, k), rows, &self.weighted);
        (t, s)
    }

    /// The removal of design row `row`.
    fn departure(&self, row: usize) -> Departure {
        let b = self.pool.problem.block;
        let (t, s) = self.leaving(row);
        let pose = self.design[row];
        let own = &self.variances[pose * b * b..(pose + 1) * b * b];
        let removal = (b > 1).then(|| Removal::new(b, own, &t)).flatten();
        let removed = removal.map(|removal| {
            let y = left_product(&removal.inv_lower, &s, b);
            let n = removed_trace(&removal, &y, self.pool.block_rows(pose), b);
            (removal, y, n)
        });
        match removed {
            Some((removal, y, n)) => Departure {
                pose,
                first: removal.z.clone(),
                second: y,
                removed: Some((removal, n)),
                pair: Pair::new(b),
            },
            None => Departure {
                pose,
                first: t,
                second: s,
                removed: None,
                pair: Pair::new(b),
            },
        }
    }

    /// Growth of the merit when `candidate` enters; g and f are the products of its rows with
    /// both factors of the departure.
    fn growth(&self, out: &mut Departure, candidate: usize, g: &[f64], f: &[f64]) -> f64 {
        let b = self.pool.problem.block;
        let of = |c: usize| c * b * b..(c + 1) * b * b;
        let (d_in, e_in) = (&self.variances[of(candidate)], &self.shares[of(candidate)]);
        let (d_out, e_out) = (&self.variances[of(out.pose)], &self.shares[of(out.pose)]);
        let found = match &out.removed {
            Some((removal, n)) => {
                let back: f64 = (0..b).map(|r| n[r * b + r]).sum();
                addition(b, d_in, g, Some((e_in, f, n)))
                    .map(|(log, lowered)| (lowered - back, removal.log + log))
            }
            None if b == 1 => {
                let growth = (1.0 + d_in[0]) * (1.0 - d_out[0]) + g[0] * g[0];
                let change = (1.0 - d_out[0]) * e_in[0] + 2.0 * g[0] * f[0];
                let change = change - (1.0 + d_in[0]) * e_out[0];
                (growth >= 1e-9).then(|| (change / growth, growth.ln()))
            }
            None => {
                let growth = out.pair.growth(d_in, d_out, g);
                growth.map(|log| (out.pair.trace(e_in, e_out, f), log))
            }
        };
        let Some((lowered, log_growth)) = found else {
            return f64::NEG_INFINITY;
        };
        let after = self.trace - lowered;
        if after <= 0.0 {
            return f64::NEG_INFINITY;
        }
        let k = self.pool.problem.terms as f64;
        (1.0 - self.share) * k * (self.trace / after).ln() + self.share * log_growth
    }
}

/// A pose about to leave the design.
struct Departure {
    pose: usize,
    /// A_i M^-1, or L^-1 of it after a removal.
    first: Vec<f64>,
    /// A_i Q, or L^-1 of it after a removal.
    second: Vec<f64>,
    /// The removal, and N by which the trace rises.
    removed: Option<(Removal, Vec<f64>)>,
    pair: Pair,
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
        let mut out = self.departure(row);
        let (mut g, mut f) = (vec![0.0; count * b * b], vec![0.0; count * b * b]);
        product_transposed(&mut g, (count * b, k, b), &self.pool.rows, &out.first);
        product_transposed(&mut f, (count * b, k, b), &self.pool.rows, &out.second);
        let mut best: Option<Swap> = None;
        for candidate in (0..count).filter(|&c| self.free[c]) {
            let own = candidate * b * b..(candidate + 1) * b * b;
            let gain = self.growth(&mut out, candidate, &g[own.clone()], &f[own]);
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
        let mut out = self.departure(row);
        let (mut g, mut f) = (vec![0.0; b * b], vec![0.0; b * b]);
        let rows = self.pool.block_rows(candidate);
        product_small(&mut g, b, k, rows, &out.first);
        product_small(&mut f, b, k, rows, &out.second);
        self.growth(&mut out, candidate, &g, &f)
    }

    fn swap(&mut self, row: usize, candidate: usize) -> bool {
        let old = self.design[row];
        if !self.update(old, candidate) {
            return false;
        }
        self.design[row] = candidate;
        self.swaps_since_rebuild += 1;
        if self.swaps_since_rebuild >= REBUILD_AFTER && !self.rebuild() {
            self.design[row] = old;
            self.rebuild();
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
        self.swaps_since_rebuild = other.swaps_since_rebuild;
    }
}
