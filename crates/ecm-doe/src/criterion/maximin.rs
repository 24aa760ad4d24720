//! Maximin designs: the largest smallest distance between two chosen points.

use std::sync::atomic::{AtomicUsize, Ordering};

use rayon::prelude::*;

use super::search::{check_room, generator};
use super::settings::{Design, apply_lists, check_starts};
use crate::budget::on_threads;
use crate::problem::{check_blocks, check_sizes};
use crate::spacing::cover::cover_bound;
use crate::spacing::neighbours::{Neighbours, box_diagonal, farthest_points};
use crate::spacing::simple;
use crate::spacing::threshold::Chain;
use crate::{Control, DesignError, Status};

/// Algorithm of the search for a space-filling design.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum SpacingMethod {
    /// Exchange of a point of the closest pair (the paper's), the best of all starts.
    Exchange,
    /// Threshold search on the conflict graph.
    #[default]
    Search,
}

/// Settings of [`maximin`].
#[derive(Debug, Clone)]
pub struct MaximinSettings {
    /// Design size, with the included points and without those measured before.
    pub n: usize,
    /// Starts: of the exchange, or farthest-point designs of which the search takes the best.
    pub starts: usize,
    /// Search: thousands of swaps in each of the four chains; 0: default.
    pub iterations: usize,
    /// Seed of the random generator.
    pub seed: u64,
    /// Worker threads, 0 for all; no influence on the result.
    pub threads: usize,
    /// Algorithm.
    pub method: SpacingMethod,
    /// Candidates that must be in the design.
    pub include: Vec<usize>,
    /// Candidates that must not be chosen.
    pub exclude: Vec<usize>,
    /// Points already measured, any number x columns: the design keeps away from them and does not choose them again.
    pub measured: Vec<f64>,
}

impl Default for MaximinSettings {
    fn default() -> Self {
        Self {
            n: 0,
            starts: 10,
            iterations: 0,
            seed: 0,
            threads: 0,
            method: SpacingMethod::Search,
            include: Vec::new(),
            exclude: Vec::new(),
            measured: Vec::new(),
        }
    }
}

/// Chains of the search; a constant, so that threads do not change the result.
pub const CHAINS: usize = 4;
/// Most thousands of swaps per chain by default.
pub const DEFAULT_ITERATIONS: usize = 3000;
/// Most distances that thinning computes.
const THINNING_WORK: usize = 2_000_000_000;
/// More candidates than this are first thinned to a farthest-point subset.
pub const MOST_CANDIDATES: usize = 6000;

/// The `settings.n` points whose closest two are farthest apart (Euclid, coordinates as given).
///
/// # Arguments
/// - `points`: N x columns row-major; scale the columns beforehand
///
/// # Errors
/// Wrong input: shape, numbers that are not finite, n below 2 or above the candidates,
/// contradictory lists.
///
/// ```
/// use ecm_doe::{Control, MaximinSettings, maximin};
/// # fn main() -> Result<(), ecm_doe::DesignError> {
/// // Three of eleven points on a line: both ends and the middle.
/// let line: Vec<f64> = (0..11).map(f64::from).collect();
/// let settings = MaximinSettings { n: 3, ..MaximinSettings::default() };
/// let design = maximin(&line, 1, &settings, &Control::new())?;
/// assert_eq!(design.indices, [0, 5, 10]);
/// assert_eq!(design.value, 5.0);
/// # Ok(()) }
/// ```
pub fn maximin(
    points: &[f64],
    columns: usize,
    settings: &MaximinSettings,
    control: &Control<'_>,
) -> Result<Design, DesignError> {
    if columns == 0 || points.is_empty() {
        return Err(DesignError::Empty);
    }
    for (what, values) in [
        ("the points", points),
        ("the measured points", &settings.measured),
    ] {
        check_blocks(what, values, columns)?;
        check_sizes(what, values, columns, 0.0)?;
    }
    check_starts(settings.starts)?;
    let least = if settings.measured.is_empty() { 2 } else { 1 };
    if settings.n < least {
        return Err(DesignError::Small {
            n: settings.n,
            least,
            criterion: "maximin",
        });
    }
    let mut available = vec![true; points.len() / columns];
    apply_lists(
        &mut available,
        settings.n,
        &settings.include,
        &settings.exclude,
        false,
    )?;
    let size = settings.n.saturating_add(settings.measured.len() / columns);
    check_room(settings.starts, size, 1)?;
    on_threads(settings.threads, || {
        search(points, columns, &available, settings, control)
    })
}

/// The points of the search: first the fixed points, then candidates.
struct Field {
    /// Times the power of two that makes the largest coordinate about 1, so that neither large nor
    /// small coordinates lose their squares.
    points: Vec<f64>,
    /// Row of the candidates, or `usize::MAX` for a measured point.
    origin: Vec<usize>,
    fixed: usize,
    allowed: Vec<bool>,
    /// Whether candidates were left out: an upper bound must then add their distance to the others.
    covering: f64,
    /// Length that is 1 here.
    unit: f64,
}

fn field(
    points: &[f64],
    columns: usize,
    available: &[bool],
    settings: &MaximinSettings,
    control: &Control<'_>,
) -> Field {
    let at = |i: usize| &points[i * columns..(i + 1) * columns];
    let mut all = settings.measured.clone();
    let mut origin = vec![usize::MAX; all.len() / columns];
    for &i in &settings.include {
        all.extend_from_slice(at(i));
        origin.push(i);
    }
    let fixed = origin.len();
    for i in (0..available.len()).filter(|&i| available[i]) {
        all.extend_from_slice(at(i));
        origin.push(i);
    }
    let largest = all.iter().fold(0.0_f64, |most, v| most.max(v.abs()));
    let power = if largest > 0.0 {
        largest.log2().floor().max(-1000.0) as i32
    } else {
        0
    };
    let shrink = 2.0_f64.powi(-power);
    all.iter_mut().for_each(|v| *v *= shrink);
    let mut covering = 0.0;
    let affordable = (THINNING_WORK / origin.len().max(1)).min(MOST_CANDIDATES);
    let most = affordable
        .min(30 * settings.n)
        .max(1500)
        .max(10 * settings.n)
        + fixed;
    if origin.len() > most {
        let keep: Vec<usize> = (0..fixed).collect();
        let allowed = vec![true; origin.len()];
        let found = farthest_points(&all, columns, most, (&keep, 0), &allowed, control);
        let mut order = found.order;
        order[fixed..].sort_unstable();
        covering = found.left.sqrt();
        all = order
            .iter()
            .flat_map(|&i| all[i * columns..(i + 1) * columns].iter().copied())
            .collect();
        origin = order.iter().map(|&i| origin[i]).collect();
    }
    let mut allowed = vec![true; origin.len()];
    allowed[..fixed].fill(false);
    Field {
        points: all,
        origin,
        fixed,
        allowed,
        covering,
        unit: 2.0_f64.powi(power),
    }
}

fn search(
    points: &[f64],
    columns: usize,
    available: &[bool],
    settings: &MaximinSettings,
    control: &Control<'_>,
) -> Design {
    let field = field(points, columns, available, settings, control);
    let size = settings.n + settings.measured.len() / columns;
    let fixed: Vec<usize> = (0..field.fixed).collect();
    let total = settings.starts;
    let done = AtomicUsize::new(0);
    let starts: Vec<(Vec<usize>, f64, usize, f64)> = (0..settings.starts)
        .into_par_iter()
        .filter(|&s| s == 0 || !control.stop())
        .map(|s| {
            let mut rng = generator(settings.seed, s as u64);
            let first = first_point(&field, s, &mut rng);
            let from = (fixed.as_slice(), first);
            let spread =
                farthest_points(&field.points, columns, size, from, &field.allowed, control);
            let radius = spread.radius();
            let found = match settings.method {
                SpacingMethod::Search => {
                    let distance = spread.distance(&field.points, columns);
                    (spread.order, distance, 0, radius)
                }
                SpacingMethod::Exchange => {
                    let (design, d, swaps) = simple::exchange(
                        &field.points,
                        columns,
                        size,
                        &fixed,
                        &field.allowed,
                        &mut rng,
                        control,
                    );
                    (design, d, swaps, radius)
                }
            };
            let finished = done.fetch_add(1, Ordering::Relaxed) + 1;
            if settings.method == SpacingMethod::Exchange {
                control.report(finished, total, field.unit * found.1.sqrt());
            }
            found
        })
        .collect();
    // Farthest points reach at least half of what is possible (Gonzalez); squared: a quarter.
    let gonzalez = starts
        .iter()
        .map(|s| 4.0 * s.3)
        .fold(box_diagonal(&field.points, columns), f64::min);
    let mut exchanges: usize = starts.iter().map(|s| s.2).sum();
    let best = starts
        .into_iter()
        .reduce(|a, b| if b.1 > a.1 { b } else { a });
    let (mut design, mut distance) = best.map_or((Vec::new(), 0.0), |b| (b.0, b.1));
    // One design alone, or two equal points in every design.
    let settled = size == field.origin.len() || gonzalez == 0.0;
    let mut rng = generator(settings.seed, u64::MAX);
    let top = if settled {
        distance
    } else if size > 1 {
        let reach = gonzalez.min(4.0 * distance).next_up();
        let first = Neighbours::new(&field.points, columns, reach, control);
        let stop = || control.cancelled();
        let high = gonzalez.next_up();
        let limits = (distance.max(1e-300), high);
        cover_bound(
            &first,
            &vec![true; field.origin.len()],
            size - 1,
            limits,
            3,
            &mut rng,
            &stop,
        )
    } else {
        gonzalez
    };
    let complete = !control.stop();
    if settings.method == SpacingMethod::Search && !settled {
        let near = Neighbours::new(&field.points, columns, top.next_up(), control);
        let found = raise_threshold(&near, &field, design, settings, control);
        (design, distance) = (found.0, found.1);
        exchanges += found.2;
    }
    let mut indices: Vec<usize> = design
        .iter()
        .map(|&i| field.origin[i])
        .filter(|&i| i != usize::MAX)
        .collect();
    indices.sort_unstable();
    let value = field.unit * distance.sqrt();
    // Leaving out candidates that are within `covering` of one kept costs at most twice that.
    let bound = (field.unit * (top.sqrt() + 2.0 * field.covering)).max(value);
    let optimal = bound <= value * (1.0 + 1e-12);
    let status = if control.cancelled() {
        Status::Interrupted
    } else if optimal || (complete && settings.method == SpacingMethod::Exchange) {
        Status::Converged
    } else {
        Status::Budget
    };
    let efficiency = if bound > 0.0 { value / bound } else { 1.0 };
    Design {
        indices,
        value,
        bound,
        efficiency,
        exchanges,
        status,
        gap: 0.0,
    }
}

fn first_point(field: &Field, start: usize, rng: &mut rand_chacha::ChaCha8Rng) -> usize {
    use rand::RngExt;
    let count = field.origin.len();
    if count == field.fixed {
        return 0;
    }
    let drawn = rng.random_range(field.fixed..count);
    if start == 0 { field.fixed } else { drawn }
}

/// Threshold search from `design`: (design, squared distance, swaps).
fn raise_threshold(
    near: &Neighbours<'_>,
    field: &Field,
    design: Vec<usize>,
    settings: &MaximinSettings,
    control: &Control<'_>,
) -> (Vec<usize>, f64, usize) {
    let (budget, settles) = match settings.iterations {
        // With a time limit the time is the budget.
        0 if control.timed() => (usize::MAX, false),
        // Without one of the user's own the search ends once it goes on in vain for long.
        0 => (DEFAULT_ITERATIONS, true),
        given => (given, false),
    };
    let moves = budget.saturating_mul(1000);
    let twins = near.twins();
    let mut chains: Vec<Chain<'_>> = (0..CHAINS)
        .map(|c| {
            let rng = generator(settings.seed, u64::MAX - 1 - c as u64);
            Chain::new(
                near,
                &twins,
                design.clone(),
                field.fixed,
                &field.allowed,
                rng,
            )
        })
        .collect();
    let part = moves.div_ceil(ROUNDS).min(LONGEST_ROUND);
    let total = moves.saturating_mul(CHAINS);
    let done = AtomicUsize::new(0);
    let patience = (moves / 16).clamp(100, PATIENCE);
    let mut ends = if settles { LEAST_SWAPS } else { moves };
    let (mut spent, mut round, mut reached) = (0, 0, 0.0);
    while spent < ends && !control.stop() {
        let now = (FIRST_ROUND << round.min(8)).min(part).min(ends - spent);
        round += 1;
        spent += now;
        chains.par_iter_mut().for_each(|chain| {
            chain.run(now, patience, control);
            let finished = done.fetch_add(now, Ordering::Relaxed) + now;
            let best = field.unit * chain.best_distance().sqrt();
            control.report(finished, total, best);
        });
        let best = chains.iter().enumerate().max_by(|a, b| {
            a.1.best_distance()
                .total_cmp(&b.1.best_distance())
                .then(b.0.cmp(&a.0))
        });
        if let Some((_, best)) = best {
            let (design, distance, raise) =
                (best.best().to_vec(), best.best_distance(), best.raise());
            if settles && distance > reached {
                ends = (IN_VAIN * spent).clamp(ends, moves);
            }
            reached = distance;
            for chain in &mut chains {
                chain.adopt(&design, distance, raise);
            }
        }
    }
    let (best, distance) = chains
        .first()
        .map_or((design, 0.0), |c| (c.best().to_vec(), c.best_distance()));
    (best, distance, spent * CHAINS)
}

/// Without a budget the search lasts this many times as long as it took to its best,
const IN_VAIN: usize = 3;
/// and at least this many swaps a chain.
const LEAST_SWAPS: usize = 200_000;
/// Number of times at which the chains share their best design.
const ROUNDS: usize = 40;
/// Swaps before the first such time; then twice as many each time.
const FIRST_ROUND: usize = 4000;
/// Most swaps between two such times.
const LONGEST_ROUND: usize = 100_000;
/// Swaps at one threshold after which it counts as too high.
const PATIENCE: usize = 20_000;
