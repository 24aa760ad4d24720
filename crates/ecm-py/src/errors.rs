//! One Python exception per error enum of the crates, all under `EcmError`.

use pyo3::create_exception;
use pyo3::exceptions::PyException;
use pyo3::prelude::*;

create_exception!(
    ecm._native,
    EcmError,
    PyException,
    "Any error of the package."
);
create_exception!(
    ecm._native,
    FemError,
    EcmError,
    "Wrong mesh, material or load."
);
create_exception!(
    ecm._native,
    ModelError,
    EcmError,
    "Wrong data for a model, or a damaged model file."
);
create_exception!(
    ecm._native,
    DesignError,
    EcmError,
    "Wrong candidates or settings of a design."
);

pub(crate) fn fem_error(error: ecm_fem::FemError) -> PyErr {
    FemError::new_err(error.to_string())
}
