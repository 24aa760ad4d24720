//! Effects of time in steps of any length: relaxation, friction, temperature, damping, softening, set.
//!
//! The static map gives h and K at a pose. A [`Stepper`] adds what depends on the way there: it takes
//! the path since the step before as straight in the mid-frame coordinates q = (c, θ) and passed at
//! constant speed, and is exact for that path whatever dt is. With Q the force to q of h, a branch m
//! of time constant τ obeys m' = x' − m/τ, so that
//!
//! m ← m + s Δx − (1 − e^(−dt/τ)) m,  s = (1 − e^(−dt/τ)) τ/dt,  x = k q or Q(q),
//!
//! and a spring that slips z ← clamp(z + Δq, ±limit), which beyond a play w pulls κ (z − clamp(z, ±w)).
//! Springs that slip as one share |z / limit| ≤ 1: z ← z / |z / limit|, for steps that turn little.
//! Several side by side, each with a limit of its own, make a smooth loop; they may follow p and act on h.
//! The wrench is that of Σ g m and these pulls, turned with the mid frame: stress stays with the
//! material, and a turn of the base turns everything.
//! After a set the rest pose has moved by a share of the farthest pose: h(p − s) acts in place of h(p).
//! Work is done on Q dq, so that branches of k q (k ≥ 0, g ≥ 0) and springs that slip only take energy.
//! A map of fewer columns has no frame, as its others are not known: q is p, Q is h, and k is full.
//!
//! ```
//! use ecm_poly::stepper::{Branch, Effects, Stepper, diagonal};
//! use ecm_poly::{EnergyModel, Pose, PoseModel};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! # let neck = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus/energy4.json");
//! let model = PoseModel::from_json(&std::fs::read_to_string(neck)?)?;
//! let mut effects = Effects::none(0.1034);
//! effects.stiffness = diagonal(&[4e4, 3e3, 3e3, 4.0, 16.0, 16.0]);
//! effects.branches[0] = Branch { share: 0.1, tau_s: 5.0, linear: true };
//! let stepper = Stepper { model: &model, effects };
//! let rest = Pose::at_rest(0.1034);
//! let bent = Pose::from_array(&[0.1, 0.005, 0.0, 0.0, 0.0, 0.1])?;
//! let mut state = stepper.init(&rest).ok_or("no finite wrench")?;
//! let inputs = effects.default_inputs();
//! let (fast, _) = stepper.step(&mut state, &bent, 0.01, &inputs).ok_or("refused")?;
//! let (after_an_hour, _) = stepper.step(&mut state, &bent, 3600.0, &inputs).ok_or("refused")?;
//! let (settled, _) = stepper.settled(&bent, &inputs).ok_or("refused")?;
//! assert!(fast.torque[2] > 1.05 * settled.torque[2]);
//! assert!((after_an_hour.torque[2] - settled.torque[2]).abs() < 1e-9);
//! # Ok(()) }
//! ```

mod decay;
mod effects;
mod frame;
mod state;

#[cfg(feature = "std")]
mod document;
#[cfg(feature = "std")]
mod models;

pub use decay::Decay;
pub use effects::{BRANCHES, Branch, Effects, Inputs, SPRINGS, Softening, diagonal};
pub use state::{STATE_NUMBERS, State, state_numbers};

use ecm_se3::linear::add;
use ecm_se3::{Mat6, Pose, Real, Vec6, Wrench};

use effects::length;
use frame::Frame;

/// Length from which springs that slip as one do: where nothing moves rounding is no slip.
const SLIPS: f64 = 1.0 + 1e-5;

/// A static map from pose to wrench.
pub trait Elastic<R> {
    /// h and K = ∂h/∂p.
    fn wrench_and_stiffness(&self, pose: &Pose<R>) -> (Wrench<R>, Mat6<R>);
}

/// A static map with effects of time.
#[derive(Clone, Copy, Debug)]
pub struct Stepper<'a, R, M> {
    /// The static map.
    pub model: &'a M,
    /// Effects beside it.
    pub effects: Effects<R>,
}

/// The static map at one pose.
struct Here<R> {
    pose: Vec6<R>,
    frame: Frame<R>,
    wrench: Wrench<R>,
    stiffness: Mat6<R>,
    /// W and ∂W/∂p.
    load: R,
    load_slope: Vec6<R>,
}

/// The static map at the pose less the set; the derivative is that to the pose.
struct AfterSet<R> {
    wrench: Wrench<R>,
    stiffness: Mat6<R>,
}

impl<R: Real, M: Elastic<R>> Stepper<'_, R, M> {
    /// The state after an infinite rest at a pose that was reached without friction.
    ///
    /// None where the static wrench there is not finite.
    #[inline]
    pub fn init(&self, pose: &Pose<R>) -> Option<State<R>> {
        let here = self.here(pose)?;
        Some(State {
            farthest: here.pose,
            coordinates: here.frame.coordinates(),
            force: here.frame.force(&here.wrench),
            stretch: [R::ZERO; 6],
            memory: [[R::ZERO; 6]; BRANCHES],
            carry: [[R::ZERO; 6]; BRANCHES],
            largest: here.load,
            further: [[R::ZERO; 6]; SPRINGS - 1],
        })
    }

    /// The wrench and its derivative to the pose, dt (s) after the step before.
    ///
    /// dt = 0 is a sudden move: everything takes part, and damping, which would be infinite, counts
    /// as zero. None, and the state as it was, where dt is negative or not finite, an input is not
    /// finite, the static wrench is not, or the pose is beyond the limits; the next dt then counts from the last step that was taken.
    #[inline]
    pub fn step(
        &self,
        state: &mut State<R>,
        pose: &Pose<R>,
        dt: R,
        inputs: &Inputs<R>,
    ) -> Option<(Wrench<R>, Mat6<R>)> {
        if !(dt >= R::ZERO && dt.is_finite() && inputs.are_finite()) {
            return None;
        }
        let effects = &self.effects;
        let small;
        let pose = if effects.grows() {
            small = effects.ungrown(pose, inputs)?;
            &small
        } else {
            pose
        };
        let here = self.here(pose)?;
        let set = self.after_set(&here, state)?;
        let q = here.frame.coordinates();
        let force = here.frame.force(&here.wrench);
        let decays = effects.branches.map(|branch| Decay::new(dt / branch.tau_s));
        let (mut total, mut steep) = ([R::ZERO; 6], [[R::ZERO; 6]; 6]);
        let mut elastic = R::ZERO;
        for (branch, decay) in effects.branches.iter().zip(&decays) {
            if !branch.linear {
                elastic += branch.share * decay.share;
            }
        }
        let along: Vec6<R> = core::array::from_fn(|j| q[j] - state.coordinates[j]);
        let path = if effects.of_pose {
            self.moved(&q, &state.coordinates)
        } else {
            along
        };
        let (mut pulls, mut grips, mut turns) = ([R::ZERO; 6], [R::ZERO; 6], [R::ZERO; 6]);
        let part = R::ONE / R::from_f64(effects.springs as f64);
        let all = core::iter::once(&mut state.stretch).chain(&mut state.further);
        for (place, stretches) in all.take(effects.springs).enumerate() {
            let size = part * R::from_f64((2 * place + 1) as f64);
            let shares: Vec6<R> = core::array::from_fn(|j| match size * effects.slip[j] {
                limit if effects.together && limit > R::ZERO => (stretches[j] + path[j]) / limit,
                _ => R::ZERO,
            });
            let over = length(shares.iter());
            for j in 0..6 {
                let (limit, play) = (size * effects.slip[j], size * effects.play[j]);
                if over > R::from_f64(SLIPS) && limit > R::ZERO {
                    stretches[j] = limit * shares[j] / over;
                    (pulls[j], grips[j]) = (stretches[j], R::ONE / over);
                    turns[j] = shares[j] / (over * over * limit);
                    continue;
                }
                let wanted = stretches[j] + path[j];
                let stretch = wanted.clamped(-limit, limit);
                stretches[j] = stretch;
                if -limit <= wanted && wanted <= limit && !(-play < stretch && stretch < play) {
                    grips[j] += part;
                }
                pulls[j] += part * (stretch - stretch.clamped(-play, play));
            }
        }
        for i in 0..6 {
            let (stiffness, friction) = (&effects.stiffness[i], &effects.friction[i]);
            let coupled = effects.coupled(i);
            let linear_step = coupled
                .clone()
                .fold(R::ZERO, |sum, j| sum + stiffness[j] * along[j]);
            let static_step = force[i] - state.force[i];
            for (b, (branch, decay)) in effects.branches.iter().zip(&decays).enumerate() {
                let driven = if branch.linear {
                    linear_step
                } else {
                    static_step
                };
                let old = state.memory[b][i];
                let change = (decay.share * driven - decay.lost * old) + state.carry[b][i];
                let new = old + change;
                state.carry[b][i] = change - (new - old);
                state.memory[b][i] = new;
                total[i] += branch.share * new;
                if branch.linear {
                    for j in coupled.clone() {
                        steep[i][j] += branch.share * decay.share * stiffness[j];
                    }
                }
            }
            if effects.of_pose {
                continue;
            }
            let pulled = coupled
                .clone()
                .fold(R::ZERO, |sum, j| sum + friction[j] * pulls[j]);
            total[i] += pulled;
            for j in coupled {
                steep[i][j] += friction[j] * grips[j] - pulled * turns[j];
            }
        }
        let largest = if here.load > state.largest {
            here.load
        } else {
            state.largest
        };
        let (lost, falls) = effects.softening.lost(here.load, largest);
        let size = self.effects.size(inputs);
        let loss = effects.softening.share * lost;
        // With a set h(p − s) stands for h(p), which temperature and the largest load scale.
        let own = if set.is_some() {
            size - loss - R::ONE
        } else {
            size - loss
        };
        let mut wrench = here.scaled(own);
        let carried = here.frame.wrench(&total);
        wrench.force = add(&wrench.force, &carried.force);
        wrench.torque = add(&wrench.torque, &carried.torque);
        // d(Q(q) terms) is `elastic` times that of h less what the turning frame adds to both.
        let turning: Vec6<R> = core::array::from_fn(|j| total[j] - elastic * force[j]);
        let beside = here.frame.carried(&turning, &steep);
        let factor = own + elastic;
        let mut tangent: Mat6<R> = core::array::from_fn(|i| {
            core::array::from_fn(|j| factor * here.stiffness[i][j] + beside[i][j])
        });
        if effects.of_pose {
            for i in 0..6 {
                let pull = effects.coupled(i).fold(R::ZERO, |sum, j| {
                    tangent[i][j] += effects.friction[i][j] * grips[j];
                    sum + effects.friction[i][j] * pulls[j]
                });
                match i {
                    0..3 => wrench.force[i] += pull,
                    _ => wrench.torque[i - 3] += pull,
                }
            }
        }
        if largest > here.load {
            let h = here.wrench.to_array();
            for i in 0..6 {
                for j in 0..6 {
                    tangent[i][j] += effects.softening.share * h[i] * here.load_slope[j] * falls;
                }
            }
        }
        if let Some(set) = &set {
            wrench.force = add(&wrench.force, &set.wrench.force);
            wrench.torque = add(&wrench.torque, &set.wrench.torque);
            for (row, more) in tangent.iter_mut().zip(&set.stiffness) {
                for (k, x) in row.iter_mut().zip(more) {
                    *k += *x;
                }
            }
        }
        if dt > R::ZERO && effects.damps() {
            let moved = self.moved(&q, &state.coordinates);
            for (i, row) in tangent.iter_mut().enumerate() {
                for j in effects.coupled(i) {
                    let damping = effects.damping[i][j] / dt;
                    // A dt so short that this overflows is a sudden move as well.
                    if damping.is_finite() {
                        let more = damping * moved[j];
                        match i {
                            0..3 => wrench.force[i] += more,
                            _ => wrench.torque[i - 3] += more,
                        }
                        row[j] += damping;
                    }
                }
            }
        }
        if here.load > state.largest {
            state.farthest = here.pose;
        }
        state.coordinates = q;
        state.force = force;
        state.largest = largest;
        if effects.grows() {
            return Some(effects.regrown(&wrench, tangent, inputs));
        }
        Some((wrench, tangent))
    }

    /// The steps through poses that are planned, dt (s) apart, from a state that stays as it is.
    ///
    /// Ends before the first pose at which [`Stepper::step`] would refuse.
    ///
    /// ```
    /// use ecm_poly::stepper::{Effects, Stepper};
    /// use ecm_poly::{Pose, PoseModel};
    /// # fn main() -> Result<(), Box<dyn std::error::Error>> {
    /// # let neck = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/corpus/energy4.json");
    /// let model = PoseModel::from_json(&std::fs::read_to_string(neck)?)?;
    /// let stepper = Stepper { model: &model, effects: Effects::none(0.1034) };
    /// let state = stepper.init(&Pose::at_rest(0.1034)).ok_or("no finite wrench")?;
    /// let path = [0.103, 0.1025, 0.102].map(Pose::at_rest);
    /// let inputs = stepper.effects.default_inputs();
    /// let wrenches = stepper.predict_ahead(&state, path, 0.02, &inputs).map(|(h, _)| h.force[0]);
    /// assert!(wrenches.collect::<Vec<_>>().is_sorted_by(|a, b| a > b));
    /// # Ok(()) }
    /// ```
    pub fn predict_ahead(
        &self,
        state: &State<R>,
        poses: impl IntoIterator<Item = Pose<R>>,
        dt: R,
        inputs: &Inputs<R>,
    ) -> impl Iterator<Item = (Wrench<R>, Mat6<R>)> {
        let (mut ahead, inputs) = (*state, *inputs);
        (poses.into_iter()).map_while(move |pose| self.step(&mut ahead, &pose, dt, &inputs))
    }

    /// The wrench of each relaxing branch with share 1, at the pose of the last step.
    #[inline]
    pub fn branches(&self, state: &State<R>) -> [Vec6<R>; BRANCHES] {
        let nothing = [[R::ZERO; 6]; BRANCHES];
        let pose = frame::pose_of(&self.effects, &state.coordinates);
        Pose::checked(&pose).map_or(nothing, |pose| {
            let frame = Frame::new(&self.effects, &pose);
            state.memory.map(|m| frame.wrench(&m).to_array())
        })
    }

    /// The limit of a long rest at a pose, and K there: no friction, nothing softened, no set.
    #[inline]
    pub fn settled(&self, pose: &Pose<R>, inputs: &Inputs<R>) -> Option<(Wrench<R>, Mat6<R>)> {
        if !inputs.are_finite() {
            return None;
        }
        let here = self.here(&self.effects.ungrown(pose, inputs)?)?;
        let size = self.effects.size(inputs);
        let tangent = here.stiffness.map(|row| row.map(|k| size * k));
        Some(self.effects.regrown(&here.scaled(size), tangent, inputs))
    }

    /// h and K at the pose less the set; None where they are not finite, no set where it is none.
    #[inline(always)]
    fn after_set(&self, here: &Here<R>, state: &State<R>) -> Option<Option<AfterSet<R>>> {
        let share = self.effects.set_share;
        if share * share <= R::ZERO {
            return Some(None);
        }
        let grows = here.load > state.largest;
        let farthest = if grows { &here.pose } else { &state.farthest };
        let mut shifted = core::array::from_fn(|j| here.pose[j] - share * farthest[j]);
        shifted[0] += share * self.effects.length_m;
        let (wrench, stiffness) = self.model.wrench_and_stiffness(&Pose::checked(&shifted)?);
        let sum = (wrench.to_array().iter()).fold(R::ZERO, |sum, &x| sum + x);
        // At the farthest pose the set grows with the pose.
        let rate = if grows { R::ONE - share } else { R::ONE };
        let stiffness = stiffness.map(|row| row.map(|k| rate * k));
        sum.is_finite()
            .then_some(Some(AfterSet { wrench, stiffness }))
    }

    /// Change of the pose between two q; not at all where they are equal.
    #[inline(always)]
    fn moved(&self, q: &Vec6<R>, before: &Vec6<R>) -> Vec6<R> {
        let along = self.effects.damping[0][0];
        let turns_alone = along * along <= R::ZERO && !self.effects.of_pose;
        if self.effects.columns.is_some() || turns_alone {
            return core::array::from_fn(|j| q[j] - before[j]);
        }
        let [now, then] = [q, before].map(|q| frame::pose_of(&self.effects, q));
        core::array::from_fn(|j| now[j] - then[j])
    }

    #[inline(always)]
    fn here(&self, pose: &Pose<R>) -> Option<Here<R>> {
        let (wrench, stiffness) = self.model.wrench_and_stiffness(pose);
        let (p, h) = (pose.to_array(), wrench.to_array());
        let sum = h.iter().fold(R::ZERO, |sum, &x| sum + x);
        let frame = Frame::new(&self.effects, pose);
        if !(sum.is_finite() && frame.is_near(&self.effects)) {
            return None;
        }
        let mut away = p;
        away[0] -= self.effects.length_m;
        let (load, load_slope) = self.effects.softening.load(&away, &h, &stiffness);
        Some(Here {
            pose: p,
            frame,
            wrench,
            stiffness,
            load,
            load_slope,
        })
    }
}

impl<R: Real> Here<R> {
    fn scaled(&self, factor: R) -> Wrench<R> {
        Wrench {
            force: self.wrench.force.map(|x| factor * x),
            torque: self.wrench.torque.map(|x| factor * x),
        }
    }
}
