//! Neo-Hookean: W_d = μ/2 (J^(−2/3) I₁ − 3), μ = E / (2 (1 + ν)), κ = E / (3 (1 − 2ν)).

use super::{Material, Model, Response, Volume, positive, positive_parameters};
use crate::FemError;
use crate::tensor::{Mat3, cofactor};

pub(super) const MODEL: Model = Model {
    name: "neo_hookean",
    parameters: &["young_modulus_Pa"],
    has_terms: false,
    make: |values, volume| {
        let young = values.one("young_modulus_Pa")?;
        let nu = match volume {
            Volume::PoissonRatio(nu) => nu,
            // E and κ give ν = (3 κ − E) / (6 κ).
            Volume::BulkModulusPa(kappa) => 0.5 - young / (6.0 * kappa),
        };
        Ok(Box::new(NeoHookean::new(young, nu)?))
    },
    start: |mu, _| vec![(3.0 * mu).ln()],
    decode: positive_parameters,
};

/// The energy of Abaqus, CalculiX and FElupe (C10 = μ/2, D1 = 2/κ).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NeoHookean {
    shear_modulus_Pa: f64,
    bulk_modulus_Pa: f64,
}

impl NeoHookean {
    /// From Young's modulus and Poisson's ratio.
    ///
    /// # Errors
    /// E not positive; ν outside (0, 0.5]. At 0.5 the volume is kept exactly (κ infinite).
    pub fn new(young_modulus_Pa: f64, poisson_ratio: f64) -> Result<Self, FemError> {
        positive("young_modulus_Pa", young_modulus_Pa)?;
        if !(poisson_ratio > 0.0 && poisson_ratio <= 0.5) {
            return Err(FemError::Parameter {
                name: "poisson_ratio",
                value: poisson_ratio,
                expected: "above 0 and at most 0.5",
            });
        }
        Ok(Self {
            shear_modulus_Pa: young_modulus_Pa / (2.0 * (1.0 + poisson_ratio)),
            bulk_modulus_Pa: young_modulus_Pa / (3.0 * (1.0 - 2.0 * poisson_ratio)),
        })
    }
}

/// μ/2 (Ī₁ − 3). With G = F^-T and c = μ J^(−2/3): P = c (F − I₁/3 G),
/// ∂P/∂F = c (δδ − 2/3 (F⊗G + G⊗F) + 2/9 I₁ G⊗G + I₁/3 G_iL G_kJ).
#[inline(always)]
pub(crate) fn distortion(mu: f64, f: &Mat3, jacobian: f64) -> Response {
    let c = mu * jacobian.cbrt().powi(-2);
    let g = cofactor(f).map(|row| row.map(|v| v / jacobian));
    let i1: f64 = f.iter().flatten().map(|v| v * v).sum();
    let mut stress = [[0.0; 3]; 3];
    let mut tangent = [[0.0; 9]; 9];
    for i in 0..3 {
        for j in 0..3 {
            stress[i][j] = c * (f[i][j] - i1 / 3.0 * g[i][j]);
            // c (−2/3 F + 2/9 I₁ G) ⊗ G − 2/3 c G ⊗ F
            let by_g = c * (-2.0 / 3.0 * f[i][j] + 2.0 / 9.0 * i1 * g[i][j]);
            let by_f = -2.0 / 3.0 * c * g[i][j];
            let row = &mut tangent[3 * i + j];
            for k in 0..3 {
                for l in 0..3 {
                    row[3 * k + l] =
                        by_g * g[k][l] + by_f * f[k][l] + c * i1 / 3.0 * g[i][l] * g[k][j];
                }
            }
            row[3 * i + j] += c;
        }
    }
    let energy = 0.5 * (c * i1 - 3.0 * mu);
    Response {
        energy,
        stress,
        tangent,
    }
}

impl Material for NeoHookean {
    #[inline(always)]
    fn respond(&self, f: &Mat3, jacobian: f64) -> Response {
        distortion(self.shear_modulus_Pa, f, jacobian)
    }

    fn shear_modulus_Pa(&self) -> f64 {
        self.shear_modulus_Pa
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        self.bulk_modulus_Pa
    }
}
