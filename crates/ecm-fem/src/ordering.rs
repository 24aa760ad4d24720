//! Fill-reducing order of the mesh nodes by geometric nested dissection.
//!
//! The body is cut across its axes where the layer of nodes that separates the
//! halves is thinnest; each half is ordered first, the separator last (George
//! 1973). All unknowns of a node stay together.

/// Number of nodes that are ordered without a further cut.
const LEAF: usize = 12;

/// Adjacency of nodes that share an element, without the node itself.
#[derive(Debug)]
pub struct Graph {
    starts: Vec<usize>,
    neighbours: Vec<u32>,
}

impl Graph {
    /// Graph of `n` nodes connected by the node lists of the elements.
    pub fn new<'a>(n: usize, elements: impl Iterator<Item = &'a [usize]>) -> Self {
        let mut lists: Vec<Vec<u32>> = vec![Vec::new(); n];
        for tet in elements {
            for &a in tet {
                lists[a].extend(tet.iter().filter(|&&b| b != a).map(|&b| b as u32));
            }
        }
        let mut starts = vec![0];
        let mut neighbours = Vec::new();
        for list in &mut lists {
            list.sort_unstable();
            list.dedup();
            neighbours.append(list);
            starts.push(neighbours.len());
        }
        Self { starts, neighbours }
    }

    fn of(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        self.neighbours[self.starts[node]..self.starts[node + 1]]
            .iter()
            .map(|&b| b as usize)
    }
}

/// Nodes with a positive `weight` (number of unknowns) in elimination order.
pub fn nested_dissection(positions: &[[f64; 3]], weight: &[usize], graph: &Graph) -> Vec<usize> {
    let nodes: Vec<usize> = (0..positions.len()).filter(|&i| weight[i] > 0).collect();
    let mut order = Vec::with_capacity(nodes.len());
    let mut side = vec![Side::Outside; positions.len()];
    dissect(nodes, positions, weight, graph, &mut side, &mut order);
    postordered(&order, graph)
}

/// The same elimination with every subtree contiguous, so that supernodes are complete.
fn postordered(order: &[usize], graph: &Graph) -> Vec<usize> {
    const ROOT: usize = usize::MAX;
    let n = order.len();
    let mut rank = vec![ROOT; graph.starts.len() - 1];
    order
        .iter()
        .enumerate()
        .for_each(|(i, &node)| rank[node] = i);
    // Elimination tree with path compression (Liu 1986).
    let (mut parent, mut ancestor) = (vec![ROOT; n], vec![ROOT; n]);
    for (i, &node) in order.iter().enumerate() {
        for neighbour in graph.of(node) {
            let mut j = rank[neighbour];
            while j < i {
                let next = std::mem::replace(&mut ancestor[j], i);
                if next == ROOT {
                    parent[j] = i;
                    break;
                }
                j = next;
            }
        }
    }
    let mut children: Vec<Vec<usize>> = vec![Vec::new(); n];
    let mut stack: Vec<(usize, bool)> = Vec::new();
    for i in (0..n).rev() {
        if parent[i] == ROOT {
            stack.push((i, false));
        } else {
            children[parent[i]].push(i);
        }
    }
    stack.reverse();
    let mut sorted = Vec::with_capacity(n);
    while let Some((i, open)) = stack.pop() {
        if open {
            sorted.push(order[i]);
        } else {
            stack.push((i, true));
            stack.extend(children[i].iter().map(|&c| (c, false)));
        }
    }
    sorted
}

#[derive(Clone, Copy, PartialEq)]
enum Side {
    Outside,
    Left,
    Right,
    Between,
}

struct Cut {
    left: Vec<usize>,
    right: Vec<usize>,
    between: Vec<usize>,
    cost: f64,
}

fn dissect(
    nodes: Vec<usize>,
    positions: &[[f64; 3]],
    weight: &[usize],
    graph: &Graph,
    side: &mut [Side],
    order: &mut Vec<usize>,
) {
    if nodes.len() <= LEAF {
        order.extend(nodes);
        return;
    }
    let mut best: Option<Cut> = None;
    for axis in 0..3 {
        let mut sorted = nodes.clone();
        sorted.sort_by(|&a, &b| {
            positions[a][axis]
                .total_cmp(&positions[b][axis])
                .then(a.cmp(&b))
        });
        let mut last = usize::MAX;
        for step in 0..=12 {
            // Cuts between 30 % and 70 %, moved to the next gap in the coordinate.
            let mut m = sorted.len() * (30 + 40 * step / 12) / 100;
            let gap = 1e-9 + 1e-6 * positions[sorted[sorted.len() - 1]][axis].abs();
            while m < sorted.len()
                && m > 0
                && positions[sorted[m]][axis] - positions[sorted[m - 1]][axis] < gap
            {
                m += 1;
            }
            if m == last || m == 0 || m == sorted.len() {
                continue;
            }
            last = m;
            for take_left in [true, false] {
                let cut = separate(&sorted, m, take_left, weight, graph, side);
                if best.as_ref().is_none_or(|b| cut.cost < b.cost) {
                    best = Some(cut);
                }
            }
        }
    }
    match best {
        Some(cut) if !cut.left.is_empty() && !cut.right.is_empty() => {
            dissect(cut.left, positions, weight, graph, side, order);
            dissect(cut.right, positions, weight, graph, side, order);
            order.extend(cut.between);
        }
        _ => order.extend(nodes),
    }
}

/// Separator: the nodes of one half that touch the other.
fn separate(
    sorted: &[usize],
    m: usize,
    take_left: bool,
    weight: &[usize],
    graph: &Graph,
    side: &mut [Side],
) -> Cut {
    let (own, other) = if take_left {
        (Side::Left, Side::Right)
    } else {
        (Side::Right, Side::Left)
    };
    for (i, &node) in sorted.iter().enumerate() {
        side[node] = if i < m { Side::Left } else { Side::Right };
    }
    for &node in sorted {
        if side[node] == own && graph.of(node).any(|b| side[b] == other) {
            side[node] = Side::Between;
        }
    }
    let mut cut = Cut {
        left: Vec::new(),
        right: Vec::new(),
        between: Vec::new(),
        cost: 0.0,
    };
    for &node in sorted {
        match side[node] {
            Side::Left => cut.left.push(node),
            Side::Right => cut.right.push(node),
            _ => cut.between.push(node),
        }
        side[node] = Side::Outside;
    }
    let sum = |list: &[usize]| list.iter().map(|&i| weight[i] as f64).sum::<f64>();
    let (l, r, b) = (sum(&cut.left), sum(&cut.right), sum(&cut.between));
    // Work grows with the cube of the separator; an uneven cut costs work in the larger half.
    cut.cost = b * (1.0 + ((l - r) / (l + r + 1.0)).powi(2));
    cut
}
