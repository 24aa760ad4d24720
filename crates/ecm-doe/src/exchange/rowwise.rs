//! The row-wise exchange: each design row in turn is exchanged for its best candidate.

use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::{LEAST_GAIN, State};
use crate::Control;

/// Number of swaps, and whether a full sweep brought no improvement within `limit` swaps.
///
/// Every sweep visits the rows in a new random order.
pub(crate) fn descend<S: State>(
    state: &mut S,
    rng: &mut ChaCha8Rng,
    limit: usize,
    control: &Control<'_>,
) -> (usize, bool) {
    let mut order: Vec<usize> = (0..state.design().len()).collect();
    let mut swaps = 0;
    loop {
        order.shuffle(rng);
        let before = swaps;
        for &row in &order {
            if swaps >= limit || control.stop() {
                return (swaps, false);
            }
            let Some(swap) = state.best_for_row(row) else {
                continue;
            };
            if state.gain(row, swap.candidate) > LEAST_GAIN && state.swap(row, swap.candidate) {
                swaps += 1;
            }
        }
        if swaps == before {
            return (swaps, true);
        }
    }
}
