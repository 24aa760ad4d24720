//! The reference load case on nested meshes graded to the rims, and its limit by Richardson.
//!
//! All meshes cut the cells of one coarse mesh in n along every direction; the error falls like
//! n⁻ᵖ with p measured from three of them (the clamped rims are singular, so p is near 1.7, not
//! 3). The error bar of a limit is half the last correction. Ends with an error where a limit and
//! the answer of the independent solver are further apart than both error bars together.
//!
//! cargo run --release -p ecm-fem --example extrapolate [2 3 4]      (default 2 4 8, minutes)
#![allow(clippy::print_stdout, missing_docs)]

use ecm_fem::{Fem, FemError, Mesh, NeoHookean, Quality};

/// t in mm and θ in rad of the independent solver, each with its error bar (docs/fem.md).
const REFERENCE: [(&str, f64, f64); 6] = [
    ("tx", -8.96, 0.03),
    ("ty", 30.11, 0.03),
    ("tz", 25.73, 0.03),
    ("thx", 0.1936, 3e-4),
    ("thy", -0.3505, 3e-4),
    ("thz", 0.4450, 3e-4),
];

/// One ring, three layers, four cells around, each cut in `n`; graded as 0.25 along and 0.3 across
/// at n = 2. Cutting a graded cell in k takes the k-th root of the ratio of neighbours.
fn nested(n: usize) -> Quality {
    let m = n as f64;
    let along = 0.25f64.powf(2.0 / (2.5 * m) * (1.75 * m - 1.0));
    let across = 0.3f64.powf(2.0 / m * (m - 1.0));
    Quality::Custom {
        rings: n,
        layers: 3 * n,
        around: 4 * n,
        layer_grading_per_mille: (1e3 * along).round() as u32,
        ring_grading_per_mille: (1e3 * across).round() as u32,
    }
}

/// Order and limit of three values at 1/h = n; no order where they do not fall alike.
fn richardson(n: [f64; 3], v: [f64; 3]) -> Option<(f64, f64)> {
    let ratio = (v[2] - v[1]) / (v[1] - v[0]);
    let power = |k: usize, p: f64| n[k].powf(-p);
    let modelled = |p: f64| (power(1, p) - power(2, p)) / (power(0, p) - power(1, p));
    let (mut low, mut high) = (0.5, 6.0);
    // The ratio falls with the order.
    if !(modelled(high) < ratio && ratio < modelled(low)) {
        return None;
    }
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if modelled(middle) > ratio {
            low = middle;
        } else {
            high = middle;
        }
    }
    let share = power(2, low) / (power(1, low) - power(2, low));
    Some((low, v[2] + share * (v[2] - v[1])))
}

/// Limit of one component with its error bar, and the line that says so.
pub struct Limit {
    pub value: f64,
    pub bar: f64,
    pub line: String,
    pub agrees: bool,
}

/// The six limits from meshes of so many cuts; `say` is told of every mesh.
pub fn limits(cuts: [usize; 3], say: impl Fn(String)) -> Result<Vec<Limit>, FemError> {
    let mut poses = [[0.0; 6]; 3];
    for (moved, n) in poses.iter_mut().zip(cuts) {
        let mesh = Mesh::cylinder(0.1034, 0.033, nested(n))?;
        let nodes = mesh.nodes_m().len();
        let fem = Fem::new(mesh, Box::new(NeoHookean::new(0.72e6, 0.49)?), None)?;
        let r = fem.solve_wrench(&[-40.0, 30.0, 20.0, 1.0, -1.0, 1.0])?;
        *moved = r.pose;
        moved[0] -= 0.1034;
        moved[..3].iter_mut().for_each(|v| *v *= 1e3);
        say(format!(
            "{nodes:6} nodes, {} {:.4?}",
            r.status.word(),
            moved
        ));
    }
    let of = |(k, (name, reference, reference_bar)): (usize, &(&str, f64, f64))| {
        let v = poses.map(|p| p[k]);
        let (order, value, bar) = match richardson(cuts.map(|n| n as f64), v) {
            Some((p, limit)) => (format!("{p:.2}"), limit, 0.5 * (limit - v[2]).abs()),
            // The differences are too small to have an order: all meshes agree.
            None => ("none".into(), v[2], (v[2] - v[1]).abs()),
        };
        Limit {
            value,
            bar,
            line: format!(
                "{name}: order {order}, limit {value:.4} +- {bar:.4}, \
                 reference {reference} +- {reference_bar}"
            ),
            agrees: (value - reference).abs() <= bar + reference_bar,
        }
    };
    Ok(REFERENCE.iter().enumerate().map(of).collect())
}

#[allow(dead_code)]
fn main() -> Result<(), Box<dyn std::error::Error>> {
    let given: Vec<usize> = std::env::args()
        .skip(1)
        .map(|a| a.parse())
        .collect::<Result<_, _>>()?;
    let cuts: [usize; 3] = match given[..] {
        [] => [2, 4, 8],
        [a, b, c] if 1 < a && a < b && b < c => [a, b, c],
        _ => return Err("expected three growing numbers of cuts from 2 on".into()),
    };
    let found = limits(cuts, |line| println!("{line}"))?;
    for limit in &found {
        println!("{}", limit.line);
    }
    if found.iter().all(|limit| limit.agrees) {
        println!("limits and reference agree within their error bars");
        return Ok(());
    }
    Err("a limit and the reference are further apart than both error bars".into())
}
