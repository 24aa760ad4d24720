//! Many load cases, each from a guess by the solved ones, or its nearest neighbour.
//!
//! The cases are sorted so that every case is far from all before it (farthest point
//! first, beginning next to rest), and solved in waves: all cases of a wave start from
//! states of earlier waves. Waves depend on the cases alone, so the number of threads
//! changes nothing, not even the last bit.

use super::newton::Workspace;
use super::predict::{Predictor, degree_for};
use super::{Fem, Load, State, Watch};
use crate::FemError;
use crate::assembly::Field;
use crate::platform::Platform;
use crate::result::{CaseResult, Status};
use crate::rod::Rod;
use ecm_se3::Pose;
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

/// Largest wave; early waves hold a quarter of what is solved before them.
const WAVE: usize = 64;

/// Smallest load step from a neighbour, as a share of the way; below, the way from rest is taken.
const NEIGHBOUR_STEP: f64 = 0.25;

/// A solved state; single precision is ample for a start.
pub(super) struct Solved {
    displacement: Vec<f32>,
    pressure: Vec<f32>,
    platform: Platform,
    load: Load,
}

impl Solved {
    fn new(state: &State, load: Load) -> Self {
        let narrow = |v: &[f64]| v.iter().map(|&x| x as f32).collect();
        Self {
            displacement: narrow(&state.field.displacement),
            pressure: narrow(&state.field.pressure),
            platform: state.platform,
            load,
        }
    }

    /// Pose, displacements and pressures one after the other.
    pub(super) fn components(&self) -> impl Iterator<Item = f64> + '_ {
        let field = self.displacement.iter().chain(&self.pressure);
        self.platform
            .pose()
            .into_iter()
            .chain(field.map(|&x| f64::from(x)))
    }

    fn state(&self) -> State {
        let wide = |v: &[f32]| v.iter().map(|&x| f64::from(x)).collect();
        State {
            field: Field {
                displacement: wide(&self.displacement),
                pressure: wide(&self.pressure),
            },
            platform: self.platform,
        }
    }
}

/// Where a case may start from, best first.
struct Starts<'a> {
    guess: Option<State>,
    neighbour: Option<&'a Solved>,
    rest: &'a CaseResult,
}

impl Fem {
    /// Solves all loads (all wrenches or all poses) on rayon's current pool; one
    /// result per load, in their order.
    ///
    /// # Errors
    /// A load that is not finite, with its row.
    pub fn solve_all(&self, loads: &[Load], watch: Watch) -> Result<Vec<CaseResult>, FemError> {
        for (row, load) in loads.iter().enumerate() {
            self.check_load(row, load)?;
        }
        let (rest_result, _) = self.follow_from_rest(
            &mut Workspace::new(self),
            &Load::Wrench([0.0; 6]),
            Watch::default(),
        );
        let points = self.points(loads, &rest_result);
        let (order, nearest) = farthest_first(&points);
        let spare: Mutex<Vec<Workspace>> = Mutex::new(Vec::new());
        let mut solved: Vec<Option<Solved>> = loads.iter().map(|_| None).collect();
        let mut results: Vec<Option<CaseResult>> = vec![None; loads.len()];
        let mut predictor: Option<Predictor> = None;
        let mut done = 0;
        while done < order.len() {
            let wave = &order[done..order.len().min(done + (done / 4).clamp(1, WAVE))];
            let known: Vec<_> = order[..done]
                .iter()
                .filter_map(|&i| solved[i].as_ref().map(|state| (&points[i], state)))
                .collect();
            // A new fit when the degree can rise or half as many cases again are known.
            let used = predictor.as_ref().map_or(0, |p| p.cases);
            if degree_for(known.len()) > degree_for(used) || 2 * known.len() > 3 * used {
                predictor = Predictor::fit(&known).or(predictor);
            }
            let outcome: Vec<(CaseResult, Option<Solved>)> = wave
                .par_iter()
                .map(|&case| {
                    let mut work = take(&spare).unwrap_or_else(|| Workspace::new(self));
                    let start =
                        self.nearest_solved(case, &order[..done], &points, &solved, &nearest);
                    let guess = predictor.as_ref().map(|p| p.state(&points[case], self));
                    let starts = Starts {
                        guess,
                        neighbour: start,
                        rest: &rest_result,
                    };
                    let outcome = self.solve_case(&mut work, &loads[case], starts, watch);
                    give(&spare, work);
                    if let Some(counter) = watch.done {
                        counter.fetch_add(1, Ordering::Relaxed);
                    }
                    outcome
                })
                .collect();
            for (&case, (result, state)) in wave.iter().zip(outcome) {
                results[case] = Some(result);
                solved[case] = state;
            }
            done += wave.len();
        }
        Ok(results.into_iter().flatten().collect())
    }

    /// Mid-frame coordinates (c / L, θ) of each load's pose; for a wrench, of the pose that
    /// the rod with this body's stiffness at rest takes. Over them states are nearly
    /// linear, over wrenches they are not.
    fn points(&self, loads: &[Load], rest: &CaseResult) -> Vec<[f64; 6]> {
        let length = self.body.mesh.length_m();
        let rod = Rod::like(&rest.stiffness, length);
        loads
            .par_iter()
            .map(|load| {
                let pose = match load {
                    Load::Wrench(h) => rod.pose(h).0,
                    Load::Pose(p) => *p,
                };
                let q = ecm_se3::mid_frame::coordinates(&Pose::from_array(&pose), length);
                std::array::from_fn(|k| if k < 3 { q[k] / length } else { q[k] })
            })
            .collect()
    }

    fn nearest_solved<'a>(
        &self,
        case: usize,
        earlier: &[usize],
        points: &[[f64; 6]],
        solved: &'a [Option<Solved>],
        from_rest: &[f64],
    ) -> Option<&'a Solved> {
        let mut best = (from_rest[case], None);
        for &other in earlier {
            if let Some(state) = &solved[other] {
                let d = square_distance(&points[case], &points[other]);
                if d < best.0 {
                    best = (d, Some(state));
                }
            }
        }
        best.1
    }

    fn solve_case(
        &self,
        work: &mut Workspace,
        load: &Load,
        starts: Starts,
        watch: Watch,
    ) -> (CaseResult, Option<Solved>) {
        if watch.cancel.is_some_and(|c| c.load(Ordering::Relaxed)) {
            let result = CaseResult {
                status: Status::Cancelled,
                ..starts.rest.clone()
            };
            return (result, None);
        }
        let (mut spent, mut guess_failed) = (0, false);
        if let Some(guess) = starts.guess {
            let (result, state) = self.jump(work, guess, load, watch);
            match result {
                Ok(result) => return (result, Some(Solved::new(&state, *load))),
                Err(iterations) => {
                    spent += iterations;
                    guess_failed = true;
                }
            }
        }
        if let Some(solved) = starts.neighbour.filter(|_| !guess_failed) {
            let (mut result, state) = self.follow(
                work,
                solved.state(),
                &solved.load,
                load,
                (1.0, NEIGHBOUR_STEP),
                watch,
            );
            if matches!(result.status, Status::Solved | Status::Cancelled) {
                result.iterations += spent;
                let keep = (result.status == Status::Solved).then(|| Solved::new(&state, *load));
                return (result, keep);
            }
            spent += result.iterations;
        }
        // What is lost on the way from a neighbour is told from rest, along proportional load.
        let (mut result, state) = if spent > 0 {
            self.follow_in_halves(work, load, watch)
        } else {
            self.follow_from_rest(work, load, watch)
        };
        result.iterations += spent;
        let keep = (result.status == Status::Solved).then(|| Solved::new(&state, *load));
        (result, keep)
    }
}

fn take(spare: &Mutex<Vec<Workspace>>) -> Option<Workspace> {
    spare.lock().ok()?.pop()
}

fn give(spare: &Mutex<Vec<Workspace>>, work: Workspace) {
    if let Ok(mut list) = spare.lock() {
        list.push(work);
    }
}

fn square_distance(a: &[f64; 6], b: &[f64; 6]) -> f64 {
    (0..6).map(|k| (a[k] - b[k]).powi(2)).sum()
}

/// Farthest-point order after rest (the origin), and each point's square distance to rest.
fn farthest_first(points: &[[f64; 6]]) -> (Vec<usize>, Vec<f64>) {
    let from_rest: Vec<f64> = points
        .iter()
        .map(|p| square_distance(p, &[0.0; 6]))
        .collect();
    let mut order = Vec::with_capacity(points.len());
    let mut gap = from_rest.clone();
    let mut left: Vec<usize> = (0..points.len()).collect();
    // The first case is the one nearest to rest: the shortest way from there.
    let first = left
        .iter()
        .copied()
        .min_by(|&a, &b| from_rest[a].total_cmp(&from_rest[b]));
    let mut next = first;
    while let Some(case) = next {
        order.push(case);
        left.retain(|&i| i != case);
        for &i in &left {
            gap[i] = gap[i].min(square_distance(&points[i], &points[case]));
        }
        next = left
            .iter()
            .copied()
            .max_by(|&a, &b| gap[a].total_cmp(&gap[b]).then(b.cmp(&a)));
    }
    (order, from_rest)
}
