//! Load stepping: the load grows in proportion, in as few steps as stability and Newton allow.

use super::condense::smallest_eigenvalue;
use super::newton::{Failure, MOST_UNSTABLE_ITERATES, Workspace};
use super::{Fem, Load, State, Watch};
use crate::platform::Platform;
use crate::result::{CREASE, CaseResult, Reason, Status};
use crate::tensor::{Mat3, product, transpose};
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Pose, Wrench};
use nalgebra::Matrix3;

/// Largest share of the load between the last stable and the first unstable equilibrium at which
/// the load is reported as unstable.
pub(super) const BRACKET: f64 = 1.0 / 16.0;

/// Which stiffness is no longer positive definite.
#[derive(Debug, Clone, Copy)]
pub(super) enum Instability {
    /// The tangent at fixed platform.
    Internal,
    /// H: the platform buckles under a dead wrench.
    Buckling,
}

/// Start of a load path: an equilibrium at a share of the load, and the size of the first step.
pub(super) struct PathStart {
    pub state: State,
    pub result: Option<CaseResult>,
    pub reached: f64,
    pub step: f64,
}

/// How Newton ended at one load.
pub(super) enum Attempt {
    Stable(Box<CaseResult>),
    Unstable(Instability),
    Failed(Failure),
}

impl Fem {
    /// Follows the load path from rest; also returns the final state.
    pub(super) fn follow_from_rest(
        &self,
        work: &mut Workspace,
        load: &Load,
        watch: Watch,
    ) -> (CaseResult, State) {
        let before = work.timing.factorisations;
        let (mut result, state) = self.follow(work, self.path_from_rest(1.0), load, watch);
        result.factorisations = work.timing.factorisations - before;
        (result, state)
    }

    pub(super) fn path_from_rest(&self, step: f64) -> PathStart {
        PathStart {
            state: self.rest(),
            result: None,
            reached: 0.0,
            step,
        }
    }

    pub(super) fn load_at_rest(&self, load: &Load) -> Load {
        match load {
            Load::Wrench(_) => Load::Wrench([0.0; 6]),
            Load::Pose(_) => Load::Pose(self.rest().platform.pose()),
        }
    }

    /// Follows the load path to its end.
    pub(super) fn follow(
        &self,
        work: &mut Workspace,
        begin: PathStart,
        load: &Load,
        watch: Watch,
    ) -> (CaseResult, State) {
        work.ready = false;
        let start = self.load_at_rest(load);
        let PathStart {
            mut state,
            result: mut last_result,
            mut reached,
            mut step,
        } = begin;
        let most = self.settings.iterations;
        let (mut iterations, mut load_steps) = (0, 0);
        let mut last_stable = state.clone();
        let mut step_may_grow = true;
        let (status, instability) = loop {
            let next = if reached + step >= 1.0 - 1e-12 {
                1.0
            } else {
                reached + step
            };
            let load_now = between(&start, load, next);
            let (attempt, n) = self.attempt(
                work,
                &mut state,
                &load_now,
                (most, MOST_UNSTABLE_ITERATES),
                watch,
            );
            iterations += n;
            let (failure, instability) = match attempt {
                Attempt::Stable(result) => {
                    load_steps += 1;
                    reached = next;
                    let grown = if step_may_grow { 2.0 * step } else { step };
                    step = grown.min(1.0 - reached);
                    step_may_grow = true;
                    last_stable.clone_from(&state);
                    last_result = Some(*result);
                    if reached == 1.0 {
                        break (Status::Solved, None);
                    }
                    continue;
                }
                Attempt::Unstable(instability) => {
                    if next - reached <= BRACKET {
                        break (Status::Unstable, Some(instability));
                    }
                    (Status::Unstable, Some(instability))
                }
                Attempt::Failed(Failure::Cancelled) => break (Status::Cancelled, None),
                Attempt::Failed(Failure::Diverged) => (Status::NotConverged, None),
                Attempt::Failed(Failure::Inverted) => (Status::Inverted, None),
                Attempt::Failed(Failure::Unstable) => {
                    let compressed =
                        |r: &CaseResult| next - reached <= BRACKET && r.stretch_ratio < CREASE;
                    if last_result.as_ref().is_some_and(compressed) {
                        break (Status::Unstable, Some(Instability::Internal));
                    }
                    (Status::Unstable, Some(Instability::Internal))
                }
            };
            step_may_grow = false;
            step *= 0.5;
            if step < self.settings.smallest_load_step {
                break (failure, instability);
            }
            state.clone_from(&last_stable);
            work.ready = false;
        };
        let mut result = match last_result {
            Some(result) => result,
            None => self.start_result(work, &mut last_stable, &start),
        };
        result.status = status;
        result.reason = instability.map(|instability| match instability {
            Instability::Buckling => Reason::Buckling,
            Instability::Internal if result.stretch_ratio < CREASE => Reason::Crease,
            Instability::Internal => Reason::Inner,
        });
        result.iterations = iterations;
        result.load_steps = load_steps;
        (result, last_stable)
    }

    /// Newton from `state` at `load`, with the result where it converges.
    pub(super) fn attempt(
        &self,
        work: &mut Workspace,
        state: &mut State,
        load: &Load,
        most: (usize, usize),
        watch: Watch,
    ) -> (Attempt, usize) {
        match self.newton(work, state, load, most, watch) {
            Ok(n) => {
                let result = self.report(work, state);
                let attempt = if self.is_stable(load, &result) {
                    Attempt::Stable(Box::new(result))
                } else if result.inner_instabilities > 0 {
                    Attempt::Unstable(Instability::Internal)
                } else {
                    Attempt::Unstable(Instability::Buckling)
                };
                (attempt, n)
            }
            Err((failure, n)) => (Attempt::Failed(failure), n),
        }
    }

    /// Stable at fixed platform and, at a given wrench, against buckling.
    fn is_stable(&self, load: &Load, result: &CaseResult) -> bool {
        result.inner_instabilities == 0
            && (matches!(load, Load::Pose(_)) || result.smallest_eigenvalue > 0.0)
    }

    /// Result of the equilibrium at the start of a path, when no step succeeded.
    fn start_result(&self, work: &mut Workspace, state: &mut State, start: &Load) -> CaseResult {
        work.ready = false;
        // The start is an equilibrium: this only assembles and factorises there.
        let _ = self.newton(
            work,
            state,
            start,
            (self.settings.iterations, MOST_UNSTABLE_ITERATES),
            Watch::default(),
        );
        self.report(work, state)
    }

    /// The result at the state for which the workspace was computed.
    fn report(&self, work: &Workspace, state: &State) -> CaseResult {
        let n = self.pattern.unknowns;
        let k_s = self
            .condensed(
                &work.sums,
                &work.balance,
                &work.columns[..6 * n],
                &work.pivots,
            )
            .0;
        let pose = state.platform.pose();
        let wrench = work.balance.wrench;
        let (at, h) = (Pose::from_array(&pose), Wrench::from_array(&wrench));
        let stiffness_of_kind = |kind| {
            let of_pose = |at| convert(&k_s, &at, &h, StiffnessKind::Screw, kind);
            at.map_or([[f64::NAN; 6]; 6], of_pose)
        };
        let hessian = stiffness_of_kind(StiffnessKind::Generalised);
        let strain = self.strain(state);
        CaseResult {
            status: Status::Solved,
            pose,
            wrench,
            energy_J: work.sums.energy_J,
            stiffness: stiffness_of_kind(StiffnessKind::Partial),
            hessian,
            smallest_eigenvalue: smallest_eigenvalue(&hessian, self.body.mesh.length_m()),
            inner_instabilities: work.balance.inner_instabilities,
            reason: None,
            stretch_ratio: strain.ratio,
            most_compressed_m: strain.at_m,
            largest_stretch: strain.largest,
            smallest_jacobian: work.sums.smallest_jacobian,
            iterations: 0,
            factorisations: 0,
            load_steps: 0,
            residual: work.balance.residual,
        }
    }

    fn strain(&self, state: &State) -> Strain {
        let mesh = &self.body.mesh;
        let mut strain = Strain {
            largest: 0.0,
            ratio: 1.0,
            at_m: [0.0; 3],
        };
        for (e, tet) in mesh.tetrahedra().iter().enumerate() {
            for f in self.body.deformation_gradients(e, &state.field) {
                let (small, large) = extreme_eigenvalues(&product(&transpose(&f), &f));
                let (small, large) = (small.max(0.0).sqrt(), large.sqrt());
                strain.largest = strain.largest.max(large);
                if small / large < strain.ratio {
                    strain.ratio = small / large;
                    let corner = |k: usize| tet[..4].iter().map(move |&n| mesh.nodes_m()[n][k]);
                    strain.at_m = [0, 1, 2].map(|k| 0.25 * corner(k).sum::<f64>());
                }
            }
        }
        strain
    }
}

/// Extremes of the principal stretches over all quadrature points.
struct Strain {
    largest: f64,
    ratio: f64,
    at_m: [f64; 3],
}

fn extreme_eigenvalues(c: &Mat3) -> (f64, f64) {
    let values = Matrix3::from_fn(|i, j| c[i][j]).symmetric_eigenvalues();
    (values.min(), values.max())
}

/// The load at `share` of the way from `start` to `end`: wrenches along a straight
/// line, poses along the screw-free path (straight origin, one rotation axis).
pub(super) fn between(start: &Load, end: &Load, share: f64) -> Load {
    match (start, end) {
        _ if share == 1.0 => *end,
        (Load::Wrench(a), Load::Wrench(b)) => {
            Load::Wrench(std::array::from_fn(|k| a[k] + share * (b[k] - a[k])))
        }
        (Load::Pose(a), Load::Pose(b)) => {
            let (from, to) = (Platform::from_pose(a), Platform::from_pose(b));
            Load::Pose(from.moved(&from.step_to(&to), share).pose())
        }
        _ => *end,
    }
}
