//! The paper's model: one free polynomial per output, of normalised inputs.

use alloc::boxed::Box;
use alloc::format;
use alloc::vec::Vec;

use crate::basis::exponents;
use crate::cubic::Cubic;
use crate::cubic_bulk;
use crate::error::{ModelError, check_count, check_finite, check_sizes};
use crate::parallel::fill_pieces;
use crate::polynomial::Polynomial;

#[cfg(feature = "std")]
mod fit;

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
                residual_variance: alloc::vec![f64::NAN; outputs],
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
        let mut values = alloc::vec![0.0; rows * self.outputs];
        fill_pieces(
            points,
            self.inputs(),
            &mut values,
            self.outputs,
            |points, values| {
                let mut scratch = alloc::vec![0.0; map.scratch_len()];
                let lines = values.chunks_exact_mut(self.outputs);
                let mut rows = points.chunks_exact(self.inputs()).zip(lines);
                rows.try_for_each(|(point, value)| map.value(point, value, &mut scratch))
            },
        )?;
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
        let mut jacobians = alloc::vec![0.0; rows * size];
        fill_pieces(
            points,
            self.inputs(),
            &mut jacobians,
            size,
            |points, jacobians| {
                let mut scratch = alloc::vec![0.0; map.scratch_len()];
                let mut value = alloc::vec![0.0; self.outputs];
                let blocks = jacobians.chunks_exact_mut(size);
                let mut rows = points.chunks_exact(self.inputs()).zip(blocks);
                rows.try_for_each(|(p, k)| map.value_and_jacobian(p, &mut value, k, &mut scratch))
            },
        )?;
        check_finite("the stiffness", &jacobians, size)?;
        Ok(jacobians)
    }

    /// The one-pass evaluation of a cubic from six to six columns.
    pub(crate) fn cubic(&self) -> Option<&Cubic<f64>> {
        self.cubic.as_deref()
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
    let mut scratch = alloc::vec![0.0; map.scratch_len()];
    let mut matrix = alloc::vec![0.0; points.len() / inputs * k];
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
