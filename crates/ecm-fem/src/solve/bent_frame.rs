//! States as small displacements from a bent frame.
//!
//! A pose bends the body's axis into a cubic r(s) with sections turned by exp(s θ),
//! s = x / L. In these frames, v = Rᵀ (x − r) − (0, Y, Z), a state is a small field that
//! depends nearly linearly on the pose even where the body is bent by 100°, and a pose
//! alone (v = 0) is a good initial guess of a complete state.

use super::{Fem, State};
use crate::pattern::NONE;
use crate::platform::Platform;
use crate::tensor::{Mat3, apply, transpose};
use ecm_se3::rotation_matrix;

/// The bent frame of a pose.
struct BentFrame {
    length_m: f64,
    end_m: [f64; 3],
    end_slope_m: [f64; 3],
    theta: [f64; 3],
}

impl BentFrame {
    fn new(platform: &Platform, length_m: f64) -> Self {
        Self {
            length_m,
            end_m: platform.position_m,
            end_slope_m: apply(&platform.rotation, [length_m, 0.0, 0.0]),
            theta: platform.rotation_vector(),
        }
    }

    /// Origin and rotation of the section at `x_m` of the undeformed body.
    fn section(&self, x_m: f64) -> ([f64; 3], Mat3) {
        let s = (x_m / self.length_m).clamp(0.0, 1.0);
        // Hermite's cubic from the origin along x to the platform along its axis.
        let (start, end) = (s * (1.0 - s).powi(2), s * s * (3.0 - 2.0 * s));
        let slope = s * s * (s - 1.0);
        let mut r = [0, 1, 2].map(|k| end * self.end_m[k] + slope * self.end_slope_m[k]);
        r[0] += start * self.length_m;
        (r, rotation_matrix(&self.theta.map(|t| s * t)))
    }
}

impl Fem {
    /// State vector: pose, v at the free nodes, pressures and inputs of the actuators. Single precision is enough for an
    /// initial guess.
    pub(super) fn flatten(&self, state: &State) -> Vec<f32> {
        let mut out: Vec<f32> = state.platform.pose().iter().map(|&p| p as f32).collect();
        let frame = BentFrame::new(&state.platform, self.body.mesh.length_m());
        for (node, x) in self.body.mesh.nodes_m().iter().enumerate() {
            if self.pattern.of_displacement[3 * node] == NONE {
                continue;
            }
            let (r, rotation) = frame.section(x[0]);
            let u = &state.field.displacement[3 * node..3 * node + 3];
            let moved = [0, 1, 2].map(|k| x[k] + u[k] - r[k]);
            let v = apply(&transpose(&rotation), moved);
            out.extend([v[0], v[1] - x[1], v[2] - x[2]].map(|c| c as f32));
        }
        let pressures = state.field.pressure.iter().enumerate();
        out.extend(
            pressures
                .filter(|(i, _)| self.has_pressure(*i))
                .map(|(_, &p)| p as f32),
        );
        let inputs = 0..self.body.actuators();
        out.extend(inputs.map(|k| (state.inputs[k] / self.input_unit(k)) as f32));
        out
    }

    /// Whether an entry of the pressures is used.
    fn has_pressure(&self, index: usize) -> bool {
        self.body.condensed_pressures() > 0 || self.pattern.of_pressure[index] != NONE
    }

    /// Inverse of [`Fem::flatten`]; missing values at the end count as zeros.
    pub(super) fn unflatten(&self, mut values: impl Iterator<Item = f64>) -> State {
        let pose: [f64; 6] = std::array::from_fn(|_| values.next().unwrap_or_default());
        let mut state = self.rest();
        state.platform = Platform::from_pose(&pose);
        let frame = BentFrame::new(&state.platform, self.body.mesh.length_m());
        for (node, x) in self.body.mesh.nodes_m().iter().enumerate() {
            if self.pattern.of_displacement[3 * node] == NONE {
                continue;
            }
            let mut v = [0.0, x[1], x[2]];
            v.iter_mut()
                .for_each(|c| *c += values.next().unwrap_or_default());
            let (r, rotation) = frame.section(x[0]);
            let turned = apply(&rotation, v);
            for k in 0..3 {
                state.field.displacement[3 * node + k] = r[k] + turned[k] - x[k];
            }
        }
        for (i, p) in state.field.pressure.iter_mut().enumerate() {
            if self.has_pressure(i) {
                *p = values.next().unwrap_or_default();
            }
        }
        for k in 0..self.body.actuators() {
            state.inputs[k] = values.next().unwrap_or_default() * self.input_unit(k);
        }
        self.place_platform_nodes(&mut state);
        state
    }
}
