//! The search for the best design of a model, for all criteria but G.

use std::sync::atomic::{AtomicUsize, Ordering};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rayon::prelude::*;

use super::settings::{CHAINS, DSettings, Design, Method};
use crate::certificate::{CertificateSettings, Continuous, continuous};
use crate::exchange::pool::Pool;
use crate::exchange::search::iterate;
use crate::exchange::{
    BlockState, CrossState, State, TraceState, fedorov, random_design, rounded_design, rowwise,
    spanning_design,
};
use crate::problem::Objective;
use crate::{Control, DesignError, Problem, Status};

/// A design of `problem` and its bound; `measured` rows add to those of the design.
pub(crate) fn search(
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
    // The bound is part of the result: it is computed even without time.
    let optimum = continuous(
        problem,
        free,
        cap,
        &CertificateSettings::default(),
        &control.without_deadline(),
    )
    .map_err(|_| singular(problem, settings))?;
    search_near(problem, settings, measured, &optimum, control)
}

/// [`search`] with a known continuous optimum.
pub(crate) fn search_near(
    problem: &Problem,
    settings: &DSettings,
    measured: usize,
    optimum: &Continuous,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    let free = settings.n - settings.include.len();
    let width = width_of(problem, settings, optimum, free);
    check_room(settings.starts, free, width)?;
    let best = match (&problem.objective, problem.block) {
        // Nothing is left to choose: the included poses are the design.
        _ if free == 0 => problem
            .regular_inverse(&problem.fixed)
            .map(|_| SearchResult {
                design: Vec::new(),
                merit: optimum.merit,
                swaps: 0,
                complete: true,
            }),
        (Objective::Trace(_) | Objective::Compound { .. }, _) => {
            run::<Linear>(problem, settings, optimum, free, control)
        }
        (Objective::Determinant, 1) => run::<Single>(problem, settings, optimum, free, control),
        (Objective::Determinant, _) => run::<Several>(problem, settings, optimum, free, control),
    };
    let Some(best) = best else {
        return Err(singular(problem, settings));
    };
    let k = problem.terms as f64;
    let rows = settings.n as f64 + measured as f64 / problem.block as f64;
    let scaled = |merit: f64| match problem.objective {
        Objective::Determinant => (merit + problem.shift) / k - rows.ln(),
        Objective::Trace(_) => (-merit / k).exp(),
        Objective::Compound { share, .. } => {
            (merit + share * problem.shift) / k - share * rows.ln()
        }
    };
    let mut indices = best.design;
    indices.extend(&settings.include);
    indices.sort_unstable();
    // By rounding the best possible design may be slightly above its bound.
    let bound = optimum.bound.max(best.merit);
    let gap = (bound - best.merit) / k;
    let (value, bound) = (scaled(best.merit), scaled(bound));
    let status = if control.cancelled() {
        Status::Interrupted
    } else if best.complete && (gap < 1e-9 || settings.method != Method::Search) {
        Status::Converged
    } else {
        Status::Budget
    };
    Ok(Design {
        indices,
        value,
        bound,
        efficiency: (-gap).exp(),
        exchanges: best.swaps,
        status,
        gap: optimum.gap / k,
    })
}

/// Most numbers that the starts of a search keep: 4 GB in single precision.
const MOST_NUMBERS: usize = 1_000_000_000;

/// Refuses a search that keeps too many numbers: `width` for each of n poses of each start.
pub(crate) fn check_room(starts: usize, n: usize, width: usize) -> Result<(), DesignError> {
    let numbers = n.saturating_mul(width).saturating_mul(starts);
    if numbers <= MOST_NUMBERS {
        return Ok(());
    }
    Err(DesignError::TooBig {
        starts,
        n,
        width,
        numbers,
        most: MOST_NUMBERS,
    })
}

/// Numbers that the search keeps for each pose.
fn width_of(problem: &Problem, settings: &DSettings, optimum: &Continuous, free: usize) -> usize {
    let available = problem.available.iter().filter(|a| **a).count();
    let pool = match settings.method {
        Method::Search => {
            let support = optimum.weights.iter().filter(|w| **w > 0.0).count();
            available.min(promising(support, free))
        }
        _ => available,
    };
    pool.max(problem.block * problem.terms)
}

/// No regular design of this size.
pub(crate) fn singular(problem: &Problem, settings: &DSettings) -> DesignError {
    DesignError::Singular {
        n: settings.n,
        terms: problem.terms,
    }
}

/// Outcome of a search.
struct SearchResult {
    design: Vec<usize>,
    merit: f64,
    swaps: usize,
    complete: bool,
}

/// Candidates that the continuous optimum uses or nearly uses.
fn promising_candidates(problem: &Problem, optimum: &Continuous, free: usize) -> Vec<usize> {
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
    order.truncate(promising(support, free));
    order.sort_unstable();
    order
}

/// Number of promising candidates for a continuous optimum of `support` poses.
fn promising(support: usize, free: usize) -> usize {
    (support + support / 2).max(free.saturating_mul(3)).max(64)
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

/// Any poses, for the criteria that are traces.
struct Linear;

impl Family for Linear {
    type State<'a> = TraceState<'a>;
    fn start<'a>(pool: &'a Pool<'a>, design: Vec<usize>) -> Option<TraceState<'a>> {
        TraceState::new(pool, design)
    }
}

fn run<F: Family>(
    problem: &Problem,
    settings: &DSettings,
    optimum: &Continuous,
    free: usize,
    control: &Control<'_>,
) -> Option<SearchResult> {
    let available: Vec<usize> = (0..problem.poses)
        .filter(|&i| problem.available[i])
        .collect();
    let thorough = settings.method == Method::Search;
    let ids = if thorough {
        promising_candidates(problem, optimum, free)
    } else {
        available.clone()
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
        // Far above what a descent takes: gains that are rounding could go round for ever.
        _ => 1000 * free + 10_000,
    };
    let k = problem.terms as f64;
    let efficiency = |merit: f64| ((merit - optimum.bound) / k).exp();
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
            control.report(finished, total, efficiency(state.merit()));
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
    ranked.sort_by(|a, b| b.0.merit().total_cmp(&a.0.merit()));
    if !thorough {
        let (best, complete) = ranked.into_iter().next()?;
        let design = best.design().iter().map(|&c| pool.ids[c]).collect();
        return Some(SearchResult {
            design,
            merit: best.merit(),
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
                    control.report(finished, total, efficiency(best.merit()));
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
        .reduce(|a, b| if b.merit() > a.merit() { b } else { a })?;
    let design: Vec<usize> = best.design().iter().map(|&c| pool.ids[c]).collect();
    let found = (design, best.merit());
    let (design, merit, more) = polish::<F>(problem, settings, available, found, control);
    Some(SearchResult {
        design,
        merit,
        swaps: swaps + more,
        complete: left == 0,
    })
}

/// Work of the default budget, in multiplications: some 5000 disturbances in each chain for
/// 200 of 1700 poses and 84 terms, a few seconds on two threads.
const DEFAULT_WORK: f64 = 5e10;

/// Disturbances in each chain that take about [`DEFAULT_WORK`].
fn default_iterations(pool: &Pool<'_>, free: usize) -> usize {
    let (b, k) = (pool.problem.block as f64, pool.problem.terms as f64);
    let (rows, width) = (free as f64, pool.len() as f64);
    let one = match (&pool.problem.objective, pool.problem.block) {
        (Objective::Trace(_) | Objective::Compound { .. }, _) => {
            4.0 * rows * width * b * b * k + 20.0 * width * b * k * k
        }
        (Objective::Determinant, 1) => 15.0 * width * (rows + k),
        (Objective::Determinant, _) => 2.0 * rows * width * b * b * k,
    };
    (DEFAULT_WORK / one / CHAINS as f64).clamp(5.0, 1e5) as usize
}

/// Copies the best chain over the worst.
fn share_best<S: State>(chains: &mut [S]) {
    let value = |i: usize| chains[i].merit();
    let best = (0..chains.len()).max_by(|&a, &b| value(a).total_cmp(&value(b)).then(b.cmp(&a)));
    let worst = (0..chains.len()).min_by(|&a, &b| value(a).total_cmp(&value(b)).then(b.cmp(&a)));
    if let (Some(best), Some(worst)) = (best, worst)
        && best != worst
    {
        let copy = chains[best].clone();
        chains[worst].copy_from(&copy);
    }
}

/// A last descent over all candidates.
fn polish<F: Family>(
    problem: &Problem,
    settings: &DSettings,
    available: Vec<usize>,
    (design, merit): (Vec<usize>, f64),
    control: &Control<'_>,
) -> (Vec<usize>, f64, usize) {
    let mut position = vec![usize::MAX; problem.poses];
    for (p, &i) in available.iter().enumerate() {
        position[i] = p;
    }
    let pool = Pool::new(problem, available, settings.replicates);
    let start = design.iter().map(|&i| position[i]).collect();
    let Some(mut state) = F::start(&pool, start) else {
        return (design, merit, 0);
    };
    let mut rng = generator(settings.seed, u64::MAX / 2);
    let limit = design.len() + 100;
    let (swaps, _) = rowwise::descend(&mut state, &mut rng, limit, &control.without_deadline());
    (
        state.design().iter().map(|&c| pool.ids[c]).collect(),
        state.merit(),
        swaps,
    )
}

/// Disturbances between two reports of progress.
const PART: usize = 50;
/// Number of times at which the chains share their best design.
const ROUNDS: usize = 10;
/// Most disturbances between two such times.
const LONGEST_ROUND: usize = 500;

/// Random generator of one start or chain, independent of the thread.
pub(crate) fn generator(seed: u64, stream: u64) -> ChaCha8Rng {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(stream);
    rng
}
