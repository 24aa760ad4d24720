//! Settings of an adapter as JSON, checked, and in another precision.

use std::format;
use std::string::{String, ToString};
use std::vec::Vec;

use ecm_se3::Real;
use serde_json::{Map, Value};

use super::{Adapter, Noise, Parameter, Prior};
use crate::error::ModelError;

impl<const N: usize> Adapter<f64, N> {
    /// From an object: `parameters` (name to `start`, `sd`, `low`, `high`, `walk`, `jumps`), `noise`
    /// (`wrench`, `pose`, `time_s`, `model`, `reach`), `gravity`, `interval_s`.
    ///
    /// # Errors
    /// Another number of parameters than N, an unknown name, a number that is missing, not finite or
    /// outside its range.
    pub fn from_document(document: &Map<String, Value>) -> Result<Self, ModelError> {
        let empty = Map::new();
        let object = |key: &str| {
            document
                .get(key)
                .and_then(Value::as_object)
                .unwrap_or(&empty)
        };
        let named = object("parameters");
        let mut found = Vec::new();
        for parameter in Parameter::ALL {
            if let Some(Value::Object(prior)) = named.get(parameter.name()) {
                found.push((parameter, prior_of(prior)?));
            }
        }
        let unknown = named
            .keys()
            .find(|key| Parameter::ALL.iter().all(|p| p.name() != *key));
        if let Some(key) = unknown {
            return Err(wrong("parameters", key.clone(), "a name of docs/adapt.md"));
        }
        let count = found.len();
        let Ok(found) = <[(Parameter, Prior<f64>); N]>::try_from(found) else {
            return Err(wrong(
                "parameters",
                count.to_string(),
                "as many as the adapter has",
            ));
        };
        let noise = object("noise");
        let adapter = Self {
            parameters: found.map(|item| item.0),
            priors: found.map(|item| item.1),
            noise: Noise {
                wrench: list(noise, "wrench")?,
                pose: list(noise, "pose")?,
                time_s: number(noise, "time_s")?,
                model: list(noise, "model")?,
                reach: list(noise, "reach")?,
                rim: number(noise, "rim")?,
                middle: list(noise, "middle")?,
                per_half_range: list(noise, "per_half_range")?,
            },
            gravity: list(document, "gravity")?,
            interval_s: number(document, "interval_s")?,
        };
        adapter.check()?;
        Ok(adapter)
    }

    fn check(&self) -> Result<(), ModelError> {
        for (parameter, prior) in self.parameters.iter().zip(&self.priors) {
            let inside = prior.low <= prior.start && prior.start <= prior.high;
            if !(inside && prior.sd >= 0.0 && prior.walk >= 0.0) {
                let found = format!("{}: {prior:?}", parameter.name());
                return Err(wrong(
                    "parameters",
                    found,
                    "low <= start <= high, sd and walk >= 0",
                ));
            }
        }
        let noise = &self.noise;
        let above = |values: &[f64]| values.iter().all(|&x| x > 0.0);
        let not_below = |values: &[f64]| values.iter().all(|&x| x >= 0.0);
        if !(above(&noise.wrench) && above(&noise.reach) && not_below(&noise.pose)) {
            return Err(wrong(
                "noise",
                format!("{noise:?}"),
                "wrench and reach above 0, pose >= 0",
            ));
        }
        if !(noise.rim >= 1.0 && not_below(&noise.per_half_range)) {
            return Err(wrong(
                "noise",
                format!("{noise:?}"),
                "rim 1 or more, per_half_range >= 0",
            ));
        }
        if !(not_below(&noise.model) && noise.time_s >= 0.0) {
            return Err(wrong(
                "noise",
                format!("{noise:?}"),
                "model and time_s >= 0",
            ));
        }
        if self.interval_s <= 0.0 {
            return Err(wrong(
                "interval_s",
                self.interval_s.to_string(),
                "a time above 0 s",
            ));
        }
        Ok(())
    }

    /// The nearest numbers of another precision.
    pub fn narrowed<R: Real>(&self) -> Adapter<R, N> {
        let pair = |v: [f64; 2]| v.map(R::from_f64);
        Adapter {
            parameters: self.parameters,
            priors: self.priors.map(|p| Prior {
                start: R::from_f64(p.start),
                sd: R::from_f64(p.sd),
                low: R::from_f64(p.low),
                high: R::from_f64(p.high),
                walk: R::from_f64(p.walk),
                jumps: R::from_f64(p.jumps),
            }),
            noise: Noise {
                wrench: pair(self.noise.wrench),
                pose: pair(self.noise.pose),
                time_s: R::from_f64(self.noise.time_s),
                model: pair(self.noise.model),
                reach: pair(self.noise.reach),
                rim: R::from_f64(self.noise.rim),
                middle: self.noise.middle.map(R::from_f64),
                per_half_range: self.noise.per_half_range.map(R::from_f64),
            },
            gravity: self.gravity.map(R::from_f64),
            interval_s: R::from_f64(self.interval_s),
        }
    }
}

fn prior_of(document: &Map<String, Value>) -> Result<Prior<f64>, ModelError> {
    Ok(Prior {
        start: number(document, "start")?,
        sd: number(document, "sd")?,
        low: number(document, "low")?,
        high: number(document, "high")?,
        walk: number(document, "walk")?,
        jumps: number(document, "jumps")?,
    })
}

fn wrong(name: &'static str, found: String, expected: &'static str) -> ModelError {
    ModelError::Setting {
        name,
        found,
        expected,
    }
}

fn number(document: &Map<String, Value>, name: &'static str) -> Result<f64, ModelError> {
    let value = document.get(name);
    value
        .and_then(Value::as_f64)
        .filter(|x| x.is_finite())
        .ok_or_else(|| {
            let found = value.map_or("missing".to_string(), Value::to_string);
            wrong(name, found, "a finite number")
        })
}

fn list<const M: usize>(
    document: &Map<String, Value>,
    name: &'static str,
) -> Result<[f64; M], ModelError> {
    let value = document.get(name);
    let items = value.and_then(Value::as_array).into_iter().flatten();
    let items: Option<Vec<f64>> = items.map(Value::as_f64).collect();
    items
        .and_then(|items| <[f64; M]>::try_from(items).ok())
        .ok_or_else(|| {
            let found = value.map_or("missing".to_string(), Value::to_string);
            wrong(name, found, "a list of finite numbers, one for each axis")
        })
}
