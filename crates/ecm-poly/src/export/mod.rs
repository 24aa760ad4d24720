//! Models as source code for a controller: C with golden vectors, a const Rust crate.
//!
//! The code needs no heap and no libm, and costs the same at every pose.

pub mod adapt;
pub mod c;
mod golden;
mod history;
pub mod model;
mod reach;
pub mod rust;
mod source;
mod terms;

use std::string::String;

/// The floating-point type of the exported code.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// f32, float.
    Single,
    /// f64, double.
    Double,
}

impl Precision {
    /// Bytes of a number.
    pub(crate) fn size(self) -> usize {
        match self {
            Precision::Single => 4,
            Precision::Double => 8,
        }
    }

    /// The type's name in C.
    pub(crate) fn in_c(self) -> &'static str {
        match self {
            Precision::Single => "float",
            Precision::Double => "double",
        }
    }

    /// The type's name in Rust.
    pub(crate) fn in_rust(self) -> &'static str {
        match self {
            Precision::Single => "f32",
            Precision::Double => "f64",
        }
    }

    /// Distance from 1 to the next number.
    pub(crate) fn epsilon(self) -> f64 {
        match self {
            Precision::Single => f64::from(f32::EPSILON),
            Precision::Double => f64::EPSILON,
        }
    }

    /// Newton's last step over the largest one: the error after it is of its square.
    pub(crate) fn settled(self) -> &'static str {
        match self {
            Precision::Single => "1e-3",
            Precision::Double => "1e-7",
        }
    }

    /// The nearest number of the type.
    pub(crate) fn rounded(self, x: f64) -> f64 {
        match self {
            Precision::Single => f64::from(x as f32),
            Precision::Double => x,
        }
    }
}

/// One file of an export.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SourceFile {
    /// Path below the export's directory, with `/`.
    pub path: String,
    /// Content.
    pub text: String,
}

/// A text with every `@KEY@` replaced by its value.
pub(crate) fn filled(template: &str, values: &[(&str, &str)]) -> String {
    let mut text = String::from(template);
    for (key, value) in values {
        text = text.replace(&std::format!("@{key}@"), value);
    }
    text
}

/// Items with commas, six on a line.
pub(crate) fn list(items: impl Iterator<Item = String>) -> String {
    let mut text = String::new();
    for (i, item) in items.enumerate() {
        text.push_str(match i {
            0 => "\n    ",
            i if i % 6 == 0 => ",\n    ",
            _ => ", ",
        });
        text.push_str(&item);
    }
    text
}
