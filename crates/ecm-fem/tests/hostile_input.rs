//! Hostile meshes, materials, files and rods: an error, never a panic nor an endless loop.
#![allow(clippy::unwrap_used, missing_docs)]

mod common;

use common::{config, fem, hostile, mesh, neo, six};
use ecm_fem::element::tet10;
use ecm_fem::material::{MODELS, Volume, choose, nominal_stress};
use ecm_fem::output::vtu;
use ecm_fem::tensor::symmetric_eigenvalues;
use ecm_fem::{
    Fem, FemError, Fibre, Gent, Material, Mesh, MooneyRivlin, NeoHookean, Ogden, Ordering, Quality,
    Rod, Watch, Yeoh,
};
use proptest::prelude::*;
use std::collections::BTreeMap;

/// A Gmsh file of a prism of three tetrahedra between the faces `base` and `top`.
const FILE: &str = "$MeshFormat 4.1 0 8 $EndMeshFormat $PhysicalNames 2 2 1 \"base\" 2 2 \"top\" \
    $EndPhysicalNames $Entities 0 0 2 1 1 0 0 0 0 0 0 1 1 0 2 0 0 0 0 0 0 1 2 0 1 0 0 0 0 0 0 0 0 \
    $EndEntities $Nodes 1 6 1 6 3 1 0 6 1 2 3 4 5 6 0 0 0 0 1 0 0 0 1 1 0 0 1 1 0 1 0 1 $EndNodes \
    $Elements 3 5 1 5 2 1 2 1 1 1 2 3 2 2 2 1 2 4 5 6 3 1 4 3 3 1 2 3 6 4 1 2 6 5 5 1 5 6 4 \
    $EndElements";

fn materials(c: f64) -> Vec<Box<dyn Material>> {
    let mut all: Vec<Box<dyn Material>> = vec![neo()];
    all.extend(NeoHookean::new(c, 0.4).map(|m| Box::new(m) as _));
    all.extend(NeoHookean::new(1e6, c).map(|m| Box::new(m) as _));
    all.extend(MooneyRivlin::new(c, 1e5, 1e7).map(|m| Box::new(m) as _));
    all.extend(Yeoh::new([1e5, c, 0.0], 1e7).map(|m| Box::new(m) as _));
    all.extend(Gent::new(1e5, c, 1e7).map(|m| Box::new(m) as _));
    all.extend(Ogden::new(vec![(1e5, 2.0), (1e4, c)], 1e7).map(|m| Box::new(m) as _));
    all.extend(Ogden::new(vec![(c, 2.0), (c, 3.0)], c).map(|m| Box::new(m) as _));
    all.extend(Fibre::new(neo(), [c, 1.0, 0.0], 1e4, 1.0).map(|m| Box::new(m) as _));
    all.extend(Fibre::new(neo(), [1.0, 1.0, 0.0], 1e4, c).map(|m| Box::new(m) as _));
    all
}

proptest! {
    #![proptest_config(config(200))]

    #[test]
    fn materials_respond(
        f in prop::array::uniform3(prop::array::uniform3(hostile())),
        jacobian in hostile(),
        c in hostile(),
    ) {
        for material in materials(c) {
            let _ = material.respond(&f, jacobian);
        }
    }

    #[test]
    fn parameters_of_any_kind_are_chosen_or_refused(
        model in 0..MODELS.len(),
        keys in prop::collection::vec((0..12usize, prop::collection::vec(hostile(), 0..4)), 0..6),
    ) {
        let (name, own) = (MODELS[model].name, MODELS[model].parameters);
        let common = ["bulk_modulus_Pa", "poisson_ratio", "fibre_direction", "fibre_k1_Pa", "fibre_k2", "x"];
        let known: Vec<&str> = own.iter().chain(&common).copied().collect();
        let parameters: BTreeMap<String, Vec<f64>> = keys.into_iter()
            .map(|(k, values)| (known[k % known.len()].to_string(), values))
            .collect();
        if let Ok(material) = choose(name, &parameters) {
            prop_assert!(material.shear_modulus_Pa() > 0.0 && material.bulk_modulus_Pa() > 0.0);
        }
    }

    #[test]
    fn solids_are_meshes_or_errors(
        size in prop::array::uniform3(prop_oneof![hostile(), 1e-3..1.0]),
        counts in prop::array::uniform3(prop_oneof![0..5usize, Just(usize::MAX)]),
        gradings in prop::array::uniform2(prop_oneof![0..2000u32, Just(u32::MAX)]),
        kind in 0..4,
    ) {
        let quality = Quality::Custom {
            rings: counts[0],
            layers: counts[1],
            around: counts[2],
            layer_grading_per_mille: gradings[0],
            ring_grading_per_mille: gradings[1],
        };
        let [length, radius, other] = size;
        let mesh = match kind {
            0 => Mesh::cylinder(length, radius, quality),
            1 => Mesh::tube(length, radius, other, quality),
            2 => Mesh::hourglass(length, radius, other, quality),
            _ => Mesh::stacked_discs(length, radius, other, counts[0], quality),
        };
        if let Ok(mesh) = mesh {
            prop_assert!(mesh.volume_m3().is_finite() && mesh.volume_m3() > 0.0);
        }
    }

    #[test]
    fn sizes_of_a_mesh_are_words_or_errors(word in "[0-9xa-z ]{0,12}") {
        if let Ok(quality) = word.parse::<Quality>()
            && quality != Quality::Standard && quality != Quality::Fine {
            prop_assert_eq!(word.split('x').count(), 3);
        }
    }

    #[test]
    fn arrays_are_meshes_or_errors(x in hostile(), node in any::<usize>(), at in 0..40usize) {
        let good = mesh();
        let (base, top) = (good.base_nodes().to_vec(), good.top_nodes().to_vec());
        let (mut nodes, mut tets) = (good.nodes_m().to_vec(), good.tetrahedra().to_vec());
        nodes[at][at % 3] = x;
        if let Ok(mesh) = Mesh::new(nodes.clone(), tets.clone(), base.clone(), top.clone()) {
            prop_assert!(mesh.length_m() > 0.0 && mesh.length_m().is_finite());
            if let Ok(fem) = Fem::new(mesh, neo(), Some(vec![1.0; tets.len()])) {
                let _ = fem.solve_wrench(&[1.0, 0.0, 0.0, 0.0, 0.0, 0.1]);
            }
        }
        let elements = tets.len();
        tets[at % elements][at % 10] = node;
        let unknown = Mesh::new(good.nodes_m().to_vec(), tets, base.clone(), top.clone());
        prop_assert!(unknown.is_err());
        let good_tets = good.tetrahedra().to_vec();
        prop_assert!(Mesh::new(good.nodes_m().to_vec(), good_tets.clone(), vec![node], top).is_err());
        prop_assert!(Mesh::new(nodes.clone(), Vec::new(), base, Vec::new()).is_err());
        let corners = [[0, 1, 2, node]];
        let count = nodes.len();
        prop_assert_eq!(Mesh::with_mid_nodes(&mut nodes, &corners).is_ok(), node < count);
        let free = Mesh::without_faces(good.nodes_m().to_vec(), good_tets, x);
        prop_assert_eq!(free.is_ok(), x.is_finite() && x > 0.0);
        if let Ok(fem) = free.and_then(|mesh| Fem::new(mesh, neo(), None)) {
            let _ = (fem.rest_stiffness(Watch::default()), fem.sizes());
            let _ = fem.ordering_cost(Ordering::MinimumDegree);
        }
    }

    #[test]
    fn moduli_are_positive_or_refused(scale in hostile(), material in 0..10usize, c in hostile()) {
        let material = materials(c).into_iter().nth(material).unwrap_or_else(neo);
        let elements = mesh().tetrahedra().len();
        if let Ok(fem) = Fem::new(mesh(), material, Some(vec![scale; elements])) {
            prop_assert!(scale > 0.0);
            let _ = fem.rest_stiffness(Watch::default());
        }
    }

    #[test]
    fn rods_end(stiffness in prop::array::uniform5(hostile()), wrench in six()) {
        let [length_m, axial, shear, bending, torsion] = stiffness;
        let rod = Rod {
            length_m,
            axial_stiffness_N: axial,
            shear_stiffness_N: shear,
            bending_stiffness_Nm2: bending,
            torsion_stiffness_Nm2: torsion,
        };
        let (pose, converged) = rod.pose(&wrench);
        prop_assert!(!converged || pose.iter().all(|v| v.is_finite()), "{pose:?}");
        prop_assert_eq!(rod.checked().is_ok(), stiffness.iter().all(|v| v.is_finite() && *v > 0.0));
    }

    /// What takes no settings of its own: element, tensors, loads, test stresses, parameters of a
    /// fit, wrenches of a rod, pictures of a field.
    #[test]
    fn numbers_of_any_kind_end(
        x in hostile(),
        more in prop::array::uniform5(hostile()),
        loads in six(),
        terms: usize,
        material in 0..10usize,
    ) {
        let [a, b, c, d, e] = more;
        let _ = symmetric_eigenvalues(&[[x, a, b], [a, c, d], [b, d, e]]);
        let body = fem();
        let mut nodes = body.mesh().tetrahedra()[0].map(|i| body.mesh().nodes_m()[i]);
        nodes[terms % 10][terms % 3] = x;
        let _ = (tet10::gradients(&nodes, &[a, b, c, d]), tet10::shape(&[x, a, b, c]));
        let volume = body.body().volume_load(|_| [x, a, b]);
        prop_assert_eq!(volume.len(), body.body().surface_load(|p| p[0] > x, [a, b, c]).len());
        let mut field = body.body().rest();
        let node = terms % field.displacement.len();
        field.displacement[node] = x;
        prop_assert!(vtu(body.body(), &field).is_ok());
        let law = materials(c).into_iter().nth(material).unwrap_or_else(neo);
        for test in ["uniaxial", "equibiaxial", "pure_shear", "torsion"] {
            let _ = nominal_stress(law.as_ref(), test, &more);
        }
        for model in MODELS {
            let start = model.start(x, terms);
            prop_assert_eq!(start.is_ok(), (1..=4).contains(&terms));
            let _ = (model.start(x, 1 + terms % 4), model.decode(&more[..terms % 6]));
        }
        let _ = Volume::PoissonRatio(x).bulk_modulus_Pa(a);
        let rod = Rod {
            length_m: a,
            axial_stiffness_N: b,
            shear_stiffness_N: c,
            bending_stiffness_Nm2: d,
            torsion_stiffness_Nm2: e,
        };
        let start = loads.map(|v| v * x);
        if let Some((wrench, _)) = rod.wrench(&loads, &start) {
            prop_assert!(wrench.iter().all(|v| v.is_finite()), "{wrench:?}");
        }
    }

    #[test]
    fn damaged_files_are_meshes_or_errors(
        changes in prop::collection::vec((0..150usize, prop_oneof![
            Just(String::new()),
            Just("18446744073709551615".to_string()),
            Just("-1".to_string()),
            Just("\"".to_string()),
            hostile().prop_map(|v| format!("{v:e}")),
            (0..30u8).prop_map(|v| v.to_string()),
            "\\PC{0,6}",
        ]), 0..3),
        cut in 0..200usize,
    ) {
        let mut words: Vec<String> = FILE.split_whitespace().map(Into::into).collect();
        let whole = changes.is_empty() && cut >= words.len();
        for (at, word) in &changes {
            let count = words.len();
            words[at % count].clone_from(word);
        }
        words.truncate(cut);
        let path = std::env::temp_dir().join(format!("ecm-fem-{}.msh", std::process::id()));
        std::fs::write(&path, words.join("\n")).unwrap();
        match Mesh::read(&path) {
            Ok(mesh) => prop_assert!(mesh.volume_m3() > 0.0),
            Err(error) => prop_assert!(!whole, "{error}"),
        }
        std::fs::remove_file(&path).unwrap();
    }
}

#[test]
fn too_many_cells_are_refused_before_they_are_made() {
    let word = "200x200x200".parse::<Quality>().unwrap();
    let error = Mesh::cylinder(0.1, 0.03, word).unwrap_err();
    assert!(matches!(error, FemError::Parameter { .. }), "{error}");
    assert!(error.to_string().contains("prisms"), "{error}");
}
