//! Upper bound of the smallest distance: a cover by fewer than n sets of small diameter.
//!
//! If the candidates fall into fewer than n sets, each of diameter below t, any n of them
//! have two in one set, so the smallest distance is below t.

use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::neighbours::Neighbours;

/// Squared diameter of a cover by at most `sets` sets that grows greedily in a random order,
/// all diameters below the squared `t`; `None` when more sets are needed or it was stopped.
///
/// # Returns
/// The largest squared diameter that occurs: the bound that this cover proves.
pub(crate) fn greedy_cover(
    near: &Neighbours<'_>,
    allowed: &[bool],
    t: f64,
    sets: usize,
    rng: &mut ChaCha8Rng,
    stop: &dyn Fn() -> bool,
) -> Option<f64> {
    let lengths = near.counts_below(t);
    let mut open = allowed.to_vec();
    // Points with few neighbours first: they are the hardest to cover; ties in random order.
    let mut order: Vec<usize> = (0..near.len()).filter(|&i| open[i]).collect();
    order.shuffle(rng);
    let mut degree: Vec<i32> = (0..near.len())
        .map(|i| {
            let (ids, _) = near.near(i);
            ids[..lengths[i] as usize]
                .iter()
                .filter(|&&j| open[j as usize])
                .count() as i32
        })
        .collect();
    let mut used = 0;
    let mut widest: f64 = 0.0;
    let mut common = vec![0u32; near.len()];
    let mut mark = vec![0u32; near.len()];
    let mut stamp = 0;
    loop {
        let seed = order
            .iter()
            .copied()
            .filter(|&i| open[i])
            .min_by_key(|&i| degree[i]);
        let Some(seed) = seed else {
            return Some(widest);
        };
        used += 1;
        if used > sets || stop() {
            return None;
        }
        // Grow: among the common open neighbours, take the one that keeps most of the others.
        let mut members = vec![seed];
        let (ids, _) = near.near(seed);
        let mut shared: Vec<usize> = ids[..lengths[seed] as usize]
            .iter()
            .map(|&j| j as usize)
            .filter(|&j| open[j])
            .collect();
        while !shared.is_empty() {
            stamp += 1;
            for &i in &shared {
                mark[i] = stamp;
            }
            for &i in &shared {
                let (ids, _) = near.near(i);
                common[i] = ids[..lengths[i] as usize]
                    .iter()
                    .filter(|&&j| mark[j as usize] == stamp)
                    .count() as u32;
            }
            let next = shared
                .iter()
                .copied()
                .max_by(|&a, &b| common[a].cmp(&common[b]).then(degree[b].cmp(&degree[a])));
            let Some(next) = next else { break };
            for &m in &members {
                widest = widest.max(near.distance(m, next));
            }
            members.push(next);
            let (ids, _) = near.near(next);
            stamp += 1;
            for &j in &ids[..lengths[next] as usize] {
                mark[j as usize] = stamp;
            }
            shared.retain(|&i| mark[i] == stamp && i != next);
        }
        for &m in &members {
            open[m] = false;
        }
        for &m in &members {
            let (ids, _) = near.near(m);
            for &j in &ids[..lengths[m] as usize] {
                degree[j as usize] -= 1;
            }
        }
    }
}

/// The smallest squared t for which `tries` greedy covers of at most `sets` sets are found.
///
/// Bisects between `low` (a distance that a design reaches) and `high`; the result is a valid
/// bound, because only covers that exist count.
pub(crate) fn cover_bound(
    near: &Neighbours<'_>,
    allowed: &[bool],
    sets: usize,
    (mut low, high): (f64, f64),
    tries: usize,
    rng: &mut ChaCha8Rng,
    stop: &dyn Fn() -> bool,
) -> f64 {
    let mut proven = high;
    for _ in 0..12 {
        if stop() || proven / low < 1.001 {
            break;
        }
        let middle = (low * proven).sqrt();
        let found = (0..tries).find_map(|_| greedy_cover(near, allowed, middle, sets, rng, stop));
        match found {
            // No two points of one set are farther apart than the widest: n points have two in one.
            Some(widest) => proven = widest.max(low).min(middle),
            None => low = middle,
        }
    }
    proven
}
