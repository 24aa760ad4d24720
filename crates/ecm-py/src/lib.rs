//! Python bindings of the ECM crates: this crate converts, it computes nothing.
//!
//! One file per crate it wraps, [`door`] for long work (GIL, Ctrl-C, progress, errors)
//! and [`arrays`] for array conversions.

mod arrays;
mod door;
mod errors;

use pyo3::prelude::*;

/// The Rust core of `ecm`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::errors::{DesignError, EcmError, FemError, ModelError};

    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
