//! Many load cases, each from a guess by the ones solved before.
//!
//! Cases are solved in groups; every case of a group starts from the same [`Guess`],
//! learned from all groups before it, and knows nothing of its neighbours in the group.
//! Groups depend on the cases alone, so the number of threads changes nothing, not even
//! the last bit.

use super::newton::Workspace;
use super::{Fem, Guess, Load, Watch};
use crate::FemError;
use crate::result::{CaseResult, Status};
use crate::rod::Rod;
use ecm_se3::Pose;
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

/// First group; every further one doubles what is solved.
const FIRST: usize = 16;

/// What is learned from at most; more changes little and needs memory.
const LEARNED: usize = 1024;

/// A load case: its result, and its state for [`Fem::learn`].
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result.
    pub result: CaseResult,
    /// Pose, displacements and pressures of the result's state on its bent axis.
    pub field: Vec<f32>,
}

impl Outcome {
    /// Whether `field` is an equilibrium under the result's wrench: where the case was
    /// solved, and where the last stable state before a loss of stability is known.
    pub fn is_state(&self) -> bool {
        matches!(self.result.status, Status::Solved | Status::Unstable)
    }
}

/// Called with row and outcome of each load case as soon as it is done, on its thread.
pub type Finished<'a> = &'a (dyn Fn(usize, &Outcome) + Sync);

impl Fem {
    /// Solves all loads (all wrenches or all poses) on rayon's current pool, learning from
    /// the solved ones; one result per load, in their order. The first wrenches begin at rest,
    /// the first poses where the tangent at rest puts them.
    ///
    /// # Errors
    /// A load that is not finite, with its row.
    pub fn solve_all(&self, loads: &[Load], watch: Watch) -> Result<Vec<CaseResult>, FemError> {
        self.check_loads(loads)?;
        let points: Vec<_> = loads.par_iter().map(|load| self.point(load)).collect();
        let order = farthest_first(&points);
        let mut outcomes: Vec<Option<Outcome>> = vec![None; loads.len()];
        let mut guess = match loads.first() {
            Some(Load::Pose(_)) => self.linear_guess(),
            _ => None,
        };
        let mut done = 0;
        while done < order.len() {
            let group = &order[done..order.len().min((2 * done).max(FIRST))];
            let found = self.solve_group(loads, group, guess.as_ref(), watch, &|_, _| {});
            for (&case, outcome) in group.iter().zip(found) {
                outcomes[case] = Some(outcome);
            }
            done += group.len();
            if done < order.len() && done <= LEARNED {
                let known: Vec<&Outcome> = (order[..done].iter())
                    .filter_map(|&i| outcomes[i].as_ref())
                    .filter(|o| o.is_state())
                    .collect();
                let equilibrium = |o: &&Outcome| match loads[0] {
                    Load::Wrench(_) => Load::Wrench(o.result.wrench),
                    Load::Pose(_) => Load::Pose(o.result.pose),
                };
                let loads: Vec<Load> = known.iter().map(equilibrium).collect();
                let fields: Vec<&[f32]> = known.iter().map(|o| o.field.as_slice()).collect();
                guess = self.learn(&loads, &fields)?.or(guess);
            }
        }
        Ok(outcomes.into_iter().flatten().map(|o| o.result).collect())
    }

    /// Solves all loads on rayon's current pool, each by itself from the same guess, or
    /// without one from rest.
    ///
    /// # Errors
    /// A load that is not finite, with its row; a guess of another body.
    pub fn solve_from(
        &self,
        loads: &[Load],
        guess: Option<&Guess>,
        watch: Watch,
        finished: Finished,
    ) -> Result<Vec<Outcome>, FemError> {
        self.check_loads(loads)?;
        guess.map_or(Ok(()), |guess| self.check_guess(guess))?;
        let all: Vec<usize> = (0..loads.len()).collect();
        Ok(self.solve_group(loads, &all, guess, watch, finished))
    }

    /// A guess from states and the loads at which they are equilibria, all wrenches or all
    /// poses; `None` when they are too few.
    ///
    /// # Errors
    /// A load that is not finite, fields that are not as many, or of another length than
    /// this body's.
    pub fn learn(&self, loads: &[Load], fields: &[&[f32]]) -> Result<Option<Guess>, FemError> {
        self.check_loads(loads)?;
        let size = |what, found, expected, why| FemError::Size {
            what,
            found,
            expected,
            why,
        };
        if fields.len() != loads.len() {
            return Err(size("fields", fields.len(), loads.len(), "one per load"));
        }
        let length = self.field_length();
        if let Some(field) = fields.iter().find(|f| f.len() != length) {
            return Err(size(
                "a field",
                field.len(),
                length,
                "this body's states have as many",
            ));
        }
        let points: Vec<_> = loads.par_iter().map(|load| self.point(load)).collect();
        let samples: Vec<_> = points.iter().zip(fields.iter().copied()).collect();
        Ok(Guess::fit(&samples))
    }

    /// Poses that a guess expects, far cheaper than to solve for them.
    ///
    /// # Errors
    /// As [`Fem::solve_from`].
    pub fn guessed_poses(&self, loads: &[Load], guess: &Guess) -> Result<Vec<[f64; 6]>, FemError> {
        self.check_loads(loads)?;
        self.check_guess(guess)?;
        Ok(loads
            .par_iter()
            .map(|load| guess.pose(&self.point(load)))
            .collect())
    }

    fn check_guess(&self, guess: &Guess) -> Result<(), FemError> {
        let (found, expected) = (guess.field_length(), self.field_length());
        if found == expected {
            return Ok(());
        }
        let why = "a guess serves the body it was learned from";
        Err(FemError::Size {
            what: "the guess's field",
            found,
            expected,
            why,
        })
    }

    /// Values in a flat field.
    pub fn field_length(&self) -> usize {
        self.flatten(&self.rest()).len()
    }

    fn check_loads(&self, loads: &[Load]) -> Result<(), FemError> {
        (loads.iter().enumerate()).try_for_each(|(row, load)| self.check_load(row, load))
    }

    fn solve_group(
        &self,
        loads: &[Load],
        group: &[usize],
        guess: Option<&Guess>,
        watch: Watch,
        finished: Finished,
    ) -> Vec<Outcome> {
        let spare: Mutex<Vec<Workspace>> = Mutex::new(Vec::new());
        // One case at a time: a creased one costs ten times a solved one.
        group
            .par_iter()
            .with_max_len(1)
            .map(|&case| {
                let mut work = take(&spare).unwrap_or_else(|| Workspace::new(self));
                let outcome = self.solve_case(&mut work, &loads[case], guess, watch);
                give(&spare, work);
                finished(case, &outcome);
                if let Some(counter) = watch.done {
                    counter.fetch_add(1, Ordering::Relaxed);
                }
                outcome
            })
            .collect()
    }

    fn solve_case(
        &self,
        work: &mut Workspace,
        load: &Load,
        guess: Option<&Guess>,
        watch: Watch,
    ) -> Outcome {
        if watch.cancelled() {
            let result = CaseResult {
                status: Status::Cancelled,
                ..self.result_at_rest().clone()
            };
            return Outcome {
                result,
                field: Vec::new(),
            };
        }
        let (result, state) = match guess {
            Some(guess) => self.solve_guessed(work, load, guess, watch),
            None => self.follow_from_rest(work, load, watch),
        };
        let field = self.flatten(&state);
        Outcome { result, field }
    }

    pub(super) fn result_at_rest(&self) -> &CaseResult {
        self.at_rest.get_or_init(|| {
            let load = Load::Wrench([0.0; 6]);
            self.follow_from_rest(&mut Workspace::new(self), &load, Watch::default())
                .0
        })
    }

    /// Mid-frame coordinates (c / L, θ) of a load's pose; for a wrench, of the pose that
    /// the rod with this body's stiffness at rest takes. Over them states are nearly
    /// linear, over wrenches they are not.
    pub(super) fn point(&self, load: &Load) -> [f64; 6] {
        let length = self.body.mesh.length_m();
        let pose = match load {
            Load::Wrench(h) => {
                Rod::like(&self.result_at_rest().stiffness, length)
                    .pose(h)
                    .0
            }
            Load::Pose(p) => *p,
        };
        let q = ecm_se3::mid_frame::coordinates(&Pose::from_array(&pose), length);
        std::array::from_fn(|k| if k < 3 { q[k] / length } else { q[k] })
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

/// The case nearest to rest (the origin), then always the one farthest from all before it:
/// any first part of the order covers the whole range.
fn farthest_first(points: &[[f64; 6]]) -> Vec<usize> {
    let mut gap: Vec<f64> = points
        .iter()
        .map(|p| square_distance(p, &[0.0; 6]))
        .collect();
    let mut order = Vec::with_capacity(points.len());
    let mut left: Vec<usize> = (0..points.len()).collect();
    let mut next = (left.iter().copied()).min_by(|&a, &b| gap[a].total_cmp(&gap[b]));
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
    order
}
