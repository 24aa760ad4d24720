//! The model that is exported, and its name.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use crate::error::ModelError;
use crate::model_file::map::{POSE, WRENCH};
pub use crate::model_file::opened::Model;
use crate::stepper::Effects;

/// Checks a name that is valid in C and Rust: lower case, digits and `_`, a letter first.
pub fn identifier(name: &str) -> Result<String, ModelError> {
    let legal = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let starts = name.starts_with(|c: char| c.is_ascii_lowercase());
    if starts && name.len() <= 40 && name.chars().all(legal) {
        return Ok(name.to_string());
    }
    Err(ModelError::Setting {
        name: "name",
        found: format!("{name:?}"),
        expected: "a lower-case letter, then at most 39 of a-z, 0-9 and _",
    })
}

/// Where a model's columns lie among the six of a pose and of a wrench.
pub(super) struct Places {
    pub inputs: Vec<usize>,
    pub outputs: Vec<usize>,
}

impl Places {
    /// # Errors
    /// Names, with commas between, that are none of a pose or a wrench.
    pub fn new(inputs: &str, outputs: &str) -> Result<Self, ModelError> {
        let places = |names: &str, all: [&str; 6]| {
            let found = names
                .split(", ")
                .map(|name| all.iter().position(|x| *x == name));
            found
                .collect::<Option<Vec<usize>>>()
                .ok_or(ModelError::Setting {
                    name: "columns",
                    found: names.to_string(),
                    expected: "columns of a pose and a wrench beside effects of time",
                })
        };
        Ok(Self {
            inputs: places(inputs, POSE)?,
            outputs: places(outputs, WRENCH)?,
        })
    }

    /// The numbers at the inputs.
    pub fn of_inputs<T: Copy>(&self, all: &[T; 6]) -> Vec<T> {
        self.inputs.iter().map(|&j| all[j]).collect()
    }

    /// The numbers at the outputs.
    pub fn of_outputs<T: Copy>(&self, all: &[T; 6]) -> Vec<T> {
        self.outputs.iter().map(|&i| all[i]).collect()
    }

    /// The rows at the outputs, each with the numbers at the inputs.
    pub fn of_matrix<T: Copy>(&self, all: &[[T; 6]; 6]) -> Vec<Vec<T>> {
        self.outputs
            .iter()
            .map(|&i| self.of_inputs(&all[i]))
            .collect()
    }
}

/// Checks that effects have steps beside a model; `whole`: beside a polynomial of all columns too.
pub(super) fn steps_of_columns(
    model: &Model,
    effects: Option<&Effects<f64>>,
    whole: bool,
) -> Result<(), ModelError> {
    let Some(effects) = effects else {
        return Ok(());
    };
    let found = match model {
        Model::Energy(_) if effects.columns.is_none() => return Ok(()),
        Model::Polynomial(_) if effects.columns.is_some() || whole => return Ok(()),
        Model::Actuated(_) => "a model with actuators and effects of time",
        Model::Energy(_) => "an energy with effects of single columns",
        Model::Polynomial(_) => "a polynomial with effects of time",
    };
    Err(ModelError::Setting {
        name: "model",
        found: found.to_string(),
        expected: "an energy, or a polynomial with effects of its columns: fit one, or remove the effects",
    })
}

/// Names of the columns in a document's list, with commas between, for comments of the code.
///
/// # Errors
/// A name of other characters than letters, digits and `_`: it could end the comment.
pub(super) fn columns(
    document: &Map<String, Value>,
    key: &'static str,
) -> Result<String, ModelError> {
    let list = document.get(key).and_then(Value::as_array);
    let names: Vec<&str> = list
        .into_iter()
        .flatten()
        .filter_map(Value::as_str)
        .collect();
    let legal = |c: char| c.is_ascii_alphanumeric() || c == '_';
    match names.iter().find(|name| !name.chars().all(legal)) {
        None => Ok(names.join(", ")),
        Some(name) => Err(ModelError::Setting {
            name: key,
            found: format!("{name:?}"),
            expected: "column names of letters, digits and _: rename the column and fit again",
        }),
    }
}
