//! The ten-node tetrahedron with a linear pressure, and its quadrature.

pub(crate) mod matrix;
mod quadrature;
pub mod tet10;

pub use quadrature::Rule;
