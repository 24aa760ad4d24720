//! Generalised least squares of an energy on wrenches.

use std::vec::Vec;

use ecm_se3::{Mat6, Vec6};

use crate::energy::groups::Group;
use crate::energy::invariants::Symmetry;
use crate::energy::model::EnergyModel;
use crate::energy::regressor::{Regressor, check_length};
use crate::energy::terms::EnergyTerms;
use crate::error::{ModelError, check_count, check_finite, check_sizes, checked_poses};
use crate::regression::Method;
use crate::regression::triangle::Triangle;

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
        let scale = scale_of(poses, self.length_m)?;
        let triangle = self.triangle(poses, wrenches, scale)?;
        self.of_triangle(triangle, scale, self.covariance.is_some())
    }

    fn terms(&self) -> Result<EnergyTerms, ModelError> {
        EnergyTerms::new(self.symmetry, self.degree, self.groups)
    }

    /// Triangle of the weighted rows [Φ | h], six a pose: all rows of a fit, or a part of those
    /// whose covariance is stated.
    ///
    /// # Errors
    /// As for [`EnergyFit::run`].
    pub fn triangle(
        &self,
        poses: &[Vec6<f64>],
        wrenches: &[Vec6<f64>],
        scale: [f64; 2],
    ) -> Result<Triangle, ModelError> {
        check_count("wrenches", "rows", wrenches.len(), poses.len())?;
        check_sizes("wrenches", wrenches.as_flattened(), 6)?;
        if let Some(covariance) = self.covariance {
            check_count("covariance", "rows", covariance.len(), poses.len())?;
        }
        check_sizes("poses", poses.as_flattened(), 6)?;
        let poses = checked_poses("poses", poses)?;
        let regressor = Regressor::new(self.length_m, &self.terms()?, scale)?;
        let columns = regressor.columns() + 1;
        let spreads = spreads(wrenches);
        Triangle::of_rows(poses.len(), 6, columns, |range| {
            let mut block = std::vec![0.0; 6 * range.len() * columns];
            let mut scratch = regressor.scratch();
            for (row, lines) in range.zip(block.chunks_exact_mut(6 * columns)) {
                let lower = match self.covariance {
                    Some(covariance) => {
                        cholesky(&covariance[row]).ok_or(ModelError::Covariance { row })?
                    }
                    None => spreads,
                };
                let weigh = |wrench: &mut Vec6<f64>| weigh(&lower, wrench);
                regressor.rows(&poses[row], weigh, &mut scratch, (lines, columns));
                let mut side = wrenches[row];
                weigh(&mut side);
                for (line, side) in lines.chunks_exact_mut(columns).zip(side) {
                    line[columns - 1] = side;
                }
            }
            check_finite("the regressor", &block, columns)?;
            Ok(block)
        })
    }

    /// The fit of a triangle of [`EnergyFit::triangle`]; `stated`: its rows were weighted by a stated
    /// covariance, so that the residual does not scale that of the coefficients.
    ///
    /// # Errors
    /// A degree out of range, fewer equations than coefficients.
    pub fn of_triangle(
        &self,
        triangle: Triangle,
        scale: [f64; 2],
        stated: bool,
    ) -> Result<EnergyModel, ModelError> {
        let terms = self.terms()?;
        let k = terms.count();
        check_count("triangle", "columns", triangle.columns(), k + 1)?;
        let equations = triangle.rows();
        if equations < k {
            return Err(ModelError::TooFewRows {
                equations,
                coefficients: k,
            });
        }
        let mut triangle = triangle;
        let lengths: Vec<f64> = (triangle.lengths(k).iter())
            .map(|&length| if length > 0.0 { length } else { 1.0 })
            .collect();
        triangle.divide_columns(&lengths);
        let (solution, factors) = triangle.solve(k, Method::LeastSquares)?;
        let (mut coefficients, rank) = (solution.coefficients, solution.rank);
        let residual = triangle.residual_squares(k, &coefficients)[0];
        let freedom = equations - rank;
        let variance = match freedom {
            _ if stated => 1.0,
            0 => 0.0,
            _ => residual / freedom as f64,
        };
        let mut covariance = solution.unscaled_covariance;
        for i in 0..k {
            coefficients[i] /= lengths[i];
            for j in 0..k {
                covariance[i * k + j] *= variance / (lengths[i] * lengths[j]);
            }
        }
        check_finite("the covariance of the coefficients", &covariance, k)?;
        check_finite("the sum of the squared residuals", &[residual], 1)?;
        let mut model = EnergyModel::of_terms(self.length_m, terms, scale, &coefficients)?;
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
///
/// # Errors
/// A pose with a number that is not finite, or a rotation beyond π.
pub fn scale_of(poses: &[Vec6<f64>], length_m: f64) -> Result<[f64; 2], ModelError> {
    let mut largest = [0.0_f64; 2];
    for pose in &checked_poses("poses", poses)? {
        let q = ecm_se3::mid_frame::coordinates(pose, length_m);
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
    Ok([usable(largest[0], 0.1 * length_m), usable(largest[1], 1.0)])
}

/// L⁻¹ h in place of h.
fn weigh(lower: &Mat6<f64>, wrench: &mut Vec6<f64>) {
    for i in 0..6 {
        let before: f64 = (0..i).map(|j| lower[i][j] * wrench[j]).sum();
        wrench[i] = (wrench[i] - before) / lower[i][i];
    }
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

/// Diagonal matrix of the standard deviations of the wrench components; 1 for one that never varies.
fn spreads(wrenches: &[Vec6<f64>]) -> Mat6<f64> {
    let n = wrenches.len() as f64;
    let spread = |component: usize| {
        let values = || wrenches.iter().map(|h| h[component]);
        let mean = values().sum::<f64>() / n;
        let square = values().map(|h| (h - mean).powi(2)).sum::<f64>() / n;
        if square > 0.0 { square.sqrt() } else { 1.0 }
    };
    std::array::from_fn(|i| std::array::from_fn(|j| if i == j { spread(i) } else { 0.0 }))
}
