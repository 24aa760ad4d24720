//! Evaluation of a vector polynomial of normalised inputs, without std or allocation.

use ecm_se3::Real;

use crate::normalise::{to_unit, unit_slope};
use crate::shape::ShapeError;

/// h_j(p) = Σ_t β_tj Π_i u_i^e_ti, u_i = p_i mapped from [lower_i, upper_i] to [−1, 1].
///
/// The tables are borrowed, so that they can be constants in flash memory.
#[derive(Clone, Copy, Debug)]
pub struct Polynomial<'a, R> {
    inputs: usize,
    outputs: usize,
    degree: usize,
    exponents: &'a [u8],
    lower: &'a [R],
    upper: &'a [R],
    coefficients: &'a [R],
}

impl<'a, R: Real> Polynomial<'a, R> {
    /// From exponents (k, inputs), ranges (inputs) and coefficients (k, outputs), row-major.
    ///
    /// The number of inputs is that of `lower`; the number of outputs follows from k.
    pub fn new(
        exponents: &'a [u8],
        lower: &'a [R],
        upper: &'a [R],
        coefficients: &'a [R],
    ) -> Result<Self, ShapeError> {
        let inputs = lower.len();
        ShapeError::check("upper", upper.len(), inputs)?;
        let terms = exponents.len().checked_div(inputs).unwrap_or(0);
        ShapeError::check("exponents", exponents.len(), terms * inputs)?;
        let outputs = coefficients.len().checked_div(terms).unwrap_or(0);
        ShapeError::check("coefficients", coefficients.len(), terms * outputs)?;
        let degree = exponents
            .chunks_exact(inputs.max(1))
            .map(|row| row.iter().map(|&e| usize::from(e)).sum())
            .max()
            .unwrap_or(0);
        Ok(Self {
            inputs,
            outputs,
            degree,
            exponents,
            lower,
            upper,
            coefficients,
        })
    }

    /// Length of the scratch memory of an evaluation: the powers of each input.
    pub fn scratch_len(&self) -> usize {
        self.inputs * (self.degree + 1)
    }

    /// h(p) into `value` (outputs).
    pub fn value(&self, point: &[R], value: &mut [R], scratch: &mut [R]) -> Result<(), ShapeError> {
        ShapeError::check("value", value.len(), self.outputs)?;
        self.fill_powers(point, scratch)?;
        value.fill(R::ZERO);
        for (row, weights) in self.terms() {
            let monomial = self.monomial(row, scratch, None);
            for (v, &weight) in value.iter_mut().zip(weights) {
                *v += monomial * weight;
            }
        }
        Ok(())
    }

    /// h(p) into `value` (outputs) and ∂h/∂p into `jacobian` (outputs, inputs), row-major.
    pub fn value_and_jacobian(
        &self,
        point: &[R],
        value: &mut [R],
        jacobian: &mut [R],
        scratch: &mut [R],
    ) -> Result<(), ShapeError> {
        ShapeError::check("jacobian", jacobian.len(), self.outputs * self.inputs)?;
        self.value(point, value, scratch)?;
        jacobian.fill(R::ZERO);
        for (row, weights) in self.terms() {
            for (i, &e) in row.iter().enumerate() {
                if e == 0 {
                    continue;
                }
                let slope = self.monomial(row, scratch, Some(i)) * R::from_u16(u16::from(e));
                for (line, &weight) in jacobian.chunks_exact_mut(self.inputs).zip(weights) {
                    line[i] += slope * weight;
                }
            }
        }
        for line in jacobian.chunks_exact_mut(self.inputs.max(1)) {
            for (entry, (&lower, &upper)) in line.iter_mut().zip(self.lower.iter().zip(self.upper))
            {
                *entry = *entry * unit_slope(lower, upper);
            }
        }
        Ok(())
    }

    /// All k monomials of one point into `row`: a row of the regressor X.
    pub fn regressor_row(
        &self,
        point: &[R],
        row: &mut [R],
        scratch: &mut [R],
    ) -> Result<(), ShapeError> {
        let terms = self.exponents.len() / self.inputs.max(1);
        ShapeError::check("row", row.len(), terms)?;
        self.fill_powers(point, scratch)?;
        for (entry, powers) in row
            .iter_mut()
            .zip(self.exponents.chunks_exact(self.inputs.max(1)))
        {
            *entry = self.monomial(powers, scratch, None);
        }
        Ok(())
    }

    #[inline(always)]
    fn terms(&self) -> impl Iterator<Item = (&'a [u8], &'a [R])> {
        self.exponents
            .chunks_exact(self.inputs.max(1))
            .zip(self.coefficients.chunks_exact(self.outputs.max(1)))
    }

    #[inline(always)]
    fn fill_powers(&self, point: &[R], scratch: &mut [R]) -> Result<(), ShapeError> {
        ShapeError::check("point", point.len(), self.inputs)?;
        ShapeError::check("scratch", scratch.len(), self.scratch_len())?;
        let ranges = self.lower.iter().zip(self.upper);
        for ((powers, &p), (&lower, &upper)) in scratch
            .chunks_exact_mut(self.degree + 1)
            .zip(point)
            .zip(ranges)
        {
            let u = to_unit(p, lower, upper);
            let mut power = R::ONE;
            for entry in powers {
                *entry = power;
                power = power * u;
            }
        }
        Ok(())
    }

    /// Π u_i^e_i, with the exponent of input `lowered` reduced by one.
    #[inline(always)]
    fn monomial(&self, row: &[u8], powers: &[R], lowered: Option<usize>) -> R {
        let mut product = R::ONE;
        for (i, (&e, table)) in row
            .iter()
            .zip(powers.chunks_exact(self.degree + 1))
            .enumerate()
        {
            let e = usize::from(e) - usize::from(lowered == Some(i));
            if e > 0 {
                product = product * table[e];
            }
        }
        product
    }
}
