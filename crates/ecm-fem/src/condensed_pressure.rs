//! Condensed pressure: eliminated from the matrix, but stored from one Newton iteration to the next.
//!
//! P2 and P2/P0 need no unknown for the pressure: p = κ (J − 1) at a point, or of the element's
//! mean. Newton in the displacements alone then sees the volume's nonlinearity times κ in the
//! geometric stiffness and takes some 30 short steps at ν = 0.49, 160 at 0.4999. Linearised with
//! the pressure as an unknown of its own and eliminated afterwards, the matrix has the same entries
//! but for that geometric part, which uses the pressure of the last step (mixed integration
//! points: Magisano, Leonetti and Garcea, Int. J. Numer. Meth. Engng 109, 2017):
//!
//! p ← p + (s (J − 1 − p/κ) + cof F : δF) / c   for a share s of a step and its linear δF.
//!
//! A step δF leaves a gap J − 1 − p/κ of second order. With c = 1/κ it becomes a pressure much
//! larger than μ, from which Newton does not recover. Therefore
//!
//! c = max(1/κ, 1/(10⁶ μ), s/μ),   s = min(1, max(4 ⟨|δF|²⟩, s_before/4))
//!
//! with the mean over the body in the last step: gaps then cause pressures of the order of μ, and
//! the softening s vanishes before Newton converges. From rest to the reference wrench, ν = 0.49:
//! 7 or 8 iterations in one load step, about 16 where a rim folds and two load steps are needed.

use crate::body::{Body, Field, Formulation, deformation, element_displacement};
use crate::tensor::{Mat3, cofactor};

/// Softening over the mean square of the last step's δF; of 1, 2 and 4 the one with the fewest
/// iterations on seven meshes of the reference case.
const SOFTENING_PER_SQUARE: f64 = 4.0;

/// Smallest ratio of the softening to that of the iteration before.
const LARGEST_DECREASE: f64 = 0.25;

/// Largest softening: a tangent with κ = μ, as at ν = 0.13.
const MOST_SOFTENING: f64 = 1.0;

impl Body {
    /// 1/κ of element `e`, 0 when incompressible, and the compliance c of its tangent, 1/Pa;
    /// `softening`: least c times μ.
    ///
    /// K_pp = 0 at ν = 0.5 would leave pivots to chance: the tangent alone, not the
    /// residual, gets a bulk modulus; Newton then gains six digits an iteration (four for P2/P0).
    pub(crate) fn compliances(&self, e: usize, softening: f64) -> (f64, f64) {
        let by_kappa = 1.0 / (self.material.bulk_modulus_Pa() * self.modulus_scale[e]);
        let least =
            softening.max(1.0 / self.largest_bulk_ratio()) / self.material.shear_modulus_Pa();
        (by_kappa, by_kappa.max(least))
    }

    /// Largest ratio of bulk to shear modulus in the tangent. P2/P0 does not converge above 10⁴;
    /// P2 locks and needs all digits of its pressures.
    fn largest_bulk_ratio(&self) -> f64 {
        match self.formulation {
            Formulation::ConstantPressure => 1e4,
            Formulation::TaylorHood | Formulation::Displacement => 1e6,
        }
    }

    /// Whether a tangent with this softening differs from the exact one.
    pub(crate) fn is_softened(&self, softening: f64) -> bool {
        self.condensed_pressures() > 0
            && softening > 1.0 / self.largest_bulk_ratio()
            && softening / self.material.shear_modulus_Pa() > 1.0 / self.material.bulk_modulus_Pa()
    }

    /// Updates the pressures of `moved`, which is `from` plus `share` of a linear step by a tangent
    /// with this softening; returns the softening for the next step.
    pub(crate) fn update_condensed_pressures(
        &self,
        from: &Field,
        moved: &mut Field,
        share: f64,
        softening: f64,
    ) -> f64 {
        let (mut square, mut total_volume) = (0.0, 0.0);
        let (pressures, count) = (self.condensed_pressures(), self.rule.points().len());
        for (e, tet) in self.mesh.tetrahedra().iter().enumerate() {
            let (u, v) = (
                element_displacement(tet, from),
                element_displacement(tet, moved),
            );
            let (by_kappa, compliance) = self.compliances(e, softening);
            let (mut volume, mut mean_gap, mut mean_rise) = (0.0, 0.0, 0.0);
            for (q, point) in self.points[e * count..(e + 1) * count].iter().enumerate() {
                let (f, g) = (deformation(point, &u), deformation(point, &v));
                let (gap, rise, change) = volume_change(&f, &g);
                square += point.volume_m3 * change;
                total_volume += point.volume_m3;
                if pressures == 1 {
                    volume += point.volume_m3;
                    mean_gap += point.volume_m3 * gap;
                    mean_rise += point.volume_m3 * rise;
                } else {
                    let old = self.pressure_unit_Pa * from.pressure[e * pressures + q];
                    let new = old + (share * (gap - by_kappa * old) + rise) / compliance;
                    moved.pressure[e * pressures + q] = new / self.pressure_unit_Pa;
                }
            }
            if pressures == 1 {
                let old = self.pressure_unit_Pa * from.pressure[e];
                let gap = share * (mean_gap / volume - by_kappa * old);
                let new = old + (gap + mean_rise / volume) / compliance;
                moved.pressure[e] = new / self.pressure_unit_Pa;
            }
        }
        f64::min(
            MOST_SOFTENING,
            f64::max(
                SOFTENING_PER_SQUARE * square / total_volume,
                LARGEST_DECREASE * softening,
            ),
        )
    }
}

/// J − 1 of `f`, its linear change from `f` to `g`, and |g − f|².
fn volume_change(f: &Mat3, g: &Mat3) -> (f64, f64, f64) {
    let c = cofactor(f);
    let (mut rise, mut square) = (0.0, 0.0);
    for i in 0..3 {
        for j in 0..3 {
            let change = g[i][j] - f[i][j];
            rise += c[i][j] * change;
            square += change * change;
        }
    }
    (crate::tensor::determinant(f) - 1.0, rise, square)
}
