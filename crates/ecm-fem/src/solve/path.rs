//! Load stepping: the load grows in proportion, in as few steps as Newton allows.
//!
//! A failed step and an equilibrium that is not stable are no verdict: Newton may have left the
//! branch. The step is halved, and where it becomes too small the branch is followed in small steps
//! of the state instead (see [`super::branch`]).

use super::branch::End;
use super::load_path::{Beside, LoadPath, Reached};
use super::newton::{Failure, MOST_UNSTABLE_ITERATES, Workspace};
use super::{Fem, Load, State, Watch};
use crate::result::{CREASE, CaseResult, Reason, Status};

/// Start of a load path: an equilibrium at a share of the load, and the size of the first step.
pub(super) struct PathStart {
    pub state: State,
    pub result: Option<CaseResult>,
    pub reached: f64,
    pub step: f64,
}

/// How Newton ended at one load.
pub(super) enum Attempt {
    Stable(Box<CaseResult>),
    Unstable,
    Failed(Failure),
}

/// Most times that a path leaves the load steps to follow the branch.
const MOST_BRIDGES: usize = 6;

impl Failure {
    pub(super) fn status(self) -> Status {
        match self {
            Self::Diverged => Status::NotConverged,
            Self::Inverted => Status::Inverted,
            Self::Collapsed => Status::Collapsed,
            Self::Cancelled => Status::Cancelled,
        }
    }
}

/// The reason of a loss, by the smallest stretch in the last stable state.
fn reason(within: bool, smallest_stretch: f64) -> Reason {
    match within {
        false => Reason::Buckling,
        true if smallest_stretch < CREASE => Reason::Crease,
        true => Reason::Inner,
    }
}

impl Fem {
    /// Follows the load path to its end; also returns the final state.
    pub(super) fn follow(
        &self,
        work: &mut Workspace,
        begin: PathStart,
        path: &LoadPath,
        watch: Watch,
    ) -> (CaseResult, State) {
        work.ready = false;
        let mut last = Reached {
            state: begin.state,
            result: begin.result,
            share: begin.reached,
        };
        let mut loss = None;
        let (mut iterations, mut load_steps) = (0, 0);
        let mut step = begin.step;
        let mut bridges = 0;
        let status = loop {
            let (failed, counts) = self.step_load(work, &mut last, path, step, watch);
            iterations += counts.0;
            load_steps += counts.1;
            let Some((failure, next)) = failed else {
                break Status::Solved;
            };
            let ends = matches!(failure, Failure::Cancelled | Failure::Collapsed);
            let follow = !ends && bridges < MOST_BRIDGES;
            let (end, n) = if follow {
                self.follow_branch(work, &mut last, path, next, &mut loss, watch)
            } else {
                (End::Failed(failure), 0)
            };
            iterations += n;
            bridges += 1;
            match end {
                End::Passed => step = self.settings.smallest_load_step,
                End::Failed(Failure::Cancelled) => break Status::Cancelled,
                End::Failed(_) if loss.is_some() => break Status::Unstable,
                End::Failed(Failure::Collapsed) => break Status::Collapsed,
                End::Failed(_) => break failure.status(),
            }
        };
        let reason = match (status, loss) {
            (Status::Unstable, Some(loss)) => {
                last = loss.before;
                let smallest = |r: &CaseResult| r.smallest_stretch;
                Some(reason(
                    loss.within,
                    last.result.as_ref().map_or(1.0, smallest),
                ))
            }
            _ => None,
        };
        let (result, state) = self.result_at(work, last, path, watch);
        let result = CaseResult {
            status,
            reason,
            iterations,
            load_steps,
            ..result
        };
        (result, state)
    }

    /// Load steps from `last`, which moves along, as far as Newton finds stable states. Returns the
    /// failure at the smallest step with its share of the load, `None` at the end of the path; and
    /// the numbers of iterations and steps.
    fn step_load(
        &self,
        work: &mut Workspace,
        last: &mut Reached,
        path: &LoadPath,
        mut step: f64,
        watch: Watch,
    ) -> (Option<(Failure, f64)>, (usize, usize)) {
        work.ready = false;
        let mut state = last.state.clone();
        let most = (self.settings.iterations, MOST_UNSTABLE_ITERATES);
        let (mut iterations, mut load_steps) = (0, 0);
        let mut step_may_grow = true;
        loop {
            let next = if last.share + step >= 1.0 - 1e-12 {
                1.0
            } else {
                last.share + step
            };
            let (attempt, n) = self.attempt(work, &mut state, path.at(next), most, watch);
            iterations += n;
            let failure = match attempt {
                Attempt::Stable(result) => {
                    load_steps += 1;
                    let grown = if step_may_grow { 2.0 * step } else { step };
                    step = grown.min(1.0 - next);
                    step_may_grow = true;
                    last.share = next;
                    last.state.clone_from(&state);
                    last.result = Some(*result);
                    if next == 1.0 {
                        return (None, (iterations, load_steps));
                    }
                    continue;
                }
                Attempt::Unstable => Failure::Diverged,
                Attempt::Failed(failure) => failure,
            };
            step_may_grow = false;
            step *= 0.5;
            if failure == Failure::Cancelled || step < self.settings.smallest_load_step {
                return (Some((failure, next)), (iterations, load_steps));
            }
            state.clone_from(&last.state);
            work.ready = false;
        }
    }

    /// Newton from `state` at a load and what acts beside it, with the result where it converges.
    pub(super) fn attempt(
        &self,
        work: &mut Workspace,
        state: &mut State,
        (load, beside): (Load, Beside),
        most: (usize, usize),
        watch: Watch,
    ) -> (Attempt, usize) {
        work.set_beside(state, &beside);
        match self.newton(work, state, &load, most, watch) {
            Ok(n) if self.is_collapsed(state) => (Attempt::Failed(Failure::Collapsed), n),
            Ok(n) => match self.report(work, state, &load) {
                (result, None) => (Attempt::Stable(Box::new(result)), n),
                (_, Some(_)) => (Attempt::Unstable, n),
            },
            Err((failure, n)) => (Attempt::Failed(failure), n),
        }
    }

    /// Whether a chamber's wall passes through itself.
    pub(super) fn is_collapsed(&self, state: &State) -> bool {
        let at = |node| self.body.place_m(&state.field, node);
        self.body.chambers.collapsed(&self.body.mesh, at)
    }

    /// The result of the last stable state; where no step succeeded, of the start.
    fn result_at(
        &self,
        work: &mut Workspace,
        mut last: Reached,
        path: &LoadPath,
        watch: Watch,
    ) -> (CaseResult, State) {
        if let Some(result) = last.result {
            return (result, last.state);
        }
        work.ready = false;
        let most = (self.settings.iterations, MOST_UNSTABLE_ITERATES);
        let at_start = path.at(last.share);
        let result = match self.attempt(work, &mut last.state, at_start, most, watch).0 {
            Attempt::Stable(result) => *result,
            _ => CaseResult::without_state(),
        };
        (result, last.state)
    }
}
