//! Model files: readable JSON with a checksum, which refuses to open when it is damaged.
//!
//! | key | meaning |
//! |---|---|
//! | `format`, `version` | `"ecm-model"`, 1; added by [`seal_model`] where they are missing |
//! | `kind` | `polynomial`, `energy` or `physics` (an energy fitted to FEM, times a factor); any other kind, such as `rod`, holds only `parameters`, which its own reader checks |
//! | `inputs`, `outputs` | columns of the measurement table |
//! | `length_m` | undeformed length; `null` for a polynomial |
//! | `degree` | highest degree of a term |
//! | `symmetry` | energies only: `alike`, `revolution`, `general` |
//! | `groups` | energies, optional: broken symmetries ([`crate::energy::groups`]) |
//! | `normalisation` | polynomial: `lower`, `upper`; energies: `scale`, (m, rad) |
//! | `terms` | exponents, in the order of [`crate::basis`] or [`crate::energy::terms`], then of the groups |
//! | `coefficients` | polynomial: (k, outputs); energies: (k), J |
//! | `covariance` | square and symmetric, or `null` |
//! | `noise`, `effects`, `domain`, `training` | any JSON; `null` where missing when sealed |
//! | `sha256` | checksum of all other keys in the form of [`canonical`] |
//!
//! Any other key is kept unchanged and is part of the checksum.

pub mod canonical;
mod check;
mod layout;
pub mod map;
pub mod opened;
mod unique;

use alloc::string::{String, ToString};

use serde_json::{Map, Value};

use crate::error::ModelError;
use crate::model_file::unique::Unique;

/// Version of the format that this crate writes and reads.
pub const VERSION: u64 = 1;
/// Value of `format`.
pub const FORMAT: &str = "ecm-model";

const MAY_BE_MISSING: [&str; 5] = ["covariance", "noise", "effects", "domain", "training"];

/// Checks a model document (JSON text), formats it and adds its checksum, replacing an existing one.
///
/// # Errors
/// Text that is not JSON, or a key that is missing or out of range.
pub fn seal_model(document: &str) -> Result<String, ModelError> {
    let mut map = parse(document)?;
    map.remove("sha256");
    let mut add = |key: &str, value: Value| {
        map.entry(key).or_insert(value);
    };
    add("format", Value::from(FORMAT));
    add("version", Value::from(VERSION));
    for key in MAY_BE_MISSING {
        add(key, Value::Null);
    }
    check::document(&map)?;
    map.insert("sha256".to_string(), Value::from(canonical::sha256(&map)));
    Ok(layout::text(&map))
}

/// Opens a model file: its document, after a check of checksum, version, keys and tables.
///
/// # Errors
/// Text that is not JSON, a wrong checksum, or a key that is missing or out of range.
pub fn open_model(text: &str) -> Result<Map<String, Value>, ModelError> {
    let mut map = parse(text)?;
    check::head(&map)?;
    let stated = check::text(&map, "sha256", "64 hexadecimal digits")?.to_string();
    map.remove("sha256");
    let sum = canonical::sha256(&map);
    if stated != sum {
        return Err(ModelError::Sum {
            found: stated,
            expected: sum,
        });
    }
    check::document(&map)?;
    map.insert("sha256".to_string(), Value::from(stated));
    Ok(map)
}

fn parse(text: &str) -> Result<Map<String, Value>, ModelError> {
    let Unique(value) = serde_json::from_str(text).map_err(|error| ModelError::Json {
        key: last_key(text, error.line(), error.column()),
        message: error.to_string(),
    })?;
    match value {
        Value::Object(map) => Ok(map),
        other => Err(ModelError::Key {
            key: "format".to_string(),
            found: alloc::format!("missing: the file holds {}", check::short(&other)),
            expected: "an object with the keys of a model file".to_string(),
        }),
    }
}

/// The last complete `"key":` before a place in a text; the whole document's name otherwise.
fn last_key(text: &str, line: usize, column: usize) -> String {
    let before: usize = text
        .split_inclusive('\n')
        .take(line.saturating_sub(1))
        .map(str::len)
        .sum();
    let end = (before + column).min(text.len());
    let bytes = &text.as_bytes()[..end];
    let mut key = None;
    let mut start = None;
    let mut candidate = None;
    let mut escaped = false;
    for (place, &byte) in bytes.iter().enumerate() {
        match (start, byte) {
            (Some(_), _) if escaped => escaped = false,
            (Some(_), b'\\') => escaped = true,
            (Some(from), b'"') => {
                candidate = text.get(from..place);
                start = None;
            }
            (Some(_), _) => {}
            (None, b'"') => start = Some(place + 1),
            (None, b':') => key = candidate.take().or(key),
            _ => {}
        }
    }
    key.unwrap_or("(top)").to_string()
}
