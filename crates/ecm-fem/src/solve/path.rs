//! Proportionally from an equilibrium to a load, in as few steps as stability and Newton allow.

use super::condense::smallest_eigenvalue;
use super::newton::{Failure, WANDERING, Workspace};
use super::{Fem, Load, State, Watch};
use crate::platform::Platform;
use crate::result::{CREASE, CaseResult, Reason, Status};
use crate::tensor::{Mat3, product, transpose};
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Pose, Wrench};
use nalgebra::Matrix3;

/// Share of the way between the last stable and the first unstable equilibrium that is
/// narrow enough to call the load unstable.
pub(super) const BRACKET: f64 = 1.0 / 16.0;

/// Which stiffness has lost its positivity.
#[derive(Debug, Clone, Copy)]
pub(super) enum Lost {
    Inside,
    Whole,
}

/// Where a path begins: an equilibrium at a share of the load, and the first step from it.
pub(super) struct Begin {
    pub state: State,
    pub result: Option<CaseResult>,
    pub reached: f64,
    pub step: f64,
}

/// What Newton found at a load.
pub(super) enum Landing {
    Stable(Box<CaseResult>),
    Lost(Lost),
    Failed(Failure),
}

impl Fem {
    /// Follows the load from rest; also returns the final state.
    pub(super) fn follow_from_rest(
        &self,
        work: &mut Workspace,
        load: &Load,
        watch: Watch,
    ) -> (CaseResult, State) {
        let before = work.timing.factorisations;
        let (mut result, state) = self.follow(work, self.begin_at_rest(1.0), load, watch);
        result.factorisations = work.timing.factorisations - before;
        (result, state)
    }

    pub(super) fn begin_at_rest(&self, step: f64) -> Begin {
        Begin {
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

    /// Follows the load proportionally to its end.
    pub(super) fn follow(
        &self,
        work: &mut Workspace,
        begin: Begin,
        load: &Load,
        watch: Watch,
    ) -> (CaseResult, State) {
        work.ready = false;
        let start = self.load_at_rest(load);
        let Begin {
            mut state,
            result: mut last_result,
            mut reached,
            mut step,
        } = begin;
        let most = self.settings.iterations;
        let (mut iterations, mut load_steps) = (0, 0);
        let mut last_good = state.clone();
        let mut may_grow = true;
        let (status, lost) = loop {
            let next = if reached + step >= 1.0 - 1e-12 {
                1.0
            } else {
                reached + step
            };
            let here = between(&start, load, next);
            let (landing, n) = self.land(work, &mut state, &here, (most, WANDERING), watch);
            iterations += n;
            let (failure, lost) = match landing {
                Landing::Stable(result) => {
                    load_steps += 1;
                    reached = next;
                    let grown = if may_grow { 2.0 * step } else { step };
                    step = grown.min(1.0 - reached);
                    may_grow = true;
                    last_good.clone_from(&state);
                    last_result = Some(*result);
                    if reached == 1.0 {
                        break (Status::Solved, None);
                    }
                    continue;
                }
                Landing::Lost(lost) => {
                    if next - reached <= BRACKET {
                        break (Status::Unstable, Some(lost));
                    }
                    (Status::Unstable, Some(lost))
                }
                Landing::Failed(Failure::Cancelled) => break (Status::Cancelled, None),
                Landing::Failed(Failure::Diverged) => (Status::NotConverged, None),
                Landing::Failed(Failure::Inverted) => (Status::Inverted, None),
                Landing::Failed(Failure::Unstable) => {
                    let compressed =
                        |r: &CaseResult| next - reached <= BRACKET && r.stretch_ratio < CREASE;
                    if last_result.as_ref().is_some_and(compressed) {
                        break (Status::Unstable, Some(Lost::Inside));
                    }
                    (Status::Unstable, Some(Lost::Inside))
                }
            };
            may_grow = false;
            step *= 0.5;
            if step < self.settings.smallest_load_step {
                break (failure, lost);
            }
            state.clone_from(&last_good);
            work.ready = false;
        };
        let mut result = match last_result {
            Some(result) => result,
            None => self.start_result(work, &mut last_good, &start),
        };
        result.status = status;
        result.reason = lost.map(|lost| match lost {
            Lost::Whole => Reason::Buckling,
            Lost::Inside if result.stretch_ratio < CREASE => Reason::Crease,
            Lost::Inside => Reason::Inner,
        });
        result.iterations = iterations;
        result.load_steps = load_steps;
        (result, last_good)
    }

    /// Newton from `state` at `load`, and what is found there.
    pub(super) fn land(
        &self,
        work: &mut Workspace,
        state: &mut State,
        load: &Load,
        most: (usize, usize),
        watch: Watch,
    ) -> (Landing, usize) {
        match self.newton(work, state, load, most, watch) {
            Ok(n) => {
                let result = self.report(work, state);
                let landing = if self.is_stable(load, &result) {
                    Landing::Stable(Box::new(result))
                } else if result.inner_instabilities > 0 {
                    Landing::Lost(Lost::Inside)
                } else {
                    Landing::Lost(Lost::Whole)
                };
                (landing, n)
            }
            Err((failure, n)) => (Landing::Failed(failure), n),
        }
    }

    /// Stable inside, and at a given wrench also as a whole.
    fn is_stable(&self, load: &Load, result: &CaseResult) -> bool {
        result.inner_instabilities == 0
            && (matches!(load, Load::Pose(_)) || result.smallest_eigenvalue > 0.0)
    }

    /// Result of the equilibrium a path began with, when no step succeeded.
    fn start_result(&self, work: &mut Workspace, state: &mut State, start: &Load) -> CaseResult {
        work.ready = false;
        // The start is an equilibrium: this only assembles and factorises there.
        let _ = self.newton(
            work,
            state,
            start,
            (self.settings.iterations, WANDERING),
            Watch::default(),
        );
        self.report(work, state)
    }

    /// Everything about the state the workspace belongs to.
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
        let to = |kind| convert(&k_s, &at, &h, StiffnessKind::Screw, kind);
        let hessian = to(StiffnessKind::Generalised);
        let strain = self.strain(state);
        CaseResult {
            status: Status::Solved,
            pose,
            wrench,
            energy_J: work.sums.energy_J,
            stiffness: to(StiffnessKind::Partial),
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
