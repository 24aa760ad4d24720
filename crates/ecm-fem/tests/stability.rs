//! Where a loss of stability is reported, and where it is not.
#![allow(clippy::unwrap_used, missing_docs, non_snake_case)]

use ecm_fem::{Fem, Formulation, Mesh, NeoHookean, Quality, Reason, Settings, Status};

const COARSE: Quality = Quality::custom([1, 4, 6], [500, 1000]);

fn neck(quality: Quality) -> Fem {
    let mesh = Mesh::cylinder(0.1034, 0.033, quality).unwrap();
    Fem::new(mesh, Box::new(NeoHookean::new(0.65e6, 0.49).unwrap()), None).unwrap()
}

fn determinant(matrix: &[[f64; 6]; 6]) -> f64 {
    nalgebra::Matrix6::from_fn(|i, j| matrix[i][j]).determinant()
}

fn axial(force_N: f64) -> [f64; 6] {
    [force_N, 0.0, 0.0, 0.0, 0.0, 0.0]
}

/// Against P = μ A (l − l⁻²) of the free incompressible bar: bonded ends shorten the neck, and
/// beyond some 1385 N a platform that is free to turn tilts and lengthens it (docs/fem.md).
#[test]
fn tension_is_solved_to_3500_N() {
    let fem = neck(COARSE);
    let area = std::f64::consts::PI * 0.033 * 0.033;
    let mu = 0.65e6 / 2.98;
    let mut before = 1.0;
    for force in (1..=14).map(|i| 250.0 * f64::from(i)) {
        let r = fem.solve_wrench(&axial(force)).unwrap();
        assert_eq!(r.status, Status::Solved, "{force} N: {:?}", r.reason);
        let stretch = r.pose[0] / 0.1034;
        let of_free_bar = (stretch - stretch.powi(-2)) / (force / (mu * area));
        assert!(
            (0.85..1.05).contains(&of_free_bar),
            "{force} N: {of_free_bar}"
        );
        assert!(stretch > before, "{force} N: {stretch}");
        assert!(r.determinant > 0.0);
        before = stretch;
    }
    // The branch of the tilted platform ends at a limit point, wherever the path is aimed.
    for force in [4500.0, 5000.0, 6000.0] {
        let r = fem.solve_wrench(&axial(force)).unwrap();
        let verdict = (r.status, r.reason);
        assert_eq!(verdict, (Status::Unstable, Some(Reason::Buckling)));
        assert!((r.wrench[0] - 4291.0).abs() < 3.0, "{}", r.wrench[0]);
    }
}

#[test]
fn tension_is_solved_on_the_standard_mesh_too() {
    let fem = neck(Quality::Standard);
    for force in [1500.0, 3000.0] {
        let r = fem.solve_wrench(&axial(force)).unwrap();
        assert_eq!(r.status, Status::Solved, "{force} N: {:?}", r.reason);
    }
}

/// The tilt is no error of one element.
#[test]
fn the_platform_tilts_with_every_element() {
    for formulation in [
        Formulation::TaylorHood,
        Formulation::ConstantPressure,
        Formulation::Displacement,
    ] {
        let settings = Settings {
            formulation,
            ..Settings::default()
        };
        let mesh = Mesh::cylinder(0.1034, 0.033, Quality::Standard).unwrap();
        let material = Box::new(NeoHookean::new(0.65e6, 0.49).unwrap());
        let fem = Fem::with_settings(mesh, material, None, settings).unwrap();
        let turn = |force: f64| {
            let r = fem.solve_wrench(&axial(force)).unwrap();
            assert_eq!(r.status, Status::Solved, "{formulation:?} {force} N");
            r.pose[3..].iter().map(|v| v * v).sum::<f64>().sqrt()
        };
        let (straight, tilted) = (turn(1200.0), turn(1400.0));
        assert!(straight < 0.01, "{formulation:?}: {straight} rad");
        assert!(tilted > 0.1, "{formulation:?}: {tilted} rad");
    }
}

/// No equilibrium was found there, which says nothing about stability.
#[test]
fn a_pose_out_of_reach_is_not_converged() {
    let fem = neck(COARSE);
    for pose in [
        [100.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [0.1, -100.0, 0.0, 0.0, 1.0, 0.0],
    ] {
        let r = fem.solve_pose(&pose).unwrap();
        assert!(
            matches!(r.status, Status::NotConverged | Status::Inverted),
            "{:?} {:?}",
            r.status,
            r.reason
        );
        assert_eq!(r.reason, None);
    }
}

/// Along this ray det H falls and changes its sign while det K_s rises, so that H would call the platform
/// unstable from m = 159 on. A dead moment in space linearises to K_s: only K_s decides.
#[test]
fn a_dead_moment_is_judged_by_the_screw_stiffness() {
    let fem = neck(Quality::Standard);
    for (m, det_h, det_k_s) in [
        (145.0, 4.764e11, 3.298e6),
        (162.0, -5.737e10, 4.209e6),
        (165.0, -7.833e10, 4.471e6),
    ] {
        let h = [-1.0, 0.0, 0.2, 0.02, 0.02, 0.0].map(|v| m * v);
        let r = fem.solve_wrench(&h).unwrap();
        assert_eq!(r.status, Status::Solved, "{m}: {:?}", r.reason);
        let found = determinant(&r.hessian);
        assert!((found / det_h - 1.0).abs() < 2e-3, "{m}: det H {found:e}");
        let found = r.determinant;
        assert!((found / det_k_s - 1.0).abs() < 2e-3, "{m}: {found:e}");
        // K_s = K diag(I, J⁻¹) with lengths over L, and det J = 2 (1 − cos θ) / θ².
        let theta = r.pose[3..].iter().map(|v| v * v).sum::<f64>().sqrt();
        let det_j = 2.0 * (1.0 - theta.cos()) / (theta * theta);
        let of_k = determinant(&r.stiffness) / det_j * 0.1034_f64.powi(6);
        assert!((of_k / found - 1.0).abs() < 1e-9, "{m}: {of_k:e}");
    }
}

/// K_s falls without limit where the body creases with the platform held, and is lost shortly before:
/// the mode tells that it is the body that gives way.
#[test]
fn a_crease_under_a_wrench_is_no_buckling() {
    let fem = neck(Quality::Standard);
    for wrench in [
        [-102.6, 97.4, -66.6, -4.0, 4.2, 4.6],
        [-107.5, 19.9, -98.0, -1.1, 2.5, -2.8],
    ] {
        let r = fem.solve_wrench(&wrench).unwrap();
        let verdict = (r.status, r.reason, r.inner_instabilities);
        assert_eq!(verdict, (Status::Unstable, Some(Reason::Crease), 0));
    }
}

/// Two planes buckle at once, and the determinant keeps its sign.
#[test]
fn a_column_buckles_at_a_bracketed_load() {
    let fem = neck(COARSE);
    let r = fem.solve_wrench(&axial(-260.0)).unwrap();
    assert_eq!(
        (r.status, r.reason),
        (Status::Unstable, Some(Reason::Buckling))
    );
    assert!(r.smallest_eigenvalue > 0.0 && r.determinant > 0.0);
    let below = fem.solve_wrench(&axial(0.99 * r.wrench[0])).unwrap();
    assert_eq!(below.status, Status::Solved);
}
