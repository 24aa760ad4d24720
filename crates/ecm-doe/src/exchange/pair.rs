//! The small matrices of an exchange of two poses with several rows each.

use crate::linalg::{cholesky, dot, log_det, lower_inverse, product, small_inverse};

/// det M grows by |det C^-1| when the pose of blocks D_i leaves and that of D_j enters:
/// C^-1 = [I + D_j, G; G', D_i - I], G = A_j M^-1 A_i'.
#[derive(Debug, Clone)]
pub(crate) struct Pair {
    block: usize,
    matrix: Vec<f64>,
    inverse: Vec<f64>,
}

impl Pair {
    pub fn new(block: usize) -> Self {
        let zeros = || vec![0.0; 4 * block * block];
        Self {
            block,
            matrix: zeros(),
            inverse: zeros(),
        }
    }

    /// log of the growth of det M; `None` when M would be singular.
    pub fn growth(&mut self, d_in: &[f64], d_out: &[f64], g: &[f64]) -> Option<f64> {
        let (b, n) = (self.block, 2 * self.block);
        for r in 0..b {
            for c in 0..b {
                let unit = if r == c { 1.0 } else { 0.0 };
                let i = r * b + c;
                self.matrix[r * n + c] = d_in[i] + unit;
                self.matrix[(r + b) * n + c + b] = d_out[i] - unit;
                self.matrix[r * n + c + b] = g[i];
                self.matrix[(c + b) * n + r] = g[i];
            }
        }
        small_inverse(&mut self.matrix, &mut self.inverse, n).filter(|growth| *growth > -20.0)
    }

    /// C of the last growth, 2b x 2b.
    pub fn inverse(&self) -> &[f64] {
        &self.inverse
    }

    /// tr(C W) of the last growth, W = [e_in, f; f', e_out].
    pub fn trace(&self, e_in: &[f64], e_out: &[f64], f: &[f64]) -> f64 {
        let (b, n) = (self.block, 2 * self.block);
        let mut sum = 0.0;
        for r in 0..b {
            for c in 0..b {
                let i = r * b + c;
                sum += self.inverse[r * n + c] * e_in[i]
                    + self.inverse[(r + b) * n + c + b] * e_out[i]
                    + (self.inverse[r * n + c + b] + self.inverse[(c + b) * n + r]) * f[i];
            }
        }
        sum
    }
}

/// A pose taken out of the design: L L' = I - D_i, z = L^-1 A_i M^-1.
#[derive(Debug, Clone)]
pub(crate) struct Removal {
    /// log det(I - D_i).
    pub log: f64,
    /// L^-1, b x b.
    pub inv_lower: Vec<f64>,
    /// z, b x k.
    pub z: Vec<f64>,
}

impl Removal {
    /// From D_i (b x b) and A_i M^-1 (b x k); `None` when M cannot lose this pose alone, or its rows
    /// are too many; use a [`Pair`] then.
    pub fn new(block: usize, variance: &[f64], solved: &[f64]) -> Option<Self> {
        let b = block;
        let mut l: Vec<f64> = variance.iter().map(|v| -v).collect();
        for r in 0..b {
            l[r * b + r] += 1.0;
        }
        // Only rounding remains here for a pose that the design needs; stay well above it.
        cholesky(&mut l, b, 0.0).ok()?;
        if b > MOST || (0..b).any(|r| l[r * b + r] < 1e-3) {
            return None;
        }
        let inv_lower = lower_inverse(&l, b);
        let z = left_product(&inv_lower, solved, b);
        Some(Self {
            log: log_det(&l, b),
            inv_lower,
            z,
        })
    }
}

/// L^-1 X of b rows.
pub(crate) fn left_product(inv_lower: &[f64], x: &[f64], b: usize) -> Vec<f64> {
    let k = x.len() / b;
    let mut out = vec![0.0; b * k];
    product(&mut out, (b, b, k), inv_lower, x);
    out
}

/// Most rows of a pose whose small matrices are kept on the stack.
const MOST: usize = 8;

/// A pose put into the design after a removal: log det(I + D_j + H H') and, with the blocks of
/// the trace, how much tr(M^-1 B) falls; H = A_j z'.
///
/// `traces` are (A_j Q A_j', F = A_j (L^-1 A_i Q)', N = z B z').
#[inline(always)]
fn addition_inner(
    b: usize,
    d_in: &[f64],
    h: &[f64],
    traces: Option<(&[f64], &[f64], &[f64])>,
) -> Option<(f64, f64)> {
    let mut l = [0.0f64; MOST * MOST];
    for r in 0..b {
        for c in 0..=r {
            let mut sum = d_in[r * b + c];
            for a in 0..b {
                sum += h[r * b + a] * h[c * b + a];
            }
            l[r * b + c] = sum;
        }
        l[r * b + r] += 1.0;
    }
    let (mut det, mut scale) = (1.0, [0.0f64; MOST]);
    for j in 0..b {
        for i in j..b {
            let mut sum = l[i * b + j];
            for a in 0..j {
                sum -= l[i * b + a] * l[j * b + a];
            }
            l[i * b + j] = sum;
        }
        let pivot = l[j * b + j];
        if !(pivot > 0.0 && pivot.is_finite()) {
            return None;
        }
        det *= pivot;
        scale[j] = 1.0 / pivot.sqrt();
        for i in j..b {
            l[i * b + j] *= scale[j];
        }
    }
    let log = det.ln();
    let Some((e_in, f, n)) = traces else {
        return Some((log, 0.0));
    };
    // tr(S^-1 (E + H F' + F H' + H N H')), S = L L'.
    let mut hn = [0.0f64; MOST * MOST];
    for r in 0..b {
        for c in 0..b {
            let mut sum = 2.0 * f[r * b + c];
            for a in 0..b {
                sum += h[r * b + a] * n[a * b + c];
            }
            hn[r * b + c] = sum;
        }
    }
    let mut w = [0.0f64; MOST * MOST];
    for r in 0..b {
        for c in 0..b {
            let mut sum = e_in[r * b + c];
            for a in 0..b {
                sum += hn[r * b + a] * h[c * b + a];
            }
            w[r * b + c] = sum;
        }
    }
    // Columns of W one by one through L and L'; only the diagonal of the result is needed.
    let mut lowered = 0.0;
    for c in 0..b {
        let mut x = [0.0f64; MOST];
        for r in 0..b {
            let mut sum = w[r * b + c];
            for a in 0..r {
                sum -= l[r * b + a] * x[a];
            }
            x[r] = sum * scale[r];
        }
        for r in (c..b).rev() {
            let mut sum = x[r];
            for a in r + 1..b {
                sum -= l[a * b + r] * x[a];
            }
            x[r] = sum * scale[r];
        }
        lowered += x[c];
    }
    Some((log, lowered))
}

/// [`addition_inner`], unrolled for the sizes that occur.
pub(crate) fn addition(
    b: usize,
    d_in: &[f64],
    h: &[f64],
    traces: Option<(&[f64], &[f64], &[f64])>,
) -> Option<(f64, f64)> {
    match b {
        6 => addition_inner(6, &d_in[..36], &h[..36], traces),
        _ => addition_inner(b.min(MOST), d_in, h, traces),
    }
}

/// N = z B z' = (L^-1 A_i Q A_i' L^-T) of b x b, from y = L^-1 A_i Q and the pose's rows.
pub(crate) fn removed_trace(removal: &Removal, y: &[f64], rows: &[f64], b: usize) -> Vec<f64> {
    let k = rows.len() / b;
    let mut n = vec![0.0; b * b];
    for r in 0..b {
        for c in 0..b {
            n[r * b + c] = dot(&y[r * k..(r + 1) * k], &rows[c * k..(c + 1) * k]);
        }
    }
    let mut out = vec![0.0; b * b];
    for r in 0..b {
        for c in 0..b {
            out[r * b + c] = (0..b)
                .map(|a| n[r * b + a] * removal.inv_lower[c * b + a])
                .sum();
        }
    }
    out
}
