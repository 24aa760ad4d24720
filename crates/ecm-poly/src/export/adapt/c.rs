//! An adapter as C: `NAME_adapt.h`, `NAME_adapt.c`, and its check with golden readings.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use super::history::History;
use super::{Settings, chosen, list, table};
use crate::adapt::{CELLS, PARTS};
use crate::error::ModelError;
use crate::export::model::{Model, identifier};
use crate::export::terms::half_turn_squared;
use crate::export::{Precision, SourceFile, filled};

/// The files, beside those of the model that `name` names as well.
///
/// # Errors
/// A name that is none, a model of other columns than six and six.
pub fn export(
    document: &Map<String, Value>,
    name: &str,
    precision: Precision,
    settings: &Settings,
) -> Result<Vec<SourceFile>, ModelError> {
    let name = identifier(name)?;
    let history = History::new(&Model::from_document(document)?, settings, precision)?;
    let kept = chosen(settings);
    let count = kept.len();
    let real = |x: &f64| format!("R({x:e})");
    let (kind, epsilon) = match precision {
        Precision::Single => ("float", f64::from(f32::EPSILON)),
        Precision::Double => ("double", f64::EPSILON),
    };
    let places: Vec<String> = (kept.iter().enumerate())
        .map(|(i, item)| format!("    {name}_parameter_{} = {i},\n", item.1.name()))
        .collect();
    let priors = list(&kept, |(_, _, p)| {
        format!(
            "{{{}}}",
            list(&[p.start, p.sd, p.low, p.high, p.walk, p.jumps], real)
        )
    });
    let noise = &settings.noise;
    let pair = |values: &[f64]| list(values, real);
    let numbers = 3 * count + count * count + 6 * PARTS * count + 6 * CELLS + 91;
    let stack = (numbers + 3 * count * count + 80 * count + 600) * precision.size() + 1600;
    let factorials = (0..10u32).map(|k| 1.0 / (1..=k).map(f64::from).product::<f64>());
    let factorials: Vec<f64> = factorials.collect();
    let golden = |x: &f64| format!("(({name}_adapt_real){x:e})");
    let common = [
        ("DECAY", include_str!("../templates/decay.c").to_string()),
        (
            "GUARD",
            format!("ECM_EXPORT_{}_ADAPT_H", name.to_uppercase()),
        ),
        ("REAL", kind.to_string()),
        ("NAME", name.clone()),
        ("COUNT", count.to_string()),
        ("PARTS", PARTS.to_string()),
        ("CELLS", CELLS.to_string()),
        (
            "PARAMETERNAMES",
            list(&kept, |item| item.1.name().to_string()),
        ),
        ("PLACES", places.concat()),
        ("KINDS", list(&kept, |item| (item.1 as u8).to_string())),
        ("PRIORS", priors),
        ("WRENCHSD", pair(&noise.wrench)),
        ("POSESD", pair(&noise.pose)),
        ("NOISETIME", real(&noise.time_s)),
        ("MODELSD", pair(&noise.model)),
        ("REACH", pair(&noise.reach)),
        ("GRAVITY", pair(&settings.gravity)),
        ("INTERVAL", real(&settings.interval_s)),
        ("EPSILON", format!("{epsilon:e}")),
        ("HALFTURN", half_turn_squared(precision)),
        ("FACTORIALS", list(&factorials, real)),
        (
            "STATE",
            (numbers * precision.size() + 4 * (CELLS + 5)).to_string(),
        ),
        ("STACK", stack.next_multiple_of(16).to_string()),
        ("READINGS", history.readings.len().to_string()),
        ("READINGLIST", table(&history.readings, "{", "}", golden)),
        ("OUTCOMES", list(&history.outcomes, u8::to_string)),
        ("VALUES", table(&history.values, "{", "}", golden)),
        ("VARIANCES", table(&history.variances, "{", "}", golden)),
        ("TOLERANCE", golden(&history.tolerance)),
    ];
    let keys: Vec<(&str, &str)> = common
        .iter()
        .map(|(key, text)| (*key, text.as_str()))
        .collect();
    let file = |suffix: &str, template: &str| SourceFile {
        path: format!("{name}{suffix}"),
        text: filled(template, &keys),
    };
    Ok(std::vec![
        file("_adapt.h", include_str!("../templates/adapt.h")),
        file("_adapt.c", include_str!("../templates/adapt.c")),
        file("_adapt_check.c", include_str!("../templates/adapt_check.c")),
    ])
}
