//! What can be wrong with a mesh.

use super::Mesh;
use crate::FemError;
use crate::element::{Rule, tet10};

impl Mesh {
    /// Indices in range, coordinates finite, every node used, faces apart.
    pub(super) fn check_indices(&self) -> Result<(), FemError> {
        let n = self.nodes_m.len();
        let outside = |what, index, node| FemError::NoSuchNode {
            what,
            index,
            node,
            nodes: n,
        };
        let mut used = vec![false; n];
        for (e, tet) in self.tetrahedra.iter().enumerate() {
            for &node in tet {
                *used
                    .get_mut(node)
                    .ok_or_else(|| outside("tetrahedron", e, node))? = true;
            }
        }
        for (what, list) in [
            ("base_nodes entry", &self.base_nodes),
            ("top_nodes entry", &self.top_nodes),
        ] {
            for (i, &node) in list.iter().enumerate() {
                if node >= n {
                    return Err(outside(what, i, node));
                }
            }
        }
        for (i, x) in self.nodes_m.iter().enumerate() {
            if let Some(&value) = x.iter().find(|v| !v.is_finite()) {
                return Err(FemError::NotFinite {
                    what: "a coordinate of node",
                    index: i,
                    value,
                });
            }
        }
        if let Some(node) = used.iter().position(|u| !u) {
            let count = used.iter().filter(|u| !**u).count();
            return Err(FemError::UnusedNode { node, count });
        }
        for (name, list) in [("base", &self.base_nodes), ("top", &self.top_nodes)] {
            if list.is_empty() && !self.has_no_faces() {
                return Err(FemError::MissingFace {
                    name,
                    found: "none with nodes".into(),
                });
            }
        }
        let mut top = vec![false; n];
        self.top_nodes.iter().for_each(|&i| top[i] = true);
        match self.base_nodes.iter().find(|&&i| top[i]) {
            Some(&node) => Err(FemError::SharedNode { node }),
            None => Ok(()),
        }
    }

    /// Elements right side out and in one piece; returns the volume.
    pub(super) fn check_shape(&self) -> Result<f64, FemError> {
        let rule = Rule::Degree5;
        let mut volume = 0.0;
        let mut first: Option<(usize, f64)> = None;
        let mut count = 0;
        for (e, tet) in self.tetrahedra.iter().enumerate() {
            let x = tet.map(|i| self.nodes_m[i]);
            let mut smallest = f64::INFINITY;
            for (lambda, weight) in rule.points() {
                let det = tet10::jacobian(&x, lambda).1;
                volume += weight * det;
                smallest = smallest.min(det);
            }
            for corner in 0..4 {
                let mut lambda = [0.0; 4];
                lambda[corner] = 1.0;
                smallest = smallest.min(tet10::jacobian(&x, &lambda).1);
            }
            // Flat by comparison with a regular tetrahedron of the same longest edge.
            let edge = super::EDGES
                .iter()
                .map(|[i, j]| (0..3).map(|k| (x[*i][k] - x[*j][k]).powi(2)).sum::<f64>())
                .fold(0.0, f64::max);
            if smallest <= 1e-9 * edge.powf(1.5) {
                count += 1;
                first = first.or(Some((e, smallest)));
            }
        }
        if let Some((element, jacobian)) = first {
            let total = self.tetrahedra.len();
            let centre = self.centre(element);
            return Err(FemError::InvertedElement {
                element,
                jacobian,
                centre,
                count,
                total,
            });
        }
        self.check_one_piece()?;
        Ok(volume)
    }

    fn check_one_piece(&self) -> Result<(), FemError> {
        let mut parent: Vec<usize> = (0..self.nodes_m.len()).collect();
        fn root(parent: &mut [usize], mut i: usize) -> usize {
            while parent[i] != i {
                parent[i] = parent[parent[i]];
                i = parent[i];
            }
            i
        }
        for tet in &self.tetrahedra {
            let a = root(&mut parent, tet[0]);
            for &node in &tet[1..] {
                let b = root(&mut parent, node);
                parent[b] = a;
            }
        }
        let pieces = (0..parent.len()).filter(|&i| parent[i] == i).count();
        if pieces == 1 {
            return Ok(());
        }
        let first = self
            .tetrahedra
            .first()
            .map_or(0, |t| root(&mut parent, t[0]));
        let element = self
            .tetrahedra
            .iter()
            .position(|t| root(&mut parent, t[0]) != first)
            .unwrap_or(0);
        Err(FemError::Disconnected {
            pieces,
            element,
            centre: self.centre(element),
        })
    }

    fn centre(&self, element: usize) -> [f64; 3] {
        self.tetrahedra.get(element).map_or([0.0; 3], |tet| {
            [0, 1, 2].map(|k| tet[..4].iter().map(|&i| self.nodes_m[i][k]).sum::<f64>() / 4.0)
        })
    }
}
