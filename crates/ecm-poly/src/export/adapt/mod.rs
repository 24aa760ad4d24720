//! An adapter as source code beside an exported model, with a golden history of readings.
//!
//! There is one adapter, that of this crate. An exported crate has it as a module; beside exported C it is
//! a crate of its own, which gives a static library with the functions of a header.

mod history;

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use self::history::History;
use super::model::{Model, identifier};
use super::{Precision, SourceFile, filled, source};
use crate::adapt::{Adapter, CELLS, PARTS, Parameter, Prior};
use crate::error::ModelError;

/// Any of the parameters; those with a standard deviation of 0 are left out of the code.
pub type Settings = Adapter<f64, { Parameter::ALL.len() }>;

const MODULE: (&str, &str) = ("src/adapt.rs", include_str!("../templates/adapt.rs.txt"));

/// The adapter for a model exported as C that `name` names as well: `NAME_adapt.h`, its check with golden
/// readings, and the crate `NAME_adapt` of the static library.
///
/// # Errors
/// A name that is none, a model of other columns than six and six.
pub fn c(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    settings: &Settings,
) -> Result<Vec<SourceFile>, ModelError> {
    let keys = keys(document, name, precision, settings, ["{", "}", "R"])?;
    let crate_of = format!("{name}_adapt");
    let mut files = source::evaluation(true, true);
    for (path, template) in [
        MODULE,
        ("src/lib.rs", include_str!("../templates/adapt_c.rs.txt")),
        ("Cargo.toml", include_str!("../templates/adapt_c.toml")),
    ] {
        files.push(file(path, template, &keys));
    }
    for file in &mut files {
        file.path = format!("{crate_of}/{}", file.path);
    }
    let header = include_str!("../templates/adapt.h");
    let check = include_str!("../templates/adapt_check.c");
    files.push(file(&format!("{crate_of}.h"), header, &keys));
    files.push(file(&format!("{crate_of}_check.c"), check, &keys));
    Ok(files)
}

/// The files of an exported crate with the module `adapt` added.
///
/// # Errors
/// As for C.
pub fn rust(
    mut files: Vec<SourceFile>,
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    settings: &Settings,
) -> Result<Vec<SourceFile>, ModelError> {
    let keys = keys(document, name, precision, settings, ["[", "]", ""])?;
    if let Some(root) = files.iter_mut().find(|file| file.path == "src/lib.rs") {
        let (first, modules) = (
            "#![forbid(unsafe_code)]\n",
            "\npub mod adapt;\nmod evaluation;\n",
        );
        let text = root.text.replacen("\nmod evaluation;\n", "", 1);
        root.text = text.replacen(first, &format!("{first}{modules}"), 1);
    }
    files.retain(|file| !file.path.starts_with("src/evaluation/"));
    files.extend(source::evaluation(true, true));
    let test = (
        "tests/adapt.rs",
        include_str!("../templates/adapt_test.rs.txt"),
    );
    files.extend([MODULE, test].map(|(path, template)| file(path, template, &keys)));
    Ok(files)
}

/// Places, parameters and what is known of those that are exported.
fn chosen(settings: &Settings) -> Vec<(usize, Parameter, Prior<f64>)> {
    let all = settings.parameters.iter().zip(&settings.priors).enumerate();
    all.filter(|(_, (_, prior))| prior.sd > 0.0)
        .map(|(i, (parameter, prior))| (i, *parameter, *prior))
        .collect()
}

/// The settings in Rust, and the golden readings with rows in `open` and `close`, each number as
/// `cast`(number) where there is such a word.
fn keys(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    settings: &Settings,
    [open, close, cast]: [&str; 3],
) -> Result<Vec<(&'static str, String)>, ModelError> {
    let name = identifier(name)?;
    let history = History::new(&Model::from_document(document)?, settings, precision)?;
    let kept = chosen(settings);
    let count = kept.len();
    let number = |x: &f64| match precision {
        Precision::Single => format!("{:e}", *x as f32),
        Precision::Double => format!("{x:e}"),
    };
    let golden = |x: &f64| match cast {
        "" => number(x),
        _ => format!("{cast}({x:e})"),
    };
    let rows = |all: &[Vec<f64>]| {
        let row = |row: &Vec<f64>| format!("{open}{}{close}", list(row, golden));
        all.iter().map(row).collect::<Vec<_>>().join(",\n    ")
    };
    let prior = |(_, _, p): &(usize, Parameter, Prior<f64>)| {
        let [start, sd, low, high, walk, jumps] =
            [p.start, p.sd, p.low, p.high, p.walk, p.jumps].map(|x| number(&x));
        format!(
            "Prior {{ start: {start}, sd: {sd}, low: {low}, high: {high}, walk: {walk}, jumps: {jumps} }}"
        )
    };
    let places: Vec<String> = (kept.iter().enumerate())
        .map(|(i, item)| format!("    {name}_parameter_{} = {i},\n", item.1.name()))
        .collect();
    let size = precision.size();
    let numbers = 3 * count + 2 * count * count + 6 * PARTS * count + 6 * CELLS + 92;
    let state = (numbers * size + 4 * (CELLS + 5)).next_multiple_of(size);
    // Measured for 1 to 13 parameters; where double is software, its calls keep more.
    let calls = if size == 4 { 2000 } else { 4000 };
    let stack = (numbers + 4 * count * count + 80 * count + 600) * size + calls;
    let noise = &settings.noise;
    Ok(std::vec![
        (
            "GUARD",
            format!("ECM_EXPORT_{}_ADAPT_H", name.to_uppercase())
        ),
        ("NAME", name),
        ("REAL", precision.in_rust().to_string()),
        ("CREAL", precision.in_c().to_string()),
        ("RUST", env!("CARGO_PKG_RUST_VERSION").to_string()),
        ("COUNT", count.to_string()),
        ("PARTS", PARTS.to_string()),
        ("CELLS", CELLS.to_string()),
        ("STATE", state.to_string()),
        ("STACK", stack.next_multiple_of(16).to_string()),
        ("NAMES", list(&kept, |item| item.1.name().to_string())),
        ("PLACES", places.concat()),
        (
            "KINDS",
            list(&kept, |item| format!("Parameter::{:?}", item.1))
        ),
        ("PRIORS", list(&kept, prior)),
        ("WRENCHSD", list(&noise.wrench, number)),
        ("POSESD", list(&noise.pose, number)),
        ("NOISETIME", number(&noise.time_s)),
        ("MODELSD", list(&noise.model, number)),
        ("REACH", list(&noise.reach, number)),
        ("RIM", number(&noise.rim)),
        ("MIDDLE", list(&noise.middle, number)),
        ("PERHALFRANGE", list(&noise.per_half_range, number)),
        ("GRAVITY", list(&settings.gravity, number)),
        ("INTERVAL", number(&settings.interval_s)),
        ("READINGS", history.readings.len().to_string()),
        ("READINGLIST", rows(&history.readings)),
        ("OUTCOMES", list(&history.outcomes, u8::to_string)),
        ("VALUES", rows(&history.values)),
        ("VARIANCES", rows(&history.variances)),
        ("TOLERANCE", golden(&history.tolerance)),
    ])
}

fn list<T>(items: &[T], of: impl Fn(&T) -> String) -> String {
    items.iter().map(of).collect::<Vec<_>>().join(", ")
}

/// A file by its path and template.
fn file(path: &str, template: &str, keys: &[(&str, String)]) -> SourceFile {
    let keys: Vec<(&str, &str)> = keys
        .iter()
        .map(|(key, text)| (*key, text.as_str()))
        .collect();
    SourceFile {
        path: path.to_string(),
        text: filled(template, &keys),
    }
}
