//! Energy models U(q) in mid-frame coordinates: symmetric Hessian by construction.

pub mod invariants;
pub mod plan;

#[cfg(feature = "binary")]
pub mod binary;
#[cfg(feature = "std")]
mod bulk;
#[cfg(feature = "std")]
mod evaluator;
#[cfg(feature = "std")]
mod expansion;
#[cfg(feature = "std")]
pub mod fit;
#[cfg(feature = "std")]
pub mod groups;
#[cfg(feature = "std")]
pub mod model;
#[cfg(feature = "std")]
pub mod regressor;
#[cfg(feature = "std")]
mod simd;
#[cfg(feature = "std")]
mod simd_tables;
#[cfg(feature = "alloc")]
pub mod tables;
#[cfg(feature = "std")]
pub mod terms;

#[cfg(feature = "std")]
pub use fit::EnergyFit;
#[cfg(feature = "std")]
pub use groups::Group;
pub use invariants::Symmetry;
#[cfg(feature = "std")]
pub use model::EnergyModel;
pub use plan::EnergyPlan;
#[cfg(feature = "alloc")]
pub use tables::EnergyTables;
#[cfg(feature = "std")]
pub use terms::EnergyTerms;
