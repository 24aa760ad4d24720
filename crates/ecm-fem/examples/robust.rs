//! Random wrenches of the paper's whole Table I box: how each ends and why, whether every solved pose
//! gives its wrench back when it is prescribed, and how every refused case ends on another mesh.
//!
//! cargo run --release -p ecm-fem --example robust [draws] [E, MPa] [P2/P1 | P2/P0 | P2]
#![allow(clippy::print_stdout)]

mod common;

use common::Draw;
use ecm_fem::{
    CREASE, CaseResult, Fem, FemError, Formulation, Load, Mesh, NeoHookean, Quality, Settings,
    Status, Watch,
};

/// A mesh that shares no inner node with the standard one.
const OTHER: Quality = Quality::Custom {
    rings: 2,
    layers: 7,
    around: 9,
    layer_grading_per_mille: 300,
    ring_grading_per_mille: 500,
};

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Largest difference of a component, over the size of the force and of the moment.
fn miss(found: &[f64; 6], wanted: &[f64; 6]) -> f64 {
    (0..6)
        .map(|k| {
            let size = norm(if k < 3 { &wanted[..3] } else { &wanted[3..] });
            (found[k] - wanted[k]).abs() / size
        })
        .fold(0.0, f64::max)
}

fn line(case: usize, wrench: &[f64; 6], r: &CaseResult) -> String {
    format!(
        "{case:3} {:13} {:8} smallest stretch {:.3} at {:.0?} mm, share {:.2} Newton {:3} eig {:7.3} J {:.3} stretch {:.2} rot {:.0} deg",
        r.status.word(),
        r.reason.map_or("-".into(), |v| format!("{v:?}")),
        r.smallest_stretch,
        r.most_compressed_m.map(|v| 1e3 * v),
        norm(&r.wrench) / norm(wrench),
        r.iterations,
        r.smallest_eigenvalue,
        r.smallest_jacobian,
        r.largest_stretch,
        norm(&r.pose[3..]).to_degrees(),
    )
}

fn main() -> Result<(), FemError> {
    let args: Vec<f64> = std::env::args()
        .skip(1)
        .filter_map(|a| a.parse().ok())
        .collect();
    let count = args.first().map_or(500, |&n| n as usize);
    let young = args.get(1).copied().unwrap_or(0.65) * 1e6;
    let formulation = match std::env::args().find(|a| a.starts_with('P')).as_deref() {
        Some("P2") => Formulation::Displacement,
        Some("P2/P0") => Formulation::ConstantPressure,
        _ => Formulation::TaylorHood,
    };
    let settings = Settings {
        formulation,
        ..Settings::default()
    };
    let mesh = Mesh::cylinder(0.1034, 0.033, Quality::Standard)?;
    let material = Box::new(NeoHookean::new(young, 0.49)?);
    let fem = Fem::with_settings(mesh, material, None, settings.clone())?;
    let mut draw = Draw(1);
    let wrenches: Vec<[f64; 6]> = (0..count).map(|_| draw.wrench()).collect();
    let loads: Vec<Load> = wrenches.iter().map(|&h| Load::Wrench(h)).collect();
    let found = fem.solve_all(&loads, Watch::default())?;

    let other = Mesh::cylinder(0.1034, 0.033, OTHER)?;
    let material = Box::new(NeoHookean::new(young, 0.49)?);
    let other = Fem::with_settings(other, material, None, settings)?;
    let mut refused_there = 0;
    let mut counts = std::collections::BTreeMap::<String, usize>::new();
    for (case, (r, h)) in found.iter().zip(&wrenches).enumerate() {
        let reason = r.reason.map_or(String::new(), |v| format!(" {v:?}"));
        *counts
            .entry(format!("{}{reason}", r.status.word()))
            .or_default() += 1;
        if r.status != Status::Solved {
            println!("{}", line(case, h, r));
            let there = other.solve_wrench(h)?;
            println!("   other mesh: {}", line(case, h, &there));
            refused_there += usize::from(there.status != Status::Solved);
        }
    }
    let solved: Vec<usize> = (0..count)
        .filter(|&i| found[i].status == Status::Solved)
        .collect();
    let poses: Vec<Load> = solved.iter().map(|&i| Load::Pose(found[i].pose)).collect();
    let back = fem.solve_all(&poses, Watch::default())?;
    let (mut wrong, mut lost, mut worst) = (0, 0, 0.0_f64);
    for (&i, r) in solved.iter().zip(&back) {
        let off = miss(&r.wrench, &wrenches[i]);
        if r.status != Status::Solved {
            lost += 1;
            println!("prescribed: {}", line(i, &wrenches[i], r));
        } else if off > 1e-6 {
            wrong += 1;
            println!(
                "prescribed: off by {off:.1e}: {}",
                line(i, &wrenches[i], &found[i])
            );
        } else {
            worst = worst.max(off);
        }
    }
    let answered = (found.iter())
        .filter(|r| r.status == Status::Solved || r.reason.is_some())
        .count();
    let beyond = (solved.iter())
        .filter(|&&i| found[i].smallest_stretch < CREASE)
        .count();
    println!(
        "{counts:?}; {answered} of {count} solved or unstable with the reason\nof {} refused, {refused_there} are refused on the other mesh\nwrench of the prescribed pose: {} agree (worst {worst:.1e}), {wrong} wrong, {lost} without a state; {beyond} solved beyond the crease threshold",
        count - solved.len(),
        solved.len() - wrong - lost
    );
    Ok(())
}
