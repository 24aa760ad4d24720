//! A model that keeps itself right: a few named parameters, estimated while the robot works.
//!
//! The measured wrench is z = s h(p) + Σ (g − g₀) w_b − (m g, R c × m g) + (R b_f, R b_τ) + noise,
//! linear in all of [`Parameter`]: a Kalman filter over parameters that wander at random (Jazwinski,
//! Stochastic Processes and Filtering Theory, 1970). What differs from the textbook:
//!
//! - **Blocks.** Readings are averaged over `interval_s`, with as many independent ones as their noise
//!   time allows, and then enter as one. Their noise is R = Σ_h + s² K Σ_p Kᵀ: the pose is measured too.
//! - **Noise of the pose** is in the innovation and in the columns H, which draws parameters to wrong
//!   values wherever the excitation is weak (errors in variables). So each half of a block is the
//!   instrument of the other (Söderström and Stoica, Instrumental Variable Methods, 1983): with H± and ν±
//!   the sum and the difference of the halves over 2, x ← x + P (H₊ᵀ S⁻¹ ν₊ − H₋ᵀ S⁻¹ ν₋), whose mean
//!   has no noise in it, whatever the noise that is stated. P follows this gain in Joseph's form.
//! - **Error of the model** is [`ModelError`]: random numbers that are alike at like poses, whose
//!   covariance with the parameters is kept. It grows towards the rim of the fitted domain and beyond it
//!   ([`Noise::rim`]), so that a pose at which nothing holds the model neither draws a parameter nor
//!   counts as an alarm. The part that changes on the way counts, with
//!   φ = e^(−way/reach), as (1 − φ)/(1 + φ) of one: standing still is no proof.
//! - **Excitation.** A parameter that multiplies the model's wrench is held while the last 200 blocks tell
//!   less of it, whatever the others are, than ten times what the noise of the pose seems to: along a
//!   direction that is told so little, the noise multiplies the estimate by a random factor. The
//!   information is H₊ᵀ R⁻¹ H₊ − H₋ᵀ R⁻¹ H₋ and its Schur complement, by the noise of the readings alone
//!   (the strength of instruments, Staiger and Stock, Econometrica 65, 1997): with the covariance of the
//!   parameters in its weight no block could tell more than is known, and what is least known would be held
//!   for ever. What no reading excites keeps its value; its variance returns to that of the start.
//! - **Innovations.** A block beyond 5 standard deviations, with twice the stated variance of the
//!   model's error, is left out. Three in a row are a jump: the covariance of those parameters that may jump is
//!   opened. Where that does not explain the readings, or the mean of 100 blocks leaves chi-square, it is
//!   no drift: [`Outcome::Diagnose`], and everything is held until [`State::resume`].
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
//!         rim: 3.0,
//!         middle: [0.1, 0.0, 0.0, 0.0, 0.0, 0.0],
//!         per_half_range: [0.0, 100.0, 100.0, 5.0, 2.5, 2.5],
//!     },
//!     gravity: [-9.81, 0.0, 0.0],
//!     interval_s: 0.1,
//! };
//! let mut state = adapter.init();
//! let diagonal = [1e3, 1e3, 1e3, 1.0, 1.0, 1.0];
//! let stiffness =
//!     core::array::from_fn(|i| core::array::from_fn(|j| if i == j { diagonal[i] } else { 0.0 }));
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
mod filter;
mod model_error;
mod parameters;
mod update;

pub use block::{Block, Reading};
pub use model_error::{CELLS, ModelError, PARTS};
pub use parameters::{Noise, Parameter, Prior};

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::{Pose, Real, Vec3, Vec6};

use crate::stepper::{BRANCHES, State as StepperState};

/// A parameter is told where the information is this many times what noise seems to add.
const TOLD: u16 = 10;

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
    /// Readings since the last block, by halves of the interval.
    pub block: [Block<R>; 2],
    /// Time since the last block (s), pauses included.
    pub time_s: R,
    /// Pose of the last block that had moved.
    pub last: Vec6<R>,
    /// Wrenches of the model and of the branches there.
    pub at_last: [Vec6<R>; 1 + BRANCHES],
    /// Error of the model.
    pub model: ModelError<R, N>,
    /// What the last blocks tell of each parameter that follows the model, whatever the others are, and what
    /// noise seems to add.
    pub excitation: [[R; 2]; N],
    /// Mean of H₊ᵀ R⁻¹ H₊ − H₋ᵀ R⁻¹ H₋: what the last blocks tell of all parameters together.
    pub information: [[R; N]; N],
    /// Mean of what noise seems to add to it along a parameter.
    pub of_noise: R,
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
            block: [Block::EMPTY; 2],
            time_s: R::ZERO,
            last: [R::ZERO; 6],
            at_last: [[R::ZERO; 6]; 1 + BRANCHES],
            model: ModelError::EMPTY,
            excitation: [[R::ZERO, R::ONE]; N],
            information: [[R::ZERO; N]; N],
            of_noise: R::ZERO,
            window: [R::ZERO; 2],
            counts: [0; 4],
            held: 0,
        }
    }

    /// Whether a parameter is held, because the motion of the last time tells too little of it, whatever the
    /// others are: less than ten times what the noise of the pose seems to. At the start until it tells more.
    /// This is a matter of poses and noise; what is known of the parameter has no part in it. False where i
    /// is no parameter's place.
    pub fn is_held(&self, state: &State<R, N>, i: usize) -> bool {
        let (Some(parameter), Some([told, of_noise])) =
            (self.parameters.get(i), state.excitation.get(i))
        else {
            return false;
        };
        let tells = *told > R::from_u16(TOLD) * *of_noise;
        parameter.follows_model() && !tells
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
        // What was read before a pause longer than an interval is dropped.
        if dt > self.interval_s {
            block = [Block::EMPTY; 2];
        }
        let read_s = block[0].read_s + block[1].read_s + R::HALF * dt;
        // No rate of readings has its middle at nine twentieths, so that rounding decides nothing.
        let middle = R::from_u16(9) / R::from_u16(20) * self.interval_s;
        let half = &mut block[usize::from(read_s >= middle)];
        half.add(reading, dt);
        let time_s = state.time_s + dt;
        if !(half.is_finite() && time_s.is_finite()) {
            return Outcome::Refused;
        }
        state.block = block;
        state.time_s = time_s;
        // The sum may round down; half a step more than the interval is as near as half a step less.
        if read_s + dt < self.interval_s {
            return Outcome::Waiting;
        }
        state.block = [Block::EMPTY; 2];
        state.time_s = R::ZERO;
        self.close(state, &block, time_s, &reading.stiffness)
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
}
