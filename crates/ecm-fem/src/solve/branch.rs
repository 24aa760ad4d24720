//! Follows a branch of equilibria in small steps of the state, also past limit points of the load.
//!
//! The share λ of the load is an unknown. With the state z, its residual r(z, λ) and one displacement
//! z_j that is given (local parametrisation: Rheinboldt and Burkardt, ACM Trans. Math. Softw. 9, 1983),
//!
//! K a = −r,   K b = −∂r/∂λ,   δλ = −a_j / b_j,   δz = a + δλ b.
//!
//! Both solves use one factorisation. j is the displacement that changes most, so that a step has
//! a largest displacement. A loss of stability is found where the last equilibrium was stable and the
//! next is not.

use super::load_path::{LoadPath, Reached};
use super::newton::{Failure, Workspace};
use super::stability::Instability;
use super::{Actuation, Fem, Load, MOST_ACTUATORS, State, Watch};
use crate::pattern::NONE;
use crate::platform::{Platform, step_size};

/// How a branch ended.
#[derive(Debug, Clone, Copy)]
pub(super) enum End {
    /// Stable beyond the load asked for.
    Passed,
    /// The steps became too small or too many.
    Failed(Failure),
}

/// A loss of stability, between a stable equilibrium and the next one on its branch.
pub(super) struct Loss {
    /// The body gives way, with the platform held or hardly moving (see [`super::critical_mode`]).
    pub within: bool,
    pub before: Reached,
}

/// Largest displacement of the first step, of all and of the smallest, over L.
const FIRST_STEP: f64 = 0.02;
const LARGEST_STEP: f64 = 0.1;
const SMALLEST_STEP: f64 = 1e-4;

/// Largest step of the platform (over L, rad) between two equilibria of one branch.
const LARGEST_PLATFORM_STEP: f64 = 0.2;

/// Ratio of a step to the one before.
const GROWTH: f64 = 1.5;

const MOST_STEPS: usize = 60;
const MOST_ITERATIONS: usize = 8;

/// A step of the unknowns and of the platform.
struct Step {
    unknowns: Vec<f64>,
    platform: [f64; 6],
    inputs: Actuation,
}

impl Fem {
    /// Follows the branch from `last`, which moves along, until its load passes `until`; returns
    /// the number of Newton iterations.
    ///
    /// An equilibrium that is not stable is approached again in smaller steps: a body that is not
    /// quite symmetric turns off before it and may remain stable. `loss` keeps the state before the
    /// first one.
    pub(super) fn follow_branch(
        &self,
        work: &mut Workspace,
        last: &mut Reached,
        path: &LoadPath,
        until: f64,
        loss: &mut Option<Loss>,
        watch: Watch,
    ) -> (End, usize) {
        let length = self.body.mesh.length_m();
        let mut size = FIRST_STEP * length;
        let mut direction: Option<Vec<f64>> = None;
        let mut state = last.state.clone();
        let mut iterations = 0;
        work.ready = false;
        for _ in 0..MOST_STEPS {
            let mut share = last.share;
            let outcome = self.branch_step(
                work,
                &mut state,
                &mut share,
                path,
                (&direction, size),
                watch,
            );
            let moved = step_size(&last.state.platform.step_to(&state.platform), length);
            let failure = match outcome {
                Ok(n) if moved <= LARGEST_PLATFORM_STEP => {
                    iterations += n;
                    let (result, instability) = self.report(work, &state, &path.at(share).0);
                    if let Some(instability) = instability {
                        // The closest loss tells best what gives way.
                        let within = instability == Instability::Inner
                            || self.gives_way_within(work, &state);
                        let first = || Loss {
                            within,
                            before: last.clone(),
                        };
                        loss.get_or_insert_with(first).within = within;
                        Failure::Diverged
                    } else if self.is_collapsed(&state) {
                        Failure::Collapsed
                    } else if share >= 1.0 {
                        // Load steps end the path exactly at the load.
                        return (End::Passed, iterations);
                    } else {
                        let before = &last.state.field.displacement;
                        let change = state.field.displacement.iter().zip(before);
                        direction = Some(change.map(|(new, old)| new - old).collect());
                        last.state.clone_from(&state);
                        last.result = Some(result);
                        last.share = share;
                        if share >= until {
                            return (End::Passed, iterations);
                        }
                        size = (GROWTH * size).min(LARGEST_STEP * length);
                        continue;
                    }
                }
                Ok(_) => Failure::Diverged,
                Err(Failure::Cancelled) => return (End::Failed(Failure::Cancelled), iterations),
                Err(failure) => failure,
            };
            size *= 0.25;
            if size < SMALLEST_STEP * length {
                return (End::Failed(failure), iterations);
            }
            state.clone_from(&last.state);
            work.ready = false;
        }
        (End::Failed(Failure::Diverged), iterations)
    }

    /// One step from an equilibrium to the next; returns the number of Newton iterations.
    fn branch_step(
        &self,
        work: &mut Workspace,
        state: &mut State,
        share: &mut f64,
        path: &LoadPath,
        (direction, size): (&Option<Vec<f64>>, f64),
        watch: Watch,
    ) -> Result<usize, Failure> {
        // Where every displacement is given there is none to step along.
        if self.pattern.unknowns == 0 {
            return Err(Failure::Diverged);
        }
        let (load, beside) = path.at(*share);
        work.set_beside(state, &beside);
        if !work.ready {
            self.tangent(work, state, &load)?;
        }
        let rate = self.load_rate(work, state, path)?;
        let free = || {
            self.pattern
                .of_displacement
                .iter()
                .enumerate()
                .filter(|(_, u)| **u != NONE)
        };
        let (mut fastest, mut along) = (0, 0.0);
        for (component, &unknown) in free() {
            let value = rate.unknowns[unknown as usize];
            if value.abs() > rate.unknowns[fastest].abs() {
                fastest = unknown as usize;
            }
            along += direction.as_ref().map_or(1.0, |d| value * d[component]);
        }
        let forward = if direction.is_some() {
            along.signum()
        } else {
            1.0
        };
        let step = forward * size / rate.unknowns[fastest].abs();
        if !step.is_finite() {
            return Err(Failure::Diverged);
        }
        self.advance(work, state, &rate, step);
        *share += step;
        for iteration in 1..=MOST_ITERATIONS {
            if watch.cancelled() {
                work.ready = false;
                return Err(Failure::Cancelled);
            }
            let (load, beside) = path.at(*share);
            work.set_beside(state, &beside);
            self.assemble(work, state)?;
            let target = match &load {
                Load::Pose(p) => Some(Platform::from_pose(p)),
                Load::Wrench(_) => None,
            };
            let gap = self.residuals(work, state, &load, target.as_ref());
            if !work.balance.residual.is_finite() {
                return Err(Failure::Diverged);
            }
            self.factorise(work)?;
            let softened = self.body.is_softened(work.sums.softening);
            if work.balance.residual <= self.settings.tolerance && !softened {
                return Ok(iteration);
            }
            let platform = self
                .step(work, &gap, target.is_some())
                .ok_or(Failure::Diverged)?;
            let unknowns = work.columns[6 * self.pattern.unknowns..].to_vec();
            let inputs = work.input_step;
            let rate = self.load_rate(work, state, path)?;
            let more = -unknowns[fastest] / rate.unknowns[fastest];
            let sum = |a: &f64, b: &f64| a + more * b;
            let correction = Step {
                unknowns: unknowns
                    .iter()
                    .zip(&rate.unknowns)
                    .map(|(a, b)| sum(a, b))
                    .collect(),
                platform: std::array::from_fn(|k| sum(&platform[k], &rate.platform[k])),
                inputs: std::array::from_fn(|k| sum(&inputs[k], &rate.inputs[k])),
            };
            let most = free().map(|(_, &u)| correction.unknowns[u as usize].abs());
            if !(more.is_finite() && most.fold(0.0, f64::max) <= size) {
                return Err(Failure::Diverged);
            }
            self.advance(work, state, &correction, 1.0);
            *share += more;
        }
        Err(Failure::Diverged)
    }

    /// Change of the state with the share of the load, by the factor in `work`.
    fn load_rate(
        &self,
        work: &mut Workspace,
        state: &State,
        path: &LoadPath,
    ) -> Result<Step, Failure> {
        let rate = path.beside_rate();
        let mut force = self.body.dead_force_N.clone();
        force.iter_mut().for_each(|f| *f *= rate.weight);
        let mut rigid = [0.0; 6];
        let mut gaps = [0.0; MOST_ACTUATORS];
        for (c, gradient) in work.sums.amount_gradient.iter().enumerate() {
            let input = rate.actuation[c];
            if rate.amounts >> c & 1 == 1 {
                gaps[c] = input;
                continue;
            }
            for (f, g) in force.iter_mut().zip(gradient) {
                *f += input * g;
            }
            (0..6).for_each(|k| rigid[k] += input * work.sums.rigid_gradient[c][k]);
        }
        self.pattern
            .of_unknowns(|component| -force[component], &mut work.residual);
        let held = matches!(path.end.load, Load::Pose(_));
        let mut gap = path.rate();
        if !held {
            let nodes = &self.pattern.platform_nodes;
            let (of_force, _) = state.platform.wrench(&self.body.mesh, nodes, &force);
            (0..6).for_each(|k| gap[k] += of_force[k] + rigid[k]);
        }
        work.amount_gap = gaps;
        let platform = self.step(work, &gap, held).ok_or(Failure::Diverged)?;
        let unknowns = work.columns[6 * self.pattern.unknowns..].to_vec();
        let inputs = work.input_step;
        Ok(Step {
            unknowns,
            platform,
            inputs,
        })
    }

    fn advance(&self, work: &mut Workspace, state: &mut State, step: &Step, share: f64) {
        work.columns[6 * self.pattern.unknowns..].copy_from_slice(&step.unknowns);
        work.input_step = step.inputs;
        self.move_by(work, state, &step.platform, share);
        std::mem::swap(state, &mut work.trial);
    }
}
