//! Generalised least squares of an energy on wrenches.

use std::vec::Vec;

use ecm_se3::{Mat6, Pose, Vec6};

use crate::dense::ThinSvd;
use crate::energy::groups::{Group, group_terms};
use crate::energy::invariants::Symmetry;
use crate::energy::model::EnergyModel;
use crate::energy::regressor::{check_length, regressor};
use crate::energy::terms::terms;
use crate::error::{ModelError, check_count, check_finite, check_sizes};

/// Settings of the fit of an energy.
#[derive(Clone, Copy, Debug)]
pub struct EnergyFit<'a> {
    /// Undeformed length of the mechanism (m).
    pub length_m: f64,
    /// Highest degree in q.
    pub degree: usize,
    /// Symmetry of the mechanism.
    pub symmetry: Symmetry,
    /// Groups of terms that break the symmetry.
    pub groups: &'a [Group],
    /// Covariance of each row's wrench (N², N² m, N² m²); without it the components are
    /// weighted by the spread of each, and the residuals give the noise.
    pub covariance: Option<&'a [Mat6<f64>]>,
}

impl EnergyFit<'_> {
    /// Coefficients β that minimise Σ (h − Φ β)ᵀ Σ⁻¹ (h − Φ β), with their covariance.
    ///
    /// Each row is whitened by the Cholesky factor of its covariance, columns are scaled to unit
    /// length, and the singular values above rounding are used. The covariance of β is
    /// (ΦᵀΣ⁻¹Φ)⁻¹, times the residual variance if no covariance is given.
    ///
    /// # Errors
    /// Wrong shapes, numbers that are not finite, a degree out of range, fewer equations than
    /// coefficients, a covariance that is not positive definite.
    ///
    /// ```
    /// use ecm_poly::{EnergyFit, Symmetry};
    /// # fn main() -> Result<(), ecm_poly::ModelError> {
    /// // A spring along the axis: f_x = 500 N/m (x - L).
    /// let poses: Vec<[f64; 6]> = (0..20)
    ///     .map(|i| [0.09 + 0.001 * f64::from(i), 0.0, 0.0, 0.0, 0.0, 0.0])
    ///     .collect();
    /// let wrenches: Vec<[f64; 6]> = poses
    ///     .iter()
    ///     .map(|p| [500.0 * (p[0] - 0.1), 0.0, 0.0, 0.0, 0.0, 0.0])
    ///     .collect();
    /// let fit = EnergyFit {
    ///     length_m: 0.1,
    ///     degree: 2,
    ///     symmetry: Symmetry::Alike,
    ///     groups: &[],
    ///     covariance: None,
    /// };
    /// let model = fit.run(&poses, &wrenches)?;
    /// let h = model.predict(&[[0.105, 0.0, 0.0, 0.0, 0.0, 0.0]])?;
    /// assert!((h[0][0] - 2.5).abs() < 1e-9);
    /// # Ok(()) }
    /// ```
    pub fn run(
        &self,
        poses: &[Vec6<f64>],
        wrenches: &[Vec6<f64>],
    ) -> Result<EnergyModel, ModelError> {
        check_length(self.length_m)?;
        check_count("wrenches", "rows", wrenches.len(), poses.len())?;
        check_sizes("poses", poses.as_flattened(), 6)?;
        check_sizes("wrenches", wrenches.as_flattened(), 6)?;
        let rows = terms(self.symmetry, self.degree)?;
        let broken = group_terms(self.groups, self.degree);
        let k = rows.len() + broken.len();
        if 6 * poses.len() < k {
            return Err(ModelError::TooFewRows {
                equations: 6 * poses.len(),
                coefficients: k,
            });
        }
        let scale = scale_of(poses, self.length_m);
        let mut matrix = regressor(poses, self.length_m, self.symmetry, (&rows, &broken), scale)?;
        let mut targets: Vec<f64> = wrenches.as_flattened().to_vec();
        match self.covariance {
            Some(covariance) => {
                check_count("covariance", "rows", covariance.len(), poses.len())?;
                whiten(covariance, &mut matrix, &mut targets, k)?;
            }
            None => weigh_by_spread(&mut matrix, &mut targets, k),
        }
        let lengths = scale_columns(&mut matrix, k);
        let factors = ThinSvd::new(&matrix, k)?;
        let rank = factors.numerical_rank();
        let inverse =
            |power: i32| move |i: usize, s: f64| if i < rank { s.powi(-power) } else { 0.0 };
        let mut coefficients = factors.solve(&targets, 1, inverse(1));
        let residual = residual_square(&matrix, &coefficients, &targets);
        let freedom = targets.len() - rank;
        let variance = match self.covariance {
            Some(_) => 1.0,
            None if freedom > 0 => residual / freedom as f64,
            None => 0.0,
        };
        let mut covariance = factors.gram(inverse(2));
        for i in 0..k {
            coefficients[i] /= lengths[i];
            for j in 0..k {
                covariance[i * k + j] *= variance / (lengths[i] * lengths[j]);
            }
        }
        check_finite("the covariance of the coefficients", &covariance, k)?;
        let mut model = EnergyModel::with_groups(
            self.length_m,
            self.degree,
            self.symmetry,
            self.groups,
            scale,
            &coefficients,
        )?;
        model.set_fit(
            covariance,
            rank,
            factors.condition_number(rank),
            if freedom > 0 {
                residual / freedom as f64
            } else {
                f64::NAN
            },
        );
        Ok(model)
    }
}

/// The largest |c| and |θ| of the poses; a tenth of the length and 1 rad where they are 0.
fn scale_of(poses: &[Vec6<f64>], length_m: f64) -> [f64; 2] {
    let mut largest = [0.0_f64; 2];
    for pose in poses {
        let q = ecm_se3::mid_frame::coordinates(&Pose::from_array(pose), length_m);
        for part in 0..2 {
            let v = &q[3 * part..3 * part + 3];
            let square: f64 = v.iter().map(|x| x * x).sum();
            largest[part] = largest[part].max(square.sqrt());
        }
    }
    let usable = |largest: f64, otherwise: f64| {
        if largest > 1e-12 * otherwise {
            largest
        } else {
            otherwise
        }
    };
    [usable(largest[0], 0.1 * length_m), usable(largest[1], 1.0)]
}

/// Multiplies the six rows of each pose by L⁻¹, Σ = L Lᵀ.
fn whiten(
    covariance: &[Mat6<f64>],
    matrix: &mut [f64],
    targets: &mut [f64],
    k: usize,
) -> Result<(), ModelError> {
    let blocks = matrix.chunks_exact_mut(6 * k);
    let sides = targets.chunks_exact_mut(6);
    for (row, (sigma, (block, side))) in covariance.iter().zip(blocks.zip(sides)).enumerate() {
        let factor = cholesky(sigma).ok_or(ModelError::Covariance { row })?;
        for i in 0..6 {
            for j in 0..i {
                let l = factor[i][j];
                let (above, below) = block.split_at_mut(i * k);
                for t in 0..k {
                    below[t] -= l * above[j * k + t];
                }
                side[i] -= l * side[j];
            }
            for t in 0..k {
                block[i * k + t] /= factor[i][i];
            }
            side[i] /= factor[i][i];
        }
    }
    Ok(())
}

/// Lower L with L Lᵀ = Σ; `None` where Σ is not symmetric positive definite.
fn cholesky(sigma: &Mat6<f64>) -> Option<Mat6<f64>> {
    let mut l = [[0.0_f64; 6]; 6];
    for i in 0..6 {
        for j in 0..=i {
            let size = (sigma[i][i] * sigma[j][j]).sqrt();
            if (sigma[i][j] - sigma[j][i]).abs() > 1e-9 * size {
                return None;
            }
            let mut rest = sigma[i][j];
            for r in 0..j {
                rest -= l[i][r] * l[j][r];
            }
            if i == j {
                if !(rest > 1e-14 * sigma[i][i] && rest.is_finite()) {
                    return None;
                }
                l[i][i] = rest.sqrt();
            } else {
                l[i][j] = rest / l[j][j];
            }
        }
    }
    Some(l)
}

/// Divides each wrench component by its standard deviation over the rows.
fn weigh_by_spread(matrix: &mut [f64], targets: &mut [f64], k: usize) {
    let n = (targets.len() / 6) as f64;
    for component in 0..6 {
        let values = || targets.iter().skip(component).step_by(6);
        let mean = values().sum::<f64>() / n;
        let square = values().map(|h| (h - mean).powi(2)).sum::<f64>() / n;
        let spread = if square > 0.0 { square.sqrt() } else { 1.0 };
        for row in matrix.chunks_exact_mut(k).skip(component).step_by(6) {
            row.iter_mut().for_each(|x| *x /= spread);
        }
        let side = targets.iter_mut().skip(component).step_by(6);
        side.for_each(|h| *h /= spread);
    }
}

/// Scales columns to unit length in place; returns the lengths, 1 for a column of zeros.
fn scale_columns(matrix: &mut [f64], k: usize) -> Vec<f64> {
    let mut lengths = std::vec![0.0; k];
    for row in matrix.chunks_exact(k) {
        for (length, x) in lengths.iter_mut().zip(row) {
            *length += x * x;
        }
    }
    for length in &mut lengths {
        *length = if *length > 0.0 { length.sqrt() } else { 1.0 };
    }
    for row in matrix.chunks_exact_mut(k) {
        for (x, length) in row.iter_mut().zip(&lengths) {
            *x /= length;
        }
    }
    lengths
}

fn residual_square(matrix: &[f64], coefficients: &[f64], targets: &[f64]) -> f64 {
    matrix
        .chunks_exact(coefficients.len())
        .zip(targets)
        .map(|(row, y)| {
            let fitted: f64 = row.iter().zip(coefficients).map(|(a, b)| a * b).sum();
            (y - fitted).powi(2)
        })
        .sum()
}
