//! The result at a state: pose, wrench, stiffnesses, stability and strain.

use super::newton::Workspace;
use super::stability::{Instability, Spectrum};
use super::{Fem, Load, State};
use crate::result::{Actuator, CaseResult, Status};
use crate::tensor::{product, symmetric_eigenvalues, transpose};
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Pose, Wrench};
use faer::mat::MatMut;

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
        let six = &work.columns[..6 * self.pattern.unknowns];
        let k_s = self
            .condensed(&work.sums, &work.balance, six, &work.pivots)
            .0;
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
            actuators: self.actuators_at(work, state),
        };
        (result, instability)
    }

    /// Volume change, ∂h/∂P and ∂q/∂P of each chamber, by the factor at the state.
    fn actuators_at(&self, work: &mut Workspace, state: &State) -> Vec<Actuator> {
        let (n, mesh) = (self.pattern.unknowns, &self.body.mesh);
        // L⁻¹ ∂V/∂u of each chamber.
        let mut columns = vec![vec![0.0; n]; self.body.chambers.count()];
        for (column, gradient) in columns.iter_mut().zip(&work.sums.chamber_gradient) {
            self.pattern
                .of_unknowns(|component| gradient[component], column);
            let column = MatMut::from_column_major_slice_mut(column, n, 1);
            work.factor.forward(&self.pattern.symbolic, column);
        }
        let along =
            |a: &[f64], b: &[f64]| -> f64 { (0..n).map(|i| a[i] * b[i] / work.pivots[i]).sum() };
        (0..self.body.chambers.count())
            .map(|c| {
                let nodes = &self.pattern.platform_nodes;
                let of_nodes = (state.platform)
                    .wrench(mesh, nodes, &work.sums.chamber_gradient[c])
                    .0;
                // h = ∂U/∂p − P ∂V/∂p, and the body gives way: K_6f K_ff⁻¹ ∂V/∂u.
                let on_wrench = std::array::from_fn(|k| {
                    along(&work.columns[k * n..(k + 1) * n], &columns[c])
                        - of_nodes[k]
                        - work.sums.cap_gradient[c][k]
                });
                Actuator {
                    input: work.sums.actuation[c],
                    amount: work.sums.chamber_m3[c] - self.chamber_m3[c],
                    on_wrench,
                    on_amounts: (0..self.body.chambers.count())
                        .map(|other| along(&columns[c], &columns[other]))
                        .collect(),
                }
            })
            .collect()
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
