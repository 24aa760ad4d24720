//! Pose-to-wrench models: polynomials with principal component regression, and symmetric
//! energies in mid-frame coordinates, both with analytic stiffness.
//!
//! Evaluation ([`polynomial`], [`energy`]) needs neither std nor allocation. The feature `alloc` reads
//! model files (JSON); fitting, many poses at once and the export need `std`.
#![no_std]

#[cfg(feature = "alloc")]
extern crate alloc;
#[cfg(feature = "std")]
extern crate std;

pub mod adapt;
pub mod arithmetic;
pub mod basis;
pub mod cubic;
pub mod energy;
pub mod normalise;
pub mod polynomial;
pub mod shape;
pub mod stepper;
#[cfg(feature = "std")]
pub mod uncertainty;

#[cfg(feature = "alloc")]
mod cubic_bulk;
#[cfg(feature = "std")]
pub mod dense;
#[cfg(feature = "alloc")]
pub mod error;
#[cfg(feature = "std")]
pub mod export;
#[cfg(feature = "alloc")]
pub mod model_file;
#[cfg(feature = "alloc")]
mod parallel;
#[cfg(feature = "alloc")]
pub mod polynomial_model;
#[cfg(feature = "alloc")]
pub mod pose_model;
#[cfg(feature = "std")]
pub mod regression;

pub use ecm_se3::{Pose, PoseError, Wrench};
#[cfg(feature = "std")]
pub use energy::EnergyFit;
#[cfg(feature = "alloc")]
pub use energy::EnergyModel;
pub use energy::Symmetry;
#[cfg(feature = "alloc")]
pub use error::{ModelError, checked_poses};
#[cfg(feature = "alloc")]
pub use model_file::{open_model, seal_model};
pub use polynomial::Polynomial;
#[cfg(feature = "alloc")]
pub use polynomial_model::PolynomialModel;
#[cfg(feature = "alloc")]
pub use pose_model::{PoseModel, PosePolynomial};
#[cfg(feature = "std")]
pub use regression::Method;
pub use shape::ShapeError;

/// The examples of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
