//! Ogden: W_d = Σ μ_p / α_p² · 2 (λ̄₁^α + λ̄₂^α + λ̄₃^α − 3), λ̄ = J^(−1/3) λ; μ = Σ μ_p.
//!
//! This is the form of Abaqus: μ_p is the p-th share of the shear modulus at rest.
//!
//! The energy is a function of the principal stretches. With F = U diag(λ) Vᵀ, in the
//! frames of U and V: P = diag(W_i), and ∂P/∂F has W_ij on the diagonal entries and, for
//! i ≠ j, (W_i λ_i − W_j λ_j)/(λ_i² − λ_j²) and (W_i λ_j − W_j λ_i)/(λ_i² − λ_j²) on the
//! off-diagonal ones (Ogden 1984, §6.1; Smith et al. 2019).

use super::{Material, Model, Response, bulk, positive};
use crate::FemError;
use crate::tensor::Mat3;
use nalgebra::Matrix3;

pub(super) const MODEL: Model = Model {
    name: "ogden",
    parameters: &["mu_Pa", "alpha"],
    has_terms: true,
    make: |values, volume| {
        let (mu, alpha) = (values.list("mu_Pa")?, values.list("alpha")?);
        if mu.len() != alpha.len() {
            return Err(values.length("alpha", alpha.len(), mu.len()));
        }
        let terms = mu.iter().copied().zip(alpha.iter().copied()).collect();
        let kappa = volume.bulk_modulus_Pa(mu.iter().sum());
        Ok(Box::new(Ogden::new(terms, kappa)?))
    },
    // The first term carries most of the stiffness, with exponents of both signs.
    start: |mu, terms| {
        let shares = (0..terms).map(|i| [0.9, 0.08, 0.01][i.min(2)] * mu);
        let exponents = (0..terms).map(|i| [1.5, -1.5, 4.0, -4.0][i % 4]);
        shares.map(f64::ln).chain(exponents).collect()
    },
    decode: |x| {
        let (log_mu, alpha) = x.split_at(x.len() / 2);
        log_mu
            .iter()
            .map(|v| v.exp())
            .chain(alpha.iter().copied())
            .collect()
    },
};

/// Terms (μ_p in Pa, α_p) and a bulk modulus.
#[derive(Debug, Clone, PartialEq)]
pub struct Ogden {
    terms: Vec<(f64, f64)>,
    bulk_modulus_Pa: f64,
}

impl Ogden {
    /// `terms`: (μ_p in Pa, α_p).
    ///
    /// # Errors
    /// No terms, μ_p not positive, α_p zero, bulk modulus not positive.
    pub fn new(terms: Vec<(f64, f64)>, bulk_modulus_Pa: f64) -> Result<Self, FemError> {
        bulk(bulk_modulus_Pa)?;
        if terms.is_empty() {
            return Err(FemError::Size {
                what: "terms",
                found: 0,
                expected: 1,
                why: "at least one pair (mu, alpha)",
            });
        }
        for &(mu, alpha) in &terms {
            positive("mu of an Ogden term, Pa,", mu)?;
            if !alpha.is_finite() || alpha == 0.0 {
                let expected = "finite and not 0";
                let name = "alpha of an Ogden term";
                return Err(FemError::Parameter {
                    name,
                    value: alpha,
                    expected,
                });
            }
        }
        Ok(Self {
            terms,
            bulk_modulus_Pa,
        })
    }

    /// W, ∂W/∂λ_i, ∂²W/∂λ_i∂λ_j.
    fn by_stretches(&self, s: [f64; 3], jacobian: f64) -> (f64, [f64; 3], Mat3) {
        let (mut energy, mut first, mut second) = (0.0, [0.0; 3], [[0.0; 3]; 3]);
        for &(mu, alpha) in &self.terms {
            let shrink = jacobian.powf(-alpha / 3.0);
            let power = s.map(|l| shrink * l.powf(alpha));
            let mean = (power[0] + power[1] + power[2]) / 3.0;
            energy += 2.0 * mu / (alpha * alpha) * (3.0 * mean - 3.0);
            let c = 2.0 * mu / alpha;
            for i in 0..3 {
                let t = c * (power[i] - mean);
                first[i] += t / s[i];
                second[i][i] -= t / (s[i] * s[i]);
                for j in 0..3 {
                    // λ_j ∂(p_i − mean)/∂λ_j = α (δ_ij p_i − p_j/3 − p_i/3 + mean/3).
                    let mut rate = -power[j] / 3.0 - power[i] / 3.0 + mean / 3.0;
                    if i == j {
                        rate += power[i];
                    }
                    second[i][j] += c * alpha * rate / (s[i] * s[j]);
                }
            }
        }
        (energy, first, second)
    }
}

impl Material for Ogden {
    fn respond(&self, f: &Mat3, jacobian: f64) -> Response {
        let svd = Matrix3::from_fn(|i, j| f[i][j]).svd(true, true);
        let (u, vt) = (svd.u.unwrap_or_default(), svd.v_t.unwrap_or_default());
        let s = [
            svd.singular_values[0],
            svd.singular_values[1],
            svd.singular_values[2],
        ];
        let (energy, first, second) = self.by_stretches(s, jacobian);
        let stress = u * Matrix3::from_diagonal(&first.into()) * vt;
        // Nine directions u_a ⊗ v_b of F and the response in each.
        let direction = |a: usize, b: usize| -> [f64; 9] {
            std::array::from_fn(|r| u[(r / 3, a)] * vt[(b, r % 3)])
        };
        let mut tangent = [[0.0; 9]; 9];
        let mut add = |value: f64, left: &[f64; 9], right: &[f64; 9]| {
            for r in 0..9 {
                for q in 0..9 {
                    tangent[r][q] += value * left[r] * right[q];
                }
            }
        };
        for a in 0..3 {
            for b in 0..3 {
                add(second[a][b], &direction(a, a), &direction(b, b));
            }
            for b in (0..3).filter(|&b| b != a) {
                let gap = s[a] - s[b];
                // (W_a − W_b)/(λ_a − λ_b), and its limit for equal stretches.
                let difference = if gap.abs() > 1e-6 * s[a] {
                    (first[a] - first[b]) / gap
                } else {
                    0.5 * (second[a][a] + second[b][b]) - second[a][b]
                };
                let sum = (first[a] + first[b]) / (s[a] + s[b]);
                let (same, crossed) = (0.5 * (difference + sum), 0.5 * (difference - sum));
                add(same, &direction(a, b), &direction(a, b));
                add(crossed, &direction(a, b), &direction(b, a));
            }
        }
        Response {
            energy,
            stress: std::array::from_fn(|i| std::array::from_fn(|j| stress[(i, j)])),
            tangent,
        }
    }

    fn shear_modulus_Pa(&self) -> f64 {
        self.terms.iter().map(|(mu, _)| mu).sum()
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        self.bulk_modulus_Pa
    }
}
