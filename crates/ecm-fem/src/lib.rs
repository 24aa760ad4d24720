//! Static finite elements for soft mechanisms between a clamped base and a rigid platform.
//!
//! Quadratic tetrahedra with an independent linear pressure (Taylor–Hood P2/P1),
//! finite strain, sparse L D Lᵀ by faer. The platform's six coordinates are
//! condensed: one factorisation serves the Newton step, the 6 × 6 stiffness and the
//! predictor, for given wrenches and given poses alike.
//!
//! # Why this element
//! (The first three figures: FElupe and CalculiX on their meshes.) Near incompressibility plain quadratic tetrahedra lock (2.4 % in the pose of the
//! reference case at 1104 nodes, 38 Newton iterations; 9 % in the stiffness at
//! ν = 0.4999), linear ones are useless (12 % to 84 %). With the pressure as an unknown
//! the volumetric residual is nearly linear: six or seven iterations from rest. Against the converged pose of the reference case (clamped cylinder,
//! rotation 0.6 rad) `Quality::Standard` (1207 nodes) errs by 0.9 % in translation and
//! 0.6 % in rotation, `Quality::Fine` (3255 nodes) by 0.4 % and 0.3 %. The four-point
//! rule changes that by 0.03 % against a fourteen-point one. How prisms are
//! split matters: diagonals that start at the clamped rim give 1.3 % where the opposite
//! ones give 2.2 % on the same nodes.
//!
//! # Where stability ends
//! A wrench is reported unstable when the equilibrium's H is not positive, and when the
//! path to it ends where the tangent at held platform loses a positive pivot: in strong
//! bending with compression a neo-Hookean body creases at the compressed rim, earlier on
//! meshes that resolve the rim.
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
