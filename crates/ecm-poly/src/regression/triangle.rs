//! The triangle of a tall matrix, block by block: all that least squares needs of its rows.
//!
//! X = Q R with orthonormal Q has the singular values of R and the same normal equations, and the
//! triangle of two stacked triangles is that of their rows (TSQR: Demmel, Grigori, Hoemmen and Langou,
//! SIAM J. Sci. Comput. 34 (2012) A206). No block of rows outlives its turn, and unlike in the Gram
//! matrix the condition number is not squared.
//!
//! A block B joins R by matrix products alone, twice as fast as by Householder's reflections: with
//! Z = B R⁻¹ the rows of both have the Gram matrix Rᵀ (I + Zᵀ Z) R, so that the next triangle is Lᵀ R
//! of L Lᵀ = I + Zᵀ Z. That matrix has a condition number of at most its trace, whatever that of R is;
//! a block whose rows are far beyond those before it goes by reflections.

use std::ops::Range;
use std::vec::Vec;

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::linalg::triangular_solve::solve_lower_triangular_in_place;
use faer::{Accum, Mat, MatMut, MatRef, Par, Side};
use rayon::prelude::*;

use crate::dense::ThinSvd;
use crate::error::{ModelError, check_count};
use crate::regression::{Method, Solution, solve};

/// Numbers in a block of rows: a few of them fit into a core's cache.
const BLOCK: usize = 1 << 17;
/// Blocks that one thread reduces in turn.
const TURN: usize = 16;
/// Largest trace of I + Zᵀ Z per column: four of the sixteen digits.
const FAR: f64 = 1e4;

/// R of rows [X | Y], and how many rows it stands for.
#[derive(Clone, Debug)]
pub struct Triangle {
    r: Mat<f64>,
    rows: usize,
}

impl Triangle {
    /// Reduces `rows` rows of `columns` numbers, which `fill` makes range by range.
    ///
    /// The ranges do not depend on the number of threads, and neither do the bits of the result.
    /// `lines` is the number of matrix rows that a row of the range stands for (six of a wrench).
    ///
    /// # Errors
    /// No line or no column; a block of another size; the error of `fill` in the first range that has one.
    pub fn of_rows<F>(
        rows: usize,
        lines: usize,
        columns: usize,
        fill: F,
    ) -> Result<Self, ModelError>
    where
        F: Fn(Range<usize>) -> Result<Vec<f64>, ModelError> + Sync,
    {
        if lines == 0 || columns == 0 {
            return Err(ModelError::Setting {
                name: "rows",
                found: std::format!("{lines} lines of {columns} columns"),
                expected: "one line and one column, or more",
            });
        }
        let least = columns.saturating_mul(2).div_ceil(lines);
        let block = (BLOCK / lines.saturating_mul(columns)).max(least);
        let turn = |t: usize| -> Result<Self, ModelError> {
            let mut own = Self::none(columns);
            let end = rows.min((t + 1) * TURN * block);
            for start in (t * TURN * block..end).step_by(block) {
                let part = start..end.min(start + block);
                let expected = part.len().saturating_mul(lines).saturating_mul(columns);
                let rows = fill(part)?;
                check_count("rows", "numbers", rows.len(), expected)?;
                own.add(&rows);
            }
            Ok(own)
        };
        let turns = rows.div_ceil(TURN * block);
        let parts: Vec<Result<Self, ModelError>> = if turns > 1 {
            (0..turns).into_par_iter().map(turn).collect()
        } else {
            (0..turns).map(turn).collect()
        };
        let mut whole = Self::none(columns);
        for part in parts {
            whole.merge(&part?);
        }
        Ok(whole)
    }

    /// The triangle of no rows.
    ///
    /// # Panics
    /// Where (columns, columns) numbers are more than memory holds.
    pub fn none(columns: usize) -> Self {
        Self {
            r: Mat::zeros(columns, columns),
            rows: 0,
        }
    }

    /// The triangle of the rows of several (columns, columns), row-major, which stand for `rows` rows.
    ///
    /// # Panics
    /// Where a part is no whole number of rows.
    pub fn of_parts<P: AsRef<[f64]>>(
        parts: impl IntoIterator<Item = P>,
        columns: usize,
        rows: usize,
    ) -> Self {
        let mut whole = Self::none(columns);
        for part in parts {
            whole.add(part.as_ref());
        }
        Self { rows, ..whole }
    }

    /// Row-major (columns, columns).
    pub fn to_row_major(&self) -> Vec<f64> {
        row_major(self.r.as_ref())
    }

    /// Number of rows that it stands for.
    pub fn rows(&self) -> usize {
        self.rows
    }

    /// Number of columns.
    pub fn columns(&self) -> usize {
        self.r.ncols()
    }

    /// Adds row-major rows.
    ///
    /// # Panics
    /// Where they are no whole number of rows.
    pub fn add(&mut self, rows: &[f64]) {
        let columns = self.r.ncols();
        let count = rows.len() / columns.max(1);
        let joined = count > columns && self.rows > columns && self.join(rows.to_vec(), count);
        if !joined {
            self.stack(MatRef::from_row_major_slice(rows, count, columns));
        }
        self.rows += count;
    }

    /// R ← Lᵀ R with L Lᵀ = I + Zᵀ Z, Z = B R⁻¹ of the row-major rows B; whether they are near enough.
    fn join(&mut self, mut rows: Vec<f64>, count: usize) -> bool {
        let columns = self.r.ncols();
        let mut z = MatMut::from_column_major_slice_mut(&mut rows, columns, count);
        solve_lower_triangular_in_place(self.r.transpose(), z.as_mut(), Par::Seq);
        let mut gram = Mat::identity(columns, columns);
        triangular::matmul(
            &mut gram,
            BlockStructure::TriangularLower,
            Accum::Add,
            z.as_ref(),
            BlockStructure::Rectangular,
            z.as_ref().transpose(),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
        let trace: f64 = (0..columns).map(|j| gram[(j, j)]).sum();
        if trace.is_nan() || trace > FAR * columns as f64 {
            return false;
        }
        let Ok(factor) = gram.llt(Side::Lower) else {
            return false;
        };
        let mut next = Mat::zeros(columns, columns);
        triangular::matmul(
            &mut next,
            BlockStructure::TriangularUpper,
            Accum::Replace,
            factor.L().transpose(),
            BlockStructure::TriangularUpper,
            &self.r,
            BlockStructure::TriangularUpper,
            1.0,
            Par::Seq,
        );
        self.r = next;
        true
    }

    /// Adds the rows of another triangle.
    ///
    /// # Panics
    /// Where it has another number of columns, and both stand for rows.
    pub fn merge(&mut self, other: &Self) {
        if self.rows == 0 {
            *self = other.clone();
            return;
        }
        self.stack(other.r.as_ref());
        self.rows += other.rows;
    }

    fn stack(&mut self, below: MatRef<'_, f64>) {
        let columns = self.r.ncols();
        let above = if self.rows == 0 { 0 } else { columns };
        let mut both = Mat::zeros(above + below.nrows(), columns);
        both.subrows_mut(0, above)
            .copy_from(self.r.subrows(0, above));
        both.subrows_mut(above, below.nrows()).copy_from(below);
        let qr = both.qr();
        let r = qr.thin_R();
        self.r = Mat::zeros(columns, columns);
        for j in 0..columns {
            for i in 0..r.nrows().min(j + 1) {
                self.r[(i, j)] = r[(i, j)];
            }
        }
    }

    /// Euclidean length of each of the first `k` columns.
    ///
    /// # Panics
    /// Where it has fewer than `k` columns.
    pub fn lengths(&self, k: usize) -> Vec<f64> {
        (0..k).map(|j| self.r.col(j).norm_l2()).collect()
    }

    /// Divides the first columns by these lengths.
    ///
    /// # Panics
    /// Where it has fewer columns than there are lengths.
    pub fn divide_columns(&mut self, lengths: &[f64]) {
        for (j, length) in lengths.iter().enumerate() {
            self.r.col_mut(j).iter_mut().for_each(|x| *x /= length);
        }
    }

    /// Least squares of the columns from `k` on by the first `k` ones.
    ///
    /// # Errors
    /// Fewer than `k` columns; singular values that do not converge; settings of the method out of range.
    pub fn solve(&self, k: usize, method: Method) -> Result<(Solution, ThinSvd), ModelError> {
        if k > self.columns() {
            return Err(ModelError::Shape {
                name: "triangle",
                unit: "columns",
                found: self.columns(),
                expected: k,
            });
        }
        let outputs = self.r.ncols() - k;
        let factors = ThinSvd::of_triangle(self.r.submatrix(0, 0, k, k), self.rows)?;
        let sides = row_major(self.r.submatrix(0, k, k, outputs));
        Ok((solve(&factors, &sides, outputs, method)?, factors))
    }

    /// Σ (y − X β)² of each output, coefficients (k, outputs) row-major.
    ///
    /// # Panics
    /// Where it has fewer than `k` columns, or there are fewer coefficients.
    pub fn residual_squares(&self, k: usize, coefficients: &[f64]) -> Vec<f64> {
        let outputs = self.r.ncols() - k;
        (0..outputs)
            .map(|output| {
                let fitted = |i: usize| -> f64 {
                    (i..k)
                        .map(|j| self.r[(i, j)] * coefficients[j * outputs + output])
                        .sum()
                };
                let column = self.r.col(k + output);
                (0..column.nrows())
                    .map(|i| (column[i] - fitted(i)).powi(2))
                    .sum()
            })
            .collect()
    }
}

fn row_major(matrix: MatRef<'_, f64>) -> Vec<f64> {
    (0..matrix.nrows())
        .flat_map(|i| (0..matrix.ncols()).map(move |j| (i, j)))
        .map(|place| matrix[place])
        .collect()
}
