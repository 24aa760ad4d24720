//! Many random wrenches of the neck, screened by the rod and solved as one batch.
//!
//! cargo run --release -p ecm-fem --example batch [pairs] [largest rotation, rad]
#![allow(clippy::print_stdout)]

mod common;

use common::Draw;
use ecm_fem::{Fem, FemError, Load, Mesh, NeoHookean, Quality, Rod, Status, Watch};
use std::f64::consts::PI;
use std::time::Instant;

/// Processor time of this process (Linux; 0 elsewhere): meaningful on a busy machine too.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let fields: Vec<f64> = stat
        .split_whitespace()
        .skip(13)
        .take(2)
        .filter_map(|v| v.parse().ok())
        .collect();
    fields.iter().sum::<f64>() / 100.0
}

fn main() -> Result<(), FemError> {
    let args: Vec<f64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let count = args.first().map_or(300, |&n| n as usize);
    let limit = args.get(1).copied().unwrap_or(0.8);
    let (length_m, r, e, nu): (f64, f64, f64, f64) = (0.1034, 0.033, 0.65e6, 0.49);
    let (area, inertia) = (PI * r * r, PI * r.powi(4) / 4.0);
    let g = e / (2.0 * (1.0 + nu));
    let rod = Rod {
        length_m,
        axial_stiffness_N: e * area,
        shear_stiffness_N: 0.9 * g * area,
        bending_stiffness_Nm2: e * inertia,
        torsion_stiffness_Nm2: 2.0 * g * inertia,
    };
    let mut draw = Draw(1);
    let (mut loads, mut drawn, mut failed) = (Vec::new(), 0, 0);
    let start = Instant::now();
    while loads.len() < count {
        drawn += 1;
        let h = draw.wrench();
        let (p, converged) = rod.pose(&h);
        failed += usize::from(!converged);
        if (p[3] * p[3] + p[4] * p[4] + p[5] * p[5]).sqrt() <= limit {
            loads.push(Load::Wrench(h));
        }
    }
    println!(
        "rod: {drawn} drawn, {failed} not converged, {count} kept, {:.1} us each",
        1e6 * start.elapsed().as_secs_f64() / drawn as f64
    );
    let mesh = Mesh::cylinder(length_m, r, Quality::Standard)?;
    let fem = Fem::new(mesh, Box::new(NeoHookean::new(e, nu)?), None)?;
    let start = Instant::now();
    let cpu = cpu_seconds();
    let (mut known, mut guess) = (Vec::new(), None);
    while known.len() < count {
        let next = if known.len() < 1024 {
            2 * known.len()
        } else {
            count
        };
        let until = count.min(next.max(16));
        let group = &loads[known.len()..until];
        let found = fem.solve_from(group, guess.as_ref(), Watch::default(), &|_, _| {})?;
        let part = |solved: bool| {
            let newton: Vec<usize> = (found.iter().map(|o| &o.result))
                .filter(|r| (r.status == Status::Solved) == solved)
                .map(|r| r.iterations)
                .collect();
            let mean = newton.iter().sum::<usize>() as f64 / newton.len().max(1) as f64;
            let most = newton.iter().max().unwrap_or(&0);
            format!("{} cases {mean:.2} (most {most})", newton.len())
        };
        println!(
            "  Newton to case {until:4}: solved {}, else {}",
            part(true),
            part(false)
        );
        known.extend(found);
        if known.len() <= 1024 {
            let states: Vec<_> = known.iter().filter(|o| o.is_state()).collect();
            let at: Vec<_> = states
                .iter()
                .map(|o| Load::Wrench(o.result.wrench))
                .collect();
            let fields: Vec<_> = states.iter().map(|o| o.field.as_slice()).collect();
            guess = fem
                .fit_warm_start(&at, &fields, Watch::default())?
                .or(guess);
        }
    }
    let results: Vec<_> = known.iter().map(|o| &o.result).collect();
    let cpu = cpu_seconds() - cpu;
    let seconds = start.elapsed().as_secs_f64();
    let mean = |f: &dyn Fn(&ecm_fem::CaseResult) -> f64| {
        results.iter().map(|r| f(r)).sum::<f64>() / results.len() as f64
    };
    let angle = |r: &ecm_fem::CaseResult| (3..6).map(|k| r.pose[k] * r.pose[k]).sum::<f64>().sqrt();
    println!(
        "fem: {seconds:.2} s, {cpu:.2} s of processor, {:.1} ms each, {:.2} Newton and {:.2} factorisations a case, {:.3} load steps, within the limit {:.3}",
        1e3 * cpu / count as f64,
        mean(&|r| r.iterations as f64),
        mean(&|r| r.factorisations as f64),
        mean(&|r| r.load_steps as f64),
        mean(&|r| f64::from(u8::from(angle(r) <= limit))),
    );
    for status in [
        Status::Solved,
        Status::Unstable,
        Status::NotConverged,
        Status::Inverted,
    ] {
        let group: Vec<_> = results.iter().filter(|r| r.status == status).collect();
        let newton: usize = group.iter().map(|r| r.iterations).sum();
        println!(
            "  {}: {}, {:.2} Newton a case",
            status.word(),
            group.len(),
            newton as f64 / group.len().max(1) as f64
        );
    }
    Ok(())
}
