//! Designs of informative poses: which of many candidates to measure, and how good that is.
//!
//! - [`d_optimal`]: the subset with the largest log det of the information matrix, by
//!   Fedorov's exchange (the paper's), by the row-wise exchange, or by a search that starts
//!   from the continuous optimum; with the certified bound of [`certificate`].
//! - [`i_optimal`], [`a_optimal`]: the smallest average variance of the prediction over the
//!   candidates, or of the coefficients, with a certified lower bound.
//! - [`g_optimal`]: the smallest largest variance; [`compound_optimal`]: D and I together.
//! - [`maximin`]: the subset with the largest smallest distance, by the paper's exchange or by
//!   a threshold search; with an upper bound from clique covers.
//!
//! The same seed and budget give the same design on any number of threads.

mod budget;
pub mod certificate;
pub mod criterion;
mod error;
mod exchange;
mod linalg;
mod problem;
pub mod regressor;
mod spacing;

pub use budget::{Control, ProgressFn, Status};
pub use criterion::d::d_optimal;
pub use criterion::linear::{a_optimal, compound_optimal, i_optimal};
pub use criterion::maximin::{MaximinSettings, SpacingMethod, maximin};
pub use criterion::minimax::g_optimal;
pub use criterion::settings::{DSettings, Design, Method};
pub use error::DesignError;
pub use exchange::InformationMatrix;
pub use problem::Problem;
