//! A material from the name of its model and named parameters, as files give them.

use super::{Fibre, Gent, Material, MooneyRivlin, NeoHookean, Ogden, Yeoh};
use crate::FemError;
use std::collections::BTreeMap;

/// Names of the models, each with its parameters; `bulk_modulus_Pa` or `poisson_ratio`
/// (0.49 where neither is given), `fibre_direction`, `fibre_k1_Pa` and `fibre_k2` fit all.
pub const MODELS: [(&str, &[&str]); 5] = [
    ("neo_hookean", &["young_modulus_Pa"]),
    ("mooney_rivlin", &["c10_Pa", "c01_Pa"]),
    ("yeoh", &["c1_Pa", "c2_Pa", "c3_Pa"]),
    ("ogden", &["mu_Pa", "alpha"]),
    ("gent", &["shear_modulus_Pa", "j_m"]),
];

const COMMON: [&str; 5] = [
    "bulk_modulus_Pa",
    "poisson_ratio",
    "fibre_direction",
    "fibre_k1_Pa",
    "fibre_k2",
];

type Parameters = BTreeMap<String, Vec<f64>>;

/// The material `model` with `parameters`, scalars as lists of one.
///
/// # Errors
/// An unknown model or parameter, one that is missing or of the wrong length, a value out of
/// bounds.
pub fn choose(model: &str, parameters: &Parameters) -> Result<Box<dyn Material>, FemError> {
    let Some((_, own)) = MODELS.iter().find(|(name, _)| *name == model) else {
        return Err(FemError::Word {
            name: "material model",
            value: model.into(),
            expected: "\"neo_hookean\", \"mooney_rivlin\", \"yeoh\", \"ogden\" or \"gent\"",
        });
    };
    if let Some(key) = parameters
        .keys()
        .find(|key| !own.contains(&key.as_str()) && !COMMON.contains(&key.as_str()))
    {
        return Err(FemError::Material {
            model: model.into(),
            problem: format!(
                "parameter {key:?} is not known; expected {} and any of {}",
                own.join(", "),
                COMMON.join(", ")
            ),
        });
    }
    let matrix = compressible(model, parameters)?;
    if !COMMON[2..].iter().any(|key| parameters.contains_key(*key)) {
        return Ok(matrix);
    }
    let direction = list(model, parameters, "fibre_direction")?;
    let [x, y, z] = direction[..] else {
        return Err(length(model, "fibre_direction", direction.len(), 3));
    };
    let k1 = one(model, parameters, "fibre_k1_Pa")?;
    let k2 = one(model, parameters, "fibre_k2")?;
    Ok(Box::new(Fibre::new(matrix, [x, y, z], k1, k2)?))
}

fn compressible(model: &str, parameters: &Parameters) -> Result<Box<dyn Material>, FemError> {
    if parameters.contains_key("bulk_modulus_Pa") {
        if parameters.contains_key("poisson_ratio") {
            return Err(FemError::Material {
                model: model.into(),
                problem: "found bulk_modulus_Pa and poisson_ratio: give one of them".into(),
            });
        }
        return with_bulk(
            model,
            parameters,
            one(model, parameters, "bulk_modulus_Pa")?,
        );
    }
    let nu = match parameters.get("poisson_ratio") {
        Some(_) => one(model, parameters, "poisson_ratio")?,
        None => 0.49,
    };
    if !(nu > 0.0 && nu <= 0.5) {
        return Err(FemError::Parameter {
            name: "poisson_ratio",
            value: nu,
            expected: "above 0 and at most 0.5",
        });
    }
    if model == "neo_hookean" {
        let young = one(model, parameters, "young_modulus_Pa")?;
        return Ok(Box::new(NeoHookean::new(young, nu)?));
    }
    let mu = with_bulk(model, parameters, f64::INFINITY)?.shear_modulus_Pa();
    with_bulk(
        model,
        parameters,
        2.0 * mu * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu)),
    )
}

fn with_bulk(
    model: &str,
    parameters: &Parameters,
    kappa: f64,
) -> Result<Box<dyn Material>, FemError> {
    let get = |key: &'static str| one(model, parameters, key);
    Ok(match model {
        "mooney_rivlin" => Box::new(MooneyRivlin::new(get("c10_Pa")?, get("c01_Pa")?, kappa)?),
        "yeoh" => Box::new(Yeoh::new(
            [get("c1_Pa")?, get("c2_Pa")?, get("c3_Pa")?],
            kappa,
        )?),
        "gent" => Box::new(Gent::new(get("shear_modulus_Pa")?, get("j_m")?, kappa)?),
        "ogden" => {
            let (mu, alpha) = (
                list(model, parameters, "mu_Pa")?,
                list(model, parameters, "alpha")?,
            );
            if mu.len() != alpha.len() {
                return Err(length(model, "alpha", alpha.len(), mu.len()));
            }
            let terms = mu.iter().copied().zip(alpha.iter().copied()).collect();
            Box::new(Ogden::new(terms, kappa)?)
        }
        _ => {
            let young = get("young_modulus_Pa")?;
            // E and κ give ν = (3 κ − E) / (6 κ).
            Box::new(NeoHookean::new(young, 0.5 - young / (6.0 * kappa))?)
        }
    })
}

fn list<'a>(
    model: &str,
    parameters: &'a Parameters,
    key: &'static str,
) -> Result<&'a [f64], FemError> {
    parameters
        .get(key)
        .map(Vec::as_slice)
        .ok_or_else(|| FemError::Material {
            model: model.into(),
            problem: format!("parameter {key:?} is missing"),
        })
}

fn one(model: &str, parameters: &Parameters, key: &'static str) -> Result<f64, FemError> {
    match list(model, parameters, key)? {
        [value] => Ok(*value),
        other => Err(length(model, key, other.len(), 1)),
    }
}

fn length(model: &str, key: &'static str, found: usize, expected: usize) -> FemError {
    FemError::Material {
        model: model.into(),
        problem: format!("parameter {key:?} has {found} numbers, expected {expected}"),
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    fn table(entries: &[(&str, &[f64])]) -> Parameters {
        let own = entries.iter();
        own.map(|(k, v)| ((*k).to_string(), v.to_vec())).collect()
    }

    #[test]
    fn moduli_follow_from_the_parameters() {
        let yeoh: &[(&str, &[f64])] = &[("c1_Pa", &[1e5]), ("c2_Pa", &[0.0]), ("c3_Pa", &[0.0])];
        let material = choose("yeoh", &table(yeoh)).unwrap();
        assert!((material.shear_modulus_Pa() - 2e5).abs() < 1e-6);
        let kappa = 2.0 * 2e5 * 1.49 / (3.0 * 0.02);
        assert!((material.bulk_modulus_Pa() / kappa - 1.0).abs() < 1e-12);
        let neo = choose(
            "neo_hookean",
            &table(&[("young_modulus_Pa", &[6e5]), ("bulk_modulus_Pa", &[1e7])]),
        )
        .unwrap();
        assert!((neo.bulk_modulus_Pa() / 1e7 - 1.0).abs() < 1e-12);
        let stiff = table(&[
            ("mu_Pa", &[2e5]),
            ("alpha", &[2.0]),
            ("poisson_ratio", &[0.5]),
        ]);
        assert!(
            choose("ogden", &stiff)
                .unwrap()
                .bulk_modulus_Pa()
                .is_infinite()
        );
    }

    #[test]
    fn what_is_wrong_is_named() {
        for (model, entries, word) in [
            ("yeho", &[][..], "yeho"),
            ("gent", &[("shear_modulus_Pa", &[1e5][..])][..], "j_m"),
            ("gent", &[("lock", &[1e5][..])][..], "lock"),
            (
                "ogden",
                &[("mu_Pa", &[1.0, 2.0][..]), ("alpha", &[2.0][..])][..],
                "alpha",
            ),
            (
                "neo_hookean",
                &[
                    ("young_modulus_Pa", &[1e6][..]),
                    ("poisson_ratio", &[0.6][..]),
                ][..],
                "poisson_ratio",
            ),
        ] {
            let error = choose(model, &table(entries)).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
