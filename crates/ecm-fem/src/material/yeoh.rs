//! Yeoh: W_d = C1 x + C2 x² + C3 x³ with x = Ī₁ − 3, μ = 2 C1.

use super::isotropic::{Derivatives, Invariants};
use super::{Model, bulk, positive};
use crate::FemError;

pub(super) const MODEL: Model = Model {
    name: "yeoh",
    parameters: &["c1_Pa", "c2_Pa", "c3_Pa"],
    has_terms: false,
    make: |values, volume| {
        let c = [
            values.one("c1_Pa")?,
            values.one("c2_Pa")?,
            values.one("c3_Pa")?,
        ];
        let kappa = volume.bulk_modulus_Pa(2.0 * c[0]);
        Ok(Box::new(Yeoh::new(c, kappa)?))
    },
    start: |mu, _| vec![(0.5 * mu).ln(), (1e-6 * mu).ln(), -0.1],
    // C1 = e^a, C3 = e^c, C2 = sqrt(3 C1 C3) (e^b − 1): the slope has no zero.
    decode: |x| {
        let (c1, c3) = (x[0].exp(), x[1].exp());
        vec![c1, (3.0 * c1 * c3).sqrt() * x[2].exp_m1(), c3]
    },
};

/// Three constants and a bulk modulus, Pa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Yeoh {
    c_Pa: [f64; 3],
    bulk_modulus_Pa: f64,
}

impl Yeoh {
    /// `c_Pa`: C1, C2, C3.
    ///
    /// # Errors
    /// C1 or the bulk modulus not positive; a slope C1 + 2 C2 x + 3 C3 x² that is not
    /// positive for every x ≥ 0.
    pub fn new(c_Pa: [f64; 3], bulk_modulus_Pa: f64) -> Result<Self, FemError> {
        positive("c_Pa[0]", c_Pa[0])?;
        bulk(bulk_modulus_Pa)?;
        let [a, b, c] = [c_Pa[0], 2.0 * c_Pa[1], 3.0 * c_Pa[2]];
        let expected = "such that C1 + 2 C2 x + 3 C3 x^2 > 0 for all x >= 0";
        if !(c >= 0.0 && b.is_finite()) {
            return Err(FemError::Parameter {
                name: "c_Pa[2]",
                value: c_Pa[2],
                expected,
            });
        }
        if b < 0.0 && b * b >= 4.0 * a * c {
            return Err(FemError::Parameter {
                name: "c_Pa[1]",
                value: c_Pa[1],
                expected,
            });
        }
        Ok(Self {
            c_Pa,
            bulk_modulus_Pa,
        })
    }
}

impl Invariants for Yeoh {
    fn derivatives(&self, i1: f64, _: f64) -> Derivatives {
        let (x, [c1, c2, c3]) = (i1 - 3.0, self.c_Pa);
        Derivatives {
            energy: x * (c1 + x * (c2 + x * c3)),
            first: [c1 + x * (2.0 * c2 + 3.0 * c3 * x), 0.0],
            second: [2.0 * c2 + 6.0 * c3 * x, 0.0, 0.0],
        }
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        self.bulk_modulus_Pa
    }
}
