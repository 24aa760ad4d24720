//! The row-wise exchange: each design row in turn takes the candidate that is best for it.

use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::{LEAST_GAIN, State};
use crate::Control;

/// Swaps carried out and whether a whole sweep found nothing to improve within `limit` swaps.
///
/// The rows are visited in an order drawn anew for every sweep.
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
