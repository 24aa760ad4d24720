//! What a file of a material model states: its names, how it is made, how a fit varies it.

use super::Material;
use crate::FemError;
use std::collections::BTreeMap;

/// Parameters that every model takes; `bulk_modulus_Pa` or `poisson_ratio`, 0.49 where neither
/// is given, and one family of fibres.
pub const COMMON: [&str; 5] = [
    "bulk_modulus_Pa",
    "poisson_ratio",
    "fibre_direction",
    "fibre_k1_Pa",
    "fibre_k2",
];

/// Numbers by the parameter's name, scalars as lists of one.
pub type Parameters = BTreeMap<String, Vec<f64>>;

type Make = fn(&Values<'_>, Volume) -> Result<Box<dyn Material>, FemError>;

/// A material model: one constant of its file, one entry of [`super::MODELS`].
#[derive(Debug)]
pub struct Model {
    /// Its name in files.
    pub name: &'static str,
    /// Its own parameters, in the order of `decode`'s numbers.
    pub parameters: &'static [&'static str],
    /// Whether each parameter is a list with one number per term.
    pub has_terms: bool,
    /// The material from its parameters.
    pub(super) make: Make,
    /// See [`Model::start`].
    pub(super) start: fn(shear_modulus_Pa: f64, terms: usize) -> Vec<f64>,
    /// See [`Model::decode`].
    pub(super) decode: fn(&[f64]) -> Vec<f64>,
}

impl Model {
    /// Free variables of a solid with this shear modulus; `terms` counts for lists of terms only.
    ///
    /// # Errors
    /// No terms, or more than 4.
    pub fn start(&self, shear_modulus_Pa: f64, terms: usize) -> Result<Vec<f64>, FemError> {
        if (1..=4).contains(&terms) {
            return Ok((self.start)(shear_modulus_Pa, terms));
        }
        Err(FemError::Size {
            what: "terms",
            found: terms,
            expected: 4,
            why: "at least one term and at most four",
        })
    }

    /// Parameters, one after the other, of free variables, which have no limits: the energy is
    /// stable for each.
    ///
    /// # Errors
    /// A number of variables that does not fit the parameters.
    pub fn decode(&self, free: &[f64]) -> Result<Vec<f64>, FemError> {
        let own = self.parameters.len();
        let fits = if self.has_terms {
            !free.is_empty() && free.len().is_multiple_of(own)
        } else {
            free.len() == own
        };
        if fits {
            return Ok((self.decode)(free));
        }
        Err(FemError::Size {
            what: "free variables",
            found: free.len(),
            expected: own,
            why: "one for each parameter, or for each term of each parameter",
        })
    }
}

/// How much a material changes its volume.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Volume {
    /// Bulk modulus κ, Pa.
    BulkModulusPa(f64),
    /// Poisson's ratio ν at small strain, in (0, 0.5].
    PoissonRatio(f64),
}

impl Volume {
    /// κ = 2 μ (1 + ν) / (3 (1 − 2 ν)) with the shear modulus μ in Pa.
    pub fn bulk_modulus_Pa(self, shear_modulus_Pa: f64) -> f64 {
        match self {
            Self::BulkModulusPa(kappa) => kappa,
            Self::PoissonRatio(nu) => {
                2.0 * shear_modulus_Pa * (1.0 + nu) / (3.0 * (1.0 - 2.0 * nu))
            }
        }
    }
}

/// Named numbers of one material, with errors that name the model.
#[derive(Debug, Clone, Copy)]
pub struct Values<'a> {
    model: &'static str,
    numbers: &'a Parameters,
}

impl<'a> Values<'a> {
    pub(super) fn new(model: &'static str, numbers: &'a Parameters) -> Self {
        Self { model, numbers }
    }

    /// Whether the parameter is given.
    pub(super) fn has(&self, key: &str) -> bool {
        self.numbers.contains_key(key)
    }

    /// The numbers of one parameter.
    pub(super) fn list(&self, key: &'static str) -> Result<&'a [f64], FemError> {
        let numbers = self.numbers.get(key).map(Vec::as_slice);
        numbers.ok_or_else(|| self.problem(format!("parameter {key:?} is missing")))
    }

    /// The number of a parameter that has one.
    pub(super) fn one(&self, key: &'static str) -> Result<f64, FemError> {
        match self.list(key)? {
            [value] => Ok(*value),
            other => Err(self.length(key, other.len(), 1)),
        }
    }

    pub(super) fn length(&self, key: &'static str, found: usize, expected: usize) -> FemError {
        self.problem(format!(
            "parameter {key:?} has {found} numbers, expected {expected}"
        ))
    }

    pub(super) fn problem(&self, problem: String) -> FemError {
        FemError::Material {
            model: self.model.into(),
            problem,
        }
    }
}

/// e^x of each free variable: parameters that are positive.
pub(super) fn positive_parameters(x: &[f64]) -> Vec<f64> {
    x.iter().map(|v| v.exp()).collect()
}
