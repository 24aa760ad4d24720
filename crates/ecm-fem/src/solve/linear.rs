//! The first guess of all: every pose as the tangent at rest would have it.
//!
//! On the bent axis (see [`super::warp`]) a state depends nearly linearly on its pose, so six
//! triangular solves at rest spare the first group of a batch its load steps.

use super::newton::Workspace;
use super::{Fem, Guess, Load, Watch};

/// Pose steps of the difference, over L and in rad: small against any curvature, large
/// against single precision.
const STEP: f64 = 1e-3;

impl Fem {
    /// Linear in the pose's point; `None` where there is no equilibrium at the rest pose.
    pub(super) fn linear_guess(&self) -> Option<Guess> {
        let load = Load::Pose(self.rest().platform.pose());
        let mut work = Workspace::new(self);
        let mut state = self.rest();
        let most = (self.settings.iterations, super::newton::WANDERING);
        self.newton(&mut work, &mut state, &load, most, Watch::default())
            .ok()?;
        let length = self.body.mesh.length_m();
        let mut known = vec![(self.point(&load), self.flatten(&state))];
        for k in 0..6 {
            let mut gap = [0.0; 6];
            gap[k] = if k < 3 { STEP * length } else { STEP };
            let step = self.step(&mut work, &gap, true)?;
            self.move_by(&mut work, &state, &step, 1.0);
            let pose = work.trial.platform.pose();
            known.push((self.point(&Load::Pose(pose)), self.flatten(&work.trial)));
        }
        let samples: Vec<_> = known.iter().map(|(p, f)| (p, f.as_slice())).collect();
        Guess::of_degree(&samples, 1)
    }
}
