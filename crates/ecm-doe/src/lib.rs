//! Designs of informative poses: which of many candidates to measure, and how good that is.
//!
//! - [`d_optimal`]: the poses with the largest log det of the information matrix, by
//!   Fedorov's exchange (the paper's), by the row-wise exchange, or by a search that starts
//!   from the continuous optimum; with the certified bound of [`certificate`].
//! - [`i_optimal`], [`a_optimal`]: the smallest average variance of the prediction over the
//!   candidates, or of the coefficients, with a certified lower bound.
//! - [`g_optimal`]: the smallest largest variance; [`compound_optimal`]: D and I together.
//! - [`maximin`]: the points with the largest smallest distance, by the paper's exchange or by a
//!   threshold search; with an upper bound from clique covers.
//! - [`Table`]: candidates from a CSV file; [`plan()`]: the chosen ones in visiting order, in the
//!   [`Protocol`] of a campaign.
//!
//! The same seed and budget give the same design on any number of threads.
//!
//! Four of the 21 points of a line that determine a quadratic best: both ends and the middle, one of
//! them twice.
//!
//! ```
//! use ecm_doe::{Control, DSettings, d_optimal};
//! # fn main() -> Result<(), ecm_doe::DesignError> {
//! let x = (0..21).map(|i| f64::from(i) / 10.0 - 1.0);
//! let regressor: Vec<f64> = x.flat_map(|x| [1.0, x, x * x]).collect();
//! let settings = DSettings { n: 4, replicates: true, ..DSettings::default() };
//! let design = d_optimal(&regressor, 1, 3, &settings, &Control::new())?;
//! assert!(design.indices.iter().all(|i| [0, 10, 20].contains(i)));
//! assert!(design.efficiency > 0.9);
//! # Ok(()) }
//! ```

mod budget;
pub mod certificate;
mod criterion;
mod error;
mod exchange;
mod linalg;
mod lists;
mod plan;
mod problem;
pub mod regressor;
mod spacing;
mod table;
mod visits;

pub use budget::{Control, ProgressFn, Status};
pub use criterion::alphabetic::{a_optimal, compound_optimal, d_optimal, i_optimal};
pub use criterion::maximin::{MaximinSettings, SpacingMethod, maximin};
pub use criterion::minimax::g_optimal;
pub use criterion::registry::{CRITERIA, Candidates, Criterion};
pub use criterion::settings::{DSettings, Design, Method};
pub use error::DesignError;
pub use exchange::InformationMatrix;
pub use lists::{repeated_rows, row_list, rows_inside};
pub use plan::{Protocol, plan};
pub use problem::Problem;
pub use table::{Columns, Table};
pub use visits::{
    DWELLS_S, Kind, Visit, diagnosable_visits, nearest_to_rest, outer_poses, rest_x_m,
};

/// The examples of the README.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
