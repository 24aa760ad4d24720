//! Closed chambers: closed forms, derivatives, reciprocity, and work that comes back.
#![allow(clippy::unwrap_used, non_snake_case, missing_docs)]

mod common;

use ecm_fem::{
    Case, ChamberShape, Chambered, Constraint, Fem, FemError, Load, Mesh, NeoHookean, Quality,
    Settings, Status, Watch,
};
use std::f64::consts::PI;

const MU: f64 = 1e5;

fn neo(nu: f64) -> Box<NeoHookean> {
    Box::new(NeoHookean::new(2.0 * MU * (1.0 + nu), nu).unwrap())
}

fn arm() -> Chambered {
    Chambered {
        length_m: 0.1,
        radius_m: 0.02,
        channel_radius_m: 0.004,
        chambers: 3,
        shape: ChamberShape::Round {
            radius_m: 0.0045,
            offset_m: 0.012,
        },
        end_wall_m: 0.0,
    }
}

fn sectors(end_wall_m: f64, channel_radius_m: f64) -> Chambered {
    Chambered {
        shape: ChamberShape::Sector {
            inner_radius_m: 0.008,
            outer_radius_m: 0.0165,
            angle_rad: 1.5,
        },
        end_wall_m,
        channel_radius_m,
        ..arm()
    }
}

/// On a third of the nodes of the standard mesh: enough for identities.
fn fem(body: &Chambered) -> Fem {
    let mesh = Mesh::chambered(body, "1x4x6".parse().unwrap()).unwrap();
    Fem::new(mesh, neo(0.49), None).unwrap()
}

fn solved(fem: &Fem, load: Load, pressures: &[f64]) -> ecm_fem::CaseResult {
    let (result, _) = fem.solve(Case::new(load, pressures).unwrap()).unwrap();
    assert_eq!(result.status, Status::Solved);
    result
}

/// A hollow sphere from an octahedron whose faces are divided, in layers.
fn sphere(inner_m: f64, outer_m: f64, divisions: usize, layers: usize) -> Mesh {
    let mut directions: Vec<[f64; 3]> = Vec::new();
    let mut find = |x: [f64; 3]| {
        let size = x.iter().map(|v| v * v).sum::<f64>().sqrt();
        let x = x.map(|v| v / size);
        let near = |y: &[f64; 3]| (0..3).all(|k| (x[k] - y[k]).abs() < 1e-9);
        directions.iter().position(near).unwrap_or_else(|| {
            directions.push(x);
            directions.len() - 1
        })
    };
    let mut triangles = Vec::new();
    for signs in 0..8 {
        let sign = |k: usize| if signs >> k & 1 == 0 { 1.0 } else { -1.0 };
        let n = divisions;
        let mut at = |i: usize, j: usize| {
            let x = [i, j, n - i - j].map(|v| v as f64);
            find([sign(0) * x[0], sign(1) * x[1], sign(2) * x[2]])
        };
        for i in 0..n {
            for j in 0..n - i {
                triangles.push([at(i, j), at(i + 1, j), at(i, j + 1)]);
                if i + j + 2 <= n {
                    triangles.push([at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]);
                }
            }
        }
    }
    let count = directions.len();
    let radius = |layer: usize| inner_m * (outer_m / inner_m).powf(layer as f64 / layers as f64);
    let mut nodes: Vec<[f64; 3]> = (0..=layers)
        .flat_map(|layer| directions.iter().map(move |d| d.map(|v| v * radius(layer))))
        .collect();
    let mut corners = Vec::new();
    for layer in 0..layers {
        for mut t in triangles.clone() {
            t.sort_unstable();
            let [i, j, k] = t.map(|v| v + layer * count);
            let (a, b, c) = (i + count, j + count, k + count);
            for mut tet in [[i, j, k, c], [i, j, b, c], [i, a, b, c]] {
                let x = tet.map(|v| nodes[v]);
                let e = |n: usize| [0, 1, 2].map(|m| x[n][m] - x[0][m]);
                let (p, q, r) = (e(1), e(2), e(3));
                let det = p[0] * (q[1] * r[2] - q[2] * r[1]) - p[1] * (q[0] * r[2] - q[2] * r[0])
                    + p[2] * (q[0] * r[1] - q[1] * r[0]);
                if det < 0.0 {
                    tet.swap(0, 1);
                }
                corners.push(tet);
            }
        }
    }
    let tets = Mesh::with_mid_nodes(&mut nodes, &corners).unwrap();
    let size = |x: [f64; 3]| x.iter().map(|v| v * v).sum::<f64>().sqrt();
    for tet in &tets {
        for (edge, [i, j]) in ecm_fem::mesh::EDGES.iter().enumerate() {
            let (a, b) = (size(nodes[tet[*i]]), size(nodes[tet[*j]]));
            let scale = 0.5 * (a + b) / size(nodes[tet[4 + edge]]);
            if (a - b).abs() < 1e-9 * a {
                nodes[tet[4 + edge]] = nodes[tet[4 + edge]].map(|v| v * scale);
            }
        }
    }
    let wall: Vec<usize> = (0..nodes.len())
        .filter(|&n| (size(nodes[n]) - inner_m).abs() < 1e-9 * inner_m)
        .collect();
    let mesh = Mesh::without_faces(nodes, tets, outer_m).unwrap();
    mesh.with_chamber("cavity", wall).unwrap()
}

/// Pressure that stretches the inner radius of a neo-Hookean sphere of constant volume (Green and
/// Zerna, Theoretical Elasticity, 1954).
fn sphere_pressure_Pa(stretch: f64, inner_m: f64, outer_m: f64) -> f64 {
    let outer = (1.0 + (inner_m / outer_m).powi(3) * (stretch.powi(3) - 1.0)).cbrt();
    let part = |l: f64| 2.0 / l + 0.5 / l.powi(4);
    MU * (part(outer) - part(stretch))
}

/// Error of the swelling of a sphere at the pressure of a given stretch of its inner radius.
fn swelling_error(divisions: usize, layers: usize, stretch: f64) -> f64 {
    let (inner, outer) = (0.01, 0.02);
    let mesh = sphere(inner, outer, divisions, layers);
    let mut held = vec![Constraint::Free; 3 * mesh.nodes_m().len()];
    for (node, x) in mesh.nodes_m().iter().enumerate() {
        for axis in 0..3 {
            let others = [(axis + 1) % 3, (axis + 2) % 3];
            if others.iter().all(|&k| x[k].abs() < 1e-12) {
                others
                    .iter()
                    .for_each(|k| held[3 * node + k] = Constraint::Prescribed);
            }
        }
    }
    let nodes = mesh.nodes_m().to_vec();
    let wall = mesh.chambers()[0].1.clone();
    let pressure = sphere_pressure_Pa(stretch, inner, outer);
    let body = Fem::with_prescribed(mesh, neo(0.5), Settings::default(), &held)
        .unwrap()
        .with_actuation(&[pressure])
        .unwrap();
    let still = vec![0.0; 3 * nodes.len()];
    let result = body.solve_prescribed(&still, Watch::default()).unwrap();
    assert_eq!(result.status, Status::Solved);
    let size = |x: [f64; 3]| x.iter().map(|v| v * v).sum::<f64>().sqrt();
    let moved = wall.iter().map(|&n| {
        size([0, 1, 2].map(|k| nodes[n][k] + result.field.displacement[3 * n + k])) / inner
    });
    let mean = moved.sum::<f64>() / wall.len() as f64;
    ((mean - stretch) / (stretch - 1.0)).abs()
}

#[test]
fn a_thick_sphere_swells_as_the_closed_form_says() {
    for stretch in [1.05, 1.5] {
        let [coarse, fine] = [(3, 2), (6, 4)].map(|(n, m)| swelling_error(n, m, stretch));
        assert!(
            fine < 2e-3,
            "{stretch}: {coarse:.1e}, {fine:.1e} of the swelling"
        );
        assert!(fine < 0.25 * coarse, "{stretch}: {coarse:.1e}, {fine:.1e}");
    }
}

#[test]
fn a_tube_with_closed_ends_follows_lame() {
    let (length, outer, inner) = (0.24, 0.02, 0.01);
    let mesh = Mesh::tube(length, outer, inner, Quality::Fine).unwrap();
    let radius = |x: &[f64; 3]| x[1].hypot(x[2]);
    let of_hole = |r: f64| (r - inner).abs() < 1e-6 * inner;
    let hole: Vec<usize> = (0..mesh.nodes_m().len())
        .filter(|&n| of_hole(radius(&mesh.nodes_m()[n])))
        .collect();
    let mesh = mesh.with_chamber("bore", hole.clone()).unwrap();
    let nodes = mesh.nodes_m().to_vec();
    let body = Fem::new(mesh, neo(0.49), None).unwrap();
    let pressure = 1e-3 * MU;
    let case = Case::new(Load::Wrench([0.0; 6]), &[pressure]).unwrap();
    let (result, field) = body.solve_field(case, Watch::default()).unwrap();
    assert_eq!(result.status, Status::Solved);
    // ε_θ(a) and ε_x of a thick tube whose ends carry P π a².
    let (young, nu) = (2.0 * MU * 1.49, 0.49);
    let k = pressure * inner * inner / (outer * outer - inner * inner);
    let hoop = k * (1.0 + (outer / inner).powi(2));
    let (radial, axial) = (-pressure, k);
    let strain = (hoop - nu * (radial + axial)) / young;
    let middle = hole
        .iter()
        .filter(|&&n| (nodes[n][0] - 0.5 * length).abs() < 0.1 * length);
    let found = middle.clone().map(|&n| {
        let x = [0, 1, 2].map(|c| nodes[n][c] + field.displacement[3 * n + c]);
        radius(&x) / radius(&nodes[n]) - 1.0
    });
    let mean = found.sum::<f64>() / middle.count() as f64;
    assert!(
        (mean / strain - 1.0).abs() < 0.01,
        "{mean:.4e} {strain:.4e}"
    );
}

#[test]
fn chambers_have_the_volume_of_their_outline() {
    for (body, area) in [
        (arm(), PI * 0.0045f64.powi(2)),
        (
            sectors(0.0, 0.004),
            0.75 * (0.0165f64.powi(2) - 0.008f64.powi(2)),
        ),
        (
            sectors(0.008, 0.0),
            0.75 * (0.0165f64.powi(2) - 0.008f64.powi(2)),
        ),
    ] {
        for quality in [Quality::Standard, Quality::Fine] {
            let mesh = Mesh::chambered(&body, quality).unwrap();
            let channel = PI * body.channel_radius_m.powi(2) * body.length_m;
            let each = area * (body.length_m - 2.0 * body.end_wall_m);
            let solid = PI * body.radius_m.powi(2) * body.length_m - channel - 3.0 * each;
            let found = mesh.volume_m3();
            assert!(
                (found / solid - 1.0).abs() < 4e-3,
                "{body:?} {found} {solid}"
            );
            let body = Fem::new(mesh, neo(0.49), None).unwrap();
            assert_eq!(body.actuators(), ["chamber_1", "chamber_2", "chamber_3"]);
            for volume in body.chamber_volumes_m3() {
                assert!((volume / each - 1.0).abs() < 6e-3, "{volume} {each}");
            }
        }
    }
}

#[test]
fn derivatives_are_those_of_neighbouring_states_and_reciprocal() {
    for body in [arm(), sectors(0.008, 0.0)] {
        let fem = fem(&body);
        let pose = [0.103, 0.004, -0.002, 0.05, 0.2, -0.1];
        let pressures = [4e3, 1e3, -1e3];
        let at = |pose: [f64; 6], pressures: [f64; 3]| solved(&fem, Load::Pose(pose), &pressures);
        let here = at(pose, pressures);
        assert_eq!(here.actuators.len(), 3);
        for c in 0..3 {
            let step = 20.0;
            let moved = |sign: f64| {
                let mut p = pressures;
                p[c] += sign * step;
                at(pose, p)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            let size = here.actuators[c]
                .on_wrench
                .iter()
                .fold(0.0f64, |m, v| m.max(v.abs()));
            for k in 0..6 {
                let slope = (up.wrench[k] - down.wrench[k]) / (2.0 * step);
                let given = here.actuators[c].on_wrench[k];
                assert!((slope - given).abs() < 1e-5 * size, "{k}: {slope} {given}");
            }
            for other in 0..3 {
                let slope =
                    (up.actuators[other].amount - down.actuators[other].amount) / (2.0 * step);
                let given = here.actuators[other].on_amounts[c];
                let largest = here.actuators[c].on_amounts[c];
                assert!((slope - given).abs() < 1e-5 * largest, "{slope} {given}");
            }
        }
        // q by the position of the platform is −G; by its rotation the same through J(θ).
        for k in 0..3 {
            let step = 1e-5;
            let moved = |sign: f64| {
                let mut p = pose;
                p[k] += sign * step;
                at(p, pressures)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for c in 0..3 {
                let slope = (up.actuators[c].amount - down.actuators[c].amount) / (2.0 * step);
                let given = -here.actuators[c].on_wrench[k];
                assert!(
                    (slope - given).abs() < 1e-5 * given.abs().max(1e-6),
                    "{slope} {given}"
                );
            }
            for j in 0..6 {
                let slope = (up.wrench[j] - down.wrench[j]) / (2.0 * step);
                let given = here.stiffness[j][k];
                let unit = here.stiffness[k][k].abs();
                assert!(
                    (slope - given).abs() < 1e-4 * unit,
                    "{j}{k}: {slope} {given}"
                );
            }
        }
        for k in 0..6 {
            for j in 0..6 {
                let (a, b) = (here.hessian[k][j], here.hessian[j][k]);
                let unit = (here.hessian[k][k] * here.hessian[j][j]).abs().sqrt();
                assert!((a - b).abs() < 1e-8 * unit, "H is symmetric");
            }
        }
    }
}

#[test]
fn the_work_of_a_cycle_of_pressures_comes_back() {
    let fem = fem(&arm());
    // Round a square of two pressures, with the trapezium rule: ∮ q dP = 0.
    let steps = 6;
    let corner = |s: f64| match s {
        s if s < 1.0 => [s, 0.0],
        s if s < 2.0 => [1.0, s - 1.0],
        s if s < 3.0 => [3.0 - s, 1.0],
        s => [0.0, 4.0 - s],
    };
    let states: Vec<_> = (0..4 * steps)
        .map(|i| {
            let [a, b] = corner(i as f64 / steps as f64).map(|v| 8e3 * v);
            solved(&fem, Load::Wrench([0.0; 6]), &[a, b, 0.0])
        })
        .collect();
    let (mut sum, mut size) = (0.0, 0.0);
    for (i, now) in states.iter().enumerate() {
        let next = &states[(i + 1) % states.len()];
        for c in 0..3 {
            let (a, b) = (&now.actuators[c], &next.actuators[c]);
            let part = 0.5 * (a.amount + b.amount) * (b.input - a.input);
            sum += part;
            size += part.abs();
        }
    }
    assert!(
        size > 1e-4 && sum.abs() < 2e-4 * size,
        "{sum:.2e} of {size:.2e} J"
    );
    // And the work of the way out is the stored energy: no load on the platform.
    let full = &states[2 * steps];
    let mut work = 0.0;
    for i in 0..2 * steps {
        for c in 0..3 {
            let (a, b) = (&states[i].actuators[c], &states[i + 1].actuators[c]);
            work += 0.5 * (a.input + b.input) * (b.amount - a.amount);
        }
    }
    assert!(
        (work / full.energy_J - 1.0).abs() < 2e-3,
        "{work} {}",
        full.energy_J
    );
}

#[test]
fn one_pressure_bends_the_arm_away_and_all_lengthen_it() {
    let fem = fem(&arm());
    let one = solved(&fem, Load::Wrench([0.0; 6]), &[1e4, 0.0, 0.0]);
    // Chamber 1 lies at +y: its side grows longer, the tip turns to -y about +z's opposite.
    assert!(one.pose[1] < -1e-4 && one.pose[5] < -2e-3, "{:?}", one.pose);
    assert!(
        one.pose[2].abs() < 2e-2 * one.pose[1].abs(),
        "{:?}",
        one.pose
    );
    let all = solved(&fem, Load::Wrench([0.0; 6]), &[1e4; 3]);
    assert!(
        all.pose[0] > 0.10005 && all.pose[1].abs() < 1e-5,
        "{:?}",
        all.pose
    );
    // The next chamber turns the pose by a third about x.
    let next = solved(&fem, Load::Wrench([0.0; 6]), &[0.0, 1e4, 0.0]);
    let (s, c) = (2.0 * PI / 3.0).sin_cos();
    let turned = c * one.pose[1];
    assert!(
        (next.pose[1] / turned - 1.0).abs() < 4e-2,
        "{:?}",
        next.pose
    );
    assert!(
        (next.pose[2] / (s * one.pose[1]) - 1.0).abs() < 4e-2,
        "{:?}",
        next.pose
    );
}

#[test]
fn a_batch_gives_what_each_row_gives() {
    let fem = fem(&arm());
    let rows: Vec<Case> = (0..18)
        .map(|i| {
            let s = |k: usize| ((i * (3 * k + 2)) % 7) as f64 / 7.0;
            let pressures = [8e3 * s(0), 8e3 * s(1), 8e3 * s(2)];
            let wrench = [2.0 * s(3), s(4) - 0.5, s(5) - 0.5, 0.0, 0.0, 0.0];
            Case::new(Load::Wrench(wrench), &pressures).unwrap()
        })
        .collect();
    let together = fem.solve_all(&rows, Watch::default()).unwrap();
    for (row, result) in rows.iter().zip(&together) {
        let (alone, _) = fem.solve(*row).unwrap();
        assert_eq!(
            (alone.status, result.status),
            (Status::Solved, Status::Solved)
        );
        for k in 0..6 {
            let unit = if k < 3 { 0.1 } else { 1.0 };
            assert!((alone.pose[k] - result.pose[k]).abs() < 1e-7 * unit);
        }
        assert!((alone.actuators[1].amount - result.actuators[1].amount).abs() < 1e-12);
    }
}

/// Nodes of the two sides of a chamber towards y that lie in its plane of symmetry, by x.
fn sides(mesh: &Mesh, radii_m: [f64; 2]) -> [Vec<usize>; 2] {
    let x = mesh.nodes_m();
    radii_m.map(|radius| {
        let own = |n: &&usize| x[**n][2].abs() < 1e-9 && (x[**n][1] - radius).abs() < 1e-9;
        let mut side: Vec<usize> = mesh.chambers()[0].1.iter().filter(own).copied().collect();
        side.sort_by(|a, b| x[*a][0].total_cmp(&x[*b][0]));
        side
    })
}

#[test]
fn a_chamber_whose_sides_meet_is_a_status_and_never_a_pose() {
    let (inner, outer) = (0.0115, 0.014);
    let body = Chambered {
        shape: ChamberShape::Sector {
            inner_radius_m: inner,
            outer_radius_m: outer,
            angle_rad: 1.3,
        },
        ..sectors(0.0, 0.0)
    };
    let mesh = Mesh::chambered(&body, "1x4x9".parse().unwrap()).unwrap();
    let nodes = mesh.nodes_m().to_vec();
    let [below, above] = sides(&mesh, [inner, outer]);
    assert!(below.len() > 8 && below.len() == above.len());
    let fem = Fem::new(mesh, neo(0.49), None).unwrap();
    let straight = [0.1, 0.0, 0.0, 0.0, 0.0, 0.0];
    let bent = |q: f64| {
        let r = 0.1 / q;
        [r * q.sin(), r * (1.0 - q.cos()), 0.0, 0.0, 0.0, q]
    };
    let suction = (1..16).map(|i| (straight, -1e3 * f64::from(i)));
    let cases = suction.chain((5..10).map(|i| (bent(0.2 * f64::from(i)), 0.0)));
    let (mut solved, mut collapsed) = (0, [0, 0]);
    for (pose, pressure) in cases {
        let case = Case::new(Load::Pose(pose), &[pressure, 0.0, 0.0]).unwrap();
        let (result, field) = fem.solve_field(case, Watch::default()).unwrap();
        // Least distance of the sides in the last stable state, across the arc.
        let gap = below.iter().zip(&above).map(|(&i, &j)| {
            let to = |n: usize| [0, 1].map(|k| nodes[n][k] + field.displacement[3 * n + k]);
            let (from, to) = (to(i), to(j));
            let turned = result.pose[5] * nodes[i][0] / 0.1;
            (to[1] - from[1]) * turned.cos() - (to[0] - from[0]) * turned.sin()
        });
        let gap = gap.fold(f64::INFINITY, f64::min);
        match result.status {
            Status::Solved => {
                solved += 1;
                assert!(gap > 0.0, "{pose:?} {pressure}: {gap:.1e} m");
            }
            Status::Collapsed => {
                collapsed[usize::from(pressure == 0.0)] += 1;
                // Bent, the sides meet beside the plane of symmetry.
                let close = pressure == 0.0 || gap < 1e-4;
                assert!(gap > 0.0 && close, "{pose:?} {pressure}: {gap:.1e} m");
            }
            other => assert_eq!(other, Status::Solved),
        }
    }
    assert!(
        solved > 13 && collapsed.iter().all(|n| *n > 1),
        "{solved} {collapsed:?}"
    );
}

#[test]
fn wrong_chambers_and_pressures_are_refused() {
    let mesh = common::mesh();
    let one = mesh.clone().with_chamber("a", vec![0, 1, 2]).unwrap();
    let error = Fem::new(one, neo(0.49), None).unwrap_err();
    assert!(matches!(error, FemError::Chamber { .. }), "{error}");
    assert!(mesh.clone().with_chamber("a", vec![usize::MAX]).is_err());
    let fem = fem(&arm());
    let load = Load::Wrench([0.0; 6]);
    for wrong in [&[1.0][..], &[1.0; 17], &[f64::NAN, 0.0, 0.0]] {
        let refused = Case::new(load, wrong).and_then(|case| fem.solve(case));
        assert!(refused.is_err());
    }
    for wrong in [
        Chambered {
            chambers: 1,
            ..arm()
        },
        Chambered {
            radius_m: 0.01,
            ..arm()
        },
        Chambered {
            end_wall_m: 0.05,
            ..arm()
        },
        Chambered {
            channel_radius_m: f64::NAN,
            ..arm()
        },
    ] {
        assert!(
            Mesh::chambered(&wrong, Quality::Standard).is_err(),
            "{wrong:?}"
        );
    }
}
