//! Threshold search: a subset without two points nearer than t, and t raised each time.
//!
//! Points nearer than t are in conflict. A tabu search swaps a point with most conflicts for
//! one outside with fewest until none is left (an independent set of size n in the conflict
//! graph; Wu and Hao's tabu search for cliques with fixed size is its mirror image).

use rand::RngExt;
use rand_chacha::ChaCha8Rng;

use super::neighbours::Neighbours;
use crate::Control;

/// One search: its design, the threshold it works on, and the best it has reached.
#[derive(Debug, Clone)]
pub(crate) struct Chain<'a> {
    near: &'a Neighbours<'a>,
    /// Points that stay in the design (they stand first).
    fixed: usize,
    design: Vec<usize>,
    /// Position in the design, or `OUT`, or `BARRED` for points that must not be chosen.
    position: Vec<u32>,
    /// Members of the design in conflict with each point.
    conflicts: Vec<i32>,
    /// Length of each neighbour list at the present threshold.
    lengths: Vec<u32>,
    tabu_until: Vec<u64>,
    threshold: f64,
    /// Relative raise of the threshold tried next.
    raise: f64,
    moves_here: usize,
    clock: u64,
    best: Vec<usize>,
    best_distance: f64,
    rng: ChaCha8Rng,
    ties_in: Vec<usize>,
    ties_out: Vec<usize>,
}

/// Swaps at one threshold, times its raise: large raises are given up sooner.
const PATIENCE_PER_RAISE: f64 = 40.0;
const OUT: u32 = u32::MAX;
const BARRED: u32 = u32::MAX - 1;

impl<'a> Chain<'a> {
    /// Starts from `design`, of which the first `fixed` points stay.
    pub fn new(
        near: &'a Neighbours<'a>,
        design: Vec<usize>,
        fixed: usize,
        allowed: &[bool],
        rng: ChaCha8Rng,
    ) -> Self {
        let best_distance = near.smallest(&design);
        let position = allowed
            .iter()
            .map(|a| if *a { OUT } else { BARRED })
            .collect();
        let mut chain = Self {
            near,
            fixed,
            best: design.clone(),
            design,
            position,
            conflicts: Vec::new(),
            lengths: Vec::new(),
            tabu_until: vec![0; allowed.len()],
            threshold: 0.0,
            raise: 0.02,
            moves_here: 0,
            clock: 1,
            best_distance,
            rng,
            ties_in: Vec::new(),
            ties_out: Vec::new(),
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

    /// Sets the threshold above the best distance and counts the conflicts anew.
    fn aim(&mut self) {
        let t = self.best_distance * (1.0 + self.raise) * (1.0 + self.raise);
        // At least the next number, so that the closest pair of the best is in conflict.
        self.threshold = t.max(self.best_distance.next_up()).min(self.near.reach);
        self.lengths = self.near.counts_below(self.threshold);
        self.conflicts = vec![0; self.near.len()];
        for &i in &self.design {
            let (ids, _) = self.near.near(i);
            for &j in &ids[..self.lengths[i] as usize] {
                self.conflicts[j as usize] += 1;
            }
        }
        self.moves_here = 0;
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
                }
                if self.threshold >= self.near.reach {
                    return;
                }
                self.raise = (self.raise * 1.5).min(0.05);
                self.aim();
            } else if self.moves_here > patience.min((PATIENCE_PER_RAISE / self.raise) as usize) {
                // Too high: come nearer to what is known to be possible.
                self.raise = (self.raise * 0.5).max(1e-9);
                self.aim();
            }
        }
    }

    /// One swap; `false` when there is no conflict left.
    fn step(&mut self) -> bool {
        let (mut worst, mut total) = (0, 0);
        self.ties_in.clear();
        for &i in &self.design[self.fixed..] {
            let c = self.conflicts[i];
            total += c;
            if c == 0 || self.tabu_until[i] > self.clock {
                continue;
            }
            if c > worst {
                worst = c;
                self.ties_in.clear();
            }
            if c == worst {
                self.ties_in.push(i);
            }
        }
        if total == 0 {
            return false;
        }
        let mut fewest = i32::MAX;
        for (i, (&c, &until)) in self.conflicts.iter().zip(&self.tabu_until).enumerate() {
            if c <= fewest && until <= self.clock && self.position[i] == OUT {
                if c < fewest {
                    fewest = c;
                    self.ties_out.clear();
                }
                self.ties_out.push(i);
            }
        }
        self.clock += 1;
        self.moves_here += 1;
        if self.ties_in.is_empty() || fewest == i32::MAX {
            // Everything is tabu: any conflicting point may move again later.
            return true;
        }
        let (leaving, entering) = self.pick();
        // Small sets would be tabu as a whole.
        let most = ((self.position.len() - self.design.len()) as i64 / 3).max(1);
        let base = i64::from(total.min(10)).min(most);
        let spread = ((self.design.len() / 40).max(6) as i64).min(most);
        let stay_out = base + self.rng.random_range(0..spread);
        let stay_in = (6 * base + self.rng.random_range(0..6 * spread)) / 10;
        self.tabu_until[leaving] = self.clock + stay_out as u64;
        self.tabu_until[entering] = self.clock + stay_in as u64;
        self.replace(leaving, entering);
        true
    }

    /// A pair in conflict with each other if there is one: its conflict vanishes as well.
    fn pick(&mut self) -> (usize, usize) {
        let (a, b) = (self.ties_in.len(), self.ties_out.len());
        let (first, second) = (self.rng.random_range(0..a), self.rng.random_range(0..b));
        let tries = (a * b).min(64);
        for t in 0..tries {
            let leaving = self.ties_in[(first + t / b) % a];
            let entering = self.ties_out[(second + t) % b];
            if self.near.distance(leaving, entering) < self.threshold {
                return (leaving, entering);
            }
        }
        (self.ties_in[first], self.ties_out[second])
    }

    fn replace(&mut self, leaving: usize, entering: usize) {
        let p = self.position[leaving];
        self.design[p as usize] = entering;
        self.position[entering] = p;
        self.position[leaving] = OUT;
        let (ids, _) = self.near.near(leaving);
        for &j in &ids[..self.lengths[leaving] as usize] {
            self.conflicts[j as usize] -= 1;
        }
        let (ids, _) = self.near.near(entering);
        for &j in &ids[..self.lengths[entering] as usize] {
            self.conflicts[j as usize] += 1;
        }
    }
}
