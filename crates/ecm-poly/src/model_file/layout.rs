//! Layout of a model file: important keys first, tables row by row.

use alloc::string::{String, ToString};
use alloc::vec::Vec;

use serde_json::{Map, Value};

const ORDER: [&str; 18] = [
    "format",
    "version",
    "kind",
    "name",
    "inputs",
    "outputs",
    "length_m",
    "degree",
    "symmetry",
    "normalisation",
    "terms",
    "coefficients",
    "covariance",
    "noise",
    "effects",
    "domain",
    "training",
    "sha256",
];

/// The text of a model file.
pub fn text(map: &Map<String, Value>) -> String {
    let place = |key: &str| {
        ORDER
            .iter()
            .position(|&k| k == key)
            .unwrap_or(ORDER.len() - 2)
    };
    let mut entries: Vec<_> = map.iter().collect();
    entries.sort_by(|a, b| place(a.0).cmp(&place(b.0)).then(a.0.cmp(b.0)));
    let mut text = String::new();
    write_entries(&entries, 0, &mut text);
    text.push('\n');
    text
}

fn write_entries(entries: &[(&String, &Value)], depth: usize, text: &mut String) {
    if entries.is_empty() {
        text.push_str("{}");
        return;
    }
    text.push('{');
    for (i, (key, value)) in entries.iter().enumerate() {
        text.push_str(if i > 0 { ",\n" } else { "\n" });
        indent(depth + 1, text);
        text.push_str(&Value::from(key.as_str()).to_string());
        text.push_str(": ");
        write_value(value, depth + 1, text);
    }
    text.push('\n');
    indent(depth, text);
    text.push('}');
}

fn write_value(value: &Value, depth: usize, text: &mut String) {
    match value {
        Value::Object(map) => {
            let mut entries: Vec<_> = map.iter().collect();
            entries.sort_by(|a, b| a.0.cmp(b.0));
            write_entries(&entries, depth, text);
        }
        Value::Array(values) if values.iter().any(|v| v.is_array() || v.is_object()) => {
            text.push('[');
            for (i, value) in values.iter().enumerate() {
                text.push_str(if i > 0 { ",\n" } else { "\n" });
                indent(depth + 1, text);
                write_value(value, depth + 1, text);
            }
            text.push('\n');
            indent(depth, text);
            text.push(']');
        }
        Value::Array(values) => {
            text.push('[');
            for (i, value) in values.iter().enumerate() {
                if i > 0 {
                    text.push_str(", ");
                }
                text.push_str(&value.to_string());
            }
            text.push(']');
        }
        scalar => text.push_str(&scalar.to_string()),
    }
}

fn indent(depth: usize, text: &mut String) {
    for _ in 0..depth {
        text.push_str("  ");
    }
}
