//! What the mean of an interval does to the parameters.

use ecm_se3::{Mat6, Pose, Real, Vec6};

use super::update::{Factor, bound_of_mean, carried, dot, root, shrunk, spread};
use super::{Adapter, Block, Outcome, State};
use crate::stepper::Decay;

/// A block counts at least as this share of one, so that a pause at one pose ends some day.
const STILL: u16 = 1000;
/// Variance of what a parameter changes over what the noise of the pose makes of it.
const EXCITED: u16 = 100;
const MOST_EXCITED: u16 = 10_000;
/// Blocks in a row beyond the bound that make a jump, and jumps that are no drift.
const SUSPECTS: u32 = 3;
const JUMPS: u32 = 3;
/// Blocks of one test of the innovations.
const WINDOW: u32 = 100;
/// Bounds as those of a normal number: of one block, and of a window (1 in 10⁶).
const BLOCK_BOUND: u16 = 5;
const WINDOW_BOUND: [u16; 2] = [19, 4];

impl<R: Real, const N: usize> Adapter<R, N> {
    /// Tests a block, and updates or leaves it out.
    pub(super) fn close(
        &self,
        state: &mut State<R, N>,
        block: &Block<R>,
        stiffness: &Mat6<R>,
    ) -> Outcome {
        let Some(pose) = Pose::checked(&block.pose) else {
            return Outcome::LeftOut;
        };
        let first = state.counts[3] == 0;
        let mut apart = if first { R::ONE } else { R::ZERO };
        let moved = first || block.moved(&state.anchor.pose, &self.noise);
        if moved {
            apart += (R::ONE - apart) * self.apart(&state.anchor.pose, &block.pose);
            state.anchor = *block;
        }
        state.counts[3] = state.counts[3].saturating_add(1);
        self.grow(&mut state.covariance, block.time_s);
        let mut columns = self.columns_at(&state.anchor);
        let expected = self.expected(state, &pose, &block.predicted, &block.branches, true);
        let innovation: Vec6<R> = core::array::from_fn(|a| block.wrench[a] - expected[a]);
        let scale = self.modulus(state);
        let scaled = stiffness.map(|row| row.map(|k| scale * k));
        let (noise, of_pose) = block.noise(&self.noise, &scaled);
        let model: Vec6<R> =
            core::array::from_fn(|a| self.noise.model[a / 3] * self.noise.model[a / 3]);
        let limit = R::from_u16(BLOCK_BOUND);
        let bound = R::from_u16(6) * bound_of_mean(R::from_u16(6), limit);
        let mut told = Told::new(&state.covariance, &columns, &noise, &model);
        let mut surprise = told.surprise(&innovation);
        let mut outcome = Outcome::Adapted;
        // A NaN does not fit.
        let fits = surprise <= bound;
        if !fits {
            state.counts[1] += 1;
            if state.counts[1] < SUSPECTS {
                return Outcome::LeftOut;
            }
            let may_jump = self.priors.iter().any(|prior| prior.jumps > R::ZERO);
            if !may_jump || state.counts[2] >= JUMPS {
                state.held = 1;
                return Outcome::Diagnose;
            }
            state.counts = [0, 0, state.counts[2] + 1, state.counts[3]];
            state.window = [R::ZERO; 2];
            self.open(&mut state.covariance);
            told = Told::new(&state.covariance, &columns, &noise, &model);
            surprise = told.surprise(&innovation);
            outcome = Outcome::Jumped;
            let fits = surprise <= bound;
            if !fits {
                return outcome;
            }
        }
        state.counts[1] = 0;
        let mut next = *state;
        if moved {
            let shift = block.pose_shift(&self.noise, &scaled, &told.solved(&innovation));
            next.anchor.shift(&shift, stiffness);
            columns = self.columns_at(&next.anchor);
            told = Told::new(&next.covariance, &columns, &noise, &model);
        }
        let all_told = self.update(&mut next, &told, &innovation, apart, &of_pose);
        let mut values = next.values.iter().chain(next.covariance.as_flattened());
        if !(values.all(|x| x.is_finite()) && next.anchor.is_finite()) {
            return Outcome::LeftOut;
        }
        *state = next;
        // The error of a parameter that is held is alike in all blocks: no chi-square.
        if !all_told {
            return outcome;
        }
        self.test(state, surprise, told.alike(&noise))
            .unwrap_or(outcome)
    }

    /// 1 − e^(−way/reach) between two poses.
    fn apart(&self, from: &Vec6<R>, to: &Vec6<R>) -> R {
        let mut way = R::ZERO;
        for i in 0..6 {
            let d = to[i] - from[i];
            way += if d < R::ZERO { -d } else { d } / self.noise.reach[i / 3];
        }
        Decay::new(way).lost
    }

    /// A random walk of dt seconds, no further than the covariance of the start.
    fn grow(&self, covariance: &mut [[R; N]; N], dt: R) {
        let hours = dt / R::from_u16(3600);
        for i in 0..N {
            let prior = &self.priors[i];
            covariance[i][i] += prior.walk * prior.walk * hours;
            self.cap(covariance, i);
        }
    }

    /// Opens what may jump.
    fn open(&self, covariance: &mut [[R; N]; N]) {
        for i in 0..N {
            let prior = &self.priors[i];
            if prior.jumps > R::ZERO {
                covariance[i][i] += prior.sd * prior.sd;
                self.cap(covariance, i);
            }
        }
    }

    /// Scales row and column, which keeps the matrix positive and its correlations as they are.
    fn cap(&self, covariance: &mut [[R; N]; N], i: usize) {
        let largest = self.priors[i].sd * self.priors[i].sd;
        if covariance[i][i] <= largest {
            return;
        }
        let ratio = largest / covariance[i][i];
        let factor = if ratio > R::EPSILON {
            root(ratio)
        } else {
            R::ZERO
        };
        for j in 0..N {
            let entry = factor * covariance[i][j];
            covariance[i][j] = entry;
            covariance[j][i] = entry;
        }
        covariance[i][i] = largest;
    }

    /// Whether no parameter was held for want of excitation.
    fn update(
        &self,
        state: &mut State<R, N>,
        told: &Told<'_, R, N>,
        innovation: &Vec6<R>,
        apart: R,
        of_pose: &Vec6<R>,
    ) -> bool {
        let still = R::from_u16(STILL);
        let times = if apart * still > R::TWO - apart {
            (R::TWO - apart) / apart
        } else {
            still
        };
        let mut total = told.total;
        let mut noisy = R::ZERO;
        for a in 0..6 {
            total[a][a] += (times - R::ONE) * told.model[a];
            noisy += of_pose[a] / total[a][a];
        }
        // What a parameter changes while the others follow it: P Hᵀ over its own variance. Its mean, or
        // blocks in which noise looks like excitation would be chosen.
        let mut held = [false; N];
        for i in 0..N {
            let own = state.covariance[i][i] * state.covariance[i][i];
            let signal = (0..6).fold(R::ZERO, |sum, a| {
                sum + told.carried[i][a] * told.carried[i][a] / total[a][a]
            });
            if !(self.parameters[i].follows_model() && own > R::ZERO) {
                continue;
            }
            let most = R::from_u16(MOST_EXCITED);
            let ratio = signal / (own * noisy);
            let ratio = if ratio < most { ratio } else { most };
            state.excitation[i] += (ratio - state.excitation[i]) / R::from_u16(20);
            held[i] = state.excitation[i] <= R::from_u16(EXCITED);
        }
        let factor = Factor::new(&total);
        let gain: [Vec6<R>; N] = core::array::from_fn(|i| match held[i] {
            true => [R::ZERO; 6],
            false => factor.solve(&told.carried[i]),
        });
        for (value, gain) in state.values.iter_mut().zip(&gain) {
            *value += dot(gain, innovation);
        }
        shrunk(&mut state.covariance, &gain, &told.carried, &total);
        self.project(state);
        !held.contains(&true)
    }

    /// Back to the bounds, along the least change in the metric of the covariance.
    fn project(&self, state: &mut State<R, N>) {
        for i in 0..N {
            let bounded = self.clamped(i, state.values[i]);
            let excess = bounded - state.values[i];
            let variance = state.covariance[i][i];
            if excess * excess > R::ZERO && variance > R::ZERO {
                for j in 0..N {
                    state.values[j] += state.covariance[j][i] / variance * excess;
                }
            }
        }
        for i in 0..N {
            state.values[i] = self.clamped(i, state.values[i]);
        }
    }

    fn clamped(&self, i: usize, value: R) -> R {
        let prior = &self.priors[i];
        if value < prior.low {
            prior.low
        } else if value > prior.high {
            prior.high
        } else {
            value
        }
    }

    /// The mean of the window's innovations against chi-square.
    fn test(&self, state: &mut State<R, N>, surprise: R, alike: R) -> Option<Outcome> {
        state.window[0] += surprise;
        state.window[1] += if state.counts[0] == 0 {
            R::ONE
        } else {
            R::ONE - alike * alike
        };
        state.counts[0] += 1;
        if state.counts[0] < WINDOW {
            return None;
        }
        let six = R::from_u16(6);
        let mean = state.window[0] / (six * R::from_u16(WINDOW as u16));
        let limit = R::from_u16(WINDOW_BOUND[0]) / R::from_u16(WINDOW_BOUND[1]);
        let bound = bound_of_mean(six * state.window[1], limit);
        state.window = [R::ZERO; 2];
        state.counts[0] = 0;
        state.counts[2] = 0;
        if mean <= bound {
            return None;
        }
        state.held = 1;
        Some(Outcome::Diagnose)
    }
}

/// What a block tells of the parameters.
struct Told<'a, R, const N: usize> {
    carried: [Vec6<R>; N],
    total: Mat6<R>,
    model: &'a Vec6<R>,
}

impl<'a, R: Real, const N: usize> Told<'a, R, N> {
    fn new(
        covariance: &[[R; N]; N],
        columns: &[Vec6<R>; N],
        noise: &Mat6<R>,
        model: &'a Vec6<R>,
    ) -> Self {
        let carried = carried(covariance, columns);
        let mut total = spread(columns, &carried);
        for a in 0..6 {
            for b in 0..6 {
                total[a][b] += noise[a][b];
            }
            total[a][a] += model[a];
        }
        Self {
            carried,
            total,
            model,
        }
    }

    /// νᵀ S⁻¹ ν: chi-square with six degrees of freedom.
    fn surprise(&self, innovation: &Vec6<R>) -> R {
        dot(innovation, &self.solved(innovation))
    }

    /// S⁻¹ ν.
    fn solved(&self, innovation: &Vec6<R>) -> Vec6<R> {
        Factor::new(&self.total).solve(innovation)
    }

    /// Mean share of the variance that is no noise: it may be alike in all blocks of a window.
    fn alike(&self, noise: &Mat6<R>) -> R {
        let sum = (0..6).fold(R::ZERO, |sum, a| {
            sum + R::ONE - noise[a][a] / self.total[a][a]
        });
        sum / R::from_u16(6)
    }
}
