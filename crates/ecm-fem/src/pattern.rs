//! Numbering of unknowns, sparsity of the tangent and where each element adds to it.

use crate::FemError;
use crate::factor::Symbolic;
use crate::mesh::Mesh;
use crate::ordering::{Graph, nested_dissection};
use crate::tendon::Segment;

/// Marks a degree of freedom that is not an unknown.
pub const NONE: u32 = u32::MAX;

/// Entries of the lower triangle of a 34 × 34 element matrix.
pub const ENTRIES: usize = 34 * 35 / 2;

/// Constraint on a displacement component of a node.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Constraint {
    /// It is an unknown.
    Free,
    /// Its displacement is given.
    Prescribed,
    /// It moves with the rigid platform.
    Platform,
}

/// Sparsity pattern, computed once per mesh and set of constraints.
#[derive(Debug)]
pub struct Pattern {
    /// Unknown of displacement component `3 node + i`, or [`NONE`].
    pub of_displacement: Vec<u32>,
    /// Unknown of the pressure at each node, [`NONE`] at mid-edge nodes.
    pub of_pressure: Vec<u32>,
    /// Number of unknowns.
    pub unknowns: usize,
    /// Number of pressures among them.
    pub pressures: usize,
    /// Element × entry: index into the values of the lower triangle, or [`NONE`].
    pub scatter: Vec<u32>,
    /// The same for the lower triangle of each tendon's segment, row by row: node, then component.
    pub scatter_segments: Vec<Vec<u32>>,
    /// Nodes on the platform.
    pub platform_nodes: Vec<usize>,
    /// Per element: does it touch the platform?
    pub touches_platform: Vec<bool>,
    /// Sparsity and analysis of the factorisation.
    pub symbolic: Symbolic,
}

/// Local numbers (row, column) of the lower triangle in the order of [`Pattern::scatter`]:
/// displacements `3 a + i` for a < 10, pressures 30 + m.
pub fn entries() -> impl Iterator<Item = (usize, usize)> {
    let uu = (0..10).flat_map(|a| {
        (0..3).flat_map(move |i| {
            (a..10).flat_map(move |b| {
                (0..3)
                    .filter(move |&k| b > a || k >= i)
                    .map(move |k| (3 * b + k, 3 * a + i))
            })
        })
    });
    let pu = (0..4).flat_map(|m| (0..30).map(move |d| (30 + m, d)));
    let pp = (0..4).flat_map(|m| (0..=m).map(move |n| (30 + m, 30 + n)));
    uu.chain(pu).chain(pp)
}

impl Pattern {
    /// A vector of the unknowns from values by displacement component; nothing at the pressures.
    pub fn of_unknowns(&self, value: impl Fn(usize) -> f64, into: &mut [f64]) {
        into.fill(0.0);
        for (component, &unknown) in self.of_displacement.iter().enumerate() {
            if unknown != NONE {
                into[unknown as usize] = value(component);
            }
        }
    }

    /// `constraints`: one entry per displacement component `3 node + i`; `with_pressure`: an unknown
    /// at every corner; `segments` of tendons connect nodes beside the elements.
    ///
    /// # Errors
    /// A factorisation too large for the memory.
    pub fn new(
        mesh: &Mesh,
        constraints: &[Constraint],
        with_pressure: bool,
        segments: &[Segment],
    ) -> Result<Self, FemError> {
        let nodes = mesh.nodes_m().len();
        let tets = mesh.tetrahedra();
        let mut is_corner = vec![false; nodes];
        let mixed = if with_pressure { tets } else { &[] };
        mixed
            .iter()
            .flat_map(|t| &t[..4])
            .for_each(|&i| is_corner[i] = true);
        let weight: Vec<usize> = (0..nodes)
            .map(|i| {
                (0..3)
                    .filter(|k| constraints[3 * i + k] == Constraint::Free)
                    .count()
                    + usize::from(is_corner[i])
            })
            .collect();
        let linked: Vec<Vec<usize>> = (segments.iter())
            .map(|s| s.nodes.iter().map(|(node, _)| *node).collect())
            .collect();
        let elements = tets.iter().map(|t| t.as_slice());
        let graph = Graph::new(nodes, elements.chain(linked.iter().map(Vec::as_slice)));
        let order = nested_dissection(mesh.nodes_m(), &weight, &graph);
        let mut of_displacement = vec![NONE; 3 * nodes];
        let mut of_pressure = vec![NONE; nodes];
        let (mut unknowns, mut pressures) = (0, 0);
        for node in order {
            for k in 0..3 {
                if constraints[3 * node + k] == Constraint::Free {
                    of_displacement[3 * node + k] = unknowns as u32;
                    unknowns += 1;
                }
            }
            if is_corner[node] {
                of_pressure[node] = unknowns as u32;
                unknowns += 1;
                pressures += 1;
            }
        }
        let local = |tet: &[usize; 10]| -> [u32; 34] {
            std::array::from_fn(|d| {
                if d < 30 {
                    of_displacement[3 * tet[d / 3] + d % 3]
                } else {
                    of_pressure[tet[d - 30]]
                }
            })
        };
        let of_segment = |linked: &[usize]| -> Vec<u32> {
            let components = linked
                .iter()
                .flat_map(|node| (0..3).map(move |k| 3 * node + k));
            components.map(|c| of_displacement[c]).collect()
        };
        let mut columns: Vec<Vec<u32>> = vec![Vec::new(); unknowns];
        let mut connect = |unknowns: &[u32]| {
            let mut g: Vec<u32> = (unknowns.iter().copied()).filter(|&d| d != NONE).collect();
            g.sort_unstable();
            for (j, &column) in g.iter().enumerate() {
                columns[column as usize].extend(&g[j..]);
            }
        };
        tets.iter().for_each(|tet| connect(&local(tet)));
        linked.iter().for_each(|nodes| connect(&of_segment(nodes)));
        let mut col_ptr = vec![0usize];
        let mut row_idx: Vec<usize> = Vec::new();
        for list in &mut columns {
            list.sort_unstable();
            list.dedup();
            row_idx.extend(list.iter().map(|&r| r as usize));
            col_ptr.push(row_idx.len());
        }
        drop(columns);
        if row_idx.len() >= NONE as usize {
            return Err(FemError::Factorisation {
                unknowns,
                reason: format!("{} entries cannot be numbered", row_idx.len()),
            });
        }
        let entry = |a: u32, b: u32| {
            let (r, c) = (a.max(b), a.min(b));
            if r == NONE {
                return NONE;
            }
            let (start, end) = (col_ptr[c as usize], col_ptr[c as usize + 1]);
            let at = row_idx[start..end].partition_point(|&x| x < r as usize);
            (start + at) as u32
        };
        let mut scatter = Vec::with_capacity(tets.len() * ENTRIES);
        for tet in tets {
            let g = local(tet);
            scatter.extend(entries().map(|(r, c)| entry(g[r], g[c])));
        }
        let scatter_segments = (linked.iter())
            .map(|nodes| {
                let g = of_segment(nodes);
                (0..g.len())
                    .flat_map(|r| (0..=r).map(move |c| (r, c)))
                    .map(|(r, c)| entry(g[r], g[c]))
                    .collect()
            })
            .collect();
        let platform_nodes: Vec<usize> = (0..nodes)
            .filter(|&i| (0..3).any(|k| constraints[3 * i + k] == Constraint::Platform))
            .collect();
        let touches_platform = tets
            .iter()
            .map(|t| t.iter().any(|n| platform_nodes.binary_search(n).is_ok()))
            .collect();
        let symbolic = Symbolic::new(unknowns, col_ptr, row_idx)?;
        Ok(Self {
            of_displacement,
            of_pressure,
            unknowns,
            pressures,
            scatter,
            scatter_segments,
            platform_nodes,
            touches_platform,
            symbolic,
        })
    }
}
