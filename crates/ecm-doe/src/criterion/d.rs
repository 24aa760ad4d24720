//! D-optimal designs: the largest log det of the information matrix.

use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use crate::budget::on_threads;
use crate::certificate::{CertificateSettings, Continuous, continuous};
use crate::exchange::pool::Pool;
use crate::exchange::search::iterate;
use crate::exchange::{
    BlockState, CrossState, State, fedorov, random_design, rounded_design, rowwise, spanning_design,
};
use crate::{Control, DesignError, Problem, Status};

/// How the exchange looks for the best design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// Best pair from random starts (the paper's).
    Fedorov,
    /// Best candidate for each row in turn, from random starts.
    RowWise,
    /// Starts drawn from the continuous optimum, then an iterated local search.
    #[default]
    Search,
}

/// Settings of [`d_optimal`].
#[derive(Debug, Clone)]
pub struct DSettings {
    /// Design size, with the included poses and without those measured before.
    pub n: usize,
    /// Independent starts.
    pub starts: usize,
    /// Search: disturbances in each of the [`CHAINS`] chains; else swaps per start. 0: default.
    pub iterations: usize,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Worker threads, 0 for all; without influence on the result.
    pub threads: usize,
    /// How to search.
    pub method: Method,
    /// A pose may be chosen more than once.
    pub replicates: bool,
    /// Candidates that must be in the design.
    pub include: Vec<usize>,
    /// Candidates that must not be chosen.
    pub exclude: Vec<usize>,
    /// Regressor rows already measured, any number x k: they count, but are not chosen again.
    pub measured: Vec<f64>,
    /// Information known beforehand, k x k (Bayesian D: ridge = diag(lambda)).
    pub prior: Option<Vec<f64>>,
}

impl Default for DSettings {
    fn default() -> Self {
        Self {
            n: 0,
            starts: 10,
            iterations: 0,
            seed: 0,
            threads: 0,
            method: Method::Search,
            replicates: false,
            include: Vec::new(),
            exclude: Vec::new(),
            measured: Vec::new(),
            prior: None,
        }
    }
}

/// Chains of the iterated local search; a constant, so that threads do not change the result.
pub const CHAINS: usize = 4;

/// Work of the default budget, in multiplications: some 5000 disturbances in each chain for
/// 200 of 1700 poses and 84 terms, a few seconds on two threads.
const DEFAULT_WORK: f64 = 5e10;

/// A design and how good it is.
#[derive(Debug, Clone)]
pub struct Design {
    /// Chosen candidates, sorted; repeated when replicates are allowed.
    pub indices: Vec<usize>,
    /// log det(M/n)/k, or the smallest distance.
    pub value: f64,
    /// Certified upper bound of `value` for every design of this kind.
    pub bound: f64,
    /// exp(value - bound), or value / bound.
    pub efficiency: f64,
    /// Swaps carried out in all starts.
    pub exchanges: usize,
    /// Why the search ended.
    pub status: Status,
    /// Kiefer-Wolfowitz gap per coefficient left in the bound (0 for distances).
    pub gap: f64,
}

/// The `settings.n` poses whose regressor rows have the largest log det(X'X).
///
/// # Arguments
/// - `regressor`: (N * block) x k row-major, `block` rows a pose
///
/// # Errors
/// Wrong input: shapes, numbers that are not finite, n larger than the candidates or too small
/// for the coefficients, candidates that cannot determine the model, contradictory lists.
pub fn d_optimal(
    regressor: &[f64],
    block: usize,
    terms: usize,
    settings: &DSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let mut problem = Problem::new(regressor, block, terms, settings.prior.as_deref())?;
    let measured = fix_known(&mut problem, settings)?;
    on_threads(settings.threads, || {
        search(&problem, settings, measured, control)
    })?
}

/// Applies the lists and the measured rows; the number of rows measured before.
fn fix_known(problem: &mut Problem, settings: &DSettings) -> Result<usize, DesignError> {
    let (n, k, b) = (settings.n, problem.terms, problem.block);
    if settings.starts == 0 {
        return Err(DesignError::Setting {
            name: "starts",
            value: "0".into(),
            expected: "at least 1",
        });
    }
    if !settings.measured.len().is_multiple_of(k) {
        let expected = settings.measured.len().div_ceil(k) * k;
        let found = settings.measured.len();
        return Err(DesignError::Shape {
            what: "the measured rows",
            found,
            expected,
        });
    }
    crate::problem::check_finite("the measured rows", &settings.measured, k)?;
    apply_lists(
        &mut problem.available,
        n,
        &settings.include,
        &settings.exclude,
        settings.replicates,
    )?;
    let measured = settings.measured.len() / k;
    if n == 0 {
        return Err(DesignError::Small {
            n,
            least: 1,
            criterion: "D-optimality",
        });
    }
    if settings.prior.is_none() && n * b + measured < k {
        let needed = (k - measured).div_ceil(b);
        return Err(DesignError::TooFew {
            n,
            rows: n * b + measured,
            terms: k,
            needed,
        });
    }
    problem.fix_rows(&settings.measured);
    for &i in &settings.include {
        problem.fix(i);
    }
    Ok(measured)
}

/// Marks what may be chosen: included poses (without repeats) and excluded ones may not.
pub(crate) fn apply_lists(
    available: &mut [bool],
    n: usize,
    include: &[usize],
    exclude: &[usize],
    replicates: bool,
) -> Result<(), DesignError> {
    let last = available.len().saturating_sub(1);
    for (what, list) in [("the include list", include), ("the exclude list", exclude)] {
        if let Some(&index) = list.iter().find(|&&i| i > last) {
            return Err(DesignError::Index { what, index, last });
        }
    }
    let mut included = vec![false; available.len()];
    for &index in include {
        if included[index] && !replicates {
            return Err(DesignError::Contradiction {
                index,
                what: "included twice",
            });
        }
        included[index] = true;
    }
    for &index in exclude {
        if included[index] {
            return Err(DesignError::Contradiction {
                index,
                what: "both included and excluded",
            });
        }
        available[index] = false;
    }
    if include.len() > n {
        return Err(DesignError::IncludeTooLong {
            include: include.len(),
            n,
        });
    }
    let candidates = available.iter().filter(|a| **a).count();
    if !replicates {
        for &i in include {
            available[i] = false;
        }
    }
    if (n > candidates && !replicates) || candidates == 0 {
        return Err(DesignError::TooMany { n, candidates });
    }
    Ok(())
}

fn search(
    problem: &Problem,
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
    // The bound is part of the answer: it is computed even when the time is short.
    let optimum = continuous(
        problem,
        free,
        cap,
        &CertificateSettings::default(),
        &control.without_deadline(),
    )
    .ok_or(DesignError::RankDeficient {
        candidates: problem.poses,
        column: 0,
    })?;
    let found = if problem.block == 1 {
        run::<Single>(problem, settings, &optimum, free, control)
    } else {
        run::<Several>(problem, settings, &optimum, free, control)
    };
    let Some(found) = found else {
        return Err(DesignError::RankDeficient {
            candidates: problem.poses,
            column: 0,
        });
    };
    let k = problem.terms as f64;
    let rows = settings.n as f64 + measured as f64 / problem.block as f64;
    let scaled = |log_det: f64| (log_det + problem.shift) / k - rows.ln();
    let mut indices = found.design;
    indices.extend(&settings.include);
    indices.sort_unstable();
    let value = scaled(found.log_det);
    let bound = scaled(optimum.bound).max(value);
    let status = if control.cancelled() {
        Status::Interrupted
    } else if found.complete && (bound - value < 1e-9 || settings.method != Method::Search) {
        Status::Converged
    } else {
        Status::Budget
    };
    Ok(Design {
        indices,
        value,
        bound,
        efficiency: (value - bound).exp(),
        exchanges: found.swaps,
        status,
        gap: optimum.gap / k,
    })
}

struct Found {
    design: Vec<usize>,
    log_det: f64,
    swaps: usize,
    complete: bool,
}

/// Candidates worth looking at: those the continuous optimum uses or nearly uses.
fn promising(problem: &Problem, optimum: &Continuous, free: usize) -> Vec<usize> {
    let mut order: Vec<usize> = (0..problem.poses)
        .filter(|&i| problem.available[i])
        .collect();
    let used = |i: usize| optimum.weights[i] > 0.0;
    order.sort_by(|&a, &b| {
        used(b)
            .cmp(&used(a))
            .then(optimum.phi[b].total_cmp(&optimum.phi[a]))
            .then(a.cmp(&b))
    });
    let support = order.iter().filter(|&&i| used(i)).count();
    order.truncate((support + support / 2).max(3 * free).max(64));
    order.sort_unstable();
    order
}

/// One kind of exchange state for pools of any lifetime.
trait Family: Sync {
    type State<'a>: State + Send;
    fn start<'a>(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<Self::State<'a>>;
}

/// Poses with one regressor row.
struct Single;

impl Family for Single {
    type State<'a> = CrossState<'a>;
    fn start<'a>(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<CrossState<'a>> {
        CrossState::new(pool, design)
    }
}

/// Poses with several regressor rows.
struct Several;

impl Family for Several {
    type State<'a> = BlockState<'a>;
    fn start<'a>(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<BlockState<'a>> {
        BlockState::new(pool, design)
    }
}

fn run<F: Family>(
    problem: &Problem,
    settings: &DSettings,
    optimum: &Continuous,
    free: usize,
    control: &Control<'_>,
) -> Option<Found> {
    let everyone: Vec<usize> = (0..problem.poses)
        .filter(|&i| problem.available[i])
        .collect();
    let thorough = settings.method == Method::Search;
    let ids = if thorough {
        promising(problem, optimum, free)
    } else {
        everyone.clone()
    };
    let pool = Pool::new(problem, ids, settings.replicates);
    let weights: Vec<f64> = pool.ids.iter().map(|&i| optimum.weights[i]).collect();
    let chain_steps = match settings.iterations {
        // With a time limit the time is the budget.
        0 if control.timed() => usize::MAX,
        0 => default_iterations(&pool, free),
        given => given,
    };
    let total = if thorough {
        chain_steps.saturating_mul(CHAINS)
    } else {
        0
    };
    let total = total.saturating_add(settings.starts);
    let done = AtomicUsize::new(0);
    let limit = match settings.iterations {
        given if given > 0 && !thorough => given,
        _ => usize::MAX,
    };
    let k = problem.terms as f64;
    let value_of = |log_det: f64| ((log_det - optimum.bound) / k).exp();
    let starts: Vec<Option<(F::State<'_>, usize, bool)>> = (0..settings.starts)
        .into_par_iter()
        .map(|start| {
            if start > 0 && control.stop() {
                return None;
            }
            let mut rng = generator(settings.seed, start as u64);
            let design = if thorough {
                rounded_design(&pool, &weights, free, &mut rng)
            } else {
                random_design(&pool, free, &mut rng)
            };
            let mut state = F::start(&pool, design)
                .or_else(|| F::start(&pool, spanning_design(&pool, free, &mut rng)))?;
            let (swaps, complete) = match settings.method {
                Method::Fedorov => fedorov::descend(&mut state, limit, control),
                _ => rowwise::descend(&mut state, &mut rng, limit, control),
            };
            let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
            control.report(finished, total, value_of(state.log_det()));
            Some((state, swaps, complete))
        })
        .collect();
    let mut swaps: usize = starts.iter().flatten().map(|s| s.1).sum();
    let mut ranked: Vec<(F::State<'_>, bool)> = starts
        .into_iter()
        .flatten()
        .map(|(state, _, complete)| (state, complete))
        .collect();
    // Stable: equal values keep the order of the starts.
    ranked.sort_by(|a, b| b.0.log_det().total_cmp(&a.0.log_det()));
    if !thorough {
        let (best, complete) = ranked.into_iter().next()?;
        let design = best.design().iter().map(|&c| pool.ids[c]).collect();
        return Some(Found {
            design,
            log_det: best.log_det(),
            swaps,
            complete,
        });
    }
    ranked.truncate(CHAINS);
    let mut chains: Vec<F::State<'_>> = ranked.into_iter().map(|(state, _)| state).collect();
    while chains.len() < CHAINS {
        chains.push(chains.first()?.clone());
    }
    let mut generators: Vec<ChaCha8Rng> = (0..CHAINS)
        .map(|c| generator(settings.seed, u64::MAX - c as u64))
        .collect();
    let round = chain_steps.div_ceil(ROUNDS).clamp(1, LONGEST_ROUND);
    let mut left = chain_steps;
    while left > 0 && !control.stop() {
        let steps = round.min(left);
        left -= steps;
        swaps += chains
            .par_iter_mut()
            .zip(generators.par_iter_mut())
            .map(|(best, rng)| {
                let mut work = best.clone();
                let mut swaps = 0;
                for part in 0..steps.div_ceil(PART) {
                    let size = PART.min(steps - part * PART);
                    swaps += iterate(best, &mut work, pool.len(), rng, size, control).swaps;
                    let finished = done.fetch_add(size, Ordering::Relaxed) + size;
                    control.report(finished, total, value_of(best.log_det()));
                    if control.stop() {
                        break;
                    }
                }
                swaps
            })
            .sum::<usize>();
        share_best(&mut chains);
    }
    let best = chains
        .into_iter()
        .reduce(|a, b| if b.log_det() > a.log_det() { b } else { a })?;
    let design: Vec<usize> = best.design().iter().map(|&c| pool.ids[c]).collect();
    let (design, log_det, more) = polish::<F>(problem, settings, everyone, design, best.log_det());
    Some(Found {
        design,
        log_det,
        swaps: swaps + more,
        complete: left == 0,
    })
}

/// Disturbances in each chain that take about [`DEFAULT_WORK`].
fn default_iterations(pool: &Pool<'_>, free: usize) -> usize {
    let (b, k) = (pool.problem.block as f64, pool.problem.terms as f64);
    let (rows, width) = (free as f64, pool.len() as f64);
    let one = if pool.problem.block == 1 {
        15.0 * width * (rows + k)
    } else {
        2.0 * rows * width * b * b * k
    };
    (DEFAULT_WORK / one / CHAINS as f64).clamp(5.0, 1e5) as usize
}

/// The worst chain goes on from the best one's design.
fn share_best<S: State>(chains: &mut [S]) {
    let value = |i: usize| chains[i].log_det();
    let best = (0..chains.len()).max_by(|&a, &b| value(a).total_cmp(&value(b)).then(b.cmp(&a)));
    let worst = (0..chains.len()).min_by(|&a, &b| value(a).total_cmp(&value(b)).then(b.cmp(&a)));
    if let (Some(best), Some(worst)) = (best, worst)
        && best != worst
    {
        let copy = chains[best].clone();
        chains[worst].copy_from(&copy);
    }
}

/// A last descent over all candidates, those not promising included.
fn polish<F: Family>(
    problem: &Problem,
    settings: &DSettings,
    everyone: Vec<usize>,
    design: Vec<usize>,
    log_det: f64,
) -> (Vec<usize>, f64, usize) {
    let mut position = vec![usize::MAX; problem.poses];
    for (p, &i) in everyone.iter().enumerate() {
        position[i] = p;
    }
    let pool = Pool::new(problem, everyone, settings.replicates);
    let start = design.iter().map(|&i| position[i]).collect();
    let Some(mut state) = F::start(&pool, start) else {
        return (design, log_det, 0);
    };
    let mut rng = generator(settings.seed, u64::MAX / 2);
    let (swaps, _) = rowwise::descend(&mut state, &mut rng, design.len() + 100, &Control::new());
    (
        state.design().iter().map(|&c| pool.ids[c]).collect(),
        state.log_det(),
        swaps,
    )
}

/// Disturbances between two looks at the clock by the progress report.
const PART: usize = 50;
/// Times at which the chains share their best design.
const ROUNDS: usize = 10;
/// Disturbances between two such times at most.
const LONGEST_ROUND: usize = 500;

/// Generator of one start or chain: the same whatever thread runs it.
pub(crate) fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}
