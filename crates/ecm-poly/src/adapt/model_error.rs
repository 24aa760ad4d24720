//! Error of the model as constants that are alike at like poses, with their covariance to the parameters.
//!
//! δ(p) = σ (5/8 a₀ + 7/4 Σ θ_i a_i / reach + 5/8 a_cell(p)) + rest, each a of six numbers with standard
//! deviation 1: one part for all poses, one that grows with each rotation, one for the neighbourhood of p.
//! That of the neighbourhood and the rest grow towards the rim of the fitted domain, where no row on the far
//! side holds the model.
//! They are not estimated (Schmidt, Advances in Control Systems 3, 1966); their covariance with the
//! parameters is kept, so that the same poses again and again are no new information. The rest has a
//! fifth of the variance and changes on the way.

use ecm_se3::{Real, Vec6};

use super::parameters::Noise;

/// Neighbourhoods that are remembered; the one that was left longest ago makes room.
pub const CELLS: usize = 8;
/// Parts of the error: all poses, three rotations, neighbourhoods.
pub const PARTS: usize = 4 + CELLS;
/// Parts at one pose.
const AT_ONCE: usize = 5;

/// What is remembered of the model's error.
#[derive(Clone, Copy, Debug, PartialEq)]
#[repr(C)]
pub struct ModelError<R, const N: usize> {
    /// Covariance of each parameter with each part.
    pub cross: [[Vec6<R>; PARTS]; N],
    /// Middle of each neighbourhood.
    pub centres: [Vec6<R>; CELLS],
    /// Block of the last visit, 0: never.
    pub visits: [u32; CELLS],
}

/// The parts at a pose: their places, weights, and covariance with the parameters.
pub(super) struct Parts<R, const N: usize> {
    places: [usize; AT_ONCE],
    weights: [Vec6<R>; AT_ONCE],
    /// Cov(parameters, δ).
    pub shared: [Vec6<R>; N],
    /// Variance of δ that the parts make.
    pub variance: Vec6<R>,
    /// Variance of the rest, which changes on the way.
    pub rest: Vec6<R>,
    /// Variance that is stated for this pose.
    pub whole: Vec6<R>,
}

impl<R: Real, const N: usize> ModelError<R, N> {
    pub(super) const EMPTY: Self = Self {
        cross: [[[R::ZERO; 6]; PARTS]; N],
        centres: [[R::ZERO; 6]; CELLS],
        visits: [0; CELLS],
    };

    /// The neighbourhood of a pose, remembered from now on.
    pub(super) fn visit(&mut self, pose: &Vec6<R>, noise: &Noise<R>, block: u32) -> usize {
        let mut nearest = None;
        let mut least = R::HALF;
        for (i, centre) in self.centres.iter().enumerate() {
            let way = way(centre, pose, noise);
            if self.visits[i] > 0 && way < least {
                least = way;
                nearest = Some(i);
            }
        }
        let cell = nearest.unwrap_or_else(|| {
            let (mut oldest, mut last) = (0, self.visits[0]);
            for (i, &visit) in self.visits.iter().enumerate() {
                if visit < last {
                    (oldest, last) = (i, visit);
                }
            }
            self.centres[oldest] = *pose;
            for row in &mut self.cross {
                row[4 + oldest] = [R::ZERO; 6];
            }
            oldest
        });
        self.visits[cell] = block;
        cell
    }

    pub(super) fn parts(&self, cell: usize, pose: &Vec6<R>, noise: &Noise<R>) -> Parts<R, N> {
        let sd: Vec6<R> = core::array::from_fn(|a| noise.model[a / 3]);
        let alike = R::from_u16(5) / R::from_u16(8);
        let slope = R::from_u16(7) / R::from_u16(4);
        // No place is beyond the array, which the compiler sees: the adapter has no panic in it.
        let places = [0, 1, 2, 3, 4 + cell.min(CELLS - 1)];
        let grown = noise.away_from_middle(pose);
        let weights: [Vec6<R>; AT_ONCE] = core::array::from_fn(|k| {
            let turn = match k {
                0 => alike,
                1..=3 => slope * pose[2 + k] / noise.reach[1],
                _ => alike * grown,
            };
            sd.map(|s| turn * s)
        });
        let shared = core::array::from_fn(|i| {
            core::array::from_fn(|a| {
                (0..AT_ONCE).fold(R::ZERO, |sum, k| {
                    sum + self.cross[i][places[k]][a] * weights[k][a]
                })
            })
        });
        let variance = core::array::from_fn(|a| {
            weights
                .iter()
                .fold(R::ZERO, |sum, weight| sum + weight[a] * weight[a])
        });
        let rest = sd.map(|s| (grown * s) * (grown * s) / R::from_u16(5));
        Parts {
            places,
            weights,
            shared,
            variance,
            rest,
            whole: sd.map(|s| (grown * s) * (grown * s)),
        }
    }

    /// After x̃ ← A x̃ − G δ.
    pub(super) fn follow(&mut self, through: &[[R; N]; N], gain: &[Vec6<R>; N], at: &Parts<R, N>) {
        for part in 0..PARTS {
            let before: [Vec6<R>; N] = core::array::from_fn(|i| self.cross[i][part]);
            for i in 0..N {
                for a in 0..6 {
                    self.cross[i][part][a] =
                        (0..N).fold(R::ZERO, |sum, j| sum + through[i][j] * before[j][a]);
                }
            }
        }
        for (k, part) in at.places.iter().enumerate() {
            for i in 0..N {
                let cross = &mut self.cross[i][(*part).min(PARTS - 1)];
                for a in 0..6 {
                    cross[a] -= gain[i][a] * at.weights[k][a];
                }
            }
        }
    }
}

/// Way between two poses in units of the reach.
pub(super) fn way<R: Real>(from: &Vec6<R>, to: &Vec6<R>, noise: &Noise<R>) -> R {
    let mut way = R::ZERO;
    for i in 0..6 {
        let d = to[i] - from[i];
        way += if d < R::ZERO { -d } else { d } / noise.reach[i / 3];
    }
    way
}
