//! Fields for other programs.

mod vtu;

pub use vtu::vtu;
