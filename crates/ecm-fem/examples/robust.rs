//! Random wrenches of the paper's whole Table I box: how each ends and why, and whether every solved pose
//! gives its wrench back when it is prescribed. Every refused case is solved on another mesh, and on a
//! finer one where that solves it; and the platform is held beyond its last stable pose.
//!
//! cargo run --release -p ecm-fem --example robust [draws] [E, MPa] [P2/P1 | P2/P0 | P2]
#![allow(clippy::print_stdout)]

mod common;

use common::Draw;
use ecm_fem::{
    CREASE, CaseResult, Fem, FemError, Formulation, Load, Mesh, NeoHookean, Outcome, Quality,
    Settings, Status, WarmStart, Watch,
};

/// A mesh that shares no inner node with the standard one.
const OTHER: Quality = Quality::custom([2, 7, 9], [300, 500]);

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

/// The neck with another mesh or element.
fn neck(quality: Quality, young: f64, settings: &Settings) -> Result<Fem, FemError> {
    let mesh = Mesh::cylinder(0.1034, 0.033, quality)?;
    let material = Box::new(NeoHookean::new(young, 0.49)?);
    Fem::with_settings(mesh, material, None, settings.clone())
}

/// A warm start that is one state for every load: one term of degree 0 in a row of seven.
fn one_state(outcome: &Outcome) -> Option<WarmStart> {
    let mut bytes: Vec<u8> = [1_u32, 7].iter().flat_map(|n| n.to_le_bytes()).collect();
    bytes.extend([1.0_f64; 6].iter().flat_map(|v| v.to_le_bytes()));
    for value in &outcome.field {
        bytes.extend(value.to_le_bytes());
        bytes.extend([0; 4 * 6]);
    }
    WarmStart::from_bytes(&bytes)
}

/// The platform held, from the last stable state on: the share of the step from the pose at 1 % less
/// of the wrench at which no stable state is found beyond; 0 in the last stable pose itself, none
/// where the body is stable 5 % beyond.
fn gives_way_held(fem: &Fem, wrench: &[f64; 6]) -> Result<Option<f64>, FemError> {
    let watch = Watch::default();
    let solve = |h: [f64; 6]| fem.solve_from(&[Load::Wrench(h)], None, watch, &|_, _| {});
    let last = solve(*wrench)?.remove(0);
    let before = fem.solve_wrench(&last.result.wrench.map(|v| 0.99 * v))?;
    let Some(guess) = one_state(&last) else {
        return Ok(None);
    };
    let (from, to) = (before.pose, last.result.pose);
    for share in [0.0, 0.25, 0.5, 1.0, 2.0, 5.0] {
        let pose = std::array::from_fn(|k| to[k] + share * (to[k] - from[k]));
        let held = fem.solve_from(&[Load::Pose(pose)], Some(&guess), watch, &|_, _| {})?;
        if held[0].result.status != Status::Solved {
            return Ok(Some(share));
        }
    }
    Ok(None)
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
    let fem = neck(Quality::Standard, young, &settings)?;
    let mut draw = Draw(1);
    let wrenches: Vec<[f64; 6]> = (0..count).map(|_| draw.wrench()).collect();
    let loads: Vec<Load> = wrenches.iter().map(|&h| Load::Wrench(h)).collect();
    let found = fem.solve_all(&loads, Watch::default())?;

    let other = neck(OTHER, young, &settings)?;
    let fine = neck(Quality::Fine, young, &settings)?;
    let (mut on_other, mut on_fine, mut when_held, mut without) = (0, 0, 0, 0);
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
            let mut refused_there = there.status == Status::Unstable;
            on_other += usize::from(refused_there);
            if !refused_there {
                let there = fine.solve_wrench(h)?;
                println!("   fine mesh:  {}", line(case, h, &there));
                refused_there = there.status == Status::Unstable;
                on_fine += usize::from(refused_there);
            }
            let held = gives_way_held(&fem, h)?;
            println!("   held: gives way {held:?} of 1 % beyond");
            let refused_held = held.is_some_and(|share| share > 0.0);
            when_held += usize::from(refused_held);
            without += usize::from(!refused_there && !refused_held);
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
        "{counts:?}; {answered} of {count} solved or unstable with the reason\nof {} refused: {on_other} on the other mesh too, {on_fine} more on the fine one; {when_held} with the platform held; {without} by none of these\nwrench of the prescribed pose: {} agree (worst {worst:.1e}), {wrong} wrong, {lost} without a state; {beyond} solved beyond the crease threshold",
        count - solved.len(),
        solved.len() - wrong - lost
    );
    Ok(())
}
