//! One linear update of all parameters by six components, for any gain.

use ecm_se3::{Mat6, Real, Vec6};

/// L D Lᵀ of a symmetric matrix; not finite where it is not positive definite.
#[derive(Clone, Copy)]
pub(super) struct Factor<R> {
    /// L below the diagonal, 1/D on it.
    entries: Mat6<R>,
}

impl<R: Real> Factor<R> {
    pub fn new(matrix: &Mat6<R>) -> Self {
        let mut entries = *matrix;
        for j in 0..6 {
            let mut pivot = entries[j][j];
            for k in 0..j {
                // entries[k][k] is 1/D, and entries[j][k] still L D.
                let scaled = entries[j][k] * entries[k][k];
                pivot -= entries[j][k] * scaled;
            }
            let inverse = if pivot > R::ZERO {
                R::ONE / pivot
            } else {
                R::NAN
            };
            for i in j + 1..6 {
                let mut sum = entries[i][j];
                for k in 0..j {
                    sum -= entries[i][k] * (entries[j][k] * entries[k][k]);
                }
                entries[i][j] = sum;
            }
            entries[j][j] = inverse;
        }
        Self { entries }
    }

    /// The matrix inverse times a vector.
    pub fn solve(&self, right: &Vec6<R>) -> Vec6<R> {
        let e = &self.entries;
        let mut x = *right;
        for i in 0..6 {
            for k in 0..i {
                x[i] -= e[i][k] * e[k][k] * x[k];
            }
        }
        for i in 0..6 {
            x[i] = x[i] * e[i][i];
        }
        for i in (0..6).rev() {
            for k in i + 1..6 {
                x[i] -= e[k][i] * e[i][i] * x[k];
            }
        }
        x
    }
}

pub(super) fn dot<R: Real>(a: &Vec6<R>, b: &Vec6<R>) -> R {
    a.iter().zip(b).fold(R::ZERO, |sum, (x, y)| sum + *x * *y)
}

/// P Hᵀ, by rows of P; `columns` holds the columns of H.
pub(super) fn carried<R: Real, const N: usize>(
    covariance: &[[R; N]; N],
    columns: &[Vec6<R>; N],
) -> [Vec6<R>; N] {
    let mut product = [[R::ZERO; 6]; N];
    for i in 0..N {
        for j in 0..N {
            for c in 0..6 {
                product[i][c] += covariance[i][j] * columns[j][c];
            }
        }
    }
    product
}

/// H P Hᵀ.
pub(super) fn spread<R: Real, const N: usize>(
    columns: &[Vec6<R>; N],
    carried: &[Vec6<R>; N],
) -> Mat6<R> {
    let mut matrix = [[R::ZERO; 6]; 6];
    for i in 0..N {
        for a in 0..6 {
            for b in 0..6 {
                matrix[a][b] += columns[i][a] * carried[i][b];
            }
        }
    }
    matrix
}

/// Σ columns times weights.
pub(super) fn combined<R: Real, const N: usize>(
    columns: &[Vec6<R>; N],
    weights: &[R; N],
) -> Vec6<R> {
    core::array::from_fn(|a| {
        columns
            .iter()
            .zip(weights)
            .fold(R::ZERO, |sum, (column, weight)| sum + column[a] * *weight)
    })
}

/// M G of six numbers by rows of G.
pub(super) fn weighed<R: Real, const N: usize>(
    matrix: &Mat6<R>,
    rows: &[Vec6<R>; N],
) -> [Vec6<R>; N] {
    rows.map(|row| core::array::from_fn(|a| dot(&matrix[a], &row)))
}

/// Adds a symmetric matrix.
pub(super) fn add<R: Real>(matrix: &mut Mat6<R>, other: &Mat6<R>) {
    for (row, more) in matrix.iter_mut().zip(other) {
        for (x, y) in row.iter_mut().zip(more) {
            *x += *y;
        }
    }
}

/// Adds to the diagonal.
pub(super) fn add_diagonal<R: Real>(matrix: &mut Mat6<R>, more: impl Fn(usize) -> R) {
    for (a, row) in matrix.iter_mut().enumerate() {
        row[a] += more(a);
    }
}

/// (A P) Aᵀ − T Gᵀ − G Tᵀ + G Q Gᵀ + D R Dᵀ of the lower triangle, and symmetric.
pub(super) fn joseph<R: Real, const N: usize>(
    covariance: &mut [[R; N]; N],
    through: &[[R; N]; N],
    mean: (&[Vec6<R>; N], &[Vec6<R>; N], &Mat6<R>),
    difference: (&[Vec6<R>; N], &Mat6<R>),
) {
    let (gain, shared, noise) = mean;
    let (apart, white) = difference;
    let (noisy, noisy_apart) = (weighed(noise, gain), weighed(white, apart));
    let half: [[R; N]; N] = core::array::from_fn(|i| {
        core::array::from_fn(|j| {
            (0..N).fold(R::ZERO, |sum, k| sum + through[i][k] * covariance[k][j])
        })
    });
    for i in 0..N {
        for j in 0..=i {
            let mut sum = (0..N).fold(R::ZERO, |sum, k| sum + half[i][k] * through[j][k]);
            sum += dot(&gain[i], &noisy[j]) + dot(&apart[i], &noisy_apart[j]);
            sum -= dot(&shared[i], &gain[j]) + dot(&gain[i], &shared[j]);
            covariance[i][j] = sum;
            covariance[j][i] = sum;
        }
    }
}

/// √x of 1e-6 ≤ x ≤ 1 by Newton's steps, without libm.
pub(super) fn root<R: Real>(x: R) -> R {
    let mut y = R::ONE;
    for _ in 0..16 {
        y = R::HALF * (y + x / y);
    }
    y
}

/// Bound of chi-square over its degrees of freedom, by Wilson and Hilferty's cube
/// (Proc. Nat. Acad. Sci. 17, 1931): (1 − a + z √a)³, a = 2/(9 ν), z the bound of a normal number.
pub(super) fn bound_of_mean<R: Real>(freedom: R, z: R) -> R {
    let a = R::TWO / (R::from_u16(9) * freedom);
    let edge = R::ONE - a + z * root(a);
    edge * edge * edge
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn solves_and_refuses() {
        let mut matrix = [[0.0_f64; 6]; 6];
        for i in 0..6 {
            for j in 0..6 {
                matrix[i][j] = 1.0 / ((i + j + 1) as f64) + if i == j { 0.5 } else { 0.0 };
            }
        }
        let exact = [1.0, -2.0, 3.0, 0.5, -0.25, 4.0];
        let right = core::array::from_fn(|i| dot(&matrix[i], &exact));
        let found = Factor::new(&matrix).solve(&right);
        for (a, b) in found.iter().zip(&exact) {
            assert!((a - b).abs() < 1e-12, "{found:?}");
        }
        matrix[3][3] = -1.0;
        assert!(
            Factor::new(&matrix)
                .solve(&right)
                .iter()
                .any(|x| x.is_nan())
        );
    }

    #[test]
    fn bounds_are_those_of_chi_square() {
        // scipy.stats.chi2.isf(norm.sf(z), n) / n
        for (n, z, exact) in [
            (6.0, 2.326_347_87, 2.801_98),
            (600.0, 4.753_424_31, 1.298_81),
        ] {
            let found = bound_of_mean(n, z);
            assert!((found / exact - 1.0_f64).abs() < 5e-3, "{n}: {found}");
        }
    }
}
