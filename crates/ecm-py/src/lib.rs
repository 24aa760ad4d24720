//! Python bindings of the ECM crates. This crate converts arguments and results only.
//!
//! One file or folder per bound crate, [`py_task`] for long work (GIL, Ctrl-C, progress, errors) and
//! [`arrays`] for array conversions.

mod arrays;
mod doe;
mod errors;
mod fem;
mod material;
mod poly;
mod py_task;
mod se3;
mod threads;

use pyo3::prelude::*;

/// The Rust core of `ecm`.
#[pymodule]
mod _native {
    #[pymodule_export]
    use crate::doe::{
        DesignResult, criteria, d_optimal, diagnosable_visits, maximin, outer_poses, repeated_rows,
        row_list, rows_inside,
    };

    #[pymodule_export]
    use crate::errors::{DesignError, EcmError, FemError, ModelError};

    #[pymodule_export]
    use crate::fem::{Fem, FemResults, Mesh, WarmStart, rod_poses, rod_wrenches};

    #[pymodule_export]
    use crate::material::{
        material_decode, material_models, material_moduli, material_start, material_stress,
    };

    #[pymodule_export]
    use crate::poly::{
        Adapter, EnergyEvaluator, PolynomialEvaluator, Stepper, export_model, merged_triangle,
        open_model, polynomial_exponents, polynomial_regressor, seal_model,
    };

    #[pymodule_export]
    use crate::se3::{
        check_rotations, convert_stiffness, inverse_left_jacobians, left_jacobians, mid_frame,
        rotation_matrices, rotation_vectors,
    };

    #[pymodule_export]
    #[allow(non_upper_case_globals)]
    const __version__: &str = env!("CARGO_PKG_VERSION");

    /// Rests before a reading in a diagnosable campaign (s): relaxation shows in their difference.
    #[pymodule_export]
    const DWELLS_S: [f64; 3] = ecm_doe::DWELLS_S;
}
