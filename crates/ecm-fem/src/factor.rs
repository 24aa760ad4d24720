//! Supernodal L D Lᵀ of the tangent: faer, without pivoting, always sequential.
//!
//! Sequential, because faer's parallel kernels change the last bits with the number
//! of threads; parallelism runs over load cases. The matrix is quasi-definite
//! (displacements positive, pressures negative), so the factors exist in every
//! order, and a wrong number of negative pivots shows an instability at fixed platform.

use crate::FemError;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::triangular_solve::{
    solve_unit_lower_triangular_in_place, solve_unit_upper_triangular_in_place,
};
use faer::mat::{MatMut, MatRef};
use faer::prelude::{Reborrow, ReborrowMut};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::supernodal::SupernodalLdltRef;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholesky, SymbolicCholeskyRaw, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use faer::{Accum, Par, Side};

/// Sparsity of the lower triangle and its symbolic factorisation.
#[derive(Debug)]
pub struct Symbolic {
    unknowns: usize,
    col_ptr: Vec<usize>,
    row_idx: Vec<usize>,
    analysis: SymbolicCholesky<usize>,
}

/// Values of one factorisation and its working memory; reused without allocation.
pub struct Factor {
    values: Vec<f64>,
    memory: MemBuffer,
    gather: Vec<f64>,
}

/// A pivot was zero or not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ZeroPivot;

impl Symbolic {
    /// Analyses the lower triangle (columns sorted, already in elimination order).
    ///
    /// # Errors
    /// Out of memory.
    pub fn new(
        unknowns: usize,
        col_ptr: Vec<usize>,
        row_idx: Vec<usize>,
    ) -> Result<Self, FemError> {
        // Without reordering faer analyses the upper triangle.
        let (upper_ptr, upper_idx) = transposed(unknowns, &col_ptr, &row_idx);
        let pattern =
            SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &upper_ptr, None, &upper_idx);
        let analysis = factorize_symbolic_cholesky(
            pattern,
            Side::Upper,
            SymmetricOrdering::Identity,
            CholeskySymbolicParams {
                supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
                ..Default::default()
            },
        )
        .map_err(|e| FemError::Factorisation {
            unknowns,
            reason: e.to_string(),
        })?;
        Ok(Self {
            unknowns,
            col_ptr,
            row_idx,
            analysis,
        })
    }

    /// Stored entries of the lower triangle.
    pub fn entries(&self) -> usize {
        self.row_idx.len()
    }

    /// Row and column of each stored entry.
    pub fn positions(&self) -> impl Iterator<Item = (usize, usize)> + '_ {
        (0..self.unknowns).flat_map(|c| {
            self.row_idx[self.col_ptr[c]..self.col_ptr[c + 1]]
                .iter()
                .map(move |&r| (r, c))
        })
    }

    /// Stored entries of L, zeros of the supernodes included.
    pub fn factor_entries(&self) -> usize {
        self.analysis.len_val()
    }
}

fn transposed(n: usize, col_ptr: &[usize], row_idx: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let mut starts = vec![0; n + 1];
    row_idx.iter().for_each(|&r| starts[r + 1] += 1);
    for i in 0..n {
        starts[i + 1] += starts[i];
    }
    let mut next = starts.clone();
    let mut indices = vec![0; row_idx.len()];
    for column in 0..n {
        for &row in &row_idx[col_ptr[column]..col_ptr[column + 1]] {
            indices[next[row]] = column;
            next[row] += 1;
        }
    }
    (starts, indices)
}

impl std::fmt::Debug for Factor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Factor")
            .field("entries", &self.values.len())
            .finish_non_exhaustive()
    }
}

impl Factor {
    /// Memory for factorisations of `symbolic`.
    pub fn new(symbolic: &Symbolic) -> Self {
        let request = symbolic
            .analysis
            .factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
        Self {
            values: vec![0.0; symbolic.analysis.len_val()],
            memory: MemBuffer::new(request),
            gather: vec![0.0; 7 * symbolic.unknowns],
        }
    }

    /// Factorises the matrix with the given values of the lower triangle; returns
    /// the number of negative pivots.
    ///
    /// # Errors
    /// [`ZeroPivot`].
    pub fn factorise(&mut self, symbolic: &Symbolic, values: &[f64]) -> Result<usize, ZeroPivot> {
        let n = symbolic.unknowns;
        let pattern =
            SymbolicSparseColMatRef::new_checked(n, n, &symbolic.col_ptr, None, &symbolic.row_idx);
        symbolic
            .analysis
            .factorize_numeric_ldlt(
                &mut self.values,
                SparseColMatRef::new(pattern, values),
                Side::Lower,
                Default::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Default::default(),
            )
            .map_err(|_| ZeroPivot)?;
        let mut negative = 0;
        let mut finite = true;
        self.each_supernode(symbolic, |_, _, l| {
            for j in 0..l.ncols() {
                negative += usize::from(l[(j, j)] < 0.0);
                finite &= l[(j, j)].is_finite() && l[(j, j)] != 0.0;
            }
        });
        if finite { Ok(negative) } else { Err(ZeroPivot) }
    }

    fn each_supernode(
        &self,
        symbolic: &Symbolic,
        mut visit: impl FnMut(usize, &[usize], MatRef<f64>),
    ) {
        // Always supernodal: `Symbolic::new` forces it.
        if let SymbolicCholeskyRaw::Supernodal(raw) = symbolic.analysis.raw() {
            let factor = SupernodalLdltRef::new(raw, &self.values);
            for s in 0..raw.n_supernodes() {
                let node = factor.supernode(s);
                visit(node.start(), node.pattern(), node.val());
            }
        }
    }

    /// x ← L⁻¹ x for the columns of x (at most seven).
    pub fn forward(&mut self, symbolic: &Symbolic, mut x: MatMut<f64>) {
        let columns = x.ncols();
        let SymbolicCholeskyRaw::Supernodal(raw) = symbolic.analysis.raw() else {
            return;
        };
        let factor = SupernodalLdltRef::new(raw, &self.values);
        for s in 0..raw.n_supernodes() {
            let node = factor.supernode(s);
            let (top, bottom) = node.val().split_at_row(node.val().ncols());
            let size = top.ncols();
            solve_unit_lower_triangular_in_place(
                top,
                x.rb_mut().subrows_mut(node.start(), size),
                Par::Seq,
            );
            let rows = node.pattern().len();
            let mut below = MatMut::from_column_major_slice_mut(
                &mut self.gather[..rows * columns],
                rows,
                columns,
            );
            faer::linalg::matmul::matmul(
                below.rb_mut(),
                Accum::Replace,
                bottom,
                x.rb().subrows(node.start(), size),
                1.0,
                Par::Seq,
            );
            for j in 0..columns {
                for (k, &row) in node.pattern().iter().enumerate() {
                    x[(row, j)] -= below[(k, j)];
                }
            }
        }
    }

    /// D, the pivots.
    pub fn pivots(&self, symbolic: &Symbolic, pivots: &mut [f64]) {
        self.each_supernode(symbolic, |start, _, l| {
            for j in 0..l.ncols() {
                pivots[start + j] = l[(j, j)];
            }
        });
    }

    /// x ← L⁻ᵀ x for the columns of x (at most seven).
    pub fn backward(&mut self, symbolic: &Symbolic, mut x: MatMut<f64>) {
        let columns = x.ncols();
        let SymbolicCholeskyRaw::Supernodal(raw) = symbolic.analysis.raw() else {
            return;
        };
        let factor = SupernodalLdltRef::new(raw, &self.values);
        for s in (0..raw.n_supernodes()).rev() {
            let node = factor.supernode(s);
            let (top, bottom) = node.val().split_at_row(node.val().ncols());
            let size = top.ncols();
            let rows = node.pattern().len();
            let mut below = MatMut::from_column_major_slice_mut(
                &mut self.gather[..rows * columns],
                rows,
                columns,
            );
            for j in 0..columns {
                for (k, &row) in node.pattern().iter().enumerate() {
                    below[(k, j)] = x[(row, j)];
                }
            }
            let mut own = x.rb_mut().subrows_mut(node.start(), size);
            faer::linalg::matmul::matmul(
                own.rb_mut(),
                Accum::Add,
                bottom.transpose(),
                below.rb(),
                -1.0,
                Par::Seq,
            );
            solve_unit_upper_triangular_in_place(top.transpose(), own, Par::Seq);
        }
    }
}
