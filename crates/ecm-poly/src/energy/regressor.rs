//! The regressor Φ of an energy: wrenches are linear in its coefficients, h = Φ β.

use std::format;
use std::vec::Vec;

use ecm_se3::{Pose, Vec6};

use crate::energy::groups::GroupTerm;
use crate::energy::invariants::Symmetry;
use crate::energy::mid_frame::EnergyMap;
use crate::error::{ModelError, check_finite, check_sizes};

/// Φ (6 N, k), row-major, six rows a pose; the columns of groups come after the symmetry's.
pub fn regressor(
    poses: &[Vec6<f64>],
    length_m: f64,
    symmetry: Symmetry,
    (exponents, broken): (&[[u8; 6]], &[GroupTerm]),
    scale: [f64; 2],
) -> Result<Vec<f64>, ModelError> {
    check_length(length_m)?;
    check_scale(scale)?;
    check_sizes("poses", poses.as_flattened(), 6)?;
    let map = EnergyMap::new(symmetry, &[], &[], scale, length_m)?;
    let general = EnergyMap::new(Symmetry::General, &[], &[], scale, length_m)?;
    let k = exponents.len() + broken.len();
    let mut matrix = std::vec![0.0; 6 * poses.len() * k];
    for (pose, block) in poses.iter().zip(matrix.chunks_exact_mut((6 * k).max(1))) {
        let point = map.term_point(&Pose::from_array(pose));
        for (t, row) in exponents.iter().enumerate() {
            let column = map.term_wrench(&point, row);
            for i in 0..6 {
                block[i * k + t] = column[i];
            }
        }
        if broken.is_empty() {
            continue;
        }
        let point = general.term_point(&Pose::from_array(pose));
        for (t, term) in (exponents.len()..).zip(broken) {
            for (monomial, weight) in &term.monomials {
                let column = general.term_wrench(&point, monomial);
                for i in 0..6 {
                    block[i * k + t] += weight * column[i];
                }
            }
        }
    }
    check_finite("the regressor", &matrix, k)?;
    Ok(matrix)
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
