//! Which equilibria are stable.
//!
//! At a given pose an equilibrium is stable where the tangent K_ff at fixed platform has no
//! negative pivot beyond those of the pressures. A dead wrench (force and moment constant in base
//! axes) adds K_s = K diag(I, J⁻¹): an increment (δr, δφ) of the platform needs the wrench
//! K_s (δr, δφ), and another equilibrium is near where det K_s = 0. Along a branch of equilibria that
//! begins at rest, stability ends where det K_s changes its sign.
//!
//! Two eigenvalues may pass zero at once and keep the sign, in a column that may bend to all sides.
//! So every real eigenvalue that is not positive counts. With a moment, K_s is not symmetric, and
//! such a pair may be complex: it passes with no equilibrium near, and whether the platform then
//! flutters depends on inertia and friction, not on statics. It counts only where its negative real
//! part exceeds the imaginary one, that is where the moment is small beside the force.
//!
//! H = ∂(f, Jᵀτ)/∂p is symmetric and belongs to a moment that is conjugate to the rotation
//! vector, which turns with the platform. Without a moment det H and det K_s have the same zeros.

use super::Load;
use nalgebra::{Matrix6, Schur};

/// What has lost stability.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Instability {
    /// The body, at fixed platform.
    Inner,
    /// The platform under a dead wrench.
    Platform,
}

/// Measures of K_s with lengths divided by L; not a number where they cannot be found.
#[derive(Debug, Clone, Copy)]
pub(super) struct Spectrum {
    /// det K_s, (N m)⁶.
    pub determinant: f64,
    /// Smallest eigenvalue of the symmetric part, N m.
    pub smallest_symmetric: f64,
    /// An eigenvalue is not positive, and not mainly imaginary.
    diverges: bool,
}

/// QR iterations for the eigenvalues of a 6 × 6 matrix; some twenty are usual.
const MOST_QR_ITERATIONS: usize = 500;

impl Spectrum {
    pub fn of(k_s: &[[f64; 6]; 6], length_m: f64) -> Self {
        let s = |i: usize| if i < 3 { length_m } else { 1.0 };
        let scaled = Matrix6::from_fn(|i, j| k_s[i][j] * s(i) * s(j));
        let unknown = Self {
            determinant: f64::NAN,
            smallest_symmetric: f64::NAN,
            diverges: true,
        };
        if !scaled.iter().all(|v| v.is_finite()) {
            return unknown;
        }
        let symmetric = (scaled + scaled.transpose()) * 0.5;
        Schur::try_new(scaled, f64::EPSILON, MOST_QR_ITERATIONS).map_or(unknown, |schur| {
            let values = schur.complex_eigenvalues();
            Self {
                determinant: scaled.determinant(),
                smallest_symmetric: symmetric.symmetric_eigenvalues().min(),
                diverges: values.iter().any(|v| v.re <= -v.im.abs()),
            }
        })
    }

    /// What is unstable at an equilibrium under `load`; `None` where it is stable.
    pub fn instability(&self, load: &Load, inner_instabilities: usize) -> Option<Instability> {
        if inner_instabilities > 0 {
            return Some(Instability::Inner);
        }
        let positive = self.determinant > 0.0 && !self.diverges;
        let held = matches!(load, Load::Pose(_));
        (!held && !positive).then_some(Instability::Platform)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn diagonal(values: [f64; 6]) -> [[f64; 6]; 6] {
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { values[i] } else { 0.0 }))
    }

    fn lost(k_s: &[[f64; 6]; 6]) -> bool {
        let wrench = Load::Wrench([0.0; 6]);
        Spectrum::of(k_s, 1.0).instability(&wrench, 0).is_some()
    }

    #[test]
    fn one_and_two_negative_eigenvalues_are_losses() {
        assert!(!lost(&diagonal([1.0, 2.0, 3.0, 1.0, 1.0, 1.0])));
        assert!(lost(&diagonal([1.0, 2.0, 3.0, 1.0, -1.0, 1.0])));
        // The determinant of this one is positive.
        assert!(lost(&diagonal([1.0, 2.0, 3.0, 1.0, -1.0, -1.0])));
        assert!(lost(&diagonal([f64::NAN; 6])));
    }

    #[test]
    fn a_pair_counts_where_it_is_mainly_real() {
        let pair = |real: f64, imaginary: f64| {
            let mut k = diagonal([1.0, 2.0, 3.0, 1.0, real, real]);
            (k[4][5], k[5][4]) = (imaginary, -imaginary);
            lost(&k)
        };
        assert!(!pair(0.5, 1.0));
        assert!(!pair(-0.5, 1.0));
        assert!(pair(-1.0, 0.5));
    }

    #[test]
    fn a_held_platform_is_judged_by_the_body_alone() {
        let k = diagonal([-1.0; 6]);
        let pose = Load::Pose([0.0; 6]);
        let spectrum = Spectrum::of(&k, 1.0);
        assert_eq!(spectrum.instability(&pose, 0), None);
        assert_eq!(spectrum.instability(&pose, 2), Some(Instability::Inner));
    }
}
