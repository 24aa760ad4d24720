//! The inner loops of the exchange in single precision, with the SIMD width of the machine.
//!
//! They add and multiply elementwise and in a fixed order, so every width gives the same bits.

use pulp::Arch;

/// max over c of free_c [(1 + d_c)(1 - d_out) + g_c^2], and the first c that attains it.
pub(crate) fn scan(arch: Arch, g: &[f32], d: &[f32], free: &[f32], d_out: f32) -> (f32, usize) {
    arch.dispatch(
        #[inline(always)]
        || scan_inner(g, d, free, d_out),
    )
}

#[inline(always)]
fn scan_inner(g: &[f32], d: &[f32], free: &[f32], d_out: f32) -> (f32, usize) {
    let top = row_maximum(g, d, free, d_out);
    let rest = 1.0 - d_out;
    let at = g
        .iter()
        .zip(d)
        .zip(free)
        .position(|((g, d), f)| ((1.0 + d) * rest + g * g) * f >= top)
        .unwrap_or(0);
    (top, at)
}

/// The best swap over all rows of G: (value, row, candidate).
pub(crate) fn scan_all(
    arch: Arch,
    g: &[f32],
    d: &[f32],
    free: &[f32],
    d_out: &[f32],
) -> (f32, usize, usize) {
    arch.dispatch(
        #[inline(always)]
        || {
            let width = d.len();
            let mut best = (0.0f32, 0, 0);
            for (row, (g, out)) in g.chunks_exact(width).zip(d_out).enumerate() {
                let top = row_maximum(g, d, free, *out);
                if top > best.0 {
                    best = (top, row, 0);
                }
            }
            let row = best.1;
            let (_, at) = scan_inner(&g[row * width..(row + 1) * width], d, free, d_out[row]);
            (best.0, row, at)
        },
    )
}

#[inline(always)]
fn row_maximum(g: &[f32], d: &[f32], free: &[f32], d_out: f32) -> f32 {
    const LANES: usize = 32;
    let rest = 1.0 - d_out;
    let mut best = [0.0f32; LANES];
    let (gc, dc, fc) = (
        g.chunks_exact(LANES),
        d.chunks_exact(LANES),
        free.chunks_exact(LANES),
    );
    let mut top = 0.0f32;
    for ((g, d), f) in gc
        .remainder()
        .iter()
        .zip(dc.remainder())
        .zip(fc.remainder())
    {
        let v = ((1.0 + d) * rest + g * g) * f;
        top = if v > top { v } else { top };
    }
    for ((g, d), f) in gc.zip(dc).zip(fc) {
        for l in 0..LANES {
            let v = ((1.0 + d[l]) * rest + g[l] * g[l]) * f[l];
            best[l] = if v > best[l] { v } else { best[l] };
        }
    }
    for b in best {
        top = if b > top { b } else { top };
    }
    top
}

/// out_c = sum_a u_a x_ac for x k x P.
pub(crate) fn combine(arch: Arch, u: &[f64], x: &[f32], out: &mut [f32]) {
    arch.dispatch(
        #[inline(always)]
        || {
            const TILE: usize = 64;
            let width = out.len();
            for (tile, out) in out.chunks_mut(TILE).enumerate() {
                let mut sum = [0.0f32; TILE];
                let at = tile * TILE;
                if out.len() == TILE {
                    for (a, u) in u.iter().enumerate() {
                        let u = *u as f32;
                        let x = &x[a * width + at..a * width + at + TILE];
                        for l in 0..TILE {
                            sum[l] += u * x[l];
                        }
                    }
                } else {
                    for (a, u) in u.iter().enumerate() {
                        let u = *u as f32;
                        for (s, x) in sum
                            .iter_mut()
                            .zip(&x[a * width + at..a * width + at + out.len()])
                        {
                            *s += u * x;
                        }
                    }
                }
                out.copy_from_slice(&sum[..out.len()]);
            }
        },
    );
}

/// G_r -= a_r g_in + b_r g_out for every row r, d -= the same form, in one pass.
pub(crate) fn downdate(
    arch: Arch,
    g: &mut [f32],
    d: &mut [f32],
    (g_in, g_out): (&[f32], &[f32]),
    factors: &[(f32, f32)],
    c: [f32; 3],
) {
    arch.dispatch(
        #[inline(always)]
        || {
            let width = g_in.len();
            for (row, (a, b)) in g.chunks_exact_mut(width).zip(factors) {
                for ((v, x), y) in row.iter_mut().zip(g_in).zip(g_out) {
                    *v -= a * x + b * y;
                }
            }
            for ((v, x), y) in d.iter_mut().zip(g_in).zip(g_out) {
                *v -= (c[0] * x + 2.0 * c[1] * y) * x + c[2] * y * y;
            }
        },
    );
}
