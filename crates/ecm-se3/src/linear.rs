//! Algebra of 3-vectors and 3 × 3 matrices (row-major arrays), and of 6 × 6 made of them.

use crate::real::Real;

/// Three components.
pub type Vec3<R> = [R; 3];
/// Rows of a 3 × 3 matrix.
pub type Mat3<R> = [[R; 3]; 3];
/// Six components: three of translation or force, three of rotation or moment.
pub type Vec6<R> = [R; 6];
/// Rows of a 6 × 6 matrix.
pub type Mat6<R> = [[R; 6]; 6];

/// The 3 × 3 unit matrix.
#[inline(always)]
pub fn identity<R: Real>() -> Mat3<R> {
    diagonal(R::ONE)
}

/// x I.
#[inline(always)]
pub fn diagonal<R: Real>(x: R) -> Mat3<R> {
    let o = R::ZERO;
    [[x, o, o], [o, x, o], [o, o, x]]
}

/// a · b.
#[inline(always)]
pub fn dot<R: Real>(a: &Vec3<R>, b: &Vec3<R>) -> R {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// a × b.
#[inline(always)]
pub fn cross<R: Real>(a: &Vec3<R>, b: &Vec3<R>) -> Vec3<R> {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// `[a]×`, the matrix with `[a]× b = a × b`.
#[inline(always)]
pub fn skew<R: Real>(a: &Vec3<R>) -> Mat3<R> {
    let o = R::ZERO;
    [[o, -a[2], a[1]], [a[2], o, -a[0]], [-a[1], a[0], o]]
}

/// a + b.
#[inline(always)]
pub fn add<R: Real>(a: &Vec3<R>, b: &Vec3<R>) -> Vec3<R> {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a − b.
#[inline(always)]
pub fn sub<R: Real>(a: &Vec3<R>, b: &Vec3<R>) -> Vec3<R> {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// s a.
#[inline(always)]
pub fn scaled<R: Real>(s: R, a: &Vec3<R>) -> Vec3<R> {
    [s * a[0], s * a[1], s * a[2]]
}

/// M a.
#[inline(always)]
pub fn apply<R: Real>(m: &Mat3<R>, a: &Vec3<R>) -> Vec3<R> {
    [dot(&m[0], a), dot(&m[1], a), dot(&m[2], a)]
}

/// Mᵀ a.
#[inline(always)]
pub fn apply_transposed<R: Real>(m: &Mat3<R>, a: &Vec3<R>) -> Vec3<R> {
    [
        m[0][0] * a[0] + m[1][0] * a[1] + m[2][0] * a[2],
        m[0][1] * a[0] + m[1][1] * a[1] + m[2][1] * a[2],
        m[0][2] * a[0] + m[1][2] * a[1] + m[2][2] * a[2],
    ]
}

/// A B.
#[inline(always)]
pub fn product<R: Real>(a: &Mat3<R>, b: &Mat3<R>) -> Mat3<R> {
    let mut m = [[R::ZERO; 3]; 3];
    for i in 0..3 {
        for j in 0..3 {
            m[i][j] = a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j];
        }
    }
    m
}

/// Aᵀ B.
#[inline(always)]
pub fn transposed_product<R: Real>(a: &Mat3<R>, b: &Mat3<R>) -> Mat3<R> {
    product(&transposed(a), b)
}

/// Mᵀ.
#[inline(always)]
pub fn transposed<R: Real>(m: &Mat3<R>) -> Mat3<R> {
    [
        [m[0][0], m[1][0], m[2][0]],
        [m[0][1], m[1][1], m[2][1]],
        [m[0][2], m[1][2], m[2][2]],
    ]
}

/// A + B.
#[inline(always)]
pub fn sum<R: Real>(a: &Mat3<R>, b: &Mat3<R>) -> Mat3<R> {
    [add(&a[0], &b[0]), add(&a[1], &b[1]), add(&a[2], &b[2])]
}

/// A − B.
#[inline(always)]
pub fn difference<R: Real>(a: &Mat3<R>, b: &Mat3<R>) -> Mat3<R> {
    [sub(&a[0], &b[0]), sub(&a[1], &b[1]), sub(&a[2], &b[2])]
}

/// s M.
#[inline(always)]
pub fn times<R: Real>(s: R, m: &Mat3<R>) -> Mat3<R> {
    [scaled(s, &m[0]), scaled(s, &m[1]), scaled(s, &m[2])]
}

/// a bᵀ.
#[inline(always)]
pub fn outer<R: Real>(a: &Vec3<R>, b: &Vec3<R>) -> Mat3<R> {
    [scaled(a[0], b), scaled(a[1], b), scaled(a[2], b)]
}

/// The 3 × 3 block of a 6 × 6 matrix whose first row and column are `3 i` and `3 j`, i and j 0 or 1;
/// NaN for others.
#[inline(always)]
pub fn block<R: Real>(m: &Mat6<R>, i: usize, j: usize) -> Mat3<R> {
    if i > 1 || j > 1 {
        return [[R::NAN; 3]; 3];
    }
    let row = |k: usize| -> Vec3<R> {
        let r = &m[3 * i + k];
        [r[3 * j], r[3 * j + 1], r[3 * j + 2]]
    };
    [row(0), row(1), row(2)]
}

/// The 6 × 6 matrix [[a, b], [c, d]].
#[inline(always)]
pub fn from_blocks<R: Real>(a: &Mat3<R>, b: &Mat3<R>, c: &Mat3<R>, d: &Mat3<R>) -> Mat6<R> {
    let mut m = [[R::ZERO; 6]; 6];
    for i in 0..3 {
        for j in 0..3 {
            m[i][j] = a[i][j];
            m[i][j + 3] = b[i][j];
            m[i + 3][j] = c[i][j];
            m[i + 3][j + 3] = d[i][j];
        }
    }
    m
}
