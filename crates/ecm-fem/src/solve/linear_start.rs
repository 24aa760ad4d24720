//! Linear warm start: the initial guess of a pose by the tangent at rest.
//!
//! In the bent frame (see [`super::bent_frame`]) a state depends nearly linearly on its pose, so six
//! triangular solves at rest replace the load steps of the first group of a batch.

use super::newton::Workspace;
use super::{Case, Fem, Load, MOST_ACTUATORS, WarmStart, Watch};

/// Pose steps of the difference, over L and in rad: small against any curvature, large
/// against single precision.
const STEP: f64 = 1e-3;

impl Fem {
    /// Linear in the mid-frame coordinates; `None` where there is no equilibrium at the rest pose.
    pub(super) fn linear_start(&self, amounts: u32, watch: Watch) -> Option<WarmStart> {
        let rest = Load::Pose(self.rest().platform.pose());
        let of = |load: Load| Case {
            amounts,
            ..Case::from(load)
        };
        let mut work = Workspace::new(self);
        let mut state = self
            .path_start(&mut work, &of(rest), 1.0, watch)
            .ok()?
            .state;
        work.ready = false;
        let most = (
            self.settings.iterations,
            super::newton::MOST_UNSTABLE_ITERATES,
        );
        self.newton(&mut work, &mut state, &rest, most, watch)
            .ok()?;
        let length = self.body.mesh.length_m();
        let mut samples = vec![(self.point(&of(rest), watch), self.flatten(&state))];
        for k in 0..6 {
            let mut gap = [0.0; 6];
            gap[k] = if k < 3 { STEP * length } else { STEP };
            let step = self.step(&mut work, &gap, true)?;
            self.move_by(&mut work, &state, &step, 1.0);
            let pose = work.trial.platform.pose();
            samples.push((
                self.point(&of(Load::Pose(pose)), watch),
                self.flatten(&work.trial),
            ));
        }
        for k in 0..self.body.actuators() {
            let mut case = of(rest);
            if amounts >> k & 1 == 1 {
                case.actuation[k] = STEP * self.amount_unit(k);
                work.amount_gap[k] = case.actuation[k];
                work.residual.fill(0.0);
            } else {
                case.actuation[k] = STEP * self.input_unit(k);
                let gradient = &work.sums.amount_gradient[k];
                self.pattern
                    .of_unknowns(|i| -case.actuation[k] * gradient[i], &mut work.residual);
            }
            self.step(&mut work, &[0.0; 6], true)?;
            self.move_by(&mut work, &state, &[0.0; 6], 1.0);
            work.amount_gap = [0.0; MOST_ACTUATORS];
            samples.push((self.point(&case, watch), self.flatten(&work.trial)));
        }
        let samples: Vec<_> = (samples.iter())
            .map(|(p, f)| (p.as_slice(), f.as_slice()))
            .collect();
        WarmStart::of_degree(&samples, 1)
    }
}
