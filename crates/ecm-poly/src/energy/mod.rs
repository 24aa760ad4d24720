//! Energy models U(q) in mid-frame coordinates: symmetric Hessian by construction.

pub mod invariants;
pub mod lanes;
pub mod mid_frame;
pub mod plan;
pub mod potential;

#[cfg(feature = "std")]
mod bulk;
#[cfg(feature = "std")]
pub mod fit;
#[cfg(feature = "std")]
pub mod groups;
#[cfg(feature = "std")]
pub mod model;
#[cfg(feature = "std")]
pub mod regressor;
#[cfg(feature = "std")]
pub mod tables;
#[cfg(feature = "std")]
pub mod terms;

#[cfg(feature = "std")]
pub use fit::EnergyFit;
#[cfg(feature = "std")]
pub use groups::Group;
pub use invariants::Symmetry;
pub use lanes::LanePlan;
pub use mid_frame::EnergyMap;
#[cfg(feature = "std")]
pub use model::EnergyModel;
pub use plan::EnergyPlan;
#[cfg(feature = "std")]
pub use tables::{EnergyTables, LaneTables};
