//! Actuators whose amount is given: a chamber that holds a volume of liquid, a tendon on a winch.
//!
//! Their inputs a are unknowns beside nodes and platform, one multiplier for each amount q. With
//! Z = L⁻¹ ∂q/∂u, the factor's diagonal D, G = K_6f K_ff⁻¹ ∂q/∂u − ∂q/∂p and C = Zᵀ D⁻¹ Z, a step of
//! the platform δ and of the inputs solves
//!
//! [K_s  G; Gᵀ  −C] (δ, δa) = (gap − K_6f y, Zᵀ D⁻¹ L⁻¹ (−r) − gap of q),   y = −K_ff⁻¹ r.
//!
//! Where amounts are held the platform has the stiffness K_s + G C⁻¹ Gᵀ, and each negative eigenvalue
//! of C is a negative pivot of K_ff that the multiplier takes away: a balloon beyond its largest
//! pressure is stable under a given volume.

use super::load_path::Beside;
use super::newton::{Border, Workspace};
use super::{Actuation, Case, Fem, State};
use crate::result::CaseResult;
use faer::mat::MatMut;
use nalgebra::{DMatrix, DVector};

/// Relative compliance of an actuator whose amount is held: its share of the amount at its unit of
/// input, far below that of any body.
const LEAST_COMPLIANCE: f64 = 1e-9;

impl Workspace {
    /// Sets what acts beside the load; the forces known so far remain ready where it acted already.
    pub fn set_beside(&mut self, state: &mut State, beside: &Beside) {
        let actuators = self.sums.inputs.len();
        for k in 0..actuators {
            if beside.amounts >> k & 1 == 0 {
                state.inputs[k] = beside.actuation[k];
            }
        }
        self.ready &= self.sums.dead_share == beside.weight
            && self.given == beside.amounts
            && self.sums.inputs == state.inputs[..actuators];
        self.sums.dead_share = beside.weight;
        self.given = beside.amounts;
        self.targets = beside.actuation;
    }

    /// aᵀ D⁻¹ b.
    pub fn along(&self, a: &[f64], b: &[f64]) -> f64 {
        (a.iter().zip(b).zip(&self.pivots))
            .map(|((a, b), d)| a * b / d)
            .sum()
    }
}

impl Fem {
    /// Unit of an actuator's input: shear modulus for a chamber, force for a tendon.
    pub(super) fn input_unit(&self, actuator: usize) -> f64 {
        match actuator < self.body.chambers.count() {
            true => self.body.material.shear_modulus_Pa(),
            false => self.force_unit_N,
        }
    }

    /// Size of an actuator's amount: volume of the chamber, length of the body.
    pub(super) fn amount_unit(&self, actuator: usize) -> f64 {
        match actuator < self.body.chambers.count() {
            true => self.amounts_at_rest[actuator],
            false => self.body.mesh.length_m(),
        }
    }

    /// What is missing of the given amounts.
    pub(super) fn amount_gap(&self, work: &Workspace) -> Actuation {
        std::array::from_fn(|k| match work.given >> k & 1 {
            0 => 0.0,
            _ => work.targets[k] - (work.sums.amounts[k] - self.amounts_at_rest[k]),
        })
    }

    /// L⁻¹ ∂q/∂u of an actuator.
    pub(super) fn amount_column(&self, work: &mut Workspace, actuator: usize) -> Vec<f64> {
        let mut column = vec![0.0; self.pattern.unknowns];
        let gradient = &work.sums.amount_gradient[actuator];
        self.pattern
            .of_unknowns(|component| gradient[component], &mut column);
        let length = column.len();
        work.factor.forward(
            &self.pattern.symbolic,
            MatMut::from_column_major_slice_mut(&mut column, length, 1),
        );
        column
    }

    /// G of an actuator: h = ∂U/∂p − a ∂q/∂p, and the body gives way.
    pub(super) fn on_wrench(&self, work: &Workspace, actuator: usize, column: &[f64]) -> [f64; 6] {
        let n = self.pattern.unknowns;
        std::array::from_fn(|k| {
            work.along(&work.columns[k * n..(k + 1) * n], column)
                - work.sums.amount_by_platform[actuator][k]
        })
    }

    /// Z, G and C of the given amounts, by the factor that is there.
    pub(super) fn border(&self, work: &mut Workspace) -> Border {
        let of: Vec<usize> = (0..work.sums.inputs.len())
            .filter(|k| work.given >> k & 1 == 1)
            .collect();
        let columns: Vec<Vec<f64>> = of.iter().map(|&k| self.amount_column(work, k)).collect();
        let pairs = || of.iter().zip(&columns);
        Border {
            on_wrench: pairs().map(|(&k, z)| self.on_wrench(work, k, z)).collect(),
            on_amounts: columns
                .iter()
                .map(|a| columns.iter().map(|b| work.along(a, b)).collect())
                .collect(),
            of,
            columns,
        }
    }

    /// Steps of the platform and of the inputs from the right sides; with `given_platform` only the
    /// inputs are sought.
    pub(super) fn bordered_step(
        &self,
        work: &Workspace,
        right: &[f64; 6],
        gaps: &Actuation,
        given_platform: bool,
    ) -> Option<([f64; 6], Actuation)> {
        let border = &work.border;
        let mut inputs = [0.0; super::MOST_ACTUATORS];
        let n = self.pattern.unknowns;
        let last = &work.columns[6 * n..];
        let unit = |i: usize| self.input_unit(border.of[i]);
        // gap of q less what the unknowns alone bring, over the unit.
        let missing = |i: usize| gaps[border.of[i]] - work.along(&border.columns[i], last);
        let s = border.of.len();
        let c = |i: usize, j: usize| border.on_amounts[i][j] * unit(i) * unit(j);
        if given_platform {
            if s > 0 {
                let side = DVector::from_fn(s, |i, _| {
                    let moved: f64 = (0..6).map(|k| border.on_wrench[i][k] * right[k]).sum();
                    (missing(i) + moved) * unit(i)
                });
                let found = DMatrix::from_fn(s, s, c).lu().solve(&side)?;
                (0..s).for_each(|i| inputs[border.of[i]] = found[i] * unit(i));
            }
            return Some((*right, inputs));
        }
        let k_s = self.at_constant_inputs(work);
        let matrix = DMatrix::from_fn(6 + s, 6 + s, |i, j| match (i < 6, j < 6) {
            (true, true) => k_s[i][j],
            (true, false) => border.on_wrench[j - 6][i] * unit(j - 6),
            (false, true) => border.on_wrench[i - 6][j] * unit(i - 6),
            (false, false) => -c(i - 6, j - 6),
        });
        let side = DVector::from_fn(6 + s, |i, _| match i < 6 {
            true => right[i],
            false => -missing(i - 6) * unit(i - 6),
        });
        let found = matrix.lu().solve(&side)?;
        (0..s).for_each(|i| inputs[border.of[i]] = found[6 + i] * unit(i));
        Some((std::array::from_fn(|k| found[k]), inputs))
    }

    /// K_s where the given amounts are held and the other inputs are constant.
    pub(super) fn condensed(&self, work: &Workspace) -> [[f64; 6]; 6] {
        let mut k_s = self.at_constant_inputs(work);
        let border = &work.border;
        let s = border.of.len();
        if s == 0 {
            return k_s;
        }
        let unit = |i: usize| self.input_unit(border.of[i]);
        // A tendon between base and platform alone has no compliance.
        let least = |i: usize| LEAST_COMPLIANCE * self.amount_unit(border.of[i]) * unit(i);
        let c = DMatrix::from_fn(s, s, |i, j| {
            let own = if i == j { least(i) } else { 0.0 };
            border.on_amounts[i][j] * unit(i) * unit(j) + own
        });
        let g = DMatrix::from_fn(s, 6, |i, k| border.on_wrench[i][k] * unit(i));
        let Some(held) = c.lu().solve(&g) else {
            return [[f64::NAN; 6]; 6];
        };
        let more = g.transpose() * held;
        for i in 0..6 {
            for j in 0..6 {
                k_s[i][j] += more[(i, j)];
            }
        }
        k_s
    }

    /// Negative pivots of K_ff that the multipliers take away.
    pub(super) fn taken_by_multipliers(&self, border: &Border) -> usize {
        let s = border.of.len();
        if s == 0 {
            return 0;
        }
        let unit = |i: usize| self.input_unit(border.of[i]);
        let c = DMatrix::from_fn(s, s, |i, j| border.on_amounts[i][j] * unit(i) * unit(j));
        let values = c.symmetric_eigenvalues();
        values.iter().filter(|v| **v < 0.0).count()
    }

    /// The case with the tendons let go that would have to push, where there are some.
    pub(super) fn slackened(&self, case: &Case, result: &CaseResult) -> Option<Case> {
        let mut other = *case;
        let first = self.body.chambers.count();
        for (k, actuator) in result.actuators.iter().enumerate().skip(first) {
            if case.amounts >> k & 1 == 1 && actuator.input < 0.0 {
                other.amounts &= !(1 << k);
                other.actuation[k] = 0.0;
            }
        }
        (other.amounts != case.amounts).then_some(other)
    }
}
