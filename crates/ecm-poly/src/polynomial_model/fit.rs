//! The fit of a polynomial: least squares, ridge or principal components, weighted rows.

use alloc::format;
use alloc::vec::Vec;

use crate::basis::exponents;
use crate::dense::{ThinSvd, condition_number};
use crate::error::{ModelError, check_count, check_sizes};
use crate::normalise::ranges;
use crate::polynomial::Polynomial;
use crate::polynomial_model::{FitFacts, PolynomialModel, fast_cubic, regressor};
use crate::regression::Method;
use crate::regression::leave_one_out::LeaveOneOut;
use crate::regression::triangle::Triangle;

impl PolynomialModel {
    /// Fits row-major `points` (N, inputs) to `observations` (N, outputs).
    ///
    /// `weights` (N): each row's squared residual is multiplied by its weight; they are scaled
    /// to a mean of one, so that the PCR threshold keeps its meaning. A row of weight zero is no
    /// observation: the fit is that of the other rows.
    ///
    /// # Errors
    /// Wrong shapes, no outputs, numbers that are not finite, fewer rows than terms, settings out of range.
    ///
    /// ```
    /// use ecm_poly::{Method, PolynomialModel};
    /// # fn main() -> Result<(), ecm_poly::ModelError> {
    /// let x: Vec<f64> = (0..9).map(f64::from).collect();
    /// let y: Vec<f64> = x.iter().map(|x| 1.0 + 2.0 * x * x).collect();
    /// let model = PolynomialModel::fit(&x, 1, &y, 1, 2, Method::LeastSquares, None)?;
    /// assert!((model.predict(&[3.5])?[0] - 25.5).abs() < 1e-12);
    /// assert!((model.jacobian(&[3.5])?[0] - 14.0).abs() < 1e-12);
    /// # Ok(()) }
    /// ```
    pub fn fit(
        points: &[f64],
        inputs: usize,
        observations: &[f64],
        outputs: usize,
        degree: usize,
        method: Method,
        weights: Option<&[f64]>,
    ) -> Result<Self, ModelError> {
        let table = exponents(inputs, degree)?;
        let rows = check_pairs(points, inputs, observations, outputs)?;
        if let Some(weights) = weights {
            check_count("weights", "numbers", weights.len(), rows)?;
            check_weights(weights)?;
            if weights.contains(&0.0) {
                let [points, observations, weights] =
                    [(points, inputs), (observations, outputs), (weights, 1)]
                        .map(|(values, columns)| observed(values, columns, weights));
                return Self::fit(
                    &points,
                    inputs,
                    &observations,
                    outputs,
                    degree,
                    method,
                    Some(&weights),
                );
            }
        }
        let (lower, upper) = ranges(points, inputs);
        let pairs = Pairs {
            points,
            observations,
            outputs,
            weights,
        };
        let triangle = pairs.triangle(&table, &lower, &upper)?;
        Self::of_triangle(&triangle, degree, (&lower, &upper), method)
    }

    /// Triangle of [X | Y] of row-major `points` (N, inputs) and `observations` (N, outputs), with
    /// inputs mapped from these ranges: a part of the rows of [`PolynomialModel::of_triangle`].
    pub fn triangle(
        points: &[f64],
        observations: &[f64],
        outputs: usize,
        degree: usize,
        (lower, upper): (&[f64], &[f64]),
    ) -> Result<Triangle, ModelError> {
        let table = exponents(lower.len(), degree)?;
        check_count("upper", "numbers", upper.len(), lower.len())?;
        check_pairs(points, lower.len(), observations, outputs)?;
        let pairs = Pairs {
            points,
            observations,
            outputs,
            weights: None,
        };
        pairs.triangle(&table, lower, upper)
    }

    /// The fit of a triangle of [X | Y], inputs mapped from these ranges.
    ///
    /// # Errors
    /// Ranges or columns that do not fit, fewer rows than terms, settings out of range.
    pub fn of_triangle(
        triangle: &Triangle,
        degree: usize,
        (lower, upper): (&[f64], &[f64]),
        method: Method,
    ) -> Result<Self, ModelError> {
        let table = exponents(lower.len(), degree)?;
        check_count("upper", "numbers", upper.len(), lower.len())?;
        let k = table.len() / lower.len();
        let outputs = triangle.columns().saturating_sub(k);
        check_count(
            "triangle",
            "columns",
            triangle.columns(),
            k + outputs.max(1),
        )?;
        if triangle.rows() < k {
            return Err(ModelError::TooFewRows {
                equations: triangle.rows(),
                coefficients: k,
            });
        }
        let (solution, _) = triangle.solve(k, method)?;
        let freedom = triangle.rows() as f64 - solution.effective_parameters;
        let squares = triangle.residual_squares(k, &solution.coefficients);
        let fit = FitFacts {
            condition_number: solution.condition_number,
            rank: solution.rank,
            effective_parameters: solution.effective_parameters,
            residual_variance: squares
                .iter()
                .map(|s| if freedom > 0.5 { s / freedom } else { f64::NAN })
                .collect(),
            unscaled_covariance: solution.unscaled_covariance,
        };
        let coefficients = solution.coefficients;
        Ok(Self {
            cubic: fast_cubic(degree, outputs, lower, upper, &coefficients),
            degree,
            exponents: table,
            lower: lower.to_vec(),
            upper: upper.to_vec(),
            coefficients,
            outputs,
            fit,
        })
    }

    /// κ of the regressor of row-major `points` (N, inputs) without normalisation.
    pub fn condition_number_raw(
        points: &[f64],
        inputs: usize,
        degree: usize,
    ) -> Result<f64, ModelError> {
        let table = exponents(inputs, degree)?;
        check_sizes("inputs", points, inputs)?;
        let (lower, upper) = (alloc::vec![-1.0; inputs], alloc::vec![1.0; inputs]);
        condition_number(
            &regressor(points, &table, &lower, &upper)?,
            table.len() / inputs,
        )
    }

    /// Leave-one-out errors of every PCR rank, of the regressor that [`PolynomialModel::fit`] uses.
    pub fn leave_one_out(
        points: &[f64],
        inputs: usize,
        observations: &[f64],
        outputs: usize,
        degree: usize,
    ) -> Result<LeaveOneOut, ModelError> {
        let table = exponents(inputs, degree)?;
        check_pairs(points, inputs, observations, outputs)?;
        let (lower, upper) = ranges(points, inputs);
        let normalised = regressor(points, &table, &lower, &upper)?;
        let factors = ThinSvd::new(&normalised, table.len() / inputs)?;
        LeaveOneOut::new(&factors, observations, outputs)
    }
}

/// Number of rows of finite `points` (N, inputs) and `observations` (N, outputs).
fn check_pairs(
    points: &[f64],
    inputs: usize,
    observations: &[f64],
    outputs: usize,
) -> Result<usize, ModelError> {
    let rows = points.len() / inputs;
    if outputs == 0 {
        return Err(ModelError::Setting {
            name: "outputs",
            found: "0 columns".into(),
            expected: "at least one column to fit",
        });
    }
    if rows == 0 {
        return Err(ModelError::TooFewRows {
            equations: 0,
            coefficients: 1,
        });
    }
    check_count("inputs", "numbers", points.len(), rows * inputs)?;
    let expected = rows.saturating_mul(outputs);
    check_count("outputs", "numbers", observations.len(), expected)?;
    check_sizes("inputs", points, inputs)?;
    check_sizes("outputs", observations, outputs)?;
    Ok(rows)
}

fn check_weights(weights: &[f64]) -> Result<(), ModelError> {
    // The mean of the weights, and each in units of it, must not overflow or vanish.
    let usable = |w: f64| w == 0.0 || (1e-100..=1e100).contains(&w);
    let bad = weights.iter().position(|w| !usable(*w));
    if bad.is_none() && weights.iter().any(|w| *w > 0.0) {
        return Ok(());
    }
    let found = match bad {
        Some(row) => format!("{} in row {row}", weights[row]),
        None => "0 in every row".into(),
    };
    Err(ModelError::Setting {
        name: "weights",
        found,
        expected: "0 or numbers from 1e-100 to 1e100, not all 0",
    })
}

/// The rows of row-major `values` whose weight is above zero.
fn observed(values: &[f64], columns: usize, weights: &[f64]) -> Vec<f64> {
    let rows = values.chunks_exact(columns).zip(weights);
    rows.filter(|(_, w)| **w > 0.0)
        .flat_map(|(row, _)| row)
        .copied()
        .collect()
}

/// Rows of a fit: row-major points (N, inputs) and observations (N, outputs), weights (N).
struct Pairs<'a> {
    points: &'a [f64],
    observations: &'a [f64],
    outputs: usize,
    weights: Option<&'a [f64]>,
}

impl Pairs<'_> {
    /// Triangle of [X | Y], each row times the square root of its weight over the mean weight.
    fn triangle(
        &self,
        exponents: &[u8],
        lower: &[f64],
        upper: &[f64],
    ) -> Result<Triangle, ModelError> {
        let (inputs, outputs) = (lower.len(), self.outputs);
        let k = exponents.len() / inputs;
        let rows = self.points.len() / inputs;
        let mean = self
            .weights
            .map_or(1.0, |w| w.iter().sum::<f64>() / rows as f64);
        let map = Polynomial::new(exponents, lower, upper, &[])?;
        Triangle::of_rows(rows, 1, k + outputs, |range| {
            let mut scratch = alloc::vec![0.0; map.scratch_len()];
            let mut block = alloc::vec![0.0; range.len() * (k + outputs)];
            for (i, line) in range.zip(block.chunks_exact_mut(k + outputs)) {
                let (x, y) = line.split_at_mut(k);
                map.regressor_row(&self.points[i * inputs..][..inputs], x, &mut scratch)?;
                y.copy_from_slice(&self.observations[i * outputs..][..outputs]);
                if let Some(weights) = self.weights {
                    let factor = (weights[i] / mean).sqrt();
                    line.iter_mut().for_each(|value| *value *= factor);
                }
            }
            Ok(block)
        })
    }
}
