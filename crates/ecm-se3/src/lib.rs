//! Poses, wrenches and mid-frame coordinates on SE(3), without std, allocation or libm.
//!
//! Conventions: a pose is (r, θ), the position of the top frame's origin in the base
//! frame and the rotation vector of the top frame's orientation, `R = exp([θ]×)`. A wrench
//! is (f, τ) at the top frame's origin, in base axes. Virtual work is f·δr + τ·δφ with
//! δφ = J(θ) δθ, so the generalised force to θ is J(θ)ᵀ τ.
//!
//! Sines and cosines enter only through the entire functions of |θ|² of [`stumpff`]; they
//! are accurate to 1e-14 up to |θ| = π, and NaN beyond |θ| = 4. Only the logarithm needs `std`.
#![no_std]

#[cfg(feature = "std")]
extern crate std;

pub mod error;
pub mod jacobian;
pub mod linear;
#[cfg(feature = "std")]
pub mod logarithm;
pub mod mid_frame;
pub mod pose;
pub mod real;
pub mod rotation;
#[cfg(feature = "std")]
pub mod source;
pub mod stiffness;
pub mod stumpff;

pub use error::{PoseError, RotationError};
pub use jacobian::{
    left_jacobian, left_jacobian_derivatives, left_jacobian_inverse, torque_derivative,
};
pub use linear::{Mat3, Mat6, Vec3, Vec6};
#[cfg(feature = "std")]
pub use logarithm::rotation_vector;
pub use pose::{Pose, Wrench};
pub use real::Real;
pub use rotation::{RotationForm, half_rotation, rotation_matrix};
pub use stumpff::Stumpff;

/// The examples of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
