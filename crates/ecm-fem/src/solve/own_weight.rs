//! Where load paths begin: the equilibrium of the body under its own weight.
//!
//! The weight grows from nothing to the whole, with no wrench or with the platform held in its pose
//! at rest. A body that cannot carry its weight has no state from which a load could be applied.

use super::load_path::LoadPath;
use super::newton::Workspace;
use super::path::PathStart;
use super::{Case, Fem, Load, State, Watch};
use crate::result::{CaseResult, Status};
use std::sync::OnceLock;

/// Equilibria under the body's own weight, each computed when first needed.
#[derive(Debug, Default)]
pub(super) struct OwnWeight {
    free: OnceLock<(CaseResult, State)>,
    held: OnceLock<(CaseResult, State)>,
}

impl Fem {
    /// Start of the path to `load` with a first step; the result of the weight alone where the
    /// body does not carry it.
    pub(super) fn path_start(
        &self,
        work: &mut Workspace,
        case: &Case,
        step: f64,
        watch: Watch,
    ) -> Result<PathStart, Box<CaseResult>> {
        let begin = PathStart {
            state: self.rest(),
            result: None,
            reached: 0.0,
            step,
        };
        if self.body.dead_force_N.iter().all(|&f| f == 0.0) {
            return Ok(begin);
        }
        let known = match case.load {
            Load::Wrench(_) => &self.own_weight.free,
            Load::Pose(_) => &self.own_weight.held,
        };
        // Bodies whose amounts are held sag less; these are few, and not kept.
        let kept = case.amounts == 0;
        let (result, state) = match known.get().filter(|_| kept) {
            Some(loaded) => loaded.clone(),
            None => {
                let start = self.at_rest_of(case);
                let path = LoadPath {
                    start,
                    end: start,
                    weight: [0.0, 1.0],
                };
                let first = PathStart { step: 1.0, ..begin };
                let loaded = self.follow(work, first, &path, watch);
                if loaded.0.status == Status::Cancelled {
                    return Err(Box::new(loaded.0));
                }
                match kept {
                    true => known.get_or_init(|| loaded).clone(),
                    false => loaded,
                }
            }
        };
        if result.status == Status::Solved {
            return Ok(PathStart {
                state,
                result: Some(result),
                reached: 0.0,
                step,
            });
        }
        // The last stable state carries a part of the weight only: it is none of this body.
        Err(Box::new(CaseResult {
            status: result.status,
            reason: result.reason,
            iterations: result.iterations,
            ..CaseResult::without_state()
        }))
    }

    /// No wrench or the pose at rest, and no actuation.
    fn at_rest_of(&self, case: &Case) -> Case {
        let load = match case.load {
            Load::Wrench(_) => Load::Wrench([0.0; 6]),
            Load::Pose(_) => Load::Pose(self.rest().platform.pose()),
        };
        Case {
            amounts: case.amounts,
            ..Case::from(load)
        }
    }

    /// The proportional path to a case under the whole weight.
    pub(super) fn path_to(&self, case: &Case) -> LoadPath {
        LoadPath {
            start: self.at_rest_of(case),
            end: *case,
            weight: [1.0, 1.0],
        }
    }

    /// Follows the load path from rest; also returns the final state.
    pub(super) fn follow_from_rest(
        &self,
        work: &mut Workspace,
        case: &Case,
        watch: Watch,
    ) -> (CaseResult, State) {
        let before = work.timing.factorisations;
        let (mut result, state) = match self.path_start(work, case, 1.0, watch) {
            Ok(begin) => self.follow(work, begin, &self.path_to(case), watch),
            Err(result) => (*result, self.rest()),
        };
        result.factorisations = work.timing.factorisations - before;
        (result, state)
    }
}
