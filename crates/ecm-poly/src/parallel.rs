//! Rows shared out among the cores, with the same bytes on any number of them.

use std::vec::Vec;

use rayon::prelude::*;

/// Rows of one piece of work: some 0.1 ms, a hundred times what it costs to hand it to a thread.
const CHUNK: usize = 512;

/// One result for each of `rows`, from a function of a piece of the rows and of its results.
///
/// The cut does not depend on the number of threads, and no row on another.
pub(crate) fn fill<P, T, F>(rows: &[P], zero: T, of_piece: F) -> Vec<T>
where
    P: Sync,
    T: Copy + Send,
    F: Fn(&[P], &mut [T]) + Sync,
{
    let mut results = std::vec![zero; rows.len()];
    if rows.len() <= CHUNK {
        of_piece(rows, &mut results);
    } else {
        let pieces = results.par_chunks_mut(CHUNK).zip(rows.par_chunks(CHUNK));
        pieces.for_each(|(results, rows)| of_piece(rows, results));
    }
    results
}
