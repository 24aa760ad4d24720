//! An adapter as C: `NAME_adapt.h`, `NAME_adapt.c`, and its check with golden readings.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use serde_json::{Map, Value};

use super::history::History;
use super::{Settings, chosen, common_keys, file, list};
use crate::adapt::{CELLS, PARTS};
use crate::error::ModelError;
use crate::export::model::{Model, identifier};
use crate::export::terms::{half_turn_squared, inverse_factorial};
use crate::export::{Precision, SourceFile};

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
    let places: Vec<String> = (kept.iter().enumerate())
        .map(|(i, item)| format!("    {name}_parameter_{} = {i},\n", item.1.name()))
        .collect();
    let priors = list(&kept, |(_, _, p)| {
        format!(
            "{{{}}}",
            list(&[p.start, p.sd, p.low, p.high, p.walk, p.jumps], real)
        )
    });
    let numbers = 3 * count + 2 * count * count + 6 * PARTS * count + 6 * CELLS + 92;
    let stack = (numbers + 4 * count * count + 80 * count + 600) * precision.size() + 1600;
    let factorials: Vec<f64> = (0..10).map(inverse_factorial).collect();
    let golden = |x: &f64| format!("(({name}_adapt_real){x:e})");
    let mut keys = common_keys(settings, &history, real, ("{", "}", golden));
    keys.extend([
        ("DECAY", include_str!("../templates/decay.c").to_string()),
        (
            "GUARD",
            format!("ECM_EXPORT_{}_ADAPT_H", name.to_uppercase()),
        ),
        ("REAL", precision.in_c().to_string()),
        ("NAME", name.clone()),
        ("PARTS", PARTS.to_string()),
        ("CELLS", CELLS.to_string()),
        (
            "PARAMETERNAMES",
            list(&kept, |item| item.1.name().to_string()),
        ),
        ("PLACES", places.concat()),
        ("KINDS", list(&kept, |item| (item.1 as u8).to_string())),
        ("PRIORS", priors),
        ("EPSILON", format!("{:e}", precision.epsilon())),
        ("HALFTURN", half_turn_squared(precision)),
        ("FACTORIALS", list(&factorials, real)),
        (
            "STATE",
            (numbers * precision.size() + 4 * (CELLS + 5)).to_string(),
        ),
        ("STACK", stack.next_multiple_of(16).to_string()),
    ]);
    let file = |suffix: &str, template| file(format!("{name}{suffix}"), template, &keys);
    Ok(std::vec![
        file("_adapt.h", include_str!("../templates/adapt.h")),
        file("_adapt.c", include_str!("../templates/adapt.c")),
        file("_adapt_check.c", include_str!("../templates/adapt_check.c")),
    ])
}
