//! Pressures that are eliminated from the matrix, yet kept from one Newton iteration to the next.
//!
//! P2 and P2/P0 need no unknown for the pressure: p = κ (J − 1) at a point, or of the element's
//! mean. Newton in the displacements alone then sees the volume's nonlinearity times κ in the
//! geometric stiffness and takes some 30 short steps at ν = 0.49, 160 at 0.4999. Linearised with
//! the pressure as an unknown of its own and eliminated afterwards, the matrix has the same entries
//! but for that geometric part, which holds the pressure of the last step (mixed integration
//! points: Magisano, Leonetti and Garcea, Int. J. Numer. Meth. Engng 109, 2017):
//!
//! p ← p + (s (J − 1 − p/κ) + cof F : δF) / c   for a step of share s and its linear δF.
//!
//! A step δF leaves a gap J − 1 − p/κ of second order, which c = 1/κ turns into pressures far
//! beyond μ that no later step of the displacements can follow. So
//!
//! c = max(1/κ, 1/(10⁶ μ), s/μ),   s = min(1, max(4 ⟨|δF|²⟩, s_before/4))
//!
//! with the mean over the body of the last step: gaps cost pressures of the order of μ, and the
//! softening s ends by itself before Newton does. From rest to the reference wrench, ν = 0.49:
//! 7 or 8 iterations where one load step does, about 16 where a rim folds and two are needed.

use crate::body::{Body, Field, Formulation, deformation, element_displacement};
use crate::tensor::{Mat3, cofactor};

/// Softening over the mean square of the last step's δF; of 1, 2 and 4 the one with the fewest
/// iterations on seven meshes of the reference case.
const SQUARES: f64 = 4.0;

/// The softening falls at most by this factor from one iteration to the next.
const FALL: f64 = 0.25;

/// Largest softening: a tangent with κ = μ, as at ν = 0.13.
const SOFTEST: f64 = 1.0;

impl Body {
    /// 1/κ of element `e`, 0 when incompressible, and the compliance c of its tangent, 1/Pa;
    /// `softening`: least c times μ.
    ///
    /// K_pp = 0 at ν = 0.5 would leave pivots to chance: the tangent alone, not the
    /// residual, gets a bulk modulus; Newton then gains six digits an iteration (four for P2/P0).
    pub(crate) fn compliances(&self, e: usize, softening: f64) -> (f64, f64) {
        let by_kappa = 1.0 / (self.material.bulk_modulus_Pa() * self.modulus_scale[e]);
        let least = softening.max(1.0 / self.stiffest()) / self.material.shear_modulus_Pa();
        (by_kappa, by_kappa.max(least))
    }

    /// Bulk over shear modulus above which the tangent is no stiffer. P2/P0 does not follow from
    /// beyond 10⁴; P2 locks, and its pressures need every digit.
    fn stiffest(&self) -> f64 {
        match self.formulation {
            Formulation::ConstantPressure => 1e4,
            Formulation::TaylorHood | Formulation::Displacement => 1e6,
        }
    }

    /// Whether a tangent of this softening stands for another body than this one.
    pub(crate) fn is_softened(&self, softening: f64) -> bool {
        self.kept_pressures() > 0
            && softening > 1.0 / self.stiffest()
            && softening / self.material.shear_modulus_Pa() > 1.0 / self.material.bulk_modulus_Pa()
    }

    /// Kept pressures of `moved`, which is `from` and `share` of a linear step by a tangent of
    /// this softening; returns the softening that befits the step.
    pub(crate) fn move_kept_pressures(
        &self,
        from: &Field,
        moved: &mut Field,
        share: f64,
        softening: f64,
    ) -> f64 {
        let (mut square, mut whole) = (0.0, 0.0);
        let (kept, count) = (self.kept_pressures(), self.rule.points().len());
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
                whole += point.volume_m3;
                if kept == 1 {
                    volume += point.volume_m3;
                    mean_gap += point.volume_m3 * gap;
                    mean_rise += point.volume_m3 * rise;
                } else {
                    let old = self.pressure_unit_Pa * from.pressure[e * kept + q];
                    let new = old + (share * (gap - by_kappa * old) + rise) / compliance;
                    moved.pressure[e * kept + q] = new / self.pressure_unit_Pa;
                }
            }
            if kept == 1 {
                let old = self.pressure_unit_Pa * from.pressure[e];
                let gap = share * (mean_gap / volume - by_kappa * old);
                let new = old + (gap + mean_rise / volume) / compliance;
                moved.pressure[e] = new / self.pressure_unit_Pa;
            }
        }
        f64::min(
            SOFTEST,
            f64::max(SQUARES * square / whole, FALL * softening),
        )
    }
}

/// J − 1 of `f`, its linear rise on the way to `g`, and the square of that way.
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
