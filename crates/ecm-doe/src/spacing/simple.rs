//! The paper's exchange: replace a point of the closest pair while the smallest distance grows.

use rand::seq::SliceRandom;
use rand_chacha::ChaCha8Rng;

use super::neighbours::squared;
use crate::Control;

/// A random design improved by simple exchanges; (design, squared smallest distance, swaps).
///
/// `fixed` points (first in the design) stay. A swap is carried out when it raises the smallest
/// distance of the replaced point above the design's, so the closest pairs vanish one by one.
pub(crate) fn exchange(
    points: &[f64],
    columns: usize,
    n: usize,
    fixed: &[usize],
    allowed: &[bool],
    rng: &mut ChaCha8Rng,
    control: &Control<'_>,
) -> (Vec<usize>, f64, usize) {
    let at = |i: usize| &points[i * columns..(i + 1) * columns];
    let mut pool: Vec<usize> = (0..allowed.len()).filter(|&i| allowed[i]).collect();
    pool.shuffle(rng);
    let mut design: Vec<usize> = fixed.to_vec();
    design.extend(pool.iter().copied().take(n - fixed.len()));
    let mut inside = vec![false; allowed.len()];
    for &i in &design {
        inside[i] = true;
    }
    let mut swaps = 0;
    loop {
        let (least, a, b) = closest(&design, &at);
        if control.stop() || design.len() < 2 {
            return (design, least, swaps);
        }
        let mut best: Option<(f64, usize, usize)> = None;
        for row in [a, b] {
            if row < fixed.len() {
                continue;
            }
            for &candidate in &pool {
                if inside[candidate] {
                    continue;
                }
                let floor = best.map_or(least, |(d, _, _)| d);
                let mut nearest = f64::INFINITY;
                for (other, &i) in design.iter().enumerate() {
                    if other != row {
                        nearest = nearest.min(squared(at(candidate), at(i)));
                        if nearest <= floor {
                            break;
                        }
                    }
                }
                if nearest > floor {
                    best = Some((nearest, row, candidate));
                }
            }
        }
        let Some((_, row, candidate)) = best else {
            return (design, least, swaps);
        };
        inside[design[row]] = false;
        inside[candidate] = true;
        design[row] = candidate;
        swaps += 1;
    }
}

fn closest<'a>(design: &[usize], at: &impl Fn(usize) -> &'a [f64]) -> (f64, usize, usize) {
    let mut best = (f64::INFINITY, 0, 0);
    for a in 1..design.len() {
        for b in 0..a {
            let d = squared(at(design[a]), at(design[b]));
            if d < best.0 {
                best = (d, a, b);
            }
        }
    }
    best
}
