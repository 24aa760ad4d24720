//! Initial designs.

use rand::RngExt;
use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::pool::Pool;
use crate::linalg::dot;

/// `n` pool positions at random, distinct unless replicates are allowed and needed.
pub(crate) fn random_design(pool: &Pool<'_>, n: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let mut order: Vec<usize> = (0..pool.len()).collect();
    order.shuffle(rng);
    let mut design: Vec<usize> = order.iter().copied().take(n).collect();
    while design.len() < n {
        design.push(rng.random_range(0..pool.len()));
    }
    design
}

/// `n` pool positions with probabilities `weights` (per pool position, summing to n).
///
/// Systematic sampling over a random order: a pose of weight w is chosen floor(w) or ceil(w) times.
pub(crate) fn rounded_design(
    pool: &Pool<'_>,
    weights: &[f64],
    n: usize,
    rng: &mut ChaCha8Rng,
) -> Vec<usize> {
    let mut order: Vec<usize> = (0..pool.len()).collect();
    order.shuffle(rng);
    let total: f64 = weights.iter().sum();
    let mut next: f64 = rng.random_range(0.0..1.0);
    let mut sum = 0.0;
    let mut design = Vec::with_capacity(n);
    for &c in &order {
        sum += weights[c] * n as f64 / total;
        while next < sum && design.len() < n {
            if pool.replicates || design.last() != Some(&c) {
                design.push(c);
            }
            next += 1.0;
        }
    }
    // Rounding of the sum, or a weight above one where repeats are not allowed.
    let mut inside = vec![false; pool.len()];
    for &c in &design {
        inside[c] = true;
    }
    for &c in &order {
        if design.len() >= n {
            break;
        }
        if !inside[c] {
            design.push(c);
        }
    }
    while design.len() < n {
        design.push(rng.random_range(0..pool.len()));
    }
    design
}

/// `n` pool positions of which the first ones span the model, the others at random.
///
/// Gram-Schmidt with the largest remaining row each time, from a random first pose: gives a
/// regular design where random designs are singular (grids, many equal poses).
pub(crate) fn spanning_design(pool: &Pool<'_>, n: usize, rng: &mut ChaCha8Rng) -> Vec<usize> {
    let (b, k, count) = (pool.problem.block, pool.problem.terms, pool.len());
    if count == 0 {
        return Vec::new();
    }
    let mut rest = pool.rows.clone();
    let mut chosen = vec![false; count];
    let mut design = Vec::with_capacity(n);
    let mut rank = 0;
    let mut pick = rng.random_range(0..count);
    while design.len() < n && rank < k {
        chosen[pick] = true;
        design.push(pick);
        for r in 0..b {
            let at = (pick * b + r) * k;
            let axis: Vec<f64> = rest[at..at + k].to_vec();
            let length = dot(&axis, &axis);
            if length < 1e-18 {
                continue;
            }
            rank += 1;
            for row in rest.chunks_exact_mut(k) {
                let share = dot(row, &axis) / length;
                for (v, a) in row.iter_mut().zip(&axis) {
                    *v -= share * a;
                }
            }
        }
        let size = |c: usize| {
            dot(
                &rest[c * b * k..(c + 1) * b * k],
                &rest[c * b * k..(c + 1) * b * k],
            )
        };
        let next = (0..count)
            .filter(|&c| !chosen[c])
            .max_by(|&x, &y| size(x).total_cmp(&size(y)));
        let Some(next) = next else { break };
        pick = next;
    }
    for c in random_design(pool, count, rng) {
        if design.len() >= n {
            break;
        }
        if !chosen[c] {
            design.push(c);
        }
    }
    while design.len() < n {
        design.push(rng.random_range(0..count));
    }
    design
}
