//! The reference load case: pose, stiffness, error and where the time goes.
//!
//! cargo run --release -p ecm-fem --example reference [rings layers around layer_grading ring_grading]
#![allow(clippy::print_stdout)]

use ecm_fem::{Fem, FemError, Load, Mesh, NeoHookean, Quality, Watch};
use std::time::Instant;

fn main() -> Result<(), FemError> {
    let args: Vec<usize> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let qualities = match args[..] {
        [rings, layers, around, layer, ring] => vec![Quality::Custom {
            rings,
            layers,
            around,
            layer_grading_per_mille: u32::try_from(layer).unwrap_or(1000),
            ring_grading_per_mille: u32::try_from(ring).unwrap_or(1000),
        }],
        _ => vec![Quality::Standard, Quality::Fine],
    };
    for quality in qualities {
        let start = Instant::now();
        let mesh = Mesh::cylinder(0.1034, 0.033, quality)?;
        let nodes = mesh.nodes_m().len();
        let elements = mesh.tetrahedra().len();
        let fem = Fem::new(mesh, Box::new(NeoHookean::new(0.72e6, 0.49)?), None)?;
        let setup = start.elapsed().as_secs_f64();
        let start = Instant::now();
        let (r, timing) = fem.solve(Load::Wrench([-40.0, 30.0, 20.0, 1.0, -1.0, 1.0]))?;
        let total = start.elapsed().as_secs_f64();
        let (reference, p) = (
            [-8.96e-3, 30.11e-3, 25.73e-3, 0.1936, -0.3505, 0.4450],
            r.pose,
        );
        let moved = [p[0] - 0.1034, p[1], p[2], p[3], p[4], p[5]];
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        let miss: Vec<f64> = (0..6).map(|k| moved[k] - reference[k]).collect();
        let (n, lower, factor) = fem.sizes();
        println!(
            "{quality:?}: {nodes} nodes, {elements} tetrahedra, n {n}, nnz {lower}, nnz L {factor}"
        );
        println!(
            "  {:?} {} Newton in {} steps, residual {:.1e}, t {:.4} {:.4} {:.4} mm, theta {:.5} {:.5} {:.5}",
            r.status,
            r.iterations,
            r.load_steps,
            r.residual,
            1e3 * moved[0],
            1e3 * moved[1],
            1e3 * moved[2],
            moved[3],
            moved[4],
            moved[5]
        );
        println!(
            "  error t {:.3} %, theta {:.3} %, stretch {:.3}, J {:.4}, eigenvalue {:.3}",
            100.0 * norm(&miss[..3]) / norm(&reference[..3]),
            100.0 * norm(&miss[3..]) / norm(&reference[3..]),
            r.largest_stretch,
            r.smallest_jacobian,
            r.smallest_eigenvalue
        );
        let k = fem.rest_stiffness(Watch::default())?;
        println!(
            "  K0 {:.0} {:.1} {:.1} {:.4} {:.3} {:.3}, y-thz {:.2}",
            k[0][0], k[1][1], k[2][2], k[3][3], k[4][4], k[5][5], k[1][5]
        );
        println!(
            "  setup {setup:.3} s, solve {total:.3} s: assembly {:.3}, factor {:.3}, solves {:.3} ({} factorisations)",
            timing.assembly_s, timing.factor_s, timing.solve_s, timing.factorisations
        );
    }
    Ok(())
}
