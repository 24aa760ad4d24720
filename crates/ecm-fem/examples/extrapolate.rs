//! The reference load case on nested meshes graded to the rims, and its limit by Richardson.
//!
//! Every mesh halves all cells of the one before; the error falls like hᵖ with p measured
//! from three meshes (the clamped rims are singular, so p is near 1, not 3).
//!
//! cargo run --release -p ecm-fem --example extrapolate
#![allow(clippy::print_stdout)]

use ecm_fem::{Fem, FemError, Mesh, NeoHookean, Quality};

fn main() -> Result<(), FemError> {
    let mut poses: Vec<[f64; 6]> = Vec::new();
    // Halving a graded cell twice needs gradings q and √q per step: end over middle cell.
    for level in 0..3u32 {
        let n = 1usize << level;
        let shrink = |first: f64, steps: f64| {
            let per_step = first.powf(1.0 / (steps - 1.0));
            let finer = per_step.powf(1.0 / n as f64);
            (1e3 * finer.powf(steps * n as f64 - 1.0)).round() as u32
        };
        let quality = Quality::Custom {
            rings: 2 * n,
            layers: 6 * n,
            around: 8 * n,
            layer_grading_per_mille: shrink(0.25, 3.5),
            ring_grading_per_mille: shrink(0.3, 2.0),
        };
        let mesh = Mesh::cylinder(0.1034, 0.033, quality)?;
        let nodes = mesh.nodes_m().len();
        let fem = Fem::new(mesh, Box::new(NeoHookean::new(0.72e6, 0.49)?), None)?;
        let r = fem.solve_wrench(&[-40.0, 30.0, 20.0, 1.0, -1.0, 1.0])?;
        let p = r.pose;
        let moved = [
            1e3 * (p[0] - 0.1034),
            1e3 * p[1],
            1e3 * p[2],
            p[3],
            p[4],
            p[5],
        ];
        println!("{nodes:6} nodes, {} {:.4?}", r.status.word(), moved);
        poses.push(moved);
    }
    let [a, b, c] = poses[..] else { return Ok(()) };
    for (k, name) in ["tx", "ty", "tz", "thx", "thy", "thz"].iter().enumerate() {
        let order = ((b[k] - a[k]) / (c[k] - b[k])).log2();
        if order < 0.5 {
            // The differences are too small to have an order: all meshes agree.
            println!("{name}: limit {:.4} +- {:.4}", c[k], (c[k] - b[k]).abs());
            continue;
        }
        let limit = c[k] + (c[k] - b[k]) / (2f64.powf(order) - 1.0);
        println!(
            "{name}: order {order:.2}, limit {limit:.4} +- {:.4}",
            0.5 * (limit - c[k]).abs()
        );
    }
    Ok(())
}
