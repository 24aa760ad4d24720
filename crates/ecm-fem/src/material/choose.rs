//! A material from the name of its model and named parameters, as files give them.

use super::{COMMON, Fibre, MODELS, Material, Model, Parameters, Values, Volume};
use crate::FemError;

/// The model `name`.
///
/// # Errors
/// An unknown name.
pub fn model(name: &str) -> Result<&'static Model, FemError> {
    MODELS
        .iter()
        .copied()
        .find(|m| m.name == name)
        .ok_or_else(|| {
            let known: Vec<&str> = MODELS.iter().map(|m| m.name).collect();
            FemError::Material {
                model: name.into(),
                problem: format!("no such model; expected one of {}", known.join(", ")),
            }
        })
}

/// The material `name` with `parameters`, scalars as lists of one.
///
/// # Errors
/// An unknown model or parameter, one that is missing or of the wrong length, a value out of
/// bounds.
pub fn choose(name: &str, parameters: &Parameters) -> Result<Box<dyn Material>, FemError> {
    let model = model(name)?;
    let values = Values::new(model.name, parameters);
    if let Some(key) = parameters
        .keys()
        .find(|key| !model.parameters.contains(&key.as_str()) && !COMMON.contains(&key.as_str()))
    {
        return Err(values.problem(format!(
            "parameter {key:?} is not known; expected {} and any of {}",
            model.parameters.join(", "),
            COMMON.join(", ")
        )));
    }
    let matrix = (model.make)(&values, volume(&values)?)?;
    if !COMMON[2..].iter().any(|key| parameters.contains_key(*key)) {
        return Ok(matrix);
    }
    let direction = values.list("fibre_direction")?;
    let [x, y, z] = direction[..] else {
        return Err(values.length("fibre_direction", direction.len(), 3));
    };
    let (k1, k2) = (values.one("fibre_k1_Pa")?, values.one("fibre_k2")?);
    Ok(Box::new(Fibre::new(matrix, [x, y, z], k1, k2)?))
}

fn volume(values: &Values<'_>) -> Result<Volume, FemError> {
    match (values.has("bulk_modulus_Pa"), values.has("poisson_ratio")) {
        (true, true) => {
            Err(values.problem("found bulk_modulus_Pa and poisson_ratio: give one of them".into()))
        }
        (true, false) => Ok(Volume::BulkModulusPa(values.one("bulk_modulus_Pa")?)),
        (false, given) => {
            let nu = if given {
                values.one("poisson_ratio")?
            } else {
                0.49
            };
            if nu > 0.0 && nu <= 0.5 {
                return Ok(Volume::PoissonRatio(nu));
            }
            Err(FemError::Parameter {
                name: "poisson_ratio",
                value: nu,
                expected: "above 0 and at most 0.5",
            })
        }
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
