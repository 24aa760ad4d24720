//! Errors of numbers that are no pose or no rotation.

use core::fmt;

use crate::linear::{Mat3, Vec3};

/// Six numbers that are no pose.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum PoseError {
    /// A number that is NaN or infinite.
    NotFinite {
        /// Its place, 0 to 5.
        component: usize,
        /// NaN or an infinity.
        value: f64,
    },
    /// A rotation vector longer than π.
    BeyondPi {
        /// The rotation vector (rad).
        rotation_vector: Vec3<f64>,
    },
}

impl fmt::Display for PoseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotFinite { component, value } => write!(
                f,
                "number {component} of the pose is {value}, expected a finite number"
            ),
            Self::BeyondPi {
                rotation_vector: [x, y, z],
            } => write!(
                f,
                "the rotation vector ({x}, {y}, {z}) rad is longer than pi: give the rotation in radians, \
                 the shorter way round"
            ),
        }
    }
}

impl core::error::Error for PoseError {}

/// A 3 x 3 matrix that is no rotation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RotationError {
    /// The matrix.
    pub matrix: Mat3<f64>,
    /// Its determinant; 1 for a rotation, -1 for a reflection.
    pub determinant: f64,
    /// Largest entry of RᵀR - I in size.
    pub deviation: f64,
}

impl fmt::Display for RotationError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "the matrix is no rotation: its determinant is {}, expected 1, and R'R differs from the unit matrix \
             by {}, expected at most 0.001; check the order and the signs of its axes",
            self.determinant, self.deviation
        )
    }
}

impl core::error::Error for RotationError {}
