//! Model files, and models as source code.

use ecm_poly::export::{Precision, adapt as adapter, c, rust};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use super::adapter::settings_of;
use super::error;
use super::stepper::effects_of;
use crate::errors::ModelError;

/// A model document (JSON text) checked, and sealed with its sha256.
#[pyfunction]
pub fn seal_model(document: &str) -> PyResult<String> {
    ecm_poly::seal_model(document).map_err(error)
}

/// The document of a model file; ModelError when its sum, version, kind or a range is wrong.
#[pyfunction]
pub fn open_model<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    ecm_poly::open_model(text).map_err(error)?;
    parsed(py, text)
}

/// JSON as Python objects, by Python's own reader.
pub(super) fn parsed<'py>(py: Python<'py>, text: &str) -> PyResult<Bound<'py, PyDict>> {
    let document = py.import("json")?.call_method1("loads", (text,))?;
    Ok(document.cast_into::<PyDict>()?)
}

/// Source files, by path, of a model file's map: C with golden vectors, or a const Rust crate.
///
/// effects: JSON of effects of time (`Effects::from_document`), exported as steps with a state.
/// adapt: JSON of all parameters that follow readings (`Adapter::from_document`).
#[pyfunction]
#[pyo3(signature = (text, name, *, target, precision = "double", effects = None, adapt = None))]
pub fn export_model<'py>(
    py: Python<'py>,
    text: &str,
    name: &str,
    target: &str,
    precision: &str,
    effects: Option<&str>,
    adapt: Option<&str>,
) -> PyResult<Bound<'py, PyDict>> {
    let precision = match precision {
        "double" => Precision::Double,
        "single" => Precision::Single,
        _ => {
            return Err(ModelError::new_err(format!(
                "precision is {precision:?}, expected double or single"
            )));
        }
    };
    let document = ecm_poly::open_model(text).map_err(error)?;
    let effects = effects.map(effects_of).transpose()?;
    let effects = effects.as_ref();
    let adapt = adapt.map(settings_of).transpose()?;
    let files = match target {
        "c" => c::export_with_effects(&document, name, precision, effects),
        "rust" => rust::export_with_effects(&document, name, precision, effects),
        _ => {
            return Err(ModelError::new_err(format!(
                "target is {target:?}, expected c or rust"
            )));
        }
    };
    let mut files = files.map_err(error)?;
    if let Some(settings) = &adapt {
        if target == "c" {
            let more = adapter::c(&document, name, precision, settings);
            files.extend(more.map_err(error)?);
        } else {
            files = adapter::rust(files, &document, name, precision, settings).map_err(error)?;
        }
    }
    let paths = PyDict::new(py);
    for file in files {
        paths.set_item(file.path, file.text)?;
    }
    Ok(paths)
}
