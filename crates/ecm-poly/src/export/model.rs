//! The model that is exported, and its name.

use std::format;
use std::string::{String, ToString};

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
