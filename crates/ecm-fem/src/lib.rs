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
//! ones give 2.2 % on the same nodes. [`Formulation::ConstantPressure`] (P2/P0) errs on the
//! soft side and brackets; [`Formulation::Displacement`] is the element of peers. ν = 0.5 is
//! accepted: the residual keeps the volume exactly, the tangent takes κ = 10⁶ μ.
//!
//! # Where stability ends
//! A wrench is reported unstable for one of two reasons ([`Reason`]): the equilibrium's H
//! is not positive (buckling), or the tangent at held platform loses a positive pivot. The
//! second happens where bending compresses one side beyond the stretch ratio 1/2.4 at which
//! a neo-Hookean surface creases (Hong, Zhao and Suo 2009; it wrinkles at 0.296, Biot 1963).
//! Evidence on 500 random wrenches of the paper's Table I box (E = 0.65 MPa, standard mesh):
//! 357 solved, 143 creased, none else; the last stable states of the creased ones have ratios
//! of 0.19 to 0.40, and equilibria just beyond converge with one or two negative pivots. Loss
//! comes earlier on meshes that resolve the rim (91, 81, 78 % of one load on 1275, 1207, 2700
//! nodes), as it must for creases, which have no length of their own. A crude line search
//! on the residual changed at most one of 60 outcomes. 217 of the solved states are beyond the threshold
//! too: stable against small disturbances on their mesh, perhaps not against a large one
//! ([`CaseResult::stretch_ratio`] tells). Contact within a crease is not modelled.
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
mod at_points;
pub mod element;
mod error;
mod factor;
mod inner_pressure;
mod kernel;
mod loads;
pub mod material;
pub mod mesh;
mod ordering;
mod ordering_cost;
pub mod output;
mod pattern;
mod platform;
mod result;
mod rod;
mod solve;
pub mod tensor;

pub use assembly::Formulation;
pub use error::FemError;
pub use material::{Fibre, Gent, Material, MooneyRivlin, NeoHookean, Ogden, Response, Yeoh};
pub use mesh::{Mesh, Profile, Quality};
pub use ordering_cost::{Ordering, OrderingCost};
pub use pattern::Hold;
pub use platform::Platform;
pub use result::{CREASE, CaseResult, Reason, Status};
pub use rod::Rod;
pub use solve::{Fem, Finished, Guess, HeldResult, Load, Outcome, Settings, Timing, Watch};
