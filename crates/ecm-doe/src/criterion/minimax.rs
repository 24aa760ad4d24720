//! G-optimal designs: the smallest largest variance of a predicted pose.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::alphabetic::root_of_moment;
use super::search::{generator, search, search_near, singular};
use super::settings::{DSettings, Design, apply_settings};
use crate::budget::on_threads;
use crate::certificate::{CertificateSettings, Continuous, continuous, continuous_from, variances};
use crate::exchange::pair::Pair;
use crate::linalg::{dot, product, product_transposed};
use crate::problem::Objective;
use crate::{Control, DesignError, Problem, Status};

/// Number of poses with the largest variances that are tried in place of a design pose.
const ENTERING: usize = 12;
/// Disturbances of the design by default.
const DEFAULT_STEPS: usize = 20;

/// The design with the smallest max over the candidates of tr(A M^-1 A').
///
/// Starts from the D-optimal design and the I-optimal one of the worst poses, then exchanges.
/// `value` is the largest variance in units of the noise variance, `bound` a certified lower
/// bound, `efficiency` bound / value. `settings.method` has no influence.
///
/// # Errors
/// As [`crate::d_optimal`].
pub fn g_optimal(
    regressor: &[f64],
    block: usize,
    terms: usize,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let mut problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    let measured = apply_settings(&mut problem, settings)?;
    on_threads(settings.threads, || {
        minimise(problem, settings, measured, control)
    })?
}

fn minimise(
    mut problem: Problem,
    settings: &DSettings,
    measured: usize,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let singular = singular(&problem, settings);
    let steps = match settings.iterations {
        0 if control.timed() => usize::MAX,
        0 => DEFAULT_STEPS,
        given => given,
    };
    let short = DSettings {
        iterations: 100,
        ..settings.clone()
    };
    let first = search(&problem, &short, measured, control)?;
    let saddle = Saddle::find(&mut problem, settings, control).ok_or(singular.clone())?;
    let second = search_near(&problem, &short, measured, &saddle.optimum, control)?;
    let own = |design: Design| -> Vec<usize> {
        let mut rest = settings.include.clone();
        let keep = |i: &usize| match rest.iter().position(|r| r == i) {
            Some(at) => {
                rest.swap_remove(at);
                false
            }
            None => true,
        };
        design.indices.into_iter().filter(keep).collect()
    };
    let mut exchanges = first.exchanges + second.exchanges;
    let mut best: Option<Variances<'_>> = None;
    for start in [own(first), own(second)] {
        let Some(mut state) = Variances::new(&problem, start, &saddle, settings.replicates) else {
            continue;
        };
        exchanges += state.descend(control);
        if best.as_ref().is_none_or(|b| state.largest < b.largest) {
            best = Some(state);
        }
    }
    let mut best = best.ok_or(singular)?;
    let bound = saddle.bound;
    let mut rng = generator(settings.seed, u64::MAX / 3);
    for step in 0..steps {
        if control.stop() || best.largest <= bound * (1.0 + 1e-9) || best.design.is_empty() {
            break;
        }
        let mut trial = best.clone();
        if trial.disturb(&mut rng) {
            exchanges += trial.descend(control);
            if trial.largest < best.largest {
                best = trial;
            }
        }
        control.report(step + 1, steps, bound / best.largest);
    }
    let value = best.largest;
    let bound = bound.min(value);
    let mut indices = best.design;
    indices.extend(&settings.include);
    indices.sort_unstable();
    Ok(Design {
        indices,
        value,
        bound,
        efficiency: bound / value,
        exchanges,
        status: if control.cancelled() {
            Status::Interrupted
        } else if bound >= value * (1.0 - 1e-9) {
            Status::Converged
        } else {
            Status::Budget
        },
        gap: saddle.gap,
    })
}

/// The continuous optimum of the largest variance, approached from below.
///
/// No largest variance is below an average over any weights u of the candidates, and the least
/// average is certified: max d >= min_w sum u_i d_i(w). Weights of the D-optimum give the bound
/// where weights are free (Kiefer and Wolfowitz); where they are capped the poses whose variance
/// stays above the average gain weight until the bound no longer rises.
struct Saddle {
    /// Largest bound so far.
    bound: f64,
    /// Design weights and certificate of the last average.
    optimum: Continuous,
    /// Smallest ratio so far of the largest variance of a continuous design to the bound, minus one.
    gap: f64,
}

impl Saddle {
    /// Sets the average with the largest bound as the objective of the problem.
    fn find(problem: &mut Problem, settings: &DSettings, control: &Control<'_>) -> Option<Self> {
        let free = settings.n - settings.include.len();
        let cap = if settings.replicates {
            f64::INFINITY
        } else {
            1.0
        };
        let (block, k) = (problem.block, problem.terms);
        let certificate = CertificateSettings {
            tolerance: 1e-7,
            ..CertificateSettings::default()
        };
        let whole = control.without_deadline();
        let first = continuous(problem, free, cap, &certificate, &whole).ok()?;
        let mut weights = first.weights.clone();
        if !weights.iter().any(|w| *w > 0.0) {
            weights.fill(1.0);
        }
        let mut best: Option<(Self, Objective)> = None;
        let mut least = f64::INFINITY;
        let mut start_weights: Option<Vec<f64>> = None;
        let mut power = 2.0;
        for round in 0..ROUNDS {
            if round > 0 && control.cancelled() {
                break;
            }
            // Weights of hostile candidates overflow: the bounds so far hold.
            let Ok(half) = root_of_moment(&problem.rows, Some(&weights), block, k) else {
                break;
            };
            problem.objective = Objective::Trace(half);
            let start = start_weights.as_deref();
            let Some(found) = continuous_from(problem, free, cap, start, &certificate, &whole)
            else {
                break;
            };
            let bound = (-found.bound / k as f64).exp();
            let Some(variance) = variances(problem, &found.weights) else {
                break;
            };
            least = least.min(variance.iter().copied().fold(0.0, f64::max));
            let risen = best.as_ref().map_or(1.0, |(b, _)| bound / b.bound - 1.0);
            let better = risen > 0.0;
            power = if better {
                (power * 1.2f64).min(4.0)
            } else {
                0.5 * power
            };
            let average: f64 = weights.iter().zip(&variance).map(|(w, d)| w * d).sum();
            let average = average / weights.iter().sum::<f64>();
            start_weights = Some(found.weights.clone());
            if better {
                let saddle = Self {
                    bound,
                    optimum: found,
                    gap: 0.0,
                };
                best = Some((saddle, problem.objective.clone()));
            }
            if least <= bound * (1.0 + CLOSE) || (risen < 0.1 * CLOSE && better) {
                break;
            }
            for (w, d) in weights.iter_mut().zip(&variance) {
                *w *= (d / average).powf(power);
            }
        }
        let (mut saddle, objective) = best?;
        problem.objective = objective;
        saddle.gap = (least / saddle.bound - 1.0).max(0.0);
        Some(saddle)
    }
}

/// Most averages tried for the bound.
const ROUNDS: usize = 40;
/// Ratio minus one at which the bound is good enough.
const CLOSE: f64 = 1e-3;

/// A design with the variance of every candidate, the largest first.
#[derive(Clone)]
struct Variances<'a> {
    problem: &'a Problem,
    design: Vec<usize>,
    free: Vec<bool>,
    replicates: bool,
    /// X M^-1, (N * block) x k.
    solved: Vec<f64>,
    /// tr(A M^-1 A') of every candidate.
    variance: Vec<f64>,
    /// Candidates by falling variance.
    order: Vec<usize>,
    largest: f64,
    /// Candidates that the continuous optimum uses.
    support: Vec<usize>,
}

impl<'a> Variances<'a> {
    fn new(
        problem: &'a Problem,
        design: Vec<usize>,
        saddle: &Saddle,
        replicates: bool,
    ) -> Option<Self> {
        let mut free = problem.available.clone();
        if !replicates {
            for &i in &design {
                free[i] = false;
            }
        }
        let mut state = Self {
            problem,
            design,
            free,
            replicates,
            solved: vec![0.0; problem.rows.len()],
            variance: vec![0.0; problem.poses],
            order: (0..problem.poses).collect(),
            largest: f64::INFINITY,
            support: (0..problem.poses)
                .filter(|&i| saddle.optimum.weights[i] > 0.0)
                .collect(),
        };
        state.rebuild().then_some(state)
    }

    fn rebuild(&mut self) -> bool {
        let (b, k) = (self.problem.block, self.problem.terms);
        let m = self.problem.information(&self.design);
        let Some((_, m)) = self.problem.regular_inverse(&m) else {
            return false;
        };
        let rows = self.problem.poses * b;
        product(&mut self.solved, (rows, k, k), &self.problem.rows, &m);
        let parts = self.solved.chunks_exact(b * k);
        for (i, part) in parts.enumerate() {
            self.variance[i] = dot(part, self.problem.pose(i));
        }
        let variance = &self.variance;
        self.order
            .sort_by(|&a, &b| variance[b].total_cmp(&variance[a]).then(a.cmp(&b)));
        self.largest = self.order.first().map_or(0.0, |&i| variance[i]);
        true
    }

    /// A_c M^-1 A_i' of every candidate c, (N * block) x block.
    fn cross(&self, i: usize) -> Vec<f64> {
        let (b, k) = (self.problem.block, self.problem.terms);
        let rows = self.problem.poses * b;
        let mut out = vec![0.0; rows * b];
        product_transposed(&mut out, (rows, k, b), &self.solved, self.problem.pose(i));
        out
    }

    fn swap(&mut self, row: usize, entering: usize) -> bool {
        let old = std::mem::replace(&mut self.design[row], entering);
        if !self.rebuild() {
            self.design[row] = old;
            self.rebuild();
            return false;
        }
        if !self.replicates {
            self.free[old] = true;
            self.free[entering] = false;
        }
        true
    }

    /// Swaps while the largest variance falls; returns the number of swaps.
    ///
    /// The poses of the largest variances are tried first, then those of the continuous optimum.
    fn descend(&mut self, control: &Control<'_>) -> usize {
        let mut swaps = 0;
        let mut outs: Vec<Vec<f64>> = Vec::new();
        while !control.stop() {
            outs.clear();
            outs.extend(self.design.iter().map(|&i| self.cross(i)));
            let free = |i: &usize| self.free[*i];
            let worst = self.order.iter().copied().filter(free).take(ENTERING);
            let found = self.best_swap(worst, &outs, control).or_else(|| {
                let used = self.support.iter().copied().filter(free);
                self.best_swap(used, &outs, control)
            });
            let Some((row, j)) = found else { break };
            let before = self.largest;
            let old = self.design[row];
            if !self.swap(row, j) {
                break;
            }
            if self.largest >= before {
                self.swap(row, old);
                break;
            }
            swaps += 1;
        }
        swaps
    }

    /// The swap to one of `entering` with the smallest largest variance, if below the current one.
    fn best_swap(
        &self,
        entering: impl Iterator<Item = usize>,
        outs: &[Vec<f64>],
        control: &Control<'_>,
    ) -> Option<(usize, usize)> {
        let mut best = (self.largest * (1.0 - 1e-9), None);
        for j in entering {
            if control.stop() {
                break;
            }
            let into = self.cross(j);
            for (row, out) in outs.iter().enumerate() {
                if let Some(largest) = self.after(row, out, j, &into, best.0) {
                    best = (largest, Some((row, j)));
                }
            }
        }
        best.1
    }

    /// The largest variance after `entering` replaces a row, `None` unless it is below `limit`.
    fn after(&self, row: usize, out: &[f64], j: usize, into: &[f64], limit: f64) -> Option<f64> {
        let b = self.problem.block;
        let n = 2 * b;
        let i = self.design[row];
        // Blocks of the poses themselves: A_j M^-1 A_j', A_i M^-1 A_i', A_j M^-1 A_i'.
        let block = |of: usize| of * b * b..(of + 1) * b * b;
        let mut pair = Pair::new(b);
        pair.growth(&into[block(j)], &out[block(i)], &out[block(j)])?;
        let w = pair.inverse();
        let mut largest: f64 = 0.0;
        let mut u = vec![0.0; n];
        for &p in &self.order {
            let mut value = self.variance[p];
            for r in p * b..(p + 1) * b {
                u[..b].copy_from_slice(&into[r * b..(r + 1) * b]);
                u[b..].copy_from_slice(&out[r * b..(r + 1) * b]);
                for (row, u_r) in w.chunks_exact(n).zip(&u) {
                    value -= u_r * dot(row, &u);
                }
            }
            largest = largest.max(value);
            if largest >= limit {
                return None;
            }
        }
        Some(largest)
    }

    /// Replaces one to three poses by random ones; `false` when the design became singular.
    fn disturb(&mut self, rng: &mut ChaCha8Rng) -> bool {
        for _ in 0..rng.random_range(1..=3) {
            let row = rng.random_range(0..self.design.len());
            let used = !self.support.is_empty() && rng.random_bool(0.5);
            let entering = if used {
                self.support[rng.random_range(0..self.support.len())]
            } else {
                rng.random_range(0..self.problem.poses)
            };
            if self.free[entering] && !self.swap(row, entering) {
                return false;
            }
        }
        true
    }
}
