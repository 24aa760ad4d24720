//! Poses, wrenches, stiffnesses and energy belong together; batches change nothing.
#![allow(clippy::unwrap_used, missing_docs)]

use ecm_fem::{Fem, Load, Mesh, NeoHookean, Quality, Status, Watch};
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};

fn fem() -> Fem {
    let quality = Quality::custom([1, 4, 7], [500, 1000]);
    let mesh = Mesh::cylinder(0.1034, 0.033, quality).unwrap();
    Fem::new(mesh, Box::new(NeoHookean::new(0.65e6, 0.49).unwrap()), None).unwrap()
}

const WRENCH: [f64; 6] = [-40.0, 30.0, 20.0, 1.0, -1.0, 1.0];

#[test]
fn pose_driven_returns_the_wrench() {
    let fem = fem();
    let there = fem.solve_wrench(&WRENCH).unwrap();
    let back = fem.solve_pose(&there.pose).unwrap();
    assert_eq!(back.status, Status::Solved);
    for k in 0..6 {
        assert!((back.wrench[k] - WRENCH[k]).abs() < 1e-6 * if k < 3 { 50.0 } else { 2.0 });
    }
    assert!((back.energy_J / there.energy_J - 1.0).abs() < 1e-9);
    assert!(there.largest_stretch > 1.1 && there.smallest_jacobian > 0.5);
}

#[test]
fn stiffness_and_forces_are_finite_differences() {
    let fem = fem();
    let at = fem.solve_wrench(&WRENCH).unwrap();
    let j = ecm_se3::left_jacobian(&[at.pose[3], at.pose[4], at.pose[5]]);
    for k in 0..6 {
        let h = if k < 3 { 1e-6 } else { 1e-5 };
        let moved = |s: f64| {
            let mut p = at.pose;
            p[k] += s * h;
            fem.solve_pose(&p).unwrap()
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        for i in 0..6 {
            let fd = (up.wrench[i] - down.wrench[i]) / (2.0 * h);
            let scale = (at.stiffness[i][i] * at.stiffness[k][k]).abs().sqrt();
            assert!(
                (fd - at.stiffness[i][k]).abs() < 1e-5 * scale,
                "{i} {k}: {fd}"
            );
        }
        // dU/dp = (f, Jᵀ τ).
        let generalised = if k < 3 {
            at.wrench[k]
        } else {
            (0..3).map(|i| j[i][k - 3] * at.wrench[3 + i]).sum()
        };
        let fd = (up.energy_J - down.energy_J) / (2.0 * h);
        assert!(
            (fd - generalised).abs() < 1e-5 * generalised.abs().max(1.0),
            "{k}: {fd}"
        );
    }
}

#[test]
fn hessian_is_symmetric_although_the_stiffness_is_not() {
    let r = fem().solve_wrench(&WRENCH).unwrap();
    let mut skew: f64 = 0.0;
    for i in 0..6 {
        for k in 0..6 {
            let scale = (r.hessian[i][i] * r.hessian[k][k]).sqrt();
            assert!((r.hessian[i][k] - r.hessian[k][i]).abs() < 1e-9 * scale);
            skew = skew.max((r.stiffness[i][k] - r.stiffness[k][i]).abs() / scale);
        }
    }
    assert!(skew > 1e-3, "K itself carries the geometry: {skew}");
}

fn loads() -> Vec<Load> {
    (0..24)
        .map(|i| {
            let s = |k: usize| ((i * 37 + k * 17) as f64 * 0.7).sin();
            Load::Wrench([30.0 * s(0), 40.0 * s(1), 40.0 * s(2), s(3), s(4), s(5)])
        })
        .collect()
}

#[test]
fn batches_have_the_same_bits_on_any_number_of_threads() {
    let fem = fem();
    let run = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| fem.solve_all(&loads(), Watch::default()).unwrap())
    };
    let one = run(1);
    assert_eq!(one, run(3));
    for (result, load) in one.iter().zip(loads()) {
        assert_eq!(result.status, Status::Solved);
        let alone = fem.solve(load).unwrap().0;
        for k in 0..6 {
            assert!((result.pose[k] - alone.pose[k]).abs() < 1e-8);
        }
    }
}

#[test]
fn batches_of_poses_and_empty_batches() {
    let fem = fem();
    assert!(
        fem.solve_all::<Load>(&[], Watch::default())
            .unwrap()
            .is_empty()
    );
    let poses: Vec<Load> = fem
        .solve_all(&loads(), Watch::default())
        .unwrap()
        .iter()
        .map(|r| Load::Pose(r.pose))
        .collect();
    let back = fem.solve_all(&poses, Watch::default()).unwrap();
    for (r, load) in back.iter().zip(loads()) {
        let Load::Wrench(h) = load else { continue };
        assert_eq!(r.status, Status::Solved);
        for k in 0..6 {
            assert!((r.wrench[k] - h[k]).abs() < 1e-4);
        }
    }
}

#[test]
fn cancelled_batches_say_so_and_progress_counts() {
    let fem = fem();
    let (cancel, done) = (AtomicBool::new(true), AtomicUsize::new(0));
    let watch = Watch {
        cancel: Some(&cancel),
        done: Some(&done),
    };
    let results = fem.solve_all(&loads(), watch).unwrap();
    assert!(results.iter().all(|r| r.status == Status::Cancelled));
    cancel.store(false, Ordering::Relaxed);
    done.store(0, Ordering::Relaxed);
    fem.solve_all(&loads()[..5], watch).unwrap();
    assert_eq!(done.load(Ordering::Relaxed), 5);
}

#[test]
fn stiffer_elements_make_a_stiffer_body() {
    let mesh = fem().mesh().clone();
    let build = |scale: Vec<f64>| {
        let material = Box::new(NeoHookean::new(0.65e6, 0.49).unwrap());
        Fem::new(mesh.clone(), material, Some(scale))
            .unwrap()
            .rest_stiffness(Watch::default())
            .unwrap()
    };
    let count = mesh.tetrahedra().len();
    let (soft, hard) = (build(vec![1.0; count]), build(vec![1.3; count]));
    for k in 0..6 {
        assert!((hard[k][k] / soft[k][k] - 1.3).abs() < 1e-9);
    }
    let uneven = build(
        (0..count)
            .map(|e| if e % 2 == 0 { 1.0 } else { 1.3 })
            .collect(),
    );
    assert!(uneven[0][0] > soft[0][0] && uneven[0][0] < hard[0][0]);
}
