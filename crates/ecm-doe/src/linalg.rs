//! Small dense matrices in row-major slices: products, Cholesky, inverse.

use faer::linalg::matmul::matmul;
use faer::traits::ComplexField;
use faer::{Accum, MatMut, MatRef, Par};

/// C = A B; A is m x p, B is p x n, C is m x n, all row-major.
///
/// Sequential, so that the result has the same bits for any number of threads.
pub(crate) fn product(c: &mut [f64], (m, p, n): (usize, usize, usize), a: &[f64], b: &[f64]) {
    matmul(
        MatMut::from_row_major_slice_mut(c, m, n),
        Accum::Replace,
        MatRef::from_row_major_slice(a, m, p),
        MatRef::from_row_major_slice(b, p, n),
        1.0,
        Par::Seq,
    );
}

/// C = A B' with B n x p, as [`product`], in either precision.
pub(crate) fn product_transposed<T: ComplexField>(
    c: &mut [T],
    (m, p, n): (usize, usize, usize),
    a: &[T],
    b: &[T],
) {
    matmul(
        MatMut::from_row_major_slice_mut(c, m, n),
        Accum::Replace,
        MatRef::from_row_major_slice(a, m, p),
        MatRef::from_row_major_slice(b, n, p).transpose(),
        T::one_impl(),
        Par::Seq,
    );
}

/// C += A' B with A p x m and B p x n.
pub(crate) fn add_transposed_product(
    c: &mut [f64],
    (m, p, n): (usize, usize, usize),
    a: &[f64],
    b: &[f64],
) {
    matmul(
        MatMut::from_row_major_slice_mut(c, m, n),
        Accum::Add,
        MatRef::from_row_major_slice(a, p, m).transpose(),
        MatRef::from_row_major_slice(b, p, n),
        1.0,
        Par::Seq,
    );
}

/// Lower factor L of A = L L', in place (the upper part is set to zero).
///
/// Returns the first column whose pivot falls below `floor` times its diagonal entry.
pub(crate) fn cholesky(a: &mut [f64], k: usize, floor: f64) -> Result<(), usize> {
    for j in 0..k {
        let before = a[j * k + j];
        let (head, tail) = a.split_at_mut((j + 1) * k);
        let row_j = &mut head[j * k..];
        let pivot = before - row_j[..j].iter().map(|v| v * v).sum::<f64>();
        if !(pivot > floor * before && pivot > 0.0) {
            return Err(j);
        }
        let root = pivot.sqrt();
        row_j[j] = root;
        row_j[j + 1..].fill(0.0);
        for i in 0..k - j - 1 {
            let row_i = &mut tail[i * k..(i + 1) * k];
            let s = row_i[j] - dot(&row_i[..j], &row_j[..j]);
            row_i[j] = s / root;
        }
    }
    Ok(())
}

/// log det of A from its lower factor.
pub(crate) fn log_det(l: &[f64], k: usize) -> f64 {
    2.0 * (0..k).map(|j| l[j * k + j].ln()).sum::<f64>()
}

/// L^-1 of a lower factor, lower triangular.
pub(crate) fn lower_inverse(l: &[f64], k: usize) -> Vec<f64> {
    let mut inv = vec![0.0; k * k];
    for i in 0..k {
        let (head, tail) = inv.split_at_mut(i * k);
        let row = &mut tail[..k];
        for j in 0..i {
            let lij = l[i * k + j];
            if lij != 0.0 {
                for (r, h) in row[..=j].iter_mut().zip(&head[j * k..=j * k + j]) {
                    *r -= lij * h;
                }
            }
        }
        let scale = 1.0 / l[i * k + i];
        for r in &mut row[..i] {
            *r *= scale;
        }
        row[i] = scale;
    }
    inv
}

/// log det A and A^-1 of a symmetric positive definite A; the failing column otherwise.
pub(crate) fn inverse(a: &[f64], k: usize) -> Result<(f64, Vec<f64>), usize> {
    let mut l = a.to_vec();
    cholesky(&mut l, k, 1e-14)?;
    let value = log_det(&l, k);
    let inv = lower_inverse(&l, k);
    let mut full = vec![0.0; k * k];
    add_transposed_product(&mut full, (k, k, k), &inv, &inv);
    Ok((value, full))
}

/// a . b with four partial sums, which the compiler keeps in vector registers.
#[inline(always)]
pub(crate) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut s = [0.0; 8];
    let (ac, bc) = (a.chunks_exact(8), b.chunks_exact(8));
    let tail: f64 = ac
        .remainder()
        .iter()
        .zip(bc.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in ac.zip(bc) {
        for l in 0..8 {
            s[l] += x[l] * y[l];
        }
    }
    s.iter().sum::<f64>() + tail
}

/// Determinant sign-free log |det| and inverse of a small general matrix by Gauss-Jordan.
pub(crate) fn small_inverse(a: &mut [f64], inv: &mut [f64], n: usize) -> Option<f64> {
    inv.fill(0.0);
    for i in 0..n {
        inv[i * n + i] = 1.0;
    }
    let mut log = 0.0;
    for col in 0..n {
        let pivot =
            (col..n).max_by(|&x, &y| a[x * n + col].abs().total_cmp(&a[y * n + col].abs()))?;
        let value = a[pivot * n + col];
        if value.abs().is_nan() || value.abs() < 1e-300 {
            return None;
        }
        if pivot != col {
            for c in 0..n {
                a.swap(pivot * n + c, col * n + c);
                inv.swap(pivot * n + c, col * n + c);
            }
        }
        log += value.abs().ln();
        for c in 0..n {
            a[col * n + c] /= value;
            inv[col * n + c] /= value;
        }
        for r in 0..n {
            let f = a[r * n + col];
            if r != col && f != 0.0 {
                for c in 0..n {
                    a[r * n + c] -= f * a[col * n + c];
                    inv[r * n + c] -= f * inv[col * n + c];
                }
            }
        }
    }
    Some(log)
}
