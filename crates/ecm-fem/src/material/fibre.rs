//! Fibres along one direction in any matrix material:
//! W_f = k₁ / (2 k₂) (exp(k₂ E²) − 1) for E = Ī₄ − 1 > 0, Ī₄ = J^(−2/3) |F a|²
//! (Holzapfel, Gasser and Ogden 2000); slack in compression.

use super::{Material, Response, positive};
use crate::FemError;
use crate::tensor::{Mat3, apply, cofactor, norm};

/// A matrix with fibres.
#[derive(Debug)]
pub struct Fibre {
    matrix: Box<dyn Material>,
    direction: [f64; 3],
    k1_Pa: f64,
    k2: f64,
}

impl Fibre {
    /// `direction` in the undeformed body, any length.
    ///
    /// # Errors
    /// A zero direction; k₁ or k₂ not positive.
    pub fn new(
        matrix: Box<dyn Material>,
        direction: [f64; 3],
        k1_Pa: f64,
        k2: f64,
    ) -> Result<Self, FemError> {
        positive("k1_Pa", k1_Pa)?;
        positive("k2", k2)?;
        let length = norm(direction);
        positive("the length of the fibre direction", length)?;
        Ok(Self {
            matrix,
            direction: direction.map(|d| d / length),
            k1_Pa,
            k2,
        })
    }
}

impl Material for Fibre {
    fn respond(&self, f: &Mat3, jacobian: f64) -> Response {
        let mut response = self.matrix.respond(f, jacobian);
        let fa = apply(f, self.direction);
        let squared = fa.iter().map(|v| v * v).sum::<f64>();
        let c = jacobian.cbrt().powi(-2);
        let strain = c * squared - 1.0;
        if strain <= 0.0 {
            return response;
        }
        let grown = (self.k2 * strain * strain).exp();
        let slope = self.k1_Pa * strain * grown;
        let curvature = self.k1_Pa * grown * (1.0 + 2.0 * self.k2 * strain * strain);
        let g = cofactor(f).map(|row| row.map(|v| v / jacobian));
        let a = &self.direction;
        // Ī₄' = c (2 Fa ⊗ a − 2/3 I₄ G).
        let first: [f64; 9] = std::array::from_fn(|r| {
            let (i, j) = (r / 3, r % 3);
            c * (2.0 * fa[i] * a[j] - 2.0 / 3.0 * squared * g[i][j])
        });
        response.energy += self.k1_Pa / (2.0 * self.k2) * (grown - 1.0);
        for r in 0..9 {
            let (i, j) = (r / 3, r % 3);
            response.stress[i][j] += slope * first[r];
            for q in 0..9 {
                let (k, l) = (q / 3, q % 3);
                let mut second = -4.0 / 3.0 * (fa[i] * a[j] * g[k][l] + g[i][j] * fa[k] * a[l])
                    + 4.0 / 9.0 * squared * g[i][j] * g[k][l]
                    + 2.0 / 3.0 * squared * g[i][l] * g[k][j];
                if i == k {
                    second += 2.0 * a[j] * a[l];
                }
                response.tangent[r][q] += curvature * first[r] * first[q] + slope * c * second;
            }
        }
        response
    }

    fn shear_modulus_Pa(&self) -> f64 {
        self.matrix.shear_modulus_Pa()
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        self.matrix.bulk_modulus_Pa()
    }
}
