//! Energy models U(q) in mid-frame coordinates: symmetric Hessian by construction.

pub mod invariants;
pub mod plan;

#[cfg(feature = "alloc")]
pub mod actuated;
#[cfg(feature = "alloc")]
mod bulk;
#[cfg(feature = "alloc")]
mod evaluator;
#[cfg(feature = "alloc")]
pub(crate) mod expansion;
#[cfg(feature = "std")]
pub mod fit;
#[cfg(feature = "alloc")]
pub mod groups;
#[cfg(feature = "alloc")]
pub mod model;
#[cfg(feature = "alloc")]
pub mod regressor;
#[cfg(feature = "alloc")]
mod simd;
#[cfg(feature = "alloc")]
mod simd_tables;
#[cfg(feature = "alloc")]
pub mod tables;
#[cfg(feature = "alloc")]
pub mod terms;

#[cfg(feature = "alloc")]
pub use actuated::ActuatedModel;
#[cfg(feature = "std")]
pub use fit::EnergyFit;
#[cfg(feature = "alloc")]
pub use groups::Group;
pub use invariants::Symmetry;
#[cfg(feature = "alloc")]
pub use model::EnergyModel;
pub use plan::EnergyPlan;
#[cfg(feature = "alloc")]
pub use tables::EnergyTables;
#[cfg(feature = "alloc")]
pub use terms::EnergyTerms;
