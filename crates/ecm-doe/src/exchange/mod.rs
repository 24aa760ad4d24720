//! Exchange algorithms: swap a design row for a candidate while the determinant grows.

mod block;
mod cross;
pub(crate) mod fedorov;
mod information;
mod kernel;
pub(crate) mod pair;
pub(crate) mod pool;
pub(crate) mod rowwise;
pub(crate) mod search;
mod start;
mod trace;

pub(crate) use block::BlockState;
pub(crate) use cross::CrossState;
pub use information::InformationMatrix;
pub(crate) use start::{random_design, rounded_design, spanning_design};
pub(crate) use trace::TraceState;

/// A swap of design row `row` for pool candidate `candidate` and its growth of the merit.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Swap {
    pub row: usize,
    pub candidate: usize,
    pub gain: f64,
}

/// Growth of the merit below which a design counts as a local optimum.
pub(crate) const LEAST_GAIN: f64 = 1e-9;

/// A design on which exchanges are tried; `candidate` counts within the pool.
pub(crate) trait State: Clone {
    /// Candidates of the design rows that may be exchanged.
    fn design(&self) -> &[usize];
    /// The maximised merit: log det M, or -k log tr(M^-1 B); whitened coordinates.
    fn merit(&self) -> f64;
    /// The best candidate for one row; its gain may be approximate.
    fn best_for_row(&mut self, row: usize) -> Option<Swap>;
    /// The exact gain of one swap.
    fn gain(&self, row: usize, candidate: usize) -> f64;
    /// Makes a swap whose exact gain is finite; `false` when it had to be undone.
    fn swap(&mut self, row: usize, candidate: usize) -> bool;
    /// Whether the candidate is not in the design, or may be repeated.
    fn is_free(&self, candidate: usize) -> bool;
    /// Copies `other` into self without allocating.
    fn copy_from(&mut self, other: &Self);
    /// Whether a scan of all rows is cheap compared with a swap.
    const SCANS_ARE_CHEAP: bool;
    /// The best swap over all rows.
    fn best_pair(&mut self) -> Option<Swap> {
        let mut best: Option<Swap> = None;
        for row in 0..self.design().len() {
            if let Some(swap) = self.best_for_row(row)
                && best.is_none_or(|b| swap.gain > b.gain)
            {
                best = Some(swap);
            }
        }
        best
    }
}
