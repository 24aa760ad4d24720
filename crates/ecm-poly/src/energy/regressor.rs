//! The regressor Φ of an energy: wrenches are linear in its coefficients, h = Φ β.

use alloc::boxed::Box;
use alloc::format;
use alloc::vec::Vec;

use ecm_se3::mid_frame::MidFrame;
use ecm_se3::{Mat6, Pose, Vec6};

use crate::energy::expansion::{Monomial, Products, differentiated, first_order, unscaled};
use crate::energy::invariants::Symmetry;
use crate::energy::plan::fill_monomials;
use crate::energy::tables::LARGEST_MEMORY;
use crate::energy::terms::EnergyTerms;
use crate::error::{ModelError, check_finite, check_sizes, checked_poses};

/// Φ (6 N, k), row-major, six rows a pose; the columns of groups come after the symmetry's.
///
/// # Errors
/// A length or scale that is not above 0; a pose with a number that is not finite or a rotation
/// beyond π.
pub fn regressor(
    poses: &[Vec6<f64>],
    length_m: f64,
    terms: &EnergyTerms,
    scale: [f64; 2],
) -> Result<Vec<f64>, ModelError> {
    check_sizes("poses", poses.as_flattened(), 6)?;
    let poses = checked_poses("poses", poses)?;
    let regressor = Regressor::new(length_m, terms, scale)?;
    let k = regressor.columns();
    let mut matrix = alloc::vec![0.0; 6 * poses.len() * k];
    let mut scratch = regressor.scratch();
    for (pose, block) in poses.iter().zip(matrix.chunks_exact_mut((6 * k).max(1))) {
        regressor.rows(pose, |_| {}, &mut scratch, (block, k));
    }
    check_finite("the regressor", &matrix, k)?;
    Ok(matrix)
}

/// The terms of an energy, ready to give the six rows of Φ of any pose.
pub(crate) struct Regressor {
    length_m: f64,
    /// Columns of the symmetry and of the groups.
    parts: [Columns; 2],
}

/// Numbers of one pose.
pub(crate) struct Scratch {
    monomials: Box<[f64; LARGEST_MEMORY]>,
    /// ∂U/∂v of each term; what no slope fills stays 0.
    slopes: [[Vec<f64>; 6]; 2],
}

impl Regressor {
    /// # Errors
    /// A length or scale that is not above 0.
    pub(crate) fn new(
        length_m: f64,
        terms: &EnergyTerms,
        scale: [f64; 2],
    ) -> Result<Self, ModelError> {
        check_length(length_m)?;
        check_scale(scale)?;
        let symmetric = terms.symmetric().iter().map(|e| alloc::vec![(*e, 1.0)]);
        let broken = terms.broken().iter().map(|term| term.monomials.clone());
        let parts = [
            Columns::new(terms.symmetry(), symmetric, scale),
            Columns::new(Symmetry::General, broken, scale),
        ];
        Ok(Self { length_m, parts })
    }

    /// Number of terms.
    pub(crate) fn columns(&self) -> usize {
        self.parts.iter().map(|part| part.count).sum()
    }

    pub(crate) fn scratch(&self) -> Scratch {
        let slopes = |part: &Columns| core::array::from_fn(|_| alloc::vec![0.0; part.count]);
        Scratch {
            monomials: Box::new([1.0; LARGEST_MEMORY]),
            slopes: [slopes(&self.parts[0]), slopes(&self.parts[1])],
        }
    }

    /// Writes the six rows of a pose, `stride` numbers apart; `weigh` changes each wrench linearly.
    ///
    /// A term's wrench is linear in its ∂U/∂v. So the wrenches of six unit slopes, weighed once,
    /// serve all terms.
    pub(crate) fn rows(
        &self,
        pose: &Pose<f64>,
        weigh: impl Fn(&mut Vec6<f64>),
        scratch: &mut Scratch,
        (rows, stride): (&mut [f64], usize),
    ) {
        let frame = MidFrame::new(pose, self.length_m);
        let q = frame.coordinates();
        let mut first = 0;
        for (part, slopes) in self.parts.iter().zip(&mut scratch.slopes) {
            if part.count == 0 {
                continue;
            }
            part.fill_slopes(&q, &mut scratch.monomials, slopes);
            let wrenches: Mat6<f64> = core::array::from_fn(|i| {
                let unit = core::array::from_fn(|j| if i == j { 1.0 } else { 0.0 });
                let mut wrench = frame.wrench(&part.symmetry.gradient(&q, &unit)).to_array();
                weigh(&mut wrench);
                wrench
            });
            let [s0, s1, s2, s3, s4, s5] = slopes.each_ref().map(|s| &s[..part.count]);
            for (i, row) in rows.chunks_mut(stride).enumerate().take(6) {
                let w = wrenches.map(|wrench| wrench[i]);
                for (t, x) in row[first..first + part.count].iter_mut().enumerate() {
                    *x = (w[0] * s0[t] + w[1] * s1[t])
                        + (w[2] * s2[t] + w[3] * s3[t])
                        + (w[4] * s4[t] + w[5] * s5[t]);
                }
            }
            first += part.count;
        }
    }
}

/// The plan of a sum of terms, kept apart term by term.
struct Columns {
    symmetry: Symmetry,
    count: usize,
    products: Vec<(u16, u8)>,
    slopes: Vec<Slope>,
}

/// Part of ∂U/∂v of one term with coefficient 1.
struct Slope {
    term: usize,
    variable: usize,
    monomial: u16,
    weight: f64,
}

impl Columns {
    /// From the weighted monomials of each term.
    fn new(
        symmetry: Symmetry,
        terms: impl Iterator<Item = Vec<(Monomial, f64)>>,
        scale: [f64; 2],
    ) -> Self {
        let mut count = 0;
        let mut found = Vec::new();
        for monomials in terms {
            for (exponents, weight) in monomials {
                let weight = weight * unscaled(symmetry, &exponents, scale);
                for i in 0..6 {
                    if let Some((lower, factor)) = differentiated(&exponents, &first_order(i)) {
                        found.push((count, i, lower, weight * factor));
                    }
                }
            }
            count += 1;
        }
        let products = Products::new(found.iter().map(|entry| entry.2));
        let slopes = found.iter().map(|&(term, variable, lower, weight)| Slope {
            term,
            variable,
            monomial: products.place(&lower),
            weight,
        });
        Self {
            symmetry,
            count,
            slopes: slopes.collect(),
            products: products.table(),
        }
    }

    /// ∂U/∂v of each term at mid-frame coordinates q.
    fn fill_slopes(
        &self,
        q: &Vec6<f64>,
        monomials: &mut [f64; LARGEST_MEMORY],
        slopes: &mut [Vec<f64>; 6],
    ) {
        fill_monomials(&self.products, &self.symmetry.variables(q), monomials);
        for slope in &self.slopes {
            slopes[slope.variable][slope.term] = 0.0;
        }
        for slope in &self.slopes {
            let value = slope.weight * monomials[usize::from(slope.monomial)];
            slopes[slope.variable][slope.term] += value;
        }
    }
}

pub(crate) fn check_length(length_m: f64) -> Result<(), ModelError> {
    if length_m > 0.0 && length_m.is_finite() {
        return Ok(());
    }
    Err(ModelError::Setting {
        name: "length_m",
        found: format!("{length_m}"),
        expected: "the mechanism's length in m, above 0",
    })
}

pub(crate) fn check_scale(scale: [f64; 2]) -> Result<(), ModelError> {
    if scale.iter().all(|&s| s > 0.0 && s.is_finite()) {
        return Ok(());
    }
    Err(ModelError::Setting {
        name: "scale",
        found: format!("({}, {})", scale[0], scale[1]),
        expected: "a length in m and an angle in rad, both above 0",
    })
}
