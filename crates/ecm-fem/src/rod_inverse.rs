//! The wrench that holds the tip of a rod at a pose.
//!
//! At a given pose the tip position is known, so [`Rod::integrate`] needs no shooting: Newton's
//! method on the six numbers of the wrench alone. With (r, θ) = g(c, h), c the tip that the moment
//! is taken about, the pose p(h) obeys r = g_r(r, h), hence
//!
//! dr/dh = (1 − ∂g_r/∂c)⁻¹ ∂g_r/∂h and dp/dh = ∂g/∂h + ∂g/∂c dr/dh.

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Matrix6x3, Vector6};

use crate::platform::rotation_vector;
use crate::rod::Rod;

const ITERATIONS: usize = 15;
/// Steps from rest to a pose that Newton's method does not reach at once.
const WALK: usize = 8;
/// Steps of the central differences: N, N m, and m over the length.
const STEP: [f64; 3] = [1e-3, 1e-5, 1e-6];
/// Largest step of Newton's method, N and N m.
const LIMIT: [f64; 2] = [40.0, 1.0];
/// Error of the pose at the solution, over (length, 1 rad).
const TOLERANCE: f64 = 1e-11;

/// A wrench (N, N m) and d pose / d wrench there.
pub type WrenchAndCompliance = ([f64; 6], [[f64; 6]; 6]);

impl Rod {
    /// Dead wrench (N, N m) that holds the tip at a pose, and the slope d pose / d wrench.
    ///
    /// Newton's method from `start`, else in steps from rest. `None` where neither finds an
    /// equilibrium.
    ///
    /// ```
    /// use ecm_fem::Rod;
    /// let rod = Rod {
    ///     length_m: 1.0,
    ///     axial_stiffness_N: 900.0,
    ///     shear_stiffness_N: 300.0,
    ///     bending_stiffness_Nm2: 2.0,
    ///     torsion_stiffness_Nm2: 1.0,
    /// };
    /// let (pose, _) = rod.pose(&[-3.0, 1.0, 0.5, 0.1, 0.2, -0.4]);
    /// let found = rod.wrench(&pose, &[0.0; 6]);
    /// assert!(found.is_some_and(|(h, _)| (h[1] - 1.0).abs() < 1e-7));
    /// ```
    pub fn wrench(&self, pose: &[f64; 6], start: &[f64; 6]) -> Option<WrenchAndCompliance> {
        let target = Vector6::from(*pose);
        let (wrench, slope) = self
            .newton(&target, Vector6::from(*start))
            .or_else(|| self.walk(&target))?;
        Some((wrench.into(), slope.transpose().into()))
    }

    /// In equal steps from rest, each from a linear prediction.
    fn walk(&self, target: &Vector6<f64>) -> Option<(Vector6<f64>, Matrix6<f64>)> {
        let rest = Vector6::from([self.length_m, 0.0, 0.0, 0.0, 0.0, 0.0]);
        let step = (target - rest) / WALK as f64;
        let (mut wrench, mut slope) = self.newton(&rest, Vector6::zeros())?;
        for k in 1..=WALK {
            let guess = wrench + slope.lu().solve(&step)?;
            (wrench, slope) = self.newton(&(rest + step * k as f64), guess)?;
        }
        Some((wrench, slope))
    }

    fn newton(
        &self,
        target: &Vector6<f64>,
        mut wrench: Vector6<f64>,
    ) -> Option<(Vector6<f64>, Matrix6<f64>)> {
        let tip = [target[0], target[1], target[2]];
        let scale = self.length_m;
        for _ in 0..ITERATIONS {
            let left = target - self.about(tip, &wrench);
            let at_tip = self.at_fixed_tip(tip, &wrench);
            // Before the largest is taken, which passes over NaN.
            if !left.iter().all(|x| x.is_finite()) {
                return None;
            }
            let size = left.fixed_rows::<3>(0).amax() / scale;
            let size = size.max(left.fixed_rows::<3>(3).amax());
            if size < TOLERANCE {
                return Some((wrench, self.slope(tip, &wrench, &at_tip)?));
            }
            let step = at_tip.lu().solve(&left)?;
            let force = step.fixed_rows::<3>(0).amax() / LIMIT[0];
            let torque = step.fixed_rows::<3>(3).amax() / LIMIT[1];
            wrench += step / force.max(torque).max(1.0);
        }
        None
    }

    /// Pose at the end of an integration whose moment is taken about `tip`.
    fn about(&self, tip: [f64; 3], wrench: &Vector6<f64>) -> Vector6<f64> {
        let (r, rotation) = self.integrate(tip, &(*wrench).into());
        let theta = rotation_vector(&rotation);
        Vector6::from([r[0], r[1], r[2], theta[0], theta[1], theta[2]])
    }

    /// ∂g/∂h.
    fn at_fixed_tip(&self, tip: [f64; 3], wrench: &Vector6<f64>) -> Matrix6<f64> {
        let mut slope = Matrix6::zeros();
        for k in 0..6 {
            let step = STEP[usize::from(k >= 3)];
            let moved = |by: f64| {
                let mut other = *wrench;
                other[k] += by;
                self.about(tip, &other)
            };
            slope.set_column(k, &((moved(step) - moved(-step)) / (2.0 * step)));
        }
        slope
    }

    /// dp/dh, with ∂g/∂c by central differences.
    fn slope(
        &self,
        tip: [f64; 3],
        wrench: &Vector6<f64>,
        at_tip: &Matrix6<f64>,
    ) -> Option<Matrix6<f64>> {
        let step = STEP[2] * self.length_m;
        let mut by_tip = Matrix6x3::zeros();
        for k in 0..3 {
            let moved = |by: f64| {
                let mut other = tip;
                other[k] += by;
                self.about(other, wrench)
            };
            by_tip.set_column(k, &((moved(step) - moved(-step)) / (2.0 * step)));
        }
        let implicit = Matrix3::identity() - by_tip.fixed_rows::<3>(0);
        let tip_slope: Matrix3x6<f64> = implicit.lu().solve(&at_tip.fixed_rows::<3>(0))?;
        Some(at_tip + by_tip * tip_slope)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ROD: Rod = Rod {
        length_m: 0.1,
        axial_stiffness_N: 2200.0,
        shear_stiffness_N: 650.0,
        bending_stiffness_Nm2: 0.6,
        torsion_stiffness_Nm2: 0.4,
    };

    /// There and back, and the slope against differences of the way there.
    #[test]
    fn is_the_inverse_of_the_pose() {
        for wrench in [
            [0.0; 6],
            [10.0, -25.0, 30.0, 0.5, 1.5, -2.0],
            [-30.0, 40.0, 10.0, -0.8, -2.0, 2.5],
        ] {
            let (pose, converged) = ROD.pose(&wrench);
            assert!(converged);
            let solved = ROD.wrench(&pose, &[0.0; 6]);
            assert!(solved.is_some());
            let (found, slope) = solved.unwrap_or_default();
            for k in 0..6 {
                let unit = if k < 3 { 1.0 } else { ROD.length_m };
                assert!((found[k] - wrench[k]).abs() < 1e-6 * unit, "{k}: {found:?}");
                let step = 1e-2 * unit;
                let at = |by: f64| {
                    let mut other = wrench;
                    other[k] += by;
                    ROD.pose(&other).0
                };
                let (plus, minus) = (at(step), at(-step));
                for (i, row) in slope.iter().enumerate() {
                    let difference = (plus[i] - minus[i]) / (2.0 * step);
                    assert!((row[k] - difference).abs() < 1e-6 / unit, "{i} {k}");
                }
            }
        }
    }

    #[test]
    fn no_wrench_holds_a_pose_that_is_no_number() {
        for k in 0..6 {
            let mut pose = [ROD.length_m, 0.0, 0.0, 0.0, 0.0, 0.0];
            pose[k] = f64::NAN;
            assert!(ROD.wrench(&pose, &[0.0; 6]).is_none(), "{k}");
        }
    }
}
