//! The Newton step of the continuous optimum: a quadratic programme over box and sum.

use pulp::Arch;

use super::Evaluation;
use crate::linalg::{dot, product, product_transposed};
use crate::problem::Problem;

/// Maximises g's - s'Hs/2 over the box and the sum by moving weight between two poses at a time.
///
/// Weight moves to the pose with the largest gradient from the pose with the largest gain.
pub(super) fn newton_step(
    problem: &Problem,
    set: &[usize],
    w: &[f64],
    eval: &Evaluation,
    cap: f64,
    accuracy: f64,
) -> Vec<f64> {
    let s = set.len();
    let hessian = hessian(problem, set, eval);
    let diagonal: Vec<f64> = (0..s).map(|i| hessian[i * s + i]).collect();
    let weight: Vec<f64> = set.iter().map(|&i| w[i]).collect();
    let mut step = vec![0.0; s];
    let mut gradient: Vec<f64> = set.iter().map(|&i| eval.phi[i]).collect();
    // Infinite for poses whose weight cannot rise or fall.
    let barred = |room: f64| if room > 0.0 { 0.0 } else { f64::INFINITY };
    let mut full: Vec<f64> = weight.iter().map(|w| barred(cap - w)).collect();
    let mut empty: Vec<f64> = weight.iter().map(|w| barred(*w)).collect();
    let mut gains = vec![0.0; s];
    let tolerance = (accuracy / weight.iter().sum::<f64>()).max(1e-13);
    let arch = Arch::new();
    for _ in 0..200 * s {
        let Some(up) = largest(arch, &gradient, &full) else {
            break;
        };
        let row = &hessian[up * s..(up + 1) * s];
        let pair = Partner {
            gradient: &gradient,
            empty: &empty,
            row,
            diagonal: &diagonal,
            best: gradient[up],
            own: row[up],
        };
        let Some((down, spread)) = pair.find(arch, &mut gains) else {
            break;
        };
        if spread < tolerance {
            break;
        }
        let curve = (row[up] + diagonal[down] - 2.0 * row[down]).max(LEAST_CURVE);
        let room_up = cap - (weight[up] + step[up]);
        let room_down = weight[down] + step[down];
        let best = (gradient[up] - gradient[down]) / curve;
        let amount = best.min(room_up).min(room_down);
        step[up] = if amount == room_up {
            cap - weight[up]
        } else {
            step[up] + amount
        };
        step[down] = if amount == room_down {
            -weight[down]
        } else {
            step[down] - amount
        };
        for i in [up, down] {
            full[i] = barred(cap - (weight[i] + step[i]));
            empty[i] = barred(weight[i] + step[i]);
        }
        let other = &hessian[down * s..(down + 1) * s];
        arch.dispatch(
            #[inline(always)]
            || {
                for ((g, a), c) in gradient.iter_mut().zip(row).zip(other) {
                    *g -= amount * (a - c);
                }
            },
        );
    }
    step
}

/// Curvature below which a direction counts as flat.
const LEAST_CURVE: f64 = 1e-12;
const LANES: usize = 8;

/// The first of the largest `values` that is not excluded.
fn largest(arch: Arch, values: &[f64], barred: &[f64]) -> Option<usize> {
    arch.dispatch(
        #[inline(always)]
        || {
            let mut top = [f64::NEG_INFINITY; LANES];
            let (vc, bc) = (values.chunks_exact(LANES), barred.chunks_exact(LANES));
            let rest = vc.remainder().iter().zip(bc.remainder());
            let mut best = rest.map(|(v, b)| v - b).fold(f64::NEG_INFINITY, f64::max);
            for (v, b) in vc.zip(bc) {
                for l in 0..LANES {
                    let value = v[l] - b[l];
                    top[l] = if value > top[l] { value } else { top[l] };
                }
            }
            best = top.into_iter().fold(best, f64::max);
            let found = values.iter().zip(barred);
            (best > f64::NEG_INFINITY)
                .then(|| found.map(|(v, b)| v - b).position(|v| v >= best))
                .flatten()
        },
    )
}

/// Gain of moving weight from each pose to the best one.
struct Partner<'a> {
    gradient: &'a [f64],
    /// Infinite for poses without weight.
    empty: &'a [f64],
    /// Row of the Hessian of the best one.
    row: &'a [f64],
    diagonal: &'a [f64],
    /// Gradient and curvature of the best one.
    best: f64,
    own: f64,
}

impl Partner<'_> {
    /// The pose with the largest gain, and the spread of the gradients of all poses with weight.
    #[inline(always)]
    fn find_inner(&self, gains: &mut [f64]) -> Option<(usize, f64)> {
        let (mut top, mut spread) = ([0.0f64; LANES], [f64::NEG_INFINITY; LANES]);
        let columns = self.gradient.chunks(LANES).zip(self.empty.chunks(LANES));
        let columns = columns.zip(self.row.chunks(LANES).zip(self.diagonal.chunks(LANES)));
        for (((g, e), (r, d)), out) in columns.zip(gains.chunks_mut(LANES)) {
            let width = out.len();
            let (g, e, r, d) = (&g[..width], &e[..width], &r[..width], &d[..width]);
            let mut one = |l: usize| {
                let slope = self.best - g[l] - e[l];
                spread[l] = if slope > spread[l] { slope } else { spread[l] };
                let slope = if slope > 0.0 { slope } else { 0.0 };
                let curve = self.own + d[l] - 2.0 * r[l];
                let curve = if curve > LEAST_CURVE {
                    curve
                } else {
                    LEAST_CURVE
                };
                out[l] = slope * slope / curve;
                top[l] = if out[l] > top[l] { out[l] } else { top[l] };
            };
            if width == LANES {
                for l in 0..LANES {
                    one(l);
                }
            } else {
                (0..width).for_each(one);
            }
        }
        let best = top.into_iter().fold(0.0, f64::max);
        let spread = spread.into_iter().fold(f64::NEG_INFINITY, f64::max);
        let down = gains.iter().position(|g| best > 0.0 && *g >= best)?;
        Some((down, spread))
    }

    fn find(&self, arch: Arch, gains: &mut [f64]) -> Option<(usize, f64)> {
        arch.dispatch(
            #[inline(always)]
            || self.find_inner(gains),
        )
    }
}

/// The negative second derivative of the objective over the poses of `set`, s x s.
fn hessian(problem: &Problem, set: &[usize], eval: &Evaluation) -> Vec<f64> {
    let (b, k, s) = (problem.block, problem.terms, set.len());
    let rows: Vec<f64> = set
        .iter()
        .flat_map(|&i| problem.pose(i).iter().copied())
        .collect();
    let mut t = vec![0.0; rows.len()];
    product_transposed(&mut t, (s * b, k, k), &rows, &eval.inv_lower);
    let Some(mixed) = &eval.mixed else {
        return block_products(&t, &t, 1.0, s, b, k);
    };
    let mut v = vec![0.0; t.len()];
    product(&mut v, (s * b, k, k), &t, &mixed.weighted);
    let scale = mixed.scale(k);
    let mut hessian = block_products(&t, &v, 2.0 * scale, s, b, k);
    // The logarithm of the trace takes psi psi' / tr^2 off again.
    for (row, &i) in hessian.chunks_exact_mut(s).zip(set) {
        let own = scale / mixed.trace * mixed.psi[i];
        for (h, &j) in row.iter_mut().zip(set) {
            *h -= own * mixed.psi[j];
        }
    }
    if mixed.share > 0.0 {
        let own = block_products(&t, &t, mixed.share, s, b, k);
        for (h, o) in hessian.iter_mut().zip(&own) {
            *h += o;
        }
    }
    hessian
}

/// H_ij = factor * sum of the entries of (T_i T_j') o (V_i V_j') for s blocks of b rows.
fn block_products(t: &[f64], v: &[f64], factor: f64, s: usize, b: usize, k: usize) -> Vec<f64> {
    let mut hessian = vec![0.0; s * s];
    if b == 1 {
        product_transposed(&mut hessian, (s, k, s), t, t);
        if std::ptr::eq(t, v) {
            hessian.iter_mut().for_each(|h| *h = factor * *h * *h);
        } else {
            let mut other = vec![0.0; s * s];
            product_transposed(&mut other, (s, k, s), v, v);
            for (h, o) in hessian.iter_mut().zip(&other) {
                *h *= factor * o;
            }
        }
        return hessian;
    }
    let (mut cross_t, mut cross_v) = (vec![0.0; b * s * b], vec![0.0; b * s * b]);
    let same = std::ptr::eq(t, v);
    for i in 0..s {
        let own = i * b * k..(i + 1) * b * k;
        product_transposed(&mut cross_t, (b, k, s * b), &t[own.clone()], t);
        if !same {
            product_transposed(&mut cross_v, (b, k, s * b), &v[own], v);
        }
        let other = if same { &cross_t } else { &cross_v };
        for j in 0..s {
            let mut sum = 0.0;
            for r in 0..b {
                let part = r * s * b + j * b..r * s * b + (j + 1) * b;
                sum += dot(&cross_t[part.clone()], &other[part]);
            }
            hessian[i * s + j] = factor * sum;
        }
    }
    hessian
}
