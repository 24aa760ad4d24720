//! An adapter as a module of an exported crate, with a golden test of readings.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use super::history::History;
use super::{Settings, chosen, list, table};
use crate::error::ModelError;
use crate::export::model::{Model, identifier};
use crate::export::source::with_adapt;
use crate::export::{Precision, SourceFile, filled};

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
    let real = match precision {
        Precision::Single => "f32",
        Precision::Double => "f64",
    };
    let priors = list(&kept, |(_, _, p)| {
        let [start, sd, low, high, walk, jumps] =
            [p.start, p.sd, p.low, p.high, p.walk, p.jumps].map(|x| number(&x));
        format!(
            "Prior {{ start: {start}, sd: {sd}, low: {low}, high: {high}, walk: {walk}, jumps: {jumps} }}"
        )
    });
    let noise = &settings.noise;
    let keys = [
        ("NAME", name),
        ("REAL", real.to_string()),
        ("COUNT", kept.len().to_string()),
        ("NAMES", list(&kept, |item| item.1.name().to_string())),
        (
            "KINDS",
            list(&kept, |item| format!("Parameter::{:?}", item.1)),
        ),
        ("PRIORS", priors),
        ("WRENCHSD", list(&noise.wrench, number)),
        ("POSESD", list(&noise.pose, number)),
        ("NOISETIME", number(&noise.time_s)),
        ("MODELSD", list(&noise.model, number)),
        ("REACH", list(&noise.reach, number)),
        ("GRAVITY", list(&settings.gravity, number)),
        ("INTERVAL", number(&settings.interval_s)),
        ("READINGS", history.readings.len().to_string()),
        ("READINGLIST", table(&history.readings, "[", "]", number)),
        ("OUTCOMES", list(&history.outcomes, u8::to_string)),
        ("VALUES", table(&history.values, "[", "]", number)),
        ("VARIANCES", table(&history.variances, "[", "]", number)),
        ("TOLERANCE", number(&history.tolerance)),
    ];
    let keys: Vec<(&str, &str)> = keys
        .iter()
        .map(|(key, text)| (*key, text.as_str()))
        .collect();
    if let Some(root) = files.iter_mut().find(|file| file.path == "src/lib.rs") {
        root.text = root
            .text
            .replacen("mod evaluation;\n", "pub mod adapt;\nmod evaluation;\n", 1);
    }
    let file = |path: &str, template: &str| SourceFile {
        path: path.to_string(),
        text: filled(template, &keys),
    };
    files.push(file(
        "src/adapt.rs",
        include_str!("../templates/adapt.rs.txt"),
    ));
    files.push(file(
        "tests/adapt.rs",
        include_str!("../templates/adapt_test.rs.txt"),
    ));
    with_adapt(&mut files);
    Ok(files)
}
