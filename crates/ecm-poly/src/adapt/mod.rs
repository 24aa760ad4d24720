//! A model that keeps itself right: a few named parameters, estimated while the robot works.
//!
//! The measured wrench is z = s h(p) + Σ (g − g₀) w_b − (m g, R c × m g) + (R b_f, R b_τ) + noise,
//! linear in all of [`Parameter`]: a Kalman filter over parameters that wander at random (Jazwinski,
//! Stochastic Processes and Filtering Theory, 1970). What differs from the textbook:
//!
//! - **Blocks.** Readings are averaged over `interval_s`, with as many independent ones as their noise
//!   time allows, and then enter as one. Their noise is Σ_h + K Σ_p Kᵀ: the pose is measured too.
//! - **Error of the model** stays alike while the pose does. With φ = e^(−way/reach) a block counts as
//!   (1 − φ)/(1 + φ) of one (mean of an autoregressive series), so that standing still is no proof.
//! - **Noise of the pose** is in the innovation and in the columns, which draws parameters to wrong
//!   values wherever the excitation is weak (errors in variables). So the columns are taken at the pose
//!   that reading and wrench together make likely, p + s Σ_p Kᵀ S⁻¹ ν, whose error has no correlation
//!   with ν.
//! - **Excitation.** So that noise is not taken for excitation, the columns are those of the last block
//!   whose pose had moved by 10 standard deviations, and a parameter that multiplies the model's wrench
//!   is held while what it changes, the others following it, is less than 100 times (in variance) what
//!   the noise of the pose makes of it. What no reading excites keeps its value; its covariance grows,
//!   and no further than at the start.
//! - **Innovations.** A block beyond 5 standard deviations is left out. Three in a row are a jump: the
//!   covariance of those parameters that may jump is opened. Where that does not explain the readings,
//!   or the mean of 100 blocks leaves chi-square, it is no drift: [`Outcome::Diagnose`], and everything
//!   is held until [`State::resume`].
//! - **Bounds** are projections in the metric of the covariance.
//!
//! ```
//! use ecm_poly::Pose;
//! use ecm_poly::adapt::{Adapter, Noise, Outcome, Parameter, Prior, Reading};
//! let adapter = Adapter {
//!     parameters: [Parameter::Modulus],
//!     priors: [Prior { start: 1.0, sd: 0.2, low: 0.5, high: 2.0, walk: 0.1, jumps: 0.0 }],
//!     noise: Noise {
//!         wrench: [0.3, 0.015],
//!         pose: [4e-5, 4e-4],
//!         time_s: 0.0,
//!         model: [0.02, 1e-3],
//!         reach: [0.01, 0.2],
//!     },
//!     gravity: [-9.81, 0.0, 0.0],
//!     interval_s: 0.1,
//! };
//! let mut state = adapter.init();
//! let stiffness = core::array::from_fn(|i| core::array::from_fn(|j| if i == j { 1e3 } else { 0.0 }));
//! for i in 0..1000 {
//!     let y = 0.01 * (0.05 * f64::from(i)).sin();
//!     let predicted = [0.0, 1e3 * y, 0.0, 0.0, 0.0, 0.0];
//!     let reading = Reading {
//!         pose: Pose::checked(&[0.1, y, 0.0, 0.0, 0.0, 0.0]).unwrap(),
//!         wrench: predicted.map(|x| 0.9 * x),
//!         predicted,
//!         stiffness,
//!         branches: [[0.0; 6]; 2],
//!     };
//!     assert!(adapter.step(&mut state, &reading, 0.01) != Outcome::Diagnose);
//! }
//! assert!((state.values[0] - 0.9).abs() < 0.01);
//! ```

mod block;
#[cfg(feature = "std")]
mod document;
mod parameters;
mod update;

pub use block::{Block, Reading};
pub use parameters::{Noise, Parameter, Prior};

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::{Mat6, Pose, Real, Vec3, Vec6};
use update::{Factor, bound_of_mean, carried, dot, root, shrunk, spread};

use crate::stepper::{BRANCHES, Decay, State as StepperState};

/// A block counts at least as this share of one, so that a pause at one pose ends some day.
const STILL: u16 = 1000;
/// Variance of what a parameter changes over what the noise of the pose makes of it.
const EXCITED: u16 = 100;
/// Blocks in a row beyond the bound that make a jump, and jumps that are no drift.
const SUSPECTS: u32 = 3;
const JUMPS: u32 = 3;
/// Blocks of one test of the innovations.
const WINDOW: u32 = 100;
/// Bounds as those of a normal number: of one block, and of a window (1 in 10⁶).
const BLOCK_BOUND: u16 = 5;
const WINDOW_BOUND: [u16; 2] = [19, 4];

/// Which parameters are estimated, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Adapter<R, const N: usize> {
    /// The parameters, each once.
    pub parameters: [Parameter; N],
    /// What is known of each.
    pub priors: [Prior<R>; N],
    /// Noise of the readings.
    pub noise: Noise<R>,
    /// Gravity in base axes (m/s²).
    pub gravity: Vec3<R>,
    /// Length of a block (s).
    pub interval_s: R,
}

/// What an adapter remembers: plain numbers, which may be stored and loaded.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct State<R, const N: usize> {
    /// The parameters.
    pub values: [R; N],
    /// Their covariance.
    pub covariance: [[R; N]; N],
    /// Readings since the last block.
    pub block: Block<R>,
    /// Means of the last block whose pose had moved.
    pub anchor: Block<R>,
    /// Sum of νᵀ S⁻¹ ν in the window, and how many independent blocks it is worth.
    pub window: [R; 2],
    /// Blocks in the window; in a row beyond the bound; jumps since a window passed; blocks in all.
    pub counts: [u32; 4],
    /// 1 after [`Outcome::Diagnose`].
    pub held: u32,
}

/// What a reading did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Outcome {
    /// It waits for the end of its block.
    Waiting,
    /// The block changed the parameters.
    Adapted,
    /// The block was beyond the bound and left out.
    LeftOut,
    /// Three such blocks: parameters that may jump are open again.
    Jumped,
    /// Neither drift nor jump of these parameters: diagnose again. Everything is held.
    Diagnose,
    /// A number was not finite, or dt not above zero: nothing happened.
    Refused,
}

/// The wrench of each relaxing branch with share 1, at the pose of a stepper's last step.
pub fn branch_wrenches<R: Real>(
    state: &StepperState<R>,
    pose: &Pose<R>,
    length_m: R,
) -> [Vec6<R>; BRANCHES] {
    let frame = MidFrame::new(pose, length_m);
    state.memory.map(|m| frame.wrench(&m).to_array())
}

impl<R: Real, const N: usize> State<R, N> {
    /// Goes on after [`Outcome::Diagnose`], with the values as they are and the covariance of the start.
    pub fn resume(&mut self, adapter: &Adapter<R, N>) {
        let values = self.values;
        *self = adapter.init();
        self.values = values;
    }
}

impl<R: Real, const N: usize> Adapter<R, N> {
    /// The state at the start, which is also a reset.
    pub fn init(&self) -> State<R, N> {
        let mut covariance = [[R::ZERO; N]; N];
        for i in 0..N {
            covariance[i][i] = self.priors[i].sd * self.priors[i].sd;
        }
        State {
            values: self.priors.map(|prior| prior.start),
            covariance,
            block: Block::EMPTY,
            anchor: Block::EMPTY,
            window: [R::ZERO; 2],
            counts: [0; 4],
            held: 0,
        }
    }

    /// Takes one reading, dt (s) after the one before.
    pub fn step(&self, state: &mut State<R, N>, reading: &Reading<R>, dt: R) -> Outcome {
        if !(dt > R::ZERO && dt.is_finite() && reading.is_finite()) {
            return Outcome::Refused;
        }
        if state.held != 0 {
            return Outcome::Diagnose;
        }
        let mut block = state.block;
        block.add(reading, dt, self.interval_s);
        if !block.is_finite() {
            return Outcome::Refused;
        }
        state.block = block;
        // The sum may round down; half a step more than the interval is as near as half a step less.
        if state.block.read_s + R::HALF * dt < self.interval_s {
            return Outcome::Waiting;
        }
        state.block = Block::EMPTY;
        self.close(state, &block.mean(), &reading.stiffness)
    }

    /// Measured wrench that the model and the parameters expect; `of_sensor`: with the sensor's zero,
    /// else what the robot feels.
    pub fn expected(
        &self,
        state: &State<R, N>,
        pose: &Pose<R>,
        predicted: &Vec6<R>,
        branches: &[Vec6<R>; BRANCHES],
        of_sensor: bool,
    ) -> Vec6<R> {
        let columns = self.columns(pose, predicted, branches);
        let mut sum = *predicted;
        for i in 0..N {
            if of_sensor || !self.parameters[i].is_zero() {
                let away = state.values[i] - self.nominal(i);
                for (total, c) in sum.iter_mut().zip(&columns[i]) {
                    *total += away * *c;
                }
            }
        }
        sum
    }

    /// The value at which a parameter changes nothing.
    fn nominal(&self, i: usize) -> R {
        match self.parameters[i] {
            Parameter::Modulus => R::ONE,
            Parameter::ShareFirst | Parameter::ShareSecond => self.priors[i].start,
            _ => R::ZERO,
        }
    }

    fn modulus(&self, state: &State<R, N>) -> R {
        let place = self
            .parameters
            .iter()
            .position(|p| *p == Parameter::Modulus);
        place.map_or(R::ONE, |i| state.values[i])
    }

    /// Columns at a mean of readings; zeros where its pose is none.
    fn columns_at(&self, block: &Block<R>) -> [Vec6<R>; N] {
        match Pose::checked(&block.pose) {
            Some(pose) => self.columns(&pose, &block.predicted, &block.branches),
            None => [[R::ZERO; 6]; N],
        }
    }

    fn columns(
        &self,
        pose: &Pose<R>,
        predicted: &Vec6<R>,
        branches: &[Vec6<R>; BRANCHES],
    ) -> [Vec6<R>; N] {
        let turn = pose.base_from_top();
        self.parameters
            .map(|parameter| parameter.column(&turn, &self.gravity, predicted, branches))
    }

    fn close(&self, state: &mut State<R, N>, block: &Block<R>, stiffness: &Mat6<R>) -> Outcome {
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
        self.update(&mut next, &told, &innovation, apart, &of_pose);
        let mut values = next.values.iter().chain(next.covariance.as_flattened());
        if !(values.all(|x| x.is_finite()) && next.anchor.is_finite()) {
            return Outcome::LeftOut;
        }
        *state = next;
        self.test(state, surprise, apart, told.share_of_model(&noise))
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

    fn update(
        &self,
        state: &mut State<R, N>,
        told: &Told<'_, R, N>,
        innovation: &Vec6<R>,
        apart: R,
        of_pose: &Vec6<R>,
    ) {
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
        // What a parameter changes while the others follow it: P Hᵀ over its own variance.
        let signal: [R; N] = core::array::from_fn(|i| {
            let own = state.covariance[i][i] * state.covariance[i][i];
            let carried = &told.carried[i];
            (0..6).fold(R::ZERO, |sum, a| {
                sum + carried[a] * carried[a] / total[a][a]
            }) / own
        });
        let factor = Factor::new(&total);
        let gain: [Vec6<R>; N] = core::array::from_fn(|i| {
            let excited = signal[i] > R::from_u16(EXCITED) * noisy;
            match self.parameters[i].follows_model() && !excited {
                true => [R::ZERO; 6],
                false => factor.solve(&told.carried[i]),
            }
        });
        for (value, gain) in state.values.iter_mut().zip(&gain) {
            *value += dot(gain, innovation);
        }
        shrunk(&mut state.covariance, &gain, &told.carried, &total);
        self.project(state);
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
    fn test(&self, state: &mut State<R, N>, surprise: R, apart: R, of_model: R) -> Option<Outcome> {
        let alike = (R::ONE - apart) * of_model;
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

    /// Mean share of the model's error in the variance of a block.
    fn share_of_model(&self, noise: &Mat6<R>) -> R {
        let sum = (0..6).fold(R::ZERO, |sum, a| {
            sum + self.model[a] / (self.model[a] + noise[a][a])
        });
        sum / R::from_u16(6)
    }
}
