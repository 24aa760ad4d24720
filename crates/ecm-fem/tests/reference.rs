//! The reference load case and closed forms.
#![allow(clippy::unwrap_used, missing_docs)]

#[path = "../examples/extrapolate.rs"]
mod extrapolate;

use ecm_fem::{Fem, Mesh, NeoHookean, Quality, Status, Watch};
use std::f64::consts::PI;

const LENGTH: f64 = 0.1034;
const RADIUS: f64 = 0.033;

fn neck(quality: Quality, young: f64, poisson: f64) -> Fem {
    let mesh = Mesh::cylinder(LENGTH, RADIUS, quality).unwrap();
    Fem::new(
        mesh,
        Box::new(NeoHookean::new(young, poisson).unwrap()),
        None,
    )
    .unwrap()
}

fn norm(v: &[f64]) -> f64 {
    v.iter().map(|x| x * x).sum::<f64>().sqrt()
}

/// Converged answer of an independent solver (P2/P1, graded to the rims, extrapolated):
/// t = (−8.96, 30.11, 25.73) ± 0.03 mm, θ = (0.1936, −0.3505, 0.4450) ± 3e-4 rad.
#[test]
fn reference_wrench_gives_the_reference_pose() {
    for (quality, limit) in [(Quality::Standard, 0.01), (Quality::Fine, 0.005)] {
        let fem = neck(quality, 0.72e6, 0.49);
        let r = fem
            .solve_wrench(&[-40.0, 30.0, 20.0, 1.0, -1.0, 1.0])
            .unwrap();
        assert_eq!(r.status, Status::Solved);
        let t = [
            r.pose[0] - LENGTH + 8.96e-3,
            r.pose[1] - 30.11e-3,
            r.pose[2] - 25.73e-3,
        ];
        let w = [r.pose[3] - 0.1936, r.pose[4] + 0.3505, r.pose[5] - 0.4450];
        let (t_error, w_error) = (norm(&t) / 40.6e-3, norm(&w) / 0.5987);
        assert!(t_error < limit, "{quality:?}: translation off by {t_error}");
        assert!(w_error < limit, "{quality:?}: rotation off by {w_error}");
        assert!(r.iterations <= 8, "{}", r.iterations);
    }
}

/// Richardson on meshes of 741, 2527 and 6025 nodes that cut the same cells: each limit has its
/// own error bar, agrees with the independent answer within both, and none is wide.
#[test]
fn extrapolation_agrees_with_the_reference() {
    let found = extrapolate::limits([2, 3, 4], |_| ()).unwrap();
    for (k, limit) in found.iter().enumerate() {
        assert!(limit.agrees, "{}", limit.line);
        let widest = if k < 3 { 0.06 } else { 6e-4 };
        assert!(limit.bar < widest, "{}", limit.line);
    }
    let t: Vec<f64> = found[..3].iter().map(|l| l.value).collect();
    let far = norm(&[t[0] + 8.96, t[1] - 30.11, t[2] - 25.73]);
    assert!(far < 0.03, "{far} mm");
}

/// Same source: K(0) diagonal 26445, 4000, 4000 N/m, 4.3528, 17.70, 17.70 N m/rad,
/// coupling 206.8 N; negative in (y, θz) as for every clamped beam along x.
#[test]
fn stiffness_at_rest() {
    let k = neck(Quality::Fine, 0.72e6, 0.49)
        .rest_stiffness(Watch::default())
        .unwrap();
    for (found, exact) in [
        (k[0][0], 26445.0),
        (k[1][1], 4000.0),
        (k[2][2], 4000.0),
        (k[3][3], 4.3528),
        (k[4][4], 17.70),
        (k[5][5], 17.70),
        (k[1][5], -206.8),
        (k[2][4], 206.8),
    ] {
        assert!((found / exact - 1.0).abs() < 5e-3, "{found} {exact}");
    }
    for i in 0..6 {
        for j in 0..6 {
            let scale = (k[i][i] * k[j][j]).sqrt();
            assert!((k[i][j] - k[j][i]).abs() < 1e-9 * scale, "{i} {j}");
        }
    }
}

/// Rivlin: twist of an incompressible neo-Hookean cylinder of held length fits rigid
/// bonded ends; M = π μ ψ R⁴ / 2, N = −π μ ψ² R⁴ / 4 with ψ = angle / L.
#[test]
fn torsion_follows_rivlin() {
    let fem = neck(Quality::Fine, 0.72e6, 0.4999);
    let r = fem.solve_pose(&[LENGTH, 0.0, 0.0, 1.0, 0.0, 0.0]).unwrap();
    assert_eq!(r.status, Status::Solved);
    let (mu, psi) = (0.72e6 / (2.0 * 1.4999), 1.0 / LENGTH);
    let moment = PI * mu * psi * RADIUS.powi(4) / 2.0;
    let force = -PI * mu * psi * psi * RADIUS.powi(4) / 4.0;
    assert!(
        (r.wrench[3] / moment - 1.0).abs() < 1e-3,
        "{} {moment}",
        r.wrench[3]
    );
    assert!(
        (r.wrench[0] / force - 1.0).abs() < 3e-3,
        "{} {force}",
        r.wrench[0]
    );
}

/// Timoshenko beam, k = 6 (1 + ν)² / (7 + 12 ν + 4 ν²) (Cowper 1966); the bonded ends
/// stiffen the last half radius at each end, so a slender rod and 2.5 %.
#[test]
fn slender_rod_is_a_timoshenko_beam() {
    let (l, r, e, nu) = (0.4, 0.01, 1e6, 0.45);
    let mesh = Mesh::cylinder(l, r, Quality::Standard).unwrap();
    let fem = Fem::new(mesh, Box::new(NeoHookean::new(e, nu).unwrap()), None).unwrap();
    let k = fem.rest_stiffness(Watch::default()).unwrap();
    let g = e / (2.0 * (1.0 + nu));
    let (area, i) = (PI * r * r, PI * r.powi(4) / 4.0);
    let shear = 6.0 * (1.0 + nu) * (1.0 + nu) / (7.0 + 12.0 * nu + 4.0 * nu * nu);
    let phi = 12.0 * e * i / (shear * g * area * l * l);
    let transverse = 12.0 * e * i / (l.powi(3) * (1.0 + phi));
    for (found, exact) in [
        (k[0][0], e * area / l),
        (k[1][1], transverse),
        (k[3][3], 2.0 * g * i / l),
        (k[5][5], (4.0 + phi) / (1.0 + phi) * e * i / l),
        (k[1][5], -transverse * l / 2.0),
    ] {
        assert!((found / exact - 1.0).abs() < 0.025, "{found} {exact}");
    }
}

/// Beyond buckling no pose is invented: the load is reported unstable, and the last
/// stable state stands just below the critical load (about −175 N at E = 0.72 MPa).
#[test]
fn compression_beyond_buckling_is_reported() {
    let fem = neck(Quality::Standard, 0.72e6, 0.49);
    let r = fem
        .solve_wrench(&[-260.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        .unwrap();
    assert_eq!(r.status, Status::Unstable);
    assert!(r.smallest_eigenvalue > 0.0);
    assert!((-180.0..-160.0).contains(&r.wrench[0]), "{}", r.wrench[0]);
}
