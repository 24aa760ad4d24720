//! Stored energies of rubber-like solids.
//!
//! W(F, p) = W_d(F) + p (J − 1) − p² / (2 κ): a distortional part per material, and
//! a pressure p that is an unknown of its own; without it, W_d + κ/2 (J − 1)².

mod choose;
mod fibre;
mod gent;
mod isotropic;
mod model;
mod mooney_rivlin;
mod neo_hookean;
mod nominal_stress;
mod ogden;
#[cfg(test)]
mod tests;
mod yeoh;

pub use choose::{choose, model};
pub use fibre::Fibre;
pub use gent::Gent;
pub use isotropic::{Derivatives, Invariants};
use model::{COMMON, Values, positive_parameters};
pub use model::{Model, Parameters, Volume};
pub use mooney_rivlin::MooneyRivlin;
pub use neo_hookean::NeoHookean;
pub(crate) use neo_hookean::distortion;
pub use nominal_stress::{TESTS, nominal_stress};
pub use ogden::Ogden;
pub use yeoh::Yeoh;

/// All material models. A new one is its file, its `mod` line above and its entry here.
pub const MODELS: &[&Model] = &[
    &neo_hookean::MODEL,
    &mooney_rivlin::MODEL,
    &yeoh::MODEL,
    &ogden::MODEL,
    &gent::MODEL,
];

use crate::FemError;
use crate::tensor::Mat3;

/// Distortional energy density with its derivatives by the deformation gradient.
#[derive(Debug, Clone, Copy)]
pub struct Response {
    /// W_d, J/m³.
    pub energy: f64,
    /// P_iJ = ∂W_d/∂F_iJ, Pa.
    pub stress: Mat3,
    /// ∂P_iJ/∂F_kL at `[3 i + J][3 k + L]`, Pa; symmetric.
    pub tangent: [[f64; 9]; 9],
}

/// A material whose distortional energy is a function of F.
pub trait Material: Send + Sync + std::fmt::Debug {
    /// W_d, its stress and its tangent; `f` has a positive determinant `jacobian`.
    fn respond(&self, f: &Mat3, jacobian: f64) -> Response;
    /// Shear modulus at rest, Pa.
    fn shear_modulus_Pa(&self) -> f64;
    /// Bulk modulus, Pa.
    fn bulk_modulus_Pa(&self) -> f64;
}

// Subnormal numbers are out: half of the smallest of them is zero.
fn positive(name: &'static str, value: f64) -> Result<(), FemError> {
    if value.is_normal() && value > 0.0 {
        return Ok(());
    }
    Err(FemError::Parameter {
        name,
        value,
        expected: "a positive number",
    })
}

/// A bulk modulus: positive; infinite keeps the volume.
fn bulk(value: f64) -> Result<(), FemError> {
    if value > 0.0 {
        return Ok(());
    }
    Err(FemError::Parameter {
        name: "bulk_modulus_Pa",
        value,
        expected: "a positive number of Pa, or infinity for poisson_ratio = 0.5",
    })
}
