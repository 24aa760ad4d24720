//! Tendons, windings and given amounts: closed forms, derivatives, and both ways to drive a body.
#![allow(clippy::unwrap_used, non_snake_case, missing_docs)]

use ecm_fem::tensor::{cofactor, determinant};
use ecm_fem::{
    BODY, Case, CaseResult, ChamberShape, Chambered, Constraint, Fem, FemError, Laid, Load, Mesh,
    NeoHookean, OUTSIDE, Quality, Settings, Status, Tendon, Watch,
};
use std::f64::consts::{FRAC_PI_2, PI};

const MU: f64 = 1e5;
const COARSE: Quality = Quality::custom([1, 4, 6], [1000, 1000]);

fn neo(nu: f64) -> Box<NeoHookean> {
    Box::new(NeoHookean::new(2.0 * MU * (1.0 + nu), nu).unwrap())
}

/// At a distance from the axis, through `guides` points of the body.
fn along(name: &str, [y, z]: [f64; 2], length_m: f64, guides: usize) -> Tendon {
    let at = |k: usize| [length_m * k as f64 / (guides + 1) as f64, y, z];
    Tendon {
        name: name.into(),
        base_m: vec![at(0)],
        body_m: (1..=guides).map(at).collect(),
        platform_m: vec![at(guides + 1)],
    }
}

/// Three chambers, two tendons, one of them free between base and platform, and two windings.
fn arm() -> Fem {
    let body = Chambered {
        length_m: 0.1,
        radius_m: 0.02,
        channel_radius_m: 0.004,
        chambers: 3,
        shape: ChamberShape::Round {
            radius_m: 0.0045,
            offset_m: 0.012,
        },
        end_wall_m: 0.0,
    };
    let free = Tendon {
        name: "free".into(),
        base_m: vec![[0.0, 0.03, 0.0], [0.01, 0.03, 0.004]],
        body_m: vec![],
        platform_m: vec![[0.1, 0.0, 0.025]],
    };
    let mesh = Mesh::chambered(&body, COARSE)
        .unwrap()
        .with_tendon(along("guided", [0.01, 0.012], 0.1, 4))
        .unwrap()
        .with_tendon(free)
        .unwrap()
        .with_winding(OUTSIDE, [0.4, -0.4], Laid::OnSurface { stiffness_N_m: 2e3 })
        .unwrap()
        .with_winding(BODY, [0.3, -0.8], Laid::InRegion { stiffness_Pa: 5e4 })
        .unwrap();
    Fem::new(mesh, neo(0.49), None).unwrap()
}

fn solved(fem: &Fem, case: Case) -> CaseResult {
    let (result, _) = fem.solve(case).unwrap();
    assert_eq!(result.status, Status::Solved);
    result
}

#[test]
fn derivatives_are_those_of_neighbouring_states_and_reciprocal() {
    let fem = arm();
    let names = ["chamber_1", "chamber_2", "chamber_3", "guided", "free"];
    assert_eq!(fem.actuators(), names);
    let pose = [0.101, 0.004, -0.002, 0.05, 0.2, -0.1];
    let inputs = [4e3, 1e3, 0.0, 1.5, 0.8];
    let at = |pose: [f64; 6], inputs: [f64; 5]| {
        solved(&fem, Case::new(Load::Pose(pose), &inputs).unwrap())
    };
    let here = at(pose, inputs);
    for c in 0..5 {
        let step = if c < 3 { 20.0 } else { 5e-3 };
        let moved = |sign: f64| {
            let mut p = inputs;
            p[c] += sign * step;
            at(pose, p)
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        let own = &here.actuators[c];
        let size = own.on_wrench.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        for k in 0..6 {
            let slope = (up.wrench[k] - down.wrench[k]) / (2.0 * step);
            let gap = (slope - own.on_wrench[k]).abs();
            assert!(gap <= 2e-5 * size, "{c}{k}: {slope} {}", own.on_wrench[k]);
        }
        for other in 0..5 {
            let (a, b) = (&up.actuators[other], &down.actuators[other]);
            let slope = (a.amount - b.amount) / (2.0 * step);
            let given = here.actuators[other].on_amounts[c];
            let largest = (own.on_amounts[c] * here.actuators[other].on_amounts[other]).sqrt();
            assert!((slope - given).abs() <= 2e-5 * largest, "{slope} {given}");
            assert!((given - own.on_amounts[other]).abs() <= 1e-9 * largest);
        }
    }
    // q by the position of the platform is −G; K by differences.
    for k in 0..3 {
        let step = 1e-5;
        let moved = |sign: f64| {
            let mut p = pose;
            p[k] += sign * step;
            at(p, inputs)
        };
        let (up, down) = (moved(1.0), moved(-1.0));
        for c in 0..5 {
            let slope = (up.actuators[c].amount - down.actuators[c].amount) / (2.0 * step);
            let given = -here.actuators[c].on_wrench[k];
            let size = if c < 3 { 1e-5 } else { 0.1 };
            assert!((slope - given).abs() < 1e-5 * size, "{slope} {given}");
        }
        for j in 0..6 {
            let slope = (up.wrench[j] - down.wrench[j]) / (2.0 * step);
            let unit = here.stiffness[k][k].abs();
            assert!((slope - here.stiffness[j][k]).abs() < 1e-4 * unit);
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

/// A guided tendon loads each section alike: M = T e and N = −T, so the beam takes a constant
/// curvature whatever the tension, e from the axis.
#[test]
fn an_offset_tendon_bends_a_beam_to_an_arc() {
    // Both clamped ends stiffen a length of the order of the radius.
    let [short, long] = [0.3, 0.6].map(arc_errors);
    for (short, long) in short.iter().zip(&long) {
        assert!(short.abs() < 0.05, "{short}");
        assert!((2.0 * long - short).abs() < 1e-3, "{short} {long}");
    }
}

/// Errors of angle, place and shortening of two arcs, over their values.
fn arc_errors(length: f64) -> Vec<f64> {
    let (radius, offset) = (0.015, 0.012);
    let layers = (50.0 * length) as usize;
    let quality = Quality::custom([2, layers, 8], [1000, 1000]);
    let mesh = Mesh::cylinder(length, radius, quality).unwrap();
    let tendon = along("t", [offset, 0.0], length, layers - 1);
    let mesh = mesh.with_tendon(tendon).unwrap();
    let fem = Fem::new(mesh, neo(0.49), None).unwrap();
    let (young, area) = (2.0 * MU * 1.49, PI * radius * radius);
    let bending = young * area * radius * radius / 4.0;
    let mut errors = Vec::new();
    for angle in [0.02, 0.6] {
        let tension = angle * bending / (offset * length);
        let load = Load::Wrench([0.0; 6]);
        let result = solved(&fem, Case::new(load, &[tension]).unwrap());
        // The tendon lies at +y: the tip turns towards it, about +z.
        let shrunk = 1.0 - tension / (young * area);
        let arc = length * shrunk / angle;
        let aside = arc * (1.0 - angle.cos());
        let shortening = angle * offset + length * (1.0 - shrunk);
        for (found, wanted) in [
            (result.pose[5], angle),
            (result.pose[1], aside),
            (result.pose[0] - length, arc * angle.sin() - length),
            (result.actuators[0].amount, shortening),
        ] {
            errors.push(found / wanted - 1.0);
        }
    }
    errors
}

/// Energy of a cylinder of constant volume with threads on its side, per length, at an axial stretch.
fn wound_energy(stretch: f64, radius: f64, angle: f64, k: f64) -> f64 {
    let solid = 0.5 * MU * (stretch.powi(2) + 2.0 / stretch - 3.0);
    let thread = (angle.cos().powi(2) / stretch + (angle.sin() * stretch).powi(2)).sqrt();
    PI * radius * radius * solid + 2.0 * PI * radius * 0.5 * k * (thread - 1.0).powi(2)
}

#[test]
fn threads_round_a_cylinder_take_their_share_of_its_stretch() {
    let (length, radius) = (0.05, 0.02);
    let quality = Quality::custom([2, 4, 24], [1000, 1000]);
    for angle in [0.0, 0.7, FRAC_PI_2] {
        let k = 0.3 * MU * radius;
        let mesh = Mesh::cylinder(length, radius, quality).unwrap();
        let mesh = mesh
            .with_winding(
                OUTSIDE,
                [angle, -angle],
                Laid::OnSurface { stiffness_N_m: k },
            )
            .unwrap();
        // Ends that slide: the state is homogeneous.
        let nodes = mesh.nodes_m().to_vec();
        let mut held = vec![Constraint::Free; 3 * nodes.len()];
        let mut given = vec![0.0; 3 * nodes.len()];
        let stretch = 1.2;
        for (node, x) in nodes.iter().enumerate() {
            if x[0] < 1e-9 || x[0] > length - 1e-9 {
                held[3 * node] = Constraint::Prescribed;
                given[3 * node] = (stretch - 1.0) * x[0];
            }
            if x[1].abs() < 1e-9 {
                held[3 * node + 1] = Constraint::Prescribed;
            }
            if x[2].abs() < 1e-9 {
                held[3 * node + 2] = Constraint::Prescribed;
            }
        }
        let fem = Fem::with_prescribed(mesh, neo(0.5), Settings::default(), &held).unwrap();
        let result = fem.solve_prescribed(&given, Watch::default()).unwrap();
        assert_eq!(result.status, Status::Solved);
        let top = (0..nodes.len()).filter(|&n| nodes[n][0] > length - 1e-9);
        let force: f64 = top.map(|n| result.reaction_N[3 * n]).sum();
        let step = 1e-5;
        let energy = |s: f64| wound_energy(s, radius, angle, k);
        let expected = (energy(stretch + step) - energy(stretch - step)) / (2.0 * step);
        assert!(
            (force / expected - 1.0).abs() < 3e-3,
            "{angle}: {force} {expected}"
        );
    }
}

const TUBE: [f64; 2] = [0.01, 0.02];

/// Potential per undeformed length of a tube of constant volume and closed ends under a pressure,
/// wound all through its wall. `state`: stretch of the inner radius, stretch along x, twist times the
/// outer radius.
fn tube_potential(state: [f64; 3], pressure: f64, k: f64, angles: [f64; 2]) -> f64 {
    let [inner, outer] = TUBE;
    let (bore, along, twist) = (state[0] * inner, state[1], state[2] / outer);
    let points = 400;
    let width = (outer - inner) / points as f64;
    let mut sum = -pressure * PI * bore * bore * along;
    for i in 0..points {
        let at_rest = inner + width * (i as f64 + 0.5);
        let r = (bore * bore + (at_rest * at_rest - inner * inner) / along).sqrt();
        let (hoop, turn) = (r / at_rest, twist * r);
        let across = 1.0 / (hoop * along);
        let solid = 0.5 * MU * (across.powi(2) + hoop.powi(2) + along.powi(2) + turn.powi(2) - 3.0);
        let threads = angles.map(|angle| {
            let (s, c) = angle.sin_cos();
            0.25 * k * ((c * hoop + s * turn).hypot(s * along) - 1.0).powi(2)
        });
        sum += 2.0 * PI * at_rest * width * (solid + threads[0] + threads[1]);
    }
    sum
}

/// Where that potential is least, by Newton's method on central differences.
fn tube_state(pressure: f64, k: f64, angles: [f64; 2]) -> [f64; 3] {
    let step = 1e-4;
    let mut state = [1.0, 1.0, 0.0];
    for _ in 0..12 {
        let at = |moves: [f64; 3]| {
            let moved = std::array::from_fn(|i| state[i] + step * moves[i]);
            tube_potential(moved, pressure, k, angles)
        };
        let unit = |i: usize, by: f64| std::array::from_fn(|j| if i == j { by } else { 0.0 });
        let sum = |a: [f64; 3], b: [f64; 3]| std::array::from_fn(|i| a[i] + b[i]);
        let gradient = [0, 1, 2].map(|i| (at(unit(i, 1.0)) - at(unit(i, -1.0))) / (2.0 * step));
        let curvature = [0, 1, 2].map(|i| {
            [0, 1, 2].map(|j| {
                let pair = |a, b| at(sum(unit(i, a), unit(j, b)));
                let crossed = pair(1.0, 1.0) - pair(1.0, -1.0) - pair(-1.0, 1.0) + pair(-1.0, -1.0);
                crossed / (4.0 * step * step)
            })
        });
        let inverse = cofactor(&curvature);
        let det = determinant(&curvature);
        for i in 0..3 {
            state[i] -= (0..3).map(|j| inverse[i][j] * gradient[j]).sum::<f64>() / det;
        }
    }
    state
}

#[test]
fn a_tube_wound_all_through_follows_the_closed_form_in_swelling_length_and_twist() {
    let ([inner, outer], length) = (TUBE, 0.2);
    let radius = |x: &[f64; 3]| x[1].hypot(x[2]);
    for (angles, k) in [([0.5, -0.5], 5.0 * MU), ([0.4, 1.0], 5.0 * MU)] {
        let mesh = Mesh::tube(length, outer, inner, Quality::Standard).unwrap();
        let bore: Vec<usize> = (0..mesh.nodes_m().len())
            .filter(|&n| (radius(&mesh.nodes_m()[n]) - inner).abs() < 1e-6 * inner)
            .collect();
        let mesh = mesh.with_chamber("bore", bore.clone()).unwrap();
        let mesh = mesh.with_winding(BODY, angles, Laid::InRegion { stiffness_Pa: k });
        let mesh = mesh.unwrap();
        let nodes = mesh.nodes_m().to_vec();
        let fem = Fem::new(mesh, neo(0.5), None).unwrap();
        let pressure = 0.4 * MU;
        let case = Case::new(Load::Wrench([0.0; 6]), &[pressure]).unwrap();
        let (result, field) = fem.solve_field(case, Watch::default()).unwrap();
        assert_eq!(result.status, Status::Solved);
        // Far from the bonded ends: radius, and slopes along x of place and of angle.
        let middle = (bore.iter()).filter(|&&n| (nodes[n][0] - 0.5 * length).abs() < 0.1 * length);
        let mut sums = [0.0; 5];
        for &n in middle {
            let (from, u) = (nodes[n], &field.displacement[3 * n..3 * n + 3]);
            let to: [f64; 3] = std::array::from_fn(|i| from[i] + u[i]);
            let turned = from[1] * to[2] - from[2] * to[1];
            let angle = turned.atan2(from[1] * to[1] + from[2] * to[2]);
            let x = from[0] - 0.5 * length;
            let values = [
                1.0,
                radius(&to) / inner,
                x * x,
                x * (to[0] - 0.5 * length),
                x * angle,
            ];
            (0..5).for_each(|i| sums[i] += values[i]);
        }
        let found = [
            sums[1] / sums[0],
            sums[3] / sums[2],
            outer * sums[4] / sums[2],
        ];
        let expected = tube_state(pressure, k, angles);
        for (i, rest) in [1.0, 1.0, 0.0].into_iter().enumerate() {
            let (found, expected) = (found[i] - rest, expected[i] - rest);
            let most = 1e-2 * expected.abs() + 1e-6;
            assert!((found - expected).abs() < most, "{i}: {found} {expected}");
        }
    }
}

#[test]
fn windings_keep_chambers_from_swelling() {
    let swelling = |k: f64| {
        let body = Chambered {
            length_m: 0.1,
            radius_m: 0.02,
            channel_radius_m: 0.0,
            chambers: 3,
            shape: ChamberShape::Round {
                radius_m: 0.0045,
                offset_m: 0.012,
            },
            end_wall_m: 0.0,
        };
        let mut mesh = Mesh::chambered(&body, COARSE).unwrap();
        for chamber in ["chamber_1", "chamber_2", "chamber_3"] {
            if k > 0.0 {
                mesh = mesh
                    .with_winding(chamber, [0.05, -0.05], Laid::OnSurface { stiffness_N_m: k })
                    .unwrap();
            }
        }
        let fem = Fem::new(mesh, neo(0.49), None).unwrap();
        let held = Load::Pose([0.1, 0.0, 0.0, 0.0, 0.0, 0.0]);
        solved(&fem, Case::new(held, &[1e4; 3]).unwrap()).actuators[0].amount
    };
    let (free, wound) = (swelling(0.0), swelling(1e5));
    assert!(wound > 0.0 && wound < 0.05 * free, "{wound:.2e} {free:.2e}");
}

#[test]
fn given_amounts_are_reached_by_the_inputs_that_give_them() {
    let fem = arm();
    let inputs = [4e3, 1e3, 0.0, 1.5, 0.8];
    // At a given pose a tendon can hardly change its length: volumes alone are given there.
    for (load, given) in [
        (
            Load::Wrench([1.0, 0.3, -0.2, 0.0, 0.01, 0.0]),
            [true, false, true, true, true],
        ),
        (
            Load::Pose([0.101, 0.004, -0.002, 0.05, 0.2, -0.1]),
            [true, false, true, false, false],
        ),
    ] {
        let driven = solved(&fem, Case::new(load, &inputs).unwrap());
        let values: Vec<f64> = (0..5)
            .map(|k| match given[k] {
                true => driven.actuators[k].amount,
                false => inputs[k],
            })
            .collect();
        let case = Case::new(load, &values).unwrap().with_amounts(&given);
        let held = solved(&fem, case);
        for k in 0..5 {
            let gap = held.actuators[k].input - inputs[k];
            assert!(gap.abs() < if k < 3 { 0.05 } else { 1e-5 }, "{k}: {gap}");
        }
        for k in 0..6 {
            assert!((held.pose[k] - driven.pose[k]).abs() < 1e-8);
        }
        // Held amounts stiffen the platform: K + G C⁻¹ Gᵀ, here by differences.
        if let Load::Pose(pose) = load {
            let step = 1e-5;
            let moved = |sign: f64| {
                let mut p = pose;
                p[0] += sign * step;
                let case = Case::new(Load::Pose(p), &values).unwrap();
                solved(&fem, case.with_amounts(&given))
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for j in 0..6 {
                let slope = (up.wrench[j] - down.wrench[j]) / (2.0 * step);
                let unit = held.stiffness[0][0];
                assert!((slope - held.stiffness[j][0]).abs() < 1e-5 * unit);
            }
            assert!(held.stiffness[0][0] > 1.002 * driven.stiffness[0][0]);
        }
        let batch = fem.solve_all(&[case; 20], Watch::default()).unwrap();
        for result in batch {
            assert_eq!(result.status, Status::Solved);
            assert!((result.actuators[0].input - inputs[0]).abs() < 0.05);
        }
    }
}

#[test]
fn a_tendon_only_pulls() {
    let fem = arm();
    let rest = Load::Wrench([0.0; 6]);
    let refused = Case::new(rest, &[0.0, 0.0, 0.0, -1.0, 0.0]).unwrap();
    assert!(
        fem.solve(refused)
            .unwrap_err()
            .to_string()
            .contains("only pulls")
    );
    // Let out by 2 mm the tendon is slack, and the body as without it.
    let let_out = Case::new(rest, &[0.0, 0.0, 0.0, -2e-3, 0.0]).unwrap();
    let let_out = let_out.with_amounts(&[false, false, false, true, false]);
    let slack = fem.solve_all(&[let_out], Watch::default()).unwrap();
    assert_eq!(slack[0].status, Status::Solved);
    assert_eq!(slack[0].actuators[3].input, 0.0);
    assert!(slack[0].pose[1].abs() < 1e-9);
}

#[test]
fn tendons_and_windings_that_are_none_are_refused() {
    let mesh = || Mesh::cylinder(0.1, 0.02, COARSE).unwrap();
    let outside = along("t", [0.05, 0.0], 0.1, 2);
    let error = |tendon: Tendon| {
        let mesh = mesh().with_tendon(tendon).unwrap();
        Fem::new(mesh, neo(0.49), None).unwrap_err().to_string()
    };
    assert!(error(outside).contains("lies outside of the body"));
    let single = Tendon {
        base_m: vec![[0.0; 3]],
        ..Tendon::default()
    };
    assert!(error(single).contains("expected at least 2"));
    let double = Tendon {
        base_m: vec![[0.0; 3], [0.0; 3]],
        ..Tendon::default()
    };
    assert!(error(double).contains("at one place"));
    let on_surface = |stiffness_N_m| Laid::OnSurface { stiffness_N_m };
    let in_region = |stiffness_Pa| Laid::InRegion { stiffness_Pa };
    let refused = |on: &str, angles_rad: [f64; 2], laid: Laid| {
        mesh().with_winding(on, angles_rad, laid).unwrap_err()
    };
    let error = refused("chamber_9", [0.1; 2], on_surface(1.0));
    let names = "the mesh has no such surface with faces along x; it has outside";
    assert!(matches!(error, FemError::Winding { .. }) && error.to_string().contains(names));
    let error = refused("sleeve", [0.1; 2], in_region(1.0)).to_string();
    assert!(error.contains("winding on `sleeve`: the mesh has no such region; it has body"));
    let error = refused(OUTSIDE, [0.1; 2], on_surface(0.0)).to_string();
    assert!(error.contains("stiffness of a winding is 0"), "{error}");
    let error = refused(BODY, [0.1; 2], in_region(f64::NAN)).to_string();
    assert!(error.contains("in a region is NaN; expected a positive number in Pa"));
    for angles in [[f64::NAN, 0.1], [0.1, f64::INFINITY], [0.1, -1.6]] {
        let error = refused(BODY, angles, in_region(1.0)).to_string();
        assert!(error.contains("the angle of a winding"), "{error}");
    }
    let error = mesh()
        .with_region("sleeve", vec![0, 1_000_000])
        .unwrap_err();
    assert!(
        error
            .to_string()
            .contains("a tetrahedron of a region is 1000000")
    );
}
