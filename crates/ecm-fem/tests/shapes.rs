//! The built-in bodies: each within the limits is meshed, passes the patch test, and converges.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use common::{config, surface_nodes};
use ecm_fem::element::Rule;
use ecm_fem::{Constraint, Fem, FemError, Mesh, NeoHookean, Quality, Settings, Status, Watch};
use proptest::prelude::*;
use std::f64::consts::PI;

/// The ranges that `Mesh::tube`, `Mesh::hourglass` and `Mesh::stacked_discs` state.
const THINNEST: f64 = 0.01;

/// Numbers between `low` and `high`, as many in each decade.
fn scales(low: f64, high: f64) -> impl Strategy<Value = f64> {
    (low.ln()..high.ln()).prop_map(f64::exp)
}

fn quality() -> impl Strategy<Value = Quality> {
    prop_oneof![Just(Quality::Standard), Just(Quality::Fine)]
}

/// A body and the volume of its outline.
fn body(
    kind: usize,
    length: f64,
    radius: f64,
    share: f64,
    discs: usize,
    quality: Quality,
) -> (Result<Mesh, FemError>, f64) {
    let (w, d) = (share * radius, (1.0 - share) * radius);
    match kind {
        0 => (
            Mesh::cylinder(length, radius, quality),
            PI * radius * radius * length,
        ),
        1 => (
            Mesh::tube(length, radius, d, quality),
            PI * (radius * radius - d * d) * length,
        ),
        2 => (
            Mesh::hourglass(length, radius, w, quality),
            PI * length * (w * w + 2.0 * w * d / 3.0 + d * d / 5.0),
        ),
        _ => (
            Mesh::stacked_discs(length, radius, w, discs, quality),
            PI * length * (w * w + w * d + 3.0 * d * d / 8.0),
        ),
    }
}

proptest! {
    #![proptest_config(config(150))]

    /// A third of them once ended in "tetrahedra are inverted or flat".
    #[test]
    fn every_body_within_the_limits_is_meshed(
        kind in 0..4usize,
        length in scales(1e-3, 10.0),
        // Of this radius over the length a waist of 1 % is the least that is no rod.
        radius in scales(2.1e-3, 1e3),
        share in scales(THINNEST, 0.999),
        discs in 2..12usize,
        quality in quality(),
    ) {
        let (mesh, volume) = body(kind, length, radius * length, share, discs, quality);
        let mesh = mesh.map_err(|e| TestCaseError::fail(e.to_string()))?;
        let found = mesh.volume_m3() / volume;
        prop_assert!((found - 1.0).abs() < 0.02, "{found} of the volume");
        prop_assert_eq!(mesh.length_m().to_bits(), length.to_bits());
    }

    /// What is not meshed is refused by the name of a parameter.
    #[test]
    fn bodies_beyond_the_limits_name_the_parameter(
        kind in 0..4usize,
        length in scales(1e-120, 1e120),
        radius in scales(1e-120, 1e120),
        share in scales(1e-12, 1e12),
        discs in 0..50usize,
    ) {
        let (mesh, _) = body(kind, length, radius, share, discs, Quality::Standard);
        if let Err(error) = mesh {
            let named = matches!(
                error,
                FemError::Parameter { name: "length_m" | "radius_m" | "inner_radius_m" | "waist_radius_m" | "disc_count", .. }
            );
            prop_assert!(named, "{error}");
        }
    }
}

#[test]
fn the_most_discs_with_the_thinnest_waist_are_meshed() {
    for quality in [Quality::Standard, Quality::Fine] {
        let (mesh, _) = body(3, 0.3, 0.03, THINNEST, 40, quality);
        mesh.unwrap();
    }
}

/// Irons' patch test: a surface moved linearly moves the interior linearly, exactly.
#[test]
fn each_kind_passes_the_patch_test() {
    let gradient = [[0.02, 0.05, -0.01], [0.0, -0.03, 0.04], [0.03, 0.01, 0.02]];
    let cases = [
        (0, 0.5),
        (1, 0.5),
        (1, 0.06),
        (2, 0.7),
        (2, 0.1),
        (3, 0.7),
        (3, 0.1),
    ];
    for (kind, share) in cases {
        let mesh = body(kind, 0.05, 0.03, share, 2, Quality::Standard)
            .0
            .unwrap();
        let nodes = mesh.nodes_m().to_vec();
        let moved: Vec<f64> = nodes
            .iter()
            .flat_map(|x| gradient.map(|row| (0..3).map(|k| row[k] * x[k]).sum::<f64>()))
            .collect();
        let mut constraints = vec![Constraint::Free; 3 * nodes.len()];
        for i in surface_nodes(&mesh) {
            constraints[3 * i..3 * i + 3].fill(Constraint::Prescribed);
        }
        assert!(
            constraints.contains(&Constraint::Free),
            "kind {kind} has no node inside"
        );
        let material = Box::new(NeoHookean::new(1e6, 0.45).unwrap());
        // The gradients of curved elements are cubic: the default rule of four points errs by 1e-3.
        let settings = Settings {
            rule: Rule::Degree5,
            ..Settings::default()
        };
        let fem = Fem::with_prescribed(mesh, material, settings, &constraints).unwrap();
        let result = fem.solve_prescribed(&moved, Watch::default()).unwrap();
        assert_eq!(result.status, Status::Solved);
        let found = &result.field.displacement;
        let worst = (found.iter().zip(&moved)).fold(0.0, |m: f64, (a, b)| m.max((a - b).abs()));
        assert!(worst < 1e-9 * 0.05, "kind {kind}, share {share}: {worst} m");
    }
}

/// K at rest of the standard mesh lies as near to that of the fine one as docs/fem.md states.
#[test]
fn the_standard_mesh_is_near_the_fine_one() {
    let stiffness = |kind, share, quality| {
        let mesh = body(kind, 0.1, 0.03, share, 3, quality).0.unwrap();
        let material = Box::new(NeoHookean::new(1e6, 0.49).unwrap());
        let fem = Fem::new(mesh, material, None).unwrap();
        fem.rest_stiffness(Watch::default()).unwrap()
    };
    let cases = [
        (0, 0.5, 0.01),
        (1, 0.2, 0.02),
        (2, 0.5, 0.02),
        (2, 0.2, 0.02),
        (3, 0.2, 0.03),
    ];
    for (kind, share, limit) in cases {
        let standard = stiffness(kind, share, Quality::Standard);
        let fine = stiffness(kind, share, Quality::Fine);
        for i in 0..6 {
            let ratio = standard[i][i] / fine[i][i] - 1.0;
            assert!(
                ratio.abs() < limit,
                "kind {kind}, share {share}, {i}: {ratio}"
            );
        }
    }
}
