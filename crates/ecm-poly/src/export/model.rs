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

/// Names of the columns in a document's list, with commas between.
pub(super) fn columns(document: &Map<String, Value>, key: &str) -> String {
    let list = document.get(key).and_then(Value::as_array);
    let names = list.into_iter().flatten().filter_map(Value::as_str);
    names.collect::<Vec<_>>().join(", ")
}
