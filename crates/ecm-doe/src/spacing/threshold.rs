//! Threshold search: a subset without two points nearer than t, and t raised each time.
//!
//! Points nearer than t are in conflict. One point enters and one leaves until no conflict is
//! left: an independent set of size n in the conflict graph. Conflicts that persist gain weight,
//! so that the search leaves dead ends (edge weights and configuration checking of
//! Cai, Su, Luo and Sattar's NuMVC for vertex covers, the complements of independent sets).

use std::cmp::Reverse;

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::neighbours::Neighbours;
use crate::Control;

/// One search: its design, the threshold it works on, and the best it has reached.
#[derive(Debug, Clone)]
pub(crate) struct Chain<'a> {
    near: &'a Neighbours<'a>,
    twins: &'a [u32],
    /// Number of points that stay in the design (its first ones).
    fixed: usize,
    design: Vec<usize>,
    /// Position in the design, or `OUT`, or `BARRED` for points that must not be chosen.
    position: Vec<u32>,
    /// Weight of each pair of neighbours, at both its places.
    weights: Vec<u32>,
    /// Members of the design in conflict with each point, and the weight of these conflicts.
    conflicts: Vec<i32>,
    cost: Vec<i64>,
    /// Points of the design that may move and are in conflict.
    torn: Torn,
    /// Whether no neighbour has moved since the point entered: it must not leave again yet.
    settled: Vec<bool>,
    moved: Vec<u64>,
    /// The point that left last.
    last: usize,
    /// Weight that was added to all pairs, for forgetting.
    added: u64,
    /// Length of each neighbour list at the present threshold.
    lengths: Vec<u32>,
    threshold: f64,
    /// Relative raise of the threshold tried next.
    raise: f64,
    moves_here: usize,
    clock: u64,
    best: Vec<usize>,
    best_distance: f64,
    rng: ChaCha8Rng,
}

/// Swaps at one threshold, times its raise: large raises are given up sooner.
const PATIENCE_PER_RAISE: f64 = 40.0;
const OUT: u32 = u32::MAX;
const BARRED: u32 = u32::MAX - 1;

impl<'a> Chain<'a> {
    /// Starts from `design`, of which the first `fixed` points stay; `twins` are `near.twins()`.
    pub fn new(
        near: &'a Neighbours<'a>,
        twins: &'a [u32],
        design: Vec<usize>,
        fixed: usize,
        allowed: &[bool],
        rng: ChaCha8Rng,
    ) -> Self {
        let best_distance = near.smallest(&design);
        let count = allowed.len();
        let position = allowed
            .iter()
            .map(|a| if *a { OUT } else { BARRED })
            .collect();
        let mut chain = Self {
            near,
            twins,
            fixed,
            best: design.clone(),
            design,
            position,
            weights: vec![1; near.places()],
            conflicts: Vec::new(),
            cost: Vec::new(),
            torn: Torn::new(count),
            settled: vec![false; count],
            moved: vec![0; count],
            last: usize::MAX,
            added: 0,
            lengths: Vec::new(),
            threshold: 0.0,
            raise: 0.02,
            moves_here: 0,
            clock: 1,
            best_distance,
            rng,
        };
        for (p, &i) in chain.design.iter().enumerate() {
            chain.position[i] = p as u32;
        }
        chain.aim();
        chain
    }

    /// Squared smallest distance of the best design.
    pub fn best_distance(&self) -> f64 {
        self.best_distance
    }

    /// The best design.
    pub fn best(&self) -> &[usize] {
        &self.best
    }

    /// Goes on from another design when it is better than this chain's own.
    pub fn adopt(&mut self, design: &[usize], distance: f64, raise: f64) {
        if distance <= self.best_distance {
            return;
        }
        for &i in &self.design[self.fixed..] {
            self.position[i] = OUT;
        }
        self.design.copy_from_slice(design);
        for (p, &i) in self.design.iter().enumerate() {
            self.position[i] = p as u32;
        }
        self.best.copy_from_slice(design);
        self.best_distance = distance;
        self.raise = raise;
        self.aim();
    }

    /// The next raise that this chain would try.
    pub fn raise(&self) -> f64 {
        self.raise
    }

    /// Sets the threshold above the best distance and counts the conflicts again.
    fn aim(&mut self) {
        let t = self.best_distance * (1.0 + self.raise) * (1.0 + self.raise);
        // At least the next number, so that the closest pair of the best is in conflict.
        self.threshold = t.max(self.best_distance.next_up()).min(self.near.reach);
        self.lengths = self.near.counts_below(self.threshold);
        self.recount();
        self.moves_here = 0;
    }

    fn recount(&mut self) {
        let near = self.near;
        self.conflicts = vec![0; near.len()];
        self.cost = vec![0; near.len()];
        for &i in &self.design {
            let (ids, _) = near.near(i);
            let weights = &self.weights[near.first(i)..];
            for (&j, &w) in ids[..self.lengths[i] as usize].iter().zip(weights) {
                self.conflicts[j as usize] += 1;
                self.cost[j as usize] += i64::from(w);
            }
        }
        self.torn.clear();
        for &i in &self.design[self.fixed..] {
            if self.conflicts[i] > 0 {
                self.torn.add(i);
            }
        }
    }

    /// Up to `moves` swaps; `patience` of them without success lower the raise.
    pub fn run(&mut self, moves: usize, patience: usize, control: &Control<'_>) {
        for step in 0..moves {
            if step.is_multiple_of(512) && control.stop() {
                return;
            }
            if !self.step() {
                let reached = self.near.smallest(&self.design);
                if reached > self.best_distance {
                    self.best_distance = reached;
                    self.best.copy_from_slice(&self.design);
                } else {
                    // Two points that must stay are the closest pair: nothing can be gained.
                    return;
                }
                if self.threshold >= self.near.reach {
                    return;
                }
                self.raise = (self.raise * 1.5).min(0.05);
                self.aim();
            } else if self.moves_here > patience.min((PATIENCE_PER_RAISE / self.raise) as usize) {
                // Too high: come nearer to a distance that is known to be possible.
                self.raise = (self.raise * 0.5).max(1e-9);
                self.aim();
            }
        }
    }

    /// One swap; `false` when there is no conflict left.
    ///
    /// The point outside with the smallest weight of conflicts enters (the longest outside among
    /// equals), then an end of a random conflict leaves.
    fn step(&mut self) -> bool {
        if self.torn.list.is_empty() {
            return false;
        }
        self.clock += 1;
        self.moves_here += 1;
        let mut entering = usize::MAX;
        let (mut least, mut oldest) = (i64::MAX, u64::MAX);
        for (i, (&cost, &position)) in self.cost.iter().zip(&self.position).enumerate() {
            if cost <= least && position == OUT && i != self.last {
                let moved = self.moved[i];
                if cost < least || moved < oldest {
                    (entering, least, oldest) = (i, cost, moved);
                }
            }
        }
        if entering == usize::MAX {
            return true;
        }
        // Until the other leaves, the design has one more.
        self.position[entering] = self.design.len() as u32;
        self.design.push(entering);
        if self.conflicts[entering] > 0 {
            self.torn.add(entering);
        }
        self.spread::<1>(entering);
        self.settled[entering] = true;
        let one = self.torn.list[self.rng.random_range(0..self.torn.list.len())] as usize;
        let leaving = self.end_of_conflict(one);
        let place = self.position[leaving] as usize;
        self.design.swap_remove(place);
        if let Some(&moved) = self.design.get(place) {
            self.position[moved] = place as u32;
        }
        self.position[leaving] = OUT;
        if self.conflicts[leaving] > 0 {
            self.torn.remove(leaving);
        }
        self.spread::<-1>(leaving);
        self.last = leaving;
        self.moved[entering] = self.clock;
        self.moved[leaving] = self.clock;
        self.weigh();
        true
    }

    /// The conflicts of the neighbours of i, which has entered (`BY` = 1) or left (-1).
    fn spread<const BY: i32>(&mut self, i: usize) {
        let near = self.near;
        let (ids, _) = near.near(i);
        let first = near.first(i);
        for (at, &j) in ids[..self.lengths[i] as usize].iter().enumerate() {
            let j = j as usize;
            self.settled[j] = false;
            self.cost[j] += i64::from(BY) * i64::from(self.weights[first + at]);
            self.conflicts[j] += BY;
            let position = self.position[j];
            if position < BARRED && position as usize >= self.fixed {
                match (BY, self.conflicts[j]) {
                    (1, 1) => self.torn.add(j),
                    (-1, 0) => self.torn.remove(j),
                    _ => {}
                }
            }
        }
    }

    /// The end of a random conflict of `one` that is to leave: of larger weight, then older.
    fn end_of_conflict(&mut self, one: usize) -> usize {
        let near = self.near;
        let (ids, _) = near.near(one);
        let mut other = one;
        let mut seen = 0;
        for &j in &ids[..self.lengths[one] as usize] {
            let position = self.position[j as usize];
            if position < BARRED && position as usize >= self.fixed {
                seen += 1;
                if self.rng.random_range(0..seen) == 0 {
                    other = j as usize;
                }
            }
        }
        if self.settled[one] != self.settled[other] {
            return if self.settled[one] { other } else { one };
        }
        let key = |i: usize| (self.cost[i], Reverse(self.moved[i]));
        if key(other) > key(one) { other } else { one }
    }

    /// Raises the weights of present conflicts; from time to time all weights decay.
    fn weigh(&mut self) {
        let near = self.near;
        for &i in &self.torn.list {
            let i = i as usize;
            let (ids, _) = near.near(i);
            let first = near.first(i);
            for (at, &j) in ids[..self.lengths[i] as usize].iter().enumerate() {
                let j = j as usize;
                let position = self.position[j];
                if position >= BARRED || (j < i && position as usize >= self.fixed) {
                    continue;
                }
                self.weights[first + at] += 1;
                self.weights[self.twins[first + at] as usize] += 1;
                self.cost[i] += 1;
                self.cost[j] += 1;
                self.added += 1;
            }
        }
        let pairs = self.weights.len() as u64 / 2;
        if self.added > pairs * (self.position.len() as u64 / 2).max(50) {
            for w in &mut self.weights {
                *w = (f64::from(*w) * FORGOTTEN).max(1.0) as u32;
            }
            self.added = (self.added as f64 * FORGOTTEN) as u64;
            self.recount();
        }
    }
}

/// Factor of the decay of the weights.
const FORGOTTEN: f64 = 0.3;

/// A set of points with additions and removals in constant time.
#[derive(Debug, Clone)]
struct Torn {
    list: Vec<u32>,
    place: Vec<u32>,
}

impl Torn {
    fn new(points: usize) -> Self {
        Self {
            list: Vec::new(),
            place: vec![0; points],
        }
    }

    fn clear(&mut self) {
        self.list.clear();
    }

    fn add(&mut self, point: usize) {
        self.place[point] = self.list.len() as u32;
        self.list.push(point as u32);
    }

    fn remove(&mut self, point: usize) {
        let place = self.place[point] as usize;
        self.list.swap_remove(place);
        if let Some(&moved) = self.list.get(place) {
            self.place[moved as usize] = place as u32;
        }
    }
}
