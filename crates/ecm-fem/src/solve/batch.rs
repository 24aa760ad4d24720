//! Many load cases, warm-started by the cases solved before.
//!
//! Cases are solved in groups. Every case of a group starts from the same [`WarmStart`], which is
//! fitted to all earlier groups; cases of one group do not use each other. Groups depend on the
//! cases only, so the results have the same bits for any number of threads.

use super::newton::Workspace;
use super::{Case, Fem, Load, WarmStart, Watch};
use crate::FemError;
use crate::result::{CaseResult, Status};
use crate::rod::Rod;
use ecm_se3::Pose;
use rayon::prelude::*;
use std::sync::Mutex;
use std::sync::atomic::Ordering;

/// Cases in the first group; every further group doubles the number of solved cases.
const FIRST_GROUP: usize = 16;

/// Most cases to which a warm start is fitted; more change little and need memory.
const MOST_FITTED: usize = 1024;

/// A load case: its result, and its state for [`Fem::fit_warm_start`].
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// The result.
    pub result: CaseResult,
    /// State vector of the result: pose, displacements and pressures in the bent frame.
    pub field: Vec<f32>,
}

impl Outcome {
    /// Whether `field` is an equilibrium under the result's wrench: where the case was
    /// solved, and where the last stable state before a loss of stability is known.
    pub fn is_state(&self) -> bool {
        matches!(self.result.status, Status::Solved | Status::Unstable) && self.result.has_state()
    }
}

/// Called with the row and outcome of each load case when it is finished, on its own thread.
pub type Finished<'a> = &'a (dyn Fn(usize, &Outcome) + Sync);

impl Fem {
    /// Solves all loads (all wrenches or all poses) on rayon's current pool, warm-started by the
    /// solved ones; one result per load, in their order. The first wrenches start at rest, the
    /// first poses at the linear prediction from rest.
    ///
    /// # Errors
    /// A load that is not finite, with its row; wrenches and poses mixed.
    ///
    /// ```
    /// use ecm_fem::{Fem, Load, Mesh, NeoHookean, Quality, Status, Watch};
    /// # fn main() -> Result<(), ecm_fem::FemError> {
    /// let coarse = Quality::Custom {
    ///     rings: 1,
    ///     layers: 3,
    ///     around: 6,
    ///     layer_grading_per_mille: 1000,
    ///     ring_grading_per_mille: 1000,
    /// };
    /// let mesh = Mesh::cylinder(0.1, 0.03, coarse)?;
    /// let fem = Fem::new(mesh, Box::new(NeoHookean::new(1e6, 0.49)?), None)?;
    /// let loads = [5.0, 10.0].map(|f| Load::Wrench([f, 0.0, 0.0, 0.0, 0.0, 0.0]));
    /// let results = fem.solve_all(&loads, Watch::default())?;
    /// assert!(results.iter().all(|r| r.status == Status::Solved));
    /// assert!(results[1].pose[0] > results[0].pose[0]);
    /// # Ok(()) }
    /// ```
    pub fn solve_all<L: Copy + Into<Case>>(
        &self,
        loads: &[L],
        watch: Watch,
    ) -> Result<Vec<CaseResult>, FemError> {
        let loads = &self.checked(loads)?;
        let points = self.points(loads, watch);
        let order = farthest_first(&points, watch);
        let mut outcomes: Vec<Option<Outcome>> = vec![None; loads.len()];
        let amounts = loads.first().map_or(0, |case| case.amounts);
        let mut warm_start = match loads.first().map(|case| case.load) {
            Some(Load::Pose(_)) => self.linear_start(amounts, watch),
            _ => None,
        };
        let mut done = 0;
        while done < order.len() {
            let group = &order[done..order.len().min((2 * done).max(FIRST_GROUP))];
            let solved = self.solve_group(loads, group, warm_start.as_ref(), watch, &|_, _| {});
            for (&case, outcome) in group.iter().zip(solved) {
                outcomes[case] = Some(outcome);
            }
            done += group.len();
            if done < order.len() && done <= MOST_FITTED && !watch.cancelled() {
                let states: Vec<(usize, &Outcome)> = (order[..done].iter())
                    .filter_map(|&i| outcomes[i].as_ref().map(|outcome| (i, outcome)))
                    .filter(|(_, outcome)| outcome.is_state())
                    .collect();
                let equilibrium = |&(i, outcome): &(usize, &Outcome)| {
                    let load = match loads[i].load {
                        Load::Wrench(_) => Load::Wrench(outcome.result.wrench),
                        Load::Pose(_) => Load::Pose(outcome.result.pose),
                    };
                    // Short of the whole load the actuation was as short.
                    let mut case = Case { load, ..loads[i] };
                    for (k, actuator) in outcome.result.actuators.iter().enumerate() {
                        case.actuation[k] = match case.amounts >> k & 1 {
                            0 => actuator.input,
                            _ => actuator.amount,
                        };
                    }
                    case
                };
                let loads: Vec<Case> = states.iter().map(equilibrium).collect();
                let fields: Vec<&[f32]> = states.iter().map(|s| s.1.field.as_slice()).collect();
                warm_start = self.fitted(&loads, &fields, watch).or(warm_start);
            }
        }
        Ok(outcomes.into_iter().flatten().map(|o| o.result).collect())
    }

    /// Solves all loads on rayon's current pool, each on its own from the same warm start; from
    /// rest without one.
    ///
    /// # Errors
    /// As [`Fem::solve_all`]; a warm start of another body.
    pub fn solve_from<L: Copy + Into<Case>>(
        &self,
        loads: &[L],
        warm_start: Option<&WarmStart>,
        watch: Watch,
        finished: Finished,
    ) -> Result<Vec<Outcome>, FemError> {
        let loads = &self.checked(loads)?;
        warm_start.map_or(Ok(()), |warm_start| self.check_warm_start(warm_start))?;
        let all: Vec<usize> = (0..loads.len()).collect();
        Ok(self.solve_group(loads, &all, warm_start, watch, finished))
    }

    /// A warm start fitted to states and the loads at which they are equilibria, all wrenches or
    /// all poses; `None` when there are too few.
    ///
    /// # Errors
    /// As [`Fem::solve_all`]; not as many fields as loads; fields of another body; the cancel flag.
    pub fn fit_warm_start<L: Copy + Into<Case>>(
        &self,
        loads: &[L],
        fields: &[&[f32]],
        watch: Watch,
    ) -> Result<Option<WarmStart>, FemError> {
        let loads = &self.checked(loads)?;
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
                "the length of this body's state vector",
            ));
        }
        let fitted = self.fitted(loads, fields, watch);
        not_cancelled(watch).map(|()| fitted)
    }

    fn fitted(&self, loads: &[Case], fields: &[&[f32]], watch: Watch) -> Option<WarmStart> {
        let points = self.points(loads, watch);
        let samples: Vec<_> = points
            .iter()
            .map(Vec::as_slice)
            .zip(fields.iter().copied())
            .collect();
        if watch.cancelled() {
            return None;
        }
        WarmStart::fit(&samples)
    }

    /// Poses (m, rad) predicted by a warm start, without solving.
    ///
    /// # Errors
    /// As [`Fem::solve_from`]; the cancel flag.
    pub fn predict_poses<L: Copy + Into<Case>>(
        &self,
        loads: &[L],
        warm_start: &WarmStart,
        watch: Watch,
    ) -> Result<Vec<[f64; 6]>, FemError> {
        let loads = &self.checked(loads)?;
        self.check_warm_start(warm_start)?;
        let points = self.points(loads, watch);
        not_cancelled(watch)?;
        Ok(points.par_iter().map(|p| warm_start.pose(p)).collect())
    }

    fn check_warm_start(&self, warm_start: &WarmStart) -> Result<(), FemError> {
        let (found, expected) = (warm_start.field_length(), self.field_length());
        if found == expected {
            return Ok(());
        }
        let why = "a warm start is valid for the body that it was fitted to";
        Err(FemError::Size {
            what: "the state vector of the warm start",
            found,
            expected,
            why,
        })
    }

    /// Number of values in a state vector.
    pub fn field_length(&self) -> usize {
        self.flatten(&self.rest()).len()
    }

    fn checked<L: Copy + Into<Case>>(&self, loads: &[L]) -> Result<Vec<Case>, FemError> {
        let cases: Vec<Case> = loads.iter().map(|&load| load.into()).collect();
        let first = cases.first().map_or("", |case| case.load.kind());
        for (row, case) in cases.iter().enumerate() {
            let found = case.load.kind();
            if found != first {
                return Err(FemError::MixedLoads { row, found, first });
            }
            if case.amounts != cases[0].amounts {
                let (found, first) = ("case of other given amounts", "case of given amounts");
                return Err(FemError::MixedLoads { row, found, first });
            }
            self.check_case(row, case)?;
        }
        Ok(cases)
    }

    fn solve_group(
        &self,
        loads: &[Case],
        group: &[usize],
        warm_start: Option<&WarmStart>,
        watch: Watch,
        finished: Finished,
    ) -> Vec<Outcome> {
        let spare: Mutex<Vec<Workspace>> = Mutex::new(Vec::new());
        // One case per task: a creased case costs ten times a solved one.
        group
            .par_iter()
            .with_max_len(1)
            .map(|&case| {
                let mut work = pop(&spare).unwrap_or_else(|| Workspace::new(self));
                let outcome = self.solve_case(&mut work, &loads[case], warm_start, watch);
                push(&spare, work);
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
        load: &Case,
        warm_start: Option<&WarmStart>,
        watch: Watch,
    ) -> Outcome {
        if watch.cancelled() {
            let result = CaseResult {
                status: Status::Cancelled,
                ..CaseResult::without_state()
            };
            return Outcome {
                result,
                field: Vec::new(),
            };
        }
        let (mut result, mut state) = match warm_start {
            Some(warm_start) => self.solve_from_warm_start(work, load, warm_start, watch),
            None => self.follow_from_rest(work, load, watch),
        };
        let mut load = *load;
        while let Some(other) = self.slackened(&load, &result) {
            load = other;
            (result, state) = self.follow_from_rest(work, &load, watch);
        }
        let field = self.flatten(&state);
        Outcome { result, field }
    }

    /// Result without load on the platform.
    pub(super) fn result_at_rest(&self, watch: Watch) -> CaseResult {
        if let Some(result) = self.at_rest.get() {
            return result.clone();
        }
        let load = Load::Wrench([0.0; 6]);
        let result = self
            .follow_from_rest(&mut Workspace::new(self), &load.into(), watch)
            .0;
        if result.status != Status::Cancelled {
            // Another thread may have been first, with the same result.
            let _ = self.at_rest.set(result.clone());
        }
        result
    }

    fn points(&self, loads: &[Case], watch: Watch) -> Vec<Vec<f64>> {
        // The first point computes the stiffness at rest for all.
        let first = loads.iter().take(1).map(|load| self.point(load, watch));
        let rest = loads.get(1..).unwrap_or_default();
        let mut points: Vec<_> = first.collect();
        points.par_extend(rest.par_iter().map(|load| self.point(load, watch)));
        points
    }

    /// Mid-frame coordinates (c / L, θ) of a load's pose, and what is given of the actuators over its unit; for a
    /// wrench, of the pose that a Cosserat rod with this body's stiffness at rest takes. States are
    /// nearly linear in these coordinates, but not in wrenches.
    pub(super) fn point(&self, case: &Case, watch: Watch) -> Vec<f64> {
        let actuators = self.body.actuators();
        let none = || vec![f64::NAN; 6 + actuators];
        if watch.cancelled() {
            return none();
        }
        let length = self.body.mesh.length_m();
        let pose = match &case.load {
            Load::Wrench(h) => {
                Rod::like(&self.result_at_rest(watch).stiffness, length)
                    .pose(h)
                    .0
            }
            Load::Pose(p) => *p,
        };
        let Ok(pose) = Pose::from_array(&pose) else {
            return none(); // A wrench under which the rod has no equilibrium.
        };
        let q = ecm_se3::mid_frame::coordinates(&pose, length);
        let of_pose = (0..6).map(|k| if k < 3 { q[k] / length } else { q[k] });
        let of_actuator = |k: usize| match case.amounts >> k & 1 {
            0 => case.actuation[k] / self.input_unit(k),
            _ => case.actuation[k] / self.amount_unit(k),
        };
        of_pose.chain((0..actuators).map(of_actuator)).collect()
    }
}

fn not_cancelled(watch: Watch) -> Result<(), FemError> {
    if watch.cancelled() {
        return Err(FemError::Cancelled);
    }
    Ok(())
}

fn pop(spare: &Mutex<Vec<Workspace>>) -> Option<Workspace> {
    spare.lock().ok()?.pop()
}

fn push(spare: &Mutex<Vec<Workspace>>, work: Workspace) {
    if let Ok(mut list) = spare.lock() {
        list.push(work);
    }
}

fn square_distance(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y).powi(2)).sum()
}

/// Order of the cases: the one nearest to rest (the origin), then always the one farthest from all
/// before it, so that any first part of the order covers the whole range.
fn farthest_first(points: &[Vec<f64>], watch: Watch) -> Vec<usize> {
    let mut gap: Vec<f64> = points
        .iter()
        .map(|p| p.iter().map(|x| x * x).sum())
        .collect();
    let mut order = Vec::with_capacity(points.len());
    let mut left: Vec<usize> = (0..points.len()).collect();
    let mut next = (left.iter().copied()).min_by(|&a, &b| gap[a].total_cmp(&gap[b]));
    while let Some(case) = next {
        order.push(case);
        left.retain(|&i| i != case);
        if watch.cancelled() {
            order.append(&mut left);
            break;
        }
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
