//! Exchange of poses with one regressor row: the cross-variance table G = X_D M^-1 X_C'.

use pulp::Arch;

use super::information::{InformationMatrix, woodbury};
use super::kernel;
use super::pool::Pool;
use super::{State, Swap};
use crate::linalg::{dot, product_transposed};

/// Swaps after which the single-precision table is computed again.
const REBUILD_AFTER: usize = 150;

/// A design with G (rows D, columns the pool) and d = diag(X_C M^-1 X_C') kept up to date.
///
/// G (single precision) proposes swaps; M^-1 (double precision) decides.
#[derive(Debug, Clone)]
pub(crate) struct CrossState<'a> {
    pool: &'a Pool<'a>,
    arch: Arch,
    design: Vec<usize>,
    /// 1 for candidates that may enter, 0 for those in the design.
    free: Vec<f32>,
    information: InformationMatrix,
    g: Vec<f32>,
    d: Vec<f32>,
    d_design: Vec<f32>,
    swaps_since_rebuild: usize,
}

impl<'a> CrossState<'a> {
    /// `None` when the design is singular.
    pub fn new(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<Self> {
        let k = pool.problem.terms;
        let found = pool.problem.regular_inverse(&pool.information(&design))?;
        let information = InformationMatrix::from_inverse(found, k);
        let mut free = vec![1.0; pool.len()];
        if !pool.replicates {
            for &c in &design {
                free[c] = 0.0;
            }
        }
        let mut state = Self {
            pool,
            arch: Arch::new(),
            g: vec![0.0; design.len() * pool.len()],
            d: vec![0.0; pool.len()],
            d_design: vec![0.0; design.len()],
            design,
            free,
            information,
            swaps_since_rebuild: 0,
        };
        state.rebuild_tables();
        Some(state)
    }

    fn rebuild_tables(&mut self) {
        let (k, width) = (self.pool.problem.terms, self.pool.len());
        let inverse: Vec<f32> = self
            .information
            .inverse()
            .iter()
            .map(|v| *v as f32)
            .collect();
        let mut t = vec![0.0f32; width * k];
        product_transposed(&mut t, (width, k, k), &self.pool.rows_f32, &inverse);
        for ((d, t), x) in self
            .d
            .iter_mut()
            .zip(t.chunks_exact(k))
            .zip(self.pool.rows_f32.chunks_exact(k))
        {
            *d = t.iter().zip(x).map(|(a, b)| a * b).sum();
        }
        let rows: Vec<f32> = self
            .design
            .iter()
            .flat_map(|&c| t[c * k..(c + 1) * k].iter().copied())
            .collect();
        let shape = (self.design.len(), k, width);
        product_transposed(&mut self.g, shape, &rows, &self.pool.rows_f32);
        self.refresh_design_variances();
        self.swaps_since_rebuild = 0;
    }

    fn refresh_design_variances(&mut self) {
        for (v, &c) in self.d_design.iter_mut().zip(&self.design) {
            *v = self.d[c];
        }
    }

    /// Computes M and its inverse again from the design, which limits rounding in long runs.
    fn rebuild(&mut self) {
        let fresh = self.pool.information(&self.design);
        let problem = self.pool.problem;
        if let Some(found) = problem.regular_inverse(&fresh) {
            self.information = InformationMatrix::from_inverse(found, problem.terms);
        }
        self.rebuild_tables();
    }

    fn proposal(&self, value: f32, row: usize, candidate: usize) -> Option<Swap> {
        (value > 1.0).then(|| Swap {
            row,
            candidate,
            gain: f64::from(value).ln(),
        })
    }
}

impl State for CrossState<'_> {
    const SCANS_ARE_CHEAP: bool = true;

    fn design(&self) -> &[usize] {
        &self.design
    }

    fn merit(&self) -> f64 {
        self.information.log_det()
    }

    fn best_for_row(&mut self, row: usize) -> Option<Swap> {
        let width = self.pool.len();
        let g = &self.g[row * width..(row + 1) * width];
        let (value, at) = kernel::scan(self.arch, g, &self.d, &self.free, self.d_design[row]);
        self.proposal(value, row, at)
    }

    fn best_pair(&mut self) -> Option<Swap> {
        let (value, row, at) =
            kernel::scan_all(self.arch, &self.g, &self.d, &self.free, &self.d_design);
        self.proposal(value, row, at)
    }

    fn gain(&self, row: usize, candidate: usize) -> f64 {
        let leaving = self.pool.block_rows(self.design[row]);
        self.information
            .growth(leaving, self.pool.block_rows(candidate))
            .max(0.0)
            .ln()
    }

    fn swap(&mut self, row: usize, candidate: usize) -> bool {
        let width = self.pool.len();
        let old = self.design[row];
        let (leaving, entering) = (self.pool.block_rows(old), self.pool.block_rows(candidate));
        let (out, into) = (
            self.information.solve(leaving),
            self.information.solve(entering),
        );
        let (g, d_in) = (dot(leaving, &into), dot(entering, &into));
        let d_out = dot(leaving, &out);
        let growth = (1.0 + d_in) * (1.0 - d_out) + g * g;
        if !(growth > 1e-9 && growth.is_finite()) {
            return false;
        }
        let c = woodbury(d_in, d_out, g);
        self.information.subtract(&into, &out, c);
        self.information.add_log(growth.ln());
        self.design[row] = candidate;
        if !self.pool.replicates {
            self.free[old] = 1.0;
            self.free[candidate] = 0.0;
        }
        self.swaps_since_rebuild += 1;
        if self.swaps_since_rebuild >= REBUILD_AFTER {
            self.rebuild();
            return true;
        }
        let mut g_in = vec![0.0f32; width];
        kernel::combine(self.arch, &into, &self.pool.columns_f32, &mut g_in);
        let g_out = self.g[row * width..(row + 1) * width].to_vec();
        // The leaving row becomes the entering one before all rows are updated in the same way.
        self.g[row * width..(row + 1) * width].copy_from_slice(&g_in);
        let c = c.map(|v| v as f32);
        let factors: Vec<(f32, f32)> = self
            .g
            .chunks_exact(width)
            .map(|r| {
                let (x, y) = (r[candidate], r[old]);
                (c[0] * x + c[1] * y, c[1] * x + c[2] * y)
            })
            .collect();
        kernel::downdate(
            self.arch,
            &mut self.g,
            &mut self.d,
            (&g_in, &g_out),
            &factors,
            c,
        );
        self.refresh_design_variances();
        true
    }

    fn is_free(&self, candidate: usize) -> bool {
        self.free[candidate] > 0.0
    }

    fn copy_from(&mut self, other: &Self) {
        self.design.copy_from_slice(&other.design);
        self.free.copy_from_slice(&other.free);
        self.information.copy_from(&other.information);
        self.g.copy_from_slice(&other.g);
        self.d.copy_from_slice(&other.d);
        self.d_design.copy_from_slice(&other.d_design);
        self.swaps_since_rebuild = other.swaps_since_rebuild;
    }
}
