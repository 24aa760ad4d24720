//! Rows shared out among the cores, with the same bytes on any number of them; one core without std.

use alloc::vec::Vec;

#[cfg(feature = "std")]
use rayon::prelude::*;

/// Most rows of one piece of work: some 0.1 ms, a hundred times what it costs to hand it to a thread.
pub(crate) const PIECE: usize = 512;

/// One result for each of `rows`, from a function of a piece of the rows and of its results.
///
/// The cut does not depend on the number of threads, and no row on another.
pub(crate) fn fill<P, T, F>(rows: &[P], zero: T, of_piece: F) -> Vec<T>
where
    P: Sync,
    T: Copy + Send,
    F: Fn(&[P], &mut [T]) + Sync,
{
    let mut results = alloc::vec![zero; rows.len()];
    #[cfg(feature = "std")]
    if rows.len() > PIECE && rayon::current_num_threads() > 1 {
        let pieces = results.par_chunks_mut(PIECE).zip(rows.par_chunks(PIECE));
        pieces.for_each(|(results, rows)| of_piece(rows, results));
        return results;
    }
    // The same pieces without handing them to another thread.
    let pieces = results.chunks_mut(PIECE).zip(rows.chunks(PIECE));
    pieces.for_each(|(results, rows)| of_piece(rows, results));
    results
}

/// As [`fill`] for row-major rows of `width` numbers and results of `result_width`; the first error.
pub(crate) fn fill_pieces<E, F>(
    rows: &[f64],
    width: usize,
    results: &mut [f64],
    result_width: usize,
    of_piece: F,
) -> Result<(), E>
where
    E: Send,
    F: Fn(&[f64], &mut [f64]) -> Result<(), E> + Sync,
{
    if rows.len() <= PIECE * width {
        return of_piece(rows, results);
    }
    let (rows_of_piece, results_of_piece) = ((PIECE * width).max(1), (PIECE * result_width).max(1));
    #[cfg(feature = "std")]
    return results
        .par_chunks_mut(results_of_piece)
        .zip(rows.par_chunks(rows_of_piece))
        .try_for_each(|(results, rows)| of_piece(rows, results));
    #[cfg(not(feature = "std"))]
    results
        .chunks_mut(results_of_piece)
        .zip(rows.chunks(rows_of_piece))
        .try_for_each(|(results, rows)| of_piece(rows, results))
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn pieces_are_the_same_on_one_thread() {
        let rows = std::vec![1.0; 3 * PIECE + 7];
        let fill_rows = || {
            fill(&rows, 0, |piece, results: &mut [usize]| {
                results.fill(piece.len());
            })
        };
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build();
        let found = one.unwrap().install(fill_rows);
        assert!(found.iter().all(|&length| length <= PIECE));
        let two = rayon::ThreadPoolBuilder::new().num_threads(2).build();
        assert_eq!(found, two.unwrap().install(fill_rows));
    }
}
