//! G-optimal designs: the smallest largest variance of a predicted pose.

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::d::{DSettings, Design, fix_known};
use super::linear::root_of_moment;
use super::model_based::{generator, search};
use crate::budget::on_threads;
use crate::certificate::{CertificateSettings, continuous};
use crate::linalg::{dot, inverse, product, product_transposed, small_inverse};
use crate::problem::Objective;
use crate::{Control, DesignError, Problem, Status};

/// Poses with the largest variances that are tried in the place of a design pose.
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
    let measured = fix_known(&mut problem, settings)?;
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
    let free = settings.n - settings.include.len();
    let cap = if settings.replicates {
        f64::INFINITY
    } else {
        1.0
    };
    let singular = DesignError::RankDeficient {
        candidates: problem.poses,
        column: 0,
    };
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
    let certificate = CertificateSettings::default();
    let whole = control.without_deadline();
    let optimum = continuous(&problem, free, cap, &certificate, &whole).ok_or(singular.clone())?;
    // The largest variance is at least any average, so also that over the D-optimal weights.
    let (block, k) = (problem.block, problem.terms);
    if optimum.weights.iter().any(|w| *w > 0.0) {
        let weights = Some(optimum.weights.as_slice());
        problem.objective = Objective::Trace(root_of_moment(&problem.rows, weights, block, k));
    } else {
        problem.objective = Objective::Trace(root_of_moment(&problem.rows, None, block, k));
    }
    let average = continuous(&problem, free, cap, &certificate, &whole).ok_or(singular.clone())?;
    let bound = (-average.bound / k as f64).exp();
    let second = search(&problem, &short, measured, control)?;
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
        let Some(mut state) = Variances::new(&problem, start, settings.replicates) else {
            continue;
        };
        exchanges += state.descend(control);
        if best.as_ref().is_none_or(|b| state.largest < b.largest) {
            best = Some(state);
        }
    }
    let mut best = best.ok_or(singular)?;
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
        gap: average.gap / k as f64,
    })
}

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
}

impl<'a> Variances<'a> {
    fn new(problem: &'a Problem, design: Vec<usize>, replicates: bool) -> Option<Self> {
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
        };
        state.rebuild().then_some(state)
    }

    fn rebuild(&mut self) -> bool {
        let (b, k) = (self.problem.block, self.problem.terms);
        let Ok((_, m)) = inverse(&self.problem.information(&self.design), k) else {
            return false;
        };
        let rows = self.problem.poses * b;
        product(
            &mut self.solved,
            (rows, k, k),
            &self.problem.rows,
            &m,
            1.0,
            false,
        );
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

    /// Swaps while the largest variance falls; their number.
    fn descend(&mut self, control: &Control<'_>) -> usize {
        let mut swaps = 0;
        while !control.stop() {
            let entering: Vec<usize> = self
                .order
                .iter()
                .copied()
                .filter(|&i| self.free[i])
                .take(ENTERING)
                .collect();
            let ins: Vec<Vec<f64>> = entering.iter().map(|&j| self.cross(j)).collect();
            let mut best = (self.largest * (1.0 - 1e-9), None);
            for row in 0..self.design.len() {
                let out = self.cross(self.design[row]);
                for (&j, into) in entering.iter().zip(&ins) {
                    if let Some(largest) = self.after(row, &out, j, into, best.0) {
                        best = (largest, Some((row, j)));
                    }
                }
            }
            let (_, Some((row, j))) = best else { break };
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

    /// The largest variance after `entering` replaces a row, `None` unless it is below `limit`.
    fn after(&self, row: usize, out: &[f64], j: usize, into: &[f64], limit: f64) -> Option<f64> {
        let b = self.problem.block;
        let n = 2 * b;
        let i = self.design[row];
        let (mut c, mut w) = (vec![0.0; n * n], vec![0.0; n * n]);
        for r in 0..b {
            for s in 0..b {
                let unit = if r == s { 1.0 } else { 0.0 };
                c[r * n + s] = into[(j * b + r) * b + s] + unit;
                c[(r + b) * n + s + b] = out[(i * b + r) * b + s] - unit;
                // A_j M^-1 A_i'
                c[r * n + s + b] = out[(j * b + r) * b + s];
                c[(s + b) * n + r] = out[(j * b + r) * b + s];
            }
        }
        small_inverse(&mut c, &mut w, n).filter(|growth| *growth > -20.0)?;
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
            let entering = rng.random_range(0..self.problem.poses);
            if self.free[entering] && !self.swap(row, entering) {
                return false;
            }
        }
        true
    }
}
