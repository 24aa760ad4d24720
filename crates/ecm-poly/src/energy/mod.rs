//! Energy models U(q) in mid-frame coordinates: symmetric Hessian by construction.

pub mod invariants;
pub mod mid_frame;
pub mod plan;
pub mod potential;
pub mod simd;

#[cfg(feature = "std")]
mod bulk;
#[cfg(feature = "std")]
pub mod fit;
#[cfg(feature = "alloc")]
pub mod groups;
#[cfg(feature = "std")]
pub mod model;
#[cfg(feature = "std")]
pub mod regressor;
#[cfg(feature = "alloc")]
pub mod tables;
#[cfg(feature = "alloc")]
pub mod terms;

#[cfg(feature = "std")]
pub use fit::EnergyFit;
#[cfg(feature = "alloc")]
pub use groups::Group;
pub use invariants::Symmetry;
pub use mid_frame::EnergyMap;
#[cfg(feature = "std")]
pub use model::EnergyModel;
pub use plan::EnergyPlan;
pub use simd::SimdPlan;
#[cfg(feature = "alloc")]
pub use tables::{EnergyTables, SimdTables};
