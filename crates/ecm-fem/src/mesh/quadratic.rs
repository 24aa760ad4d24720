//! From four-node to ten-node tetrahedra.

use super::EDGES;
use std::collections::HashMap;

/// Adds one node per edge, placed by `middle(a, b)`, the two corner nodes of the
/// edge; numbering follows first occurrence, so it is the same on every run.
pub fn raise(
    nodes: &mut Vec<[f64; 3]>,
    corners: &[[usize; 4]],
    mut middle: impl FnMut(usize, usize, &[[f64; 3]]) -> [f64; 3],
) -> Vec<[usize; 10]> {
    let mut edge_node: HashMap<(usize, usize), usize> = HashMap::new();
    corners
        .iter()
        .map(|c| {
            let mut tet = [c[0], c[1], c[2], c[3], 0, 0, 0, 0, 0, 0];
            for (e, [i, j]) in EDGES.iter().enumerate() {
                let (a, b) = (c[*i].min(c[*j]), c[*i].max(c[*j]));
                tet[4 + e] = *edge_node.entry((a, b)).or_insert_with(|| {
                    let x = middle(a, b, nodes);
                    nodes.push(x);
                    nodes.len() - 1
                });
            }
            tet
        })
        .collect()
}

/// The mid-edge nodes that lie between two marked corners on a marked surface:
/// for each element face whose three corners are all in `marked` (sorted).
pub fn mid_nodes_of_faces(tets: &[[usize; 10]], marked: &[usize]) -> Vec<usize> {
    let mut found = Vec::new();
    for tet in tets {
        for face in &super::FACES {
            if face[..3]
                .iter()
                .all(|&i| marked.binary_search(&tet[i]).is_ok())
            {
                found.extend(face[3..].iter().map(|&i| tet[i]));
            }
        }
    }
    found.sort_unstable();
    found.dedup();
    found
}
