//! Cost of a fill-reducing order: nested dissection compared with approximate minimum degree.

use crate::assembly::Sums;
use crate::{Fem, FemError};
use faer::Par;
use faer::Side;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::sparse::linalg::SupernodalThreshold;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, SymbolicCholeskyRaw, SymmetricOrdering, factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMatRef};
use std::time::Instant;

/// Elimination order of the unknowns.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Ordering {
    /// Geometric nested dissection, the order of every solve.
    NestedDissection,
    /// Approximate minimum degree, faer's default (Amestoy, Davis and Duff 1996).
    MinimumDegree,
}

/// Cost of one numeric factorisation of the tangent at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OrderingCost {
    /// Stored entries of L.
    pub entries: usize,
    /// Multiplications, Σ over columns of (entries below the diagonal)².
    pub multiplications: f64,
    /// Best of three, s.
    pub seconds: f64,
}

impl Fem {
    /// Factorises the tangent at rest in the given order.
    ///
    /// # Errors
    /// Out of memory, or a zero pivot.
    pub fn ordering_cost(&self, ordering: Ordering) -> Result<OrderingCost, FemError> {
        let (body, pattern) = (self.body(), self.pattern());
        let unknowns = pattern.unknowns;
        let fail = |reason: String| FemError::Factorisation { unknowns, reason };
        let mut sums = Sums::new(body, pattern);
        sums.assemble(body, pattern, &self.rest())
            .map_err(|_| fail("an element is inverted at rest".into()))?;
        // Upper triangle by columns: without reordering faer reads only this triangle.
        let mut columns: Vec<Vec<(usize, f64)>> = vec![Vec::new(); unknowns];
        for ((row, column), &value) in pattern.symbolic.positions().zip(&sums.tangent) {
            columns[row].push((column, value));
        }
        let mut starts = vec![0];
        let (mut rows, mut values) = (Vec::new(), Vec::new());
        for column in &columns {
            rows.extend(column.iter().map(|e| e.0));
            values.extend(column.iter().map(|e| e.1));
            starts.push(rows.len());
        }
        let matrix = SymbolicSparseColMatRef::new_checked(unknowns, unknowns, &starts, None, &rows);
        let order = match ordering {
            Ordering::NestedDissection => SymmetricOrdering::Identity,
            Ordering::MinimumDegree => SymmetricOrdering::Amd,
        };
        let params = CholeskySymbolicParams {
            supernodal_flop_ratio_threshold: SupernodalThreshold::FORCE_SUPERNODAL,
            ..Default::default()
        };
        let analysis = factorize_symbolic_cholesky(matrix, Side::Upper, order, params)
            .map_err(|e| fail(e.to_string()))?;
        let mut multiplications = 0.0;
        if let SymbolicCholeskyRaw::Supernodal(raw) = analysis.raw() {
            for s in 0..raw.n_supernodes() {
                let width = raw.supernode_end()[s] - raw.supernode_begin()[s];
                let below = raw.supernode(s).pattern().len();
                multiplications += (0..width)
                    .map(|j| ((below + width - 1 - j) as f64).powi(2))
                    .sum::<f64>();
            }
        }
        let request = analysis.factorize_numeric_ldlt_scratch::<f64>(Par::Seq, Default::default());
        let mut memory = MemBuffer::new(request);
        let mut factor = vec![0.0; analysis.len_val()];
        let mut seconds = f64::INFINITY;
        for _ in 0..3 {
            let start = Instant::now();
            analysis
                .factorize_numeric_ldlt(
                    &mut factor,
                    SparseColMatRef::new(matrix, &values),
                    Side::Upper,
                    Default::default(),
                    Par::Seq,
                    MemStack::new(&mut memory),
                    Default::default(),
                )
                .map_err(|e| fail(format!("{e:?}")))?;
            seconds = seconds.min(start.elapsed().as_secs_f64());
        }
        Ok(OrderingCost {
            entries: analysis.len_val(),
            multiplications,
            seconds,
        })
    }
}
