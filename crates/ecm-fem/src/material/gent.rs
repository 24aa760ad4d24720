//! Gent: W_d = −μ J_m / 2 ln(1 − (Ī₁ − 3) / J_m).

use super::isotropic::{Derivatives, Invariants};
use super::{Model, bulk, positive, positive_parameters};
use crate::FemError;

/// Share of J_m from which the energy goes on as a parabola: a Newton trial may pass
/// the locking stretch, where the logarithm ends.
const LOCK: f64 = 0.99;

pub(super) const MODEL: Model = Model {
    name: "gent",
    parameters: &["shear_modulus_Pa", "j_m"],
    has_terms: false,
    make: |values, volume| {
        let mu = values.one("shear_modulus_Pa")?;
        let kappa = volume.bulk_modulus_Pa(mu);
        Ok(Box::new(Gent::new(mu, values.one("j_m")?, kappa)?))
    },
    start: |mu, _| vec![mu.ln(), 50.0_f64.ln()],
    decode: positive_parameters,
};

/// Shear modulus, locking value J_m of Ī₁ − 3, bulk modulus.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Gent {
    shear_modulus_Pa: f64,
    lock: f64,
    bulk_modulus_Pa: f64,
}

impl Gent {
    /// # Errors
    /// A parameter that is not positive.
    pub fn new(shear_modulus_Pa: f64, lock: f64, bulk_modulus_Pa: f64) -> Result<Self, FemError> {
        positive("shear_modulus_Pa", shear_modulus_Pa)?;
        positive("lock", lock)?;
        bulk(bulk_modulus_Pa)?;
        Ok(Self {
            shear_modulus_Pa,
            lock,
            bulk_modulus_Pa,
        })
    }
}

impl Invariants for Gent {
    fn derivatives(&self, i1: f64, _: f64) -> Derivatives {
        let (mu, lock) = (self.shear_modulus_Pa, self.lock);
        let x = i1 - 3.0;
        let at = x.min(LOCK * lock);
        let left = 1.0 - at / lock;
        let (energy, slope) = (-0.5 * mu * lock * left.ln(), 0.5 * mu / left);
        let curvature = 0.5 * mu / (lock * left * left);
        let past = x - at;
        Derivatives {
            energy: energy + past * (slope + 0.5 * curvature * past),
            first: [slope + curvature * past, 0.0],
            second: [curvature, 0.0, 0.0],
        }
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        self.bulk_modulus_Pa
    }
}
