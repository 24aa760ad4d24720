//! From a known equilibrium to a load, in as few steps as stability and Newton allow.

use super::condense::smallest_eigenvalue;
use super::newton::{Failure, Workspace};
use super::{Fem, Load, State, Watch};
use crate::platform::Platform;
use crate::result::{CREASE, CaseResult, Reason, Status};
use crate::tensor::{Mat3, product, transpose};
use ecm_se3::stiffness::{StiffnessKind, convert};
use ecm_se3::{Pose, Wrench};
use nalgebra::Matrix3;

/// Newton iterations granted to a guess before the way from a neighbour is taken.
const JUMP: usize = 10;

/// Share of the way between the last stable and the first unstable equilibrium that is
/// narrow enough to call the load unstable.
const BRACKET: f64 = 1.0 / 16.0;

/// Which stiffness has lost its positivity.
#[derive(Debug, Clone, Copy)]
enum Lost {
    Inside,
    Whole,
}

impl Fem {
    /// Follows the load from rest; also returns the final state.
    pub(super) fn follow_from_rest(
        &self,
        work: &mut Workspace,
        load: &Load,
        watch: Watch,
    ) -> (CaseResult, State) {
        let start = self.load_at_rest(load);
        let steps = (1.0, self.settings.smallest_load_step);
        self.follow(work, self.rest(), &start, load, steps, watch)
    }

    /// As [`Fem::follow_from_rest`] for a load that a jump has already failed at: begins halfway.
    pub(super) fn follow_in_halves(
        &self,
        work: &mut Workspace,
        load: &Load,
        watch: Watch,
    ) -> (CaseResult, State) {
        let start = self.load_at_rest(load);
        let steps = (0.5, self.settings.smallest_load_step);
        self.follow(work, self.rest(), &start, load, steps, watch)
    }

    fn load_at_rest(&self, load: &Load) -> Load {
        match load {
            Load::Wrench(_) => Load::Wrench([0.0; 6]),
            Load::Pose(_) => Load::Pose(self.rest().platform.pose()),
        }
    }

    /// Follows the load from `state`, an equilibrium under `start`, to `load`, in steps
    /// between the two given shares.
    pub(super) fn follow(
        &self,
        work: &mut Workspace,
        mut state: State,
        start: &Load,
        load: &Load,
        (first_step, smallest_step): (f64, f64),
        watch: Watch,
    ) -> (CaseResult, State) {
        work.ready = false;
        let (mut reached, mut step) = (0.0, first_step);
        let most = self.settings.iterations;
        let (mut iterations, mut load_steps) = (0, 0);
        let mut last_good = state.clone();
        let mut last_result: Option<CaseResult> = None;
        let mut may_grow = true;
        let (status, lost) = loop {
            let next = if reached + step >= 1.0 - 1e-12 {
                1.0
            } else {
                reached + step
            };
            let outcome = self.newton(work, &mut state, &between(start, load, next), most, watch);
            let (failure, lost) = match outcome {
                Ok(n) => {
                    iterations += n;
                    let result = self.report(work, &state);
                    if self.is_stable(load, &result) {
                        load_steps += 1;
                        reached = next;
                        let grown = if may_grow { 2.0 * step } else { step };
                        step = grown.min(1.0 - reached);
                        may_grow = true;
                        last_good.clone_from(&state);
                        last_result = Some(result);
                        if reached == 1.0 {
                            break (Status::Solved, None);
                        }
                        continue;
                    }
                    let lost = if result.inner_instabilities > 0 {
                        Lost::Inside
                    } else {
                        Lost::Whole
                    };
                    if next - reached <= BRACKET {
                        break (Status::Unstable, Some(lost));
                    }
                    (Status::Unstable, Some(lost))
                }
                Err((failure, n)) => {
                    iterations += n;
                    match failure {
                        Failure::Cancelled => break (Status::Cancelled, None),
                        Failure::Diverged => (Status::NotConverged, None),
                        Failure::Unstable => {
                            let compressed = |r: &CaseResult| {
                                next - reached <= BRACKET && r.stretch_ratio < CREASE
                            };
                            if last_result.as_ref().is_some_and(compressed) {
                                break (Status::Unstable, Some(Lost::Inside));
                            }
                            (Status::Unstable, Some(Lost::Inside))
                        }
                        Failure::Inverted => (Status::Inverted, None),
                    }
                }
            };
            may_grow = false;
            step *= 0.5;
            if step < smallest_step {
                break (failure, lost);
            }
            state.clone_from(&last_good);
            work.ready = false;
        };
        let mut result = match last_result {
            Some(result) => result,
            None => self.start_result(work, &mut last_good, start),
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

    /// Newton at the load itself from a guessed state; on failure, or where it ends
    /// unstable, the number of iterations lost.
    pub(super) fn jump(
        &self,
        work: &mut Workspace,
        mut state: State,
        load: &Load,
        watch: Watch,
    ) -> (Result<CaseResult, usize>, State) {
        work.ready = false;
        let outcome = match self.newton(work, &mut state, load, JUMP, watch) {
            Ok(iterations) => {
                let result = self.report(work, &state);
                if self.is_stable(load, &result) {
                    Ok(CaseResult {
                        iterations,
                        load_steps: 1,
                        ..result
                    })
                } else {
                    Err(iterations)
                }
            }
            Err((_, iterations)) => Err(iterations),
        };
        (outcome, state)
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
            self.settings.iterations,
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
fn between(start: &Load, end: &Load, share: f64) -> Load {
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
