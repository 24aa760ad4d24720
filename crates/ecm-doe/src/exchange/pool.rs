//! The candidates of an exchange, in the memory layout of its scans.

use crate::problem::Problem;

/// Some candidates of a problem: their indices, rows, and single-precision copies.
#[derive(Debug)]
pub(crate) struct Pool<'a> {
    pub problem: &'a Problem,
    /// Candidate of each pool position.
    pub ids: Vec<usize>,
    /// (P * block) x k.
    pub rows: Vec<f64>,
    /// P x k in single precision, for block 1.
    pub rows_f32: Vec<f32>,
    /// k x P in single precision, for block 1.
    pub columns_f32: Vec<f32>,
    /// A pose may be chosen more than once.
    pub replicates: bool,
}

impl<'a> Pool<'a> {
    /// The available candidates among `ids`.
    pub fn new(problem: &'a Problem, ids: Vec<usize>, replicates: bool) -> Self {
        let rows: Vec<f64> = ids
            .iter()
            .flat_map(|&i| problem.pose(i).iter().copied())
            .collect();
        let (k, count) = (problem.terms, ids.len());
        let (mut rows_f32, mut columns_f32) = (Vec::new(), Vec::new());
        if problem.block == 1 {
            rows_f32 = rows.iter().map(|v| *v as f32).collect();
            columns_f32 = vec![0.0; rows.len()];
            for (p, row) in rows.chunks_exact(k).enumerate() {
                for (c, v) in row.iter().enumerate() {
                    columns_f32[c * count + p] = *v as f32;
                }
            }
        }
        Self {
            problem,
            ids,
            rows,
            rows_f32,
            columns_f32,
            replicates,
        }
    }

    /// Number of candidates.
    pub fn len(&self) -> usize {
        self.ids.len()
    }

    /// Rows of a pool candidate, block x k.
    pub fn block_rows(&self, candidate: usize) -> &[f64] {
        let stride = self.problem.block * self.problem.terms;
        &self.rows[candidate * stride..(candidate + 1) * stride]
    }

    /// The problem's fixed information plus that of `design` (pool positions).
    pub fn information(&self, design: &[usize]) -> Vec<f64> {
        let (b, k) = (self.problem.block, self.problem.terms);
        let mut m = self.problem.fixed.clone();
        let rows: Vec<f64> = design
            .iter()
            .flat_map(|&c| self.block_rows(c).iter().copied())
            .collect();
        crate::linalg::add_transposed_product(&mut m, (k, design.len() * b, k), &rows, &rows);
        m
    }
}
