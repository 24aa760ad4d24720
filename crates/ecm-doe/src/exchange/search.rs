//! Iterated local search: disturb a few rows of a good design, repair it, keep the better one.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::{State, fedorov, rowwise};
use crate::Control;

/// Work done by a search.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Effort {
    /// Number of swaps.
    pub swaps: usize,
    /// Number of disturbances.
    pub steps: usize,
}

/// Up to `steps` disturbances of `best`, each repaired by an exchange.
///
/// `work` is scratch of the same pool and design size. Stops early on cancellation or at the time limit.
pub(crate) fn iterate<S: State>(
    best: &mut S,
    work: &mut S,
    candidates: usize,
    rng: &mut ChaCha8Rng,
    steps: usize,
    control: &Control<'_>,
) -> Effort {
    let rows = best.design().len();
    let mut effort = Effort::default();
    if rows == 0 || candidates == 0 {
        return effort;
    }
    for _ in 0..steps {
        if control.stop() {
            break;
        }
        work.copy_from(best);
        let kicks = rng.random_range(2..=8usize).min(rows);
        for _ in 0..kicks {
            let row = rng.random_range(0..rows);
            let candidate = rng.random_range(0..candidates);
            if work.is_free(candidate) && work.gain(row, candidate) > -3.0 {
                effort.swaps += usize::from(work.swap(row, candidate));
            }
        }
        let limit = 10 * rows + 100;
        effort.swaps += if S::SCANS_ARE_CHEAP {
            fedorov::descend(work, limit, control).0
        } else {
            rowwise::descend(work, rng, limit, control).0
        };
        effort.steps += 1;
        if work.merit() > best.merit() + 1e-11 {
            best.copy_from(work);
        }
    }
    effort
}
