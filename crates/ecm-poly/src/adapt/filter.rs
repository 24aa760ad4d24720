//! What the two halves of an interval do to the parameters.

use ecm_se3::{Mat6, Pose, Real, Vec6};

use super::block::Pair;
use super::model_error::{Parts, way};
use super::update::{
    Factor, add, add_diagonal, bound_of_mean, carried, combined, dot, joseph, spread,
};
use super::{Adapter, Block, Outcome, Parameter, State, TOLD};
use crate::stepper::Decay;

/// A block counts at least as this share of one, so that a pause at one pose ends some day.
const STILL: u16 = 1000;
/// Blocks over which information and noise of the columns are averaged.
const EXCITED_OVER: u16 = 200;
/// A column of which the ones before it leave less than this share is one of them; single precision tells it.
const NO_OTHER: u16 = u16::MAX;
/// Blocks in a row beyond the bound that make a jump, and jumps that are no drift.
const SUSPECTS: u32 = 3;
const JUMPS: u32 = 3;
/// Blocks of one test of the innovations.
const WINDOW: u32 = 100;
/// Bounds as those of a normal number: of one block, and of a window (1 in 10⁶).
const BLOCK_BOUND: u16 = 5;
const WINDOW_BOUND: [u16; 2] = [19, 4];
/// The tests allow twice the stated variance of the model's error: this much beside the one in it.
const ALLOWED: u16 = 1;
/// A variance beyond this many times that of the start is no result.
const MOST: u16 = 16;

/// Columns and innovations of a block.
struct Seen<R, const N: usize> {
    /// Means of both halves, and half their difference.
    columns: [[Vec6<R>; N]; 2],
    innovations: [Vec6<R>; 2],
    /// Noise of either; with modulus 1, and the part of the pose in it.
    noise: Mat6<R>,
    unscaled: Mat6<R>,
    of_pose: Mat6<R>,
    parts: Parts<R, N>,
}

/// P Hᵀ and S of a block.
struct Told<R, const N: usize> {
    carried: [Vec6<R>; N],
    total: Mat6<R>,
}

impl<R: Real, const N: usize> Adapter<R, N> {
    /// Tests a block of `time_s`, and updates or leaves it out.
    pub(super) fn close(
        &self,
        state: &mut State<R, N>,
        halves: &[Block<R>; 2],
        time_s: R,
        stiffness: &Mat6<R>,
    ) -> Outcome {
        let pair = Pair::new(halves, &self.noise);
        let Some(mut columns) = self.columns_of(&pair) else {
            return Outcome::LeftOut;
        };
        let mut apart = R::ZERO;
        if state.counts[3] == 0 {
            apart = R::ONE;
        } else if pair.moved(&state.last, &self.noise) {
            apart = Decay::new(way(&state.last, &pair.pose, &self.noise)).lost;
        }
        if apart > R::ZERO {
            state.last = pair.pose;
            state.at_last = pair.of_model();
        }
        state.counts[3] = state.counts[3].saturating_add(1);
        self.grow(state, time_s);
        let cell = state.model.visit(&pair.pose, &self.noise, state.counts[3]);
        let scale = self.modulus(state);
        let of_pose = pair.of_pose(&self.noise, stiffness);
        let innovations = self.innovations(state, &pair, &columns);
        // At rest the noise of the pose must not look like a change of the columns.
        let rest = Pose::checked(&state.last).filter(|_| apart <= R::ZERO);
        if let Some(pose) = rest {
            let [predicted, branches @ ..] = &state.at_last;
            columns = [self.columns(&pose, predicted, branches), [[R::ZERO; 6]; N]];
        }
        let seen = Seen {
            innovations,
            columns,
            noise: pair.noise(&self.noise, &of_pose, scale),
            unscaled: pair.noise(&self.noise, &of_pose, R::ONE),
            of_pose,
            parts: state.model.parts(cell, &pair.pose, &self.noise),
        };
        let limit = R::from_u16(BLOCK_BOUND);
        let bound = R::from_u16(6) * bound_of_mean(R::from_u16(6), limit);
        let mut told = seen.told(&state.covariance);
        let (mut surprise, mut alike) = self.surprise(&seen, &told);
        let mut outcome = Outcome::Adapted;
        // A NaN does not fit.
        let fits = surprise <= bound;
        if !fits {
            state.counts[1] = state.counts[1].saturating_add(1);
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
            self.open(state);
            told = seen.told(&state.covariance);
            (surprise, alike) = self.surprise(&seen, &told);
            outcome = Outcome::Jumped;
            let fits = surprise <= bound;
            if !fits {
                return outcome;
            }
        }
        state.counts[1] = 0;
        let mut next = *state;
        self.update(&mut next, &seen, told, (apart, pair.two && apart > R::ZERO));
        if !self.is_sound(&next) {
            return Outcome::LeftOut;
        }
        *state = next;
        self.test(state, surprise, alike).unwrap_or(outcome)
    }

    /// Mean of both halves and half their difference; None where a mean pose is none.
    fn columns_of(&self, pair: &Pair<R>) -> Option<[[Vec6<R>; N]; 2]> {
        let at = |half: &Block<R>| {
            let pose = Pose::checked(&half.pose)?;
            Some(self.columns(&pose, &half.predicted, &half.branches))
        };
        let (first, second) = (at(&pair.halves[0])?, at(&pair.halves[1])?);
        let of = |sign: R| {
            core::array::from_fn(|i| {
                core::array::from_fn(|a| R::HALF * (first[i][a] + sign * second[i][a]))
            })
        };
        Some([of(R::ONE), of(-R::ONE)])
    }

    fn innovations(
        &self,
        state: &State<R, N>,
        pair: &Pair<R>,
        columns: &[[Vec6<R>; N]; 2],
    ) -> [Vec6<R>; 2] {
        let away = core::array::from_fn(|i| state.values[i] - self.nominal(i));
        let [first, second] = &pair.halves;
        let of = |sign: R, columns| {
            let explained = combined(columns, &away);
            core::array::from_fn(|a| {
                let rest = |half: &Block<R>| half.wrench[a] - half.predicted[a];
                R::HALF * (rest(first) + sign * rest(second)) - explained[a]
            })
        };
        [of(R::ONE, &columns[0]), of(-R::ONE, &columns[1])]
    }

    /// A walk of dt seconds that forgets: θ̃ ← f θ̃, variance (1 − f²) of the start.
    fn grow(&self, state: &mut State<R, N>, dt: R) {
        let hours = dt / R::from_u16(3600);
        let lost: [R; N] = core::array::from_fn(|i| {
            let prior = &self.priors[i];
            let rate = prior.walk * prior.walk * hours / (R::TWO * prior.sd * prior.sd);
            match prior.sd > R::ZERO {
                true => Decay::new(rate).lost,
                false => R::ZERO,
            }
        });
        let kept = lost.map(|x| R::ONE - x);
        for i in 0..N {
            let prior = &self.priors[i];
            for j in 0..N {
                state.covariance[i][j] = kept[i] * kept[j] * state.covariance[i][j];
            }
            // 1 - kept^2 without the 1, which would swallow slow walks in single precision.
            let grown = lost[i] * (R::TWO - lost[i]);
            state.covariance[i][i] += grown * prior.sd * prior.sd;
            for part in &mut state.model.cross[i] {
                *part = part.map(|x| kept[i] * x);
            }
        }
    }

    /// Opens what may jump.
    fn open(&self, state: &mut State<R, N>) {
        for i in 0..N {
            let prior = &self.priors[i];
            if prior.jumps > R::ZERO {
                state.covariance[i][i] += prior.sd * prior.sd;
            }
        }
    }

    /// νᵀ S⁻¹ ν with twice the variance of the model's error, chi-square with six degrees of freedom where
    /// that is right; and the mean share of the variance that is no noise.
    fn surprise(&self, seen: &Seen<R, N>, told: &Told<R, N>) -> (R, R) {
        let mut total = told.total;
        add_diagonal(&mut total, |a| R::from_u16(ALLOWED) * seen.parts.whole[a]);
        let innovation = &seen.innovations[0];
        let surprise = dot(innovation, &Factor::new(&total).solve(innovation));
        let sum = (0..6).fold(R::ZERO, |sum, a| {
            sum + R::ONE - seen.noise[a][a] / total[a][a]
        });
        (surprise, sum / R::from_u16(6))
    }

    /// Instrumental variables: x ← x + P (H₊ᵀ S⁻¹ ν₊ − H₋ᵀ S⁻¹ ν₋), + the mean of the halves and − half
    /// their difference, which is (H₁ᵀ S⁻¹ ν₂ + H₂ᵀ S⁻¹ ν₁)/2.
    fn update(
        &self,
        state: &mut State<R, N>,
        seen: &Seen<R, N>,
        told: Told<R, N>,
        (apart, told_apart): (R, bool),
    ) {
        let [mean, difference] = &seen.columns;
        let parts = &seen.parts;
        let still = R::from_u16(STILL);
        let times = if apart * still > R::TWO - apart {
            (R::TWO - apart) / apart
        } else {
            still
        };
        let mut carried_apart = carried(&state.covariance, difference);
        let mut total = told.total;
        add_diagonal(&mut total, |a| (times - R::ONE) * parts.rest[a]);
        add(&mut total, &spread(difference, &carried_apart));
        let factor = Factor::new(&total);
        let mut carried = told.carried;
        if told_apart {
            self.inform(state, seen);
        }
        self.hold(state, told_apart, [&mut carried, &mut carried_apart]);
        let gain = carried.map(|row| factor.solve(&row));
        let gain_apart = carried_apart.map(|row| factor.solve(&row));
        let [innovation, innovation_apart] = &seen.innovations;
        for i in 0..N {
            state.values[i] += dot(&gain[i], innovation) - dot(&gain_apart[i], innovation_apart);
        }
        let through: [[R; N]; N] = core::array::from_fn(|i| {
            core::array::from_fn(|j| {
                let one = if i == j { R::ONE } else { R::ZERO };
                one - dot(&gain[i], &mean[j]) + dot(&gain_apart[i], &difference[j])
            })
        });
        let shared = core::array::from_fn(|i| {
            core::array::from_fn(|a| {
                (0..N).fold(R::ZERO, |sum, j| sum + through[i][j] * parts.shared[j][a])
            })
        });
        let mut noise = seen.noise;
        add_diagonal(&mut noise, |a| parts.variance[a] + times * parts.rest[a]);
        let covariance = &mut state.covariance;
        joseph(
            covariance,
            &through,
            (&gain, &shared, &noise),
            (&gain_apart, &seen.noise),
        );
        state.model.follow(&through, &gain, parts);
        self.project(state);
    }

    /// Adds the information of a block to the mean over the last of them, by the noise of the readings alone:
    /// no covariance of the filter is in it, so that what is known of a parameter does not hold it.
    fn inform(&self, state: &mut State<R, N>, seen: &Seen<R, N>) {
        let over = R::from_u16(EXCITED_OVER);
        let factor = Factor::new(&seen.unscaled);
        let [mean, apart] = &seen.columns;
        for i in 0..N {
            let (one, other) = (factor.solve(&mean[i]), factor.solve(&apart[i]));
            for j in 0..N {
                let told = dot(&one, &mean[j]) - dot(&other, &apart[j]);
                let place = &mut state.information[i][j];
                *place += (told - *place) / over;
            }
        }
        // The trace of K Σ_p Kᵀ R⁻¹: what the noise of the pose adds to the information of h.
        let noise = (0..6).fold(R::ZERO, |sum, a| sum + factor.solve(&seen.of_pose[a])[a]);
        state.of_noise += (noise - state.of_noise) / over;
        self.excite(state);
    }

    /// What the last blocks tell of each parameter that follows the model, whatever the others are: the Schur
    /// complement of its information. What is known, or told by noise only, does not follow.
    fn excite(&self, state: &mut State<R, N>) {
        // Loops over all places, with none that the compiler cannot see to be one: no panic is left in them.
        let open: [bool; N] = core::array::from_fn(|i| self.priors[i].sd > R::ZERO);
        let follows = self.parameters.map(Parameter::follows_model);
        let enough = R::from_u16(TOLD) * state.of_noise;
        let mut left = state.information;
        for j in 0..N {
            let other = open[j] && !follows[j];
            if other && left[j][j] * R::from_u16(NO_OTHER) > state.information[j][j] {
                eliminate(&mut left, j);
            }
        }
        for i in 0..N {
            if !(open[i] && follows[i]) {
                continue;
            }
            let mut own = left;
            for j in 0..N {
                if j != i && open[j] && follows[j] && own[j][j] > enough {
                    eliminate(&mut own, j);
                }
            }
            state.excitation[i] = [own[i][i], state.of_noise];
        }
    }

    /// Takes parameters that follow the model out of the gains while the readings tell too little of them,
    /// the others following; and in a block that has not moved, or has no two halves.
    fn hold(&self, state: &State<R, N>, told_apart: bool, mut carried: [&mut [Vec6<R>; N]; 2]) {
        let held: [bool; N] = core::array::from_fn(|i| {
            let open = self.parameters[i].follows_model() && state.covariance[i][i] > R::ZERO;
            open && (!told_apart || self.is_held(state, i))
        });
        let mut rest = state.covariance;
        for h in (0..N).filter(|h| held[*h]) {
            let own = rest[h][h];
            let share: [R; N] = core::array::from_fn(|i| match own > R::ZERO && i != h {
                true => rest[i][h] / own,
                false => R::ZERO,
            });
            for i in 0..N {
                for j in 0..N {
                    let less = share[i] * rest[h][j];
                    rest[i][j] -= less;
                }
            }
            for part in &mut carried {
                let row = part[h];
                for i in 0..N {
                    for a in 0..6 {
                        part[i][a] -= share[i] * row[a];
                    }
                }
                part[h] = [R::ZERO; 6];
            }
        }
    }

    /// Whether all numbers are finite, and no variance is below zero or far beyond that of the start.
    fn is_sound(&self, state: &State<R, N>) -> bool {
        let cross = state.model.cross.as_flattened().as_flattened();
        let mut numbers = state
            .values
            .iter()
            .chain(state.covariance.as_flattened())
            .chain(state.excitation.as_flattened())
            .chain(state.information.as_flattened())
            .chain([&state.of_noise])
            .chain(cross);
        numbers.all(|x| x.is_finite())
            && (0..N).all(|i| {
                let (sd, variance) = (self.priors[i].sd, state.covariance[i][i]);
                variance >= R::ZERO && variance <= R::from_u16(MOST) * sd * sd
            })
    }

    /// Back to the bounds, along the least change in the metric of the covariance.
    fn project(&self, state: &mut State<R, N>) {
        for (i, prior) in self.priors.iter().enumerate() {
            let bounded = state.values[i].clamped(prior.low, prior.high);
            let excess = bounded - state.values[i];
            let variance = state.covariance[i][i];
            if excess * excess > R::ZERO && variance > R::ZERO {
                for j in 0..N {
                    state.values[j] += state.covariance[j][i] / variance * excess;
                }
            }
        }
        for (value, prior) in state.values.iter_mut().zip(&self.priors) {
            *value = value.clamped(prior.low, prior.high);
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
        state.counts[0] = state.counts[0].saturating_add(1);
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

/// Takes what row j explains out of the other rows.
fn eliminate<R: Real, const N: usize>(matrix: &mut [[R; N]; N], j: usize) {
    let row = matrix[j];
    for (i, other) in matrix.iter_mut().enumerate() {
        let share = other[j] / row[j];
        if i != j {
            for (x, y) in other.iter_mut().zip(&row) {
                *x -= share * *y;
            }
        }
    }
}

impl<R: Real, const N: usize> Seen<R, N> {
    /// P H₊ᵀ + Cov(θ, δ), and its S.
    fn told(&self, covariance: &[[R; N]; N]) -> Told<R, N> {
        let columns = &self.columns[0];
        let mut carried = carried(covariance, columns);
        let mut total = spread(columns, &carried);
        for (row, shared) in carried.iter_mut().zip(&self.parts.shared) {
            for a in 0..6 {
                row[a] += shared[a];
            }
        }
        let once = spread(columns, &self.parts.shared);
        for a in 0..6 {
            for b in 0..6 {
                total[a][b] += once[a][b] + once[b][a] + self.noise[a][b];
            }
        }
        add_diagonal(&mut total, |a| self.parts.variance[a] + self.parts.rest[a]);
        Told { carried, total }
    }
}
