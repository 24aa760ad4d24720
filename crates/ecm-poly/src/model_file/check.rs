//! Checks that a model document has the keys that its kind needs, with valid values.

use alloc::format;
use alloc::string::{String, ToString};
use alloc::vec::Vec;

use serde_json::{Map, Value};

use crate::basis::exponents;
use crate::energy::groups::{Group, GroupTerm, group_terms};
use crate::energy::invariants::Symmetry;
use crate::energy::terms::terms;
use crate::error::ModelError;
use crate::model_file::map::{POSE, WRENCH};
use crate::model_file::{FORMAT, VERSION};

type Document = Map<String, Value>;

/// Checks format and version.
pub fn head(map: &Document) -> Result<(), ModelError> {
    let format = text(map, "format", "\"ecm-model\"")?;
    if format != FORMAT {
        return Err(wrong("format", map.get("format"), "\"ecm-model\""));
    }
    if get(map, "version", "1")?.as_u64() != Some(VERSION) {
        return Err(wrong(
            "version",
            map.get("version"),
            "1, the only version that this program reads: fit the model again, or use the program that wrote it",
        ));
    }
    Ok(())
}

/// Checks everything but the checksum.
pub fn document(map: &Document) -> Result<(), ModelError> {
    head(map)?;
    let inputs = names(map, "inputs")?;
    let outputs = names(map, "outputs")?;
    for key in ["noise", "effects", "domain", "training"] {
        get(map, key, "any JSON, or null")?;
    }
    match text(map, "kind", "polynomial, energy or physics")? {
        "polynomial" => polynomial(map, inputs.len(), outputs.len())?,
        "energy" | "physics" => {
            for (key, found, expected) in [("inputs", inputs, POSE), ("outputs", outputs, WRENCH)] {
                if found != expected {
                    let six = expected.join(", ");
                    return Err(wrong(key, map.get(key), &format!("[{six}]")));
                }
            }
            energy(map)?;
        }
        // A kind that this crate does not evaluate: its reader checks what stands inside.
        _ => {
            inside(map, "parameters")?;
        }
    }
    covariance(get(map, "covariance", "a square matrix, or null")?)
}

fn polynomial(map: &Document, inputs: usize, outputs: usize) -> Result<(), ModelError> {
    let expected = "a length above 0, or null";
    let length = get(map, "length_m", expected)?;
    if !length.is_null() && !length.as_f64().is_some_and(|l| l > 0.0) {
        return Err(wrong("length_m", Some(length), expected));
    }
    let degree = degree(map, 20)?;
    let table = exponents(inputs, degree)
        .map_err(|error| wrong("degree", map.get("degree"), &error.to_string()))?;
    let rows: Vec<Vec<u8>> = table.chunks_exact(inputs).map(<[u8]>::to_vec).collect();
    term_table(map, &rows)?;
    let normalisation = inside(map, "normalisation")?;
    let lower = numbers(normalisation, "normalisation.lower", "lower", inputs)?;
    let upper = numbers(normalisation, "normalisation.upper", "upper", inputs)?;
    if let Some(i) = (0..inputs).find(|&i| lower[i] > upper[i]) {
        return Err(wrong(
            "normalisation.lower",
            Some(&Value::from(lower[i])),
            &format!("at most normalisation.upper, {}, at place {i}", upper[i]),
        ));
    }
    let expected = format!("{} rows of {outputs} numbers", rows.len());
    let coefficients = array(map, "coefficients", &expected)?;
    if coefficients.len() != rows.len() {
        return Err(count("coefficients", coefficients.len(), "rows", &expected));
    }
    for (i, row) in coefficients.iter().enumerate() {
        number_list(&format!("coefficients[{i}]"), Some(row), outputs)?;
    }
    Ok(())
}

fn energy(map: &Document) -> Result<(), ModelError> {
    let expected = "the mechanism's length in m, above 0";
    let length = get(map, "length_m", expected)?;
    if !length.as_f64().is_some_and(|l| l > 0.0) {
        return Err(wrong("length_m", Some(length), expected));
    }
    let expected = "alike, revolution or general";
    let Some(symmetry) = Symmetry::from_name(text(map, "symmetry", expected)?) else {
        return Err(wrong("symmetry", map.get("symmetry"), expected));
    };
    let degree = degree(map, 8)?;
    let rows = terms(symmetry, degree)
        .map_err(|error| wrong("degree", map.get("degree"), &error.to_string()))?;
    let mut rows: Vec<Vec<u8>> = rows.iter().map(|row| row.to_vec()).collect();
    if map.contains_key("groups") {
        let list = array(map, "groups", "a list of names of groups")?;
        let names: Vec<&str> = list.iter().filter_map(Value::as_str).collect();
        let groups = Group::from_names(&names, symmetry)
            .map_err(|error| wrong("groups", map.get("groups"), &error.to_string()))?;
        if groups.len() != list.len() {
            let expected = "names of groups, each once";
            return Err(wrong("groups", map.get("groups"), expected));
        }
        rows.extend(group_terms(&groups, degree).iter().map(GroupTerm::row));
    }
    term_table(map, &rows)?;
    let normalisation = inside(map, "normalisation")?;
    let scale = numbers(normalisation, "normalisation.scale", "scale", 2)?;
    if scale.iter().any(|&s| s <= 0.0) {
        return Err(wrong(
            "normalisation.scale",
            normalisation.get("scale"),
            "a length in m and an angle in rad, both above 0",
        ));
    }
    number_list("coefficients", map.get("coefficients"), rows.len())?;
    Ok(())
}

fn degree(map: &Document, limit: u64) -> Result<usize, ModelError> {
    let expected = format!("an integer from 0 to {limit}");
    let value = get(map, "degree", &expected)?;
    match value.as_u64() {
        Some(degree) if degree <= limit => Ok(degree as usize),
        _ => Err(wrong("degree", Some(value), &expected)),
    }
}

/// The terms must be those of the degree, in the order of this crate.
fn term_table(map: &Document, rows: &[Vec<u8>]) -> Result<(), ModelError> {
    let expected = format!("the {} exponents of this degree, in order", rows.len());
    let found = array(map, "terms", &expected)?;
    if found.len() != rows.len() {
        return Err(count("terms", found.len(), "rows", &expected));
    }
    for (i, (row, expected)) in found.iter().zip(rows).enumerate() {
        let same = row.as_array().is_some_and(|row| {
            row.len() == expected.len()
                && row
                    .iter()
                    .zip(expected)
                    .all(|(a, &b)| a.as_u64() == Some(u64::from(b)))
        });
        if !same {
            return Err(wrong(
                &format!("terms[{i}]"),
                Some(row),
                &format!("{expected:?}"),
            ));
        }
    }
    Ok(())
}

fn covariance(value: &Value) -> Result<(), ModelError> {
    if value.is_null() {
        return Ok(());
    }
    let expected = "a square, symmetric matrix, or null";
    let Some(rows) = value.as_array() else {
        return Err(wrong("covariance", Some(value), expected));
    };
    let mut matrix = Vec::with_capacity(rows.len());
    for (i, row) in rows.iter().enumerate() {
        matrix.push(number_list(
            &format!("covariance[{i}]"),
            Some(row),
            rows.len(),
        )?);
    }
    for i in 0..matrix.len() {
        if matrix[i][i] < 0.0 {
            let key = format!("covariance[{i}][{i}]");
            return Err(wrong(
                &key,
                Some(&Value::from(matrix[i][i])),
                "a variance, 0 or above",
            ));
        }
        for j in 0..i {
            let apart = (matrix[i][j] - matrix[j][i]).abs();
            if above_root(apart, 1e-6, matrix[i][i], matrix[j][j]) {
                let key = format!("covariance[{i}][{j}]");
                let mirrored = format!("{} as at [{j}][{i}]", matrix[j][i]);
                return Err(wrong(&key, Some(&Value::from(matrix[i][j])), &mirrored));
            }
        }
    }
    Ok(())
}

/// Whether d > t √(x y) for numbers not below 0, without a root, which needs std.
fn above_root(d: f64, t: f64, x: f64, y: f64) -> bool {
    if x == 0.0 || y == 0.0 {
        return d > 0.0;
    }
    (d / x) * (d / y) > t * t
}

fn get<'a>(map: &'a Document, key: &str, expected: &str) -> Result<&'a Value, ModelError> {
    map.get(key).ok_or_else(|| wrong(key, None, expected))
}

/// A string value.
pub fn text<'a>(map: &'a Document, key: &str, expected: &str) -> Result<&'a str, ModelError> {
    let value = get(map, key, expected)?;
    value
        .as_str()
        .ok_or_else(|| wrong(key, Some(value), expected))
}

fn array<'a>(map: &'a Document, key: &str, expected: &str) -> Result<&'a [Value], ModelError> {
    let value = get(map, key, expected)?;
    let list = value.as_array().map(Vec::as_slice);
    list.ok_or_else(|| wrong(key, Some(value), expected))
}

fn inside<'a>(map: &'a Document, key: &str) -> Result<&'a Document, ModelError> {
    let value = get(map, key, "an object")?;
    value
        .as_object()
        .ok_or_else(|| wrong(key, Some(value), "an object"))
}

fn names<'a>(map: &'a Document, key: &str) -> Result<Vec<&'a str>, ModelError> {
    let expected = "a list of different column names";
    let list = array(map, key, expected)?;
    let names: Vec<&str> = list.iter().filter_map(Value::as_str).collect();
    let repeated = (1..names.len()).any(|i| names[..i].contains(&names[i]));
    if names.is_empty() || names.len() != list.len() || repeated {
        return Err(wrong(key, map.get(key), expected));
    }
    Ok(names)
}

fn numbers(map: &Document, path: &str, key: &str, length: usize) -> Result<Vec<f64>, ModelError> {
    number_list(path, map.get(key), length)
}

fn number_list(key: &str, value: Option<&Value>, length: usize) -> Result<Vec<f64>, ModelError> {
    let expected = format!("a list of {length} finite numbers");
    let Some(list) = value.and_then(Value::as_array) else {
        return Err(wrong(key, value, &expected));
    };
    if list.len() != length {
        return Err(count(key, list.len(), "numbers", &expected));
    }
    list.iter()
        .enumerate()
        .map(|(i, x)| match x.as_f64() {
            Some(number) if number.is_finite() => Ok(number),
            _ => Err(wrong(&format!("{key}[{i}]"), Some(x), "a finite number")),
        })
        .collect()
}

fn count(key: &str, found: usize, unit: &str, expected: &str) -> ModelError {
    ModelError::Key {
        key: key.to_string(),
        found: format!("{found} {unit}"),
        expected: expected.to_string(),
    }
}

fn wrong(key: &str, found: Option<&Value>, expected: &str) -> ModelError {
    ModelError::Key {
        key: key.to_string(),
        found: found.map_or_else(|| "missing".to_string(), short),
        expected: expected.to_string(),
    }
}

/// A value for a message, cut to about sixty characters.
pub fn short(value: &Value) -> String {
    let text = value.to_string();
    if text.chars().count() <= 60 {
        return text;
    }
    let mut cut: String = text.chars().take(57).collect();
    cut.push_str("...");
    cut
}
