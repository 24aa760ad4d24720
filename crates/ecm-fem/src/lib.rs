//! Static finite elements for soft mechanisms between a clamped base and a rigid platform.
//!
//! Quadratic tetrahedra with an independent linear pressure (Taylor–Hood P2/P1),
//! finite strain, sparse L D Lᵀ by faer. The platform's six coordinates are
//! condensed: one factorisation serves the Newton step, the 6 × 6 stiffness and the
//! predictor, for given wrenches and given poses alike.
//!
//! ```
//! use ecm_fem::{Fem, Mesh, NeoHookean, Quality, Status};
//! # fn main() -> Result<(), ecm_fem::FemError> {
//! let mesh = Mesh::cylinder(0.1034, 0.033, Quality::Standard)?;
//! let fem = Fem::new(mesh, Box::new(NeoHookean::new(0.72e6, 0.49)?), None)?;
//! let result = fem.solve_wrench(&[-40.0, 30.0, 20.0, 1.0, -1.0, 1.0])?;
//! assert_eq!(result.status, Status::Solved);
//! # Ok(()) }
//! ```
// Units stand in names: shear_modulus_Pa, energy_J.
#![allow(non_snake_case)]

pub mod assembly;
pub mod element;
mod error;
mod factor;
pub mod material;
pub mod mesh;
mod ordering;
pub mod output;
mod pattern;
mod platform;
mod result;
mod rod;
mod solve;
pub mod tensor;

pub use error::FemError;
pub use material::{Fibre, Gent, Material, MooneyRivlin, NeoHookean, Ogden, Response, Yeoh};
pub use mesh::{Mesh, Profile, Quality};
pub use platform::Platform;
pub use result::{CaseResult, Status};
pub use rod::Rod;
pub use solve::{Fem, Load, Settings, Timing, Watch};
