//! Cauchy stress at the quadrature points.

use crate::body::{Body, Field, Formulation};
use crate::tensor::Mat3;

impl Body {
    /// Cauchy stress σ = P Fᵀ / J at the points of element `e`, Pa, with P of W_d and pressure.
    pub(crate) fn cauchy_stress_Pa(&self, e: usize, field: &Field) -> Vec<Mat3> {
        let tet = &self.mesh.tetrahedra()[e];
        let gradients: Vec<Mat3> = self.deformation_gradients(e, field).collect();
        let condensed = self.condensed_pressures();
        gradients
            .iter()
            .zip(self.rule.points())
            .enumerate()
            .map(|(q, (f, (psi, _)))| {
                let jacobian = crate::tensor::determinant(f);
                let scaled: f64 = match self.formulation {
                    Formulation::TaylorHood => {
                        (0..4).map(|m| psi[m] * field.pressure[tet[m]]).sum()
                    }
                    Formulation::ConstantPressure => field.pressure[e],
                    Formulation::Displacement => field.pressure[e * condensed + q],
                };
                let pressure = self.pressure_unit_Pa * scaled;
                let mut stress = self.material.respond(f, jacobian).stress;
                let stabilisation = self.stabilisation(e, f, jacobian, pressure);
                for i in 0..3 {
                    for j in 0..3 {
                        stress[i][j] *= self.modulus_scale[e];
                        stress[i][j] += stabilisation.as_ref().map_or(0.0, |x| x.stress[i][j]);
                    }
                }
                let mut sigma = crate::tensor::product(&stress, &crate::tensor::transpose(f))
                    .map(|row| row.map(|v| v / jacobian));
                for k in 0..3 {
                    sigma[k][k] += pressure + stabilisation.as_ref().map_or(0.0, |x| x.pressure);
                }
                sigma
            })
            .collect()
    }
}
