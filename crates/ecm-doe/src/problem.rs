//! The candidates as information: whitened regressor blocks and the rows that are fixed.

use crate::DesignError;
use crate::linalg::{
    add_transposed_product, cholesky, inverse, log_det, lower_inverse, product_transposed,
};

/// The objective of a design.
#[derive(Debug, Clone)]
pub(crate) enum Objective {
    /// log det M, to be large.
    Determinant,
    /// tr(M^-1 B) with B = H H', to be small; holds H (k x k) in whitened coordinates.
    Trace(Vec<f64>),
    /// share log det M - (1 - share) k log tr(M^-1 H H'), to be large.
    Compound {
        /// H, k x k.
        half: Vec<f64>,
        /// Share of the determinant, 0 to 1.
        share: f64,
    },
}

impl Objective {
    /// H and the share of the determinant of the criteria that hold a trace.
    pub(crate) fn trace_part(&self) -> Option<(&[f64], f64)> {
        match self {
            Self::Determinant => None,
            Self::Trace(half) => Some((half, 0.0)),
            Self::Compound { half, share } => Some((half, *share)),
        }
    }
}

/// Candidates of a model-based design in coordinates in which their mean information is I.
///
/// Each pose i has a block A_i of `block` rows; a design w has M(w) = F + sum w_i A_i' A_i
/// with F the information of the rows that are fixed. Determinants change under the
/// whitening X <- X R^-1 only by the constant `shift` = log det R'R, so designs do not.
#[derive(Debug, Clone)]
pub struct Problem {
    /// Number of candidate poses N.
    pub(crate) poses: usize,
    /// Regressor rows of a pose.
    pub(crate) block: usize,
    /// Number of coefficients k.
    pub(crate) terms: usize,
    /// (N * block) x k, whitened.
    pub(crate) rows: Vec<f64>,
    /// F, k x k, whitened.
    pub(crate) fixed: Vec<f64>,
    /// log det R'R.
    pub(crate) shift: f64,
    /// Candidates that may still be chosen.
    pub(crate) available: Vec<bool>,
    /// R^-1 transposed, k x k: whitens a column vector x as `back * x`.
    pub(crate) back: Vec<f64>,
    pub(crate) objective: Objective,
    /// Variance of a whitened coefficient above which a design counts as singular.
    most_variance: f64,
}

/// [`Problem::most_variance`] as a multiple of that of one average pose. A singular matrix has
/// rounding of 1e10 and more there, which exchanges would mistake for gains.
const MOST_VARIANCE: f64 = 1e9;
/// The same where a weak prior alone may determine a coefficient.
const MOST_VARIANCE_WITH_PRIOR: f64 = 1e12;

impl Problem {
    /// Whitens the (N * block) x k regressor `rows`; `prior` (k x k) is prior information.
    ///
    /// # Errors
    /// Wrong shapes, numbers that are not finite, and candidates that cannot determine the
    /// model even with the prior.
    pub fn new(
        rows: &[f64],
        block: usize,
        terms: usize,
        prior: Option<&[f64]>,
    ) -> Result<Self, DesignError> {
        let stride = block.saturating_mul(terms);
        if stride == 0 || rows.is_empty() {
            return Err(DesignError::Empty);
        }
        check_blocks("the regressor", rows, stride)?;
        check_sizes("the regressor", rows, terms, LEAST_SIZE)?;
        let poses = rows.len() / stride;
        let k = terms;
        match prior {
            Some(prior) => check_prior(prior, k)?,
            // Before the k x k matrices: so few rows cannot determine k coefficients.
            None if poses * block < k => {
                return Err(DesignError::RankDeficient {
                    candidates: poses,
                    column: poses * block,
                });
            }
            None => {}
        }
        let mut moment = prior.map_or_else(|| vec![0.0; k * k], <[f64]>::to_vec);
        add_transposed_product(&mut moment, (k, poses * block, k), rows, rows);
        // Twice: the first factor leaves an error of kappa^2 eps, the second removes it.
        let (first, shift_1) = whitening(&moment, poses, k)?;
        let mut fixed = prior.map_or_else(|| vec![0.0; k * k], |p| congruence(p, &first, k));
        let mut moment = fixed.clone();
        let mut once = vec![0.0; CHUNK.min(poses * block) * k];
        for part in rows.chunks(CHUNK * k) {
            let out = &mut once[..part.len()];
            product_transposed(out, (part.len() / k, k, k), part, &first);
            add_transposed_product(&mut moment, (k, part.len() / k, k), out, out);
        }
        let (second, shift_2) = whitening(&moment, poses, k)?;
        fixed = congruence(&fixed, &second, k);
        check_information("the prior", &fixed)?;
        let mut back = vec![0.0; k * k];
        crate::linalg::product(&mut back, (k, k, k), &second, &first);
        let mut white = vec![0.0; rows.len()];
        product_transposed(&mut white, (poses * block, k, k), rows, &back);
        Ok(Self {
            poses,
            block,
            terms,
            rows: white,
            fixed,
            shift: shift_1 + shift_2,
            available: vec![true; poses],
            back,
            objective: Objective::Determinant,
            most_variance: if prior.is_some() {
                MOST_VARIANCE_WITH_PRIOR
            } else {
                MOST_VARIANCE
            },
        })
    }

    /// log det R'R: added to a whitened log det, it gives that of the given coordinates.
    pub fn log_det_shift(&self) -> f64 {
        self.shift
    }

    /// Rows of pose i, block x k.
    pub(crate) fn pose(&self, i: usize) -> &[f64] {
        let stride = self.block * self.terms;
        &self.rows[i * stride..(i + 1) * stride]
    }

    /// Adds A_i' A_i to the fixed information.
    pub(crate) fn fix(&mut self, i: usize) {
        let (b, k) = (self.block, self.terms);
        let rows = self.pose(i).to_vec();
        add_transposed_product(&mut self.fixed, (k, b, k), &rows, &rows);
    }

    /// Adds raw regressor rows measured before (any number x k) to the fixed information.
    ///
    /// # Errors
    /// Rows so much larger than those of the candidates that variances would vanish beside them.
    pub(crate) fn fix_rows(&mut self, rows: &[f64]) -> Result<(), DesignError> {
        let k = self.terms;
        let count = rows.len() / k;
        let mut white = vec![0.0; rows.len()];
        product_transposed(&mut white, (count, k, k), rows, &self.back);
        add_transposed_product(&mut self.fixed, (k, count, k), &white, &white);
        check_information("the measured rows", &self.fixed)
    }

    /// F + the information of `design`, whitened.
    pub(crate) fn information(&self, design: &[usize]) -> Vec<f64> {
        let (b, k) = (self.block, self.terms);
        let mut m = self.fixed.clone();
        let rows: Vec<f64> = design
            .iter()
            .flat_map(|&i| self.pose(i).iter().copied())
            .collect();
        add_transposed_product(&mut m, (k, design.len() * b, k), &rows, &rows);
        m
    }

    /// log det M and M^-1 (whitened); `None` where M is singular but for rounding.
    pub(crate) fn regular_inverse(&self, m: &[f64]) -> Option<(f64, Vec<f64>)> {
        let k = self.terms;
        let (log_det, inverse) = inverse(m, k).ok()?;
        let regular = (0..k).all(|i| inverse[i * k + i] < self.most_variance);
        regular.then_some((log_det, inverse))
    }

    /// log det of F + the information of `design` in the given (not whitened) coordinates.
    pub fn log_det(&self, design: &[usize]) -> Option<f64> {
        self.regular_inverse(&self.information(design))
            .map(|(v, _)| v + self.shift)
    }
}

/// Number of regressor rows that are whitened at once.
const CHUNK: usize = 8192;

/// R^-T (lower triangular) with R'R = moment / poses, and log det R'R.
fn whitening(moment: &[f64], poses: usize, k: usize) -> Result<(Vec<f64>, f64), DesignError> {
    let scale: Vec<f64> = (0..k)
        .map(|j| (moment[j * k + j] / poses as f64).sqrt())
        .collect();
    if let Some(column) = scale.iter().position(|s| !(*s > 0.0 && s.is_finite())) {
        return Err(DesignError::RankDeficient {
            candidates: poses,
            column,
        });
    }
    let mut l = vec![0.0; k * k];
    for i in 0..k {
        for j in 0..k {
            l[i * k + j] = moment[i * k + j] / (poses as f64 * scale[i] * scale[j]);
        }
    }
    // Dependent columns leave a pivot of the size of rounding, about k eps.
    cholesky(&mut l, k, 1e-13).map_err(|column| DesignError::RankDeficient {
        candidates: poses,
        column,
    })?;
    let shift = log_det(&l, k) + 2.0 * scale.iter().map(|s| s.ln()).sum::<f64>();
    let mut inv = lower_inverse(&l, k);
    for i in 0..k {
        for j in 0..k {
            inv[i * k + j] /= scale[j];
        }
    }
    Ok((inv, shift))
}

/// T A T'.
fn congruence(a: &[f64], t: &[f64], k: usize) -> Vec<f64> {
    let mut half = vec![0.0; k * k];
    crate::linalg::product(&mut half, (k, k, k), t, a);
    let mut full = vec![0.0; k * k];
    product_transposed(&mut full, (k, k, k), &half, t);
    full
}

/// Refuses NaN and infinite numbers; the error names the first.
pub(crate) fn check_finite(
    what: &'static str,
    values: &[f64],
    columns: usize,
) -> Result<(), DesignError> {
    match values.iter().position(|v| !v.is_finite()) {
        None => Ok(()),
        Some(at) => Err(DesignError::NotFinite {
            what,
            row: at / columns,
            column: at % columns,
            value: values[at],
        }),
    }
}

/// Largest size of a number whose products and squares stay finite.
const MOST_SIZE: f64 = 1e100;
/// Least size of the largest number of a column whose squares do not vanish.
const LEAST_SIZE: f64 = 1e-100;

/// Refuses numbers that are not a whole number of blocks of this size.
pub(crate) fn check_blocks(
    what: &'static str,
    values: &[f64],
    size: usize,
) -> Result<(), DesignError> {
    let (found, blocks) = (values.len(), values.len().div_ceil(size));
    let expected = blocks.saturating_mul(size);
    if found == expected {
        return Ok(());
    }
    Err(DesignError::Shape {
        what,
        found,
        expected,
    })
}

/// [`check_finite`], and refuses numbers whose squares overflow and columns without a number of
/// size `least` that are not all 0.
pub(crate) fn check_sizes(
    what: &'static str,
    values: &[f64],
    columns: usize,
    least: f64,
) -> Result<(), DesignError> {
    check_finite(what, values, columns)?;
    let mut largest = vec![(0.0_f64, 0); columns];
    for (row, line) in values.chunks_exact(columns).enumerate() {
        for (most, value) in largest.iter_mut().zip(line) {
            if value.abs() > most.0 {
                *most = (value.abs(), row);
            }
        }
    }
    let sizes = least..=MOST_SIZE;
    match largest
        .iter()
        .position(|(size, _)| *size > 0.0 && !sizes.contains(size))
    {
        None => Ok(()),
        Some(column) => Err(DesignError::Size {
            what,
            row: largest[column].1,
            column,
            value: values[largest[column].1 * columns + column],
            expected: if largest[column].0 > MOST_SIZE {
                "sizes of at most 1e100"
            } else {
                "a size of at least 1e-100 somewhere in the column, or 0 throughout"
            },
        }),
    }
}

/// Sizes of information, measured by that of the candidates, whose products and quotients neither
/// overflow nor vanish: tr(M^-1 B) of a small B beside a large M.
pub(crate) const INFORMATION: std::ops::RangeInclusive<f64> = 1e-100..=1e100;

/// Refuses information that is too large beside that of the candidates.
fn check_information(what: &'static str, information: &[f64]) -> Result<(), DesignError> {
    let size = |v: &f64| if v.is_nan() { f64::INFINITY } else { v.abs() };
    let found = information.iter().map(size).fold(0.0, f64::max);
    if found <= *INFORMATION.end() {
        return Ok(());
    }
    Err(DesignError::Information { what, found })
}

/// Refuses prior information that is not finite, symmetric and free of negative directions.
fn check_prior(prior: &[f64], k: usize) -> Result<(), DesignError> {
    if k.checked_mul(k) != Some(prior.len()) {
        return Err(DesignError::Shape {
            what: "the prior",
            found: prior.len(),
            expected: k.saturating_mul(k),
        });
    }
    check_finite("the prior", prior, k)?;
    let root = |i: usize| prior[i * k + i].max(0.0).sqrt();
    let mut unit = vec![0.0; k * k];
    for i in 0..k {
        for j in 0..k {
            let size = root(i) * root(j);
            let (value, mirrored) = (prior[i * k + j], prior[j * k + i]);
            let skew = (value - mirrored).abs();
            if prior[i * k + i] < 0.0 || skew > 1e-9 * size || skew.is_nan() || size.is_nan() {
                return Err(refused_prior(i, j, value));
            }
            unit[i * k + j] = if size > 0.0 { value / size } else { 0.0 };
            if size == 0.0 && value != 0.0 {
                return Err(refused_prior(i, j, value));
            }
        }
        unit[i * k + i] += 1e-9;
    }
    cholesky(&mut unit, k, 0.0).map_err(|i| refused_prior(i, i, prior[i * k + i]))
}

fn refused_prior(i: usize, j: usize, value: f64) -> DesignError {
    DesignError::Setting {
        name: "prior",
        value: format!("{value} in row {i}, column {j}"),
        expected: "a symmetric matrix without negative eigenvalues, such as a diagonal of numbers of 0 or above",
    }
}
