//! The result at a state: pose, wrench, stiffnesses, stability and strain.

use super::newton::Workspace;
use super::stability::{Instability, Spectrum};
use super::{Fem, Load, State};
use crate::result::{Actuator, CaseResult, Status};
use crate::tensor::{product, symmetric_eigenvalues, transpose};
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Pose, Wrench};

/// Extremes of the principal stretches over all quadrature points.
struct Strain {
    smallest: f64,
    largest: f64,
    ratio: f64,
    /// Where the smallest is, in the undeformed body.
    at_m: [f64; 3],
}

impl Fem {
    /// The result at the equilibrium for which the workspace was computed, and what is unstable
    /// there under `load`.
    pub(super) fn report(
        &self,
        work: &mut Workspace,
        state: &State,
        load: &Load,
    ) -> (CaseResult, Option<Instability>) {
        let k_s = self.condensed(work);
        let spectrum = Spectrum::of(&k_s, self.body.mesh.length_m());
        let inner_instabilities = work.balance.inner_instabilities;
        let instability = spectrum.instability(load, inner_instabilities);
        let pose = state.platform.pose();
        let wrench = work.balance.wrench;
        let (at, h) = (Pose::from_array(&pose), Wrench::from_array(&wrench));
        let stiffness_of_kind = |kind| {
            let of_pose = |at| convert(&k_s, &at, &h, StiffnessKind::Screw, kind);
            at.map_or([[f64::NAN; 6]; 6], of_pose)
        };
        let strain = self.strain(state);
        let result = CaseResult {
            status: Status::Solved,
            pose,
            wrench,
            energy_J: work.sums.energy_J,
            stiffness: stiffness_of_kind(StiffnessKind::Partial),
            hessian: stiffness_of_kind(StiffnessKind::Generalised),
            smallest_eigenvalue: spectrum.smallest_symmetric,
            determinant: spectrum.determinant,
            inner_instabilities,
            reason: None,
            smallest_stretch: strain.smallest,
            stretch_ratio: strain.ratio,
            most_compressed_m: strain.at_m,
            largest_stretch: strain.largest,
            smallest_jacobian: work.sums.smallest_jacobian,
            iterations: 0,
            factorisations: 0,
            load_steps: 0,
            residual: work.balance.residual,
            actuators: self.actuators_at(work),
        };
        (result, instability)
    }

    /// Input, amount, G and C of each actuator, by the factor at the state.
    fn actuators_at(&self, work: &mut Workspace) -> Vec<Actuator> {
        let columns: Vec<Vec<f64>> = (0..self.body.actuators())
            .map(|k| self.amount_column(work, k))
            .collect();
        let of = |(k, column): (usize, &Vec<f64>)| Actuator {
            input: work.sums.inputs[k],
            amount: work.sums.amounts[k] - self.amounts_at_rest[k],
            on_wrench: self.on_wrench(work, k, column),
            on_amounts: columns
                .iter()
                .map(|other| work.along(column, other))
                .collect(),
        };
        columns.iter().enumerate().map(of).collect()
    }

    fn strain(&self, state: &State) -> Strain {
        let mesh = &self.body.mesh;
        let mut strain = Strain {
            smallest: f64::INFINITY,
            largest: 0.0,
            ratio: 1.0,
            at_m: [0.0; 3],
        };
        for (e, tet) in mesh.tetrahedra().iter().enumerate() {
            for f in self.body.deformation_gradients(e, &state.field) {
                let [small, _, large] = symmetric_eigenvalues(&product(&transpose(&f), &f));
                let (small, large) = (small.max(0.0).sqrt(), large.sqrt());
                strain.largest = strain.largest.max(large);
                strain.ratio = strain.ratio.min(small / large);
                if small < strain.smallest {
                    strain.smallest = small;
                    let corner = |k: usize| tet[..4].iter().map(move |&n| mesh.nodes_m()[n][k]);
                    strain.at_m = [0, 1, 2].map(|k| 0.25 * corner(k).sum::<f64>());
                }
            }
        }
        strain
    }
}
