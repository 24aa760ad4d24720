//! The assembled forces and tangents against finite differences, and exact fields.
#![allow(clippy::unwrap_used, clippy::expect_used)]

use super::newton::Workspace;
use super::{Fem, Load, Settings, Watch};
use crate::Status;
use crate::assembly::Sums;
use crate::body::Formulation;
use crate::material::NeoHookean;
use crate::mesh::{Mesh, Quality};
use crate::pattern::{Constraint, NONE};
use crate::tensor::{apply, determinant};
use ecm_se3::rotation_matrix;

const COARSE: Quality = Quality::custom([1, 3, 5], [800, 1000]);

fn coarse() -> Fem {
    let mesh = Mesh::cylinder(0.1, 0.03, COARSE).unwrap();
    let material = Box::new(NeoHookean::new(0.7e6, 0.49).unwrap());
    let scale = (0..mesh.tetrahedra().len())
        .map(|e| 1.0 + 0.05 * (e % 5) as f64)
        .collect();
    Fem::new(mesh, material, Some(scale)).unwrap()
}

/// A smooth finite deformation that respects the clamped base.
fn deformed(fem: &Fem) -> super::State {
    let mut state = fem.rest();
    state.platform = state
        .platform
        .moved(&[0.004, 0.01, -0.006, 0.3, -0.2, 0.4], 1.0);
    for (i, x) in fem.body.mesh.nodes_m().iter().enumerate() {
        let s = x[0] / 0.1;
        let u = [
            0.004 * s,
            0.01 * s * s + 0.1 * x[2] * s,
            -0.006 * s * s - 0.1 * x[1] * s,
        ];
        state.field.displacement[3 * i..3 * i + 3].copy_from_slice(&u);
        state.field.pressure[i] = 0.002 * (1.0 + s + 10.0 * x[1]);
    }
    fem.place_platform_nodes(&mut state);
    state
}

fn sums_at(fem: &Fem, state: &super::State) -> Sums {
    let mut sums = Sums::new(&fem.body, &fem.pattern);
    sums.assemble(&fem.body, &fem.pattern, state).unwrap();
    sums
}

fn unknown_residual(fem: &Fem, sums: &Sums) -> Vec<f64> {
    let mut r = vec![0.0; fem.pattern.unknowns];
    for (c, &u) in fem.pattern.of_displacement.iter().enumerate() {
        if u != NONE {
            r[u as usize] = sums.force[c];
        }
    }
    for (n, &u) in fem.pattern.of_pressure.iter().enumerate() {
        if u != NONE {
            r[u as usize] = sums.volume[n];
        }
    }
    r
}

/// K v for the lower triangle in the pattern's order.
fn times(fem: &Fem, sums: &Sums, v: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; v.len()];
    for (&value, (row, column)) in sums.tangent.iter().zip(fem.pattern.symbolic.positions()) {
        out[row] += value * v[column];
        if row != column {
            out[column] += value * v[row];
        }
    }
    out
}

#[test]
fn tangent_is_the_derivative_of_the_internal_forces() {
    let fem = coarse();
    let state = deformed(&fem);
    let sums = sums_at(&fem, &state);
    let n = fem.pattern.unknowns;
    let direction: Vec<f64> = (0..n)
        .map(|i| ((i * 7919) % 101) as f64 / 101.0 - 0.5)
        .collect();
    let h = 1e-6;
    let moved = |s: f64| {
        let mut m = state.clone();
        for (c, &u) in fem.pattern.of_displacement.iter().enumerate() {
            if u != NONE {
                m.field.displacement[c] += s * 1e-2 * direction[u as usize];
            }
        }
        for (k, &u) in fem.pattern.of_pressure.iter().enumerate() {
            if u != NONE {
                m.field.pressure[k] += s * 1e-2 * direction[u as usize];
            }
        }
        let sums = sums_at(&fem, &m);
        (unknown_residual(&fem, &sums), sums.energy_J)
    };
    let ((up, e_up), (down, e_down)) = (moved(h), moved(-h));
    let exact = times(
        &fem,
        &sums,
        &direction.iter().map(|d| 1e-2 * d).collect::<Vec<_>>(),
    );
    let size = exact.iter().fold(0.0f64, |a, b| a.max(b.abs()));
    for i in 0..n {
        let fd = (up[i] - down[i]) / (2.0 * h);
        assert!(
            (fd - exact[i]).abs() < 1e-6 * size,
            "{i}: {fd} {}",
            exact[i]
        );
    }
    // The forces are the derivative of the energy.
    let work: f64 = unknown_residual(&fem, &sums)
        .iter()
        .zip(&direction)
        .map(|(r, d)| 1e-2 * r * d)
        .sum();
    assert!(((e_up - e_down) / (2.0 * h) - work).abs() < 1e-6 * work.abs().max(1e-3));
}

#[test]
fn platform_columns_are_derivatives_too() {
    let fem = coarse();
    let state = deformed(&fem);
    let sums = sums_at(&fem, &state);
    let nodes = &fem.pattern.platform_nodes;
    let (_, geometric) = state.platform.wrench(&fem.body.mesh, nodes, &sums.force);
    let h = 1e-6;
    for k in 0..6 {
        let at = |s: f64| {
            let mut m = state.clone();
            let mut step = [0.0; 6];
            step[k] = s;
            m.platform = state.platform.moved(&step, 1.0);
            fem.place_platform_nodes(&mut m);
            let sums = sums_at(&fem, &m);
            let wrench = m.platform.wrench(&fem.body.mesh, nodes, &sums.force).0;
            (unknown_residual(&fem, &sums), wrench)
        };
        let ((up, w_up), (down, w_down)) = (at(h), at(-h));
        let size = sums
            .coupling
            .iter()
            .fold(0.0f64, |a, row| a.max(row[k].abs()));
        for i in 0..fem.pattern.unknowns {
            let fd = (up[i] - down[i]) / (2.0 * h);
            assert!((fd - sums.coupling[i][k]).abs() < 1e-6 * size, "{i} {k}");
        }
        for i in 0..6 {
            let mut exact = sums.platform[i][k];
            if i >= 3 && k >= 3 {
                exact += geometric[i - 3][k - 3];
            }
            let fd = (w_up[i] - w_down[i]) / (2.0 * h);
            let size = sums.platform[i][i].abs() + sums.platform[k][k].abs();
            assert!((fd - exact).abs() < 1e-6 * size, "{i} {k}: {fd} {exact}");
        }
    }
}

#[test]
fn rigid_motion_costs_nothing() {
    let fem = coarse();
    let mut state = fem.rest();
    let turn = rotation_matrix(&[0.9, -1.1, 1.4]);
    for (i, x) in fem.body.mesh.nodes_m().iter().enumerate() {
        let y = apply(&turn, *x);
        for k in 0..3 {
            state.field.displacement[3 * i + k] = y[k] - x[k] + 0.3;
        }
    }
    let sums = sums_at(&fem, &state);
    assert!(sums.energy_J.abs() < 1e-13);
    assert!(sums.force.iter().all(|f| f.abs() < 1e-9));
    assert!(sums.volume.iter().all(|f| f.abs() < 1e-9));
}

/// Patch test: linear displacements on the whole boundary give them inside, with the
/// pressure κ (J − 1) everywhere.
#[test]
fn linear_boundary_displacements_give_a_homogeneous_state() {
    let quality = Quality::custom([2, 4, 6], [500, 500]);
    let mesh = Mesh::cylinder(0.1, 0.03, quality).unwrap();
    let on_boundary = |x: &[f64; 3]| x[0] < 1e-9 || x[0] > 0.1 - 1e-9 || x[1].hypot(x[2]) > 0.0275;
    let mut constraints = vec![Constraint::Free; 3 * mesh.nodes_m().len()];
    for (i, x) in mesh.nodes_m().iter().enumerate() {
        if on_boundary(x) {
            constraints[3 * i..3 * i + 3].fill(Constraint::Prescribed);
        }
    }
    let material = Box::new(NeoHookean::new(0.7e6, 0.49).unwrap());
    let settings = Settings {
        tolerance: 1e-13,
        ..Settings::default()
    };
    let fem = Fem::with_constraints(mesh, material, None, settings, &constraints).unwrap();
    let gradient = [[1.1, 0.1, 0.0], [-0.05, 0.96, 0.2], [0.02, 0.0, 0.98]];
    let linear = |x: &[f64; 3]| {
        let y = apply(&gradient, *x);
        [0, 1, 2].map(|k| y[k] - x[k])
    };
    let mut state = fem.rest();
    for (i, x) in fem.body.mesh.nodes_m().iter().enumerate() {
        let disturb = if on_boundary(x) {
            0.0
        } else {
            3e-4 * (i as f64).sin()
        };
        for k in 0..3 {
            state.field.displacement[3 * i + k] = linear(x)[k] + disturb;
        }
    }
    let load = Load::Pose(fem.rest().platform.pose());
    let mut work = Workspace::new(&fem);
    fem.newton(&mut work, &mut state, &load, (25, 3), Watch::default())
        .unwrap();
    let kappa = 0.7e6 / (3.0 * (1.0 - 0.98));
    let pressure = kappa * (determinant(&gradient) - 1.0);
    for (i, x) in fem.body.mesh.nodes_m().iter().enumerate() {
        for k in 0..3 {
            let miss = state.field.displacement[3 * i + k] - linear(x)[k];
            assert!(miss.abs() < 1e-12, "node {i}: {miss}");
        }
        if fem.pattern.of_pressure[i] != NONE {
            let p = state.field.pressure[i] * fem.body.pressure_unit_Pa;
            let stabilisation = fem
                .body
                .stabilisation(0, &gradient, determinant(&gradient), p);
            let p = p + stabilisation.unwrap().pressure;
            assert!(
                (p / pressure - 1.0).abs() < 1e-8,
                "node {i}: {p} {pressure}"
            );
        }
    }
}

#[test]
fn newton_ends_quadratically_and_counts_the_pressures_as_negative_pivots() {
    let fem = coarse();
    let (result, _) = fem
        .solve(Load::Wrench([-20.0, 10.0, 10.0, 0.3, -0.3, 0.3]))
        .unwrap();
    assert!(result.iterations <= 7, "{}", result.iterations);
    assert!(result.residual < 1e-9);
    assert_eq!(result.inner_instabilities, 0);
}

/// n[0] × n[1] × 1 cells of six tetrahedra on the unit square, finer towards y = 1.
fn plate(n: [usize; 2]) -> Mesh {
    let at = |i: usize, j: usize, k: usize| (i * (n[1] + 1) + j) * 2 + k;
    let mut corners = Vec::new();
    for i in 0..n[0] {
        for j in 0..n[1] {
            // Kuhn: one tetrahedron per order of the three unit steps.
            for (order, odd) in [
                ([0, 1, 2], false),
                ([1, 2, 0], false),
                ([2, 0, 1], false),
                ([0, 2, 1], true),
                ([2, 1, 0], true),
                ([1, 0, 2], true),
            ] {
                let mut c = [i, j, 0];
                let mut tet = [at(i, j, 0); 4];
                for (m, axis) in order.into_iter().enumerate() {
                    c[axis] += 1;
                    tet[m + 1] = at(c[0], c[1], c[2]);
                }
                if odd {
                    tet.swap(2, 3);
                }
                corners.push(tet);
            }
        }
    }
    let mut nodes = Vec::new();
    for i in 0..=n[0] {
        for j in 0..=n[1] {
            let y = 1.0 - (1.0 - j as f64 / n[1] as f64).powf(1.5);
            nodes.extend([0.0, 0.1].map(|z| [i as f64 / n[0] as f64, y, z]));
        }
    }
    let tets = Mesh::with_mid_nodes(&mut nodes, &corners).unwrap();
    Mesh::without_faces(nodes, tets, 1.0).unwrap()
}

/// Unstable modes of a block between rollers in plane strain, compressed to `stretch`.
fn surface_instabilities(n: [usize; 2], stretch: f64, formulation: Formulation) -> usize {
    let mesh = plate(n);
    let nodes = mesh.nodes_m().to_vec();
    let mut constraints = vec![Constraint::Free; 3 * nodes.len()];
    for (i, x) in nodes.iter().enumerate() {
        constraints[3 * i + 2] = Constraint::Prescribed;
        if x[0] < 1e-9 || x[0] > 1.0 - 1e-9 {
            constraints[3 * i] = Constraint::Prescribed;
        }
        if x[1] < 1e-9 {
            constraints[3 * i + 1] = Constraint::Prescribed;
        }
    }
    let material = Box::new(NeoHookean::new(1.0, 0.499).unwrap());
    let settings = Settings {
        formulation,
        ..Settings::default()
    };
    let fem = Fem::with_constraints(mesh, material, None, settings, &constraints).unwrap();
    let mut state = fem.rest();
    let out = 1.0 / stretch;
    for (i, x) in nodes.iter().enumerate() {
        state.field.displacement[3 * i] = (stretch - 1.0) * x[0];
        state.field.displacement[3 * i + 1] = (out - 1.0) * x[1];
    }
    // Newton from close by: the homogeneous state is exact in the mesh.
    let load = Load::Pose(fem.rest().platform.pose());
    let mut work = Workspace::new(&fem);
    fem.newton(&mut work, &mut state, &load, (10, 10), Watch::default())
        .unwrap();
    let flat = |i: usize| (state.field.displacement[3 * i + 1] - (out - 1.0)).abs() < 1e-2;
    assert!((0..nodes.len()).all(|i| nodes[i][1] < 1.0 - 1e-9 || flat(i)));
    work.balance.inner_instabilities
}

/// Biot (1963): the surface of an incompressible neo-Hookean body is stable down to a stretch
/// of 0.544 in plane strain, at every wavelength. Taylor–Hood by itself loses that from 0.70 on.
#[test]
fn a_compressed_surface_is_stable_as_far_as_biot() {
    for (n, lost) in [([3, 3], 0.51), ([6, 5], 0.54), ([10, 8], 0.54)] {
        let modes = |stretch| surface_instabilities(n, stretch, Formulation::TaylorHood);
        for stretch in [0.8, 0.7, 0.6, 0.55] {
            assert_eq!(modes(stretch), 0, "{n:?} {stretch}");
        }
        assert!(modes(lost) > 0, "{n:?}");
    }
}

#[test]
fn the_first_poses_of_a_batch_begin_where_the_tangent_at_rest_puts_them() {
    let fem = coarse();
    let loads: Vec<Load> = (0..12)
        .map(|i| {
            let a = f64::from(i);
            let (y, z) = (0.04 * a.sin(), 0.04 * a.cos());
            let x = fem.body.mesh.length_m() - 0.015;
            Load::Pose([x, y, z, 0.5 * (2.0 * a).sin(), -15.0 * z, 15.0 * y])
        })
        .collect();
    let batch = fem.solve_all(&loads, Watch::default()).unwrap();
    let (mut together, mut alone) = (0, 0);
    for (load, found) in loads.iter().zip(&batch) {
        let (rest, _) = fem.solve(load).unwrap();
        assert_eq!(found.status, Status::Solved);
        assert_eq!(found.load_steps, 1);
        together += found.iterations;
        alone += rest.iterations;
        for k in 0..6 {
            let unit = if k < 3 { 1.0 } else { fem.body.mesh.length_m() };
            let miss = (found.wrench[k] - rest.wrench[k]).abs();
            assert!(miss < 1e-7 * unit * fem.force_unit_N, "{k}: {miss}");
        }
    }
    assert!(
        20 * together <= 17 * alone,
        "{together} of {alone} iterations"
    );
}
