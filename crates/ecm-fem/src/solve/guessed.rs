//! A load from guessed states: at once, or to the last stable share of it.

use super::newton::{Failure, Workspace};
use super::path::{BRACKET, Begin, Landing, between};
use super::{Fem, Guess, Load, State, Watch};
use crate::result::CaseResult;

/// Newton iterations granted to a guess, and iterates that may be unstable without progress.
const TRUST: (usize, usize) = (10, 1);

impl Fem {
    /// The load from a guess; where that is not stable, guesses along the proportional path
    /// lead to a stable state at most [`BRACKET`] before the loss of stability, from where
    /// the path is followed as from rest.
    pub(super) fn solve_guessed(
        &self,
        work: &mut Workspace,
        load: &Load,
        guess: &Guess,
        watch: Watch,
    ) -> (CaseResult, State) {
        let before = work.timing.factorisations;
        let mut state = guess.state(&self.point(load), self);
        work.ready = false;
        let (landing, mut iterations) = self.land(work, &mut state, load, TRUST, watch);
        let begin = match landing {
            Landing::Stable(mut result) => {
                (result.iterations, result.load_steps) = (iterations, 1);
                result.factorisations = work.timing.factorisations - before;
                return (*result, state);
            }
            Landing::Failed(Failure::Cancelled) => self.begin_at_rest(0.5),
            Landing::Lost(_) | Landing::Failed(_) => {
                let (begin, n) = self.last_stable(work, load, guess, watch);
                iterations += n;
                begin
            }
        };
        let (mut result, state) = self.follow(work, begin, load, watch);
        result.iterations += iterations;
        result.factorisations = work.timing.factorisations - before;
        (result, state)
    }

    /// A stable equilibrium close before the loss of stability, else rest; and the
    /// iterations spent on it.
    fn last_stable(
        &self,
        work: &mut Workspace,
        load: &Load,
        guess: &Guess,
        watch: Watch,
    ) -> (Begin, usize) {
        let start = self.load_at_rest(load);
        let guessed = |share: f64| {
            let here = between(&start, load, share);
            (guess.state(&self.point(&here), self), here)
        };
        let mut iterations = 0;
        // One factorisation at a guess nearly tells stable from unstable ...
        let (mut low, mut high) = (0.0, 1.0);
        while high - low > BRACKET && !watch.cancelled() {
            let middle = 0.5 * (low + high);
            let (mut state, here) = guessed(middle);
            iterations += 1;
            if self.looks_stable(work, &mut state, &here) {
                low = middle;
            } else {
                high = middle;
            }
        }
        // ... but errs on the stable side: from there back to an equilibrium that is stable,
        // and between it and the unstable ones by halves.
        let mut begin = self.begin_at_rest(0.5);
        let (mut share, mut back) = (low, BRACKET);
        (low, high) = (0.0, 1.0);
        while high - low > BRACKET && share > 0.0 {
            let (mut state, here) = guessed(share);
            work.ready = false;
            let (landing, n) = self.land(work, &mut state, &here, TRUST, watch);
            iterations += n;
            match landing {
                Landing::Stable(result) => {
                    low = share;
                    begin.result = Some(*result);
                    begin.state = state;
                    begin.reached = low;
                }
                Landing::Failed(Failure::Cancelled) => break,
                Landing::Lost(_) | Landing::Failed(_) => high = share,
            }
            share = if low > 0.0 {
                0.5 * (low + high)
            } else {
                share - back
            };
            back *= 2.0;
        }
        if low > 0.0 {
            begin.step = high - low;
        }
        (begin, iterations)
    }

    /// Whether the tangent at a state near equilibrium is positive at held platform.
    fn looks_stable(&self, work: &mut Workspace, state: &mut State, load: &Load) -> bool {
        self.tangent(work, state, load).is_ok() && work.balance.inner_instabilities == 0
    }
}
