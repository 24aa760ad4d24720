//! The paper's model: one free polynomial per output, of normalised inputs.

use std::boxed::Box;
use std::format;
use std::vec::Vec;

use crate::basis::exponents;
use crate::cubic::Cubic;
use crate::cubic_bulk;
use crate::dense::{ThinSvd, condition_number};
use crate::error::{ModelError, check_count, check_finite, check_sizes};
use crate::normalise::ranges;
use crate::polynomial::Polynomial;
use crate::regression::leave_one_out::LeaveOneOut;
use crate::regression::{Method, Solution, solve};

/// n inputs to m outputs by polynomials of one degree; n = m = 6 for a pose-to-wrench map.
#[derive(Clone, Debug)]
pub struct PolynomialModel {
    degree: usize,
    exponents: Vec<u8>,
    lower: Vec<f64>,
    upper: Vec<f64>,
    coefficients: Vec<f64>,
    outputs: usize,
    fit: FitFacts,
    /// The same coefficients for fast evaluation; only for six inputs and outputs at degree 3.
    cubic: Option<Box<Cubic<f64>>>,
}

/// Quality of the fit of a polynomial; NaN for a model made from coefficients.
#[derive(Clone, Debug)]
pub struct FitFacts {
    /// Condition number κ of the normalised regressor, over the singular values in use.
    pub condition_number: f64,
    /// Number of singular values in use.
    pub rank: usize,
    /// tr(2H − H²) of the hat matrix H.
    pub effective_parameters: f64,
    /// s² per output: squared residual per degree of freedom; NaN without degrees of freedom.
    pub residual_variance: Vec<f64>,
    /// (XᵀX)⁻¹ over the singular values in use, row-major (k, k).
    pub unscaled_covariance: Vec<f64>,
}

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
        let k = table.len() / inputs;
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
        if rows < k {
            return Err(ModelError::TooFewRows {
                equations: rows,
                coefficients: k,
            });
        }
        let (lower, upper) = ranges(points, inputs);
        let mut normalised = regressor(points, &table, &lower, &upper)?;
        let mut targets = observations.to_vec();
        if let Some(weights) = weights {
            apply_weights(weights, &mut normalised, k);
            apply_weights(weights, &mut targets, outputs);
        }
        let Solution {
            coefficients,
            rank,
            condition_number,
            effective_parameters,
            unscaled_covariance,
        } = solve(&ThinSvd::new(&normalised, k)?, &targets, outputs, method)?;
        let freedom = rows as f64 - effective_parameters;
        let squares = residual_squares(&normalised, &coefficients, &targets, outputs);
        let fit = FitFacts {
            condition_number,
            rank,
            effective_parameters,
            residual_variance: squares
                .iter()
                .map(|s| if freedom > 0.5 { s / freedom } else { f64::NAN })
                .collect(),
            unscaled_covariance,
        };
        Ok(Self {
            cubic: fast_cubic(degree, outputs, &lower, &upper, &coefficients),
            degree,
            exponents: table,
            lower,
            upper,
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
        let (lower, upper) = (std::vec![-1.0; inputs], std::vec![1.0; inputs]);
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

    /// From coefficients (k, outputs), row-major, of inputs normalised from [lower, upper].
    pub fn from_coefficients(
        degree: usize,
        lower: &[f64],
        upper: &[f64],
        coefficients: &[f64],
    ) -> Result<Self, ModelError> {
        let inputs = lower.len();
        check_count("upper", "numbers", upper.len(), inputs)?;
        let exponents = exponents(inputs, degree)?;
        let k = exponents.len() / inputs;
        check_sizes("lower", lower, inputs)?;
        check_sizes("upper", upper, inputs)?;
        let outputs = coefficients.len() / k;
        if outputs == 0 || coefficients.len() != k * outputs {
            return Err(ModelError::Setting {
                name: "coefficients",
                found: format!("{} numbers", coefficients.len()),
                expected: "k = C(degree + inputs, degree) rows of at least one output",
            });
        }
        check_finite("coefficients", coefficients, outputs)?;
        if let Some(i) = (0..inputs).find(|&i| lower[i] > upper[i]) {
            return Err(ModelError::Setting {
                name: "lower",
                found: format!("{} above upper {} at input {i}", lower[i], upper[i]),
                expected: "lower ≤ upper",
            });
        }
        Ok(Self {
            cubic: fast_cubic(degree, outputs, lower, upper, coefficients),
            degree,
            exponents,
            lower: lower.to_vec(),
            upper: upper.to_vec(),
            coefficients: coefficients.to_vec(),
            outputs,
            fit: FitFacts {
                condition_number: f64::NAN,
                rank: k,
                effective_parameters: k as f64,
                residual_variance: std::vec![f64::NAN; outputs],
                unscaled_covariance: Vec::new(),
            },
        })
    }

    /// The model as a polynomial that borrows its tables.
    pub fn map(&self) -> Result<Polynomial<'_, f64>, ModelError> {
        Ok(Polynomial::new(
            &self.exponents,
            &self.lower,
            &self.upper,
            &self.coefficients,
        )?)
    }

    /// ĥ (N, outputs) of row-major points (N, inputs).
    pub fn predict(&self, points: &[f64]) -> Result<Vec<f64>, ModelError> {
        let map = self.map()?;
        let rows = self.rows_of(points)?;
        if let Some(cubic) = &self.cubic {
            let values = cubic_bulk::values(cubic, points);
            check_finite("the prediction", &values, self.outputs)?;
            return Ok(values);
        }
        let mut scratch = std::vec![0.0; map.scratch_len()];
        let mut values = std::vec![0.0; rows * self.outputs];
        let lines = values.chunks_exact_mut(self.outputs);
        for (point, value) in points.chunks_exact(self.inputs()).zip(lines) {
            map.value(point, value, &mut scratch)?;
        }
        check_finite("the prediction", &values, self.outputs)?;
        Ok(values)
    }

    /// ∂ĥ/∂p (N, outputs, inputs) of row-major points (N, inputs); the paper's K.
    pub fn jacobian(&self, points: &[f64]) -> Result<Vec<f64>, ModelError> {
        let map = self.map()?;
        let rows = self.rows_of(points)?;
        if let Some(cubic) = &self.cubic {
            let jacobians = cubic_bulk::jacobians(cubic, points);
            check_finite("the stiffness", &jacobians, 36)?;
            return Ok(jacobians);
        }
        let size = self.outputs * self.inputs();
        let mut scratch = std::vec![0.0; map.scratch_len()];
        let mut value = std::vec![0.0; self.outputs];
        let mut jacobians = std::vec![0.0; rows * size];
        let blocks = jacobians.chunks_exact_mut(size);
        for (point, block) in points.chunks_exact(self.inputs()).zip(blocks) {
            map.value_and_jacobian(point, &mut value, block, &mut scratch)?;
        }
        check_finite("the stiffness", &jacobians, size)?;
        Ok(jacobians)
    }

    pub(crate) fn rows_of(&self, points: &[f64]) -> Result<usize, ModelError> {
        let rows = points.len() / self.inputs();
        check_count("inputs", "numbers", points.len(), rows * self.inputs())?;
        check_finite("inputs", points, self.inputs())?;
        Ok(rows)
    }

    /// Highest degree of a term.
    pub fn degree(&self) -> usize {
        self.degree
    }
    /// Number of inputs n.
    pub fn inputs(&self) -> usize {
        self.lower.len()
    }
    /// Number of outputs m.
    pub fn outputs(&self) -> usize {
        self.outputs
    }
    /// (k, inputs), row-major.
    pub fn exponents(&self) -> &[u8] {
        &self.exponents
    }
    /// Inputs that map to −1.
    pub fn lower(&self) -> &[f64] {
        &self.lower
    }
    /// Inputs that map to 1.
    pub fn upper(&self) -> &[f64] {
        &self.upper
    }
    /// (k, outputs), row-major.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }
    /// Quality of the fit.
    pub fn facts(&self) -> &FitFacts {
        &self.fit
    }
}

fn fast_cubic(
    degree: usize,
    outputs: usize,
    lower: &[f64],
    upper: &[f64],
    coefficients: &[f64],
) -> Option<Box<Cubic<f64>>> {
    if (lower.len(), outputs, degree) != (6, 6, 3) {
        return None;
    }
    Cubic::new(lower, upper, coefficients).ok().map(Box::new)
}

/// X (N, k), row-major, of row-major points and exponents (k, inputs).
pub fn regressor(
    points: &[f64],
    exponents: &[u8],
    lower: &[f64],
    upper: &[f64],
) -> Result<Vec<f64>, ModelError> {
    let inputs = lower.len().max(1);
    let map = Polynomial::new(exponents, lower, upper, &[])?;
    let k = exponents.len() / inputs;
    let mut scratch = std::vec![0.0; map.scratch_len()];
    let mut matrix = std::vec![0.0; points.len() / inputs * k];
    for (point, row) in points
        .chunks_exact(inputs)
        .zip(matrix.chunks_exact_mut(k.max(1)))
    {
        map.regressor_row(point, row, &mut scratch)?;
    }
    Ok(matrix)
}

/// X (N, k) of the monomials up to `degree`, inputs mapped from [lower, upper] to [−1, 1].
pub fn polynomial_regressor(
    points: &[f64],
    degree: usize,
    lower: &[f64],
    upper: &[f64],
) -> Result<Vec<f64>, ModelError> {
    check_count("upper", "numbers", upper.len(), lower.len())?;
    let inputs = lower.len();
    let table = exponents(inputs, degree)?;
    let rows = points.len() / inputs;
    check_count("inputs", "numbers", points.len(), rows * inputs)?;
    for (name, values) in [("inputs", points), ("lower", lower), ("upper", upper)] {
        check_sizes(name, values, inputs)?;
    }
    let matrix = regressor(points, &table, lower, upper)?;
    check_finite("the regressor", &matrix, table.len() / inputs)?;
    Ok(matrix)
}

/// Σ (y − X β)² of each output.
fn residual_squares(
    matrix: &[f64],
    coefficients: &[f64],
    targets: &[f64],
    outputs: usize,
) -> Vec<f64> {
    let k = coefficients.len() / outputs;
    let mut squares = std::vec![0.0; outputs];
    for (row, y) in matrix.chunks_exact(k).zip(targets.chunks_exact(outputs)) {
        let mut residual = y.to_vec();
        for (x, weights) in row.iter().zip(coefficients.chunks_exact(outputs)) {
            for (e, w) in residual.iter_mut().zip(weights) {
                *e -= x * w;
            }
        }
        for (square, e) in squares.iter_mut().zip(&residual) {
            *square += e * e;
        }
    }
    squares
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

/// Multiplies rows by the square root of weight over mean weight.
fn apply_weights(weights: &[f64], matrix: &mut [f64], columns: usize) {
    let mean = weights.iter().sum::<f64>() / weights.len() as f64;
    for (line, w) in matrix.chunks_exact_mut(columns).zip(weights) {
        let factor = (w / mean).sqrt();
        line.iter_mut().for_each(|x| *x *= factor);
    }
}
