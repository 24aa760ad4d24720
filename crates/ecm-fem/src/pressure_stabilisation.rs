//! Pressure stabilisation: bulk stiffness at the quadrature points where distortion is large, so
//! that Taylor–Hood does not lose stability before the body does.
//!
//! Taylor–Hood preserves the volume on average only. Displacements that change the volume at
//! points, but not on average, make the geometric stiffness of a large pressure indefinite (Auricchio, Beirão da Veiga, Lovadina and Reali, Comput. Methods Appl. Mech. Engng
//! 194, 2005). A block of incompressible neo-Hookean rubber in plane strain, whose surface is
//! stable down to a stretch of 0.544 (Biot 1963), has negative pivots from 0.70 on, the more
//! the finer the mesh. A part γ of the bulk modulus at the points instead of in the pressure,
//!
//! W_d + γ/2 (J − 1)² + p (J − 1) − p² / (2 (κ − γ)),
//!
//! is the same body for every γ: 0 is Taylor–Hood, κ is P2, which locks. With γ = 3 μ everywhere
//! the block loses stability between 0.55 and 0.54, but the pose of the reference case errs
//! by 1.30 % instead of 0.90 %. The distortion shows where it is needed:
//!
//! γ = Γ y / (1 + y), y = 3 μ x² / Γ, x = Ī₁ − 3, Γ = min(10 μ, κ/5)
//!
//! gives the block the same (test `a_compressed_surface_is_stable_as_far_as_biot`) and the
//! pose 0.94 %. At rest γ = 0. Energy, forces and tangent are exact derivatives of one another.

use crate::body::{Body, Formulation};
use crate::material::{Response, distortion};
use crate::tensor::Mat3;

/// γ / (μ x²) at small distortion.
const INITIAL_GROWTH: f64 = 3.0;

/// Largest γ / μ.
const LARGEST_RATIO: f64 = 10.0;

/// Additional terms of one Taylor–Hood point by γ, per undeformed volume.
pub(crate) struct Stabilisation {
    /// Energy in addition to p (J − 1) − p²/(2 κ), J/m³.
    pub energy: f64,
    /// Pressure in addition to p, Pa.
    pub pressure: f64,
    /// Stress by the change of γ, Pa.
    pub stress: Mat3,
    /// 1 / (κ − γ).
    pub by_kappa: f64,
    /// ∂²/∂F∂p = cof F − `mixing`.
    pub mixing: Mat3,
    bulk: f64,
    /// Factors of cof ⊗ x' + x' ⊗ cof, x' ⊗ x', x''.
    factors: [f64; 3],
    distortion: Response,
}

impl Body {
    /// Stabilisation at a point with deformation gradient `f` and `pressure` (Pa); `None` for
    /// elements that preserve the volume at points.
    pub(crate) fn stabilisation(
        &self,
        e: usize,
        f: &Mat3,
        jacobian: f64,
        pressure: f64,
    ) -> Option<Stabilisation> {
        if self.formulation != Formulation::TaylorHood {
            return None;
        }
        let kappa = self.material.bulk_modulus_Pa() * self.modulus_scale[e];
        let mu = self.material.shear_modulus_Pa() * self.modulus_scale[e];
        // μ = 2: the energy is x.
        let x = distortion(2.0, f, jacobian);
        let limit = (LARGEST_RATIO * mu).min(0.2 * kappa);
        let by_limit = INITIAL_GROWTH * mu / limit;
        let y = by_limit * x.energy * x.energy;
        let (dy, ddy) = (2.0 * by_limit * x.energy, 2.0 * by_limit);
        let bulk = limit * y / (1.0 + y);
        let slope = limit * dy / (1.0 + y).powi(2);
        let bend = limit * (ddy - 2.0 * dy * dy / (1.0 + y)) / (1.0 + y).powi(2);
        let by_kappa = 1.0 / (kappa - bulk);
        let (gap, q) = (jacobian - 1.0, pressure * by_kappa);
        // ∂/∂γ of the energy: zero where the pressure equation holds at the point.
        let by_gamma = 0.5 * (gap * gap - q * q);
        Some(Stabilisation {
            energy: 0.5 * bulk * gap * gap - 0.5 * pressure * pressure * (by_kappa - 1.0 / kappa),
            pressure: bulk * gap,
            stress: x.stress.map(|row| row.map(|v| by_gamma * slope * v)),
            by_kappa,
            mixing: x.stress.map(|row| row.map(|v| q * slope * by_kappa * v)),
            bulk,
            factors: [
                gap * slope,
                by_gamma * bend - slope * slope * q * q * by_kappa,
                by_gamma * slope,
            ],
            distortion: x,
        })
    }
}

impl Stabilisation {
    /// Adds its tangent without the geometric part of the pressure, times `weight`.
    pub(crate) fn add_tangent(&self, tangent: &mut [[f64; 9]; 9], cof: &Mat3, weight: f64) {
        let [cross, square, curve] = self.factors.map(|v| weight * v);
        let bulk = weight * self.bulk;
        let rise = &self.distortion.stress;
        for (r, (row, curvature)) in tangent.iter_mut().zip(&self.distortion.tangent).enumerate() {
            let (c, a) = (cof[r / 3][r % 3], rise[r / 3][r % 3]);
            let (by_cof, by_rise) = (bulk * c + cross * a, cross * c + square * a);
            for k in 0..9 {
                row[k] += by_cof * cof[k / 3][k % 3]
                    + by_rise * rise[k / 3][k % 3]
                    + curve * curvature[k];
            }
        }
    }
}
