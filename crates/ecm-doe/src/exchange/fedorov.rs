//! Fedorov's exchange (the paper's): make the best of all swaps until none improves the design.

use super::{LEAST_GAIN, State};
use crate::Control;

/// Number of swaps, and whether a local optimum was reached within `limit` swaps.
pub(crate) fn descend<S: State>(
    state: &mut S,
    limit: usize,
    control: &Control<'_>,
) -> (usize, bool) {
    let mut swaps = 0;
    while swaps < limit && !control.stop() {
        let Some(swap) = state.best_pair() else {
            return (swaps, true);
        };
        if state.gain(swap.row, swap.candidate) <= LEAST_GAIN
            || !state.swap(swap.row, swap.candidate)
        {
            return (swaps, true);
        }
        swaps += 1;
    }
    (swaps, false)
}
