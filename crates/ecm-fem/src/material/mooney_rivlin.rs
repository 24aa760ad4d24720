//! Mooney–Rivlin: W_d = C10 (Ī₁ − 3) + C01 (Ī₂ − 3), μ = 2 (C10 + C01).

use super::isotropic::{Derivatives, Invariants};
use super::{Model, bulk, positive, positive_parameters};
use crate::FemError;

pub(super) const MODEL: Model = Model {
    name: "mooney_rivlin",
    parameters: &["c10_Pa", "c01_Pa"],
    has_terms: false,
    make: |values, volume| {
        let (c10, c01) = (values.one("c10_Pa")?, values.one("c01_Pa")?);
        let kappa = volume.bulk_modulus_Pa(2.0 * (c10 + c01));
        Ok(Box::new(MooneyRivlin::new(c10, c01, kappa)?))
    },
    start: |mu, _| vec![(0.4 * mu).ln(), (0.1 * mu).ln()],
    decode: positive_parameters,
};

/// Two constants and a bulk modulus, Pa.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MooneyRivlin {
    c10_Pa: f64,
    c01_Pa: f64,
    bulk_modulus_Pa: f64,
}

impl MooneyRivlin {
    /// # Errors
    /// C10 + C01 or the bulk modulus not positive, C01 negative.
    pub fn new(c10_Pa: f64, c01_Pa: f64, bulk_modulus_Pa: f64) -> Result<Self, FemError> {
        positive("c10_Pa + c01_Pa", c10_Pa + c01_Pa)?;
        bulk(bulk_modulus_Pa)?;
        if c01_Pa.is_nan() || c01_Pa < 0.0 {
            let expected = "at least 0: a negative one loses stability in compression";
            return Err(FemError::Parameter {
                name: "c01_Pa",
                value: c01_Pa,
                expected,
            });
        }
        Ok(Self {
            c10_Pa,
            c01_Pa,
            bulk_modulus_Pa,
        })
    }
}

impl Invariants for MooneyRivlin {
    fn derivatives(&self, i1: f64, i2: f64) -> Derivatives {
        Derivatives {
            energy: self.c10_Pa * (i1 - 3.0) + self.c01_Pa * (i2 - 3.0),
            first: [self.c10_Pa, self.c01_Pa],
            second: [0.0; 3],
        }
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        self.bulk_modulus_Pa
    }
}
