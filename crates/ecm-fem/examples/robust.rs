//! Random wrenches of the paper's Table I box, each alone from rest: how they end and why.
//!
//! cargo run --release -p ecm-fem --example robust [draws] [E, MPa] [P2/P1 | P2/P0 | P2] [rings layers around layer_grading ring_grading (per mille)]
#![allow(clippy::print_stdout)]

use ecm_fem::{
    CREASE, Fem, FemError, Formulation, Load, Mesh, NeoHookean, Quality, Settings, Status,
};

/// A linear congruential generator (Knuth, MMIX): enough to draw loads.
struct Draw(u64);

impl Draw {
    fn between(&mut self, low: f64, high: f64) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        low + (high - low) * (self.0 >> 11) as f64 / (1u64 << 53) as f64
    }
}

fn main() -> Result<(), FemError> {
    let args: Vec<f64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let count = args.first().map_or(60, |&n| n as usize);
    let young = args.get(1).copied().unwrap_or(0.65) * 1e6;
    let quality = match args.get(2..7) {
        Some(&[rings, layers, around, layer, ring]) => Quality::Custom {
            rings: rings as usize,
            layers: layers as usize,
            around: around as usize,
            layer_grading_per_mille: layer as u32,
            ring_grading_per_mille: ring as u32,
        },
        _ => Quality::Standard,
    };
    let formulation = match std::env::args().find(|a| a.starts_with('P')).as_deref() {
        Some("P2") => Formulation::Displacement,
        Some("P2/P0") => Formulation::ConstantPressure,
        _ => Formulation::TaylorHood,
    };
    let settings = Settings {
        formulation,
        ..Settings::default()
    };
    let mesh = Mesh::cylinder(0.1034, 0.033, quality)?;
    println!("{} nodes", mesh.nodes_m().len());
    let material = Box::new(NeoHookean::new(young, 0.49)?);
    let fem = Fem::with_settings(mesh, material, None, settings)?;
    let mut draw = Draw(1);
    let mut counts = std::collections::BTreeMap::<String, usize>::new();
    let mut newton = 0;
    let (mut wrong, mut beyond) = (0, 0);
    for case in 0..count {
        let mut h = [draw.between(-110.0, 30.0), 0.0, 0.0, 0.0, 0.0, 0.0];
        h[1..3]
            .iter_mut()
            .for_each(|v| *v = draw.between(-100.0, 100.0));
        h[3..].iter_mut().for_each(|v| *v = draw.between(-5.0, 5.0));
        let r = fem.solve(&Load::Wrench(h))?.0;
        let norm = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>().sqrt();
        *counts
            .entry(format!("{} {:?}", r.status.word(), r.reason))
            .or_default() += 1;
        newton += r.iterations;
        if r.status == Status::Solved {
            beyond += usize::from(r.stretch_ratio < CREASE);
            let back = fem.solve_pose(&r.pose)?;
            let miss = (0..6)
                .map(|k| {
                    (back.wrench[k] - h[k]).abs()
                        / if k < 3 { norm(&h[..3]) } else { norm(&h[3..]) }
                })
                .fold(0.0, f64::max);
            if back.status != Status::Solved || miss > 1e-6 {
                wrong += 1;
                println!("    pose-driven: {} off by {miss:.1e}", back.status.word());
            }
        }
        println!(
            "{case:3} {:13} {:8?} ratio {:.3} at {:.0?} mm, share {:.2} steps {:2} Newton {:3} eig {:7.3} inner {} J {:.3} stretch {:.2} rot {:.0} deg, force {:.0} N",
            r.status.word(),
            r.reason.map_or("-".into(), |v| format!("{v:?}")),
            r.stretch_ratio,
            r.most_compressed_m.map(|v| 1e3 * v),
            norm(&r.wrench) / norm(&h),
            r.load_steps,
            r.iterations,
            r.smallest_eigenvalue,
            r.inner_instabilities,
            r.smallest_jacobian,
            r.largest_stretch,
            norm(&r.pose[3..]).to_degrees(),
            norm(&h[..3])
        );
    }
    println!(
        "{counts:?}, {:.1} Newton a case; wrench recomputed from the pose wrong in {wrong}; solved beyond the crease threshold {beyond}",
        newton as f64 / count as f64
    );
    Ok(())
}
