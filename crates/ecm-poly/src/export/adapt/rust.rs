//! An adapter as a module of an exported crate, with a golden test of readings.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use super::history::History;
use super::{Settings, chosen, common_keys, file, list};
use crate::error::ModelError;
use crate::export::model::{Model, identifier};
use crate::export::source::with_adapt;
use crate::export::{Precision, SourceFile};

/// The files of an exported crate with the module `adapt` added.
///
/// # Errors
/// As for C.
pub fn export(
    mut files: Vec<SourceFile>,
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    settings: &Settings,
) -> Result<Vec<SourceFile>, ModelError> {
    let name = identifier(name)?;
    let history = History::new(&Model::from_document(document)?, settings, precision)?;
    let kept = chosen(settings);
    let number = |x: &f64| match precision {
        Precision::Single => format!("{:e}", *x as f32),
        Precision::Double => format!("{x:e}"),
    };
    let priors = list(&kept, |(_, _, p)| {
        let [start, sd, low, high, walk, jumps] =
            [p.start, p.sd, p.low, p.high, p.walk, p.jumps].map(|x| number(&x));
        format!(
            "Prior {{ start: {start}, sd: {sd}, low: {low}, high: {high}, walk: {walk}, jumps: {jumps} }}"
        )
    });
    let mut keys = common_keys(settings, &history, number, ("[", "]", number));
    keys.extend([
        ("NAME", name),
        ("REAL", precision.in_rust().to_string()),
        ("NAMES", list(&kept, |item| item.1.name().to_string())),
        (
            "KINDS",
            list(&kept, |item| format!("Parameter::{:?}", item.1)),
        ),
        ("PRIORS", priors),
    ]);
    if let Some(root) = files.iter_mut().find(|file| file.path == "src/lib.rs") {
        root.text = root
            .text
            .replacen("mod evaluation;\n", "pub mod adapt;\nmod evaluation;\n", 1);
    }
    for (path, template) in [
        ("src/adapt.rs", include_str!("../templates/adapt.rs.txt")),
        (
            "tests/adapt.rs",
            include_str!("../templates/adapt_test.rs.txt"),
        ),
    ] {
        files.push(file(path.to_string(), template, &keys));
    }
    with_adapt(&mut files);
    Ok(files)
}
