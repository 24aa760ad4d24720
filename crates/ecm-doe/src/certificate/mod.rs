//! The continuous optimum and the certified bound of every design.
//!
//! A continuous design gives every pose a weight 0 <= w_i <= cap with sum w_i = n; exact
//! designs are those with integer weights (cap 1: each pose at most once; no cap: repeats).
//! log det is concave, so with phi_i = tr(A_i M^-1 A_i') any feasible M* obeys
//!
//! log det M* <= log det M + k log(S / k),   S = tr(M^-1 F) + max_w sum w_i phi_i,
//!
//! the Kiefer-Wolfowitz inequality; the maximum fills the largest phi up to the cap. It
//! holds for every M, so the bound is certified however far the optimisation came. For
//! Phi = tr(M^-1 B) (I- and A-optimality) Cauchy-Schwarz gives Phi* >= Phi^2 / S' with
//! psi_i = tr(A_i M^-1 B M^-1 A_i'), so that the merit -k log Phi grows by k log(S / k) at most
//! with phi_i = (k / Phi) psi_i. A merit of both in shares has the phi of both in these shares:
//! by Jensen's inequality the same bound holds.

mod newton;

use crate::DesignError;
use crate::budget::Control;
use crate::linalg::{
    add_transposed_product, cholesky, dot, log_det, lower_inverse, product, product_transposed,
};
use crate::problem::{Objective, Problem};
use newton::newton_step;

/// The continuous optimum: weights, merit and certified bound.
#[derive(Debug, Clone)]
pub struct Continuous {
    /// w_i, summing to n.
    pub weights: Vec<f64>,
    /// phi_i at the optimum.
    pub phi: Vec<f64>,
    /// log det M(w), -k log tr(M^-1 B), or both in shares, in whitened coordinates.
    pub merit: f64,
    /// The merit of any feasible design is at most this (whitened coordinates).
    pub bound: f64,
    /// k log(S/k), the Kiefer-Wolfowitz gap left.
    pub gap: f64,
    /// Number of Newton steps.
    pub iterations: usize,
}

/// Settings of [`continuous`].
#[derive(Debug, Clone, Copy)]
pub struct CertificateSettings {
    /// Stops when the gap per coefficient is below this.
    pub tolerance: f64,
    /// Most Newton steps.
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

/// The objective and its gradient at some weights.
struct Evaluation {
    /// The merit: concave in the weights, with gradient `phi`; k = sum w phi + fixed.
    merit: f64,
    inv_lower: Vec<f64>,
    mixed: Option<Mixed>,
    phi: Vec<f64>,
    /// The part of S that comes from F.
    fixed: f64,
}

/// The part of an average variance in the merit.
struct Mixed {
    /// L^-1 H.
    weighted: Vec<f64>,
    /// tr(M^-1 H H').
    trace: f64,
    /// Share of log det M.
    share: f64,
    /// psi_i = tr(A_i M^-1 H H' M^-1 A_i').
    psi: Vec<f64>,
}

impl Mixed {
    fn new(problem: &Problem, inv_lower: &[f64]) -> Option<Self> {
        let (half, share) = problem.objective.trace_part()?;
        let weighted = square_product(inv_lower, half, problem.terms);
        Some(Self {
            trace: dot(&weighted, &weighted),
            weighted,
            share,
            psi: Vec::new(),
        })
    }

    /// share log det M - (1 - share) k log tr(M^-1 H H'); without the determinant where it has no
    /// share.
    fn merit(&self, log_det: f64, k: usize) -> f64 {
        self.share * log_det - (1.0 - self.share) * k as f64 * self.trace.ln()
    }

    /// Factor of the gradient of the trace in that of the merit.
    fn scale(&self, k: usize) -> f64 {
        (1.0 - self.share) * k as f64 / self.trace
    }
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
        add_transposed_product(&mut m, (k, part.len() * b, k), &left, &left);
    }
    m
}

/// The merit alone; `None` when M is singular.
fn merit(problem: &Problem, w: &[f64]) -> Option<f64> {
    let k = problem.terms;
    let mut l = weighted_information(problem, w);
    cholesky(&mut l, k, 1e-14).ok()?;
    let value = log_det(&l, k);
    if matches!(problem.objective, Objective::Determinant) {
        return Some(value);
    }
    Mixed::new(problem, &lower_inverse(&l, k)).map(|m| m.merit(value, k))
}

/// A B of k x k matrices.
fn square_product(a: &[f64], b: &[f64], k: usize) -> Vec<f64> {
    let mut c = vec![0.0; k * k];
    product(&mut c, (k, k, k), a, b);
    c
}

fn evaluate(problem: &Problem, w: &[f64]) -> Option<Evaluation> {
    const CHUNK: usize = 4096;
    let (b, k) = (problem.block, problem.terms);
    let mut l = weighted_information(problem, w);
    cholesky(&mut l, k, 1e-14).ok()?;
    let inv_lower = lower_inverse(&l, k);
    let mut mixed = Mixed::new(problem, &inv_lower);
    let mut phi = vec![0.0; problem.poses];
    let mut psi = vec![0.0; if mixed.is_some() { problem.poses } else { 0 }];
    let mut t = vec![0.0; CHUNK.min(problem.poses) * b * k];
    let mut v = vec![0.0; if mixed.is_some() { t.len() } else { 0 }];
    for start in (0..problem.poses).step_by(CHUNK) {
        let count = CHUNK.min(problem.poses - start);
        let rows = &problem.rows[start * b * k..(start + count) * b * k];
        let part = &mut t[..count * b * k];
        product_transposed(part, (count * b, k, k), rows, &inv_lower);
        squares(&mut phi[start..start + count], part, b * k);
        if let Some(mixed) = &mixed {
            let out = &mut v[..count * b * k];
            product(out, (count * b, k, k), part, &mixed.weighted);
            squares(&mut psi[start..start + count], out, b * k);
        }
    }
    // S takes tr(M^-1 F), and tr(Y' F Y) with Y = M^-1 H, from what is fixed.
    let of_fixed = |y: &[f64]| dot(&square_product(y, &problem.fixed, k), y);
    let mut fixed = of_fixed(&inv_lower);
    let mut value = log_det(&l, k);
    if let Some(mixed) = &mut mixed {
        let mut y = vec![0.0; k * k];
        add_transposed_product(&mut y, (k, k, k), &mixed.weighted, &inv_lower);
        let scale = mixed.scale(k);
        fixed = mixed.share * fixed + scale * of_fixed(&y);
        for (phi, psi) in phi.iter_mut().zip(&psi) {
            *phi = mixed.share * *phi + scale * psi;
        }
        value = mixed.merit(value, k);
        mixed.psi = psi;
    }
    Some(Evaluation {
        merit: value,
        inv_lower,
        mixed,
        phi,
        fixed,
    })
}

/// Sums of squares of the blocks of `size` numbers.
fn squares(out: &mut [f64], values: &[f64], size: usize) {
    for (sum, block) in out.iter_mut().zip(values.chunks_exact(size)) {
        *sum = dot(block, block);
    }
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
    let gap = (k * ((sum + eval.fixed) / k).ln()).max(0.0);
    (gap, level)
}

/// Weights with which the multiplicative step w <- min(cap, c w phi) sums to n.
fn multiplicative_step(w: &mut [f64], phi: &[f64], n: f64, cap: f64) {
    let mut raw: Vec<f64> = w.iter().zip(phi).map(|(w, p)| w * p).collect();
    // What reaches the cap stays there, and the factor of the rest only grows.
    let (mut capped, mut left) = (0usize, raw.iter().sum::<f64>());
    loop {
        let factor = (n - capped as f64 * cap) / left;
        if !(factor > 0.0 && factor.is_finite()) {
            break;
        }
        let before = capped;
        left = 0.0;
        for (w, r) in w.iter_mut().zip(&mut raw) {
            if *r >= 0.0 && *r * factor >= cap {
                (*w, *r) = (cap, -1.0);
                capped += 1;
            } else if *r >= 0.0 {
                *w = *r * factor;
                left += *r;
            }
        }
        if capped == before {
            break;
        }
    }
}

/// The continuous optimum for `n` poses with weights at most `cap` (infinite: repeats).
///
/// A few multiplicative steps come near the optimum, then Newton steps on the relevant poses
/// (a quadratic programme solved by pairwise moves), each checked against all candidates.
///
/// # Errors
/// A cap or a tolerance that is not above 0, no Newton steps, and a problem whose M is singular even
/// with uniform weights.
pub fn continuous(
    problem: &Problem,
    n: usize,
    cap: f64,
    settings: &CertificateSettings,
    control: &Control<'_>,
) -> Result<Continuous, DesignError> {
    let refused = |name, value: String, expected| {
        Err(DesignError::Setting {
            name,
            value,
            expected,
        })
    };
    let most = problem.available.iter().filter(|a| **a).count() as f64;
    if !(cap > 0.0 && cap * most >= n as f64) {
        let expected = "a weight of at least n / candidates, infinite for repeats";
        return refused("cap", cap.to_string(), expected);
    }
    if !(settings.tolerance > 0.0 && settings.tolerance.is_finite()) {
        let value = settings.tolerance.to_string();
        return refused("tolerance", value, "a finite number above 0");
    }
    if settings.iterations == 0 {
        return refused("iterations", "0".into(), "at least 1");
    }
    continuous_from(problem, n, cap, None, settings, control).ok_or(DesignError::Singular {
        n,
        terms: problem.terms,
    })
}

/// [`continuous`] from weights that are nearly the optimum.
pub(crate) fn continuous_from(
    problem: &Problem,
    n: usize,
    cap: f64,
    start: Option<&[f64]>,
    settings: &CertificateSettings,
    control: &Control<'_>,
) -> Option<Continuous> {
    let k = problem.terms as f64;
    let n_f = n as f64;
    let count = problem.available.iter().filter(|a| **a).count();
    if n == 0 || count == 0 {
        let eval = evaluate(problem, &vec![0.0; problem.poses])?;
        let weights = vec![0.0; problem.poses];
        let (merit, phi) = (eval.merit, eval.phi);
        return Some(Continuous {
            weights,
            phi,
            merit,
            bound: merit,
            gap: 0.0,
            iterations: 0,
        });
    }
    let wanted = 2 * (n.min(4 * problem.terms) + problem.terms);
    let (mut w, mut eval) = match start {
        Some(start) => (start.to_vec(), evaluate(problem, start)?),
        None => region(problem, n_f, cap, count, wanted)?,
    };
    let (mut gap, mut level) = bound_at(problem, &eval, n_f, cap);
    let mut bound = eval.merit + gap;
    let mut iterations = 0;
    while iterations < settings.iterations && gap > settings.tolerance * k && !control.stop() {
        let set = working_set(problem, &w, &eval.phi, level, wanted);
        let step = newton_step(problem, &set, &w, &eval, cap, 0.005 * gap);
        let before = (gap, eval.merit);
        // The last Newton steps gain less than rounding but still close the gap.
        let slack = 1e-12 * (1.0 + eval.merit.abs());
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
            if merit(problem, &trial).is_some_and(|v| v > eval.merit - slack) {
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
        bound = bound.min(eval.merit + gap);
        iterations += 1;
        if gap > 0.9 * before.0 && eval.merit <= before.1 + slack {
            break;
        }
    }
    gap = (bound - eval.merit).max(0.0);
    Some(Continuous {
        merit: eval.merit,
        phi: eval.phi,
        weights: w,
        bound,
        gap,
        iterations,
    })
}

/// Weights after a few multiplicative steps from uniform ones, on at most `wanted` poses.
fn region(
    problem: &Problem,
    n: f64,
    cap: f64,
    count: usize,
    wanted: usize,
) -> Option<(Vec<f64>, Evaluation)> {
    let share = (n / count as f64).min(cap);
    let uniform = |a: &bool| if *a { share } else { 0.0 };
    let mut w: Vec<f64> = problem.available.iter().map(uniform).collect();
    let mut eval = evaluate(problem, &w)?;
    for _ in 0..4 {
        multiplicative_step(&mut w, &pull(problem, &eval.phi), n, cap);
        eval = evaluate(problem, &w)?;
    }
    if count > wanted {
        return keep_best(problem, w, eval, wanted, n, cap);
    }
    Some((w, eval))
}

/// tr(A_i M(w)^-1 A_i') of every candidate; `None` when M is singular.
pub(crate) fn variances(problem: &Problem, w: &[f64]) -> Option<Vec<f64>> {
    let mut own = problem.clone();
    own.objective = Objective::Determinant;
    evaluate(&own, w).map(|eval| eval.phi)
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

/// Most poses with weight that one Newton step moves: its Hessian then takes 130 MB.
const MOST_MOVING: usize = 4000;

/// Poses with weight (the least settled where they are many), and those whose phi is large enough
/// to gain weight.
fn working_set(problem: &Problem, w: &[f64], phi: &[f64], level: f64, limit: usize) -> Vec<usize> {
    let mut wishes: Vec<usize> = (0..problem.poses)
        .filter(|&i| problem.available[i] && w[i] == 0.0 && phi[i] > 0.98 * level)
        .collect();
    wishes.sort_unstable_by(|&a, &b| phi[b].total_cmp(&phi[a]).then(a.cmp(&b)));
    wishes.truncate((limit / 2).max(64));
    let mut set: Vec<usize> = (0..problem.poses).filter(|&i| w[i] > 0.0).collect();
    if set.len() > MOST_MOVING {
        let distance = |i: usize| (phi[i] - level).abs();
        set.sort_unstable_by(|&a, &b| distance(b).total_cmp(&distance(a)).then(a.cmp(&b)));
        set.truncate(MOST_MOVING);
    }
    set.extend(wishes);
    set.sort_unstable();
    set
}

/// Factor of the multiplicative step: phi for the determinant, its root for the trace.
fn pull(problem: &Problem, phi: &[f64]) -> Vec<f64> {
    match problem.objective {
        Objective::Determinant => phi.to_vec(),
        _ => phi.iter().map(|p| p.sqrt()).collect(),
    }
}

/// Removes rounding from sum w = n within the box.
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
