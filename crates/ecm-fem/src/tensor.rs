//! Three-by-three algebra on plain arrays.

/// A 3 × 3 matrix, row by row.
pub type Mat3 = [[f64; 3]; 3];

/// The unit matrix.
pub const IDENTITY: Mat3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// Cofactor matrix: det(F) F^-T.
#[inline(always)]
pub fn cofactor(f: &Mat3) -> Mat3 {
    [
        [
            f[1][1] * f[2][2] - f[1][2] * f[2][1],
            f[1][2] * f[2][0] - f[1][0] * f[2][2],
            f[1][0] * f[2][1] - f[1][1] * f[2][0],
        ],
        [
            f[2][1] * f[0][2] - f[2][2] * f[0][1],
            f[2][2] * f[0][0] - f[2][0] * f[0][2],
            f[2][0] * f[0][1] - f[2][1] * f[0][0],
        ],
        [
            f[0][1] * f[1][2] - f[0][2] * f[1][1],
            f[0][2] * f[1][0] - f[0][0] * f[1][2],
            f[0][0] * f[1][1] - f[0][1] * f[1][0],
        ],
    ]
}

/// Determinant.
#[inline(always)]
pub fn determinant(f: &Mat3) -> f64 {
    let c = cofactor(f);
    f[0][0] * c[0][0] + f[0][1] * c[0][1] + f[0][2] * c[0][2]
}

/// Matrix product.
#[inline(always)]
pub fn product(a: &Mat3, b: &Mat3) -> Mat3 {
    let mut c = [[0.0; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            c[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
        }
    }
    c
}

/// Transpose.
#[inline(always)]
pub fn transpose(a: &Mat3) -> Mat3 {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[j][i]))
}

/// Matrix times vector.
#[inline(always)]
pub fn apply(a: &Mat3, v: [f64; 3]) -> [f64; 3] {
    a.map(|row| dot(row, v))
}

/// Scalar product.
#[inline(always)]
pub fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Vector product.
#[inline(always)]
pub fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// `[v]×`, with `[v]× w = v × w`.
#[inline(always)]
pub fn skew(v: [f64; 3]) -> Mat3 {
    [[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]]
}

/// Length.
#[inline(always)]
pub fn norm(v: [f64; 3]) -> f64 {
    dot(v, v).sqrt()
}

/// Eigenvalues of a symmetric matrix, smallest first, by Jacobi's rotations: accurate to rounding
/// also where they are equal. Not a number where an entry is not finite.
pub fn symmetric_eigenvalues(a: &Mat3) -> [f64; 3] {
    if !a.iter().flatten().all(|entry| entry.is_finite()) {
        return [f64::NAN; 3];
    }
    let mut m = *a;
    // Convergence is quadratic: six sweeps are more than any matrix needs.
    for _ in 0..6 {
        // No squares: those of very small or large entries are zero or infinite.
        let off = m[0][1].abs() + m[0][2].abs() + m[1][2].abs();
        let diagonal = m[0][0].abs() + m[1][1].abs() + m[2][2].abs();
        if off <= 1e-17 * diagonal {
            break;
        }
        for (p, q, r) in [(0, 1, 2), (0, 2, 1), (1, 2, 0)] {
            if m[p][q] == 0.0 {
                continue;
            }
            let ratio = (m[q][q] - m[p][p]) / (2.0 * m[p][q]);
            let tangent = ratio.signum() / (ratio.abs() + ratio.hypot(1.0));
            let cosine = 1.0 / tangent.hypot(1.0);
            let sine = tangent * cosine;
            let change = tangent * m[p][q];
            m[p][p] -= change;
            m[q][q] += change;
            (m[p][q], m[q][p]) = (0.0, 0.0);
            let (x, y) = (m[r][p], m[r][q]);
            (m[r][p], m[r][q]) = (cosine * x - sine * y, sine * x + cosine * y);
            (m[p][r], m[q][r]) = (m[r][p], m[r][q]);
        }
    }
    let mut values = [m[0][0], m[1][1], m[2][2]];
    values.sort_by(f64::total_cmp);
    values
}
