//! Regressor rows of the models for which designs are made.

use ecm_poly::ModelError;
use ecm_poly::basis;
use ecm_poly::energy::regressor::regressor;
use ecm_poly::energy::{EnergyTerms, Symmetry};
use ecm_poly::error::{check_count, check_finite, check_sizes};
use ecm_poly::normalise::{ranges, to_unit};

/// A model whose coefficients enter linearly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Model {
    /// All monomials of the normalised coordinates up to a degree; one row a pose.
    Polynomial {
        /// The degree.
        degree: usize,
    },
    /// Energy in mid-frame coordinates; six rows a pose, needs all six pose coordinates.
    Energy {
        /// Highest degree in q.
        degree: usize,
        /// Symmetry of the mechanism.
        symmetry: Symmetry,
    },
}

/// Regressor of some poses.
#[derive(Debug, Clone)]
pub struct Regressor {
    /// (N * block) x terms, row-major.
    pub rows: Vec<f64>,
    /// Rows a pose.
    pub block: usize,
    /// Coefficients.
    pub terms: usize,
}

impl Regressor {
    /// Prior information of a ridge fit: lambda on each coefficient but a polynomial's constant.
    pub fn ridge(&self, lambda: f64) -> Vec<f64> {
        let free = usize::from(self.block == 1);
        let known = |i: usize| i.is_multiple_of(self.terms + 1) && i >= free;
        let entries = 0..self.terms * self.terms;
        entries
            .map(|i| if known(i) { lambda } else { 0.0 })
            .collect()
    }
}

impl Model {
    /// The model of a name: `cubic`, `poly:D`, `energyD`, `energyD-revolution`, `energyD-general`.
    pub fn from_name(name: &str) -> Option<Self> {
        let degree = match name {
            "linear" => Some(1),
            "quadratic" => Some(2),
            "cubic" => Some(3),
            _ => name
                .strip_prefix("poly:")
                .and_then(|d| d.parse().ok())
                .filter(|d| *d <= 20),
        };
        if let Some(degree) = degree {
            return Some(Self::Polynomial { degree });
        }
        let (digits, symmetry) = match name.strip_prefix("energy")?.split_once('-') {
            None => (name.strip_prefix("energy")?, Symmetry::Alike),
            Some((digits, "revolution")) => (digits, Symmetry::Revolution),
            Some((digits, "general")) => (digits, Symmetry::General),
            Some(_) => return None,
        };
        let degree = digits.parse().ok().filter(|d| (4..=6).contains(d))?;
        Some(Self::Energy { degree, symmetry })
    }

    /// Regressor at `points` (N x columns) of either kind: an energy takes the `length_m` (m) of the
    /// mechanism, a polynomial the ranges [lower, upper] of the candidates.
    ///
    /// # Errors
    /// As those of [`Model::polynomial`] and [`Model::energy`].
    pub fn regressor(
        self,
        points: &[f64],
        (lower, upper): (&[f64], &[f64]),
        length_m: f64,
    ) -> Result<Regressor, ModelError> {
        match self {
            Self::Polynomial { degree } => Self::polynomial(points, degree, lower, upper),
            Self::Energy { degree, symmetry } => {
                Self::energy(points.as_chunks().0, degree, symmetry, length_m)
            }
        }
    }

    /// Regressor of a polynomial in `points` (N x columns) mapped from [lower, upper] to [-1, 1].
    ///
    /// # Errors
    /// Wrong shapes, numbers that are not finite or too large, and a degree with too many terms.
    pub fn polynomial(
        points: &[f64],
        degree: usize,
        lower: &[f64],
        upper: &[f64],
    ) -> Result<Regressor, ModelError> {
        let columns = lower.len();
        let exponents = basis::exponents(columns, degree)?;
        check_points(points, lower, upper)?;
        let terms = exponents.len() / columns.max(1);
        if (points.len() / columns).saturating_mul(terms) > MOST_NUMBERS {
            return Err(ModelError::Setting {
                name: "degree",
                found: format!(
                    "{degree}: {terms} terms of {} poses",
                    points.len() / columns
                ),
                expected: "a regressor of at most 5e8 numbers; take a lower degree or fewer poses",
            });
        }
        let mut rows = Vec::with_capacity(points.len() / columns.max(1) * terms);
        let mut powers = vec![1.0; columns * (degree + 1)];
        for point in points.chunks_exact(columns.max(1)) {
            for (c, v) in point.iter().enumerate() {
                let unit = to_unit(*v, lower[c], upper[c]);
                for d in 1..=degree {
                    powers[c * (degree + 1) + d] = powers[c * (degree + 1) + d - 1] * unit;
                }
            }
            for term in exponents.chunks_exact(columns.max(1)) {
                let factor = |(c, e): (usize, &u8)| powers[c * (degree + 1) + usize::from(*e)];
                rows.push(term.iter().enumerate().map(factor).product::<f64>());
            }
        }
        if let Some(place) = rows.iter().position(|v| !v.is_finite()) {
            return Err(ModelError::Setting {
                name: "points",
                found: format!("row {} too far outside its ranges", place / terms),
                expected: "terms below 1e308; widen the ranges or leave out this row",
            });
        }
        Ok(Regressor {
            rows,
            block: 1,
            terms,
        })
    }

    /// Regressor of an energy model at `poses` (m, rad).
    ///
    /// Each row is divided by its component's noise, [`COMPONENT_SD`].
    ///
    /// # Errors
    /// A length that is not positive, a degree out of range, numbers that are not finite.
    pub fn energy(
        poses: &[[f64; 6]],
        degree: usize,
        symmetry: Symmetry,
        length_m: f64,
    ) -> Result<Regressor, ModelError> {
        let energy_terms = EnergyTerms::new(symmetry, degree, &[])?;
        let scale = [length_m, 1.0];
        let mut rows = regressor(poses, length_m, &energy_terms, scale)?;
        let terms = energy_terms.count();
        for (r, row) in rows.chunks_exact_mut(terms).enumerate() {
            for v in row {
                *v /= COMPONENT_SD[r % 6];
            }
        }
        check_finite("the regressor", &rows, terms)?;
        Ok(Regressor {
            rows,
            block: 6,
            terms,
        })
    }
}

/// Rows over which I-optimality averages: h and K over the workspace.
///
/// The rows of h at up to [`REGION_POSES`] evenly chosen `points`, and those of its change over
/// half the range of each of the d coordinates, each weighing 1/d. Their mean variance is that of h
/// plus that of K times half the range.
///
/// # Arguments
/// - `points`: N x columns; `lower`, `upper`: their ranges
/// - `rows_of`: regressor of any points
///
/// # Errors
/// Wrong shapes, numbers that are not finite or too large, and those of `rows_of`.
pub fn prediction_region<E: From<ModelError>>(
    points: &[f64],
    lower: &[f64],
    upper: &[f64],
    rows_of: impl Fn(&[f64]) -> Result<Regressor, E>,
) -> Result<Vec<f64>, E> {
    check_points(points, lower, upper)?;
    let columns = lower.len();
    let stride = (points.len() / columns).div_ceil(REGION_POSES).max(1);
    let sample: Vec<f64> = points
        .chunks_exact(columns)
        .step_by(stride)
        .flatten()
        .copied()
        .collect();
    let moving: Vec<usize> = (0..columns).filter(|&c| upper[c] > lower[c]).collect();
    let count = moving.len() as f64;
    // The mean is over all rows here: what is wanted is over the poses of the sample.
    let whole = (1.0 + count).sqrt();
    let Regressor {
        rows: mut region,
        terms,
        ..
    } = rows_of(&sample)?;
    region.iter_mut().for_each(|v| *v *= whole);
    for c in moving {
        let step = REGION_STEP * (upper[c] - lower[c]);
        let mut shifted = sample.clone();
        shifted
            .iter_mut()
            .skip(c)
            .step_by(columns)
            .for_each(|v| *v += step);
        let above = rows_of(&shifted)?.rows;
        shifted.copy_from_slice(&sample);
        shifted
            .iter_mut()
            .skip(c)
            .step_by(columns)
            .for_each(|v| *v -= step);
        let below = rows_of(&shifted)?.rows;
        let scale = whole / (4.0 * REGION_STEP * count.sqrt());
        region.extend(above.iter().zip(&below).map(|(a, b)| scale * (a - b)));
    }
    check_finite("the region", &region, terms)?;
    Ok(region)
}

/// Poses of a [`prediction_region`] at most.
pub const REGION_POSES: usize = 1000;
/// Step of its differences, as a share of a coordinate's range.
const REGION_STEP: f64 = 1e-4;

/// One reading's noise of the six components, N and N m: an instrument of the paper's kind, whose
/// fx carries the pose noise of the stiff axis.
pub const COMPONENT_SD: [f64; 6] = [0.9, 0.3, 0.3, 0.010, 0.012, 0.012];

/// Smallest and largest of each of the `columns` columns.
pub fn column_ranges(points: &[f64], columns: usize) -> (Vec<f64>, Vec<f64>) {
    ranges(points, columns)
}

/// Points mapped column by column from [lower, upper] to [-1, 1]; without width to 0.
///
/// # Errors
/// Wrong shapes, and numbers that are not finite or too large.
pub fn normalise(points: &[f64], lower: &[f64], upper: &[f64]) -> Result<Vec<f64>, ModelError> {
    check_points(points, lower, upper)?;
    let ranges = lower.iter().zip(upper).cycle();
    let mapped = points.iter().zip(ranges);
    Ok(mapped
        .map(|(v, (low, high))| to_unit(*v, *low, *high))
        .collect())
}

/// Most numbers of a regressor: 4 GB.
const MOST_NUMBERS: usize = 500_000_000;

/// Refuses points that do not fit their ranges, and numbers that are not finite or too large.
fn check_points(points: &[f64], lower: &[f64], upper: &[f64]) -> Result<(), ModelError> {
    let columns = lower.len();
    if columns == 0 {
        return Err(ModelError::Setting {
            name: "lower",
            found: "no numbers".into(),
            expected: "the lower end of each coordinate, of at least one",
        });
    }
    check_count("upper", "numbers", upper.len(), columns)?;
    let whole = points.len().div_ceil(columns) * columns;
    check_count("points", "numbers", points.len(), whole)?;
    check_sizes("points", points, columns)?;
    check_sizes("lower", lower, columns)?;
    check_sizes("upper", upper, columns)
}
