//! The criteria of a design, one file each; their settings and the search that they share.

pub mod alphabetic;
pub mod maximin;
pub mod minimax;
pub(crate) mod registry;
pub(crate) mod search;
pub mod settings;
