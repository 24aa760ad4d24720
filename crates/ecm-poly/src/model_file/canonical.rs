//! The canonical form of a document, from which its checksum is computed.
//!
//! UTF-8 without any white space; keys of every object in the order of their bytes; strings
//! with the escapes `\"`, `\\` and `\u00xx` for control characters only; a number that is whole
//! and below 2⁵³ in size as its decimal digits (so 1, 1.0 and 1e0 are one number, as are 0 and
//! −0.0), a larger integer as its digits, any other as the shortest decimal that reads back
//! to the same double, one digit before the point, like `1.5e-7`. The sum is SHA-256 in
//! lower-case hexadecimal digits over all keys but `sha256`.

use alloc::format;
use alloc::string::String;
use alloc::vec::Vec;

use serde_json::{Map, Number, Value};
use sha2::{Digest, Sha256};

/// SHA-256 of the canonical form.
pub fn sha256(map: &Map<String, Value>) -> String {
    let digest = Sha256::digest(canonical(map).as_bytes());
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// The canonical form of an object.
pub fn canonical(map: &Map<String, Value>) -> String {
    let mut text = String::new();
    write_object(map, &mut text);
    text
}

fn write_object(map: &Map<String, Value>, text: &mut String) {
    let mut entries: Vec<_> = map.iter().collect();
    entries.sort_by(|a, b| a.0.cmp(b.0));
    text.push('{');
    for (i, (key, value)) in entries.into_iter().enumerate() {
        if i > 0 {
            text.push(',');
        }
        write_string(key, text);
        text.push(':');
        write_value(value, text);
    }
    text.push('}');
}

fn write_value(value: &Value, text: &mut String) {
    match value {
        Value::Null => text.push_str("null"),
        Value::Bool(true) => text.push_str("true"),
        Value::Bool(false) => text.push_str("false"),
        Value::Number(number) => write_number(number, text),
        Value::String(string) => write_string(string, text),
        Value::Array(values) => {
            text.push('[');
            for (i, value) in values.iter().enumerate() {
                if i > 0 {
                    text.push(',');
                }
                write_value(value, text);
            }
            text.push(']');
        }
        Value::Object(map) => write_object(map, text),
    }
}

fn write_number(number: &Number, text: &mut String) {
    if let Some(integer) = number.as_u64() {
        text.push_str(&format!("{integer}"));
    } else if let Some(integer) = number.as_i64() {
        text.push_str(&format!("{integer}"));
    } else {
        let x = number.as_f64().unwrap_or(f64::NAN);
        let whole = x as i64;
        if whole as f64 == x && x.abs() < 9_007_199_254_740_992.0 {
            text.push_str(&format!("{whole}"));
        } else {
            text.push_str(&format!("{x:e}"));
        }
    }
}

fn write_string(string: &str, text: &mut String) {
    text.push('"');
    for c in string.chars() {
        match c {
            '"' => text.push_str("\\\""),
            '\\' => text.push_str("\\\\"),
            c if (c as u32) < 0x20 => text.push_str(&format!("\\u{:04x}", c as u32)),
            c => text.push(c),
        }
    }
    text.push('"');
}
