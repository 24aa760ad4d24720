//! The model that is exported, and its name.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use crate::error::ModelError;
pub use crate::model_file::opened::Model;

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
