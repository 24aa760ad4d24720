//! An adapter as source code beside an exported model, with a golden history of readings.

mod c;
mod history;
mod rust;

pub use c::export as c;
pub use rust::export as rust;

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use self::history::History;
use super::{SourceFile, filled};
use crate::adapt::{Adapter, Parameter, Prior};

/// Any of the parameters; those with a standard deviation of 0 are left out of the code.
pub type Settings = Adapter<f64, { Parameter::ALL.len() }>;

/// Places, parameters and what is known of those that are exported.
fn chosen(settings: &Settings) -> Vec<(usize, Parameter, Prior<f64>)> {
    let all = settings.parameters.iter().zip(&settings.priors).enumerate();
    all.filter(|(_, (_, prior))| prior.sd > 0.0)
        .map(|(i, (parameter, prior))| (i, *parameter, *prior))
        .collect()
}

fn list<T>(items: &[T], of: impl Fn(&T) -> String) -> String {
    let items: Vec<String> = items.iter().map(of).collect();
    items.join(", ")
}

/// What C and Rust need alike: the settings that are numbers, and the golden readings.
fn common_keys(
    settings: &Settings,
    history: &History,
    number: impl Fn(&f64) -> String,
    (open, close, golden): (&str, &str, impl Fn(&f64) -> String),
) -> Vec<(&'static str, String)> {
    let kept = chosen(settings);
    let noise = &settings.noise;
    let rows = |all: &[Vec<f64>]| table(all, open, close, &golden);
    std::vec![
        ("COUNT", kept.len().to_string()),
        ("WRENCHSD", list(&noise.wrench, &number)),
        ("POSESD", list(&noise.pose, &number)),
        ("NOISETIME", number(&noise.time_s)),
        ("MODELSD", list(&noise.model, &number)),
        ("REACH", list(&noise.reach, &number)),
        ("RIM", number(&noise.rim)),
        ("MIDDLE", list(&noise.middle, &number)),
        ("PERHALFRANGE", list(&noise.per_half_range, &number)),
        ("GRAVITY", list(&settings.gravity, &number)),
        ("INTERVAL", number(&settings.interval_s)),
        ("READINGS", history.readings.len().to_string()),
        ("READINGLIST", rows(&history.readings)),
        ("OUTCOMES", list(&history.outcomes, u8::to_string)),
        ("VALUES", rows(&history.values)),
        ("VARIANCES", rows(&history.variances)),
        ("TOLERANCE", golden(&history.tolerance)),
    ]
}

/// A file by its path and template.
fn file(path: String, template: &str, keys: &[(&str, String)]) -> SourceFile {
    let keys: Vec<(&str, &str)> = keys
        .iter()
        .map(|(key, text)| (*key, text.as_str()))
        .collect();
    SourceFile {
        path,
        text: filled(template, &keys),
    }
}

/// A table with one row a line.
fn table(rows: &[Vec<f64>], open: &str, close: &str, of: impl Fn(&f64) -> String) -> String {
    let rows: Vec<String> = rows
        .iter()
        .map(|row| format!("{open}{}{close}", list(row, &of)))
        .collect();
    rows.join(",\n    ")
}
