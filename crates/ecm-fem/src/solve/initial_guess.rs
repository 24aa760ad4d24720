//! Load cases that start from an initial guess of the state instead of the rest state.

use super::load_path::Beside;
use super::newton::{Failure, Workspace};
use super::path::{Attempt, PathStart};
use super::{Case, Fem, Load, State, WarmStart, Watch};
use crate::result::CaseResult;

/// Largest share of the load between the last stable guess and the first one that is not.
const BRACKET: f64 = 1.0 / 16.0;

/// Most Newton iterations from an initial guess, and most unstable iterates without progress.
const MOST_ITERATIONS: (usize, usize) = (10, 1);

impl Fem {
    /// Solves a load from an initial guess. Where the equilibrium is not stable, initial guesses
    /// at smaller shares of the load lead to a stable state at most [`BRACKET`] before the loss
    /// of stability; load stepping goes on from there.
    pub(super) fn solve_from_warm_start(
        &self,
        work: &mut Workspace,
        load: &Case,
        guess: &WarmStart,
        watch: Watch,
    ) -> (CaseResult, State) {
        let before = work.timing.factorisations;
        let mut state = guess.state(&self.point(load, watch), self);
        work.ready = false;
        let path = self.path_to(load);
        let (attempt, mut iterations) =
            self.attempt(work, &mut state, path.at(1.0), MOST_ITERATIONS, watch);
        let begin = match attempt {
            Attempt::Stable(mut result) => {
                (result.iterations, result.load_steps) = (iterations, 1);
                result.factorisations = work.timing.factorisations - before;
                return (*result, state);
            }
            Attempt::Failed(Failure::Cancelled) => self.path_start(work, load, 0.5, watch),
            Attempt::Unstable | Attempt::Failed(_) => {
                let (begin, n) = self.last_stable(work, load, guess, watch);
                iterations += n;
                begin
            }
        };
        let (mut result, state) = match begin {
            Ok(begin) => self.follow(work, begin, &path, watch),
            Err(result) => (*result, self.rest()),
        };
        result.iterations += iterations;
        result.factorisations = work.timing.factorisations - before;
        (result, state)
    }

    /// A stable equilibrium shortly before the loss of stability, or the rest state; and the
    /// iterations that it took.
    fn last_stable(
        &self,
        work: &mut Workspace,
        load: &Case,
        guess: &WarmStart,
        watch: Watch,
    ) -> (Result<PathStart, Box<CaseResult>>, usize) {
        let path = self.path_to(load);
        let guess_at = |share: f64| {
            let partial = path.at(share);
            let case = load.at(partial);
            (guess.state(&self.point(&case, watch), self), partial)
        };
        let mut iterations = 0;
        // One factorisation at an initial guess separates stable from unstable loads ...
        let (mut low, mut high) = (0.0, 1.0);
        while high - low > BRACKET && !watch.cancelled() {
            let middle = 0.5 * (low + high);
            let (mut state, partial) = guess_at(middle);
            iterations += 1;
            if self.looks_stable(work, &mut state, partial) {
                low = middle;
            } else {
                high = middle;
            }
        }
        // ... but calls too many stable: from there, go back to a stable equilibrium, then bisect
        // between it and the unstable ones.
        let mut begin = match self.path_start(work, load, 0.5, watch) {
            Ok(begin) => begin,
            failed => return (failed, iterations),
        };
        let (mut share, mut step_back) = (low, BRACKET);
        (low, high) = (0.0, 1.0);
        while high - low > BRACKET && share > 0.0 {
            let (mut state, partial) = guess_at(share);
            work.ready = false;
            let (attempt, n) = self.attempt(work, &mut state, partial, MOST_ITERATIONS, watch);
            iterations += n;
            match attempt {
                Attempt::Stable(result) => {
                    low = share;
                    begin.result = Some(*result);
                    begin.state = state;
                    begin.reached = low;
                }
                Attempt::Failed(Failure::Cancelled) => break,
                Attempt::Unstable | Attempt::Failed(_) => high = share,
            }
            share = if low > 0.0 {
                0.5 * (low + high)
            } else {
                share - step_back
            };
            step_back *= 2.0;
        }
        if low > 0.0 {
            begin.step = high - low;
        }
        (Ok(begin), iterations)
    }

    /// Whether the tangent at a state near equilibrium is positive at fixed platform.
    fn looks_stable(
        &self,
        work: &mut Workspace,
        state: &mut State,
        (load, beside): (Load, Beside),
    ) -> bool {
        work.set_beside(state, &beside);
        self.tangent(work, state, &load).is_ok() && work.balance.inner_instabilities == 0
    }
}
