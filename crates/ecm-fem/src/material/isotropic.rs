//! Energies of the two isochoric invariants, W_d(Ī₁, Ī₂).
//!
//! Ī₁ = J^(−2/3) I₁ and Ī₂ = J^(−4/3) I₂ with I₁ = F : F, I₂ = (I₁² − FFᵀ : FFᵀ)/2. With
//! ∂Ī/∂F = D and its derivative ∂D/∂F in closed form, every material needs only its first
//! and second derivatives by Ī₁ and Ī₂.

use super::{Material, Response};
use crate::tensor::{Mat3, cofactor, product, transpose};

/// Value and derivatives of W_d by (Ī₁, Ī₂).
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Derivatives {
    /// W_d.
    pub energy: f64,
    /// ∂W_d/∂Ī₁, ∂W_d/∂Ī₂.
    pub first: [f64; 2],
    /// ∂²W_d/∂Ī₁², ∂²W_d/∂Ī₁∂Ī₂, ∂²W_d/∂Ī₂².
    pub second: [f64; 3],
}

/// A material given by its energy of the isochoric invariants.
pub trait Invariants: Send + Sync + std::fmt::Debug {
    /// W_d and its derivatives.
    fn derivatives(&self, i1: f64, i2: f64) -> Derivatives;
    /// Bulk modulus, Pa.
    fn bulk_modulus_Pa(&self) -> f64;
    /// 2 (∂W/∂Ī₁ + ∂W/∂Ī₂) at rest.
    fn shear_modulus_Pa(&self) -> f64 {
        let d = self.derivatives(3.0, 3.0);
        2.0 * (d.first[0] + d.first[1])
    }
}

/// An isochoric invariant with its first and second derivatives by F.
struct Invariant {
    value: f64,
    first: [f64; 9],
    second: [[f64; 9]; 9],
}

/// From J^(−2n/3) I with the derivatives of I: with G = F^-T and s = −2 n / 3,
/// D = J^s (I' + s I G), ∂D = J^s (I'' + s (I' ⊗ G + G ⊗ I') + s² I G ⊗ G − s I G_iL G_kJ).
fn isochoric(
    n: f64,
    jacobian: f64,
    g: &Mat3,
    value: f64,
    first: &[f64; 9],
    mut second: [[f64; 9]; 9],
) -> Invariant {
    let s = -2.0 * n / 3.0;
    let c = jacobian.powf(s);
    let flat = |m: &Mat3, r: usize| m[r / 3][r % 3];
    for r in 0..9 {
        for q in 0..9 {
            second[r][q] = c
                * (second[r][q]
                    + s * (first[r] * flat(g, q) + flat(g, r) * first[q])
                    + s * s * value * flat(g, r) * flat(g, q)
                    - s * value * g[r / 3][q % 3] * g[q / 3][r % 3]);
        }
    }
    let first = std::array::from_fn(|r| c * (first[r] + s * value * flat(g, r)));
    Invariant {
        value: c * value,
        first,
        second,
    }
}

/// Ī₁ and Ī₂ with derivatives: I₁' = 2 F; I₂' = 2 (I₁ F − B F), B = F Fᵀ, C = Fᵀ F;
/// I₂'' = 2 (2 F ⊗ F + I₁ δδ − δ_ik C_JL − F_iL F_kJ − B_ik δ_JL).
fn invariants(f: &Mat3, jacobian: f64) -> [Invariant; 2] {
    let g = cofactor(f).map(|row| row.map(|v| v / jacobian));
    let (b, c) = (product(f, &transpose(f)), product(&transpose(f), f));
    let i1 = b[0][0] + b[1][1] + b[2][2];
    let i2 = 0.5 * (i1 * i1 - b.iter().flatten().map(|v| v * v).sum::<f64>());
    let bf = product(&b, f);
    let first1 = std::array::from_fn(|r| 2.0 * f[r / 3][r % 3]);
    let first2 = std::array::from_fn(|r| 2.0 * (i1 * f[r / 3][r % 3] - bf[r / 3][r % 3]));
    let mut second1 = [[0.0; 9]; 9];
    let mut second2 = [[0.0; 9]; 9];
    for r in 0..9 {
        let (i, j) = (r / 3, r % 3);
        second1[r][r] = 2.0;
        for q in 0..9 {
            let (k, l) = (q / 3, q % 3);
            let mut value = 2.0 * f[i][j] * f[k][l] - f[i][l] * f[k][j];
            if i == k {
                value -= c[j][l];
            }
            if j == l {
                value -= b[i][k];
            }
            if r == q {
                value += i1;
            }
            second2[r][q] = 2.0 * value;
        }
    }
    [
        isochoric(1.0, jacobian, &g, i1, &first1, second1),
        isochoric(2.0, jacobian, &g, i2, &first2, second2),
    ]
}

impl<M: Invariants> Material for M {
    fn respond(&self, f: &Mat3, jacobian: f64) -> Response {
        let [a, b] = invariants(f, jacobian);
        let d = self.derivatives(a.value, b.value);
        let stress = std::array::from_fn(|i| {
            std::array::from_fn(|j| {
                d.first[0] * a.first[3 * i + j] + d.first[1] * b.first[3 * i + j]
            })
        });
        let mut tangent = [[0.0; 9]; 9];
        for r in 0..9 {
            for q in 0..9 {
                tangent[r][q] = d.first[0] * a.second[r][q]
                    + d.first[1] * b.second[r][q]
                    + d.second[0] * a.first[r] * a.first[q]
                    + d.second[1] * (a.first[r] * b.first[q] + b.first[r] * a.first[q])
                    + d.second[2] * b.first[r] * b.first[q];
            }
        }
        Response {
            energy: d.energy,
            stress,
            tangent,
        }
    }

    fn shear_modulus_Pa(&self) -> f64 {
        Invariants::shear_modulus_Pa(self)
    }

    fn bulk_modulus_Pa(&self) -> f64 {
        Invariants::bulk_modulus_Pa(self)
    }
}
