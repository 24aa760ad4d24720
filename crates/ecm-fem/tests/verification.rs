//! Solutions from outside: manufactured, Cook's membrane, elastica, incompressible limit.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use common::surface_nodes;
use ecm_fem::element::{Rule, tet10};
use ecm_fem::tensor::{Mat3, cofactor, determinant};
use ecm_fem::{
    Constraint, Fem, Formulation, Material, Mesh, NeoHookean, PrescribedResult, Quality, Settings,
    Status, Watch,
};
use std::f64::consts::PI;

/// n[0] × n[1] × n[2] cells of six tetrahedra on the unit cube, moved by `place`.
fn block(n: [usize; 3], place: impl Fn([f64; 3]) -> [f64; 3]) -> Mesh {
    let at = |i: usize, j: usize, k: usize| (i * (n[1] + 1) + j) * (n[2] + 1) + k;
    let mut corners = Vec::new();
    for i in 0..n[0] {
        for j in 0..n[1] {
            for k in 0..n[2] {
                // Kuhn: one tetrahedron per order of the three unit steps.
                for order in [
                    [0, 1, 2],
                    [1, 2, 0],
                    [2, 0, 1],
                    [0, 2, 1],
                    [2, 1, 0],
                    [1, 0, 2],
                ] {
                    let mut c = [i, j, k];
                    let mut tet = [at(i, j, k); 4];
                    for (m, axis) in order.into_iter().enumerate() {
                        c[axis] += 1;
                        tet[m + 1] = at(c[0], c[1], c[2]);
                    }
                    let odd = matches!(order, [0, 2, 1] | [2, 1, 0] | [1, 0, 2]);
                    if odd {
                        tet.swap(2, 3);
                    }
                    corners.push(tet);
                }
            }
        }
    }
    let mut nodes = Vec::new();
    for i in 0..=n[0] {
        for j in 0..=n[1] {
            for k in 0..=n[2] {
                let share = |a: usize, axis: usize| a as f64 / n[axis] as f64;
                nodes.push(place([share(i, 0), share(j, 1), share(k, 2)]));
            }
        }
    }
    let tets = Mesh::with_mid_nodes(&mut nodes, &corners).unwrap();
    Mesh::without_faces(nodes, tets, 1.0).unwrap()
}

/// u(X) of the manufactured solution and its gradient (rows: component).
fn manufactured(x: [f64; 3]) -> ([f64; 3], Mat3) {
    let (a, p) = (0.08, PI);
    let (s, c) = (|v: f64| (p * v).sin(), |v: f64| (p * v).cos());
    let u = [
        a * s(x[1]) * c(x[2]),
        a * s(x[2]) * c(x[0]),
        a * s(x[0]) * s(x[1]),
    ];
    let g = [
        [0.0, a * p * c(x[1]) * c(x[2]), -a * p * s(x[1]) * s(x[2])],
        [-a * p * s(x[2]) * s(x[0]), 0.0, a * p * c(x[2]) * c(x[0])],
        [a * p * c(x[0]) * s(x[1]), a * p * s(x[0]) * c(x[1]), 0.0],
    ];
    (u, g)
}

/// P of the manufactured solution with p = κ (J − 1).
fn first_piola(x: [f64; 3], material: &NeoHookean) -> Mat3 {
    let mut f = manufactured(x).1;
    (0..3).for_each(|k| f[k][k] += 1.0);
    let jacobian = determinant(&f);
    let stress = material.respond(&f, jacobian).stress;
    let (c, p) = (cofactor(&f), material.bulk_modulus_Pa() * (jacobian - 1.0));
    std::array::from_fn(|i| std::array::from_fn(|j| stress[i][j] + p * c[i][j]))
}

/// Method of manufactured solutions (Roache 2002): the body force −Div P of a given u on a
/// cube whose whole boundary follows u; displacement converges with order 3 in L2.
#[test]
fn displacement_converges_with_the_third_order() {
    for (formulation, poisson) in [
        (Formulation::TaylorHood, 0.49),
        (Formulation::Displacement, 0.3),
    ] {
        let errors = [3, 6].map(|n| manufactured_error(block([n; 3], |x| x), formulation, poisson));
        let order = (errors[0] / errors[1]).log2();
        assert!(order >= 2.8, "{formulation:?}: order {order}, {errors:?}");
    }
}

/// The same on each built-in body: curved elements keep the order, also where edges within the
/// body follow the outline (a thin wall, a narrow waist).
#[test]
fn each_builtin_body_converges_with_the_third_order() {
    let sizes = |n: usize, rings: usize, layers: usize, around: usize| {
        Quality::custom([n * rings, n * layers, n * around], [1000, 1000])
    };
    type Make = fn(Quality) -> Result<Mesh, ecm_fem::FemError>;
    let bodies: [(&str, Make, [usize; 3]); 5] = [
        ("cylinder", |q| Mesh::cylinder(1.0, 0.5, q), [2, 3, 8]),
        ("thick tube", |q| Mesh::tube(1.0, 0.5, 0.2, q), [2, 3, 10]),
        ("thin tube", |q| Mesh::tube(1.0, 0.5, 0.44, q), [2, 3, 10]),
        (
            "hourglass",
            |q| Mesh::hourglass(1.0, 0.5, 0.1, q),
            [2, 4, 8],
        ),
        (
            "discs",
            |q| Mesh::stacked_discs(1.0, 0.5, 0.15, 2, q),
            [2, 5, 8],
        ),
    ];
    for (name, make, [rings, layers, around]) in bodies {
        let errors = [1, 2].map(|n| {
            let mesh = make(sizes(n, rings, layers, around)).unwrap();
            manufactured_error(mesh, Formulation::TaylorHood, 0.49)
        });
        let order = (errors[0] / errors[1]).log2();
        assert!(order >= 2.6, "{name}: order {order}, {errors:?}");
    }
}

/// Error in L2 of a body whose whole surface follows the manufactured solution.
fn manufactured_error(mesh: Mesh, formulation: Formulation, poisson: f64) -> f64 {
    let material = NeoHookean::new(1.0, poisson).unwrap();
    let nodes = mesh.nodes_m().to_vec();
    let mut constraints = vec![Constraint::Free; 3 * nodes.len()];
    let mut given = vec![0.0; 3 * nodes.len()];
    for i in surface_nodes(&mesh) {
        constraints[3 * i..3 * i + 3].fill(Constraint::Prescribed);
        given[3 * i..3 * i + 3].copy_from_slice(&manufactured(nodes[i]).0);
    }
    let settings = Settings {
        rule: Rule::Degree5,
        formulation,
        ..Settings::default()
    };
    let fem = Fem::with_prescribed(mesh, Box::new(material), settings, &constraints).unwrap();
    let h = 1e-4;
    let force = fem.body().volume_load(|x| {
        let mut b = [0.0; 3];
        for j in 0..3 {
            let moved = |s: f64| {
                let mut y = x;
                y[j] += s * h;
                first_piola(y, &material)
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            (0..3).for_each(|i| b[i] -= (up[i][j] - down[i][j]) / (2.0 * h));
        }
        b
    });
    let fem = fem.with_dead_force(force).unwrap();
    let result = fem.solve_prescribed(&given, Watch::default()).unwrap();
    assert_eq!(result.status, Status::Solved);
    square_error(&fem, &result).sqrt()
}

fn square_error(fem: &Fem, result: &PrescribedResult) -> f64 {
    let (body, u) = (fem.body(), &result.field.displacement);
    let rule = body.rule.points();
    let mut sum = 0.0;
    for (e, tet) in body.mesh.tetrahedra().iter().enumerate() {
        for (q, (lambda, _)) in rule.iter().enumerate() {
            let n = tet10::shape(lambda);
            let x = [0, 1, 2].map(|k| {
                (0..10)
                    .map(|a| n[a] * body.mesh.nodes_m()[tet[a]][k])
                    .sum::<f64>()
            });
            let exact = manufactured(x).0;
            for k in 0..3 {
                let found: f64 = (0..10).map(|a| n[a] * u[3 * tet[a] + k]).sum();
                sum += body.points[e * rule.len() + q].volume_m3 * (found - exact[k]).powi(2);
            }
        }
    }
    sum
}

/// Cook's panel of unit thickness, n × n × 1 cells; `hold_z` says which nodes keep their z.
/// Returns the displacement of (48, `at`) under a dead shear `load` on the right edge.
fn cook(n: usize, at: f64, load: f64, material: NeoHookean, hold_z: fn(f64) -> bool) -> [f64; 2] {
    let mesh = block([n, n, 1], |s| {
        let low = 44.0 * s[0];
        let high = 44.0 + 16.0 * s[0];
        [48.0 * s[0], low + s[1] * (high - low), s[2]]
    });
    let nodes = mesh.nodes_m().to_vec();
    let mut constraints = vec![Constraint::Free; 3 * nodes.len()];
    for (i, x) in nodes.iter().enumerate() {
        if hold_z(x[2]) {
            constraints[3 * i + 2] = Constraint::Prescribed;
        }
        if x[0] < 1e-9 {
            constraints[3 * i..3 * i + 2].fill(Constraint::Prescribed);
        }
    }
    let fem =
        Fem::with_prescribed(mesh, Box::new(material), Settings::default(), &constraints).unwrap();
    let force = fem
        .body()
        .surface_load(|x| x[0] > 48.0 - 1e-9, [0.0, load / 16.0, 0.0]);
    let fem = fem.with_dead_force(force).unwrap();
    let result = fem
        .solve_prescribed(&vec![0.0; 3 * nodes.len()], Watch::default())
        .unwrap();
    assert_eq!(result.status, Status::Solved);
    let total: f64 = (0..nodes.len())
        .filter(|&i| nodes[i][0] < 1e-9)
        .map(|i| result.reaction_N[3 * i + 1])
        .sum();
    assert!((total / load + 1.0).abs() < 1e-4, "{total}");
    let tip = nodes
        .iter()
        .position(|x| (x[0] - 48.0).abs() < 1e-9 && (x[1] - at).abs() < 1e-9)
        .unwrap();
    [0, 1].map(|k| result.field.displacement[3 * tip + k])
}

/// Cook's membrane in plane strain at finite strain, μ = 80.194, κ = 400 889.8, dead load 100
/// over the right edge. A two-dimensional P2/P1 code gives 6.8001, 6.8741, 6.9043, 6.9185 on 8,
/// 16, 32, 64 divisions, 6.93(1) in the limit; the corners are singular, the order is near 1.
#[test]
fn cooks_membrane_follows_a_plane_code() {
    let (mu, kappa): (f64, f64) = (80.194, 400_889.8);
    let poisson = (3.0 * kappa - 2.0 * mu) / (6.0 * kappa + 2.0 * mu);
    let material = NeoHookean::new(2.0 * mu * (1.0 + poisson), poisson).unwrap();
    let [a, b] = [8, 16].map(|n| cook(n, 60.0, 100.0, material, |_| true)[1]);
    assert!((a / 6.8001 - 1.0).abs() < 0.004, "{a}");
    assert!((b / 6.8741 - 1.0).abs() < 0.004, "{b}");
    assert!(a < b && b < 6.94, "{a} {b}");
    // The plane code's differences fall by 0.41 and 0.47 a halving: what is left after two is
    // 0.5 to 1 of the last.
    let limit = b + 0.75 * (b - a);
    assert!((limit - 6.93).abs() < 0.02, "{limit}");
}

/// Cook's panel as it was published: plane stress, E = 1, ν = 1/3, unit load, 23.96 at the middle
/// of the loaded edge (Cook, J. Struct. Div. 100, 1974; the converged value); at a ten-thousandth of
/// the load, with z held on one face only.
#[test]
fn cooks_panel_in_the_linear_limit() {
    let material = NeoHookean::new(1.0, 1.0 / 3.0).unwrap();
    let found = cook(12, 52.0, 1e-4, material, |z| z < 1e-9)[1] / 1e-4;
    assert!((found / 23.96 - 1.0).abs() < 0.005, "{found}");
}

fn slender() -> (Fem, f64) {
    let (l, r, e) = (1.0, 0.012, 1e7);
    let mesh = Mesh::cylinder(l, r, Quality::custom([1, 60, 8], [1000, 1000])).unwrap();
    let fem = Fem::new(mesh, Box::new(NeoHookean::new(e, 0.3).unwrap()), None).unwrap();
    (fem, e * PI * r.powi(4) / 4.0)
}

/// Elastica of a cantilever under a dead tip force (Bisshopp and Drucker 1945; Mattiasson
/// 1981): P L² / EI = 5 gives w / L = 0.71379, u / L = 0.38763, angle 1.21537.
#[test]
fn cantilever_follows_the_elastica() {
    let (fem, ei) = slender();
    for (load, w, u, angle) in [
        (1.0, 0.30172, 0.05643, 0.46135),
        (5.0, 0.71379, 0.38763, 1.21537),
    ] {
        let r = fem
            .solve_wrench(&[0.0, load * ei, 0.0, 0.0, 0.0, 0.0])
            .unwrap();
        assert_eq!(r.status, Status::Solved);
        for (found, exact) in [(r.pose[1], w), (1.0 - r.pose[0], u), (r.pose[5], angle)] {
            assert!((found - exact).abs() < 0.008 * exact, "{found} {exact}");
        }
    }
}

/// A pure end moment rolls the rod to a circle: with t = M L / EI,
/// x = L sin t / t, y = L (1 − cos t) / t.
#[test]
fn end_moment_bends_to_a_circle() {
    let (fem, ei) = slender();
    let t = 0.5 * PI;
    let r = fem
        .solve_wrench(&[0.0, 0.0, 0.0, 0.0, 0.0, t * ei])
        .unwrap();
    assert_eq!(r.status, Status::Solved);
    assert!((r.pose[5] / t - 1.0).abs() < 0.008, "{}", r.pose[5]);
    let t = r.pose[5];
    assert!((r.pose[0] - t.sin() / t).abs() < 2e-3);
    assert!((r.pose[1] - (1.0 - t.cos()) / t).abs() < 2e-3);
}

fn neck(formulation: Formulation, poisson: f64) -> Fem {
    let mesh = Mesh::cylinder(0.1034, 0.033, Quality::Standard).unwrap();
    let material = Box::new(NeoHookean::new(0.72e6, poisson).unwrap());
    let settings = Settings {
        formulation,
        ..Settings::default()
    };
    Fem::with_settings(mesh, material, None, settings).unwrap()
}

/// Transverse stiffness at rest, 4000(5) N/m converged: P2/P0 below, P2/P1 above, P2 far above.
#[test]
fn elements_bracket_the_stiffness() {
    let k = |f| neck(f, 0.49).rest_stiffness(Watch::default()).unwrap()[1][1] / 4000.0;
    let (soft, mixed, plain) = (
        k(Formulation::ConstantPressure),
        k(Formulation::TaylorHood),
        k(Formulation::Displacement),
    );
    assert!((0.97..1.0).contains(&soft), "{soft}");
    assert!((1.0..1.015).contains(&mixed), "{mixed}");
    assert!(plain > 1.02, "{plain}");
}

/// All three reach the reference wrench in one way from compressible to incompressible, and in
/// few iterations (P2, which locks, not beyond 0.4999).
#[test]
fn every_formulation_solves_the_reference_wrench() {
    for (formulation, poisson, most) in [
        (Formulation::TaylorHood, 0.3, 7),
        (Formulation::ConstantPressure, 0.3, 8),
        (Formulation::ConstantPressure, 0.49, 9),
        (Formulation::ConstantPressure, 0.4999, 12),
        (Formulation::ConstantPressure, 0.5, 12),
        (Formulation::Displacement, 0.3, 8),
        (Formulation::Displacement, 0.49, 10),
        (Formulation::Displacement, 0.4999, 45),
    ] {
        let r = neck(formulation, poisson)
            .solve_wrench(&[-40.0, 30.0, 20.0, 1.0, -1.0, 1.0])
            .unwrap();
        assert_eq!(r.status, Status::Solved, "{formulation:?} {poisson}");
        let (found, locks) = (r.iterations, formulation == Formulation::Displacement);
        assert!(found <= most, "{formulation:?} {poisson}: {found}");
        if poisson >= 0.49 {
            let limit = if locks { 0.09 } else { 0.03 };
            assert!((r.pose[1] / 0.03011 - 1.0).abs() < limit, "{:?}", r.pose);
        }
    }
}

/// K of the elements that eliminate the pressure against finite differences of the wrench: the
/// kept pressure of the last iteration belongs to the state that is reported.
#[test]
fn eliminated_pressures_leave_the_tangent_exact() {
    let quality = Quality::custom([1, 4, 6], [500, 1000]);
    for (formulation, poisson, limit) in [
        (Formulation::ConstantPressure, 0.49, 2e-5),
        // Here the tangent takes κ = 10⁴ μ.
        (Formulation::ConstantPressure, 0.5, 1e-4),
        (Formulation::Displacement, 0.49, 2e-5),
    ] {
        let mesh = Mesh::cylinder(0.1034, 0.033, quality).unwrap();
        let material = Box::new(NeoHookean::new(0.72e6, poisson).unwrap());
        let settings = Settings {
            formulation,
            ..Settings::default()
        };
        let fem = Fem::with_settings(mesh, material, None, settings).unwrap();
        let at = fem
            .solve_wrench(&[-40.0, 30.0, 20.0, 1.0, -1.0, 1.0])
            .unwrap();
        for k in 0..6 {
            let h = if k < 3 { 1e-6 } else { 1e-5 };
            let moved = |s: f64| {
                let mut p = at.pose;
                p[k] += s * h;
                fem.solve_pose(&p).unwrap().wrench
            };
            let (up, down) = (moved(1.0), moved(-1.0));
            for i in 0..6 {
                let fd = (up[i] - down[i]) / (2.0 * h);
                let scale = (at.stiffness[i][i] * at.stiffness[k][k]).abs().sqrt();
                let gap = (fd - at.stiffness[i][k]).abs() / scale;
                assert!(gap < limit, "{formulation:?} {poisson} {i} {k}: {gap}");
            }
        }
    }
}

/// ν = 0.5: the volume is kept, Newton still ends in a few steps, and the stiffness is the
/// limit of ν → 0.5.
#[test]
fn incompressible_is_no_special_case() {
    let exact = neck(Formulation::TaylorHood, 0.5);
    let near = neck(Formulation::TaylorHood, 0.4999);
    let wrench = [-40.0, 30.0, 20.0, 1.0, -1.0, 1.0];
    let (a, b) = (
        exact.solve_wrench(&wrench).unwrap(),
        near.solve_wrench(&wrench).unwrap(),
    );
    assert_eq!(a.status, Status::Solved);
    assert!(a.iterations <= 9, "{}", a.iterations);
    for k in 0..6 {
        assert!((a.pose[k] / b.pose[k] - 1.0).abs() < 3e-3);
        assert!((a.stiffness[k][k] / b.stiffness[k][k] - 1.0).abs() < 3e-3);
    }
    let back = exact.solve_pose(&a.pose).unwrap();
    for k in 0..6 {
        assert!((back.wrench[k] - wrench[k]).abs() < 1e-5);
    }
    let mesh = Mesh::cylinder(0.1, 0.03, Quality::Standard).unwrap();
    let material = Box::new(NeoHookean::new(1e6, 0.5).unwrap());
    let settings = Settings {
        formulation: Formulation::Displacement,
        ..Settings::default()
    };
    assert!(Fem::with_settings(mesh, material, None, settings).is_err());
}
