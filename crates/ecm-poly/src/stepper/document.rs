//! Effects of time as JSON, and in another precision.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use ecm_se3::{Mat6, Real, Vec6};
use serde_json::{Map, Value};

use super::{BRANCHES, Branch, Effects, SPRINGS, Softening, diagonal};
use crate::error::ModelError;

impl Effects<f64> {
    /// From an object with the names of the fields; `branches` is a list, and what lacks is absent.
    ///
    /// A matrix is its six diagonal numbers or all 36, row by row; `columns` are twelve numbers.
    ///
    /// # Errors
    /// A number that is missing or not finite, a time constant or a length that is not above zero,
    /// another number of entries.
    pub fn from_document(document: &Map<String, Value>) -> Result<Self, ModelError> {
        let length = number(document, "length_m", None)?;
        let mut effects = Effects::none(length);
        let branches = document.get("branches").and_then(Value::as_array);
        let branches = branches.map_or(&[][..], Vec::as_slice);
        if branches.len() > BRANCHES {
            return Err(wrong(
                "branches",
                format!("{} of them", branches.len()),
                "at most 2",
            ));
        }
        for (own, value) in effects.branches.iter_mut().zip(branches) {
            let empty = Map::new();
            let branch = value.as_object().unwrap_or(&empty);
            *own = Branch {
                share: number(branch, "share", None)?,
                tau_s: number(branch, "tau_s", None)?,
                linear: branch.get("linear").and_then(Value::as_bool) == Some(true),
            };
            if own.tau_s <= 0.0 {
                return Err(wrong("tau_s", own.tau_s.to_string(), "a time above 0 s"));
            }
        }
        if length <= 0.0 {
            return Err(wrong("length_m", length.to_string(), "a length above 0 m"));
        }
        effects.stiffness = matrix(document, "stiffness")?;
        effects.friction = matrix(document, "friction")?;
        effects.slip = numbers(document, "slip")?;
        effects.play = numbers(document, "play")?;
        effects.together = document.get("together") == Some(&Value::Bool(true));
        let springs = number(document, "springs", Some(1.0))?;
        let counted = (1..=SPRINGS).find(|&count| count as f64 == springs);
        effects.springs =
            counted.ok_or_else(|| wrong("springs", springs.to_string(), "a number from 1 to 5"))?;
        effects.of_pose = document.get("friction_of_pose") == Some(&Value::Bool(true));
        effects.damping = match numbers(document, "damping") {
            Ok([along, about]) => diagonal(&[along, along, along, about, about, about]),
            Err(_) => matrix(document, "damping")?,
        };
        effects.softer_per_kelvin = number(document, "softer_per_kelvin", Some(0.0))?;
        effects.reference_degc = number(document, "reference_degc", Some(0.0))?;
        effects.growth_per_kelvin = number(document, "growth_per_kelvin", Some(0.0))?;
        effects.ageing_per_s = number(document, "ageing_per_s", Some(0.0))?;
        effects.settling_per_s = match number(document, "ageing_tau_s", Some(0.0))? {
            steady if steady <= 0.0 => 0.0,
            tau_s => 1.0 / tau_s,
        };
        effects.softening = Softening {
            share: number(document, "softening", Some(0.0))?,
            width: number(document, "softening_width", Some(0.0))?,
            hyperbolic: document.get("softening_hyperbolic") == Some(&Value::Bool(true)),
            of_pose: numbers(document, "softening_of_pose")?,
            of_wrench: numbers(document, "softening_of_wrench")?,
        };
        effects.set_share = number(document, "set_share", Some(0.0))?;
        effects.temperature_range_degc = range(document, "temperature_range_degc")?;
        effects.age_range_s = range(document, "age_range_s")?;
        let limits = document.get("limits");
        effects.limits = limits.map(|_| numbers(document, "limits")).transpose()?;
        if document.contains_key("columns") {
            let ends = numbers::<12>(document, "columns")?;
            let end = |k: usize| core::array::from_fn(|j| ends[6 * k + j]);
            (effects.length_m, effects.columns) = (0.0, Some([end(0), end(1)]));
        }
        Ok(effects)
    }

    /// Ids of the effects that act, with commas.
    pub fn names(&self) -> String {
        let any = |values: &[f64]| values.iter().any(|&x| x != 0.0);
        let names = [
            ("stress_relaxation", any(&self.branches.map(|b| b.share))),
            ("hysteresis", any(self.friction.as_flattened())),
            ("temperature_modulus", self.softer_per_kelvin != 0.0),
            ("thermal_expansion", self.growth_per_kelvin != 0.0),
            ("ageing", self.ageing_per_s != 0.0),
            ("viscous_damping", any(self.damping.as_flattened())),
            ("mullins_softening", self.softening.share != 0.0),
            ("permanent_set", self.set_share != 0.0),
        ];
        let acting: Vec<&str> = names.iter().filter(|n| n.1).map(|n| n.0).collect();
        acting.join(", ")
    }

    /// Ranges of temperature (°C) and age (s); where any will do, all finite numbers of f32.
    pub fn input_ranges(&self) -> [[f64; 2]; 2] {
        let known = [self.temperature_range_degc, self.age_range_s];
        known.map(|range| range.unwrap_or([-3e38, 3e38]))
    }

    /// Default and range of temperature (°C) and age (s), in words.
    pub fn input_words(&self) -> [String; 2] {
        let defaults = self.default_inputs();
        let all = [
            (defaults.temperature_degc, self.temperature_range_degc),
            (defaults.age_s, self.age_range_s),
        ];
        all.map(|(default, range)| match range {
            Some([low, high]) => format!("default {default}, from {low} to {high}"),
            None => format!("default {default}, any: nothing follows it"),
        })
    }

    /// The nearest constants of another precision.
    pub fn narrowed<R: Real>(&self) -> Effects<R> {
        let six = |v: Vec6<f64>| v.map(R::from_f64);
        Effects {
            length_m: R::from_f64(self.length_m),
            stiffness: self.stiffness.map(six),
            branches: self.branches.map(|branch| Branch {
                share: R::from_f64(branch.share),
                tau_s: R::from_f64(branch.tau_s),
                linear: branch.linear,
            }),
            friction: self.friction.map(six),
            slip: six(self.slip),
            play: six(self.play),
            together: self.together,
            springs: self.springs,
            of_pose: self.of_pose,
            softer_per_kelvin: R::from_f64(self.softer_per_kelvin),
            reference_degc: R::from_f64(self.reference_degc),
            growth_per_kelvin: R::from_f64(self.growth_per_kelvin),
            ageing_per_s: R::from_f64(self.ageing_per_s),
            settling_per_s: R::from_f64(self.settling_per_s),
            damping: self.damping.map(six),
            softening: Softening {
                share: R::from_f64(self.softening.share),
                width: R::from_f64(self.softening.width),
                hyperbolic: self.softening.hyperbolic,
                of_pose: six(self.softening.of_pose),
                of_wrench: six(self.softening.of_wrench),
            },
            set_share: R::from_f64(self.set_share),
            temperature_range_degc: self.temperature_range_degc.map(|r| r.map(R::from_f64)),
            age_range_s: self.age_range_s.map(|r| r.map(R::from_f64)),
            limits: self.limits.map(|r| r.map(R::from_f64)),
            columns: self.columns.map(|ends| ends.map(six)),
        }
    }
}

fn wrong(name: &'static str, found: String, expected: &'static str) -> ModelError {
    ModelError::Setting {
        name,
        found,
        expected,
    }
}

fn number(
    document: &Map<String, Value>,
    name: &'static str,
    default: Option<f64>,
) -> Result<f64, ModelError> {
    let value = match document.get(name) {
        None => default,
        Some(value) => value.as_f64().filter(|x| x.is_finite()),
    };
    value.ok_or_else(|| {
        let found = document
            .get(name)
            .map_or("missing".to_string(), Value::to_string);
        wrong(name, found, "a finite number")
    })
}

/// None where it is missing.
fn range(
    document: &Map<String, Value>,
    name: &'static str,
) -> Result<Option<[f64; 2]>, ModelError> {
    let Some(value) = document.get(name) else {
        return Ok(None);
    };
    let range = numbers::<2>(document, name)?;
    if range[0] <= range[1] {
        return Ok(Some(range));
    }
    Err(wrong(
        name,
        value.to_string(),
        "a least and a largest number",
    ))
}

/// Zeros where it is missing; six numbers are a diagonal.
fn matrix(document: &Map<String, Value>, name: &'static str) -> Result<Mat6<f64>, ModelError> {
    let count = document.get(name).and_then(Value::as_array).map(Vec::len);
    if count == Some(36) {
        let all = numbers::<36>(document, name)?;
        return Ok(core::array::from_fn(|i| {
            core::array::from_fn(|j| all[6 * i + j])
        }));
    }
    Ok(diagonal(&numbers(document, name)?))
}

/// Zeros where the list is missing.
fn numbers<const N: usize>(
    document: &Map<String, Value>,
    name: &'static str,
) -> Result<[f64; N], ModelError> {
    let Some(value) = document.get(name) else {
        return Ok([0.0; N]);
    };
    let list = value.as_array().into_iter().flatten();
    let list: Option<Vec<f64>> = list.map(Value::as_f64).collect();
    list.and_then(|list| <[f64; N]>::try_from(list).ok())
        .ok_or_else(|| {
            wrong(
                name,
                value.to_string(),
                "a list of finite numbers, one for each axis",
            )
        })
}
