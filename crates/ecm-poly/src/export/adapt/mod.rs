//! An adapter as source code beside an exported model, with a golden history of readings.

mod c;
mod history;
mod rust;

pub use c::export as c;
pub use rust::export as rust;

use std::format;
use std::string::String;
use std::vec::Vec;

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

/// A table with one row a line.
fn table(rows: &[Vec<f64>], open: &str, close: &str, of: impl Fn(&f64) -> String) -> String {
    let rows: Vec<String> = rows
        .iter()
        .map(|row| format!("{open}{}{close}", list(row, &of)))
        .collect();
    rows.join(",\n    ")
}
