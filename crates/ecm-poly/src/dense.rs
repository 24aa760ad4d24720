//! Thin singular value decompositions, by faer.
//!
//! faer is built without its feature `rayon`: it runs sequentially and gives the same bits
//! on any number of threads.

use std::vec::Vec;

use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, Mat, MatRef, Par};

use crate::error::{ModelError, check_count, check_finite};

/// X = U diag(σ) Vᵀ, singular values falling.
#[derive(Clone, Debug)]
pub struct ThinSvd {
    /// (rows, r).
    pub(crate) u: Mat<f64>,
    /// (r).
    pub singular_values: Vec<f64>,
    /// (columns, r).
    pub(crate) v: Mat<f64>,
    /// Rows of the matrix, or of that whose triangle was decomposed.
    rows: usize,
}

impl ThinSvd {
    /// Decomposes a row-major matrix with `columns` columns.
    pub fn new(matrix: &[f64], columns: usize) -> Result<Self, ModelError> {
        Self::of(as_matrix(matrix, columns)?)
    }

    /// Decomposes the triangle of a matrix of `rows` rows.
    pub(crate) fn of_triangle(triangle: MatRef<'_, f64>, rows: usize) -> Result<Self, ModelError> {
        let factors = Self::of(triangle)?;
        Ok(Self { rows, ..factors })
    }

    /// `Ok` where row-major `y` has `outputs` numbers for each row of U.
    pub(crate) fn check_rows(&self, y: &[f64], outputs: usize) -> Result<(), ModelError> {
        let expected = self.u.nrows().saturating_mul(outputs);
        check_count("outputs", "numbers", y.len(), expected)
    }

    fn of(matrix: MatRef<'_, f64>) -> Result<Self, ModelError> {
        let (rows, columns) = (matrix.nrows(), matrix.ncols());
        let failed = |_| ModelError::Decomposition { rows, columns };
        // A tall matrix is first reduced to its triangle: fewer operations, same digits.
        if rows > 2 * columns && columns > 0 {
            let qr = matrix.qr();
            let inner = qr.thin_R().thin_svd().map_err(failed)?;
            return Ok(Self {
                u: qr.compute_thin_Q() * inner.U(),
                singular_values: inner.S().column_vector().iter().copied().collect(),
                v: inner.V().to_owned(),
                rows,
            });
        }
        let svd = matrix.thin_svd().map_err(failed)?;
        Ok(Self {
            u: svd.U().to_owned(),
            singular_values: svd.S().column_vector().iter().copied().collect(),
            v: svd.V().to_owned(),
            rows,
        })
    }

    /// U (rows, r), row-major.
    pub fn left_vectors(&self) -> Vec<f64> {
        row_major(self.u.as_ref())
    }

    /// V (columns, r), row-major.
    pub fn right_vectors(&self) -> Vec<f64> {
        row_major(self.v.as_ref())
    }

    /// Singular values above rounding: σ > σ₁ ε max(rows, columns).
    pub fn numerical_rank(&self) -> usize {
        let largest = self.singular_values.first().copied().unwrap_or(0.0);
        let size = self.rows.max(self.v.nrows()) as f64;
        let floor = largest * f64::EPSILON * size;
        self.singular_values.iter().filter(|&&s| s > floor).count()
    }

    /// σ₁/σ_rank of the first `rank` singular values; infinite where none is above zero.
    pub fn condition_number(&self, rank: usize) -> f64 {
        match (self.singular_values.first(), rank.checked_sub(1)) {
            (Some(&first), Some(last)) => match self.singular_values.get(last) {
                Some(&s) if s > 0.0 => first / s,
                _ => f64::INFINITY,
            },
            _ => f64::INFINITY,
        }
    }

    /// V diag(filter(σ)) Uᵀ Y of row-major `y` (rows, outputs): row-major (columns, outputs).
    ///
    /// # Panics
    /// Where `y` has not `outputs` numbers for each row of U, or `singular_values` is no longer as it was.
    pub fn solve(&self, y: &[f64], outputs: usize, filter: impl Fn(usize, f64) -> f64) -> Vec<f64> {
        let y = MatRef::from_row_major_slice(y, self.u.nrows(), outputs);
        let mut projected = self.u.transpose() * y;
        for (i, &s) in self.singular_values.iter().enumerate() {
            let factor = filter(i, s);
            for j in 0..outputs {
                projected[(i, j)] *= factor;
            }
        }
        let solution = &self.v * projected;
        (0..solution.nrows())
            .flat_map(|i| (0..outputs).map(move |j| (i, j)))
            .map(|place| solution[place])
            .collect()
    }

    /// V diag(filter(σ)) Vᵀ, row-major (columns, columns), exactly symmetric.
    pub fn gram(&self, filter: impl Fn(usize, f64) -> f64) -> Vec<f64> {
        let n = self.v.nrows();
        let factors: Vec<f64> = (self.singular_values.iter().enumerate())
            .map(|(i, &s)| filter(i, s))
            .collect();
        let mut scaled = self.v.clone();
        for (j, factor) in factors.iter().enumerate() {
            scaled.col_mut(j).iter_mut().for_each(|x| *x *= factor);
        }
        // Half of the product is enough: the other half is its mirror image.
        let mut product = Mat::zeros(n, n);
        triangular::matmul(
            &mut product,
            BlockStructure::TriangularLower,
            Accum::Replace,
            &scaled,
            BlockStructure::Rectangular,
            self.v.transpose(),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
        let entry = |i: usize, j: usize| product[(i.max(j), i.min(j))];
        (0..n)
            .flat_map(|i| (0..n).map(move |j| (i, j)))
            .map(|(i, j)| entry(i, j))
            .collect()
    }
}

fn row_major(matrix: MatRef<'_, f64>) -> Vec<f64> {
    let rows = 0..matrix.nrows();
    rows.flat_map(|i| (0..matrix.ncols()).map(move |j| matrix[(i, j)]))
        .collect()
}

/// Singular values alone, falling.
pub fn singular_values(matrix: &[f64], columns: usize) -> Result<Vec<f64>, ModelError> {
    let matrix = as_matrix(matrix, columns)?;
    matrix
        .singular_values()
        .map_err(|_| ModelError::Decomposition {
            rows: matrix.nrows(),
            columns,
        })
}

/// A row-major matrix; refuses another shape, no numbers, and numbers that are not finite.
fn as_matrix(numbers: &[f64], columns: usize) -> Result<MatRef<'_, f64>, ModelError> {
    let rows = numbers.len().checked_div(columns).unwrap_or(0);
    if rows == 0 {
        return Err(ModelError::Setting {
            name: "matrix",
            found: std::format!("{} numbers in {columns} columns", numbers.len()),
            expected: "at least one row and one column",
        });
    }
    check_count("matrix", "numbers", numbers.len(), rows * columns)?;
    check_finite("matrix", numbers, columns)?;
    Ok(MatRef::from_row_major_slice(numbers, rows, columns))
}

/// σ₁/σ_min of a row-major matrix; infinite where a singular value is zero.
pub fn condition_number(matrix: &[f64], columns: usize) -> Result<f64, ModelError> {
    // Powers of large inputs overflow: as far from a usable matrix as a singular one.
    if matrix.iter().any(|x| !x.is_finite()) {
        return Ok(f64::INFINITY);
    }
    let values = singular_values(matrix, columns)?;
    Ok(match (values.first(), values.last()) {
        (Some(&first), Some(&last)) if last > 0.0 => first / last,
        _ => f64::INFINITY,
    })
}
