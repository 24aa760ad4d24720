//! Cosserat rod under a dead tip wrench: a cheap estimate of the pose.
//!
//! Straight rod along x, clamped at its base; strains from the force n and the moment
//! m in section axes: v = (1 + n_x/EA, n_y/GA, n_z/GA), u = (m_x/GJ, m_y/EI, m_z/EI);
//! r' = R v, `R' = R [u]×`. The dead tip wrench determines the stress state once the tip
//! position is known, m(s) = τ + (r_tip − r(s)) × f, so shooting is on three numbers
//! (Antman, Nonlinear Problems of Elasticity, ch. 8).

use crate::FemError;
use crate::platform::rotation_vector;
use crate::tensor::{Mat3, apply, cross, norm, product, transpose};
use ecm_se3::rotation_matrix;
use nalgebra::{Matrix3, Vector3};

/// Runge–Kutta steps along the rod.
const STEPS: usize = 20;
const ITERATIONS: usize = 60;

/// A straight rod clamped at its base.
///
/// ```
/// use ecm_fem::Rod;
/// # fn main() -> Result<(), ecm_fem::FemError> {
/// let rod = Rod {
///     length_m: 1.0,
///     axial_stiffness_N: 1e9,
///     shear_stiffness_N: 1e9,
///     bending_stiffness_Nm2: 2.0,
///     torsion_stiffness_Nm2: 1.0,
/// }
/// .checked()?;
/// // A pure end moment bends it into an arc of angle M L / (E I).
/// let (pose, converged) = rod.pose(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
/// assert!(converged && (pose[5] - 0.5).abs() < 1e-9);
/// # Ok(()) }
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rod {
    /// Length, m.
    pub length_m: f64,
    /// EA, N.
    pub axial_stiffness_N: f64,
    /// k GA, N.
    pub shear_stiffness_N: f64,
    /// EI, N m².
    pub bending_stiffness_Nm2: f64,
    /// GJ, N m².
    pub torsion_stiffness_Nm2: f64,
}

impl Rod {
    /// Checks that all parameters are positive.
    ///
    /// # Errors
    /// The first parameter that is not a positive number.
    pub fn checked(self) -> Result<Self, FemError> {
        for (name, value) in [
            ("length_m", self.length_m),
            ("axial_stiffness_N", self.axial_stiffness_N),
            ("shear_stiffness_N", self.shear_stiffness_N),
            ("bending_stiffness_Nm2", self.bending_stiffness_Nm2),
            ("torsion_stiffness_Nm2", self.torsion_stiffness_Nm2),
        ] {
            if !(value.is_finite() && value > 0.0) {
                return Err(FemError::Parameter {
                    name,
                    value,
                    expected: "a positive number",
                });
            }
        }
        Ok(self)
    }

    /// The rod of `length_m` with the stiffness K at rest of a body (the mean over y and z):
    /// EI/L = K_θθ − |K_yθ| L/2, 1 + Φ = 6 EI / (L² |K_yθ|), GA = 12 EI / (Φ L²).
    pub(crate) fn like(stiffness: &[[f64; 6]; 6], length_m: f64) -> Self {
        let k = stiffness;
        let tilt = 0.5 * (k[4][4] + k[5][5]);
        let mixed = 0.5 * (k[1][5].abs() + k[2][4].abs());
        // A body whose ends differ much may leave the beam's range: then a slender rod.
        let bending = (length_m * (tilt - 0.5 * mixed * length_m)).max(0.05 * length_m * tilt);
        let phi = (6.0 * bending / (length_m * length_m * mixed) - 1.0).max(1e-3);
        Self {
            length_m,
            axial_stiffness_N: k[0][0] * length_m,
            shear_stiffness_N: 12.0 * bending / (phi * length_m * length_m),
            bending_stiffness_Nm2: bending,
            torsion_stiffness_Nm2: k[3][3] * length_m,
        }
    }

    /// Pose (x, y, z, θx, θy, θz) of the tip under the dead wrench, and whether the
    /// shooting converged; if not, the last iterate.
    pub fn pose(&self, wrench: &[f64; 6]) -> ([f64; 6], bool) {
        // Load steps keep Newton on the branch that starts at rest.
        let mut tip = [self.length_m, 0.0, 0.0];
        let (mut reached, mut step) = (0.0, 1.0);
        let mut end = (tip, crate::tensor::IDENTITY);
        let mut converged = true;
        while reached < 1.0 {
            let share = f64::min(1.0, reached + step);
            let load = wrench.map(|h| share * h);
            match self.shoot(tip, &load) {
                Some(found) => {
                    (tip, reached, end) = (found.0, share, found);
                    step *= 2.0;
                }
                None if step > 1.0 / 32.0 => step *= 0.5,
                None => {
                    converged = false;
                    break;
                }
            }
        }
        let (r, theta) = (end.0, rotation_vector(&end.1));
        ([r[0], r[1], r[2], theta[0], theta[1], theta[2]], converged)
    }

    /// Newton on the tip position: integrate(tip) = tip.
    fn shoot(&self, mut tip: [f64; 3], wrench: &[f64; 6]) -> Option<([f64; 3], Mat3)> {
        let miss = |guess: [f64; 3]| {
            let (r, rotation) = self.integrate(guess, wrench);
            ([0, 1, 2].map(|k| r[k] - guess[k]), rotation)
        };
        let mut previous = f64::INFINITY;
        for _ in 0..ITERATIONS {
            let (e, rotation) = miss(tip);
            let size = norm(e);
            if size < 1e-10 * self.length_m {
                return Some((tip, rotation));
            }
            if !size.is_finite() || size > 2.0 * previous.max(0.1 * self.length_m) {
                return None;
            }
            previous = size;
            let h = 1e-6 * self.length_m;
            let mut jacobian = Matrix3::zeros();
            for k in 0..3 {
                let mut moved = tip;
                moved[k] += h;
                let (plus, _) = miss(moved);
                for i in 0..3 {
                    jacobian[(i, k)] = (plus[i] - e[i]) / h;
                }
            }
            let step = jacobian.lu().solve(&Vector3::from_column_slice(&e))?;
            let limit = (0.3 * self.length_m / step.norm()).min(1.0);
            tip = [0, 1, 2].map(|k| tip[k] - limit * step[k]);
        }
        None
    }

    /// Tip position and orientation when the moment is taken about `tip`.
    pub(crate) fn integrate(&self, tip: [f64; 3], wrench: &[f64; 6]) -> ([f64; 3], Mat3) {
        let force = [wrench[0], wrench[1], wrench[2]];
        let torque = [wrench[3], wrench[4], wrench[5]];
        let rates = |r: [f64; 3], rotation: &Mat3| {
            let back = transpose(rotation);
            let arm = [0, 1, 2].map(|k| tip[k] - r[k]);
            let about = cross(arm, force);
            let n = apply(&back, force);
            let m = apply(&back, [0, 1, 2].map(|k| torque[k] + about[k]));
            let v = [
                1.0 + n[0] / self.axial_stiffness_N,
                n[1] / self.shear_stiffness_N,
                n[2] / self.shear_stiffness_N,
            ];
            let u = [
                m[0] / self.torsion_stiffness_Nm2,
                m[1] / self.bending_stiffness_Nm2,
                m[2] / self.bending_stiffness_Nm2,
            ];
            (apply(rotation, v), u)
        };
        let h = self.length_m / STEPS as f64;
        let mut r = [0.0; 3];
        let mut rotation = crate::tensor::IDENTITY;
        // Runge–Kutta–Munthe-Kaas of order four with the commutator of its third stage.
        let turned = |rotation: &Mat3, u: [f64; 3]| product(rotation, &rotation_matrix(&u));
        let along = |r: [f64; 3], v: [f64; 3], s: f64| [0, 1, 2].map(|k| r[k] + s * v[k]);
        for _ in 0..STEPS {
            let (v1, u1) = rates(r, &rotation);
            let w1 = u1.map(|x| h * x);
            let half1 = w1.map(|x| 0.5 * x);
            let (v2, u2) = rates(along(r, v1, 0.5 * h), &turned(&rotation, half1));
            let w2 = u2.map(|x| h * x);
            // Left-trivialised: dexp of the right action has the opposite sign.
            let c12 = cross(w1, w2);
            let half2 = [0, 1, 2].map(|k| 0.5 * w2[k] + 0.125 * c12[k]);
            let (v3, u3) = rates(along(r, v2, 0.5 * h), &turned(&rotation, half2));
            let w3 = u3.map(|x| h * x);
            let (v4, u4) = rates(along(r, v3, h), &turned(&rotation, w3));
            let w4 = u4.map(|x| h * x);
            let c14 = cross(w1, w4);
            r = [0, 1, 2].map(|k| r[k] + h / 6.0 * (v1[k] + 2.0 * v2[k] + 2.0 * v3[k] + v4[k]));
            let w = [0, 1, 2]
                .map(|k| (w1[k] + 2.0 * w2[k] + 2.0 * w3[k] + w4[k]) / 6.0 + c14[k] / 12.0);
            rotation = turned(&rotation, w);
        }
        (r, rotation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rod() -> Rod {
        Rod {
            length_m: 1.0,
            axial_stiffness_N: 1e9,
            shear_stiffness_N: 1e9,
            bending_stiffness_Nm2: 1.0,
            torsion_stiffness_Nm2: 0.8,
        }
    }

    /// Elastica, dead transverse tip force P L² / EI (Bisshopp and Drucker 1945;
    /// Mattiasson 1981): deflection / L.
    #[test]
    fn tip_force_follows_the_elastica() {
        for (p, w, u, angle) in [
            (1.0, 0.30172, 0.05643, 0.46135),
            (2.0, 0.49346, 0.16064, 0.78175),
            (5.0, 0.71379, 0.38763, 1.21537),
            (10.0, 0.81061, 0.55500, 1.43029),
        ] {
            let (pose, converged) = rod().pose(&[0.0, p, 0.0, 0.0, 0.0, 0.0]);
            assert!(converged);
            assert!((pose[1] - w).abs() < 2e-5, "{p}: {}", pose[1]);
            assert!((1.0 - pose[0] - u).abs() < 2e-5, "{p}: {}", 1.0 - pose[0]);
            assert!((pose[5] - angle).abs() < 2e-5, "{p}: {}", pose[5]);
        }
    }

    /// A pure end moment rolls the rod up into a circle.
    #[test]
    fn end_moment_rolls_the_rod_up() {
        let t: f64 = 2.0;
        let (pose, converged) = rod().pose(&[0.0, 0.0, 0.0, 0.0, 0.0, t]);
        assert!(converged);
        assert!((pose[0] - t.sin() / t).abs() < 1e-6);
        assert!((pose[1] - (1.0 - t.cos()) / t).abs() < 1e-6);
        assert!((pose[5] - t).abs() < 1e-6);
    }

    /// A rod made from a Timoshenko beam's stiffness has that beam's tip compliance.
    #[test]
    fn takes_its_sections_from_the_stiffness_at_rest() {
        let (l, ea, ga, ei, gj): (f64, f64, f64, f64, f64) = (0.3, 900.0, 300.0, 2.0, 1.5);
        let phi = 12.0 * ei / (ga * l * l);
        let mut k = [[0.0; 6]; 6];
        (k[0][0], k[3][3]) = (ea / l, gj / l);
        let (transverse, tilt) = (
            12.0 * ei / (l.powi(3) * (1.0 + phi)),
            (4.0 + phi) / (1.0 + phi) * ei / l,
        );
        (k[1][1], k[2][2], k[4][4], k[5][5]) = (transverse, transverse, tilt, tilt);
        (k[1][5], k[2][4]) = (-transverse * l / 2.0, transverse * l / 2.0);
        let rod = Rod::like(&k, l);
        for (found, exact) in [
            (rod.axial_stiffness_N, ea),
            (rod.shear_stiffness_N, ga),
            (rod.bending_stiffness_Nm2, ei),
            (rod.torsion_stiffness_Nm2, gj),
        ] {
            assert!((found / exact - 1.0).abs() < 1e-9, "{found} {exact}");
        }
    }

    /// Doubling the load direction's rotation about x rotates the answer.
    #[test]
    fn turns_with_the_load_about_its_axis() {
        let (a, _) = rod().pose(&[0.3, 1.0, 0.0, 0.2, 0.0, 0.4]);
        let (b, _) = rod().pose(&[0.3, 0.0, 1.0, 0.2, -0.4, 0.0]);
        assert!((a[0] - b[0]).abs() < 1e-12);
        assert!((a[1] - b[2]).abs() < 1e-12 && (a[2] + b[1]).abs() < 1e-12);
        assert!((a[5] + b[4]).abs() < 1e-12 && (a[3] - b[3]).abs() < 1e-12);
    }
}
