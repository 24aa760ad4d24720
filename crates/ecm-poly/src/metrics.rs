//! Figures of merit of a pose-to-wrench map.

use std::vec::Vec;

use ecm_se3::Mat6;

use crate::dense::singular_values;
use crate::error::{ModelError, check_count, check_sizes};

/// e_rel = (ĥ − h)/h, the paper's eq. (7); infinite or NaN where h is 0.
pub fn relative_errors(predicted: &[f64], observed: &[f64]) -> Result<Vec<f64>, ModelError> {
    check_count("predicted", "numbers", predicted.len(), observed.len())?;
    let pairs = predicted.iter().zip(observed);
    Ok(pairs.map(|(&a, &b)| (a - b) / b).collect())
}

/// Root mean square of ĥ − h, per output of row-major (N, outputs); empty without rows.
pub fn rmse(predicted: &[f64], observed: &[f64], outputs: usize) -> Result<Vec<f64>, ModelError> {
    check_count("predicted", "numbers", predicted.len(), observed.len())?;
    let rows = observed.len().checked_div(outputs).unwrap_or(0);
    check_count("observed", "numbers", observed.len(), rows * outputs)?;
    if rows == 0 {
        return Ok(Vec::new());
    }
    let mut sums = std::vec![0.0; outputs];
    let mut count = 0.0_f64;
    for (a, b) in predicted
        .chunks_exact(outputs.max(1))
        .zip(observed.chunks_exact(outputs.max(1)))
    {
        count += 1.0;
        for j in 0..outputs {
            sums[j] += (a[j] - b[j]).powi(2);
        }
    }
    Ok(sums.into_iter().map(|s| (s / count).sqrt()).collect())
}

/// ‖K_sym‖₂/‖K‖₂ of the paper's eq. (10): 1 for a symmetric matrix, NaN for zeros.
pub fn symmetric_share(stiffness: &Mat6<f64>) -> Result<f64, ModelError> {
    let mut whole: Vec<f64> = stiffness.iter().flatten().copied().collect();
    check_sizes("stiffness", &whole, 6)?;
    // In units of the largest entry: halves of the smallest numbers would vanish.
    let largest = whole.iter().fold(0.0_f64, |most, x| most.max(x.abs()));
    whole.iter_mut().for_each(|x| *x /= largest);
    if largest == 0.0 {
        return Ok(f64::NAN);
    }
    let mut half = whole.clone();
    for i in 0..6 {
        for j in 0..6 {
            half[6 * i + j] = 0.5 * (whole[6 * i + j] + whole[6 * j + i]);
        }
    }
    let norm = |m: &[f64]| -> Result<f64, ModelError> {
        Ok(singular_values(m, 6)?.first().copied().unwrap_or(0.0))
    };
    Ok(norm(&half)? / norm(&whole)?)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn relative_error_and_rmse_of_two_rows() {
        assert_eq!(relative_errors(&[1.1, 2.0], &[1.0, 4.0]).unwrap()[1], -0.5);
        let r = rmse(&[1.0, 2.0, 3.0, 2.0], &[0.0, 2.0, 0.0, 4.0], 2).unwrap();
        assert!((r[0] - 5.0_f64.sqrt()).abs() < 1e-15 && (r[1] - 2.0_f64.sqrt()).abs() < 1e-15);
        assert!(rmse(&[1.0], &[1.0, 2.0], 1).is_err());
    }

    #[test]
    fn share_is_one_for_symmetric_and_zero_for_skew() {
        let mut m = [[0.0; 6]; 6];
        m[0][1] = 3.0;
        m[1][0] = -3.0;
        assert_eq!(symmetric_share(&m).unwrap(), 0.0);
        m[1][0] = 3.0;
        assert!((symmetric_share(&m).unwrap() - 1.0).abs() < 1e-15);
    }
}
