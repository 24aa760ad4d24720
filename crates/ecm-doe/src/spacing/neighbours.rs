//! Neighbour lists: for every candidate its near neighbours, nearest first.

use rayon::prelude::*;

use crate::Control;

/// Squared Euclidean distance.
pub(crate) fn squared(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// Points and, for each, the others nearer than `reach`, sorted by distance.
#[derive(Debug)]
pub(crate) struct Neighbours<'a> {
    pub points: &'a [f64],
    pub columns: usize,
    /// Squared distance up to which the lists are complete.
    pub reach: f64,
    starts: Vec<usize>,
    ids: Vec<u32>,
    distances: Vec<f64>,
}

impl<'a> Neighbours<'a> {
    /// Lists of all pairs with squared distance below `reach`; empty ones once cancelled.
    pub fn new(points: &'a [f64], columns: usize, reach: f64, control: &Control<'_>) -> Self {
        let count = points.len() / columns;
        let lists: Vec<Vec<(f64, u32)>> = (0..count)
            .into_par_iter()
            .map(|i| {
                if control.cancelled() {
                    return Vec::new();
                }
                let own = &points[i * columns..(i + 1) * columns];
                let mut list: Vec<(f64, u32)> = points
                    .chunks_exact(columns)
                    .enumerate()
                    .filter_map(|(j, other)| {
                        let d = squared(own, other);
                        (j != i && d < reach).then_some((d, j as u32))
                    })
                    .collect();
                list.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
                list
            })
            .collect();
        let mut starts = Vec::with_capacity(count + 1);
        starts.push(0);
        let (mut ids, mut distances) = (Vec::new(), Vec::new());
        for list in lists {
            ids.extend(list.iter().map(|p| p.1));
            distances.extend(list.iter().map(|p| p.0));
            starts.push(ids.len());
        }
        Self {
            points,
            columns,
            reach,
            starts,
            ids,
            distances,
        }
    }

    /// Number of points.
    pub fn len(&self) -> usize {
        self.starts.len() - 1
    }

    /// Place of the first neighbour of i among those of all points.
    pub fn first(&self, i: usize) -> usize {
        self.starts[i]
    }

    /// Places of all neighbours.
    pub fn places(&self) -> usize {
        self.ids.len()
    }

    /// For the place of j among the neighbours of i that of i among the neighbours of j.
    pub fn twins(&self) -> Vec<u32> {
        (0..self.len())
            .into_par_iter()
            .flat_map_iter(|i| {
                let (ids, distances) = self.near(i);
                ids.iter().zip(distances).map(move |(&j, &d)| {
                    let (others, far) = self.near(j as usize);
                    let from = far.partition_point(|x| *x < d);
                    // Ids rise among equal distances.
                    let step = others[from..].iter().position(|&o| o as usize == i);
                    (self.starts[j as usize] + from + step.unwrap_or(0)) as u32
                })
            })
            .collect()
    }

    /// Squared distance of two points.
    pub fn distance(&self, i: usize, j: usize) -> f64 {
        let c = self.columns;
        squared(
            &self.points[i * c..(i + 1) * c],
            &self.points[j * c..(j + 1) * c],
        )
    }

    /// Neighbours of i with their squared distances, nearest first.
    pub fn near(&self, i: usize) -> (&[u32], &[f64]) {
        let range = self.starts[i]..self.starts[i + 1];
        (&self.ids[range.clone()], &self.distances[range])
    }

    /// Number of neighbours of each point nearer than the squared distance `t`.
    pub fn counts_below(&self, t: f64) -> Vec<u32> {
        (0..self.len())
            .map(|i| self.near(i).1.partition_point(|d| *d < t) as u32)
            .collect()
    }

    /// Smallest squared distance within `design`.
    pub fn smallest(&self, design: &[usize]) -> f64 {
        let mut least = f64::INFINITY;
        for (a, &i) in design.iter().enumerate() {
            for &j in &design[..a] {
                least = least.min(self.distance(i, j));
            }
        }
        least
    }
}

/// Points in farthest-point order: each next point is the one farthest from those before it.
#[derive(Debug)]
pub(crate) struct FarthestPoints {
    /// The points: first the fixed ones.
    pub order: Vec<usize>,
    /// Squared distance of each to those before it; shorter than the order after a cancellation,
    /// from which on points come in the order of the table.
    reached: Vec<f64>,
    /// Squared distance of the farthest point that is left.
    pub left: f64,
}

impl FarthestPoints {
    /// The least squared distance that the order reached, of which Gonzalez' bound is made;
    /// infinite where the order was not completed.
    pub fn radius(&self) -> f64 {
        if self.reached.len() < self.order.len() {
            return f64::INFINITY;
        }
        self.reached.iter().copied().fold(f64::INFINITY, f64::min)
    }

    /// The least squared distance between two points of the order.
    pub fn distance(&self, points: &[f64], columns: usize) -> f64 {
        if self.reached.len() == self.order.len() {
            return self.radius();
        }
        let at = |i: usize| &points[i * columns..(i + 1) * columns];
        let own = self.order.iter().enumerate();
        own.flat_map(|(a, &i)| self.order[..a].iter().map(move |&j| squared(at(i), at(j))))
            .fold(f64::INFINITY, f64::min)
    }
}

/// The first `n` points in farthest-point order.
///
/// The points of `from.0` are fixed and come first; without any, the first is `from.1`. Points
/// that are not `allowed` are never taken.
pub(crate) fn farthest_points(
    points: &[f64],
    columns: usize,
    n: usize,
    (fixed, start): (&[usize], usize),
    allowed: &[bool],
    control: &Control<'_>,
) -> FarthestPoints {
    let at = |i: usize| &points[i * columns..(i + 1) * columns];
    let count = points.len() / columns;
    let mut nearest = vec![f64::INFINITY; count];
    let mut order = Vec::with_capacity(n);
    let mut reached = Vec::with_capacity(n);
    let mut next = fixed.first().copied().unwrap_or(start);
    while order.len() < n {
        reached.push(nearest[next]);
        order.push(next);
        nearest[next] = -1.0;
        for (i, near) in nearest.iter_mut().enumerate() {
            if *near >= 0.0 {
                *near = near.min(squared(at(i), at(next)));
            }
        }
        if control.cancelled() {
            let rest = fixed.get(order.len()..).unwrap_or_default();
            order.extend(rest);
            let open = (0..count).filter(|&i| allowed[i] && nearest[i] >= 0.0);
            order.extend(open.take(n - order.len()).collect::<Vec<_>>());
            break;
        }
        next = match fixed.get(order.len()) {
            Some(&f) => f,
            None => {
                let far = (0..count)
                    .filter(|&i| allowed[i] && nearest[i] >= 0.0)
                    .max_by(|&a, &b| nearest[a].total_cmp(&nearest[b]).then(b.cmp(&a)));
                let Some(far) = far else { break };
                far
            }
        };
    }
    let left = nearest.iter().copied().fold(0.0, f64::max);
    FarthestPoints {
        order,
        reached,
        left,
    }
}

/// Squared diagonal of the box around the points: no two are farther apart.
pub(crate) fn box_diagonal(points: &[f64], columns: usize) -> f64 {
    let (lower, upper) = ecm_poly::normalise::ranges(points, columns);
    squared(&lower, &upper)
}
