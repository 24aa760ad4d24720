//! Newton's method on nodes, pressures and platform together.

use super::{Actuation, Fem, Load, MOST_ACTUATORS, State, Watch};
use crate::assembly::Sums;
use crate::factor::Factor;
use crate::pattern::NONE;
use crate::platform::{Platform, step_size};
use crate::tensor::Mat3;
use faer::mat::MatMut;
use std::time::Instant;

/// Seconds spent in the parts of a solve.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Timing {
    /// Element loops.
    pub assembly_s: f64,
    /// Numeric factorisations.
    pub factor_s: f64,
    /// Triangular solves.
    pub solve_s: f64,
    /// Number of factorisations.
    pub factorisations: usize,
}

/// Working memory of one thread.
#[derive(Debug)]
pub(super) struct Workspace {
    pub sums: Sums,
    pub factor: Factor,
    /// L⁻¹ K_f6, column by column, then one column for the step.
    pub columns: Vec<f64>,
    pub pivots: Vec<f64>,
    pub residual: Vec<f64>,
    pub trial: State,
    /// Whether `sums`, `factor` and the first six `columns` belong to the current state.
    pub ready: bool,
    pub balance: Balance,
    pub timing: Timing,
    /// Bit k: of actuator k the amount is given.
    pub given: u32,
    /// The given amounts, and inputs of the other actuators.
    pub targets: Actuation,
    /// What is missing of the given amounts.
    pub amount_gap: Actuation,
    /// Step of their inputs.
    pub input_step: Actuation,
    pub border: Border,
}

/// The given amounts at the state of the factor.
#[derive(Debug, Clone, Default)]
pub(super) struct Border {
    /// Numbers of the actuators.
    pub of: Vec<usize>,
    /// Z of each.
    pub columns: Vec<Vec<f64>>,
    /// G of each.
    pub on_wrench: Vec<[f64; 6]>,
    /// C among them.
    pub on_amounts: Vec<Vec<f64>>,
}

/// Equilibrium of the platform at a state.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Balance {
    pub wrench: [f64; 6],
    pub geometric: Mat3,
    /// Norm of all residuals over the force unit.
    pub residual: f64,
    pub inner_instabilities: usize,
}

/// Why Newton stopped without an equilibrium.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Failure {
    Diverged,
    Inverted,
    Collapsed,
    Cancelled,
}

/// Iterates that are unstable and bring no progress, after which Newton gives up.
pub(super) const MOST_UNSTABLE_ITERATES: usize = 3;

/// Smallest share of a Newton step that is tried.
const SMALLEST_SHARE: f64 = 1.0 / 64.0;

/// Largest expected ratio of residuals at which a step reuses an old factor.
const CHORD_GAIN: f64 = 0.1;

impl Workspace {
    pub fn new(fem: &Fem) -> Self {
        let n = fem.pattern.unknowns;
        Self {
            sums: Sums::new(&fem.body, &fem.pattern),
            factor: Factor::new(&fem.pattern.symbolic),
            columns: vec![0.0; 7 * n],
            pivots: vec![0.0; n],
            residual: vec![0.0; n],
            trial: fem.rest(),
            ready: false,
            balance: Balance::default(),
            timing: Timing::default(),
            given: 0,
            targets: [0.0; MOST_ACTUATORS],
            amount_gap: [0.0; MOST_ACTUATORS],
            input_step: [0.0; MOST_ACTUATORS],
            border: Border::default(),
        }
    }
}

impl Fem {
    /// Takes `state` to equilibrium under `load` in at most `most` iterations; returns
    /// their number.
    ///
    /// On success tangent, factor and `balance` belong to the final state.
    pub(super) fn newton(
        &self,
        work: &mut Workspace,
        state: &mut State,
        load: &Load,
        (most, most_unstable): (usize, usize),
        watch: Watch,
    ) -> Result<usize, (Failure, usize)> {
        let n = self.pattern.unknowns;
        if !work.ready {
            self.place_platform_nodes(state);
            work.sums.softening = 0.0;
            self.assemble(work, state).map_err(|f| (f, 0))?;
        }
        let target = match load {
            Load::Pose(p) => Some(Platform::from_pose(p)),
            Load::Wrench(_) => None,
        };
        let mut iteration = 0;
        let mut previous_share = 1.0;
        let (mut unstable_iterates, mut without_progress) = (0, 0);
        let mut last_residual = f64::INFINITY;
        let mut has_factor = false;
        loop {
            if watch.cancelled() {
                work.ready = false;
                return Err((Failure::Cancelled, iteration));
            }
            let gap = self.residuals(work, state, load, target.as_ref());
            if work.balance.residual.is_nan() {
                return Err((Failure::Diverged, iteration));
            }
            let softened = self.body.is_softened(work.sums.softening);
            let converged = work.balance.residual <= self.settings.tolerance && !softened;
            // A step with the factor of the state before gains about twice what the last gained.
            let gain = 2.0 * work.balance.residual / last_residual;
            let chord = has_factor
                && unstable_iterates == 0
                && gain < CHORD_GAIN
                && gain * work.balance.residual <= self.settings.tolerance;
            if !work.ready && (converged || !chord) {
                self.factorise(work).map_err(|f| (f, iteration))?;
            }
            has_factor = true;
            if converged {
                return Ok(iteration);
            }
            unstable_iterates += usize::from(work.balance.inner_instabilities > 0);
            without_progress += usize::from(
                work.balance.inner_instabilities > 0 && work.balance.residual > 0.5 * last_residual,
            );
            last_residual = work.balance.residual;
            if iteration == most || without_progress >= most_unstable {
                work.ready = false;
                return Err((Failure::Diverged, iteration));
            }
            let platform_step = self
                .step(work, &gap, target.is_some())
                .ok_or((Failure::Diverged, iteration))?;
            let size = step_size(&platform_step, self.body.mesh.length_m());
            // After a step that inverted elements cut short, do not try the full step at once.
            let softening = work.sums.softening;
            let mut share = (self.settings.step_limit / size)
                .min(1.0)
                .min(2.0 * previous_share);
            loop {
                work.sums.softening = softening;
                self.move_by(work, state, &platform_step, share);
                std::mem::swap(state, &mut work.trial);
                match self.assemble(work, state) {
                    Ok(()) => break,
                    Err(failure) => {
                        // Back to where the step began; `columns[6 n..]` still holds the step.
                        std::mem::swap(state, &mut work.trial);
                        share *= 0.5;
                        if share < SMALLEST_SHARE {
                            return Err((failure, iteration));
                        }
                    }
                }
            }
            previous_share = share;
            debug_assert_eq!(work.columns.len(), 7 * n);
            iteration += 1;
        }
    }

    /// Tangent, factor and `balance` at a state that need not be an equilibrium.
    pub(super) fn tangent(
        &self,
        work: &mut Workspace,
        state: &mut State,
        load: &Load,
    ) -> Result<(), Failure> {
        self.place_platform_nodes(state);
        work.sums.softening = 0.0;
        self.assemble(work, state)?;
        self.residuals(work, state, load, None);
        self.factorise(work)
    }

    pub(super) fn place_platform_nodes(&self, state: &mut State) {
        for &node in &self.pattern.platform_nodes {
            let u = state.platform.displacement(&self.body.mesh, node);
            state.field.displacement[3 * node..3 * node + 3].copy_from_slice(&u);
        }
    }

    pub(super) fn assemble(&self, work: &mut Workspace, state: &State) -> Result<(), Failure> {
        let start = Instant::now();
        work.ready = false;
        let outcome = work.sums.assemble(&self.body, &self.pattern, state);
        work.timing.assembly_s += start.elapsed().as_secs_f64();
        outcome.map_err(|_| Failure::Inverted)
    }

    /// Fills the residual and its norm; returns what is missing at the platform: the wrench
    /// (given − current) or the step to the given pose.
    pub(super) fn residuals(
        &self,
        work: &mut Workspace,
        state: &State,
        load: &Load,
        target: Option<&Platform>,
    ) -> [f64; 6] {
        let mut square = 0.0;
        for (component, &unknown) in self.pattern.of_displacement.iter().enumerate() {
            if unknown != NONE {
                let r = work.sums.force[component];
                work.residual[unknown as usize] = r;
                square += r * r;
            }
        }
        for (node, &unknown) in self.pattern.of_pressure.iter().enumerate() {
            if unknown != NONE {
                let r = work.sums.volume[node];
                work.residual[unknown as usize] = r;
                square += r * r;
            }
        }
        let mesh = &self.body.mesh;
        let (mut wrench, geometric) =
            state
                .platform
                .wrench(mesh, &self.pattern.platform_nodes, &work.sums.force);
        for (input, gradient) in work.sums.inputs.iter().zip(&work.sums.rigid_gradient) {
            (0..6).for_each(|k| wrench[k] -= input * gradient[k]);
        }
        work.amount_gap = self.amount_gap(work);
        work.balance.wrench = wrench;
        work.balance.geometric = geometric;
        let length = mesh.length_m();
        let gap = match (load, target) {
            (Load::Wrench(h), _) => std::array::from_fn(|k| h[k] - wrench[k]),
            (_, Some(target)) => state.platform.step_to(target),
            _ => [0.0; 6],
        };
        for k in 0..6 {
            // Moments over L and steps over L, both in the force unit.
            let g = match target {
                None if k < 3 => gap[k],
                None => gap[k] / length,
                Some(_) if k < 3 => gap[k] / length * self.force_unit_N,
                Some(_) => gap[k] * self.force_unit_N,
            };
            square += g * g;
        }
        for (k, missing) in work.amount_gap.iter().enumerate() {
            square += (missing * self.input_unit(k) / length).powi(2);
        }
        work.balance.residual = square.sqrt() / self.force_unit_N;
        gap
    }

    /// Factor of K_ff and L⁻¹ K_f6.
    pub(super) fn factorise(&self, work: &mut Workspace) -> Result<(), Failure> {
        let n = self.pattern.unknowns;
        let symbolic = &self.pattern.symbolic;
        let start = Instant::now();
        let negative = work
            .factor
            .factorise(symbolic, &work.sums.tangent)
            .map_err(|_| Failure::Diverged)?;
        let middle = Instant::now();
        for k in 0..6 {
            for (entry, row) in work.columns[k * n..(k + 1) * n]
                .iter_mut()
                .zip(&work.sums.coupling)
            {
                *entry = row[k];
            }
        }
        let columns = MatMut::from_column_major_slice_mut(&mut work.columns[..6 * n], n, 6);
        work.factor.forward(symbolic, columns);
        work.factor.pivots(symbolic, &mut work.pivots);
        work.border = self.border(work);
        let taken = self.pattern.pressures + self.taken_by_multipliers(&work.border);
        work.balance.inner_instabilities = negative.saturating_sub(taken);
        work.timing.factor_s += (middle - start).as_secs_f64();
        work.timing.solve_s += middle.elapsed().as_secs_f64();
        work.timing.factorisations += 1;
        work.ready = true;
        Ok(())
    }

    /// Newton step of the platform; the step of the unknowns is left in the seventh column.
    pub(super) fn step(
        &self,
        work: &mut Workspace,
        gap: &[f64; 6],
        pose_given: bool,
    ) -> Option<[f64; 6]> {
        let n = self.pattern.unknowns;
        let start = Instant::now();
        let last = &mut work.columns[6 * n..];
        for (entry, r) in last.iter_mut().zip(&work.residual) {
            *entry = -r;
        }
        work.factor.forward(
            &self.pattern.symbolic,
            MatMut::from_column_major_slice_mut(last, n, 1),
        );
        let mut right = *gap;
        if !pose_given {
            // (K_66 − K_6f K_ff⁻¹ K_f6) δ = gap − K_6f y with y = −K_ff⁻¹ r.
            for (k, value) in right.iter_mut().enumerate() {
                *value -= work.along(&work.columns[k * n..(k + 1) * n], &work.columns[6 * n..]);
            }
        }
        let (delta, inputs) = self.bordered_step(work, &right, &work.amount_gap, pose_given)?;
        work.input_step = inputs;
        let (six, last) = work.columns.split_at_mut(6 * n);
        for (k, d) in delta.iter().enumerate() {
            for (entry, z) in last.iter_mut().zip(&six[k * n..(k + 1) * n]) {
                *entry -= d * z;
            }
        }
        for (&k, column) in work.border.of.iter().zip(&work.border.columns) {
            for (entry, z) in last.iter_mut().zip(column) {
                *entry += inputs[k] * z;
            }
        }
        for (entry, pivot) in last.iter_mut().zip(&work.pivots) {
            *entry /= pivot;
        }
        work.factor.backward(
            &self.pattern.symbolic,
            MatMut::from_column_major_slice_mut(last, n, 1),
        );
        work.timing.solve_s += start.elapsed().as_secs_f64();
        Some(delta)
    }

    /// `work.trial` = `state` moved by `share` of the step.
    pub(super) fn move_by(
        &self,
        work: &mut Workspace,
        state: &State,
        platform_step: &[f64; 6],
        share: f64,
    ) {
        let step = &work.columns[6 * self.pattern.unknowns..];
        let trial = &mut work.trial;
        trial.platform = state.platform.moved(platform_step, share);
        trial.inputs = std::array::from_fn(|k| state.inputs[k] + share * work.input_step[k]);
        let displacement = trial
            .field
            .displacement
            .iter_mut()
            .zip(&state.field.displacement);
        for ((new, old), &unknown) in displacement.zip(&self.pattern.of_displacement) {
            *new = *old;
            if unknown != NONE {
                *new += share * step[unknown as usize];
            }
        }
        let pressure = trial.field.pressure.iter_mut().zip(&state.field.pressure);
        for ((new, old), &unknown) in pressure.zip(&self.pattern.of_pressure) {
            if unknown != NONE {
                *new = old + share * step[unknown as usize];
            }
        }
        if self.body.condensed_pressures() > 0 {
            self.move_platform_linearly(trial, state, platform_step, share);
            let softening = &mut work.sums.softening;
            *softening = self.body.update_condensed_pressures(
                &state.field,
                &mut trial.field,
                share,
                *softening,
            );
        }
        self.place_platform_nodes(trial);
    }

    /// Platform nodes moved by the linear step, δx = δr + δφ × arm: the pressures would take a
    /// finite rotation for a change of volume.
    fn move_platform_linearly(
        &self,
        trial: &mut State,
        state: &State,
        step: &[f64; 6],
        share: f64,
    ) {
        for &node in &self.pattern.platform_nodes {
            let arm = state.platform.arm(&self.body.mesh, node);
            let turned = crate::tensor::cross([step[3], step[4], step[5]], arm);
            for k in 0..3 {
                let old = state.field.displacement[3 * node + k];
                trial.field.displacement[3 * node + k] = old + share * (step[k] + turned[k]);
            }
        }
    }
}
