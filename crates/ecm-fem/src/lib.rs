//! Static finite elements for soft mechanisms between a clamped base and a rigid platform.
//!
//! Quadratic tetrahedra with an independent linear pressure (Taylor–Hood P2/P1),
//! finite strain, sparse L D Lᵀ by faer. The platform's six coordinates are
//! condensed: one factorisation serves the Newton step, the 6 × 6 stiffness and the
//! predictor, for given wrenches and for given poses.
//!
//! # Why this element
//! (The first three figures: FElupe and CalculiX on their meshes.) Near incompressibility plain
//! quadratic tetrahedra lock (2.4 % in the pose of the reference case at 1104 nodes, 38 Newton
//! iterations; 9 % in the stiffness at ν = 0.4999), and linear ones are useless (12 % to 84 %).
//! With the pressure as an unknown the volumetric residual is nearly linear: six or seven
//! iterations from rest. Against the converged pose of the reference case (clamped cylinder,
//! rotation 0.6 rad) `Quality::Standard` (1207 nodes) errs by 0.94 % in translation and 0.65 % in
//! rotation, `Quality::Fine` (3255 nodes) by 0.46 % and 0.31 %. The four-point rule changes that
//! by 0.03 % against a fourteen-point one. The split of prisms into tetrahedra matters: diagonals
//! that start at the clamped rim give an error of 1.3 %, the opposite ones 2.2 % on the same nodes.
//! [`Formulation::ConstantPressure`] (P2/P0) errs on the soft side, so that both bracket the
//! solution; [`Formulation::Displacement`] is the element of other programs. ν = 0.5 is accepted:
//! the residual preserves the volume exactly, the tangent takes κ = 10⁶ μ.
//!
//! # Where stability ends
//! A wrench is reported unstable where a stable and an unstable equilibrium lie one step apart on
//! the branch from rest ([`Reason`]): the stiffness K_s of a dead wrench is lost (buckling), or the
//! tangent at fixed platform loses a positive pivot, shortly before which K_s is lost as well. The
//! second is physical where a side is
//! compressed below a stretch of 0.544: down to it a neo-Hookean surface is stable against small
//! disturbances (Biot 1963). From 0.65 on the surface creases under large disturbances (Hong, Zhao
//! and Suo 2009; see [`CaseResult::smallest_stretch`]). Plain Taylor–Hood elements lose stability
//! much earlier, which is an error of the element: the module `pressure_stabilisation` has the
//! remedy and its evidence. Contact within a crease is not modelled.
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

mod assembly;
mod body;
mod chamber;
mod condensed_pressure;
pub mod element;
mod error;
mod factor;
mod loads;
pub mod material;
pub mod mesh;
mod ordering;
mod ordering_cost;
pub mod output;
mod pattern;
mod platform;
mod pressure_stabilisation;
mod result;
mod rod;
mod rod_inverse;
mod solve;
mod stress;
mod tendon;
pub mod tensor;
mod winding;

pub use body::{Body, Field, Formulation};
pub use error::FemError;
pub use material::{Fibre, Gent, Material, MooneyRivlin, NeoHookean, Ogden, Response, Yeoh};
pub use mesh::{
    BODY, ChamberShape, Chambered, Laid, Mesh, OUTSIDE, Profile, Quality, Tendon, Winding,
};
pub use ordering_cost::{Ordering, OrderingCost};
pub use pattern::Constraint;
pub use result::{Actuator, CREASE, CaseResult, Reason, Status};
pub use rod::Rod;
pub use rod_inverse::WrenchAndCompliance;
pub use solve::{
    Case, Fem, Finished, Load, MOST_ACTUATORS, Outcome, PrescribedResult, Settings, Timing,
    WarmStart, Watch,
};

/// The examples of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
