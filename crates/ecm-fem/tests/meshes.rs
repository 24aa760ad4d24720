//! Gmsh files, and what each kind of broken input is answered with.
#![allow(clippy::unwrap_used, missing_docs)]

use ecm_fem::{Fem, FemError, Laid, Load, Mesh, NeoHookean, Quality, Watch};
use std::fmt::Write;

const COARSE: Quality = Quality::custom([1, 3, 6], [1000, 1000]);

fn cylinder() -> Mesh {
    Mesh::cylinder(0.1, 0.03, COARSE).unwrap()
}

/// The mesh as a Gmsh 4.1 file, linear or quadratic.
fn gmsh(mesh: &Mesh, quadratic: bool) -> String {
    let corner_used = |i: usize| mesh.tetrahedra().iter().any(|t| t[..4].contains(&i));
    let kept: Vec<usize> = (0..mesh.nodes_m().len())
        .filter(|&i| quadratic || corner_used(i))
        .collect();
    let mut named = vec![("base", mesh.base_nodes()), ("top", mesh.top_nodes())];
    let chambers = mesh.chambers().iter();
    named.extend(chambers.map(|(name, nodes)| (name.as_str(), nodes.as_slice())));
    let count = named.len();
    let mut text = String::from("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$PhysicalNames\n");
    writeln!(text, "{}", count + 2).unwrap();
    for (k, (name, _)) in named.iter().enumerate() {
        writeln!(text, "2 {} \"{name}\"", k + 1).unwrap();
    }
    writeln!(
        text,
        "3 1 \"soft body\"\n3 2 \"sleeve\"\n$EndPhysicalNames\n$Entities\n0 0 {count} 2"
    )
    .unwrap();
    for k in 1..=count {
        writeln!(text, "{k} 0 0 0 0 0 0 1 {k} 0").unwrap();
    }
    text.push_str("1 0 0 0 0 0 0 1 1 0\n2 0 0 0 0 0 0 1 2 0\n$EndEntities\n");
    let n = kept.len();
    writeln!(text, "$Nodes\n1 {n} 1 {n}\n3 1 0 {n}").unwrap();
    kept.iter()
        .for_each(|i| writeln!(text, "{}", i + 1).unwrap());
    for &i in &kept {
        let x = mesh.nodes_m()[i];
        writeln!(text, "{} {} {}", x[0], x[1], x[2]).unwrap();
    }
    text.push_str("$EndNodes\n");
    let faces = [
        [0, 2, 1, 6, 5, 4],
        [0, 1, 3, 4, 8, 7],
        [1, 2, 3, 5, 9, 8],
        [0, 3, 2, 7, 9, 6],
    ];
    let mut blocks = Vec::new();
    for (entity, (_, named)) in (1..).zip(&named) {
        let mut lines = Vec::new();
        for t in mesh.tetrahedra() {
            for f in faces {
                if f.iter().all(|&i| named.contains(&t[i])) {
                    lines.push(
                        f[..if quadratic { 6 } else { 3 }]
                            .iter()
                            .map(|&i| t[i])
                            .collect(),
                    );
                }
            }
        }
        blocks.push((2, entity, if quadratic { 9 } else { 2 }, lines));
    }
    let order: &[usize] = if quadratic {
        &[0, 1, 2, 3, 4, 5, 6, 7, 9, 8]
    } else {
        &[0, 1, 2, 3]
    };
    let mut tets: Vec<Vec<usize>> = mesh
        .tetrahedra()
        .iter()
        .map(|t| order.iter().map(|&i| t[i]).collect())
        .collect();
    // The first half is one region, the second another.
    let sleeve = tets.split_off(tets.len() / 2);
    let kind = if quadratic { 11 } else { 4 };
    blocks.extend([(3, 1, kind, tets), (3, 2, kind, sleeve)]);
    writeln!(text, "$Elements\n{} 0 0 0", blocks.len()).unwrap();
    for (dimension, entity, kind, lines) in blocks {
        writeln!(text, "{dimension} {entity} {kind} {}", lines.len()).unwrap();
        for (e, line) in lines.iter().enumerate() {
            let tags: Vec<String> = line.iter().map(|i| (i + 1).to_string()).collect();
            writeln!(text, "{} {}", e + 1, tags.join(" ")).unwrap();
        }
    }
    text + "$EndElements\n"
}

fn parse(text: &str) -> Result<Mesh, FemError> {
    let path = std::env::temp_dir().join(format!("ecm-fem-{:?}.msh", std::thread::current().id()));
    std::fs::write(&path, text).unwrap();
    let mesh = Mesh::read(&path);
    std::fs::remove_file(&path).unwrap();
    mesh
}

#[test]
fn quadratic_gmsh_file_gives_the_mesh_back() {
    let mesh = cylinder();
    let read = parse(&gmsh(&mesh, true)).unwrap();
    assert_eq!(read.tetrahedra(), mesh.tetrahedra());
    assert_eq!(read.top_nodes(), mesh.top_nodes());
    assert!((read.length_m() - 0.1).abs() < 1e-12);
    assert!((read.volume_m3() / mesh.volume_m3() - 1.0).abs() < 1e-9);
}

/// Triangles in a block of a volume were once taken for tetrahedra.
#[test]
fn a_volume_block_of_triangles_is_refused() {
    let good = gmsh(&cylinder(), false);
    for (kind, nodes) in [(2, "1 2 3"), (9, "1 2 3 4 5 6"), (15, "1"), (1, "1 2")] {
        let block = format!("3 1 {kind} 1\n1 {nodes}\n$EndElements");
        let text = good.replace("$Elements\n4 0", "$Elements\n5 0");
        assert_ne!(text, good);
        let error = parse(&text.replace("$EndElements", &block)).unwrap_err();
        let message = error.to_string();
        assert!(
            message.contains(&format!("element type {kind} in a volume")),
            "{message}"
        );
    }
}

#[test]
fn linear_gmsh_file_is_raised_to_quadratic() {
    let mesh = cylinder();
    let read = parse(&gmsh(&mesh, false)).unwrap();
    assert_eq!(read.nodes_m().len(), mesh.nodes_m().len());
    assert_eq!(read.base_nodes().len(), mesh.base_nodes().len());
    // Straight edges cut off the rim.
    assert!(read.volume_m3() < mesh.volume_m3());
    let fem = Fem::new(read, Box::new(NeoHookean::new(1e6, 0.45).unwrap()), None).unwrap();
    assert!(fem.rest_stiffness(Watch::default()).unwrap()[0][0] > 0.0);
}

#[test]
fn broken_files_name_line_and_remedy() {
    let good = gmsh(&cylinder(), true);
    let cases = [
        (String::new(), "no tetrahedra"),
        ("garbage".into(), "expected a section"),
        (good.replace("4.1 0 8", "2.2 0 8"), "format version 2.2"),
        (good.replace("4.1 0 8", "4.1 1 8"), "binary"),
        (
            good.replace("\"top\"", "\"lid\""),
            "no face named `top` (named groups: base, lid)",
        ),
        (good.replace("\"base\"", "\"foot\""), "no face named `base`"),
        (good[..good.len() / 2].into(), "the end of the file"),
        (good.replacen("0.03", "zero", 1), "\"zero\""),
        (good.replacen("0.03", "nan", 1), "is NaN"),
        (good.replace("$EndEntities", "$Nonsense"), "\"$Nonsense\""),
        (good.replace("3 1 11", "3 1 5"), "element type 5"),
        (good.replacen("$PhysicalNames", "$MeshFormat", 1), "found"),
        (good.replacen("3 1 0 ", "3 1 1 ", 1), "parametric"),
    ];
    for (text, expected) in cases {
        let message = parse(&text).unwrap_err().to_string();
        assert!(message.contains(expected), "{message} lacks {expected}");
    }
    let missing = Mesh::read(std::path::Path::new("no/such/file.msh")).unwrap_err();
    assert!(missing.to_string().contains("no/such/file.msh"));
}

#[test]
fn chambers_and_regions_of_a_file_are_those_of_the_mesh() {
    let body = ecm_fem::Chambered {
        length_m: 0.1,
        radius_m: 0.02,
        channel_radius_m: 0.004,
        chambers: 3,
        shape: ecm_fem::ChamberShape::Sector {
            inner_radius_m: 0.008,
            outer_radius_m: 0.0165,
            angle_rad: 1.5,
        },
        end_wall_m: 0.008,
    };
    let mesh = Mesh::chambered(&body, COARSE).unwrap();
    let volumes = |mesh: &Mesh| {
        let material = Box::new(ecm_fem::NeoHookean::new(1e6, 0.49).unwrap());
        let fem = ecm_fem::Fem::new(mesh.clone(), material, None).unwrap();
        assert_eq!(fem.actuators(), ["chamber_1", "chamber_2", "chamber_3"]);
        fem.chamber_volumes_m3().to_vec()
    };
    // A linear file has straight edges.
    for (quadratic, most) in [(true, 1e-12), (false, 0.1)] {
        let read = parse(&gmsh(&mesh, quadratic)).unwrap();
        let all = mesh.tetrahedra().len();
        let sleeve: Vec<usize> = (all / 2..all).collect();
        assert_eq!(read.region("sleeve"), Some(sleeve));
        assert_eq!(read.region("body").map(|list| list.len()), Some(all));
        assert_eq!(read.region("base"), None);
        for (found, given) in volumes(&read).iter().zip(volumes(&mesh)) {
            assert!((found / given - 1.0).abs() < most, "{found} {given}");
        }
        // Threads through both regions are threads through the body, those of one are not.
        let wound = |on: &[&str]| {
            let laid = Laid::InRegion { stiffness_Pa: 1e6 };
            on.iter().try_fold(read.clone(), |mesh, on| {
                mesh.with_winding(on, [0.3, 0.9], laid)
            })
        };
        let [both, all, one] = [&["soft body", "sleeve"][..], &["body"], &["sleeve"]].map(|on| {
            let material = Box::new(NeoHookean::new(1e6, 0.49).unwrap());
            let fem = Fem::new(wound(on).unwrap(), material, None).unwrap();
            fem.rest_stiffness(Watch::default()).unwrap()[3][3]
        });
        assert!(
            (both / all - 1.0).abs() < 1e-9 && one < 0.98 * all,
            "{both} {all} {one}"
        );
        let names = wound(&["collar"]).unwrap_err().to_string();
        assert!(
            names.contains("no such region; it has sleeve, soft body, body"),
            "{names}"
        );
    }
}

type Parts = (Vec<[f64; 3]>, Vec<[usize; 10]>, Vec<usize>, Vec<usize>);

fn broken(change: impl Fn(&mut Parts)) -> FemError {
    let mesh = cylinder();
    let mut parts = (
        mesh.nodes_m().to_vec(),
        mesh.tetrahedra().to_vec(),
        mesh.base_nodes().to_vec(),
        mesh.top_nodes().to_vec(),
    );
    change(&mut parts);
    Mesh::new(parts.0, parts.1, parts.2, parts.3).unwrap_err()
}

#[test]
fn broken_meshes_are_told_apart() {
    let inside_out = broken(|m| m.1.iter_mut().for_each(|t| t.swap(0, 1)));
    assert!(
        matches!(inside_out, FemError::InvertedElement { element: 0, count, total, .. } if count == total)
    );
    let one = broken(|m| m.1[7].swap(2, 3));
    assert!(matches!(
        one,
        FemError::InvertedElement {
            element: 7,
            count: 1,
            ..
        }
    ));
    assert!(one.to_string().contains("the first is 7"));
    let mirrored = broken(|m| m.0.iter_mut().for_each(|x| x[1] = -x[1]));
    assert!(matches!(mirrored, FemError::InvertedElement { .. }));
    let flat = broken(|m| m.0.iter_mut().for_each(|x| x[1] = 0.0));
    assert!(matches!(flat, FemError::InvertedElement { .. }));
    let nan = broken(|m| m.0[3][1] = f64::NAN);
    assert!(matches!(nan, FemError::NotFinite { index: 3, .. }));
    let infinite = broken(|m| m.0[4][0] = f64::INFINITY);
    assert!(infinite.to_string().contains("node 4 is inf"));
    let unused = broken(|m| m.0.push([0.0; 3]));
    assert!(matches!(unused, FemError::UnusedNode { count: 1, .. }));
    let outside = broken(|m| m.1[2][9] = 100_000);
    assert!(matches!(
        outside,
        FemError::NoSuchNode {
            what: "tetrahedron",
            index: 2,
            ..
        }
    ));
    let no_base = broken(|m| m.2.clear());
    assert!(matches!(
        no_base,
        FemError::MissingFace { name: "base", .. }
    ));
    let no_top = broken(|m| m.3.clear());
    assert!(matches!(no_top, FemError::MissingFace { name: "top", .. }));
    let wrong_top = broken(|m| m.3[0] = 100_000);
    assert!(matches!(
        wrong_top,
        FemError::NoSuchNode {
            what: "top_nodes entry",
            ..
        }
    ));
    let shared = broken(|m| m.3.push(m.2[0]));
    assert!(matches!(shared, FemError::SharedNode { .. }));
    let point = broken(|m| m.3.truncate(1));
    assert!(matches!(
        point,
        FemError::NotASurface {
            name: "top",
            nodes: 1
        }
    ));
    let upside_down = broken(|m| std::mem::swap(&mut m.2, &mut m.3));
    assert!(matches!(upside_down, FemError::WrongAxis { .. }));
    let along_z = broken(|m| m.0.iter_mut().for_each(|x| *x = [x[1], x[2], x[0]]));
    assert!(along_z.to_string().contains("expected (L, 0, 0)"));
    let two = broken(|m| {
        let (n, count) = (m.0.len(), m.1.len());
        for i in 0..n {
            let x = m.0[i];
            m.0.push([x[0], x[1] + 1.0, x[2]]);
        }
        for e in 0..count {
            let t = m.1[e].map(|i| i + n);
            m.1.push(t);
        }
    });
    assert!(matches!(two, FemError::Disconnected { pieces: 2, .. }));
    let empty = Mesh::new(Vec::new(), Vec::new(), Vec::new(), Vec::new()).unwrap_err();
    assert!(matches!(empty, FemError::MissingFace { .. }));
}

#[test]
fn broken_materials_and_loads_are_named() {
    for (e, nu, name) in [
        (0.0, 0.4, "young_modulus_Pa"),
        (-1.0, 0.4, "young_modulus_Pa"),
        (f64::NAN, 0.4, "young_modulus_Pa"),
        (1e6, 0.51, "poisson_ratio"),
        (1e6, -0.1, "poisson_ratio"),
        (1e6, f64::NAN, "poisson_ratio"),
    ] {
        assert!(
            NeoHookean::new(e, nu)
                .unwrap_err()
                .to_string()
                .starts_with(name)
        );
    }
    let material = || Box::new(NeoHookean::new(1e6, 0.45).unwrap());
    let short = Fem::new(cylinder(), material(), Some(vec![1.0])).unwrap_err();
    assert!(short.to_string().contains("one per tetrahedron"));
    let count = cylinder().tetrahedra().len();
    let negative = Fem::new(cylinder(), material(), Some(vec![-1.0; count])).unwrap_err();
    assert!(negative.to_string().contains("positive factor"));
    let fem = Fem::new(cylinder(), material(), None).unwrap();
    let loads = [
        Load::Wrench([0.0; 6]),
        Load::Wrench([0.0, f64::NAN, 0.0, 0.0, 0.0, 0.0]),
    ];
    let load = fem.solve_all(&loads, Watch::default()).unwrap_err();
    assert_eq!(
        load.to_string(),
        "a component of wrench 1 is NaN; expected a finite number"
    );
    assert!(fem.solve_pose(&[0.1, 0.0, 0.0, 4.0, 0.0, 0.0]).is_err());
}
