//! The reference load case from rest on growing meshes: where the time goes, how it grows with
//! the nodes, and what the own nested dissection saves against minimum degree.
//!
//! cargo run --release -p ecm-fem --example where_time_goes
#![allow(clippy::print_stdout)]

use ecm_fem::{Fem, FemError, Load, Mesh, NeoHookean, Ordering, Quality};
use std::time::Instant;

/// Slope of a straight line through (ln x, ln y).
fn exponent(points: &[(f64, f64)]) -> f64 {
    let n = points.len() as f64;
    let (sx, sy) = points
        .iter()
        .fold((0.0, 0.0), |s, p| (s.0 + p.0.ln(), s.1 + p.1.ln()));
    let (mx, my) = (sx / n, sy / n);
    let (mut xy, mut xx) = (0.0, 0.0);
    for (x, y) in points {
        xy += (x.ln() - mx) * (y.ln() - my);
        xx += (x.ln() - mx).powi(2);
    }
    xy / xx
}

fn main() -> Result<(), FemError> {
    let custom = |rings, layers, around| Quality::Custom {
        rings,
        layers,
        around,
        layer_grading_per_mille: 150,
        ring_grading_per_mille: 80,
    };
    let mut growth = Vec::new();
    let mut factor_growth = Vec::new();
    println!(
        "  nodes unknowns Newton  time s | assembly factor solve rest % | \
         nnz L, Gmult, s of one factorisation: dissection, minimum degree"
    );
    for quality in [
        custom(2, 6, 8),
        Quality::Standard,
        Quality::Fine,
        custom(3, 12, 15),
        custom(4, 14, 18),
        custom(5, 18, 24),
    ] {
        let mesh = Mesh::cylinder(0.1034, 0.033, quality)?;
        let nodes = mesh.nodes_m().len();
        let fem = Fem::new(mesh, Box::new(NeoHookean::new(0.72e6, 0.49)?), None)?;
        let mut best = (f64::INFINITY, Default::default(), 0);
        for _ in 0..3 {
            let start = Instant::now();
            let (r, timing) = fem.solve(Load::Wrench([-40.0, 30.0, 20.0, 1.0, -1.0, 1.0]))?;
            let total = start.elapsed().as_secs_f64();
            if total < best.0 {
                best = (total, timing, r.iterations);
            }
        }
        let (total, timing, newton) = best;
        let share = |s: f64| 100.0 * s / total;
        let rest = total - timing.assembly_s - timing.factor_s - timing.solve_s;
        let own = fem.ordering_cost(Ordering::NestedDissection)?;
        let degree = fem.ordering_cost(Ordering::MinimumDegree)?;
        println!(
            "{nodes:7} {:8} {newton:6} {total:7.3} | {:8.0} {:6.0} {:5.0} {:6.0} | \
             {:9} {:6.2} {:6.4}, {:9} {:6.2} {:6.4}",
            fem.sizes().0,
            share(timing.assembly_s),
            share(timing.factor_s),
            share(timing.solve_s),
            share(rest),
            own.entries,
            own.multiplications / 1e9,
            own.seconds,
            degree.entries,
            degree.multiplications / 1e9,
            degree.seconds,
        );
        growth.push((nodes as f64, total / newton as f64));
        factor_growth.push((nodes as f64, own.multiplications));
    }
    println!(
        "time of an iteration grows like nodes^{:.2}, multiplications of a factorisation like nodes^{:.2}",
        exponent(&growth),
        exponent(&factor_growth)
    );
    Ok(())
}
