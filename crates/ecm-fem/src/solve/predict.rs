//! A first guess of a state from the states solved so far.
//!
//! Every component of the state is a polynomial of the load's point (see
//! [`Fem::points`]; scaled to [−1, 1]), fitted by least squares to all solved cases;
//! the degree grows with their number. From such a guess Newton needs three steps where it needs six from the
//! nearest neighbour.

use super::batch::Solved;
use super::{Fem, State};
use crate::platform::Platform;
use nalgebra::DMatrix;

/// Degree and solved cases it needs: twice the number of terms, 7, 28, 84, 210.
const NEEDED: [(usize, usize); 4] = [(4, 420), (3, 168), (2, 56), (1, 14)];

/// A tiny ridge on the normalised normal equations: terms that the cases do not tell
/// apart share their coefficient instead of cancelling.
const RIDGE: f64 = 1e-10;

/// Polynomials for all components of the state.
#[derive(Debug)]
pub(super) struct Predictor {
    degree: usize,
    scale: [f64; 6],
    /// Component after component, one coefficient per term.
    coefficients: Vec<f64>,
    /// Number of solved cases behind it.
    pub cases: usize,
}

/// All monomials of six variables up to `degree`, lowest first.
fn monomials(x: &[f64; 6], degree: usize, out: &mut Vec<f64>) {
    out.clear();
    out.push(1.0);
    // Each monomial of one degree times the variables from its last one on.
    let mut last: Vec<(usize, usize)> = vec![(0, 0)];
    for _ in 0..degree {
        let mut next = Vec::new();
        for &(index, first) in &last {
            for (k, value) in x.iter().enumerate().skip(first) {
                out.push(out[index] * value);
                next.push((out.len() - 1, k));
            }
        }
        last = next;
    }
}

/// Degree that `cases` solved cases carry, if any.
pub(super) fn degree_for(cases: usize) -> Option<usize> {
    NEEDED
        .iter()
        .find(|(_, needed)| cases >= *needed)
        .map(|(degree, _)| *degree)
}

impl Predictor {
    /// Fits the solved states at their `points` (see [`Fem::points`]); `None` when too few.
    pub fn fit(solved: &[(&[f64; 6], &Solved)]) -> Option<Self> {
        let degree = degree_for(solved.len())?;
        let mut scale = [f64::MIN_POSITIVE; 6];
        for (point, _) in solved {
            for k in 0..6 {
                scale[k] = scale[k].max(point[k].abs());
            }
        }
        let mut row = Vec::new();
        let mut features = Vec::new();
        for (point, _) in solved {
            monomials(
                &std::array::from_fn(|k| point[k] / scale[k]),
                degree,
                &mut row,
            );
            features.extend_from_slice(&row);
        }
        let (terms, cases) = (row.len(), solved.len());
        let phi = DMatrix::from_vec(terms, cases, features);
        let mut normal = &phi * phi.transpose();
        let ridge = RIDGE * cases as f64;
        for k in 0..terms {
            normal[(k, k)] += ridge;
        }
        let weights = normal.cholesky()?.solve(&phi);
        let components = solved[0].1.components().count();
        let mut coefficients = vec![0.0; components * terms];
        for (case, (_, state)) in solved.iter().enumerate() {
            let weight = weights.column(case);
            for (component, value) in state.components().enumerate() {
                let target = &mut coefficients[component * terms..(component + 1) * terms];
                for (c, w) in target.iter_mut().zip(weight.iter()) {
                    *c += w * value;
                }
            }
        }
        Some(Self {
            degree,
            scale,
            coefficients,
            cases,
        })
    }

    /// The state guessed for a load at `point`.
    pub fn state(&self, point: &[f64; 6], fem: &Fem) -> State {
        let mut terms = Vec::new();
        monomials(
            &std::array::from_fn(|k| point[k] / self.scale[k]),
            self.degree,
            &mut terms,
        );
        let mut values = self
            .coefficients
            .chunks_exact(terms.len())
            .map(|c| c.iter().zip(&terms).map(|(a, b)| a * b).sum::<f64>());
        let pose: [f64; 6] = std::array::from_fn(|_| values.next().unwrap_or_default());
        let mut state = fem.rest();
        state.platform = Platform::from_pose(&pose);
        let field = &mut state.field;
        for (slot, value) in field
            .displacement
            .iter_mut()
            .chain(&mut field.pressure)
            .zip(values)
        {
            *slot = value;
        }
        state
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn monomials_are_complete_and_distinct() {
        let x = [2.0, 3.0, 5.0, 7.0, 11.0, 13.0];
        for (degree, count) in [(1, 7), (2, 28), (3, 84), (4, 210)] {
            let mut terms = Vec::new();
            monomials(&x, degree, &mut terms);
            assert_eq!(terms.len(), count);
            // Primes: equal products are equal monomials.
            terms.sort_by(f64::total_cmp);
            terms.dedup();
            assert_eq!(terms.len(), count);
        }
    }
}
