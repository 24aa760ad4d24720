//! The regressor Φ of an energy: wrenches are linear in its coefficients, h = Φ β.

use std::format;
use std::vec::Vec;

use ecm_se3::Vec6;
use ecm_se3::mid_frame::MidFrame;

use crate::energy::invariants::Symmetry;
use crate::energy::plan::fill_monomials;
use crate::energy::tables::{
    LARGEST_MEMORY, Monomial, Products, differentiated, first_order, unscaled,
};
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
    check_length(length_m)?;
    check_scale(scale)?;
    check_sizes("poses", poses.as_flattened(), 6)?;
    let poses = checked_poses("poses", poses)?;
    let symmetric = terms.symmetric().iter().map(|e| std::vec![(*e, 1.0)]);
    let symmetric = Columns::new(terms.symmetry(), symmetric, scale);
    let broken = terms.broken().iter().map(|term| term.monomials.clone());
    let broken = Columns::new(Symmetry::General, broken, scale);
    let k = terms.count();
    let mut matrix = std::vec![0.0; 6 * poses.len() * k];
    for (pose, block) in poses.iter().zip(matrix.chunks_exact_mut((6 * k).max(1))) {
        let frame = MidFrame::new(pose, length_m);
        let mut add = |t: usize, column: Vec6<f64>| {
            for i in 0..6 {
                block[i * k + t] = column[i];
            }
        };
        symmetric.wrenches(&frame, &mut add);
        let first = symmetric.count;
        broken.wrenches(&frame, &mut |t, column| add(first + t, column));
    }
    check_finite("the regressor", &matrix, k)?;
    Ok(matrix)
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

    /// Gives `take` the number and the wrench of each term.
    fn wrenches(&self, frame: &MidFrame<f64>, take: &mut impl FnMut(usize, Vec6<f64>)) {
        if self.count == 0 {
            return;
        }
        let q = frame.coordinates();
        let mut monomials = [1.0; LARGEST_MEMORY];
        fill_monomials(&self.products, &self.symmetry.variables(&q), &mut monomials);
        for slopes in self.slopes.chunk_by(|a, b| a.term == b.term) {
            let mut first = [0.0; 6];
            for slope in slopes {
                first[slope.variable] += slope.weight * monomials[usize::from(slope.monomial)];
            }
            let force = self.symmetry.gradient(&q, &first);
            take(slopes[0].term, frame.wrench(&force).to_array());
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
