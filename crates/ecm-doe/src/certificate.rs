//! What is possible: the continuous optimum and the certified bound of every design.
//!
//! A continuous design gives every pose a weight 0 <= w_i <= cap with sum w_i = n; exact
//! designs are the whole-numbered ones (cap 1: each pose at most once; no cap: repeats).
//! log det is concave, so with phi_i = tr(A_i M^-1 A_i') any feasible M* obeys
//!
//! log det M* <= log det M + k log(S / k),   S = tr(M^-1 F) + max_w sum w_i phi_i,
//!
//! the Kiefer-Wolfowitz inequality; the maximum fills the largest phi up to the cap. It
//! holds for every M, so the bound is certified however far the optimisation came.

use crate::budget::Control;
use crate::linalg::{cholesky, dot, log_det, lower_inverse, product_transposed};
use crate::problem::Problem;

/// The continuous optimum: weights, log det M and how far it can be from the best.
#[derive(Debug, Clone)]
pub struct Continuous {
    /// w_i, summing to n.
    pub weights: Vec<f64>,
    /// phi_i = tr(A_i M^-1 A_i') at the optimum.
    pub phi: Vec<f64>,
    /// log det M(w) in whitened coordinates.
    pub log_det: f64,
    /// log det M* of any feasible design is at most this (whitened coordinates).
    pub bound: f64,
    /// k log(S/k), the Kiefer-Wolfowitz gap left.
    pub gap: f64,
    /// Newton steps taken.
    pub iterations: usize,
}

/// Settings of [`continuous`].
#[derive(Debug, Clone, Copy)]
pub struct CertificateSettings {
    /// Stops when the gap per coefficient is below this.
    pub tolerance: f64,
    /// Newton steps at most.
    pub iterations: usize,
}

impl Default for CertificateSettings {
    fn default() -> Self {
        Self {
            tolerance: 1e-9,
            iterations: 60,
        }
    }
}

/// phi of every pose and log det M at the weights `w`; `None` when M is singular.
struct Evaluation {
    log_det: f64,
    inv_lower: Vec<f64>,
    phi: Vec<f64>,
    /// tr(M^-1 F)
    fixed_trace: f64,
}

fn weighted_information(problem: &Problem, w: &[f64]) -> Vec<f64> {
    const CHUNK: usize = 2048;
    let (b, k) = (problem.block, problem.terms);
    let mut m = problem.fixed.clone();
    let support: Vec<usize> = (0..problem.poses).filter(|&i| w[i] > 0.0).collect();
    let mut left = Vec::new();
    for part in support.chunks(CHUNK) {
        left.clear();
        for &i in part {
            let root = w[i].sqrt();
            left.extend(problem.pose(i).iter().map(|v| v * root));
        }
        crate::linalg::add_transposed_product(&mut m, (k, part.len() * b, k), &left, &left);
    }
    m
}

fn information_log_det(problem: &Problem, w: &[f64]) -> Option<f64> {
    let mut m = weighted_information(problem, w);
    cholesky(&mut m, problem.terms, 1e-14).ok()?;
    Some(log_det(&m, problem.terms))
}

fn evaluate(problem: &Problem, w: &[f64]) -> Option<Evaluation> {
    const CHUNK: usize = 4096;
    let (b, k) = (problem.block, problem.terms);
    let mut l = weighted_information(problem, w);
    cholesky(&mut l, k, 1e-14).ok()?;
    let log_det = log_det(&l, k);
    let inv_lower = lower_inverse(&l, k);
    let mut phi = vec![0.0; problem.poses];
    let mut t = vec![0.0; CHUNK.min(problem.poses) * b * k];
    for start in (0..problem.poses).step_by(CHUNK) {
        let count = CHUNK.min(problem.poses - start);
        let rows = &problem.rows[start * b * k..(start + count) * b * k];
        let t = &mut t[..count * b * k];
        product_transposed(t, (count * b, k, k), rows, &inv_lower);
        for (value, block) in phi[start..start + count]
            .iter_mut()
            .zip(t.chunks_exact(b * k))
        {
            *value = dot(block, block);
        }
    }
    let fixed_trace = if problem.fixed.iter().all(|v| *v == 0.0) {
        0.0
    } else {
        let mut half = vec![0.0; k * k];
        crate::linalg::product(&mut half, (k, k, k), &inv_lower, &problem.fixed, 1.0, false);
        dot(&half, &inv_lower)
    };
    Some(Evaluation {
        log_det,
        inv_lower,
        phi,
        fixed_trace,
    })
}

/// max over feasible w of sum w_i phi_i, and the phi at which the filling stops.
fn best_filling(phi: &[f64], available: &[bool], n: f64, cap: f64) -> (f64, f64) {
    let mut sorted: Vec<f64> = phi
        .iter()
        .zip(available)
        .filter(|(_, a)| **a)
        .map(|(p, _)| *p)
        .collect();
    sorted.sort_unstable_by(|a, b| b.total_cmp(a));
    let (mut left, mut sum, mut level) = (n, 0.0, sorted.first().copied().unwrap_or(0.0));
    for p in sorted {
        if left <= 0.0 {
            break;
        }
        let take = left.min(cap);
        sum += take * p;
        left -= take;
        level = p;
    }
    (sum, level)
}

/// The Kiefer-Wolfowitz gap at `eval`, and the phi at which the filling stops.
fn bound_at(problem: &Problem, eval: &Evaluation, n: f64, cap: f64) -> (f64, f64) {
    let k = problem.terms as f64;
    let (sum, level) = best_filling(&eval.phi, &problem.available, n, cap);
    let gap = (k * ((sum + eval.fixed_trace) / k).ln()).max(0.0);
    (gap, level)
}

/// Weights with which the multiplicative step w <- min(cap, c w phi) sums to n.
fn multiplicative_step(w: &mut [f64], phi: &[f64], n: f64, cap: f64) {
    let raw: Vec<f64> = w.iter().zip(phi).map(|(w, p)| w * p).collect();
    let (mut low, mut high) = (0.0, 1.0);
    let total = |c: f64| raw.iter().map(|r| (c * r).min(cap)).sum::<f64>();
    for _ in 0..200 {
        if total(high) >= n {
            break;
        }
        low = high;
        high *= 2.0;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if total(middle) < n {
            low = middle
        } else {
            high = middle
        }
    }
    for (w, r) in w.iter_mut().zip(&raw) {
        *w = (high * r).min(cap);
    }
}

/// The continuous optimum for `n` poses with weights at most `cap` (infinite: repeats).
///
/// A few multiplicative steps find the region, then Newton steps on the poses that matter
/// (a quadratic programme solved by pairwise moves), each checked against all candidates.
///
/// # Returns
/// `None` when even the uniform weights leave M singular.
pub fn continuous(
    problem: &Problem,
    n: usize,
    cap: f64,
    settings: &CertificateSettings,
    control: &Control<'_>,
) -> Option<Continuous> {
    let k = problem.terms as f64;
    let n_f = n as f64;
    let count = problem.available.iter().filter(|a| **a).count();
    if n == 0 || count == 0 {
        let eval = evaluate(problem, &vec![0.0; problem.poses])?;
        let weights = vec![0.0; problem.poses];
        let (log_det, phi) = (eval.log_det, eval.phi);
        return Some(Continuous {
            weights,
            phi,
            log_det,
            bound: log_det,
            gap: 0.0,
            iterations: 0,
        });
    }
    let share = n_f / count as f64;
    let mut w: Vec<f64> = problem
        .available
        .iter()
        .map(|a| if *a { share.min(cap) } else { 0.0 })
        .collect();
    let mut eval = evaluate(problem, &w)?;
    for _ in 0..4 {
        multiplicative_step(&mut w, &eval.phi, n_f, cap);
        eval = evaluate(problem, &w)?;
    }
    let wanted = 2 * (n.min(4 * problem.terms) + problem.terms);
    if count > wanted {
        (w, eval) = keep_best(problem, w, eval, wanted, n_f, cap)?;
    }
    let (mut gap, mut level) = bound_at(problem, &eval, n_f, cap);
    let mut bound = eval.log_det + gap;
    let mut iterations = 0;
    while iterations < settings.iterations && gap > settings.tolerance * k && !control.stop() {
        let set = working_set(problem, &w, &eval.phi, level, wanted);
        let step = newton_step(problem, &set, &w, &eval, cap, 0.05 * gap);
        let before = (gap, eval.log_det);
        let mut size = 1.0;
        let mut moved = false;
        for _ in 0..30 {
            let mut trial = w.clone();
            for (&i, s) in set.iter().zip(&step) {
                trial[i] = (w[i] + size * s).clamp(0.0, cap);
                if trial[i] < 1e-12 {
                    trial[i] = 0.0;
                }
            }
            if information_log_det(problem, &trial).is_some_and(|v| v > eval.log_det) {
                w = trial;
                moved = true;
                break;
            }
            size *= 0.5;
        }
        if !moved {
            break;
        }
        restore_sum(&mut w, n_f, cap);
        eval = evaluate(problem, &w)?;
        (gap, level) = bound_at(problem, &eval, n_f, cap);
        bound = bound.min(eval.log_det + gap);
        iterations += 1;
        if (before.0 - gap).abs() < 1e-15 && eval.log_det <= before.1 {
            break;
        }
    }
    Some(Continuous {
        log_det: eval.log_det,
        phi: eval.phi,
        weights: w,
        bound,
        gap,
        iterations,
    })
}

/// Keeps the weights of the `wanted` poses with the largest phi and spreads the rest on them.
fn keep_best(
    problem: &Problem,
    w: Vec<f64>,
    eval: Evaluation,
    wanted: usize,
    n: f64,
    cap: f64,
) -> Option<(Vec<f64>, Evaluation)> {
    let mut order: Vec<usize> = (0..problem.poses)
        .filter(|&i| problem.available[i])
        .collect();
    order.sort_unstable_by(|&a, &b| eval.phi[b].total_cmp(&eval.phi[a]).then(a.cmp(&b)));
    let mut kept = vec![0.0; problem.poses];
    for &i in &order[..wanted] {
        kept[i] = w[i];
    }
    multiplicative_step(&mut kept, &vec![1.0; problem.poses], n, cap);
    match evaluate(problem, &kept) {
        Some(found) => Some((kept, found)),
        // The best ones alone do not span the model: go on with all of them.
        None => Some((w, eval)),
    }
}

/// Poses with weight and those whose phi says that they want some.
fn working_set(problem: &Problem, w: &[f64], phi: &[f64], level: f64, limit: usize) -> Vec<usize> {
    let mut wishes: Vec<usize> = (0..problem.poses)
        .filter(|&i| problem.available[i] && w[i] == 0.0 && phi[i] > 0.98 * level)
        .collect();
    wishes.sort_unstable_by(|&a, &b| phi[b].total_cmp(&phi[a]).then(a.cmp(&b)));
    wishes.truncate((limit / 2).max(64));
    let mut set: Vec<usize> = (0..problem.poses).filter(|&i| w[i] > 0.0).collect();
    set.extend(wishes);
    set.sort_unstable();
    set
}

/// Maximises g's - s'Hs/2 over the box and the sum by moving weight between two poses at a time.
fn newton_step(
    problem: &Problem,
    set: &[usize],
    w: &[f64],
    eval: &Evaluation,
    cap: f64,
    accuracy: f64,
) -> Vec<f64> {
    let (b, k, s) = (problem.block, problem.terms, set.len());
    let rows: Vec<f64> = set
        .iter()
        .flat_map(|&i| problem.pose(i).iter().copied())
        .collect();
    let mut t = vec![0.0; rows.len()];
    product_transposed(&mut t, (s * b, k, k), &rows, &eval.inv_lower);
    let hessian = squared_blocks(&t, s, b, k);
    let mut step = vec![0.0; s];
    let mut gradient: Vec<f64> = set.iter().map(|&i| eval.phi[i]).collect();
    let n: f64 = set.iter().map(|&i| w[i]).sum();
    let tolerance = (accuracy / n).max(1e-13);
    for _ in 0..200 * s {
        let (mut up, mut best) = (usize::MAX, f64::NEG_INFINITY);
        for i in 0..s {
            if gradient[i] > best && w[set[i]] + step[i] < cap {
                (up, best) = (i, gradient[i]);
            }
        }
        if up == usize::MAX {
            break;
        }
        let row = &hessian[up * s..(up + 1) * s];
        let (mut down, mut gain, mut worst) = (usize::MAX, 0.0, f64::INFINITY);
        for j in 0..s {
            if w[set[j]] + step[j] > 0.0 {
                worst = worst.min(gradient[j]);
                let slope = best - gradient[j];
                let curve = (row[up] + hessian[j * s + j] - 2.0 * row[j]).max(1e-12);
                if slope > 0.0 && slope * slope / curve > gain {
                    (down, gain) = (j, slope * slope / curve);
                }
            }
        }
        if down == usize::MAX || best - worst < tolerance {
            break;
        }
        let curve = (row[up] + hessian[down * s + down] - 2.0 * row[down]).max(1e-12);
        let room_up = cap - (w[set[up]] + step[up]);
        let room_down = w[set[down]] + step[down];
        let full = (best - gradient[down]) / curve;
        let amount = full.min(room_up).min(room_down);
        step[up] = if amount == room_up {
            cap - w[set[up]]
        } else {
            step[up] + amount
        };
        step[down] = if amount == room_down {
            -w[set[down]]
        } else {
            step[down] - amount
        };
        let other = &hessian[down * s..(down + 1) * s];
        for ((g, a), c) in gradient.iter_mut().zip(row).zip(other) {
            *g -= amount * (a - c);
        }
    }
    step
}

/// H_ij = |T_i T_j'|_F^2 for s blocks of b rows.
fn squared_blocks(t: &[f64], s: usize, b: usize, k: usize) -> Vec<f64> {
    let mut hessian = vec![0.0; s * s];
    let mut cross = vec![0.0; b * s * b];
    for i in 0..s {
        let own = &t[i * b * k..(i + 1) * b * k];
        product_transposed(&mut cross, (b, k, s * b), own, t);
        for j in 0..s {
            let mut sum = 0.0;
            for r in 0..b {
                let part = &cross[r * s * b + j * b..r * s * b + (j + 1) * b];
                sum += part.iter().map(|v| v * v).sum::<f64>();
            }
            hessian[i * s + j] = sum;
        }
    }
    hessian
}

/// Removes the rounding of sum w = n, keeping the box.
fn restore_sum(w: &mut [f64], n: f64, cap: f64) {
    let excess = w.iter().sum::<f64>() - n;
    let inside: Vec<usize> = (0..w.len())
        .filter(|&i| w[i] > 1e-6 && w[i] < cap - 1e-6)
        .collect();
    if inside.is_empty() {
        return;
    }
    let share = excess / inside.len() as f64;
    for i in inside {
        w[i] = (w[i] - share).clamp(0.0, cap);
    }
}
