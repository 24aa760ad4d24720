//! Own weight, buckling, closed loops, other materials, output.
#![allow(clippy::unwrap_used, missing_docs)]

use ecm_fem::output::vtu;
use ecm_fem::{
    Fem, Fibre, Gent, Load, Material, Mesh, MooneyRivlin, NeoHookean, Ogden, Quality, Status,
    Watch, Yeoh,
};
use std::f64::consts::PI;

fn small(material: Box<dyn Material>) -> Fem {
    let quality = Quality::custom([1, 4, 6], [500, 1000]);
    Fem::new(Mesh::cylinder(0.1, 0.03, quality).unwrap(), material, None).unwrap()
}

fn neo() -> NeoHookean {
    NeoHookean::new(0.7e6, 0.49).unwrap()
}

/// A held column under its own weight rests half on its top, half on its base.
#[test]
fn own_weight_is_shared_by_both_ends() {
    let fem = small(Box::new(neo()))
        .with_body_force([-100.0, 40.0, 0.0])
        .unwrap();
    let volume = fem.mesh().volume_m3();
    let held = fem.solve_pose(&[0.1, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    assert_eq!(held.status, Status::Solved);
    assert!(
        (held.wrench[0] / (50.0 * volume) - 1.0).abs() < 1e-3,
        "{}",
        held.wrench[0]
    );
    assert!(
        (held.wrench[1] / (-20.0 * volume) - 1.0).abs() < 1e-2,
        "{}",
        held.wrench[1]
    );
    // Released, it sags: axial by ρ g L² / (2 E) for a free column, a little less bonded.
    let free = fem.solve_wrench(&[0.0; 6]).unwrap();
    let sag = 0.1 - free.pose[0];
    let slender = 100.0 * 0.01 / (2.0 * 0.7e6);
    assert!((0.8..1.0).contains(&(sag / slender)), "{}", sag / slender);
    assert!(
        small(Box::new(neo()))
            .with_body_force([f64::NAN, 0.0, 0.0])
            .is_err()
    );
}

/// Fixed–free Euler column with shear (Haringx): P = GA (√(1 + 4 P_E / GA) − 1) / 2 for
/// P_E = π² EI / (4 L²); a slender one, so that the bonded ends hardly matter.
#[test]
fn slender_column_buckles_at_the_euler_load() {
    let (l, r, e, nu) = (0.6, 0.01, 1e6, 0.45);
    let mesh = Mesh::cylinder(l, r, Quality::Standard).unwrap();
    let fem = Fem::new(mesh, Box::new(NeoHookean::new(e, nu).unwrap()), None).unwrap();
    let ga = 0.9 * e / (2.0 * (1.0 + nu)) * PI * r * r;
    let euler = PI * PI * e * PI * r.powi(4) / 4.0 / (4.0 * l * l);
    let critical = 0.5 * ga * ((1.0 + 4.0 * euler / ga).sqrt() - 1.0);
    let below = fem
        .solve_wrench(&[-0.98 * critical, 0.0, 0.0, 0.0, 0.0, 0.0])
        .unwrap();
    assert_eq!(below.status, Status::Solved);
    // The eigenvalue falls almost linearly with the load: its zero is the buckling load.
    let half = fem
        .solve_wrench(&[-0.9 * critical, 0.0, 0.0, 0.0, 0.0, 0.0])
        .unwrap();
    let (a, b) = (half.smallest_eigenvalue, below.smallest_eigenvalue);
    let found = (0.9 + 0.08 * a / (a - b)) * critical;
    assert!((found / critical - 1.0).abs() < 0.02, "{found} {critical}");
    let above = fem
        .solve_wrench(&[-1.1 * critical, 0.0, 0.0, 0.0, 0.0, 0.0])
        .unwrap();
    assert_eq!(above.status, Status::Unstable);
    assert!(above.wrench[0] > -1.02 * critical);
}

/// Work around a closed loop of poses, by Simpson's rule, against the energy stored.
#[test]
fn closed_loop_of_poses_costs_no_work() {
    let fem = small(Box::new(neo()));
    let n = 48;
    let pose = |i: usize| {
        let t = 2.0 * PI * (i % n) as f64 / n as f64;
        [
            0.1 + 0.002 * t.sin(),
            0.01 * t.cos(),
            0.01 * t.sin(),
            0.2 * (2.0 * t).sin(),
            -0.3 * t.sin(),
            0.3 * t.cos(),
        ]
    };
    let loads: Vec<Load> = (0..n).map(|i| Load::Pose(pose(i))).collect();
    let results = fem.solve_all(&loads, ecm_fem::Watch::default()).unwrap();
    // The trapezoidal rule converges exponentially for periodic functions.
    let mut work = 0.0;
    for (i, r) in results.iter().enumerate() {
        assert_eq!(r.status, Status::Solved);
        let t = 2.0 * PI * i as f64 / n as f64;
        let rate = [
            0.002 * t.cos(),
            -0.01 * t.sin(),
            0.01 * t.cos(),
            0.4 * (2.0 * t).cos(),
            -0.3 * t.cos(),
            -0.3 * t.sin(),
        ];
        let j = ecm_se3::left_jacobian(&[r.pose[3], r.pose[4], r.pose[5]]);
        for k in 0..3 {
            work += r.wrench[k] * rate[k];
            for m in 0..3 {
                work += r.wrench[3 + m] * j[m][k] * rate[3 + k];
            }
        }
    }
    let work = work * 2.0 * PI / n as f64;
    let stored = results.iter().map(|r| r.energy_J).fold(0.0, f64::max);
    assert!(work.abs() < 1e-6 * stored, "{work} {stored}");
}

#[test]
fn every_material_carries_the_load() {
    let kappa = 1.2e7;
    let materials: Vec<Box<dyn Material>> = vec![
        Box::new(MooneyRivlin::new(0.8e5, 0.4e5, kappa).unwrap()),
        Box::new(Yeoh::new([1.2e5, -5e3, 2e3], kappa).unwrap()),
        Box::new(Gent::new(2.4e5, 10.0, kappa).unwrap()),
        Box::new(Ogden::new(vec![(2e5, 1.7), (4e4, -2.0)], kappa).unwrap()),
        Box::new(Fibre::new(Box::new(neo()), [1.0, 0.0, 0.0], 2e4, 1.0).unwrap()),
    ];
    for material in materials {
        let name = format!("{material:?}");
        let r = small(material)
            .solve_wrench(&[-20.0, 15.0, 10.0, 0.5, -0.5, 0.5])
            .unwrap();
        assert_eq!(r.status, Status::Solved, "{name}");
        assert!(r.iterations <= 12, "{name}: {} iterations", r.iterations);
        for i in 0..6 {
            for k in 0..6 {
                let scale = (r.hessian[i][i] * r.hessian[k][k]).sqrt();
                assert!(
                    (r.hessian[i][k] - r.hessian[k][i]).abs() < 1e-8 * scale,
                    "{name}"
                );
            }
        }
    }
}

#[test]
fn tubes_and_hourglasses_are_solved() {
    for mesh in [
        Mesh::tube(0.1, 0.03, 0.018, Quality::Standard).unwrap(),
        Mesh::hourglass(0.1, 0.03, 0.02, Quality::Standard).unwrap(),
        Mesh::stacked_discs(0.1, 0.03, 0.022, 3, Quality::Standard).unwrap(),
    ] {
        let fem = Fem::new(mesh, Box::new(neo()), None).unwrap();
        let r = fem
            .solve_wrench(&[-10.0, 8.0, 5.0, 0.2, -0.2, 0.2])
            .unwrap();
        assert_eq!(r.status, Status::Solved);
        let back = fem.solve_pose(&r.pose).unwrap();
        assert!((back.wrench[0] + 10.0).abs() < 1e-5);
    }
}

#[test]
fn vtu_holds_every_node_and_element() {
    let fem = small(Box::new(neo()));
    let (result, field) = fem
        .solve_field(
            Load::Wrench([-10.0, 5.0, 0.0, 0.0, 0.0, 0.3]),
            Watch::default(),
        )
        .unwrap();
    assert_eq!(result.status, Status::Solved);
    let text = vtu(fem.body(), &field).unwrap();
    let rows = |name: &str| {
        let start = text.find(&format!("Name=\"{name}\"")).unwrap();
        text[start..]
            .lines()
            .skip(1)
            .take_while(|l| !l.starts_with('<'))
            .count()
    };
    let (nodes, elements) = (fem.mesh().nodes_m().len(), fem.mesh().tetrahedra().len());
    assert_eq!(rows("displacement_m"), nodes);
    assert_eq!(rows("connectivity"), elements);
    assert_eq!(rows("stress_Pa"), elements);
    assert!(!text.contains("NaN"));
}

/// A soft column that falls over under its own weight has no state from which to begin.
#[test]
fn a_body_that_does_not_carry_its_weight_has_no_state() {
    let soft = || {
        let mesh = Mesh::cylinder(0.15, 0.005, COARSE_COLUMN).unwrap();
        Fem::new(mesh, Box::new(NeoHookean::new(3e4, 0.49).unwrap()), None).unwrap()
    };
    let weight = 1100.0 * 9.81;
    for force in [-weight, -1e9] {
        let standing = soft().with_body_force([force, 0.0, 0.0]).unwrap();
        let r = standing.solve_wrench(&[0.0; 6]).unwrap();
        assert_ne!(r.status, Status::Solved);
        assert!(!r.has_state() && r.residual.is_nan());
        let error = standing
            .rest_stiffness(Watch::default())
            .unwrap_err()
            .to_string();
        assert!(error.contains("own weight"), "{error}");
    }
    // The same body hangs, and sags by ρ g L² / (2 E).
    let hanging = soft().with_body_force([weight, 0.0, 0.0]).unwrap();
    let r = hanging.solve_wrench(&[0.0; 6]).unwrap();
    assert_eq!(r.status, Status::Solved);
    assert_eq!(r.inner_instabilities, 0);
    let sag = (r.pose[0] - 0.15) / (weight * 0.15 * 0.15 / (2.0 * 3e4));
    assert!((0.95..1.05).contains(&sag), "{sag}");
    assert!(hanging.rest_stiffness(Watch::default()).unwrap()[0][0] > 0.0);
}

const COARSE_COLUMN: Quality = Quality::custom([1, 10, 6], [1000, 1000]);
